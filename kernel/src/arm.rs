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

    /// Points of the flange frame in the base frame (m): what [`Self::forward`] does with them, in fewer steps where no
    /// rotation is asked for.
    pub fn points<const P: usize>(
        &self,
        joints: &JointPos<N>,
        points_in_flange: [Vector3<f64>; P],
    ) -> [Vector3<f64>; P] {
        let mut points_in_link = points_in_flange;
        for (dh, &theta) in self.dh.iter().zip(&joints.0).rev() {
            let (sin, cos) = libm::sincos(theta);
            for point in &mut points_in_link {
                *point = dh.point(sin, cos, point);
            }
        }
        points_in_link
    }
}

impl Dh {
    /// A point of this row's frame in the frame before it: turned by α and shifted along x, then turned by θ and shifted
    /// along z.
    fn point(&self, sin: f64, cos: f64, point: &Vector3<f64>) -> Vector3<f64> {
        let (sa, ca) = (self.sin_alpha, self.cos_alpha);
        let (x, y, z) = (point.x + self.a, ca * point.y - sa * point.z, sa * point.y + ca * point.z);
        Vector3::new(cos * x - sin * y, sin * x + cos * y, z + self.d)
    }

    fn link(&self, theta: f64) -> Pose {
        let (s, c) = libm::sincos(theta);
        let (sa, ca) = (self.sin_alpha, self.cos_alpha);
        Pose {
            rotation: Matrix3::new(c, -s * ca, s * sa, s, c * ca, -c * sa, 0.0, sa, ca),
            translation: Vector3::new(self.a * c, self.a * s, self.d),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arm without any right angle or zero, so that every term counts.
    fn crooked<const N: usize>() -> Arm<N> {
        let row = |k: usize| {
            let (sin_alpha, cos_alpha) = libm::sincos(0.3 + k as f64);
            Dh { d: 0.1 + 0.2 * k as f64, a: 0.4 - 0.1 * k as f64, sin_alpha, cos_alpha }
        };
        let all = JointPos([0.0; N]);
        Arm {
            name: "crooked",
            dh: core::array::from_fn(row),
            position_min: all,
            position_max: all,
            velocity_max: JointVel([0.0; N]),
        }
    }

    fn points_are_those_of_the_pose<const N: usize>() {
        let arm = crooked::<N>();
        for k in 0..100 {
            let joints = JointPos(core::array::from_fn(|j| libm::sin((k * N + j) as f64) * 3.0));
            let pose = arm.forward(&joints);
            let points = [Vector3::zeros(), Vector3::new(0.1, -0.2, 0.3)];
            for (point, found) in points.iter().zip(arm.points(&joints, points)) {
                assert!((pose.transform_point(point) - found).norm() < 1e-14 * N as f64);
            }
        }
    }

    #[test]
    fn points_of_the_flange_are_where_its_pose_takes_them() {
        points_are_those_of_the_pose::<3>();
        points_are_those_of_the_pose::<6>();
        points_are_those_of_the_pose::<9>();
    }
}
