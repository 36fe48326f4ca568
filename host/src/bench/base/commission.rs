//! What tests at a plant's commissioning find: how its base swings, and how fast the base may be followed.
//!
//! Both are done in calm, the crane standing still but for what the arm does to it.

use super::cell::{self, CellError};
use super::margin;
use crate::sim::plant::{Kind, Params, Plant};
use nalgebra::{SMatrix, SVector, Vector3};
use screed_kernel::base::history::History;
use screed_kernel::base::swing::{Swing, SwingMode};
use screed_kernel::pose::Pose;

/// What is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Commissioned {
    /// How the base swings, about the base's origin.
    pub swing: Swing,
    /// What links do beside the encoders, as the base's estimate takes it (rad): the larger, the slower it is.
    pub joint_deviation: f64,
}

/// From the fastest to the slowest that is tried (rad).
const DEVIATIONS: [f64; 13] = [3e-4, 4e-4, 5e-4, 7e-4, 9e-4, 1.2e-3, 1.6e-3, 2.2e-3, 3e-3, 5e-3, 1e-2, 3e-2, 1e-1];

/// A kick: a joint goes as far (rad) as a heavy arm's and a light one's may, in this time (s): too slowly to shake the arm's own
/// links at 8 Hz and more.
const KICK: [f64; 2] = [0.02, 0.2];
const KICKED: f64 = 0.15;
const JOINTS: [usize; 3] = [0, 1, 2];
/// When it is over, and for how long the swing is looked at then (s).
const SETTLED: f64 = 0.5;
const LOOKED: f64 = 4.0;
/// What frequencies are looked for under a heavy arm and a light one, below those of its links, and in what steps at first (rad/s).
const FREQUENCIES: [std::ops::Range<f64>; 2] = [6.0..44.0, 6.0..53.0];
const STEP: f64 = 0.25;
const DAMPINGS: [f64; 5] = [0.02, 0.035, 0.05, 0.07, 0.1];

/// Finds both: of a row of deviations, from fast to slow, the first with which every loop keeps its margins, or the last.
///
/// # Errors
/// [`CellError`]
pub fn commission(kind: Kind, params: &Params, seed: u64) -> Result<Commissioned, CellError> {
    let [shift, turn] = cell::swing_deviations(kind);
    let mut modes = [SwingMode::STILL; 6];
    let deviations = [shift, shift, shift, turn, turn, turn];
    for ((mode, [frequency, damping]), deviation) in modes.iter_mut().zip(swings(kind, params, seed)).zip(deviations) {
        *mode = SwingMode { frequency, damping, deviation };
    }
    let mut found = Commissioned { swing: Swing { centre: Vector3::zeros(), modes }, joint_deviation: 0.0 };
    for deviation in DEVIATIONS {
        found.joint_deviation = deviation;
        if margin::is_kept(kind, params, seed, &found)? {
            break;
        }
    }
    Ok(found)
}

/// Frequency (rad/s) and damping ratio of each axis, from how the base swings after a kick of each of [`JOINTS`]: what one
/// leaves alone another moves.
fn swings(kind: Kind, params: &Params, seed: u64) -> [[f64; 2]; 6] {
    let [heavy, light] = FREQUENCIES;
    let frequencies = if kind == Kind::Nj130 { heavy } else { light };
    let kicks = JOINTS.map(|joint| kicked(kind, params, seed, joint));
    std::array::from_fn(|axis| {
        let of = |seen: &Vec<(f64, [f64; 6])>| seen.iter().map(|(time, parts)| (*time, parts[axis])).collect();
        fitted(&kicks.each_ref().map(of), &frequencies)
    })
}

/// The base's pose (m, rad) over time (s) after a kick of that joint.
fn kicked(kind: Kind, params: &Params, seed: u64, joint: usize) -> Vec<(f64, [f64; 6])> {
    let mut calm = params.clone();
    (calm.base.drift_speed, calm.base.turn_speed, calm.base.step_interval) = (0.0, 0.0, f64::INFINITY);
    calm.tracker.break_interval = f64::INFINITY;
    let mut plant = Plant::new(&calm, seed);
    let nominal_from_tracker = calm.tracker_from_nominal.inverse();
    let target_from_flange = calm.flange_from_target.inverse();
    let period = calm.period_ns as f64 * 1e-9;
    let [heavy, light] = KICK;
    let kick = if kind == Kind::Nj130 { heavy } else { light };
    let mut encoders = History::<6, { cell::DEPTH }>::new();
    let mut seen: Vec<(f64, [f64; 6])> = Vec::new();
    for tick in 0..((SETTLED + LOOKED) / period) as usize {
        let done = (tick as f64 * period / KICKED).min(1.0);
        let mut command = calm.start;
        command.0[joint] += 0.5 * kick * (1.0 - (std::f64::consts::PI * done).cos());
        let measured = plant.step(&command);
        // A tick is later than the one before: it goes in.
        let _ = encoders.push(measured.now, &measured.joints);
        for pose in measured.poses {
            let time = pose.at.0 as f64 * 1e-9 - SETTLED;
            if let (true, Ok(joints)) = (time >= 0.0, encoders.at(pose.at)) {
                let nominal_from_flange = nominal_from_tracker * pose.tracker_from_target * target_from_flange;
                seen.push((time, parts(&(nominal_from_flange * calm.arm.forward(&joints).inverse()))));
            }
        }
    }
    seen
}

fn parts(pose: &Pose) -> [f64; 6] {
    let (way, turn) = (pose.translation, pose.rotation_vector());
    [way.x, way.y, way.z, turn.x, turn.y, turn.z]
}

/// The damped oscillation about a slow curve that leaves least of these values: first on a grid, then ever finer about the best.
fn fitted(kicks: &[Vec<(f64, f64)>], frequencies: &std::ops::Range<f64>) -> [f64; 2] {
    let count = ((frequencies.end - frequencies.start) / STEP) as usize;
    let grid = (0..count).flat_map(|k| DAMPINGS.map(|damping| [frequencies.start + STEP * k as f64, damping]));
    // Every fourth value will do for the grid.
    let few: Vec<Vec<_>> = kicks.iter().map(|values| values.iter().copied().step_by(4).collect()).collect();
    let mut best = least(&few, grid);
    let mut step = [STEP, 0.01];
    for _ in 0..6 {
        let [f, d] = best;
        let around = [-1.0, -0.5, 0.0, 0.5, 1.0];
        let near = around.iter().flat_map(|i| {
            around.map(|j| {
                [(f + i * step[0]).clamp(frequencies.start, frequencies.end), (d + j * step[1]).clamp(0.005, 0.3)]
            })
        });
        best = least(kicks, near);
        step = step.map(|step| 0.5 * step);
    }
    best
}

fn least(kicks: &[Vec<(f64, f64)>], candidates: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    let of = |candidate| kicks.iter().map(|values| left(values, candidate)).sum::<f64>();
    let scored = candidates.map(|candidate| (of(candidate), candidate));
    scored.min_by(|a, b| a.0.total_cmp(&b.0)).map_or([f64::NAN; 2], |(_, best)| best)
}

/// Sum of squares that 1, t, t² and a damped oscillation leave of the values, by the normal equations.
fn left(values: &[(f64, f64)], [frequency, damping]: [f64; 2]) -> f64 {
    let turning = frequency * (1.0 - damping * damping).sqrt();
    let (mut normal, mut right, mut square) = (SMatrix::<f64, 5, 5>::zeros(), SVector::<f64, 5>::zeros(), 0.0);
    for (time, value) in values {
        let (sin, cos) = (turning * time).sin_cos();
        let swing = (-damping * frequency * time).exp();
        let row = SVector::from([1.0, *time, time * time, swing * cos, swing * sin]);
        normal += row * row.transpose();
        right += row * *value;
        square += value * value;
    }
    normal.cholesky().map_or(f64::INFINITY, |normal| square - right.dot(&normal.solve(&right)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The plant knows what it is made of; the test sees it with the sensors' noise. A light arm hardly moves its base: some of its modes
    /// are lost in the noise, and matter as little.
    #[test]
    fn a_kick_tells_how_the_base_swings() {
        let mut lost = 0;
        for seed in 0..12 {
            let kind = cell::kind(seed);
            let params = Params::random(kind, seed);
            for (axis, [frequency, damping]) in swings(kind, &params, seed).into_iter().enumerate() {
                let (is, damped) = (params.base.frequency[axis], params.base.damping);
                let told = (frequency / is - 1.0).abs() < 0.08 && (damping - damped).abs() < 0.05;
                assert!(
                    told || kind == Kind::Ur10e,
                    "plant {seed}, axis {axis}: {frequency} rad/s and {damping}, is {is} and {damped}"
                );
                lost += usize::from(!told);
            }
        }
        println!("{lost} of 36 modes of light arms' bases lost");
        assert!(lost <= 6, "{lost} of 36");
    }
}
