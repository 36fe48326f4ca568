//! What the kernel will say of setpoints, said before anything moves: its own gate, with its own limits.

use super::error::PlanError;
use super::stream::Setpoint;
use crate::config::Cell;
use screed_kernel::arm::Arm;
use screed_kernel::config::Config;
use screed_kernel::guard::{Differences, Violation};
use screed_kernel::units::JointPos;
use std::sync::Arc;

/// Follows setpoints and judges each against the ones before.
#[derive(Clone, Debug)]
pub struct JointCheck {
    arm: Arm<6>,
    config: Arc<Config<6>>,
    differences: Differences<6>,
}

impl JointCheck {
    /// At rest at `start`.
    ///
    /// # Errors
    /// [`PlanError::Refused`] when the kernel would not take the cell's limits.
    pub fn new(cell: &Cell, start: &JointPos<6>) -> Result<Self, PlanError> {
        let arm = cell.robot.arm;
        let config = Config::new(&cell.configure(), &arm).map_err(PlanError::Refused)?;
        Ok(Self { arm, config: Arc::new(config), differences: Differences::at_rest(*start) })
    }

    /// The next setpoint.
    ///
    /// # Errors
    /// The first limit that it breaks.
    pub fn follow(&mut self, setpoint: &Setpoint) -> Result<(), Violation> {
        self.differences.push(&setpoint.joints, &self.config.plan, self.config.periods.sample)?;
        self.config.workspace.check(&self.arm, &setpoint.joints)
    }
}
