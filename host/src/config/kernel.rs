//! What the kernel is told of a cell.

use super::Cell;
use screed_kernel::closed_loop::{ClosedLoop, LoopError};
use screed_kernel::control::{Bounds, Settings};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::drive::{Drive, Learning};
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

/// What may be learnt of a servo: as far as `servoj` goes, a dead time that has not been named, and some more (s, s²).
const LAG: [f64; 2] = [0.01, 0.4];
const INVERSE_GAIN: [f64; 2] = [1.0 / 4000.0, 1.0 / 40.0];

impl Cell {
    /// The loop that compensates the servo's lag, if the cell wants it: it begins with the look-ahead and gain that are set.
    ///
    /// # Errors
    /// [`LoopError`]
    pub fn closed_loop(&self) -> Result<Option<ClosedLoop<6, 2>>, LoopError> {
        let Some(lead) = self.lead else { return Ok(None) };
        let period = 1.0 / f64::from(self.link.rate_hz);
        let drive = Drive { lag: self.link.servoj_lookahead, inverse_gain: 1.0 / self.link.servoj_gain };
        let learning = Learning {
            lag: LAG,
            inverse_gain: INVERSE_GAIN,
            dead_time: lead.dead_time,
            filter_time: 0.05,
            velocity_min: 0.002,
            memory: 30.0,
            noise: 2e-5,
            adoption: 0.5,
        };
        // Without a tracker there is nothing to feed back: bounds that are never reached.
        let bounds = Bounds {
            shift_max: 1.0,
            turn_max: 1.0,
            shift_speed_max: 1.0,
            shift_acceleration_max: 1.0,
            turn_speed_max: 1.0,
            turn_acceleration_max: 1.0,
            patience: 1.0,
        };
        let same = |value| ByProcess { deposit: value, travel: value, mill: value };
        let settings = Settings {
            gains: ByProcess { deposit: [Gains::NONE; 6], travel: [Gains::NONE; 6], mill: [Gains::NONE; 6] },
            bounds: same(bounds),
            works: Process::Deposit,
            flange_from_tcp: self.tool.flange_from_tcp,
            dead_time: lead.dead_time,
        };
        ClosedLoop::new(&self.robot.arm, None, &settings, &[drive; 6], &learning, period).map(Some)
    }
}
