//! Whether a table has the shape, and what of it the closed form needs.

use super::{Geometry, REACH_TOLERANCE};
use crate::arm::{Arm, JointKind};
use crate::ik::Side;
use crate::pose::Pose;
use nalgebra::{Matrix3, Vector3};

/// How far (m, and as sine or cosine) a table may be from the shape.
const SHAPE_TOLERANCE: f64 = 1e-14;

impl Geometry {
    /// The geometry of an arm whose last six joints have this shape; `None` if they do not, or if a coupling is not a whole
    /// number, so that full turns of one joint would move another link.
    pub fn of<const N: usize>(arm: &Arm<N>) -> Option<Self> {
        let (_, [one, two, three, four, five, six]) = arm.dh.split_last_chunk::<6>()?;
        let (_, joints) = arm.joints.split_last_chunk::<6>()?;
        let whole = |factor: f64| libm::round(factor) == factor;
        let turning = joints.iter().all(|joint| joint.kind == JointKind::Revolute);
        let coupled = joints.iter().filter_map(|joint| joint.coupling);
        let zeros = [four.a, five.a, five.d, two.sin_alpha];
        let square = [one.cos_alpha, three.cos_alpha, four.cos_alpha, five.cos_alpha];
        let near = |value: &f64| libm::fabs(*value) <= SHAPE_TOLERANCE;
        if !turning || !coupled.clone().all(|coupling| whole(coupling.factor)) || !zeros.iter().chain(&square).all(near)
        {
            return None;
        }
        let sign = |value: f64| Side::of(value).sign();
        let (s1, c2, s3) = (sign(one.sin_alpha), sign(two.cos_alpha), sign(three.sin_alpha));
        let (fore_x, fore_y) = (three.a, -c2 * s3 * four.d);
        let fore = libm::sqrt(fore_x * fore_x + fore_y * fore_y);
        if !(libm::fabs(two.a) > REACH_TOLERANCE && fore > REACH_TOLERANCE) {
            return None;
        }
        let (sin, cos) = (six.sin_alpha, six.cos_alpha);
        let six_from_last = Pose {
            rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, cos, -sin, 0.0, sin, cos),
            translation: Vector3::new(six.a, 0.0, six.d),
        };
        let six_from_flange = arm.last_from_flange.map_or(six_from_last, |flange| six_from_last * flange);
        Some(Self {
            d1: one.d,
            a1: one.a,
            b: s1 * (two.d + c2 * three.d),
            upper: two.a,
            fore,
            fore_x: fore_x / fore,
            fore_y: fore_y / fore,
            fore_angle: libm::atan2(fore_y, fore_x),
            stretched: 1.0 / (libm::fabs(two.a) + fore),
            s1,
            c2,
            s3,
            s4: sign(four.sin_alpha),
            s5: sign(five.sin_alpha),
            share: 1.0 / (1.0 + coupled.clone().fold(0.0, |most: f64, coupling| most.max(libm::fabs(coupling.factor)))),
            offsets: [one.theta, two.theta, three.theta, four.theta, five.theta, six.theta],
            coupled: coupled.count() > 0,
            zero_from_base: arm.base_from_zero.map(|base_from_zero| base_from_zero.inverse()),
            flange_from_six: six_from_flange.inverse(),
            slack: REACH_TOLERANCE,
        })
    }
}
