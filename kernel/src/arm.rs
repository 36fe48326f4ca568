//! Serial arms as data: a table of standard Denavit–Hartenberg parameters, what moves each link, and limits.

use crate::pose::Pose;
use crate::units::{JointAcc, JointPos, JointVel};
use nalgebra::{ArrayStorage, Matrix3, SMatrix, Vector3};

/// One row of a standard DH table (Spong, Hutchinson, Vidyasagar, "Robot Modeling and Control", 3.2): turn θ about z,
/// shift d along z, shift a along the new x, turn α about it. A revolute joint adds to θ, a prismatic one to d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dh {
    /// Turn about z (rad); of a revolute joint where the joint reads zero.
    pub theta: f64,
    /// Shift along z (m); of a prismatic joint where the joint reads zero.
    pub d: f64,
    /// Shift along x (m).
    pub a: f64,
    /// sin α; given with the cosine so that right angles are exact.
    pub sin_alpha: f64,
    /// cos α.
    pub cos_alpha: f64,
}

/// What a joint does to its link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns it about z; positions in rad.
    Revolute,
    /// Shifts it along z; positions in m.
    Prismatic,
}

/// A joint, and what else moves its link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Turn or shift.
    pub kind: JointKind,
    /// Another joint that moves this link too, as the rods of a parallelogram do.
    pub coupling: Option<Coupling>,
}

/// The link's DH variable is its own joint's position plus `factor` times that of an earlier joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    /// The earlier joint (0 is the first).
    pub joint: usize,
    /// How much of its motion reaches this link.
    pub factor: f64,
}

/// What a data sheet says of an arm, or that none says it: a cell file must, then, before anything moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rating<T> {
    /// By the data sheet.
    Known(T),
    /// No source gives it.
    Unknown,
}

/// A serial arm with N joints, 3 to 9.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm<const N: usize> {
    /// The name used in cell files.
    pub name: &'static str,
    /// Frame 0 of the table in the base frame; `None` where they are one.
    pub base_from_zero: Option<Pose>,
    /// The table: frame i + 1 in frame i.
    pub dh: [Dh; N],
    /// What moves each link.
    pub joints: [Joint; N],
    /// The flange in frame N of the table; `None` where they are one.
    pub last_from_flange: Option<Pose>,
    /// Lowest joint positions (rad, m); minus infinity for a joint that turns without end.
    pub position_min: JointPos<N>,
    /// Highest joint positions (rad, m); infinity for a joint that turns without end.
    pub position_max: JointPos<N>,
    /// Highest joint speeds (rad/s, m/s).
    pub velocity_max: Rating<JointVel<N>>,
    /// Highest joint accelerations (rad/s², m/s²).
    pub acceleration_max: Rating<JointAcc<N>>,
}

/// The geometric Jacobian: joint velocities (rad/s, m/s) to the velocity of the flange's origin (m/s, rows 0 to 2) and its
/// angular velocity (rad/s, rows 3 to 5), both in the base frame.
pub type Jacobian<const N: usize> = SMatrix<f64, 6, N>;

impl Joint {
    /// A turning joint that moves its own link only.
    pub const REVOLUTE: Self = Self { kind: JointKind::Revolute, coupling: None };
    /// A sliding joint that moves its own link only.
    pub const PRISMATIC: Self = Self { kind: JointKind::Prismatic, coupling: None };
}

impl<T: Copy> Rating<T> {
    /// The value, when a data sheet gives it.
    pub const fn known(self) -> Option<T> {
        match self {
            Self::Known(value) => Some(value),
            Self::Unknown => None,
        }
    }
}

impl<const N: usize> Arm<N> {
    /// Forward kinematics: the flange in the base frame.
    pub fn forward(&self, joints: &JointPos<N>) -> Pose {
        let mut base_from_link = self.base_from_zero();
        for link in self.links(joints) {
            base_from_link = link.after(&base_from_link);
        }
        self.flange_after(&base_from_link)
    }

    /// Forward kinematics of every link: frames 1 to N of the table in the base frame. The flange is the last times
    /// [`Self::last_from_flange`].
    pub fn frames(&self, joints: &JointPos<N>) -> [Pose; N] {
        let mut frames = [Pose::identity(); N];
        let mut base_from_link = self.base_from_zero();
        for (frame, link) in frames.iter_mut().zip(self.links(joints)) {
            base_from_link = link.after(&base_from_link);
            *frame = base_from_link;
        }
        frames
    }

    /// The flange in the base frame, and how it moves with each joint (Spong, Hutchinson, Vidyasagar, 4.6).
    pub fn jacobian(&self, joints: &JointPos<N>) -> (Pose, Jacobian<N>) {
        let zero = (Vector3::zeros(), Vector3::zeros());
        let mut axes = [zero; N];
        let mut base_from_link = self.base_from_zero();
        for (axis, link) in axes.iter_mut().zip(self.links(joints)) {
            *axis = (base_from_link.rotation.column(2).into(), base_from_link.translation);
            base_from_link = link.after(&base_from_link);
        }
        let flange = self.flange_after(&base_from_link);
        let mut columns = [[0.0; 6]; N];
        for ((column, (axis, origin)), joint) in columns.iter_mut().zip(&axes).zip(&self.joints) {
            *column = match joint.kind {
                JointKind::Revolute => {
                    let linear = axis.cross(&(flange.translation - origin));
                    [linear.x, linear.y, linear.z, axis.x, axis.y, axis.z]
                }
                JointKind::Prismatic => [axis.x, axis.y, axis.z, 0.0, 0.0, 0.0],
            };
        }
        for link in 0..N {
            let (Some(joint), Some(&moved)) = (self.joints.get(link), columns.get(link)) else { continue };
            let Some(Coupling { joint, factor }) = joint.coupling else { continue };
            for (entry, moved) in columns.get_mut(joint).into_iter().flatten().zip(moved) {
                *entry += factor * moved;
            }
        }
        (flange, Jacobian::from_array_storage(ArrayStorage(columns)))
    }

    fn base_from_zero(&self) -> Pose {
        self.base_from_zero.unwrap_or(Pose::identity())
    }

    fn flange_after(&self, base_from_last: &Pose) -> Pose {
        match &self.last_from_flange {
            Some(last_from_flange) => *base_from_last * *last_from_flange,
            None => *base_from_last,
        }
    }

    /// The rows of the table with the joints where they are.
    fn links<'a>(&'a self, joints: &'a JointPos<N>) -> impl DoubleEndedIterator<Item = Dh> + 'a {
        self.dh.iter().zip(&self.joints).zip(&joints.0).map(|((link, joint), own)| {
            let coupled = joint.coupling.and_then(|coupling| Some(coupling.factor * joints.0.get(coupling.joint)?));
            let variable = own + coupled.unwrap_or(0.0);
            match joint.kind {
                JointKind::Revolute => Dh { theta: link.theta + variable, ..*link },
                JointKind::Prismatic => Dh { d: link.d + variable, ..*link },
            }
        })
    }

    /// Points of the flange frame in the base frame (m): what [`Self::forward`] does with them, in fewer steps where no
    /// rotation is asked for.
    pub fn points<const P: usize>(
        &self,
        joints: &JointPos<N>,
        points_in_flange: [Vector3<f64>; P],
    ) -> [Vector3<f64>; P] {
        let mut points = points_in_flange;
        let outward = |pose: &Pose, points: &mut [_; P]| *points = points.map(|point| pose.transform_point(&point));
        if let Some(last_from_flange) = &self.last_from_flange {
            outward(last_from_flange, &mut points);
        }
        for link in self.links(joints).rev() {
            let (sin, cos) = libm::sincos(link.theta);
            // Not by `map`, which is a call and two copies for each point.
            for point in &mut points {
                *point = link.point(sin, cos, point);
            }
        }
        if let Some(base_from_zero) = &self.base_from_zero {
            outward(base_from_zero, &mut points);
        }
        points
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

    /// The frame after this link, given the one before it.
    #[inline(always)]
    fn after(&self, base_from_link: &Pose) -> Pose {
        let (s, c) = libm::sincos(self.theta);
        let axis = |column: usize| -> Vector3<f64> { base_from_link.rotation.column(column).into() };
        let (x0, y0, z0) = (axis(0), axis(1), axis(2));
        let x = x0 * c + y0 * s;
        let turned = y0 * c - x0 * s;
        let y = turned * self.cos_alpha + z0 * self.sin_alpha;
        let z = z0 * self.cos_alpha - turned * self.sin_alpha;
        Pose {
            rotation: Matrix3::from_columns(&[x, y, z]),
            translation: base_from_link.translation + z0 * self.d + x * self.a,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arm without any right angle or zero, so that every term counts; its second joint slides, its last is coupled.
    fn crooked<const N: usize>() -> Arm<N> {
        let row = |k: usize| {
            let (sin_alpha, cos_alpha) = libm::sincos(0.3 + k as f64);
            Dh { theta: 0.2 - k as f64, d: 0.1 + 0.2 * k as f64, a: 0.4 - 0.1 * k as f64, sin_alpha, cos_alpha }
        };
        let mut joints = [Joint::REVOLUTE; N];
        joints[1] = Joint::PRISMATIC;
        joints[N - 1].coupling = Some(Coupling { joint: 1, factor: -0.7 });
        let shifted = |x, roll| Some(Pose::from_roll_pitch_yaw(Vector3::new(x, -0.3, 0.2), roll, 0.5, -0.6));
        Arm {
            name: "crooked",
            base_from_zero: shifted(0.5, 0.4),
            dh: core::array::from_fn(row),
            joints,
            last_from_flange: shifted(-0.1, 1.4),
            position_min: JointPos([-3.0; N]),
            position_max: JointPos([3.0; N]),
            velocity_max: Rating::Unknown,
            acceleration_max: Rating::Unknown,
        }
    }

    fn joints<const N: usize>(k: usize) -> JointPos<N> {
        JointPos(core::array::from_fn(|j| libm::sin((k * N + j) as f64) * 3.0))
    }

    fn points_are_those_of_the_pose<const N: usize>() {
        let arm = crooked::<N>();
        for joints in (0..100).map(joints) {
            let pose = arm.forward(&joints);
            let points = [Vector3::zeros(), Vector3::new(0.1, -0.2, 0.3)];
            for (point, found) in points.iter().zip(arm.points(&joints, points)) {
                assert!((pose.transform_point(point) - found).norm() < 1e-14 * N as f64);
            }
        }
    }

    fn columns_are_differences_of_poses<const N: usize>() {
        let arm = crooked::<N>();
        for joints in (0..100).map(joints) {
            let (pose, jacobian) = arm.jacobian(&joints);
            assert_eq!(pose, arm.forward(&joints));
            assert_eq!(pose, arm.frames(&joints)[N - 1] * arm.last_from_flange.unwrap());
            for joint in 0..N {
                let beside = |shift: f64| {
                    let mut joints = joints;
                    joints.0[joint] += shift;
                    arm.forward(&joints)
                };
                let (below, above) = (beside(-1e-5), beside(1e-5));
                let turned = Pose { rotation: above.rotation * below.rotation.transpose(), ..above };
                let linear = (above.translation - below.translation) / 2e-5;
                let angular = turned.rotation_vector() / 2e-5;
                assert!((jacobian.fixed_view::<3, 1>(0, joint) - linear).norm() < 1e-8);
                assert!((jacobian.fixed_view::<3, 1>(3, joint) - angular).norm() < 1e-8);
            }
        }
    }

    #[test]
    fn the_jacobian_is_what_small_moves_do() {
        columns_are_differences_of_poses::<3>();
        columns_are_differences_of_poses::<6>();
        columns_are_differences_of_poses::<9>();
    }

    #[test]
    fn points_of_the_flange_are_where_its_pose_takes_them() {
        points_are_those_of_the_pose::<3>();
        points_are_those_of_the_pose::<6>();
        points_are_those_of_the_pose::<9>();
    }
}
