//! Inverse kinematics of any arm by iteration: a damped Newton step (Levenberg–Marquardt) whose damping is in proportion to
//! the squared error that is left (Sugihara, "Solvability-Unconcerned Inverse Kinematics by the Levenberg–Marquardt Method",
//! IEEE Transactions on Robotics 27(5), 2011; damping near singularities: Nakamura and Hanafusa 1986, Wampler 1986). So steps
//! stay short far off and near singularities, and become Newton's near the goal.
//!
//! The answer is the one that the seed leads to. An arm of more than six joints has many: each step is the shortest that does
//! its work, so joints stay near the seed. An arm of fewer than six reaches only poses of its own: any other is refused with
//! what is left, position and orientation alike.

use super::{Answer, IkError, Missed, check, distance, turned};
use crate::arm::Arm;
use crate::pose::Pose;
use crate::units::JointPos;
use nalgebra::{Cholesky, SMatrix, SVector, Vector6};

/// Steps, taken and refused, of one solution.
pub const STEPS_MAX: usize = 200;
/// What an answer misses the pose by at most (m, rad).
pub const RESIDUAL_MAX: f64 = 1e-10;
/// Below this (m, rad) no other step is tried where one does not make it better.
const RESIDUAL_FLAT: f64 = 1e-12;
/// What no step can make better, for rounding (m, rad).
const RESIDUAL_LEAST: f64 = 2e-15;
/// Damping over the squared error, at first and at least.
const DAMPING: f64 = 0.1;
const DAMPING_LEAST: f64 = 1e-6;
/// Damping over the trace of JᵀJ, so that its rounding leaves it positive definite.
const DAMPING_FLOOR: f64 = 1e-14;

/// The joints inside the limits that the seed leads to. A seed outside its limits starts from the nearest inside.
///
/// # Errors
/// [`IkError::NotFinite`], [`IkError::NotRotation`]; [`IkError::NotConverged`] when [`STEPS_MAX`] steps do not bring position
/// and orientation within [`RESIDUAL_MAX`].
pub fn nearest<const N: usize>(
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Answer<N>, IkError> {
    check(base_from_flange, seed)?;
    let (joints, residual) = approach(arm, base_from_flange, seed);
    if residual > RESIDUAL_MAX {
        return Err(IkError::NotConverged { residual });
    }
    let joints = turned(arm, &joints, seed).map_err(|beyond| {
        let mut missed = Missed::nothing();
        missed.limit(beyond);
        missed.error()
    })?;
    Ok(Answer { joints, branch: None, margins: None, free: None })
}

/// Where steps from `start` end, inside the limits, and what is left there (m, rad).
pub(super) fn approach<const N: usize>(arm: &Arm<N>, goal: &Pose, start: &JointPos<N>) -> (JointPos<N>, f64) {
    let mut at = inside(arm, start);
    let (flange, mut jacobian) = arm.jacobian(&at);
    let mut error = between(&flange, goal);
    let mut damping = DAMPING;
    for _ in 0..STEPS_MAX {
        if size(&error) <= RESIDUAL_LEAST {
            break;
        }
        let Some(step) = step(arm, &at, &jacobian, &error, damping) else { break };
        let mut next = at;
        for (position, step) in next.0.iter_mut().zip(step.iter()) {
            *position += step;
        }
        let next = inside(arm, &next);
        let (flange, next_jacobian) = arm.jacobian(&next);
        let next_error = between(&flange, goal);
        if next_error.norm_squared() < error.norm_squared() {
            (at, jacobian, error) = (next, next_jacobian, next_error);
            damping = (0.1 * damping).max(DAMPING_LEAST);
        } else if size(&error) <= RESIDUAL_FLAT || distance(&next, &at) <= f64::EPSILON {
            // Rounding is all that is left, or nothing can move.
            break;
        } else {
            damping *= 10.0;
        }
    }
    (at, size(&error))
}

/// The step of damped least squares, without the joints that stand at a limit and would be pushed beyond it.
fn step<const N: usize>(
    arm: &Arm<N>,
    at: &JointPos<N>,
    jacobian: &SMatrix<f64, 6, N>,
    error: &Vector6<f64>,
    damping: f64,
) -> Option<SVector<f64, N>> {
    let mut jacobian = *jacobian;
    let limits = at.0.iter().zip(arm.position_min.0.iter().zip(&arm.position_max.0));
    for (mut column, (position, (low, high))) in jacobian.column_iter_mut().zip(limits) {
        let pull = column.dot(error);
        if (position <= low && pull < 0.0) || (position >= high && pull > 0.0) {
            column.fill(0.0);
        }
    }
    let mut normal = jacobian.transpose() * jacobian;
    let trace = normal.trace();
    let damping = damping * error.norm_squared() + DAMPING_FLOOR * trace + f64::MIN_POSITIVE;
    normal += SMatrix::<f64, N, N>::identity() * damping;
    let step = Cholesky::new(normal)?.solve(&(jacobian.transpose() * error));
    step.iter().all(|joint| joint.is_finite()).then_some(step)
}

/// What moves one pose to the other: shift (m), turn (rad), both in the base frame.
fn between(from: &Pose, to: &Pose) -> Vector6<f64> {
    let shift = to.translation - from.translation;
    let turn = Pose { rotation: to.rotation * from.rotation.transpose(), ..*to }.rotation_vector();
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

/// The larger of shift and turn.
fn size(error: &Vector6<f64>) -> f64 {
    error.fixed_rows::<3>(0).norm().max(error.fixed_rows::<3>(3).norm())
}

/// The joints, each moved to its limit if it is beyond.
fn inside<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>) -> JointPos<N> {
    let mut inside = *joints;
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    for (position, (low, high)) in inside.0.iter_mut().zip(limits) {
        *position = position.max(*low).min(*high);
    }
    inside
}
