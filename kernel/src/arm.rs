//! Serial arms as data: a table of standard Denavit–Hartenberg parameters and limits.

use crate::pose::Pose;
use crate::units::{JointPos, JointVel};
use nalgebra::{Matrix3, Vector3};

/// One row of a standard DH table (Spong, Hutchinson, Vidyasagar, "Robot Modeling and Control", 3.2): turn θ about z,
/// shift d along z, shift a along the new x, turn α about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dh {
    /// Shift along z (m).
    pub d: f64,
    /// Shift along x (m).
    pub a: f64,
    /// sin α; given with the cosine so that right angles are exact.
    pub sin_alpha: f64,
    /// cos α.
    pub cos_alpha: f64,
}

/// A serial arm with N revolute joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm<const N: usize> {
    /// The name used in cell files.
    pub name: &'static str,
    /// Frame 0 is `base`, frame N is `flange`.
    pub dh: [Dh; N],
    /// Lowest joint positions (rad).
    pub position_min: JointPos<N>,
    /// Highest joint positions (rad).
    pub position_max: JointPos<N>,
    /// Highest joint speeds by the data sheet (rad/s).
    pub velocity_max: JointVel<N>,
}

impl<const N: usize> Arm<N> {
    /// Forward kinematics: the flange in the base frame.
    pub fn forward(&self, joints: &JointPos<N>) -> Pose {
        let mut base_from_link = Pose::identity();
        for (dh, &theta) in self.dh.iter().zip(&joints.0) {
            base_from_link = base_from_link * dh.link(theta);
        }
        base_from_link
    }
}

impl Dh {
    fn link(&self, theta: f64) -> Pose {
        let (s, c) = libm::sincos(theta);
        let (sa, ca) = (self.sin_alpha, self.cos_alpha);
        Pose {
            rotation: Matrix3::new(c, -s * ca, s * sa, s, c * ca, -c * sa, 0.0, sa, ca),
            translation: Vector3::new(self.a * c, self.a * s, self.d),
        }
    }
}
