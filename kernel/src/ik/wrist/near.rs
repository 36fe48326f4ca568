//! The nominal arm that a calibrated one with a spherical wrist is close to.
//!
//! What a calibration adds to a right angle, to an axis that goes through the wrist's centre and to parallel axes 2 and 3 is
//! left out: tilts times lengths of the arm, millimetres. Only where axes 2 and 3 are a little out of parallel d₃ may be
//! large; as with the UR type ([`crate::ik::ur::Geometry::near`]) the link between them is the plane vector (a₂, −d₃ sin α₂).

use super::{Geometry, coupled};
use crate::arm::{Arm, Dh};
use crate::ik::Side;
use crate::ik::calibrated::{Factors, SHIFT_MAX, SLACK, TILT_MAX};
use crate::units::JointPos;

impl Geometry {
    /// The nominal arm for a table whose last six rows have right angles within 0.05, and in rows 4 and 5 lengths within
    /// 0.05 m of none.
    pub fn near<const N: usize>(arm: &Arm<N>) -> Option<Self> {
        let mut nominal = *arm;
        let (_, [one, two, three, four, five, _]) = nominal.dh.split_last_chunk_mut::<6>()?;
        let short = [four.a, five.a, five.d].iter().all(|length| libm::fabs(*length) <= SHIFT_MAX);
        let upper = (two.a, -three.d * two.sin_alpha);
        let sign = Side::of(two.a).sign();
        let direction = libm::atan2(sign * upper.1, sign * upper.0);
        let straight = flat(two)?;
        two.d += three.d * two.cos_alpha;
        two.a = sign * libm::hypot(upper.0, upper.1);
        two.theta += direction;
        three.theta -= straight * direction;
        three.d = 0.0;
        (two.sin_alpha, two.cos_alpha) = (0.0, straight);
        for row in [one, three, four, five] {
            (row.sin_alpha, row.cos_alpha) = (square(row)?, 0.0);
        }
        let (_, [_, _, _, four, five, _]) = nominal.dh.split_last_chunk_mut::<6>()?;
        (four.a, five.a, five.d) = (0.0, 0.0, 0.0);
        if short { Self::of(&nominal).map(|geometry| Self { slack: SLACK, ..geometry }) } else { None }
    }

    /// What the determinant of the Jacobian is the product of, at these joints of the nominal arm.
    pub(in crate::ik) fn factors<const N: usize>(&self, arm: &Arm<N>, joints: &JointPos<N>) -> Factors {
        let mut table = self.offsets;
        for (joint, angle) in (N.wrapping_sub(6)..N).zip(table.iter_mut()) {
            *angle += joints.0.get(joint).copied().unwrap_or(0.0) + coupled(arm, joint, joints);
        }
        let [_, theta2, theta3, _, theta5, _] = table;
        let bend = self.c2 * theta3 + self.fore_angle;
        let along = self.a1 + self.upper * libm::cos(theta2) + self.fore * libm::cos(theta2 + bend);
        Factors { along, away: 1.0 / self.stretched, elbow: libm::sin(bend), wrist: libm::sin(theta5) }
    }

    /// What of a difference of an angle one joint has at least.
    pub(in crate::ik) const fn share(&self) -> f64 {
        self.share
    }

    /// Joints at which none of the factors is small; the arm's own first joints stay at zero.
    pub(in crate::ik) fn regular<const N: usize>(&self, arm: &Arm<N>) -> JointPos<N> {
        let half = core::f64::consts::FRAC_PI_2;
        // The upper arm along x, away from axis 1 if that is in front of it; forearm square to it, wrist square to that.
        let theta2 = if Side::of(self.a1) == Side::of(self.upper) { 0.0 } else { 2.0 * half };
        let table = [0.0, theta2, self.c2 * (half - self.fore_angle), 0.0, half, 0.0];
        let mut joints = JointPos::ZERO;
        for ((joint, angle), offset) in (N.wrapping_sub(6)..N).zip(table).zip(self.offsets) {
            let position = angle - offset - coupled(arm, joint, &joints);
            if let Some(slot) = joints.0.get_mut(joint) {
                *slot = position;
            }
        }
        joints
    }
}

/// The cosine, ±1, of a row whose axes are nearly parallel.
fn flat(row: &Dh) -> Option<f64> {
    (libm::fabs(row.sin_alpha) <= TILT_MAX).then(|| Side::of(row.cos_alpha).sign())
}

/// The sine, ±1, of a row whose axes are nearly square to each other.
fn square(row: &Dh) -> Option<f64> {
    (libm::fabs(row.cos_alpha) <= TILT_MAX).then(|| Side::of(row.sin_alpha).sign())
}
