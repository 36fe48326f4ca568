//! The arms of the courses, one of each way to solve the inverse kinematics, and what their kernels and loops are made for.

use super::Course;
use crate::inverse::{displaced, tilted};
use nalgebra::Vector3;
use screed_kernel::arm::Arm;
use screed_kernel::arms::comau::NJ130;
use screed_kernel::arms::crane::CRANE_NJ130;
use screed_kernel::arms::gantry::CONTOUR_CRAFTER;
use screed_kernel::arms::kuka::KR120_R2500;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::closed_loop::ClosedLoop;
use screed_kernel::control::{Bounds, Settings};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::drive::{Drive, Learning};
use screed_kernel::ekf::State;
use screed_kernel::estimator::{Estimator, EstimatorConfig};
use screed_kernel::frame::{Configure, MotionLimits};
use screed_kernel::guard::{Motion, Periods, Plane, output_least};
use screed_kernel::pid::{ByProcess, Gains, Process};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};

/// The arms by name, and how each is solved.
pub const ARMS: [&str; 8] = [
    "UR10e (closed form)",
    "NJ130 (wrist, parallelogram)",
    "KR 120 (wrist)",
    "UR10e, calibrated",
    "KR 120, calibrated",
    "no closed form (iteration)",
    "gantry, 4 joints",
    "crane with NJ130, 9 joints",
];

/// Ticks that an estimator remembers: so far back may a late pose reach.
pub const DEPTH: usize = 8;

/// Setpoints that a ring holds.
pub const RING: usize = 4096;

/// From tick to tick (ns).
pub const TICK_NS: u64 = 2_000_000;

/// From a command to its effect (s).
const DEAD_TIME: f64 = 4e-3;

/// What corrections may be.
const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.1, velocity_max: 0.5, acceleration_max: 10.0 };

/// An arm, and where its joint 3 stretches it while joint 2 is at zero.
pub(super) struct Stretched<const N: usize>(pub Arm<N>, pub f64);

/// An arm, whatever its count of joints.
// There is no heap, and one at a time.
#[allow(clippy::large_enum_variant)]
pub(super) enum AnyArm {
    Six(Stretched<6>),
    Four(Stretched<4>),
    Nine(Stretched<9>),
}

/// The arm of a course.
pub(super) fn arm(course: &Course) -> AnyArm {
    let kuka = -libm::atan2(0.041, 1.0);
    let comau = libm::atan2(-0.25, 1.10558);
    match course.arm() {
        0 => AnyArm::Six(Stretched(UR10E, 0.0)),
        1 => AnyArm::Six(Stretched(NJ130, comau)),
        2 => AnyArm::Six(Stretched(KR120_R2500, kuka)),
        3 => AnyArm::Six(Stretched(tilted(0.01), 0.0)),
        4 => AnyArm::Six(Stretched(displaced(&KR120_R2500, 0.001), kuka)),
        5 => AnyArm::Six(Stretched(displaced(&UR10E, 0.3), 0.0)),
        6 => AnyArm::Four(Stretched(CONTOUR_CRAFTER, 0.0)),
        _ => AnyArm::Nine(Stretched(CRANE_NJ130, comau)),
    }
}

/// Limits around a posture, for setpoints so many ticks apart, with the workspace bounded by every plane there can be.
pub(super) fn configure<const N: usize>(arm: &Arm<N>, around: &JointPos<N>, ticks: u64) -> Configure {
    let plan = Motion {
        velocity_max: JointVel([1.0; N]),
        acceleration_max: JointAcc([60.0; N]),
        jerk_max: JointJerk([60_000.0; N]),
    };
    let sample_period_ns = ticks * TICK_NS;
    let periods = Periods { sample: sample_period_ns as f64 * 1e-9, tick: TICK_NS as f64 * 1e-9 };
    let output = output_least(&plan, periods, &CORRECTION);
    let mut limits = [heapless(), heapless()];
    let [low, high] = &mut limits;
    for (position, (least, most)) in around.0.iter().zip(arm.position_min.0.iter().zip(&arm.position_max.0)) {
        let _ = low.push(f64::max(*least, position - 1.0));
        let _ = high.push(f64::min(*most, position + 1.0));
    }
    let [position_min, position_max] = limits;
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]];
    let planes = axes.iter().chain(&axes).map(|axis| Plane { normal_in_base: *axis, offset: 100.0 });
    Configure {
        sample_period_ns,
        tick_period_ns: TICK_NS,
        position_min,
        position_max,
        plan: MotionLimits::from(&plan),
        output: MotionLimits::from(&output),
        following_error_max: 0.05,
        deviation_max: 0.05,
        correction: CORRECTION,
        flange_from_tcp: [0.0, 0.0, 0.15, 0.0, 0.1, 0.0],
        workspace: planes.collect(),
    }
}

fn heapless() -> screed_kernel::frame::JointValues {
    screed_kernel::frame::JointValues::new()
}

/// What an estimator is made for.
pub(super) fn estimator<const N: usize>(pivot: Vector3<f64>) -> EstimatorConfig<N> {
    EstimatorConfig {
        base: screed_kernel::base::BaseConfig { pivot, ..crate::base::config(TICK_NS, 0.2) },
        jerk_density: [1.0; N],
        encoder_deviation: JointPos([1e-4; N]),
        joint_deviation: JointPos([3e-4; N]),
        rate_deviation: JointVel([1.0; N]),
        start_deviation: State {
            position: JointPos([1e-2; N]),
            velocity: JointVel([0.1; N]),
            acceleration: JointAcc([1.0; N]),
        },
        dead_time: DEAD_TIME,
    }
}

/// A loop, with a tracker or without; none only if a configuration were refused.
pub(super) fn around<const N: usize>(
    arm: &Arm<N>,
    config: &EstimatorConfig<N>,
    tracked: bool,
) -> Option<ClosedLoop<N, DEPTH>> {
    let drives = [Drive { lag: 0.02, inverse_gain: 1e-4 }; N];
    let estimator = if tracked { Some(Estimator::new(config).ok()?) } else { None };
    ClosedLoop::new(arm, estimator, &settings(), &drives, &learning(), config.base.period).ok()
}

fn settings<const N: usize>() -> Settings<N> {
    let bounds = Bounds {
        shift_max: 0.03,
        turn_max: 0.02,
        shift_speed_max: 0.01,
        shift_acceleration_max: 0.1,
        turn_speed_max: 0.01,
        turn_acceleration_max: 0.1,
        patience: 1.0,
    };
    let gains = |crossover| [Gains::for_drive(&Drive { lag: 0.05, inverse_gain: 1e-3 }, crossover, 0.02); N];
    Settings {
        gains: ByProcess { deposit: gains(1.0), travel: gains(0.5), mill: gains(2.0) },
        bounds: ByProcess { deposit: bounds, travel: bounds, mill: bounds },
        works: Process::Deposit,
        flange_from_tcp: Pose::from_rotation_vector(Vector3::new(0.0, 0.0, 0.15), Vector3::new(0.0, 0.1, 0.0)),
        dead_time: DEAD_TIME,
    }
}

const fn learning() -> Learning {
    Learning {
        lag: [0.0, 0.3],
        inverse_gain: [0.0, 0.01],
        dead_time: DEAD_TIME,
        filter_time: 0.05,
        velocity_min: 0.01,
        memory: 20.0,
        noise: 1e-4,
        adoption: 0.3,
    }
}
