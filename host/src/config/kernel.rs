//! What the kernel is told of a cell.

use super::Cell;
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::frame::{Configure, MotionLimits};
use screed_kernel::guard::{Motion, Periods, output_least};

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
        let correction = CorrectionLimits::NONE;
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
