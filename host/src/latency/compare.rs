//! Two programs side by side.

use super::{DISCARD_US, Histogram};
use serde::Serialize;
use std::fmt;

/// Resamplings of a bootstrap.
const RESAMPLES: usize = 10_000;
/// Seed of a bootstrap: the same pairs give the same interval.
const SEED: u64 = 20_110;

/// A slice of each, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Pair {
    /// Our median (µs).
    pub ours_median_us: u32,
    /// The yardstick's (µs).
    pub theirs_median_us: u32,
    /// Our 99th percentile (µs).
    pub ours_p99_us: u32,
    /// The yardstick's (µs).
    pub theirs_p99_us: u32,
}

impl Pair {
    /// Of two slices; `None` when the pair is to be discarded, for one that is empty or has a wake-up beyond [`DISCARD_US`].
    pub fn of(ours: &Histogram, theirs: &Histogram) -> Option<Self> {
        if ours.max_us() > DISCARD_US || theirs.max_us() > DISCARD_US {
            return None;
        }
        Some(Self {
            ours_median_us: ours.quantile_us(0.5)?,
            theirs_median_us: theirs.quantile_us(0.5)?,
            ours_p99_us: ours.quantile_us(0.99)?,
            theirs_p99_us: theirs.quantile_us(0.99)?,
        })
    }

    fn difference(&self) -> f64 {
        f64::from(self.ours_median_us) - f64::from(self.theirs_median_us)
    }

    /// Half a microsecond more for both: what is counted is rounded down, and may be 0.
    fn ratio(&self) -> f64 {
        (f64::from(self.ours_p99_us) + 0.5) / (f64::from(self.theirs_p99_us) + 0.5)
    }
}

/// A figure with the interval that holds it 95 times of 100.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// The median over pairs.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Interval {
    /// The median of `values` with its percentile bootstrap; `None` of nothing.
    pub fn of_median(values: &[f64]) -> Option<Self> {
        let value = median(&mut values.to_vec())?;
        let mut random = SEED;
        let mut sample = vec![0.0; values.len()];
        let mut medians: Vec<f64> = Vec::with_capacity(RESAMPLES);
        for _ in 0..RESAMPLES {
            for slot in &mut sample {
                *slot = values[(splitmix(&mut random) % values.len() as u64) as usize];
            }
            medians.extend(median(&mut sample));
        }
        medians.sort_by(f64::total_cmp);
        let at = |share: f64| medians[((medians.len() - 1) as f64 * share).round() as usize];
        Some(Self { value, low: at(0.025), high: at(0.975) })
    }
}

/// What all pairs came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Pairs that count.
    pub pairs: Vec<Pair>,
    /// Pairs discarded by the rule.
    pub discarded: u32,
    /// Our median less the yardstick's (µs).
    pub median_difference_us: Interval,
    /// Our 99th percentile over the yardstick's.
    pub p99_ratio: Interval,
}

impl Comparison {
    /// Of so many pairs that count; `None` of none.
    pub fn of(pairs: Vec<Pair>, discarded: u32) -> Option<Self> {
        let differences: Vec<f64> = pairs.iter().map(Pair::difference).collect();
        let ratios: Vec<f64> = pairs.iter().map(Pair::ratio).collect();
        Some(Self {
            median_difference_us: Interval::of_median(&differences)?,
            p99_ratio: Interval::of_median(&ratios)?,
            pairs,
            discarded,
        })
    }

    /// Width of the interval of the medians' difference (µs).
    pub fn width_us(&self) -> f64 {
        self.median_difference_us.high - self.median_difference_us.low
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pairs, discarded, median_difference_us: difference, p99_ratio: ratio } = self;
        writeln!(f, "{} pairs of slices, {discarded} more discarded", pairs.len())?;
        writeln!(
            f,
            "  median, ours less cyclictest's: {:+.1} µs [{:+.1}, {:+.1}]",
            difference.value, difference.low, difference.high
        )?;
        writeln!(f, "  p99, ours over cyclictest's:    {:.2} [{:.2}, {:.2}]", ratio.value, ratio.low, ratio.high)
    }
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let (below, above) = (values.get(values.len().checked_sub(1)? / 2)?, values.get(values.len() / 2)?);
    Some(0.5 * (below + above))
}

/// Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014).
fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
