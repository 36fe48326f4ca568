//! A base that drifts by 3 mm/s, corrected and not: seeded plants (docs/plant.md) are led along a circle at four speeds by the
//! kernel and its closed loop, and the margins of their loops are found.

pub mod cell;
pub mod commission;
pub mod margin;
pub mod report;
pub mod trial;

use crate::failure::{Exit, Failure};
use crate::sim::plant::{Displacement, Kind, Params};
use commission::Commissioned;
use margin::Margin;
use nalgebra::Vector3;
use screed_kernel::fault::Fault;
use screed_kernel::guard::Motion;
use screed_kernel::units::JointPos;
use trial::{Correction, Sample, TrialError};

/// Speeds of the tool (m/s).
pub const SPEEDS: [f64; 4] = [0.015, 0.05, 0.1, 0.25];

/// What is compared: a base that drifts straight on in a random direction, and last one that turns to another every few seconds.
pub const CONDITIONS: [&str; 4] = ["off", "lead only", "on", "on, turning"];

/// How long the speed is held (s), and which part of the run is scored (s): not the ramps, nor the first second and a half at full speed,
/// in which corrections are still led in.
const SECONDS: f64 = 5.5;
const SCORED: std::ops::Range<f64> = 2.5..6.5;

/// Of a run of a plant (m): largest and root mean square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// From where the tool should be, the dead time taken out.
    pub absolute: [f64; 2],
    /// From where it should be at the same instant.
    pub timed: [f64; 2],
    /// From the circle.
    pub contour: [f64; 2],
}

impl Errors {
    /// Of a run that a fault ended.
    pub const STOPPED: Self =
        Self { absolute: [f64::INFINITY; 2], timed: [f64::INFINITY; 2], contour: [f64::INFINITY; 2] };
}

/// What became of a base that is pushed by 0.1 m while the beam breaks now and then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disturbed {
    /// Largest speed, acceleration and jerk of what was sent, each as a share of the guard's limit.
    pub shares: [f64; 3],
    /// How often trust in the tracker ended, and came back.
    pub relocks: usize,
    /// What the push led to.
    pub fault: Option<Fault>,
}

/// A plant.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Its kind.
    pub kind: Kind,
    /// Of its loops.
    pub margin: Margin,
    /// By speed and condition, in the order of [`SPEEDS`] and [`CONDITIONS`].
    pub errors: Vec<Vec<Errors>>,
    /// With everything that disturbs.
    pub disturbed: Disturbed,
}

/// What a plant could not be scored for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("plant {seed}: {error:?}")]
pub struct BaseBenchError {
    /// The plant.
    pub seed: u64,
    /// Why.
    pub error: TrialError,
}

/// Scores plants 0 to `count` − 1, on two threads.
///
/// # Errors
/// [`BaseBenchError`]
pub fn run(count: u64) -> Result<Vec<Score>, BaseBenchError> {
    let half = |odd: u64| (0..count).filter(|seed| seed % 2 == odd).map(score).collect::<Result<Vec<_>, _>>();
    let [even, odd] = std::thread::scope(|scope| {
        let threads = [0, 1].map(|odd| scope.spawn(move || half(odd)));
        threads.map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    Ok([even?, odd?].concat())
}

fn score(seed: u64) -> Result<Score, BaseBenchError> {
    let failed = |error| BaseBenchError { seed, error };
    let kind = cell::kind(seed);
    let params = Params::random(kind, seed);
    let cell = |error| failed(TrialError::Cell(error));
    let found = commission::commission(kind, &params, seed).map_err(cell)?;
    let margin = margin::of(kind, &params, seed, &found).map_err(cell)?;
    // Drift alone: steps of the base and breaks of the beam are another question.
    let mut turning = params.clone();
    (turning.base.step_interval, turning.tracker.break_interval) = (f64::INFINITY, f64::INFINITY);
    let mut straight = turning.clone();
    straight.base.drift_time = f64::INFINITY;
    let on = Correction::On(found);
    let conditions = [(&straight, Correction::Off), (&straight, Correction::Lead), (&straight, on), (&turning, on)];
    let mut errors = Vec::new();
    for speed in SPEEDS {
        let mut row = Vec::new();
        for (params, correction) in conditions {
            let run = trial::run(kind, params, seed, (speed, SECONDS), correction, |_, _| {}).map_err(failed)?;
            row.push(if run.fault.is_some() { Errors::STOPPED } else { judged(&run.samples) });
        }
        errors.push(row);
    }
    let disturbed = disturbed(kind, &params, seed, found).map_err(failed)?;
    Ok(Score { kind, margin, errors, disturbed })
}

fn judged(samples: &[Sample]) -> Errors {
    let of = |value: fn(&Sample) -> f64| {
        let scored = || samples.iter().filter(|sample| SCORED.contains(&sample.time)).map(value);
        let squares: f64 = scored().map(|value| value * value).sum();
        [scored().fold(0.0, f64::max), (squares / scored().count() as f64).sqrt()]
    };
    Errors {
        absolute: of(|sample| sample.absolute),
        timed: of(|sample| sample.timed),
        contour: of(|sample| sample.contour),
    }
}

/// Steps of the base, beam breaks every two seconds, and after four seconds a push.
fn disturbed(kind: Kind, params: &Params, seed: u64, found: Commissioned) -> Result<Disturbed, TrialError> {
    let mut params = params.clone();
    params.tracker.break_interval = 2.0;
    params.tracker.break_length = [0.02, 0.8];
    params.tracker.relock = [0.1, 0.4];
    let push = Displacement { translation: Vector3::new(0.06, -0.06, 0.06), rotation: Vector3::zeros() };
    let run = trial::run(kind, &params, seed, (0.05, SECONDS), Correction::On(found), |tick, plant| {
        if tick == 2000 {
            plant.shift_base(&push);
        }
    })?;
    let trusted: Vec<bool> = run.samples.iter().map(|sample| sample.trusted).collect();
    let relocks = trusted.windows(2).filter(|pair| !pair[0] && pair[1]).count();
    let limits = cell::configure(&params).output.motion::<6>().ok_or(TrialError::Kernel)?;
    let period = params.period_ns as f64 * 1e-9;
    Ok(Disturbed { shares: shares(&run.sent, &limits, period), relocks, fault: run.fault })
}

/// The largest differences of what was sent, over their limits.
fn shares(sent: &[JointPos<6>], limits: &Motion<6>, period: f64) -> [f64; 3] {
    let mut shares = [0.0_f64; 3];
    for window in sent.windows(4) {
        for joint in 0..6 {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k: usize| window[k].0[joint]);
            let differences = [d - c, d - 2.0 * c + b, d - 3.0 * (c - b) - a];
            let most = [limits.velocity_max.0[joint], limits.acceleration_max.0[joint], limits.jerk_max.0[joint]];
            for (order, (difference, most)) in (1..).zip(differences.iter().zip(most)) {
                let share = difference.abs() / period.powi(order) / most;
                shares[order as usize - 1] = shares[order as usize - 1].max(share);
            }
        }
    }
    shares
}

impl From<BaseBenchError> for Failure {
    fn from(error: BaseBenchError) -> Self {
        Self::told(Exit::Failed, error.to_string())
    }
}

#[cfg(test)]
mod tests;
