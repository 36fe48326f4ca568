//! Everything that is measured, put together. The order of the fields is that of the page.

use super::counts::Counted;
use super::evt::Evt;
use super::figures::Figures;
use super::machine::Machine;
use super::response::Response;
use super::search::Search;
use super::times::Summary;
use screed_tape::vectors::{ARMS, Class, Course};
use serde::Serialize;

/// Cycles that an instruction may take, for columns: on average, a processor with caches and several ways at once stays below 2; one
/// without stays below 4; 8 stands for cold memory.
pub const CYCLES_PER_INSTRUCTION: [u64; 3] = [2, 4, 8];

/// The budgets: periods of a cycle (ns).
pub const BUDGETS_NS: [u64; 3] = [8_000_000, 2_000_000, 1_000_000];

/// By how much the largest that was seen is multiplied before a budget is divided by it. What is seen is never the worst; Cazorla and
/// others report 1.2 and more as industry's habit, this is more than twice that.
pub const MARGIN_FACTOR: f64 = 3.0;

/// Instructions of one arm and class.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Instructions {
    /// The arm.
    pub arm: &'static str,
    /// The class.
    pub class: &'static str,
    /// How many calls.
    pub vectors: usize,
    /// The fewest.
    pub min: u64,
    /// On average.
    pub mean: f64,
    /// The most.
    pub max: u64,
    /// Which call took the most: the course's name and its tick.
    pub worst: String,
    /// The course's number among those that are compared.
    pub course: Option<u32>,
    /// The most, times [`CYCLES_PER_INSTRUCTION`].
    pub cycles: [u64; 3],
}

/// A budget divided by what was seen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Margin {
    /// Of what.
    pub what: String,
    /// The largest seen under the stall rule (ns).
    pub largest_ns: u64,
    /// The largest seen of all (ns).
    pub largest_with_stalls_ns: u64,
    /// The factor.
    pub factor: f64,
    /// Budget over largest times factor, for each of [`BUDGETS_NS`], under the stall rule.
    pub margins: [f64; 3],
    /// The same with stalls.
    pub margins_with_stalls: [f64; 3],
}

/// A row of the loops' list.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LoopBound {
    /// The file.
    pub file: String,
    /// The function.
    pub function: String,
    /// Turns at most.
    pub turns: String,
    /// What asserts it.
    pub asserted_by: String,
}

/// Extreme values of one row of times.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EvtOf {
    /// Of what.
    pub what: String,
    /// What came of it.
    pub evt: Evt,
}

/// Stack of one class.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Painted {
    /// The class.
    pub class: &'static str,
    /// The deepest (bytes).
    pub bytes: usize,
}

/// The report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Whether it was made in a hurry.
    pub quick: bool,
    /// Point 1.
    pub machine: Machine,
    /// Whether the paced part ran hard-timed, and what was refused.
    pub scheduling: String,
    /// Point 2: courses, and ticks among their calls.
    pub courses: usize,
    /// Ticks.
    pub ticks: usize,
    /// Every loop of the kernel with its bound.
    pub loops: Vec<LoopBound>,
    /// Point 3.
    pub instructions: Vec<Instructions>,
    /// The whole cycle's: fewest, mean, most.
    pub cycle_instructions: CycleInstructions,
    /// The committed figures.
    pub committed: Figures,
    /// Point 4.
    pub times: Vec<Summary>,
    /// Stall rule (ns).
    pub stall_ns: u64,
    /// Point 5.
    pub search: Search,
    /// Point 6.
    pub painted: Vec<Painted>,
    /// Point 8.
    pub evt: Vec<EvtOf>,
    /// Point 9.
    pub responses: Vec<Response>,
    /// Point 10.
    pub margins: Vec<Margin>,
}

/// Instructions of the whole cycle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CycleInstructions {
    /// Cycles.
    pub cycles: usize,
    /// The fewest.
    pub min: u64,
    /// On average.
    pub mean: f64,
    /// The most.
    pub max: u64,
    /// Which one that was, counted from the first of the demo's print.
    pub worst: usize,
    /// The most, times [`CYCLES_PER_INSTRUCTION`].
    pub cycles_at: [u64; 3],
}

impl CycleInstructions {
    /// Of counts in order; none of none.
    pub fn of(counts: &[u64]) -> Option<Self> {
        let (worst, max) = counts.iter().copied().enumerate().max_by_key(|(_, count)| *count)?;
        let mean = counts.iter().sum::<u64>() as f64 / counts.len() as f64;
        Some(Self {
            cycles: counts.len(),
            min: counts.iter().copied().min()?,
            mean,
            max,
            worst,
            cycles_at: CYCLES_PER_INSTRUCTION.map(|cycles| cycles * max),
        })
    }
}

/// Instructions by arm and class, in order.
pub fn instructions(counted: &[Counted], courses: &[Course]) -> Vec<Instructions> {
    let mut rows = Vec::new();
    for (arm, name) in ARMS.into_iter().enumerate() {
        for class in Class::ALL {
            let mine = || counted.iter().filter(|counted| counted.call.arm == arm && counted.call.class == class);
            let Some(worst) = mine().max_by_key(|counted| counted.call.count) else { continue };
            let vectors = mine().count();
            let number = courses.iter().position(|course| *course == worst.course);
            rows.push(Instructions {
                arm: name,
                class: class.name(),
                vectors,
                min: mine().map(|counted| counted.call.count).min().unwrap_or(0),
                mean: mine().map(|counted| counted.call.count).sum::<u64>() as f64 / vectors as f64,
                max: worst.call.count,
                worst: format!("{} tick {}", worst.course, worst.call.tick),
                course: number.and_then(|number| u32::try_from(number).ok()),
                cycles: CYCLES_PER_INSTRUCTION.map(|cycles| cycles * worst.call.count),
            });
        }
    }
    rows
}

/// Every loop of the kernel, as docs/kernel-loops.md has it.
pub fn loops() -> Vec<LoopBound> {
    include_str!("../../../docs/kernel-loops.md")
        .lines()
        .filter(|line| line.starts_with("| `"))
        .filter_map(|line| {
            let mut cells = line.trim_matches('|').split('|').map(|cell| cell.trim().replace('`', ""));
            let (file, function, _) = (cells.next()?, cells.next()?, cells.next()?);
            Some(LoopBound { file, function, turns: cells.next()?, asserted_by: cells.next()? })
        })
        .collect()
}

/// A budget over the largest time and the factor.
pub fn margin(what: &str, largest_ns: u64, largest_with_stalls_ns: u64) -> Margin {
    let margins = |largest: u64| BUDGETS_NS.map(|budget| budget as f64 / (largest as f64 * MARGIN_FACTOR));
    Margin {
        what: what.to_owned(),
        largest_ns,
        largest_with_stalls_ns,
        factor: MARGIN_FACTOR,
        margins: margins(largest_ns),
        margins_with_stalls: margins(largest_with_stalls_ns),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_of_the_loops_is_read() {
        let loops = loops();
        let rows = include_str!("../../../docs/kernel-loops.md").lines().filter(|line| line.contains(".rs` |")).count();
        assert!(loops.len() == rows && rows > 50, "{} of {rows}", loops.len());
        assert!(loops.iter().all(|row| !row.turns.is_empty() && !row.asserted_by.is_empty()), "{loops:?}");
    }
}
