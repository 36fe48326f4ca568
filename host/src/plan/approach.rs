//! The approach: straight in joint space, as quick as the joints' share and the tool's travel limits allow.

use super::error::PlanError;
use super::moves::{Move, MoveKind, travel_limits};
use super::profile::{PathLimits, Profile, Stretch};
use super::route::Route;
use super::tooling::Tooling;
use crate::config::Cell;
use nalgebra::Vector3;
use screed_kernel::units::JointPos;

/// Places on the way at which the tool's derivatives by the share of the way are taken.
const SAMPLES: usize = 1000;
/// What the derivatives may be greater between the samples.
const BETWEEN_SAMPLES: f64 = 1.02;

/// What a person wants to know before the first motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Whether the tool is lifted straight up before.
    pub lifted: bool,
    /// The joints it starts from (rad).
    pub from: JointPos<6>,
    /// The joints it leads to, above the first layer's start (rad).
    pub to: JointPos<6>,
    /// How long it takes (s).
    pub duration: f64,
    /// How far the tool centre point goes (m).
    pub tool_distance: f64,
    /// The lowest tool centre point on the way, above the part frame's xy plane (m).
    pub tool_lowest: f64,
}

/// The move and its summary; no move when the joints are there already.
pub fn approach(
    tooling: &Tooling,
    cell: &Cell,
    layer: usize,
    [from, to]: [JointPos<6>; 2],
    period: f64,
) -> Result<(Option<Move>, Approach), PlanError> {
    let points: Vec<Vector3<f64>> = (0..=SAMPLES)
        .map(|i| Route::joints_between(&from, &to, i as f64 / SAMPLES as f64))
        .map(|joints| tooling.point_in_part(&joints).coords)
        .collect();
    let mut summary = Approach {
        lifted: false,
        from,
        to,
        duration: 0.0,
        tool_distance: points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum(),
        tool_lowest: points.iter().fold(f64::INFINITY, |lowest, point| lowest.min(point.z)),
    };
    if from == to {
        return Ok((None, summary));
    }
    let limits = limits(cell, &points, &from, &to);
    let stretches = [Stretch { length: 1.0, curvature_max: 0.0, rest_after: true }];
    let profile = Profile::quickest(&stretches, &limits);
    summary.duration = profile.duration();
    let route = Route::Joints { from, to };
    let approach = Move::new(MoveKind::Approach, layer, route, &stretches, profile, limits, period)?;
    Ok((Some(approach), summary))
}

/// Limits per share x of the way. With p(x) the tool's way and ẋ, ẍ speed and acceleration of the share, the tool moves at
/// |p′|·ẋ and accelerates by at most |p′|·ẍ + |p″|·ẋ²; half of its limit goes to each term.
fn limits(cell: &Cell, points: &[Vector3<f64>], from: &JointPos<6>, to: &JointPos<6>) -> PathLimits {
    let step = 1.0 / SAMPLES as f64;
    let greatest = |derivative: &mut dyn Iterator<Item = f64>| BETWEEN_SAMPLES * derivative.fold(0.0, f64::max);
    let first = greatest(&mut points.windows(2).map(|p| (p[1] - p[0]).norm() / step));
    let second = greatest(&mut points.windows(3).map(|p| (p[2] - p[1] * 2.0 + p[0]).norm() / (step * step)));
    let travel = travel_limits(cell);
    // A quotient by a derivative of zero is infinite: no limit.
    let mut limits = PathLimits {
        velocity_max: (travel.velocity_max / first).min((0.5 * travel.acceleration_max / second).sqrt()),
        acceleration_max: 0.5 * travel.acceleration_max / first,
        jerk_max: travel.jerk_max / first,
    };
    let (robot, share) = (&cell.robot, cell.travel.approach_joint_share);
    for joint in 0..6 {
        let turn = (to.0[joint] - from.0[joint]).abs();
        limits.velocity_max = limits.velocity_max.min(share * robot.joint_velocity_max.0[joint] / turn);
        limits.acceleration_max = limits.acceleration_max.min(share * robot.joint_acceleration_max.0[joint] / turn);
        limits.jerk_max = limits.jerk_max.min(share * robot.joint_jerk_max.0[joint] / turn);
    }
    limits
}
