//! What a comparison aims at, by which rule it was made, and why an aim may be missed.

use super::{Comparison, DISCARD_US, Interval};
use crate::doctor::{Diagnosis, Finding, Verdict};
use serde::Serialize;
use std::fmt;

/// How narrow the interval of the medians' difference has to be to stop before the most pairs (µs).
const NARROW_US: f64 = 6.0;
/// What is aimed at: our median less the yardstick's (µs).
const DIFFERENCE_AIM_US: f64 = 3.0;
/// What is aimed at: where the interval of the 99th percentiles' ratio lies.
const RATIO_AIM: [f64; 2] = [0.5, 2.0];

/// The rule of a comparison, fixed before it is made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rule {
    /// A pair in which either was once later is discarded (µs).
    pub discard_us: u32,
    /// How long a slice lasts (s).
    pub slice_s: f64,
    /// At least so many pairs that count.
    pub pairs_least: u32,
    /// At most so many pairs are measured.
    pub pairs_most: u32,
    /// From the least on it ends once the interval of the medians' difference is no wider (µs).
    pub stop_width_us: f64,
}

impl Rule {
    /// Slices of so many seconds, at least and at most so many pairs.
    pub const fn new(slice_s: f64, pairs_least: u32, pairs_most: u32) -> Self {
        Self { discard_us: DISCARD_US, slice_s, pairs_least, pairs_most, stop_width_us: NARROW_US }
    }

    /// Whether enough was measured.
    pub fn is_met(&self, found: &Comparison) -> bool {
        found.pairs.len() >= self.pairs_least as usize && self.is_narrow(found)
    }

    fn is_narrow(&self, found: &Comparison) -> bool {
        found.width_us() <= self.stop_width_us
    }
}

/// An aim, and by how much it is missed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Aim {
    /// What is aimed at.
    pub what: &'static str,
    /// Its unit; empty of a ratio.
    pub unit: &'static str,
    /// No less than this, if anything.
    pub at_least: Option<f64>,
    /// No more than this.
    pub at_most: f64,
    /// Whether it is met.
    pub met: bool,
    /// By how much what was found lies below.
    pub below_by: f64,
    /// By how much what was found lies above.
    pub above_by: f64,
}

impl Aim {
    /// All between `low` and `high` has to lie inside.
    fn new(what: &'static str, unit: &'static str, aim: (Option<f64>, f64), low: f64, high: f64) -> Self {
        let (at_least, at_most) = aim;
        let below_by = at_least.map_or(0.0, |least| (least - low).max(0.0));
        let above_by = (high - at_most).max(0.0);
        Self { what, unit, at_least, at_most, met: below_by == 0.0 && above_by == 0.0, below_by, above_by }
    }
}

impl fmt::Display for Aim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, unit, at_least, at_most, met, below_by, above_by } = *self;
        match at_least {
            Some(least) => write!(f, "{what} inside [{least}, {at_most}]{unit}: ")?,
            None => write!(f, "{what} at most {at_most}{unit}: ")?,
        }
        if met {
            return write!(f, "met");
        }
        write!(f, "missed")?;
        for (by, side) in [(below_by, "below"), (above_by, "above")] {
            if by > 0.0 {
                write!(f, ", {by:.2}{unit} {side}")?;
            }
        }
        Ok(())
    }
}

/// A comparison with its rule, and what it came to beside what was aimed at.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// What was found.
    #[serde(flatten)]
    pub comparison: Comparison,
    /// The rule.
    pub rule: Rule,
    /// Whether the interval of the medians' difference got as narrow as the rule wants.
    pub narrow: bool,
    /// Each aim.
    pub aims: [Aim; 2],
    /// Where an aim is missed or the interval stayed wide: what `screed doctor` finds BAD or POOR, the likely reason.
    pub likely_why: Vec<Finding>,
}

impl Judged {
    /// Of a comparison made on a machine with this diagnosis.
    pub fn of(comparison: Comparison, rule: Rule, machine: &Diagnosis) -> Self {
        let Comparison { median_difference_us: difference, p99_ratio: Interval { low, high, .. }, .. } = comparison;
        let [least, most] = RATIO_AIM;
        let aims = [
            Aim::new("medians' difference", " µs", (None, DIFFERENCE_AIM_US), difference.value, difference.value),
            Aim::new("interval of the p99 ratio", "", (Some(least), most), low, high),
        ];
        let narrow = rule.is_narrow(&comparison);
        let as_wanted = narrow && aims.iter().all(|aim| aim.met);
        let is_bad = |finding: &&Finding| matches!(finding.verdict, Verdict::Bad | Verdict::Poor);
        let findings = machine.findings.iter().filter(is_bad).filter(|_| !as_wanted);
        Self { narrow, aims, likely_why: findings.cloned().collect(), comparison, rule }
    }
}

impl fmt::Display for Judged {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { comparison, rule, narrow, aims, likely_why } = self;
        let Rule { discard_us, slice_s, pairs_least, pairs_most, stop_width_us } = rule;
        write!(f, "  {comparison}")?;
        writeln!(
            f,
            "  rule: slices of {slice_s} s in turns; a pair in which either was once later than {discard_us} µs is discarded;"
        )?;
        writeln!(
            f,
            "    from {pairs_least} pairs on it ends once the interval of the difference is at most {stop_width_us} µs wide, at the latest after {pairs_most}"
        )?;
        let width = comparison.width_us();
        let got = if *narrow { "it got as narrow as that" } else { "it stayed wider than that" };
        writeln!(f, "    {got}: {width:.1} µs, {} pairs", comparison.pairs.len())?;
        for aim in aims {
            writeln!(f, "  aim: {aim}")?;
        }
        if *narrow && aims.iter().all(|aim| aim.met) {
            return Ok(());
        }
        if likely_why.is_empty() {
            return writeln!(f, "  why: nothing that screed doctor looks at; see what else ran");
        }
        writeln!(f, "  likely why (screed doctor says what to do):")?;
        for Finding { what, found, verdict, .. } in likely_why {
            writeln!(f, "    {} {what}: {found}", if *verdict == Verdict::Bad { "BAD " } else { "POOR" })?;
        }
        Ok(())
    }
}
