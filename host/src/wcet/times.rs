//! Times of the tick under conditions that only get worse: caches warm, caches cold, caches cold and the branch predictor full of
//! something else, and with a program on another processor that takes the memory.

use super::WcetError;
use super::counts::Counted;
use super::disturb::{CoRunner, Disturber};
use screed_tape::vectors::{Class, Course, Edge};
use serde::Serialize;
use std::time::{Duration, Instant};

/// Longer than this no call takes by itself: the machine's host or another program had the processor. Fixed beforehand: the shortest
/// of the budgets. Such samples are counted, kept in the raw samples, and left out of the figures that say so.
pub const STALL_NS: u64 = 1_000_000;

/// What is done to the machine before each tick, or beside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Condition {
    /// Nothing.
    Warm,
    /// Every line of the program and of what the tick works on is put out of every cache.
    Cold,
    /// The same, and 16,384 branches of other code are run.
    ColdBranches,
    /// Nothing; a program on another processor writes 64 MiB over and over.
    CoRunner,
}

impl Condition {
    /// Every condition.
    pub const ALL: [Self; 4] = [Self::Warm, Self::Cold, Self::ColdBranches, Self::CoRunner];

    /// Its name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Warm => "warm",
            Self::Cold => "cold caches",
            Self::ColdBranches => "cold, branches thrashed",
            Self::CoRunner => "co-runner",
        }
    }
}

/// One measured call.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// What it was; none of a whole cycle.
    pub class: Option<Class>,
    /// When it was taken, among all of its condition.
    pub index: u32,
    /// How long it took (ns).
    pub ns: u64,
}

/// What samples of one condition came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// What was measured.
    pub what: String,
    /// Under which condition.
    pub condition: Condition,
    /// Samples, stalls included.
    pub count: usize,
    /// Half were not longer (ns).
    pub median_ns: u64,
    /// 99 % were not longer (ns).
    pub p99_ns: u64,
    /// 99.9 % were not longer (ns).
    pub p999_ns: u64,
    /// The longest that was no stall (ns).
    pub max_ns: u64,
    /// The longest of all (ns).
    pub max_with_stalls_ns: u64,
    /// Samples that the stall rule leaves out.
    pub stalls: usize,
    /// The whole histogram: upper edge of a bin (ns), eight to a doubling, and count; empty bins are left out.
    pub histogram: Vec<(u64, u64)>,
}

impl Summary {
    /// Of times (ns); none of none.
    pub fn of(what: &str, condition: Condition, times: impl Iterator<Item = u64>) -> Option<Self> {
        let mut all: Vec<u64> = times.collect();
        all.sort_unstable();
        let kept = all.partition_point(|ns| *ns <= STALL_NS);
        let at = |share: f64| {
            let rank = (share * kept as f64).ceil().max(1.0) as usize;
            all.get(..kept).and_then(|kept| kept.get(rank - 1)).copied()
        };
        Some(Self {
            what: what.to_owned(),
            condition,
            count: all.len(),
            median_ns: at(0.5)?,
            p99_ns: at(0.99)?,
            p999_ns: at(0.999)?,
            max_ns: at(1.0)?,
            max_with_stalls_ns: *all.last()?,
            stalls: all.len() - kept,
            histogram: histogram(&all),
        })
    }
}

/// Counts between edges that are eight to a doubling.
pub fn histogram(sorted: &[u64]) -> Vec<(u64, u64)> {
    let mut bins: Vec<(u64, u64)> = Vec::new();
    for ns in sorted {
        let edge = (8.0 * (*ns as f64).max(1.0).log2()).ceil();
        let edge = (edge / 8.0).exp2().ceil() as u64;
        match bins.last_mut() {
            Some((last, count)) if *last == edge => *count += 1,
            _ => bins.push((edge, 1)),
        }
    }
    bins
}

/// Times of every tick of these courses.
///
/// # Errors
/// [`WcetError`] where the system does not give what a condition needs.
pub fn measure(courses: &[Course], condition: Condition, cpu: Option<usize>) -> Result<Vec<Sample>, WcetError> {
    let mut disturber = Disturber::new(condition, false)?;
    let _beside = match condition {
        Condition::CoRunner => Some(CoRunner::start(cpu)?),
        _ => None,
    };
    let origin = Instant::now();
    let mut samples = Vec::new();
    with_room_above(|| {
        courses.iter().for_each(|course| {
            let mut meter = |edge: Edge| {
                if edge == Edge::Before {
                    disturber.disturb();
                }
                nanos(origin.elapsed())
            };
            course.run(&mut meter, &mut |call| {
                if call.class.is_tick() {
                    let index = samples.len() as u32;
                    samples.push(Sample { class: Some(call.class), index, ns: call.count });
                }
            });
        })
    });
    Ok(samples)
}

/// Runs something with a megabyte of this stack above it, so that what a disturber flushes is mapped.
#[inline(never)]
pub(super) fn with_room_above<T>(run: impl FnOnce() -> T) -> T {
    let mut room = [0_u8; 1 << 20];
    std::hint::black_box(&mut room);
    let result = run();
    std::hint::black_box(&mut room);
    result
}

/// Times (ns) of one tick, the course played again for each: the same path from the same state, in the order in which they were taken.
pub fn repeat(worst: &Counted, count: usize) -> Vec<u64> {
    let origin = Instant::now();
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        worst.course.run(&mut |_: Edge| nanos(origin.elapsed()), &mut |call| {
            if call.tick == worst.call.tick && call.class == worst.call.class {
                times.push(call.count);
            }
        });
    }
    times
}

pub(super) fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stalls_are_counted_and_left_out_by_the_rule_alone() {
        let times = (1..=1000).chain([STALL_NS, STALL_NS + 1, 5 * STALL_NS]);
        let summary = Summary::of("tick", Condition::Warm, times).unwrap();
        assert_eq!((summary.count, summary.stalls), (1003, 2));
        assert_eq!((summary.max_ns, summary.max_with_stalls_ns), (STALL_NS, 5 * STALL_NS));
        assert_eq!((summary.median_ns, summary.p99_ns, summary.p999_ns), (501, 991, 1000));
        assert_eq!(summary.histogram.iter().map(|(_, count)| count).sum::<u64>(), 1003);
        assert!(summary.histogram.is_sorted());
        assert_eq!(Summary::of("tick", Condition::Warm, std::iter::empty()), None);
    }
}
