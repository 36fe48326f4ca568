//! Arms with a spherical wrist from the lengths that data sheets draw.
//!
//! Source of the parameters: Brandstötter, Angerer, Hofbaur, "An Analytical Solution of the Inverse Kinematics Problem of
//! Industrial Serial Manipulators with an Ortho-parallel Basis and a Spherical Wrist" (Austrian Robotics Workshop, 2014).

use crate::arm::{Arm, Dh, Joint, Rating};
use crate::pose::Pose;
use crate::units::{JointPos, JointVel};
use core::f64::consts::{FRAC_PI_2, PI};
use nalgebra::{Matrix3, Vector3};

/// Lengths (m) and senses of such an arm. Stretched upwards, all of its own angles zero, joints 1, 4 and 6 turn about the
/// base's z axis and joints 2, 3 and 5 about its y axis; the flange's axes are the base's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Opw {
    /// From axis 1 to axis 2, along x.
    pub a1: f64,
    /// From the elbow, axis 3, to axis 4, along x.
    pub a2: f64,
    /// From axis 1 to axis 4, along y.
    pub b: f64,
    /// From the base up to axis 2.
    pub c1: f64,
    /// From axis 2 up to axis 3.
    pub c2: f64,
    /// From axis 3 up to the wrist's centre.
    pub c3: f64,
    /// From the wrist's centre up to the flange.
    pub c4: f64,
    /// +1 or −1: the sense in which the robot's own joints count.
    pub signs: [f64; 6],
    /// What the robot's own joints differ by (rad): the angle above is sign times joint position minus offset.
    pub offsets: [f64; 6],
}

impl Opw {
    /// The table. A joint of negative sign turns about an axis that points the other way; no limits, ratings unknown.
    pub const fn arm(&self, name: &'static str) -> Arm<6> {
        let s = self.signs;
        Arm {
            name,
            base_from_zero: if s[0] < 0.0 { Some(turned([1.0, -1.0, -1.0])) } else { None },
            dh: [
                self.row(0, 0.0, self.c1, self.a1, -(s[0] * s[1]), 0.0),
                self.row(1, -FRAC_PI_2, self.b, self.c2, 0.0, s[1] * s[2]),
                self.row(2, FRAC_PI_2, 0.0, self.a2, s[2] * s[3], 0.0),
                self.row(3, 0.0, self.c3, 0.0, -(s[3] * s[4]), 0.0),
                self.row(4, 0.0, 0.0, 0.0, s[4] * s[5], 0.0),
                self.row(5, 0.0, self.c4, 0.0, 0.0, s[5]),
            ],
            joints: [Joint::REVOLUTE; 6],
            last_from_flange: None,
            position_min: JointPos([f64::NEG_INFINITY; 6]),
            position_max: JointPos([f64::INFINITY; 6]),
            velocity_max: Rating::Unknown,
            acceleration_max: Rating::Unknown,
        }
    }

    const fn row(&self, joint: usize, theta: f64, d: f64, a: f64, sin_alpha: f64, cos_alpha: f64) -> Dh {
        let sign = self.signs[joint];
        Dh { theta: sign * (theta - self.offsets[joint]), d: sign * d, a, sin_alpha, cos_alpha }
    }
}

/// A pose at the origin whose axes are the outer ones, some of them pointing the other way.
pub(super) const fn turned(senses: [f64; 3]) -> Pose {
    let [x, y, z] = senses;
    Pose { rotation: Matrix3::new(x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z), translation: Vector3::new(0.0, 0.0, 0.0) }
}

/// Limits from degrees.
pub(super) const fn positions<const N: usize>(degrees: [f64; N]) -> JointPos<N> {
    JointPos(radians(degrees))
}

/// Speeds from degrees a second.
pub(super) const fn speeds(degrees: [f64; 6]) -> Rating<JointVel<6>> {
    Rating::Known(JointVel(radians(degrees)))
}

/// Radians from degrees.
pub(super) const fn radians<const N: usize>(degrees: [f64; N]) -> [f64; N] {
    let mut radians = degrees;
    let mut joint = 0;
    while joint < N {
        radians[joint] = degrees[joint] * (PI / 180.0);
        joint += 1;
    }
    radians
}
