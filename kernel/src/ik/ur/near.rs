//! The nominal arm that a calibrated one is close to.
//!
//! A calibration lets the axes of joints 2, 3 and 4 be a little out of parallel. The common normal of two such axes may lie
//! hundreds of metres away, and d₂, d₃, d₄ lead there and back: 439, −446 and 7 m are shipped. Their sum is what counts, and
//! so do their sidewise parts: with z₃ tilted by α₂ about x, row 3's shift along it moves frame 3 by −d₃ sin α₂ along y of
//! row 2, whatever θ₃ is. So the link from axis 2 to axis 3 is the plane vector (a₂, −(d₃ + d₄ cos α₃) sin α₂), that from 3
//! to 4 (a₃, −d₄ sin α₃); their lengths are the nominal arm's, their directions go into the θ offsets. What is left out, tilts
//! times lengths of the arm itself, is millimetres.

use super::Geometry;
use crate::arm::{Arm, Dh, Joint, JointKind};
use crate::ik::Side;
use crate::ik::calibrated::{Factors, SHIFT_MAX, SLACK, TILT_MAX};
use crate::units::JointPos;
use core::f64::consts::PI;

impl Geometry {
    /// The nominal arm for a table whose α are within 0.05 of 90° 0 0 90° −90° 0, those of 90° in either sense, and whose
    /// shifts along x in rows 1, 4, 5 and 6 are within 0.05 m of none; every joint turns for itself.
    pub fn near<const N: usize>(arm: &Arm<N>) -> Option<Self> {
        let mut rows: [Dh; 6] = arm.dh.as_slice().try_into().ok()?;
        let [r1, r2, _, r4, r5, r6] = &mut rows;
        // The x axis of a frame may point either way along the common normal of two axes that nearly meet.
        with_sine(r1, r2, 1.0);
        with_sine(r4, r5, 1.0);
        with_sine(r5, r6, -1.0);
        let [r1, r2, r3, r4, r5, r6] = &rows;
        let tilted = |row: &Dh, sine: f64, cosine: f64| {
            libm::fabs(row.sin_alpha - sine) <= TILT_MAX && libm::fabs(row.cos_alpha - cosine) <= TILT_MAX
        };
        let square = tilted(r1, 1.0, 0.0) && tilted(r4, 1.0, 0.0) && tilted(r5, -1.0, 0.0);
        let flat = [r2, r3, r6].iter().all(|row| tilted(row, 0.0, 1.0));
        let short = [r1, r4, r5, r6].iter().all(|row| libm::fabs(row.a) <= SHIFT_MAX);
        let turning = |joint: &Joint| matches!(joint, Joint { kind: JointKind::Revolute, coupling: None });
        if !(square && flat && short && arm.joints.iter().all(turning)) {
            return None;
        }
        let beyond = r3.d + r4.d * r3.cos_alpha;
        let (upper, fore) = ((r2.a, -beyond * r2.sin_alpha), (r3.a, -r4.d * r3.sin_alpha));
        // Both lengths with one sign, as nominal tables have them, so that sin θ₃ keeps its.
        let sign = if r3.a < 0.0 { -1.0 } else { 1.0 };
        let direction = |(x, y): (f64, f64)| libm::atan2(sign * y, sign * x);
        let (at2, at3) = (direction(upper), direction(fore));
        Some(Self {
            zero_from_base: arm.base_from_zero.map(|pose| pose.inverse()),
            flange_from_last: arm.last_from_flange.map(|pose| pose.inverse()),
            offsets: [r1.theta, r2.theta + at2, r3.theta + at3 - at2, r4.theta - at3, r5.theta, r6.theta],
            d1: r1.d,
            across: r2.d + beyond * r2.cos_alpha,
            d5: r5.d,
            d6: r6.d,
            a2: sign * libm::hypot(upper.0, upper.1),
            a3: sign * libm::hypot(fore.0, fore.1),
            slack: SLACK,
        })
    }

    /// What the determinant of the Jacobian is the product of, at these joints of the nominal arm.
    pub(in crate::ik) fn factors<const N: usize>(&self, joints: &JointPos<N>) -> Factors {
        let [_, t2, t3, t4, t5, _] = self.table(joints);
        let along = self.a2 * libm::cos(t2) + self.a3 * libm::cos(t2 + t3) + self.d5 * libm::sin(t2 + t3 + t4);
        let away = libm::hypot(along, self.across).max(f64::MIN_POSITIVE);
        Factors { along, away, elbow: libm::sin(t3), wrist: libm::sin(t5) }
    }

    /// Joints at which none of the factors is small.
    pub(in crate::ik) fn regular<const N: usize>(&self) -> JointPos<N> {
        let half = core::f64::consts::FRAC_PI_2;
        // The upper arm level, the forearm upright, and d₅ along the upper arm.
        let last = if Side::of(self.a2 * self.d5) == Side::Plus { 0.0 } else { 2.0 * half };
        let mut joints = JointPos::ZERO;
        for ((position, angle), offset) in joints.0.iter_mut().zip([0.0, 0.0, half, last, half, 0.0]).zip(self.offsets)
        {
            *position = angle - offset;
        }
        joints
    }
}

/// The same table with the frame between two rows turned by half a turn about its z axis, if sin α has not that sign.
fn with_sine(row: &mut Dh, next: &mut Dh, sign: f64) {
    if row.sin_alpha * sign < 0.0 {
        (row.theta, row.a, row.sin_alpha) = (row.theta + PI, -row.a, -row.sin_alpha);
        next.theta -= PI;
    }
}
