//! What the kernel is told of a cell.

use super::{Cell, Lead};
use screed_kernel::closed_loop::{ClosedLoop, LoopError};
use screed_kernel::control::{Bounds, Settings};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::estimator::{Estimator, EstimatorError};
use screed_kernel::frame::{Configure, MotionLimits};
use screed_kernel::guard::{Motion, Periods, output_least};
use screed_kernel::pid::{ByProcess, Gains, Process};

impl Cell {
    /// The kernel's configuration: the cell's limits for setpoints, and for what leaves the kernel as much more as path
    /// clock and interpolation need.
    pub fn configure(&self) -> Configure {
        let list = |values: &[f64; 6]| values.iter().copied().collect();
        let (robot, tool) = (&self.robot, &self.tool.flange_from_tcp);
        let plan = Motion {
            velocity_max: robot.joint_velocity_max,
            acceleration_max: robot.joint_acceleration_max,
            jerk_max: robot.joint_jerk_max,
        };
        let period_ns = 1_000_000_000 / u64::from(self.link.rate_hz);
        let period = period_ns as f64 * 1e-9;
        let correction = self.lead.map_or(CorrectionLimits::NONE, |lead| lead.limits);
        let output = output_least(&plan, Periods { sample: period, tick: period }, &correction);
        let (shift, turn) = (tool.translation, tool.rotation_vector());
        Configure {
            sample_period_ns: period_ns,
            tick_period_ns: period_ns,
            position_min: list(&robot.arm.position_min.0),
            position_max: list(&robot.arm.position_max.0),
            plan: MotionLimits::from(&plan),
            output: MotionLimits::from(&output),
            following_error_max: robot.following_error_max,
            deviation_max: robot.deviation_max,
            correction,
            flange_from_tcp: [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z],
            workspace: self.workspace.iter().map(|bound| bound.plane).collect(),
        }
    }
}

/// Ticks that the estimator remembers: a tracker's poses may come so late.
pub const DEPTH: usize = 16;

/// Why a cell's loop cannot be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CellLoopError {
    /// Of the estimator.
    Estimator(EstimatorError),
    /// Of the loop.
    Loop(LoopError),
}

impl Cell {
    /// The loop that leads and corrects, if the cell wants one: without a tracker it compensates the servo's lag alone.
    ///
    /// # Errors
    /// [`CellLoopError`]
    pub fn closed_loop(&self) -> Result<Option<ClosedLoop<6, DEPTH>>, CellLoopError> {
        let Some(lead) = self.lead else { return Ok(None) };
        let period = 1.0 / f64::from(self.link.rate_hz);
        let estimator = self.tracked.map(|tracked| Estimator::new(&tracked.estimator)).transpose();
        let estimator = estimator.map_err(CellLoopError::Estimator)?;
        let settings = self.tracked.map_or_else(|| self.lead_alone(&lead), |tracked| tracked.settings);
        let Lead { drive, learning, .. } = lead;
        let made = ClosedLoop::new(&self.robot.arm, estimator, &settings, &[drive; 6], &learning, period);
        made.map(Some).map_err(CellLoopError::Loop)
    }

    /// Without a tracker there is nothing to feed back: bounds at the tool that are never reached.
    fn lead_alone(&self, lead: &Lead) -> Settings<6> {
        let bounds = Bounds {
            shift_max: 1.0,
            turn_max: 1.0,
            shift_speed_max: 1.0,
            shift_acceleration_max: 1.0,
            turn_speed_max: 1.0,
            turn_acceleration_max: 1.0,
            patience: lead.patience,
        };
        let same = |value| ByProcess { deposit: value, travel: value, mill: value };
        Settings {
            gains: ByProcess { deposit: [Gains::NONE; 6], travel: [Gains::NONE; 6], mill: [Gains::NONE; 6] },
            bounds: same(bounds),
            works: Process::Deposit,
            flange_from_tcp: self.tool.flange_from_tcp,
            dead_time: lead.learning.dead_time,
        }
    }
}
