//! Inverse kinematics of a calibrated arm: the closed form of the nominal arm it is close to gives a start for each branch,
//! and the damped Newton steps of [`super::numeric`] lead from there to the pose.
//!
//! A calibration moves singularities by its millimetres, and around them the unit's answers are not its nominal's. Where two
//! meet at a stretched elbow they meet earlier or later. Where joints 4 and 6 come into line, which leaves one of them free in
//! the nominal arm, the unit has none, two or four answers instead of a circle of them: so it may have more than eight. From
//! a start or an answer whose margin is less than 0.25 the search follows the curve on which the answers meet (`scan`), and
//! finds them by the sign of what is left there; answers that are found so are searched around likewise.
//!
//! [`Branch`]: the nominal arm's signs at the answer; but the one that is nearest to zero is such that all three together have
//! the sign of the Jacobian's determinant, which is their product and changes its sign where the unit's own answers meet.
//! [`Margins`] likewise. Where joints 4 and 6 are in line, more than two answers can have the same signs.
//!
//! Where three or four answers nearly meet at once on a circle, or two singularities meet, some that lie within hundredths of
//! a radian of each other are not told apart or not found; `tests/inverse.rs` counts them: 4 of 2,784 around the singularities
//! with circles, none at folds and at random poses.

mod scan;
mod search;

use super::numeric::{RESIDUAL_MAX, approach};
use super::track::{Tracked, determinant, track, within};
use super::{
    Answer, Beyond, Branch, Branches, IkError, Margins, Side, Singularity, check, distance, turned, ur, wrist,
};
use crate::arm::Arm;
use crate::pose::Pose;
use crate::units::JointPos;
use core::f64::consts::PI;
use search::{CLOSE, Search};

/// How much the sines and cosines of α may differ from those of right angles.
pub const TILT_MAX: f64 = 0.05;
/// Lengths (m) that a nominal arm does not have.
pub const SHIFT_MAX: f64 = 0.05;
/// How far (m) out of the nominal arm's reach a pose may be that the calibrated one reaches.
pub const SLACK: f64 = 0.05;
/// Margin of an answer that may not be alone.
const NEAR: f64 = 0.25;
/// By how much margins of the nominal arm may differ from the calibrated one's.
const MARGIN_TILT: f64 = 0.05;
/// Steps (rad) around a circle, and beside a fold: the answers that meet there are within 2·[`NEAR`] of each other.
const CIRCLE_STEP: f64 = PI / 18.0;
const FOLD_STEP: f64 = 0.08;
const FOLD_REACH: f64 = 0.8;

/// How a calibrated arm is solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    nominal: Nominal,
    /// The Jacobian's determinant over the product of its factors.
    scale: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Nominal {
    Ur(ur::Geometry),
    Wrist(wrist::Geometry),
}

/// A curve on which branches meet: the joint, of the last six, that moves along it, steps of it and how far it goes (rad).
struct Curve {
    joint: usize,
    step: f64,
    reach: f64,
    /// Whether the nominal arm has a whole circle of answers at the singularity, or two that meet.
    is_circle: bool,
}

/// What the determinant of the nominal arm's Jacobian is the product of, but for a constant. Each is zero at a singularity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Factors {
    /// How far (m) the wrist is in front of axis 1, and of what length that is a share.
    pub along: f64,
    pub away: f64,
    /// Sine of the elbow's angle.
    pub elbow: f64,
    /// Sine of the wrist's.
    pub wrist: f64,
}

impl Geometry {
    /// For an arm near one of UR type ([`ur::Geometry::near`]) or one whose last six joints have a spherical wrist
    /// ([`wrist::Geometry::near`]).
    pub fn near<const N: usize>(arm: &Arm<N>) -> Option<Self> {
        let ur = ur::Geometry::near(arm).map(Nominal::Ur);
        let nominal = ur.or_else(|| wrist::Geometry::near(arm).map(Nominal::Wrist))?;
        let joints = match &nominal {
            Nominal::Ur(geometry) => geometry.regular(),
            Nominal::Wrist(geometry) => geometry.regular(arm),
        };
        let Factors { along, elbow, wrist, .. } = nominal.factors(arm, &joints);
        let scale = determinant(&arm.jacobian(&joints).1) / (along * elbow * wrist);
        (scale.is_finite() && scale != 0.0).then_some(Self { nominal, scale })
    }

    /// The words for a person.
    pub const fn name(&self) -> &'static str {
        match self.nominal {
            Nominal::Ur(_) => "calibrated UR type, iteration from its nominal arm's closed form",
            Nominal::Wrist(_) => "calibrated spherical wrist, iteration from its nominal arm's closed form",
        }
    }

    /// Every branch inside the joint limits, each joint turned by full turns to lie nearest to `seed`; each answer meets the
    /// pose to [`RESIDUAL_MAX`].
    ///
    /// # Errors
    /// As [`ur::inverse`] or [`wrist::inverse`]; where the nominal arm reaches the pose and the unit does not, how much it
    /// misses it by: [`IkError::OutOfReach`], or [`IkError::Singular`] where it is the wrist that cannot turn so;
    /// [`IkError::NotConverged`] when the steps end without having found that out.
    pub fn inverse<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Branches<N>, IkError> {
        check(base_from_flange, seed)?;
        let unit = held(arm, seed);
        let mut search = Search::new(self, &unit, base_from_flange, seed);
        // The seed too is a start: near a singularity it may be the best.
        search.start(seed);
        let starts = self.nominal.inverse(&unit, base_from_flange, seed);
        for start in starts.iter().flat_map(|starts| starts.as_slice()) {
            search.nominal(start);
        }
        search.neighbours();
        search.end(arm, starts.err())
    }

    /// The branch nearest to `seed`, by the largest joint difference.
    ///
    /// # Errors
    /// As [`Self::inverse`].
    pub fn nearest<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Answer<N>, IkError> {
        check(base_from_flange, seed)?;
        let (joints, residual) = approach(&held(arm, seed), base_from_flange, seed);
        if residual <= RESIDUAL_MAX
            && let Ok(answer) = self.answer(arm, &joints, seed)
            // The margins prove that no other branch is nearer, as in the closed form.
            && let Some(margins) = answer.margins
            && distance(&answer.joints, seed) <= self.nominal.share() * (margins.nearest().1 - MARGIN_TILT)
        {
            return Ok(answer);
        }
        let found = self.inverse(arm, base_from_flange, seed)?;
        found.nearest(seed).copied().ok_or(IkError::NotConverged { residual })
    }

    /// The answer on the seed's own branch to which few short steps lead from a seed nearby ([`super::track`]).
    ///
    /// # Errors
    /// [`IkError::NotFinite`], [`IkError::NotRotation`]; where the steps do not shrink as they have to, [`IkError::Singular`] when
    /// the seed is closer than 0.05 to a singularity and [`IkError::NotConverged`] when it is not; [`IkError::Limit`].
    pub fn track<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Answer<N>, IkError> {
        check(base_from_flange, seed)?;
        let Tracked { joints, determinant } = track(arm, base_from_flange, seed, true).map_err(|residual| {
            let (singularity, distance) = self.posture(arm, seed).1.nearest();
            if distance < CLOSE {
                IkError::Singular { singularity, distance }
            } else {
                IkError::NotConverged { residual }
            }
        })?;
        let joints = within(arm, &joints).map_err(Beyond::error)?;
        let (branch, margins) = self.sides(arm, &joints, determinant);
        Ok(Answer { joints, branch: Some(branch), margins: Some(margins), free: None })
    }

    fn answer<const N: usize>(
        &self,
        arm: &Arm<N>,
        joints: &JointPos<N>,
        seed: &JointPos<N>,
    ) -> Result<Answer<N>, Beyond> {
        let joints = turned(arm, joints, seed)?;
        let (branch, margins) = self.posture(arm, &joints);
        Ok(Answer { joints, branch: Some(branch), margins: Some(margins), free: None })
    }

    /// The curve on which branches meet at a singularity.
    fn curve(&self, singularity: Singularity) -> Curve {
        let fold = |joint| Curve { joint, step: FOLD_STEP, reach: FOLD_REACH, is_circle: false };
        let circle = |joint| Curve { joint, step: CIRCLE_STEP, reach: PI, is_circle: true };
        match (singularity, self.nominal) {
            (Singularity::Shoulder, Nominal::Ur(_)) => fold(0),
            (Singularity::Shoulder, Nominal::Wrist(_)) => circle(0),
            (Singularity::Elbow, _) => fold(2),
            (Singularity::Wrist, Nominal::Ur(_)) => circle(5),
            (Singularity::Wrist, Nominal::Wrist(_)) => circle(3),
        }
    }

    /// On which branch joints are, and how far from each singularity.
    pub fn posture<const N: usize>(&self, arm: &Arm<N>, joints: &JointPos<N>) -> (Branch, Margins) {
        self.sides(arm, joints, determinant(&arm.jacobian(joints).1))
    }

    /// The same by the determinant of the Jacobian of the last six joints.
    fn sides<const N: usize>(&self, arm: &Arm<N>, joints: &JointPos<N>, determinant: f64) -> (Branch, Margins) {
        let Factors { along, away, elbow, wrist } = self.nominal.factors(arm, joints);
        let mut branch = Branch { shoulder: Side::of(along), elbow: Side::of(elbow), wrist: Side::of(wrist) };
        let mut margins =
            Margins { shoulder: libm::fabs(along) / away, elbow: libm::fabs(elbow), wrist: libm::fabs(wrist) };
        let product = determinant / self.scale;
        let (nearest, margin) = margins.nearest();
        if margin < NEAR {
            // The factor that makes the product right.
            let (others, side, margin) = match nearest {
                Singularity::Shoulder => (elbow * wrist * away, &mut branch.shoulder, &mut margins.shoulder),
                Singularity::Elbow => (along * wrist, &mut branch.elbow, &mut margins.elbow),
                Singularity::Wrist => (along * elbow, &mut branch.wrist, &mut margins.wrist),
            };
            let factor = product / others;
            // Two singularities in one place leave nothing to divide by.
            if factor.is_finite() {
                *side = Side::of(factor);
                *margin = libm::fabs(factor).min(1.0);
            }
        }
        (branch, margins)
    }
}

impl Nominal {
    fn inverse<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Branches<N>, IkError> {
        match self {
            Self::Ur(geometry) => geometry.inverse(arm, base_from_flange, seed),
            Self::Wrist(geometry) => geometry.inverse(arm, base_from_flange, seed),
        }
    }

    fn factors<const N: usize>(&self, arm: &Arm<N>, joints: &JointPos<N>) -> Factors {
        match self {
            Self::Ur(geometry) => geometry.factors(joints),
            Self::Wrist(geometry) => geometry.factors(arm, joints),
        }
    }

    /// What of a difference of an angle one joint has at least.
    const fn share(&self) -> f64 {
        match self {
            Self::Ur(_) => 1.0,
            Self::Wrist(geometry) => geometry.share(),
        }
    }
}

/// The arm without limits, which are judged at the answers, turned by full turns; the joints that carry the last six stay
/// where the seed has them.
fn held<const N: usize>(arm: &Arm<N>, seed: &JointPos<N>) -> Arm<N> {
    let (mut position_min, mut position_max) = (JointPos([f64::NEG_INFINITY; N]), JointPos([f64::INFINITY; N]));
    let ends = position_min.0.iter_mut().zip(&mut position_max.0);
    for ((low, high), seed) in ends.zip(&seed.0).take(N.saturating_sub(6)) {
        (*low, *high) = (*seed, *seed);
    }
    Arm { position_min, position_max, ..*arm }
}
