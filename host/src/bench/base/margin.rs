//! How far a plant's loops are from instability, by the response of the real code to a step on the real plant, without noise.
//!
//! All that is added to a joint is cut there, and a step u of that joint is commanded instead. What comes back is the filter's
//! estimate q_e and, by way of the base that the arm's reaction moves and of the links that bend, the base's shift s as joints: the
//! controller adds s + C·(s − q_e). So with P = q_e/u, S = s/u and the PID's own discrete response C, the loop's response is
//! L = C·P − (1 + C)·S at e^(jωh). One joint at a time; the other five are not controlled meanwhile.

use super::cell::{self, CellError};
use super::commission::Commissioned;
use super::report::{GAIN_DB, PHASE, SENSITIVITY};
use crate::sim::plant::{Kind, Params, Plant};
use nalgebra::Complex;
use screed_kernel::estimator::{Estimator, EstimatorConfig, Robot};
use screed_kernel::ik::Family;
use screed_kernel::pid::{ByProcess, Gains};
use screed_kernel::units::JointPos;

/// Step (rad): small, so that nothing is gated and the kinematics stay straight.
const STEP: f64 = 2e-5;
/// Before the step, and after it (s): by then the least damped base has come to a tenth.
const BEFORE: f64 = 1.0;
const AFTER: f64 = 16.0;
/// Frequencies (rad/s), evenly on a logarithmic scale.
const FREQUENCIES: usize = 240;
const LOWEST: f64 = 0.01;
const HIGHEST: f64 = 300.0;

/// The worst of a plant's loops, over joints and processes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margin {
    /// Largest of 1/|1 + L|.
    pub sensitivity: f64,
    /// By how much the loop's gain may grow.
    pub gain: f64,
    /// By how much its phase may lag more (rad).
    pub phase: f64,
}

impl Margin {
    const BEST: Self = Self { sensitivity: 1.0, gain: f64::INFINITY, phase: std::f64::consts::PI };

    /// Whether it is as large as is wanted.
    pub fn is_kept(&self) -> bool {
        self.sensitivity <= SENSITIVITY && 20.0 * self.gain.log10() >= GAIN_DB && self.phase >= PHASE
    }

    fn worst(self, other: Self) -> Self {
        Self {
            sensitivity: self.sensitivity.max(other.sensitivity),
            gain: self.gain.min(other.gain),
            phase: self.phase.min(other.phase),
        }
    }

    /// Of a response on rising frequencies. What lies beyond −1 counts as no margin at all.
    fn of(response: &[Complex<f64>]) -> Self {
        let mut margin = Self::BEST;
        for pair in response.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            margin.sensitivity = margin.sensitivity.max(1.0 / (b + 1.0).norm_sqr().sqrt());
            if a.im * b.im <= 0.0 && a.im != b.im {
                let crossing = a.re + (b.re - a.re) * a.im / (a.im - b.im);
                if crossing < 0.0 {
                    margin.gain = margin.gain.min(-1.0 / crossing);
                }
            }
            if (a.norm_sqr() - 1.0) * (b.norm_sqr() - 1.0) <= 0.0 {
                let phase = [a, b].map(|value| std::f64::consts::PI - value.im.atan2(value.re).abs());
                margin.phase = margin.phase.min(phase[0].min(phase[1]));
            }
        }
        margin
    }
}

/// The margins of a plant.
///
/// # Errors
/// [`CellError`]
pub fn of(kind: Kind, params: &Params, seed: u64, found: &Commissioned) -> Result<Margin, CellError> {
    let mut margin = Margin::BEST;
    for joint in 0..6 {
        margin = margin.worst(of_joint(kind, params, seed, found, joint)?);
    }
    Ok(margin)
}

/// Whether every loop of a plant keeps its margin.
///
/// # Errors
/// [`CellError`]
pub fn is_kept(kind: Kind, params: &Params, seed: u64, found: &Commissioned) -> Result<bool, CellError> {
    for joint in 0..6 {
        if !of_joint(kind, params, seed, found, joint)?.is_kept() {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The worst over processes.
fn of_joint(kind: Kind, params: &Params, seed: u64, found: &Commissioned, joint: usize) -> Result<Margin, CellError> {
    let params = quiet(params);
    let ByProcess { deposit, travel, mill } = cell::gains(kind);
    let period = params.period_ns as f64 * 1e-9;
    let ratio = (HIGHEST / LOWEST).powf(1.0 / (FREQUENCIES - 1) as f64);
    let frequencies: Vec<f64> = (0..FREQUENCIES).map(|k| LOWEST * ratio.powi(k as i32)).collect();
    let responses = responses(&cell::estimator(kind, &params, found), &params, seed, joint, &frequencies)?;
    let mut margin = Margin::BEST;
    for gains in [&deposit, &travel, &mill] {
        let loops: Vec<_> = frequencies
            .iter()
            .zip(&responses)
            .map(|(frequency, [estimate, shift])| {
                let controller = controller(&gains[joint], *frequency, period);
                controller * estimate - (controller + 1.0) * shift
            })
            .collect();
        margin = margin.worst(Margin::of(&loops));
    }
    Ok(margin)
}

/// Without noise, drift, backlash and interruptions: what is left is linear.
fn quiet(params: &Params) -> Params {
    let mut params = params.clone();
    (params.encoder_noise, params.encoder_quantum, params.rate_noise) = (0.0, 0.0, 0.0);
    params.joints.iter_mut().for_each(|joint| joint.play = 0.0);
    (params.base.drift_speed, params.base.turn_speed, params.base.step_interval) = (0.0, 0.0, f64::INFINITY);
    (params.tracker.noise, params.tracker.missing, params.tracker.break_interval) = (0.0, 0.0, f64::INFINITY);
    params
}

/// The PID's response, by its own difference equations ([`screed_kernel::pid`]).
fn controller(gains: &Gains, frequency: f64, h: f64) -> Complex<f64> {
    let back = Complex::from_polar(1.0, -frequency * h);
    let Gains { proportional, integral, derivative, filter_time, .. } = *gains;
    let difference = Complex::new(1.0, 0.0) - back;
    Complex::new(proportional, 0.0)
        + Complex::new(integral * h, 0.0) / difference
        + difference * derivative / (Complex::new(filter_time + h, 0.0) - back * filter_time)
}

/// What estimate and shift of a joint do to its step, by frequency.
fn responses(
    config: &EstimatorConfig<6>,
    params: &Params,
    seed: u64,
    joint: usize,
    frequencies: &[f64],
) -> Result<Vec<[Complex<f64>; 2]>, CellError> {
    let mut estimator = Estimator::<6, { cell::DEPTH }>::new(config).map_err(CellError::Estimator)?;
    let (mut plant, family, arm) = (Plant::new(params, seed), Family::of(params.arm), params.arm);
    let period = params.period_ns as f64 * 1e-9;
    let [before, after] = [BEFORE, AFTER].map(|time| (time / period) as usize);
    let mut last = None;
    let zero = Complex::new(0.0, 0.0);
    let mut sums = vec![[zero; 2]; frequencies.len()];
    let turns: Vec<_> = frequencies.iter().map(|frequency| Complex::from_polar(1.0, -frequency * period)).collect();
    let mut phases = vec![Complex::new(1.0, 0.0); frequencies.len()];
    let start = arm.forward(&params.start);
    for tick in 0..before + after {
        let mut command = params.start;
        if tick >= before {
            command.0[joint] += STEP;
        }
        let measured = plant.step(&command);
        let robot = Robot { actual: measured.joints, rates: Some(measured.rates), ready: true };
        let poses: Vec<_> = measured.poses.iter().map(cell::pose).collect();
        let Ok(estimated) = estimator.tick(arm, measured.now, &robot, &poses) else { continue };
        let shifted = family.nearest(arm, &(estimated.base.nominal_from_base.inverse() * start), &params.start);
        let shifted = shifted.map_or(params.start, |answer| answer.joints);
        let now = [&estimated.joints, &shifted].map(|joints: &JointPos<6>| joints.0[joint]);
        if tick >= before
            && let Some(last) = last
        {
            let last: [f64; 2] = last;
            let steps = [0, 1].map(|k| (now[k] - last[k]) / STEP);
            for ((sums, phase), turn) in sums.iter_mut().zip(&mut phases).zip(&turns) {
                // The command's own step is at the tick's beginning, what came of it at its end.
                *phase *= turn;
                sums[0] += *phase * steps[0];
                sums[1] += *phase * steps[1];
            }
        }
        last = Some(now);
    }
    Ok(sums)
}
