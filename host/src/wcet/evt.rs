//! What extreme values say of a row of times, or that they say nothing: a generalised Pareto law for what exceeds a threshold, only
//! where every one of its preconditions was tested and held; else [`Verdict::Refused`], and no number.
//!
//! Times of a shared machine are neither independent nor identically distributed, and a fit that does not ask about that gives a
//! bound all the same. What has to hold is what Cazorla et al. ask of measurement-based analysis ("PROARTIS", ACM TECS 12, 2013):
//! independence, identical distribution, and a tail that the law fits. Times of a clock are also discrete (Griffin and Burns,
//! "Realism in statistical analysis of worst case execution times", WCET 2010), which many equal values show.

mod pareto;
mod tests_of;

pub use pareto::Pareto;
pub use tests_of::{Test, words};

use serde::Serialize;

/// Below this a test's precondition is held to be broken. Each of the tests may fail by chance, so it is not 0.05.
pub const LEVEL: f64 = 0.01;

/// Samples that a judgement needs at least.
pub const SAMPLES_MIN: usize = 1000;

/// Where thresholds are tried (share of samples below); the one in the middle is used.
const THRESHOLDS: [f64; 5] = [0.80, 0.85, 0.90, 0.925, 0.95];
const CHOSEN: usize = 2;

/// Probabilities of exceedance that a fit is asked for.
const PROBABILITIES: [f64; 3] = [1e-4, 1e-6, 1e-9];

/// Resamplings of a bootstrap, and its seed.
const RESAMPLES: usize = 300;
const SEED: u64 = 20_130_901;

/// A fit at one threshold, for the plot of its stability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AtThreshold {
    /// Share of samples below it.
    pub share: f64,
    /// The threshold.
    pub threshold: f64,
    /// Samples above it.
    pub exceedances: usize,
    /// The shape ξ, and its standard error.
    pub shape: f64,
    /// Standard error of the shape.
    pub shape_error: f64,
}

/// A value that is exceeded with a probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantile {
    /// The probability, of one sample.
    pub probability: f64,
    /// The value.
    pub value: f64,
    /// Lower end of the interval that holds it 95 times of 100.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Nothing can be said, and why.
    Refused(Vec<String>),
    /// A law fits.
    Fitted {
        /// The law of what exceeds the threshold.
        law: Pareto,
        /// The threshold.
        threshold: f64,
        /// What it gives.
        quantiles: Vec<Quantile>,
    },
}

/// All that was looked at.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evt {
    /// Samples.
    pub count: usize,
    /// Tests of the preconditions, whatever they said.
    pub tests: Vec<Test>,
    /// Fits at several thresholds.
    pub stability: Vec<AtThreshold>,
    /// What came of it.
    pub verdict: Verdict,
}

impl Evt {
    /// Judges samples in the order in which they were taken.
    pub fn of(samples: &[f64]) -> Self {
        let mut evt =
            Self { count: samples.len(), tests: Vec::new(), stability: Vec::new(), verdict: Verdict::Refused(vec![]) };
        if samples.len() < SAMPLES_MIN || samples.iter().any(|sample| !sample.is_finite()) {
            evt.verdict = Verdict::Refused(vec![format!("{} samples, {SAMPLES_MIN} are needed", samples.len())]);
            return evt;
        }
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        evt.tests = vec![
            tests_of::ljung_box(samples, 20),
            tests_of::runs(samples, quantile(&sorted, 0.5)),
            tests_of::halves(samples),
        ];
        evt.stability = THRESHOLDS.iter().filter_map(|share| at_threshold(&sorted, *share)).collect();
        let threshold = quantile(&sorted, THRESHOLDS[CHOSEN]);
        let excesses = excesses(&sorted, threshold);
        evt.tests.push(tests_of::discrete(&excesses));
        match Pareto::fit(&excesses) {
            Some(law) => {
                evt.tests.push(bounded(&law));
                evt.tests.push(stable(&evt.stability));
                evt.tests.push(tests_of::goodness(&excesses, &law, RESAMPLES, SEED));
                evt.tests.push(held_out(samples));
                let above = excesses.len() as f64 / samples.len() as f64;
                evt.verdict = verdict(&evt.tests, law, threshold, above, &excesses);
            }
            None => evt.verdict = Verdict::Refused(vec!["no generalised Pareto law could be fitted".to_owned()]),
        }
        evt
    }
}

fn verdict(tests: &[Test], law: Pareto, threshold: f64, above: f64, excesses: &[f64]) -> Verdict {
    let broken: Vec<String> = tests.iter().filter(|test| !test.holds).map(Test::words).collect();
    if !broken.is_empty() {
        return Verdict::Refused(broken);
    }
    let quantiles = PROBABILITIES
        .iter()
        .map(|probability| {
            let value = threshold + law.quantile(probability / above);
            let [low, high] = law.interval(excesses, probability / above).map(|excess| threshold + excess);
            Quantile { probability: *probability, value, low, high }
        })
        .collect();
    Verdict::Fitted { law, threshold, quantiles }
}

fn at_threshold(sorted: &[f64], share: f64) -> Option<AtThreshold> {
    let threshold = quantile(sorted, share);
    let excesses = excesses(sorted, threshold);
    let law = Pareto::fit(&excesses)?;
    Some(AtThreshold {
        share,
        threshold,
        exceedances: excesses.len(),
        shape: law.shape,
        shape_error: law.shape_error(excesses.len()),
    })
}

/// Whether the tail is one that times of bounded work can have. From ½ on a law has no variance: what looks so heavy is a mixture, of a
/// program's times and of something else's.
fn bounded(law: &Pareto) -> Test {
    Test::judged("tail: the shape is below one half", law.shape, None, law.shape < 0.5)
}

/// Whether the shape is the same at every threshold: each within three standard errors of the chosen one. Overlapping samples make
/// them more alike than independent ones, never less.
fn stable(fits: &[AtThreshold]) -> Test {
    let Some(chosen) = fits.get(CHOSEN).filter(|_| fits.len() == THRESHOLDS.len()) else {
        return Test::judged("threshold stability", f64::NAN, None, false);
    };
    let far = fits.iter().map(|fit| (fit.shape - chosen.shape).abs() / fit.shape_error.hypot(chosen.shape_error));
    let far = far.fold(0.0, f64::max);
    Test::judged("threshold stability (largest difference of the shape, in standard errors)", far, None, far <= 3.0)
}

/// Whether the first half foretells the second: how many of it exceed what one in a hundred should, by the binomial law.
fn held_out(samples: &[f64]) -> Test {
    let (first, second) = samples.split_at(samples.len() / 2);
    let mut sorted = first.to_vec();
    sorted.sort_by(f64::total_cmp);
    let threshold = quantile(&sorted, THRESHOLDS[CHOSEN]);
    let excesses = excesses(&sorted, threshold);
    let name = "held-out half (samples above the first half's 1 in 100)";
    match Pareto::fit(&excesses) {
        Some(law) => {
            let share = 0.01;
            let limit = threshold + law.quantile(share * first.len() as f64 / excesses.len() as f64);
            let above = second.iter().filter(|sample| **sample > limit).count();
            // The first half's own error is as large as the second's: twice the variance.
            let mean = share * second.len() as f64;
            let z = (above as f64 - mean) / (2.0 * mean * (1.0 - share)).sqrt();
            Test::of(name, above as f64, tests_of::two_sided(z))
        }
        None => Test::judged(name, f64::NAN, None, false),
    }
}

fn excesses(sorted: &[f64], threshold: f64) -> Vec<f64> {
    sorted.iter().filter(|sample| **sample > threshold).map(|sample| sample - threshold).collect()
}

/// The least of sorted values that a share of all does not exceed; not a number of none.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil().max(1.0) as usize;
    sorted.get(rank - 1).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests;
