//! The kernel's filter and the paper's, side by side on the same measurements.

use super::Random;
use super::literal::Literal;
use super::plant::{DENSITY, N, Noise, Plant, deviation};
use nalgebra::Vector3;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

/// Root mean squares over ticks and runs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rms {
    /// Of the flange's place (m).
    pub place: f64,
    /// Of its rotation (rad).
    pub turn: f64,
    /// Of the joints (rad).
    pub joints: f64,
}

/// Of three filters, on the same runs.
#[derive(Debug)]
pub struct Rivals {
    /// The kernel's.
    pub ours: Rms,
    /// The paper's, one line mended.
    pub literal: Rms,
    /// The paper's as printed.
    pub printed: Rms,
    /// Mean over the runs of the place's mean square, ours less the mended one's, over the mended one's; and half of its 95 %
    /// interval from the scatter of the runs.
    pub difference: [f64; 2],
}

/// Runs of `ticks` at 8 ms; half of the z, pose and rates together, are missing, as in the paper. The first quarter is not scored.
/// All three are told the command.
pub fn rivals(seeds: std::ops::Range<u64>, noise: Noise, ticks: usize) -> Rivals {
    let mut sums = [[0.0; 3]; 3];
    let (mut runs, mut count) = (Vec::new(), 0.0);
    for seed in seeds {
        let mut plant = Plant::new(seed, noise, 8e-3);
        let mut ekf = plant.filter();
        let literal = Literal::new(ekf.state(), &deviation(&noise), DENSITY[0], plant.dt);
        let (mut printed, mut literal) = (literal.clone().printed(), literal);
        let mut coin = Random(seed ^ 1);
        let mut places = [0.0; 2];
        for tick in 0..ticks {
            let commanded = plant.step();
            let (pose, (rates, rate_deviation), reliable) = (plant.pose(), plant.rates(), coin.below(2) == 0);
            ekf.predict(plant.dt, &commanded).unwrap();
            for filter in [&mut literal, &mut printed] {
                filter.command(&commanded, plant.dt);
                filter.tick(&UR10E, &pose, &rates, rate_deviation.0[0], reliable);
            }
            if reliable {
                ekf.pose(&UR10E, &pose).unwrap();
                ekf.rates(&rates, &rate_deviation).unwrap();
            }
            if tick < ticks / 4 {
                continue;
            }
            count += 1.0;
            let all = [ekf.state().position, literal.joints(), printed.joints()];
            for (which, (sums, joints)) in sums.iter_mut().zip(all).enumerate() {
                let [place, turn, joint] = squares(&plant.truth.position, &joints);
                for (sum, square) in sums.iter_mut().zip([place, turn, joint]) {
                    *sum += square;
                }
                if which < 2 {
                    places[which] += place;
                }
            }
        }
        runs.push(places);
    }
    let theirs = runs.iter().map(|places| places[1]).sum::<f64>() / runs.len() as f64;
    let differences: Vec<f64> = runs.iter().map(|[ours, literal]| (ours - literal) / theirs).collect();
    let (mean, half) = super::estimation::mean(&differences);
    let rms = |[place, turn, joints]: [f64; 3]| Rms {
        place: (place / count).sqrt(),
        turn: (turn / count).sqrt(),
        joints: (joints / count).sqrt(),
    };
    let [ours, literal, printed] = sums.map(rms);
    Rivals { ours, literal, printed, difference: [mean, half] }
}

/// Squares of the flange's place and rotation and of the joints, off the truth.
fn squares(truth: &JointPos<N>, joints: &JointPos<N>) -> [f64; 3] {
    let (is, was) = (UR10E.forward(truth), UR10E.forward(joints));
    let turn = Pose { rotation: is.rotation.transpose() * was.rotation, translation: Vector3::zeros() };
    let joint = truth.0.iter().zip(&joints.0).map(|(a, b)| (a - b) * (a - b)).sum();
    [(is.translation - was.translation).norm_squared(), turn.rotation_vector().norm_squared(), joint]
}
