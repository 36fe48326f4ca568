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
use crate::ik::{Branch, Margins, Side};
use crate::units::JointPos;

/// How much the sines and cosines of α may differ from those of right angles.
const TILT_MAX: f64 = 0.05;
/// Lengths (m) that a nominal arm does not have.
const SHIFT_MAX: f64 = 0.05;
/// How far (m) out of the nominal arm's reach a pose may be that the calibrated one reaches.
const SLACK: f64 = 0.05;

impl Geometry {
    /// The nominal arm for a table whose α are within 0.05 of 90° 0 0 90° −90° 0 and whose shifts along x in rows 1, 4, 5
    /// and 6 are within 0.05 m of none; every joint turns for itself.
    pub fn near<const N: usize>(arm: &Arm<N>) -> Option<Self> {
        let rows: &[Dh; 6] = arm.dh.as_slice().try_into().ok()?;
        let [r1, r2, r3, r4, r5, r6] = rows;
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

    /// On which branch joints are, and how far from each singularity.
    pub fn posture<const N: usize>(&self, joints: &JointPos<N>) -> (Branch, Margins) {
        let [_, t2, t3, t4, t5, _] = self.table(joints);
        let (s5, s3) = (libm::sin(t5), libm::sin(t3));
        let along = self.a2 * libm::cos(t2) + self.a3 * libm::cos(t2 + t3) + self.d5 * libm::sin(t2 + t3 + t4);
        let branch = Branch { shoulder: Side::of(along), elbow: Side::of(s3), wrist: Side::of(s5) };
        let away = libm::hypot(along, self.across).max(f64::MIN_POSITIVE);
        (branch, Margins { shoulder: libm::fabs(along) / away, elbow: libm::fabs(s3), wrist: libm::fabs(s5) })
    }
}
