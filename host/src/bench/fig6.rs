//! Figure 6 of the KRAKEN paper ("An all-in-one robotic platform for hybrid manufacturing of large volume parts", section 3.2):
//! a simulated arm's pose, measured with much noise and half of it missing, and filtered.
//!
//! Motion, noise and seeds are in `fixtures/data/fig6.toml`. The filter is tuned on one set of seeds and scored on another. Beside
//! it stands what a smoother makes of the same measurements with the future known too: no filter can do better on average.

pub mod plot;
pub mod report;
mod trial;

use nalgebra::Vector3;
use screed_kernel::ekf::EkfError;
use screed_kernel::pose::Pose;
use serde::Deserialize;
use thiserror::Error;
pub use trial::{Sample, run};

/// Joints of the arm.
pub const N: usize = 6;

/// What tuning tries for [`Case::jerk_time_s`] (s).
pub const JERK_TIMES: [f64; 9] = [0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0];

/// Why the experiment cannot be done.
#[derive(Debug, Error)]
pub enum Fig6Error {
    /// The description of the experiment.
    #[error("the experiment's description is not sound: {0}; correct fixtures/data/fig6.toml")]
    SetUp(String),
    /// The filter refused an input.
    #[error("the filter refused {what} at {time} s: {error:?}; correct the noise in fixtures/data/fig6.toml")]
    Filter {
        /// What it was given.
        what: &'static str,
        /// When (s).
        time: f64,
        /// Why.
        error: EkfError,
    },
}

/// The experiment; units stand in the names.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)] // The fixture says what they are.
pub struct SetUp {
    pub robot: String,
    pub duration_s: f64,
    pub unscored_s: f64,
    pub centre_rad: [f64; N],
    pub amplitude_rad: [[f64; 3]; N],
    pub frequency_hz: [[f64; 3]; N],
    pub noise: Noise,
    pub start: Start,
    pub seeds: Seeds,
    #[serde(rename = "case")]
    pub cases: Vec<Case>,
}

/// What is added to the true pose, and how much of it is missing.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Noise {
    pub position_m: f64,
    pub quaternion: f64,
    pub missing: f64,
}

/// How uncertain the filter is at first.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Start {
    pub position_rad: f64,
    pub velocity_rad_s: f64,
    pub acceleration_rad_s2: f64,
}

/// First and last seed of each set.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Seeds {
    pub tune: [u64; 2],
    pub score: [u64; 2],
}

/// One way to run the filter.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Case {
    pub name: String,
    pub period_ms: f64,
    pub rate_deviation_rad_s: Option<f64>,
    pub jerk_time_s: f64,
    pub aim_m: Option<f64>,
    pub aim_deg: Option<f64>,
}

/// Mean and standard deviation of errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Of the target's place (m).
    pub position: [f64; 2],
    /// Of its rotation (rad).
    pub rotation: [f64; 2],
}

/// What a case comes to over a set of seeds.
#[derive(Clone, Debug)]
pub struct Score {
    /// As measured, where it was.
    pub raw: Errors,
    /// By the filter, at every tick.
    pub filtered: Errors,
    /// By the smoother.
    pub smoothed: Errors,
    /// Of the whole state.
    pub nees: Nees,
    /// Of the flange's place, 3 numbers.
    pub nees_place: Nees,
    /// Share of the joint errors inside three of the filter's standard deviations.
    pub covered: f64,
    /// How many runs.
    pub runs: usize,
}

/// Normalised estimation error squared; what the filter believes of itself is the count of numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nees {
    /// Mean over runs and time.
    pub mean: f64,
    /// Where 95 % of the means over the runs at one instant would lie for a filter that is exactly right.
    pub band: [f64; 2],
    /// Share of the instants whose mean over the runs is in that band.
    pub inside: f64,
}

impl Nees {
    /// Of sums over the runs, instant by instant.
    fn of(sums: &[f64], freedom: usize, runs: usize) -> Self {
        let means = sums.iter().map(|sum| sum / runs as f64);
        // Wilson and Hilferty 1931: the cube root of χ²/k is nearly normal.
        let spread = 2.0 / (9.0 * (freedom * runs) as f64);
        let band = [-1.96, 1.96].map(|z: f64| freedom as f64 * (1.0 - spread + z * spread.sqrt()).powi(3));
        let inside = means.clone().filter(|mean| (band[0]..=band[1]).contains(mean)).count();
        let count = sums.len() as f64;
        Self { mean: means.sum::<f64>() / count, band, inside: inside as f64 / count }
    }
}

impl SetUp {
    /// Reads and judges a description.
    ///
    /// # Errors
    /// [`Fig6Error::SetUp`]
    pub fn parse(text: &str) -> Result<Self, Fig6Error> {
        let set_up: Self = toml::from_str(text).map_err(|error| Fig6Error::SetUp(error.to_string()))?;
        let fail = |message: &str| Err(Fig6Error::SetUp(message.to_owned()));
        let positive = |values: &[f64]| values.iter().all(|value| value.is_finite() && *value > 0.0);
        let Self { duration_s, unscored_s, noise, start, seeds, cases, .. } = &set_up;
        if set_up.robot != "ur10e" {
            return fail("expected robot = \"ur10e\"");
        }
        if !positive(&[*duration_s, *unscored_s, noise.position_m, noise.quaternion]) || duration_s <= unscored_s {
            return fail("durations and noise have to be positive, and duration_s more than unscored_s");
        }
        if !positive(&[start.position_rad, start.velocity_rad_s, start.acceleration_rad_s2]) {
            return fail("the deviations in [start] have to be positive");
        }
        if !(0.0..1.0).contains(&noise.missing) {
            return fail("missing is a share, at least 0 and less than 1");
        }
        let sets = [seeds.tune, seeds.score];
        if sets.iter().any(|[first, last]| first >= last) || (seeds.tune[1] >= seeds.score[0]) {
            return fail("[seeds] wants two sets, first before last, those to tune before those to score");
        }
        let short = |case: &Case| case.period_ms > 1e3 * (duration_s - unscored_s);
        let rates = |case: &Case| case.rate_deviation_rad_s.unwrap_or(1.0);
        if cases.iter().any(|case| !positive(&[case.period_ms, case.jerk_time_s, rates(case)]) || short(case)) {
            return fail("a case's numbers have to be positive, its period shorter than what is scored");
        }
        Ok(set_up)
    }
}

impl Score {
    /// Runs a case on every seed from the first to the last.
    ///
    /// # Errors
    /// [`Fig6Error::Filter`]
    pub fn of(set_up: &SetUp, case: &Case, [first, last]: [u64; 2]) -> Result<Self, Fig6Error> {
        let mut sums: [Sum; 6] = Default::default();
        let (mut nees, mut nees_place) = (Vec::new(), Vec::new());
        let (mut inside, mut all) = (0.0, 0.0);
        let runs = (last - first + 1) as usize;
        for seed in first..=last {
            let samples = trial::run(set_up, case, seed)?;
            let scored = samples.iter().filter(|sample| sample.time >= set_up.unscored_s);
            let mut instant = 0;
            for sample in scored {
                let poses = [sample.raw, Some(sample.filtered), Some(sample.smoothed)];
                for (sums, pose) in sums.chunks_exact_mut(2).zip(poses) {
                    let Some(pose) = pose else { continue };
                    let [place, turn] = error(&sample.truth, &pose);
                    sums[0].add(place);
                    sums[1].add(turn);
                }
                if let Some(consistency) = &sample.consistency {
                    if nees.len() <= instant {
                        nees.push(0.0);
                        nees_place.push(0.0);
                    }
                    nees[instant] += consistency.nees;
                    nees_place[instant] += consistency.nees_place;
                    instant += 1;
                    inside += consistency.inside as f64;
                    all += N as f64;
                }
            }
        }
        let errors = |k: usize| Errors { position: sums[k].mean(), rotation: sums[k + 1].mean() };
        Ok(Self {
            raw: errors(0),
            filtered: errors(2),
            smoothed: errors(4),
            nees: Nees::of(&nees, 3 * N, runs),
            nees_place: Nees::of(&nees_place, 3, runs),
            covered: inside / all,
            runs,
        })
    }
}

/// Distance (m) and angle (rad) from one pose to another.
fn error(truth: &Pose, pose: &Pose) -> [f64; 2] {
    let place = (pose.translation - truth.translation).norm();
    let turn = Pose { rotation: truth.rotation.transpose() * pose.rotation, translation: Vector3::zeros() };
    [place, turn.rotation_vector().norm()]
}

/// Count, sum and sum of squares.
#[derive(Default)]
struct Sum([f64; 3]);

impl Sum {
    fn add(&mut self, value: f64) {
        let [count, sum, squares] = &mut self.0;
        *count += 1.0;
        *sum += value;
        *squares += value * value;
    }

    /// Mean and standard deviation.
    fn mean(&self) -> [f64; 2] {
        let [count, sum, squares] = self.0;
        let mean = sum / count;
        [mean, (squares / count - mean * mean).max(0.0).sqrt()]
    }
}

#[cfg(test)]
mod tests;
