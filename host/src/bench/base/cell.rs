//! What a plant is controlled with: the same for every plant of a kind, but for what a cell's registration and a test of the
//! link would have found (where base, target and tool are, dead time, sensors' noise), and what [`super::commission`] finds.

use super::commission::Commissioned;
use crate::sim::plant::{Kind, Params, ROTATION_DEVIATION, position_deviation};
use nalgebra::Vector3;
use screed_kernel::base::{BaseConfig, BaseLimits, Drift};
use screed_kernel::closed_loop::{ClosedLoop, LoopError};
use screed_kernel::control::{Bounds, Settings};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::drive::{Drive, Learning};
use screed_kernel::ekf::State;
use screed_kernel::estimator::{Estimator, EstimatorConfig, EstimatorError, TrackerPose};
use screed_kernel::frame::{Configure, MotionLimits};
use screed_kernel::guard::{Motion, Periods, output_least};
use screed_kernel::pid::{ByProcess, Gains, Process};
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};

/// Ticks that estimator and encoders' history remember: 16 ms, four times the tracker's greatest latency.
pub const DEPTH: usize = 8;

/// How far and how fast corrections and leads may go (rad): 250 mm/s on a UR10e with a lag of 0.13 s is 0.05 rad.
pub const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.15, velocity_max: 1.0, acceleration_max: 20.0 };

/// Bounds of corrections at the tool.
pub const BOUNDS: Bounds = Bounds {
    shift_max: 0.05,
    turn_max: 0.02,
    shift_speed_max: 0.02,
    shift_acceleration_max: 0.1,
    turn_speed_max: 0.02,
    turn_acceleration_max: 0.1,
    patience: 2.0,
};

/// What is different for the kinds. A crane swings at 1.5 to 6 Hz with little damping, and feedback that moves the arm moves the crane:
/// there it has to be slow.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tuning {
    /// Where the loop crosses 1 (rad/s): deposit, travel, mill.
    crossover: [f64; 3],
    /// The same as the filter takes it.
    encoder_deviation: f64,
    /// Density of the joints' jerk beside the commanded (rad²/s⁵).
    jerk_density: f64,
    /// How long the base moves one way (s).
    drift_time: f64,
    /// How far it swings: shift (m), turn (rad).
    swing: [f64; 2],
}

const fn tuning(kind: Kind) -> Tuning {
    match kind {
        Kind::Nj130 => Tuning {
            crossover: [0.1, 0.05, 0.1],
            encoder_deviation: 1e-4,
            jerk_density: 0.1,
            drift_time: 2.5,
            swing: [5e-5, 2e-4],
        },
        Kind::Ur10e => Tuning {
            crossover: [1.0, 0.5, 1.0],
            encoder_deviation: 3e-4,
            jerk_density: 1.0,
            drift_time: 1.0,
            swing: [5e-5, 1e-4],
        },
    }
}

/// How much more the wrist's links do beside their encoders.
const SOFTNESS: [f64; 6] = [1.0, 1.0, 1.0, 3.0, 3.0, 3.0];

/// Time constant of the filter of the loop (s).
const FILTER: f64 = 0.02;

/// The loop of one kind of plant, or of one plant.
pub type Loop = ClosedLoop<6, DEPTH>;

/// The drive that is assumed of a kind: the middle of its range.
pub const fn assumed(kind: Kind) -> Drive {
    match kind {
        Kind::Nj130 => Drive { lag: 0.0275, inverse_gain: 1.0 / 4450.0 },
        Kind::Ur10e => Drive { lag: 0.1, inverse_gain: 1.0 / 300.0 },
    }
}

/// Which kind a seed's plant is of.
pub const fn kind(seed: u64) -> Kind {
    if seed.is_multiple_of(2) { Kind::Nj130 } else { Kind::Ur10e }
}

/// How far a kind's base swings, as its estimate takes it: shift (m) and turn (rad).
pub const fn swing_deviations(kind: Kind) -> [f64; 2] {
    tuning(kind).swing
}

/// The gains of all joints, by process.
pub fn gains(kind: Kind) -> ByProcess<[Gains; 6]> {
    let [deposit, travel, mill] =
        tuning(kind).crossover.map(|crossover| [Gains::for_drive(&assumed(kind), crossover, FILTER); 6]);
    ByProcess { deposit, travel, mill }
}

/// What a plant's estimator knows.
pub fn estimator(kind: Kind, params: &Params, found: &Commissioned) -> EstimatorConfig<6> {
    let tuning = tuning(kind);
    let pivot = (params.arm.forward(&params.start) * params.flange_from_tcp).translation;
    EstimatorConfig {
        base: BaseConfig {
            tracker_from_nominal: params.tracker_from_nominal,
            flange_from_target: params.flange_from_target,
            pivot,
            drift: Drift { speed: 3e-3, turn_rate: 2e-4, time: tuning.drift_time },
            swing: found.swing,
            hold: 0.5,
            agreeing: 20,
            limits: BaseLimits {
                translation_max: 0.05,
                velocity_max: 0.1,
                acceleration_max: 1.0,
                rotation_max: 0.02,
                turn_rate_max: 0.02,
                turn_acceleration_max: 1.0,
            },
            period: params.period_ns as f64 * 1e-9,
        },
        jerk_density: [tuning.jerk_density; 6],
        encoder_deviation: JointPos([tuning.encoder_deviation; 6]),
        joint_deviation: JointPos(SOFTNESS.map(|softer| softer * found.joint_deviation)),
        rate_deviation: JointVel([2e-3; 6]),
        start_deviation: State {
            position: JointPos([1e-2; 6]),
            velocity: JointVel([0.1; 6]),
            acceleration: JointAcc([1.0; 6]),
        },
        dead_time: params.dead_time_ns as f64 * 1e-9,
    }
}

/// Why a plant cannot be controlled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CellError {
    /// The estimator.
    Estimator(EstimatorError),
    /// The loop.
    Loop(LoopError),
}

/// The loop of a plant; without a tracker only the lead is left of it.
///
/// # Errors
/// [`CellError`]
pub fn closed_loop(kind: Kind, params: &Params, tracked: Option<&Commissioned>) -> Result<Loop, CellError> {
    let period = params.period_ns as f64 * 1e-9;
    let dead_time = params.dead_time_ns as f64 * 1e-9;
    let estimator = tracked
        .map(|found| Estimator::new(&estimator(kind, params, found)))
        .transpose()
        .map_err(CellError::Estimator)?;
    let settings = Settings {
        gains: gains(kind),
        bounds: ByProcess { deposit: BOUNDS, travel: BOUNDS, mill: BOUNDS },
        works: Process::Deposit,
        flange_from_tcp: params.flange_from_tcp,
        dead_time,
    };
    let learning = Learning {
        lag: [0.005, 0.3],
        inverse_gain: [1.0 / 10_000.0, 1.0 / 100.0],
        dead_time,
        filter_time: 0.05,
        velocity_min: 0.002,
        memory: 30.0,
        noise: 2e-5,
        adoption: 0.3,
    };
    ClosedLoop::new(params.arm, estimator, &settings, &[assumed(kind); 6], &learning, period).map_err(CellError::Loop)
}

/// The kernel's configuration for a plant.
pub fn configure(params: &Params) -> Configure {
    let arm = params.arm;
    let rated = arm.velocity_max.known().unwrap_or(JointVel([1.0; 6]));
    let plan = Motion {
        velocity_max: JointVel(rated.0.map(|speed| 0.5 * speed)),
        acceleration_max: JointAcc([10.0; 6]),
        jerk_max: JointJerk([500.0; 6]),
    };
    let period = params.period_ns as f64 * 1e-9;
    let output = output_least(&plan, Periods { sample: period, tick: period }, &CORRECTION);
    let list = |values: &[f64; 6]| values.iter().copied().collect();
    let tool = params.flange_from_tcp;
    let (shift, turn): (Vector3<f64>, _) = (tool.translation, tool.rotation_vector());
    Configure {
        sample_period_ns: params.period_ns,
        tick_period_ns: params.period_ns,
        position_min: list(&arm.position_min.0),
        position_max: list(&arm.position_max.0),
        plan: MotionLimits::from(&plan),
        output: MotionLimits::from(&output),
        following_error_max: 0.3,
        deviation_max: 0.3,
        correction: CORRECTION,
        flange_from_tcp: [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z],
        workspace: heapless::Vec::new(),
    }
}

/// A tracker's pose with the deviations of its table.
pub fn pose(tracked: &crate::sim::plant::Tracked) -> TrackerPose {
    TrackerPose {
        at: tracked.at,
        tracker_from_target: tracked.tracker_from_target,
        position_deviation: position_deviation(tracked.tracker_from_target.translation.norm()),
        rotation_deviation: ROTATION_DEVIATION,
    }
}
