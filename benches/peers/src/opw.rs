//! The worker for rs-opw-kinematics: arms with a spherical wrist, all branches or those sorted by distance from the seed. It
//! verifies each answer by forward kinematics, to 1e-6; that cannot be turned off.
//!
//! Parameters: Brandstötter, Angerer, Hofbaur (2014), as the published descriptions of the arms give them (origin of each in
//! the kernel's catalogue); pinocchio's forward kinematics of these descriptions confirms them to 1e-14 m.

use crate::child::Outcome;
use crate::record::Record;
use rs_opw_kinematics::kinematic_traits::{Joints, Kinematics, Pose};
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parallelogram::Parallelogram;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;
use screed_kernel::pose;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// An input in the peer's own form.
pub struct Input {
    pose: Pose,
    seed: Joints,
}

/// A peer's arm.
pub struct Peer {
    kinematics: Arc<dyn Kinematics>,
    opw_from_flange: [[f64; 3]; 3],
}

const AS_FLANGE: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const UPRIGHT: [f64; 6] = [0.0, 0.0, -FRAC_PI_2, 0.0, 0.0, 0.0];
const LEVEL: [f64; 6] = [0.0, -FRAC_PI_2, 0.0, 0.0, 0.0, 0.0];
const KUKA: [i8; 6] = [-1, 1, 1, -1, 1, -1];
const COMAU: [i8; 6] = [-1, 1, -1, -1, 1, -1];

impl Peer {
    /// The arm of that name.
    pub fn new(arm: &str) -> Outcome<Self> {
        let (lengths, sign_corrections, offsets) = match arm {
            "kr120-r2500-pro" => ([0.35, 0.041, 0.675, 1.15, 1.0, 0.215], KUKA, LEVEL),
            "kr210-r2700-2" => ([0.33, -0.115, 0.645, 1.15, 1.22, 0.215], KUKA, LEVEL),
            "irb140" => ([0.07, 0.0, 0.352, 0.36, 0.38, 0.065], [1; 6], UPRIGHT),
            "irb6700-200-2.60" => ([0.32, -0.2, 0.78, 1.125, 1.1425, 0.2], [1; 6], UPRIGHT),
            "nj130-2.6" => ([0.35, -0.25, 0.83, 1.16, 1.10558, 0.165], COMAU, [0.0; 6]),
            _ => return Err(format!("no parameters for {arm}").into()),
        };
        let [a1, a2, c1, c2, c3, c4] = lengths;
        let robot =
            OPWKinematics::new(Parameters { a1, a2, b: 0.0, c1, c2, c3, c4, offsets, sign_corrections, dof: 6 });
        let (kinematics, opw_from_flange): (Arc<dyn Kinematics>, _) = match arm {
            // Its forearm keeps its direction while the upper arm turns.
            "nj130-2.6" => (
                Arc::new(Parallelogram { robot: Arc::new(robot), scaling: -1.0, driven: 1, coupled: 2 }),
                [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
            ),
            // Its flange's x axis points out of it.
            "irb140" => (Arc::new(robot), [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
            _ => (Arc::new(robot), AS_FLANGE),
        };
        Ok(Self { kinematics, opw_from_flange })
    }

    /// The pose as the peer wants it: a quaternion, and the last frame turned as its convention has it.
    pub fn input(&self, record: &Record) -> Input {
        let pose::Pose { rotation, translation } = record.base_from_flange;
        let entry =
            |row: usize, column: usize| (0..3).map(|k| rotation[(row, k)] * self.opw_from_flange[column][k]).sum();
        let columns: [[f64; 3]; 3] = std::array::from_fn(|column| std::array::from_fn(|row| entry(row, column)));
        let rotation = glam::DQuat::from_mat3(&glam::DMat3::from_cols_array_2d(&columns));
        Input { pose: Pose::from_parts(glam::DVec3::from_array(translation.into()), rotation), seed: record.seed.0 }
    }

    /// All branches, within ±180°.
    pub fn all(&self, input: &Input) -> Vec<Joints> {
        self.kinematics.inverse(&input.pose)
    }

    /// All branches, each turned to lie near the seed, the nearest first.
    pub fn nearest(&self, input: &Input) -> Vec<Joints> {
        self.kinematics.inverse_continuing(&input.pose, &input.seed)
    }
}

/// As [`crate::worker`] says.
pub fn show_all(answers: &[Joints], numbers: &mut Vec<f64>) {
    numbers.push(answers.len() as f64);
    numbers.extend(answers.iter().flatten());
}

/// The first of them.
pub fn show_first(answers: &[Joints], numbers: &mut Vec<f64>) {
    show_all(answers.first().map_or(&[], std::slice::from_ref), numbers);
}
