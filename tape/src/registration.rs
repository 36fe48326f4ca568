//! Frames from pairs of points: in space, in a plane, on a line, mirrored, with noise and without.

use crate::hash::Fnv;
use crate::random::Random;
use nalgebra::Vector3;
use screed_kernel::pose::Pose;
use screed_kernel::registration::{PointPair, RegistrationError, register};

/// Registers random pairs; whether they held a frame.
pub fn hash(hash: &mut Fnv, random: &mut Random) -> bool {
    let mut any = |size: f64| Vector3::from_fn(|_, _| random.between(-size, size));
    let truth = Pose::from_rotation_vector(any(30.0), any(3.0));
    let mut pairs = [PointPair { in_outer: Vector3::zeros(), in_inner: Vector3::zeros() }; 8];
    for pair in &mut pairs {
        pair.in_inner = any(2.0);
        pair.in_outer = any(1e-3);
    }
    let (count, kind) = (random.below(7) as usize + 2, random.below(6));
    for pair in &mut pairs {
        let PointPair { in_outer: noise, in_inner } = *pair;
        pair.in_inner = match kind {
            0 => Vector3::new(in_inner.x, in_inner.y, 0.0),
            1 => Vector3::new(in_inner.x, 2.0 * in_inner.x, -in_inner.x),
            _ => in_inner,
        };
        let seen = if kind == 2 { -pair.in_inner } else { pair.in_inner };
        // Without noise where it would hide the plane or the line.
        pair.in_outer = truth.transform_point(&seen) + if kind < 2 { Vector3::zeros() } else { noise };
    }
    match register(pairs.get(..count).unwrap_or(&pairs)) {
        Ok(found) => {
            let Pose { rotation, translation } = found.outer_from_inner;
            let covariance = found.covariance(1e-4);
            let [first, ..] = &pairs;
            let residual = found.residual(first);
            let single = [found.residual_rms, found.residual_max, found.mirrored_rms, found.sigma()];
            let fields = rotation.iter().chain(&translation).chain(&found.axes_in_outer).chain(&found.levers);
            for value in fields.chain(&covariance).chain(&residual).chain(&single) {
                hash.number(*value);
            }
            hash.integer(found.residual_max_pair as u64);
            true
        }
        Err(error) => {
            let (kind, value) = match error {
                RegistrationError::TooFew { found } => (1, found as f64),
                RegistrationError::Collinear { lever, .. } => (2, lever),
                RegistrationError::Ambiguous { axis_in_outer } => (3, axis_in_outer.x),
                RegistrationError::Coincident { spread } => (4, spread),
                RegistrationError::Coordinate { pair } => (5, pair as f64),
            };
            hash.integer(kind);
            hash.number(value);
            false
        }
    }
}
