//! How late a loop wakes: histograms, and the paired comparison with a yardstick.
//!
//! On a machine that others share, a loop's worst is the machine's, not the loop's: only what two programs meet side by side
//! compares them. So slices alternate, ours and cyclictest's, in the order A B B A A B B A …, on the same processor; of each pair
//! the medians' difference and the 99th percentiles' ratio are taken, and their middle is given with the interval that a
//! bootstrap over pairs leaves (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13).

mod aims;
pub mod certificate;
mod compare;

pub use aims::{Aim, Judged, Rule};
pub use compare::{Comparison, Interval, Pair};

use serde::Serialize;
use std::fmt;

/// A slice in which either program was once later than this tells of the machine's host, and is discarded with its pair (µs).
/// Fixed beforehand, so that nobody can choose.
pub const DISCARD_US: u32 = 20_000;

/// Counts of whole microseconds, rounded down, as cyclictest counts them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Histogram {
    counts: Vec<u64>,
    /// Later than the last bin.
    beyond: u64,
    max_us: u32,
}

impl Histogram {
    /// Empty, with bins for 0 to `bins` − 1 µs.
    pub fn new(bins: usize) -> Self {
        Self { counts: vec![0; bins], beyond: 0, max_us: 0 }
    }

    /// Counts one.
    pub fn add(&mut self, latency_us: u32) {
        self.add_many(latency_us, 1);
    }

    /// Counts some of the same.
    pub fn add_many(&mut self, latency_us: u32, count: u64) {
        if count == 0 {
            return;
        }
        match self.counts.get_mut(latency_us as usize) {
            Some(bin) => *bin += count,
            None => self.beyond += count,
        }
        self.max_us = self.max_us.max(latency_us);
    }

    /// How many were counted.
    pub fn total(&self) -> u64 {
        self.counts.iter().sum::<u64>() + self.beyond
    }

    /// The largest (µs).
    pub const fn max_us(&self) -> u32 {
        self.max_us
    }

    /// The least latency that a share of all does not exceed (µs); that of the last bin or the largest where it lies beyond. None
    /// of nothing.
    pub fn quantile_us(&self, share: f64) -> Option<u32> {
        let rank = (share * self.total() as f64).ceil().max(1.0) as u64;
        let mut sum = 0;
        for (latency, count) in (0_u32..).zip(&self.counts) {
            sum += count;
            if sum >= rank {
                return Some(latency);
            }
        }
        (self.beyond > 0).then_some(self.max_us)
    }

    /// The bins that are not empty: latency (µs) and count.
    pub fn bins(&self) -> impl Iterator<Item = (u32, u64)> {
        (0_u32..).zip(&self.counts).filter(|(_, count)| **count > 0).map(|(latency, count)| (latency, *count))
    }
}

/// What a run came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// How many.
    pub count: u64,
    /// Half were not later (µs).
    pub median_us: u32,
    /// 99 % were not later (µs).
    pub p99_us: u32,
    /// 99.9 % were not later (µs).
    pub p999_us: u32,
    /// The latest (µs).
    pub max_us: u32,
    /// Slots of the grid that a late wake-up let go by.
    pub missed: u64,
    /// Every bin that is not empty: latency (µs), count.
    pub histogram: Vec<(u32, u64)>,
}

impl Summary {
    /// Of a histogram; `None` of an empty one.
    pub fn of(histogram: &Histogram, missed: u64) -> Option<Self> {
        Some(Self {
            count: histogram.total(),
            median_us: histogram.quantile_us(0.5)?,
            p99_us: histogram.quantile_us(0.99)?,
            p999_us: histogram.quantile_us(0.999)?,
            max_us: histogram.max_us(),
            missed,
            histogram: histogram.bins().collect(),
        })
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, median_us, p99_us, p999_us, max_us, missed, .. } = self;
        write!(f, "{count}: median {median_us} µs, p99 {p99_us} µs, p99.9 {p999_us} µs, max {max_us} µs, ")?;
        write!(f, "{missed} slots missed")
    }
}

#[cfg(test)]
mod tests;
