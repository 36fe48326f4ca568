//! From a point of the part to joints, and back.

use super::path::Point;
use crate::config::Cell;
use nalgebra::{Matrix3, Vector3};
use screed_kernel::arm::Arm;
use screed_kernel::ik::{Branches, Family, IkError};
use screed_kernel::pose::Pose;
use screed_kernel::setpoint::joint_on_grid;
use screed_kernel::units::JointPos;

/// The arm, its tool, and where the part lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Tooling {
    /// The arm.
    pub arm: Arm<6>,
    /// How its inverse kinematics is solved.
    family: Family,
    base_from_part: Pose,
    flange_from_tcp: Pose,
    /// The flange's orientation for the tool's one direction.
    base_from_flange: Matrix3<f64>,
    /// The flange's origin less the tool centre point, in the base frame (m).
    flange_less_tcp: Vector3<f64>,
}

impl Tooling {
    /// Of a cell. The tool points down in the part frame: tcp z is the part's −z, tcp x is the part's x.
    pub fn new(cell: &Cell) -> Self {
        let (base_from_part, flange_from_tcp) = (cell.part.base_from_part, cell.tool.flange_from_tcp);
        let part_from_tcp = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let tcp_from_flange = flange_from_tcp.inverse();
        let base_from_tcp = base_from_part.rotation * part_from_tcp;
        Self {
            arm: cell.robot.arm,
            family: Family::of(&cell.robot.arm),
            base_from_part,
            flange_from_tcp,
            base_from_flange: base_from_tcp * tcp_from_flange.rotation,
            flange_less_tcp: base_from_tcp * tcp_from_flange.translation,
        }
    }

    /// The flange for a tool centre point in the part frame.
    pub fn flange_at(&self, point_in_part: &Point) -> Pose {
        let tcp = self.base_from_part.transform_point(&point_in_part.coords);
        Pose { rotation: self.base_from_flange, translation: tcp + self.flange_less_tcp }
    }

    /// The joints nearest to `seed` for a tool centre point in the part frame, on the grid.
    ///
    /// # Errors
    /// As [`Family::nearest`].
    pub fn joints_at(&self, point_in_part: &Point, seed: &JointPos<6>) -> Result<JointPos<6>, IkError> {
        let flange = self.flange_at(point_in_part);
        self.family.nearest(&self.arm, &flange, seed).map(|answer| on_grid(&answer.joints))
    }

    /// Every branch for a tool centre point in the part frame, each nearest to `seed`.
    ///
    /// # Errors
    /// As [`Family::inverse`].
    pub fn branches_at(&self, point_in_part: &Point, seed: &JointPos<6>) -> Result<Branches<6>, IkError> {
        self.family.inverse(&self.arm, &self.flange_at(point_in_part), seed)
    }

    /// Whether joints hold the tool in its one direction, to 1e-6 rad.
    pub fn is_upright(&self, joints: &JointPos<6>) -> bool {
        (self.arm.forward(joints).rotation - self.base_from_flange).norm() < 1e-6
    }

    /// Where joints put the tool centre point, in the base frame.
    pub fn base_from_tcp(&self, joints: &JointPos<6>) -> Pose {
        self.arm.forward(joints) * self.flange_from_tcp
    }

    /// Where joints put the tool centre point, in the part frame.
    pub fn point_in_part(&self, joints: &JointPos<6>) -> Point {
        Point::from((self.base_from_part.inverse() * self.base_from_tcp(joints)).translation)
    }
}

/// The joints on the kernel's grid ([`joint_on_grid`]): numbers on a grid survive being sent, added and compared without a
/// last bit that differs.
pub fn on_grid(joints: &JointPos<6>) -> JointPos<6> {
    JointPos(joints.0.map(joint_on_grid))
}
