//! Inverse kinematics of any arm by iteration: a damped Newton step (Levenberg–Marquardt) whose damping is in proportion to
//! the squared error that is left (Sugihara, "Solvability-Unconcerned Inverse Kinematics by the Levenberg–Marquardt Method",
//! IEEE Transactions on Robotics 27(5), 2011; damping near singularities: Nakamura and Hanafusa 1986, Wampler 1986). So steps
//! stay short far off and near singularities, and become Newton's near the goal.
//!
//! The answer is the one that the seed leads to. An arm of more than six joints has many: each step is the shortest that does
//! its work, so joints stay near the seed. An arm of fewer than six reaches only poses of its own: any other is refused with
//! what is left, position and orientation alike.

use super::track;
use super::{Answer, Beyond, IkError, check, distance, turned};
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
/// How far (rad, m) from where steps got stuck others start.
const AWAY: [f64; 4] = [0.2, -0.2, 0.6, -0.6];
/// A share of the trace of JᵀJ that is none.
const LOST: f64 = 1e-12;
/// Damping over the squared error, at first and at least.
const DAMPING: f64 = 0.1;
const DAMPING_LEAST: f64 = 1e-6;
/// Damping over the trace of JᵀJ, so that its rounding leaves it positive definite.
const DAMPING_FLOOR: f64 = 1e-14;

/// The joints inside the limits that the seed leads to. A seed outside its limits starts from the nearest inside. Where that
/// gets stuck, four more starts beside the place, along the direction that is lost there, have their try.
///
/// # Errors
/// [`IkError::NotFinite`], [`IkError::NotRotation`]; [`IkError::NotConverged`] when [`STEPS_MAX`] steps from each start do not
/// bring position and orientation within [`RESIDUAL_MAX`].
pub fn nearest<const N: usize>(
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Answer<N>, IkError> {
    check(base_from_flange, seed)?;
    let (mut joints, mut residual) = approach(arm, base_from_flange, seed);
    for away in AWAY {
        if residual <= RESIDUAL_MAX {
            break;
        }
        // Stuck where a direction is lost: along it, to either side, the way may be free.
        let (across, left) = approach(arm, base_from_flange, &beside(arm, &joints, away));
        if left <= RESIDUAL_MAX {
            (joints, residual) = (across, left);
        }
    }
    if residual > RESIDUAL_MAX {
        return Err(IkError::NotConverged { residual });
    }
    let joints = turned(arm, &joints, seed).map_err(Beyond::error)?;
    Ok(Answer { joints, branch: None, margins: None, free: None })
}

/// The joints inside the limits to which few short steps lead from a seed nearby ([`super::track`]); six joints stay on the seed's
/// side of singularities.
///
/// # Errors
/// [`IkError::NotFinite`], [`IkError::NotRotation`]; [`IkError::NotConverged`] when the steps do not shrink as they have to;
/// [`IkError::Limit`].
pub fn track<const N: usize>(arm: &Arm<N>, base_from_flange: &Pose, seed: &JointPos<N>) -> Result<Answer<N>, IkError> {
    check(base_from_flange, seed)?;
    let tracked = track::track(arm, base_from_flange, seed, N == 6);
    let joints = tracked.map_err(|residual| IkError::NotConverged { residual })?.joints;
    let joints = track::within(arm, &joints).map_err(Beyond::error)?;
    Ok(Answer { joints, branch: None, margins: None, free: None })
}

/// Joints moved along the direction in which they move the flange the least: a vector that is left of three steps of inverse
/// iteration (Golub, Van Loan, "Matrix Computations", 8.2.2).
fn beside<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>, away: f64) -> JointPos<N> {
    let (_, jacobian) = arm.jacobian(joints);
    let mut normal = jacobian.transpose() * jacobian;
    normal += SMatrix::<f64, N, N>::identity() * (LOST * normal.trace() + f64::MIN_POSITIVE);
    let mut moved = *joints;
    let Some(factor) = Cholesky::new(normal) else { return moved };
    let mut direction = SVector::<f64, N>::repeat(1.0);
    for _ in 0..3 {
        direction = factor.solve(&direction);
        direction /= direction.norm();
    }
    if direction.iter().all(|share| share.is_finite()) {
        for (position, share) in moved.0.iter_mut().zip(direction.iter()) {
            *position += away * share;
        }
    }
    moved
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
    solve(&jacobian, error, damping * error.norm_squared())
}

/// The joint step of damped least squares: (JᵀJ + damping)⁻¹ Jᵀ e.
pub(super) fn solve<const N: usize>(
    jacobian: &SMatrix<f64, 6, N>,
    error: &Vector6<f64>,
    damping: f64,
) -> Option<SVector<f64, N>> {
    let mut normal = jacobian.transpose() * jacobian;
    let damping = damping + DAMPING_FLOOR * normal.trace() + f64::MIN_POSITIVE;
    normal += SMatrix::<f64, N, N>::identity() * damping;
    let step = Cholesky::new(normal)?.solve(&(jacobian.transpose() * error));
    step.iter().all(|joint| joint.is_finite()).then_some(step)
}

/// What moves one pose to the other: shift (m), turn (rad), both in the base frame.
pub(super) fn between(from: &Pose, to: &Pose) -> Vector6<f64> {
    let shift = to.translation - from.translation;
    let turn = Pose { rotation: to.rotation * from.rotation.transpose(), ..*to }.rotation_vector();
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

/// The larger of shift and turn.
pub(super) fn size(error: &Vector6<f64>) -> f64 {
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

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::arm::{Dh, Joint, JointKind, Rating};
    use crate::arms::ur::UR10E;
    use std::println;

    /// splitmix64, as a number in [-1, 1].
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// An arm without any right angle; its second joint slides.
    fn crooked<const N: usize>() -> Arm<N> {
        let row = |k: usize| {
            let (sin_alpha, cos_alpha) = libm::sincos(0.3 + k as f64);
            Dh { theta: 0.2 - k as f64, d: 0.1 + 0.1 * k as f64, a: 0.4 - 0.05 * k as f64, sin_alpha, cos_alpha }
        };
        let mut joints = [Joint::REVOLUTE; N];
        joints[1].kind = JointKind::Prismatic;
        Arm {
            name: "crooked",
            base_from_zero: None,
            dh: core::array::from_fn(row),
            joints,
            last_from_flange: None,
            position_min: JointPos([-2.0; N]),
            position_max: JointPos([2.0; N]),
            velocity_max: Rating::Unknown,
            acceleration_max: Rating::Unknown,
        }
    }

    /// Poses of joints within the limits, from seeds so far from them: how many of a thousand are solved.
    fn solved<const N: usize>(arm: &Arm<N>, away: f64) -> usize {
        let mut state = 7;
        let mut solved = 0;
        for _ in 0..1000 {
            let joints = JointPos(core::array::from_fn(|_| 2.0 * random(&mut state)));
            let seed = JointPos(joints.0.map(|position| position + away * random(&mut state)));
            let pose = arm.forward(&joints);
            match nearest(arm, &pose, &seed) {
                Ok(answer) => {
                    solved += 1;
                    assert!(size(&between(&arm.forward(&answer.joints), &pose)) <= RESIDUAL_MAX);
                    let mut limits = answer.joints.0.iter().zip(arm.position_min.0.iter().zip(&arm.position_max.0));
                    assert!(limits.all(|(position, (low, high))| low <= position && position <= high), "{answer:?}");
                    // A redundant arm goes elsewhere, but not far.
                    assert!(away > 0.1 || distance(&answer.joints, &seed) < 30.0 * away, "{joints:?} {answer:?}");
                }
                Err(IkError::NotConverged { residual }) => assert!(residual > RESIDUAL_MAX, "{residual:e}"),
                Err(error) => panic!("{error:?}"),
            }
        }
        println!("{N} joints, {away} away: {solved} of 1000");
        solved
    }

    #[test]
    fn arms_of_three_to_nine_joints_are_solved_from_near_seeds() {
        assert!(solved(&crooked::<3>(), 0.1) >= 995);
        assert!(solved(&crooked::<4>(), 0.1) >= 995);
        assert!(solved(&crooked::<5>(), 0.1) >= 995);
        assert!(solved(&crooked::<6>(), 0.1) >= 995);
        assert!(solved(&crooked::<7>(), 0.1) >= 995);
        assert!(solved(&crooked::<8>(), 0.1) >= 995);
        assert!(solved(&crooked::<9>(), 0.1) >= 995);
        assert!(solved(&UR10E, 0.1) >= 995);
        assert!(solved(&crooked::<7>(), 1.0) >= 800);
        assert!(solved(&crooked::<9>(), 1.0) >= 800);
    }

    #[test]
    fn steps_end_and_what_is_left_is_told() {
        let far = Pose::from_translation(3.0, 0.0, 0.5);
        let error = nearest(&UR10E, &far, &JointPos::ZERO);
        assert!(
            matches!(error, Err(IkError::NotConverged { residual }) if (1.0..3.5).contains(&residual)),
            "{error:?}"
        );
        let error = nearest(&crooked::<9>(), &Pose::from_translation(20.0, 0.0, 0.0), &JointPos([0.1; 9]));
        assert!(
            matches!(error, Err(IkError::NotConverged { residual }) if (10.0..20.0).contains(&residual)),
            "{error:?}"
        );
        // Four joints do not turn the flange as they like: what is left is an angle.
        let arm = crooked::<4>();
        let pose = arm.forward(&JointPos([0.3; 4]));
        let turned = pose * Pose::from_roll_pitch_yaw(nalgebra::Vector3::zeros(), 0.2, 0.1, -0.2);
        let error = nearest(&arm, &turned, &JointPos([0.3; 4]));
        assert!(
            matches!(error, Err(IkError::NotConverged { residual }) if (0.01..0.3).contains(&residual)),
            "{error:?}"
        );
        assert_eq!(
            nearest(&arm, &Pose::from_translation(f64::NAN, 0.0, 0.0), &JointPos::ZERO),
            Err(IkError::NotFinite)
        );
    }
}
