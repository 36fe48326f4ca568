//! The arm of the tape, and the only place that knows how its kernel is made.

use crate::motion::JOINTS;
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::frame::Configure;
use screed_kernel::tick::{Kernel, Sensors};
use screed_kernel::units::JointPos;

/// Setpoints that the ring holds.
pub const RING: usize = 4096;

/// The kernel that hears the tape.
pub type TapeKernel = Kernel<JOINTS, RING>;

/// Its arm.
pub const ARM: Arm<JOINTS> = UR10E;

/// Ticks and samples are so far apart (s).
pub const PERIOD: f64 = 0.002;

/// No joint may go farther to either side (rad).
pub const POSITION_MAX: f64 = 1.2;

/// No joint may be farther from its target (rad).
pub const FOLLOWING_MAX: f64 = 0.05;

/// A kernel that knows nothing yet.
pub fn kernel() -> TapeKernel {
    Kernel::new()
}

/// Limits that the tape's motions keep.
pub fn configure() -> Configure {
    let all = |value: f64| [value; JOINTS].into_iter().collect();
    Configure {
        period_ns: 2_000_000,
        position_min: all(-POSITION_MAX),
        position_max: all(POSITION_MAX),
        velocity_max: all(2.0),
        acceleration_max: all(20.0),
        jerk_max: all(2000.0),
        following_error_max: FOLLOWING_MAX,
    }
}

/// What the robot says.
pub fn sensors(actual: JointPos<JOINTS>, ready: bool) -> Sensors<JOINTS> {
    Sensors { actual, ready }
}
