//! Inverse kinematics of a calibrated arm: the closed form of the nominal arm it is close to gives a start for each branch,
//! and the damped Newton steps of [`super::numeric`] lead from there to the pose.
//!
//! Branch and margins are those of the nominal arm at the answer; so they are inexact by the calibration's tilts, and an arm
//! within some hundredths of a singularity may have one answer where its nominal has two.

use super::numeric::{RESIDUAL_MAX, approach};
use super::{Answer, Branches, IkError, Missed, check, distance, turned, ur};
use crate::arm::Arm;
use crate::pose::Pose;
use crate::units::JointPos;

/// Answers nearer to each other than this (rad) are one.
const SAME: f64 = 1e-6;
/// Starts nearer to a singularity than this go to the pose in stages.
const STAGED: f64 = 0.2;
const STAGES: u32 = 16;
/// By how much margins of the nominal arm may differ from the calibrated one's.
const MARGIN_TILT: f64 = 0.05;

/// Every branch inside the joint limits, as [`ur::inverse`]; each answer meets the pose to [`RESIDUAL_MAX`].
///
/// # Errors
/// As [`ur::inverse`]; [`IkError::NotConverged`] when no start leads to the pose.
pub fn inverse<const N: usize>(
    nominal: &ur::Geometry,
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Branches<N>, IkError> {
    check(base_from_flange, seed)?;
    let endless = endless(arm);
    // The seed too is a start: near a singularity it may be the best.
    let starts = nominal.inverse(&endless, base_from_flange, seed);
    let others = starts.iter().flat_map(|starts| starts.as_slice()).map(|start| &start.joints);
    let (mut found, mut missed, mut least) = (Branches::empty(), Missed::nothing(), f64::INFINITY);
    for start in core::iter::once(seed).chain(others) {
        let (joints, residual) = stay(nominal, &endless, base_from_flange, start);
        if residual > RESIDUAL_MAX {
            least = least.min(residual);
            continue;
        }
        match answer(nominal, arm, &joints, seed) {
            Ok(answer) if found.as_slice().iter().any(|other| distance(&other.joints, &answer.joints) < SAME) => {}
            Ok(answer) => found.push(answer),
            Err(beyond) => missed.limit(beyond),
        }
    }
    match (found.as_slice().is_empty(), missed.limit, starts) {
        (false, ..) => Ok(found),
        (true, Some(_), _) => Err(missed.error()),
        (true, None, Err(error)) => Err(error),
        (true, None, Ok(_)) => Err(IkError::NotConverged { residual: least }),
    }
}

/// The branch nearest to `seed`, by the largest joint difference.
///
/// # Errors
/// As [`inverse`].
pub fn nearest<const N: usize>(
    nominal: &ur::Geometry,
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Answer<N>, IkError> {
    check(base_from_flange, seed)?;
    let (joints, residual) = approach(&endless(arm), base_from_flange, seed);
    if residual <= RESIDUAL_MAX
        && let Ok(answer) = answer(nominal, arm, &joints, seed)
        // The margins prove that no other branch is nearer, as in the closed form.
        && let Some(margins) = answer.margins
        && distance(&answer.joints, seed) <= 0.5 * (margins.nearest().1 - MARGIN_TILT)
    {
        return Ok(answer);
    }
    let found = inverse(nominal, arm, base_from_flange, seed)?;
    found.nearest(seed).copied().ok_or(IkError::NotConverged { residual })
}

/// From a start to the pose; near a singularity in stages, each a part of the way, so that steps stay on the start's branch.
fn stay<const N: usize>(
    nominal: &ur::Geometry,
    endless: &Arm<N>,
    goal: &Pose,
    start: &JointPos<N>,
) -> (JointPos<N>, f64) {
    let stages = if nominal.posture(start).1.nearest().1 < STAGED { STAGES } else { 1 };
    let begin = endless.forward(start);
    let turn = Pose { rotation: goal.rotation * begin.rotation.transpose(), ..*goal }.rotation_vector();
    let mut at = *start;
    for stage in 1..stages {
        let share = f64::from(stage) / f64::from(stages);
        let translation = begin.translation + (goal.translation - begin.translation) * share;
        let turned = Pose::from_rotation_vector(translation, turn * share);
        let goal = Pose { rotation: turned.rotation * begin.rotation, translation };
        at = approach(endless, &goal, &at).0;
    }
    approach(endless, goal, &at)
}

fn answer<const N: usize>(
    nominal: &ur::Geometry,
    arm: &Arm<N>,
    joints: &JointPos<N>,
    seed: &JointPos<N>,
) -> Result<Answer<N>, super::Beyond> {
    let joints = turned(arm, joints, seed)?;
    let (branch, margins) = nominal.posture(&joints);
    Ok(Answer { joints, branch: Some(branch), margins: Some(margins), free: None })
}

/// The arm without limits: they are judged at the answers, turned by full turns.
fn endless<const N: usize>(arm: &Arm<N>) -> Arm<N> {
    let (position_min, position_max) = (JointPos([f64::NEG_INFINITY; N]), JointPos([f64::INFINITY; N]));
    Arm { position_min, position_max, ..*arm }
}
