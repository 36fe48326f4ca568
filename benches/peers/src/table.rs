//! What is compared, and the table of it.

use crate::arms::Ours;
use crate::check::{self, Agreement};
use crate::child::{Job, Outcome};
use crate::race::{self, Pair, Timed};
use crate::record::{self, Record};
use std::fs;
use std::path::Path;

/// Inputs on which both must agree, and those that are timed.
const CHECKED: usize = 100_000;
const TIMED: usize = 1_000;

/// The folders of the workers, by what their compilers were told of the processor: nothing (x86-64), or x86-64-v3.
const BUILDS: [&str; 2] = ["x86-64", "x86-64-v3"];

/// A line of the table: what ours does, and the peer that does the same work.
struct Line {
    ours: Ours,
    item: &'static str,
    program: &'static str,
    theirs: &'static str,
    builds: &'static [&'static str],
    /// How many times faster ours is meant to be.
    goal: f64,
}

fn lines() -> Outcome<Vec<Line>> {
    let line = |arm, item, program, theirs, goal| -> Outcome<Line> {
        let ours = Ours::named(arm).ok_or_else(|| format!("no such arm: {arm}"))?;
        Ok(Line { ours, item, program, theirs, builds: &BUILDS, goal })
    };
    let mut lines = vec![
        line("ur10e", "all-verified", "ur-analytic-ik", "all", 8.0)?,
        line("ur10e", "all", "ur-analytic-ik-unverified", "all", 8.0)?,
        line("ur10e", "nearest-verified", "ur-analytic-ik", "nearest", 30.0)?,
        line("ur10e", "nearest", "ur-analytic-ik-unverified", "nearest", 30.0)?,
        line("ur10e", "jacobian", "kdl", "jacobian", 20.0)?,
        Line { builds: &["x86-64"], ..line("ur10e", "jacobian", "kdl-debian", "jacobian", 20.0)? },
    ];
    for arm in ["kr120-r2500-pro", "kr210-r2700-2", "irb140", "irb6700-200-2.60", "nj130-2.6"] {
        lines.push(line(arm, "all-verified", "rs-opw-kinematics", "opw-all", 6.0)?);
        lines.push(line(arm, "nearest-verified", "rs-opw-kinematics", "opw-nearest", 6.0)?);
    }
    Ok(lines)
}

/// Compares answers, then time and instructions, of the workers in the folders of `workers`.
///
/// # Errors
/// Answers that differ, or a worker that fails.
pub fn side_by_side(workers: &Path) -> Outcome<()> {
    let folder = tempfile::tempdir()?;
    let lines = lines()?;
    println!("the same answers at {CHECKED} random poses (seed 1)");
    for line in &lines {
        let records = record::random(&line.ours.arm, CHECKED, 1);
        let inputs = folder.path().join("checked");
        let hash = record::write(&inputs, &records)?;
        println!("  {}; inputs {hash:016x}", line.title());
        for build in line.builds {
            let found = line.compare(&line.pair(&workers.join(build), &inputs, CHECKED), &records);
            let found = found.map_err(|error| format!("{}, {build}: {error}", line.title()))?;
            let nearer = if found.nearer == 0 { String::new() } else { format!("; {} of ours nearer", found.nearer) };
            println!("    {build:<10} {} the same, differing by {:.1e} at most{nearer}", found.common, found.worst);
        }
    }

    let (mut pairs, mut hashes) = (Vec::new(), Vec::new());
    // They stay, for a profiler.
    let kept = workers.join("inputs");
    fs::create_dir_all(&kept)?;
    for line in &lines {
        let inputs = kept.join(line.ours.arm.name);
        hashes.push(record::write(&inputs, &record::random(&line.ours.arm, TIMED, 2))?);
        pairs.extend(line.builds.iter().map(|build| line.pair(&workers.join(build), &inputs, TIMED)));
    }
    let times = pairs.iter().map(race::time).collect::<Outcome<Vec<Timed>>>()?;
    let counts = race::count(&pairs, folder.path())?;

    println!("\none input, of {TIMED} random poses (seed 2); ns of processor time, median");
    println!("    {:<10} {:>16} {:>18} {:>34}", "", "ours", "theirs", "theirs / ours");
    println!(
        "    {:<10} {:>8} {:>7} {:>10} {:>7} {:>9} {:<13} {:>12} {:>6}",
        "", "ns", "instr.", "ns", "instr.", "time", "(quartiles)", "instructions", "goal"
    );
    let mut rows = times.iter().zip(&counts);
    for (line, hash) in lines.iter().zip(hashes) {
        println!("  {}; inputs {hash:016x}", line.title());
        for (build, (time, [ours, theirs])) in line.builds.iter().zip(&mut rows) {
            let [low, median, high] = time.ratio;
            let quartiles = format!("({low:.1}-{high:.1})");
            println!(
                "    {build:<10} {:>8.0} {ours:>7.0} {:>10.0} {theirs:>7.0} {median:>9.1} {quartiles:<13} {:>12.1} {:>6}",
                time.ours,
                time.theirs,
                theirs / ours,
                line.goal
            );
        }
    }
    Ok(())
}

impl Line {
    fn title(&self) -> String {
        let what = match self.item {
            "all-verified" => "inverse, all branches, each verified",
            "all" => "inverse, all branches, none verified",
            "nearest-verified" => "inverse, nearest branch, verified",
            "nearest" => "inverse, nearest branch, not verified",
            _ => "forward, with Jacobian",
        };
        format!("{}: {what}; {}", self.ours.arm.name, self.program)
    }

    fn pair(&self, workers: &Path, inputs: &Path, count: usize) -> Pair {
        let arm = self.ours.arm.name;
        let job = |program, item| Job { program: workers.join(program), item, arm, inputs: inputs.to_path_buf() };
        Pair { ours: job("screed-peers", self.item), theirs: job(self.program, self.theirs), inputs: count }
    }

    fn compare(&self, pair: &Pair, records: &[Record]) -> Outcome<Agreement> {
        match self.item {
            "all-verified" | "all" => check::branches(&pair.ours, &pair.theirs, records.len()),
            "nearest-verified" | "nearest" => check::nearest(&pair.ours, &pair.theirs, records),
            // A pose, three rows of four, and a Jacobian.
            _ => check::numbers(&pair.ours, &pair.theirs, records.len(), 12 + 36),
        }
    }
}
