//! One call for any arm: its table says which solution it has.

use super::{Answer, Branches, IkError, calibrated, gantry, numeric, ur, wrist};
use crate::arm::Arm;
use crate::pose::Pose;
use crate::units::JointPos;

/// How an arm is solved. A host finds it once for an arm, and keeps it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Family {
    /// [`ur`]: closed form.
    Ur(ur::Geometry),
    /// [`wrist`]: closed form of the last six joints.
    Wrist(wrist::Geometry),
    /// [`gantry`]: closed form.
    Gantry(gantry::Geometry),
    /// [`calibrated`]: iteration from the closed form of the nominal arm.
    Calibrated(calibrated::Geometry),
    /// [`numeric`]: iteration from the seed.
    Numeric,
}

impl Family {
    /// The first that the table fits, in the order above.
    pub fn of<const N: usize>(arm: &Arm<N>) -> Self {
        let closed = ur::Geometry::of(arm).map(Self::Ur);
        let closed = closed.or_else(|| wrist::Geometry::of(arm).map(Self::Wrist));
        let closed = closed.or_else(|| gantry::Geometry::of(arm).map(Self::Gantry));
        closed.or_else(|| calibrated::Geometry::near(arm).map(Self::Calibrated)).unwrap_or(Self::Numeric)
    }

    /// The words for a person.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Ur(_) => "UR type, closed form",
            Self::Wrist(_) => "spherical wrist, closed form",
            Self::Gantry(_) => "gantry, closed form",
            Self::Calibrated(geometry) => geometry.name(),
            Self::Numeric => "iteration from the seed",
        }
    }

    /// Every branch that reaches the pose inside the joint limits, each the nearest full turns to `seed`; of a gantry and by
    /// [`numeric`] one answer. `arm` is the one that the family is of.
    ///
    /// # Errors
    /// As the family's own `inverse`.
    pub fn inverse<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Branches<N>, IkError> {
        match self {
            Self::Ur(geometry) => geometry.inverse(arm, base_from_flange, seed),
            Self::Wrist(geometry) => geometry.inverse(arm, base_from_flange, seed),
            Self::Calibrated(geometry) => geometry.inverse(arm, base_from_flange, seed),
            Self::Gantry(_) | Self::Numeric => self.nearest(arm, base_from_flange, seed).map(Branches::one),
        }
    }

    /// The answer nearest to `seed`, by the largest joint difference (rad, m). `arm` is the one that the family is of.
    ///
    /// # Errors
    /// As the family's own `nearest`.
    pub fn nearest<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Answer<N>, IkError> {
        match self {
            Self::Ur(geometry) => geometry.nearest(arm, base_from_flange, seed),
            Self::Wrist(geometry) => geometry.nearest(arm, base_from_flange, seed),
            Self::Gantry(geometry) => geometry.nearest(arm, base_from_flange, seed),
            Self::Calibrated(geometry) => geometry.nearest(arm, base_from_flange, seed),
            Self::Numeric => numeric::nearest(arm, base_from_flange, seed),
        }
    }

    /// The answer to a pose a small step away from that of `seed`, in the time that a tick has. Closed forms give the nearest;
    /// iterated arms the one that a few short steps lead to on the seed's own branch ([`super::track`]), or none. `arm` is the one that
    /// the family is of.
    ///
    /// # Errors
    /// As the family's own `nearest` or `track`.
    pub fn track<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Answer<N>, IkError> {
        match self {
            Self::Ur(_) | Self::Wrist(_) | Self::Gantry(_) => self.nearest(arm, base_from_flange, seed),
            Self::Calibrated(geometry) => geometry.track(arm, base_from_flange, seed),
            Self::Numeric => numeric::track(arm, base_from_flange, seed),
        }
    }
}
