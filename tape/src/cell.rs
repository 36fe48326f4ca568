//! The arm of the tape, and the only place that knows how its kernel is made, configured and called.

use crate::motion::JOINTS;
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::frame::{Configure, MotionLimits};
use screed_kernel::guard::{Limits, Motion, Periods, Plane, output_least, plan_limits};
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel, Nanos};

/// Setpoints that the ring holds.
pub const RING: usize = 4096;

/// The kernel that hears the tape.
pub type TapeKernel = Kernel<JOINTS, RING>;

/// Its arm.
pub const ARM: Arm<JOINTS> = UR10E;

/// From tick to tick (ns).
pub const TICK_NS: u64 = 2_000_000;

/// From setpoint to setpoint (ns): what the tape's configurations choose from.
pub const SAMPLES_NS: [u64; 3] = [TICK_NS, 2 * TICK_NS, 4 * TICK_NS];

/// No joint may go farther to either side (rad).
pub const POSITION_MAX: f64 = 1.2;

/// No actual joint may be farther from its target (rad).
pub const FOLLOWING_MAX: f64 = 0.05;

/// No estimated joint may be farther from its target (rad).
pub const DEVIATION_MAX: f64 = 0.04;

/// What corrections may be.
pub const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.01, velocity_max: 0.02, acceleration_max: 0.2 };

/// What the tape's motions keep.
const PLAN: Motion<JOINTS> = Motion {
    velocity_max: JointVel([2.0; JOINTS]),
    acceleration_max: JointAcc([20.0; JOINTS]),
    jerk_max: JointJerk([2000.0; JOINTS]),
};

/// The arm must not reach far back and not far down.
const PLANES: [Plane; 2] =
    [Plane { normal_in_base: [1.0, 0.0, 0.0], offset: 1.1 }, Plane { normal_in_base: [0.0, 0.0, -1.0], offset: 0.7 }];

/// A kernel that knows nothing yet.
pub const fn kernel() -> TapeKernel {
    Kernel::new(&ARM)
}

/// One cycle.
pub fn tick(kernel: &mut TapeKernel, now: Nanos, sensors: &Sensors<JOINTS>) -> Command<JOINTS> {
    kernel.tick(now, sensors)
}

/// What a robot says that has nothing but encoders.
pub const fn sensors(actual: JointPos<JOINTS>, ready: bool) -> Sensors<JOINTS> {
    Sensors { actual, estimate: None, correction: None, ready }
}

/// Limits that the tape's motions keep, for setpoints so far apart.
pub fn configure(sample_ns: u64) -> Configure {
    let all = |value: f64| [value; JOINTS].into_iter().collect();
    Configure {
        sample_period_ns: sample_ns,
        tick_period_ns: TICK_NS,
        position_min: all(-POSITION_MAX),
        position_max: all(POSITION_MAX),
        plan: MotionLimits::from(&PLAN),
        output: MotionLimits::from(&output(sample_ns)),
        following_error_max: FOLLOWING_MAX,
        deviation_max: DEVIATION_MAX,
        correction: CORRECTION,
        flange_from_tcp: [0.0, 0.0, 0.15, 0.0, 0.0, 0.0],
        workspace: PLANES.into_iter().collect(),
    }
}

/// The highest position that a setpoint may have (rad).
pub fn highest(sample_ns: u64) -> f64 {
    let position = JointPos([POSITION_MAX; JOINTS]);
    let limits = Limits { position_min: position, position_max: position, motion: output(sample_ns) };
    let [highest, ..] = plan_limits(&limits, &PLAN, periods(sample_ns), &CORRECTION).position_max.0;
    highest
}

fn output(sample_ns: u64) -> Motion<JOINTS> {
    output_least(&PLAN, periods(sample_ns), &CORRECTION)
}

fn periods(sample_ns: u64) -> Periods {
    Periods { sample: sample_ns as f64 * 1e-9, tick: TICK_NS as f64 * 1e-9 }
}
