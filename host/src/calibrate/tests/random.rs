//! Seeded poses and noise.

use crate::calibrate::pose_fit::TrackerNoise;
use nalgebra::Vector3;
use screed_kernel::pose::Pose;
use screed_tape::random::Random;
use std::f64::consts::PI;

/// A number of the standard normal distribution (Box, Muller, "A note on the generation of random normal deviates",
/// 1958).
pub fn normal(random: &mut Random) -> f64 {
    let radius = (-2.0 * random.between(f64::MIN_POSITIVE, 1.0).ln()).sqrt();
    radius * random.between(0.0, 2.0 * PI).cos()
}

pub fn normals(random: &mut Random, sigma: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sigma * normal(random))
}

/// A pose within `reach` (m) along each axis, turned by up to `turn` (rad) about any axis.
pub fn pose(random: &mut Random, reach: f64, turn: f64) -> Pose {
    let position = Vector3::from_fn(|_, _| random.between(-reach, reach));
    let axis = normals(random, 1.0).normalize();
    Pose::from_rotation_vector(position, axis * random.between(0.0, turn))
}

/// A pose as the tracker measures it.
pub fn measured(random: &mut Random, tracker_from_target: &Pose, noise: &TrackerNoise) -> Pose {
    let sigma = noise.position_at(&tracker_from_target.translation);
    let turn = Pose::from_rotation_vector(Vector3::zeros(), normals(random, noise.rotation));
    Pose {
        rotation: turn.rotation * tracker_from_target.rotation,
        translation: tracker_from_target.translation + normals(random, sigma),
    }
}
