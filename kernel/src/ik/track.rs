//! Newton's steps from a seed that is near: what the arms without a closed form have in a loop that may not be late.
//!
//! The steps are local. The first is bounded, each of the next is at most half of the one before (the monotonicity test of Deuflhard,
//! "Newton Methods for Nonlinear Problems", 2004, section 2.1), and where the last six joints carry the flange, the determinant
//! of the Jacobian keeps its sign. So the answer is on the seed's own branch and near it, or there is none: beside a singularity,
//! where steps do not shrink so, and across one.

use super::numeric::{between, size, solve};
use super::{Beyond, on_limit};
use crate::arm::{Arm, Jacobian};
use crate::pose::Pose;
use crate::units::JointPos;
use nalgebra::Vector6;

/// Steps of one answer.
pub const STEPS_MAX: usize = 6;
/// The joints that the first step moves by (rad, m), together, at most.
pub const STEP_MAX: f64 = 1.0;
/// What the next step is of one at most.
const SHRINK: f64 = 0.5;
/// The last step (rad, m), all joints together. What is left behind it is of second order, at most half its square times the
/// size of the arm in metres, or 1: below [`super::numeric::RESIDUAL_MAX`] for arms of less than 100 m.
const STEP_LAST: f64 = 1e-6;
/// What the last step may leave of a pose by itself, where there are not just as many joints as numbers of a pose (m, rad).
const LEFT_MAX: f64 = 1e-12;

/// Joints that steps led to.
pub(super) struct Tracked<const N: usize> {
    pub joints: JointPos<N>,
    /// Of the Jacobian of the last six joints, where the last step began; 0 where steps are of all joints.
    pub determinant: f64,
}

/// The joints near the seed that put the flange there, or what is left (m, rad) where steps ended without.
///
/// `last_six`: the joints before the last six stand.
pub(super) fn track<const N: usize>(
    arm: &Arm<N>,
    goal: &Pose,
    seed: &JointPos<N>,
    last_six: bool,
) -> Result<Tracked<N>, f64> {
    let mut joints = *seed;
    let (mut most, mut first, mut left) = (STEP_MAX, 0.0, f64::INFINITY);
    for _ in 0..STEPS_MAX {
        let (flange, jacobian) = arm.jacobian(&joints);
        let error = between(&flange, goal);
        left = size(&error);
        let (moved, determinant) = if last_six {
            let (step, determinant) = eliminate(&jacobian, &error);
            (add(&mut joints, step.iter(), N.saturating_sub(6)), determinant)
        } else {
            let Some(step) = solve(&jacobian, &error, 0.0) else { break };
            let met = size(&(error - jacobian * step)) <= LEFT_MAX;
            let moved = add(&mut joints, step.iter(), 0);
            // Else short steps say nothing of what is left.
            (if met { moved } else { moved.max(2.0 * STEP_LAST) }, 0.0)
        };
        first = if first == 0.0 { determinant } else { first };
        // Not so either where the Jacobian is singular and the step no number.
        if !(moved <= most && first * determinant >= 0.0) {
            break;
        }
        if moved <= STEP_LAST {
            return Ok(Tracked { joints, determinant });
        }
        most = SHRINK * moved;
    }
    Err(left)
}

/// Moves the joints behind the first `carried`; returns by how much together.
fn add<'a, const N: usize>(joints: &mut JointPos<N>, step: impl Iterator<Item = &'a f64>, carried: usize) -> f64 {
    let mut moved = 0.0;
    for (position, step) in joints.0.iter_mut().skip(carried).zip(step) {
        *position += step;
        moved += libm::fabs(*step);
    }
    moved
}

/// Whether the joints are inside their limits, and on them where only rounding takes them beyond: without full turns, which are
/// no small step.
pub(super) fn within<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>) -> Result<JointPos<N>, Beyond> {
    let mut within = *joints;
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    for (joint, (position, (low, high))) in (0..N).zip(within.0.iter_mut().zip(limits)) {
        *position = on_limit(*position, *low, *high).map_err(|(position, by)| Beyond { joint, position, by })?;
    }
    Ok(within)
}

/// The determinant of the columns of the last six joints.
pub(super) fn determinant<const N: usize>(jacobian: &Jacobian<N>) -> f64 {
    eliminate(jacobian, &Vector6::zeros()).1
}

/// The step of the last six joints that meets the error, and the determinant of their columns: Gaussian elimination with the
/// largest pivot of each column (Golub, Van Loan, "Matrix Computations", 3.4). Without a determinant the step is no number.
fn eliminate<const N: usize>(jacobian: &Jacobian<N>, error: &Vector6<f64>) -> ([f64; 6], f64) {
    let mut columns = [[0.0; 6]; 6];
    for (to, from) in columns.iter_mut().zip(jacobian.data.0.iter().skip(N.saturating_sub(6))) {
        *to = *from;
    }
    let [[error]] = [error.data.0];
    let [a, b, c, d, e, f] = columns;
    let mut entries: [[f64; 7]; 6] = core::array::from_fn(|k| [a[k], b[k], c[k], d[k], e[k], f[k], error[k]]);
    let mut rows = entries.each_mut();
    let (mut determinant, mut rest) = (1.0, rows.as_mut_slice());
    for column in 0..6 {
        let Some((pivot, others)) = rest.split_first_mut() else { break };
        for other in others.iter_mut() {
            if libm::fabs(other[column]) > libm::fabs(pivot[column]) {
                core::mem::swap(pivot, other);
                determinant = -determinant;
            }
        }
        determinant *= pivot[column];
        if determinant == 0.0 {
            break;
        }
        // A copy: compilers see that it stays while the others change.
        let pivot = **pivot;
        let inverse = 1.0 / pivot[column];
        for other in others.iter_mut() {
            let share = other[column] * inverse;
            // Also what is zero by now: a fixed count of entries is several times as fast.
            for (entry, pivot) in other.iter_mut().zip(pivot) {
                *entry -= share * pivot;
            }
        }
        rest = others;
    }
    let mut step = [0.0; 6];
    for (column, row) in rows.iter().enumerate().rev() {
        let [parts @ .., whole] = row;
        // Steps not yet known are zero.
        let known = parts.iter().zip(&step).fold(*whole, |rest, (part, step)| rest - part * step);
        step[column] = known / row[column];
    }
    (step, determinant)
}
