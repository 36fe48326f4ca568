//! The arms that are compared.

use crate::record::Record;
use screed_kernel::arm::Arm;
use screed_kernel::arms::{abb, comau, kuka, ur};
use screed_kernel::ik::{Answer, Branches, Family, IkError};
use screed_kernel::units::JointPos;

/// An arm of ours.
pub struct Ours {
    /// With limits that leave out no branch, as the peers have none.
    pub arm: Arm<6>,
    /// Found once for an arm, as the peers do.
    family: Family,
}

impl Ours {
    /// The arm of that name, if it is compared with anyone.
    pub fn named(name: &str) -> Option<Self> {
        let arms = [ur::UR10E, kuka::KR120_R2500, kuka::KR210_R2700, abb::IRB140, abb::IRB6700_200, comau::NJ130];
        let arm = arms.into_iter().find(|arm| arm.name == name)?;
        let (low, high) = (JointPos([f64::NEG_INFINITY; 6]), JointPos([f64::INFINITY; 6]));
        Some(Self { arm: Arm { position_min: low, position_max: high, ..arm }, family: Family::of(&arm) })
    }

    /// All branches.
    pub fn all(&self, input: &Record) -> Result<Branches<6>, IkError> {
        self.family.inverse(&self.arm, &input.base_from_flange, &input.seed)
    }

    /// The branch nearest to the seed.
    pub fn nearest(&self, input: &Record) -> Result<Answer<6>, IkError> {
        self.family.nearest(&self.arm, &input.base_from_flange, &input.seed)
    }
}
