//! The loop around a kernel: what belongs to the whole of it and to none of its parts.

use nalgebra::Vector3;
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::base::swing::Swing;
use screed_kernel::base::{BaseConfig, BaseLimits, Drift};
use screed_kernel::closed_loop::{ClosedLoop, LoopReport};
use screed_kernel::control::{Bounds, Settings};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::drive::{Drive, Learning};
use screed_kernel::ekf::State;
use screed_kernel::estimator::{Estimator, EstimatorConfig, Robot, TrackerPose};
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, Configure, ModeCode, MotionLimits, ToKernel};
use screed_kernel::guard::{Motion, Periods, output_least};
use screed_kernel::pid::{ByProcess, Gains, Process};
use screed_kernel::pose::Pose;
use screed_kernel::tick::Kernel;
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel, Nanos};

const PERIOD: f64 = 0.002;
const ARM: Arm<6> = UR10E;
const AT: JointPos<6> = JointPos([0.1, -0.9, 1.2, -0.6, 0.8, 0.2]);
const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.05, velocity_max: 0.3, acceleration_max: 10.0 };
const TRANSLATION_MAX: f64 = 0.02;

struct World {
    kernel: Box<Kernel<6, 64>>,
    around: ClosedLoop<6, 8>,
    estimator: EstimatorConfig<6>,
    actual: JointPos<6>,
    now: Nanos,
}

impl World {
    fn new() -> Self {
        let estimator = estimator();
        let drive = Drive { lag: 0.02, inverse_gain: 1e-4 };
        let learning = Learning {
            lag: [0.0, 0.3],
            inverse_gain: [0.0, 0.01],
            dead_time: 0.0,
            filter_time: 0.05,
            velocity_min: 0.01,
            memory: 20.0,
            noise: 1e-4,
            adoption: 0.3,
        };
        let made = Estimator::new(&estimator).unwrap();
        let around = ClosedLoop::new(&ARM, Some(made), &settings(), &[drive; 6], &learning, PERIOD).unwrap();
        let mut world =
            Self { kernel: Box::new(Kernel::new(&ARM)), around, estimator, actual: AT, now: Nanos(1_000_000_000) };
        world.say(&ToKernel::Configure(configure()));
        world
    }

    fn say(&mut self, message: &ToKernel) {
        let mut out = [0; frame::WIRE_MAX];
        let used = frame::encode(message, &mut out).unwrap();
        assert_eq!(self.kernel.receive(&out[..used]), used);
    }

    /// So many ticks with the base shifted along x (m).
    fn ticks(&mut self, count: u32, shift: f64) -> LoopReport<6> {
        let mut last = None;
        for _ in 0..count {
            self.now = self.now.plus(2_000_000);
            let base = self.estimator.base.tracker_from_nominal * Pose::from_translation(shift, 0.0, 0.0);
            let pose = TrackerPose {
                at: self.now,
                tracker_from_target: base * ARM.forward(&self.actual) * self.estimator.base.flange_from_target,
                position_deviation: 25e-6,
                rotation_deviation: 1.7e-4,
            };
            let robot = Robot { actual: self.actual, rates: Some(JointVel::ZERO), ready: true };
            let (command, report) = self.around.tick(&mut self.kernel, self.now, &robot, &[pose]);
            self.actual = command.joints.unwrap_or(self.actual);
            last = Some(report);
        }
        last.unwrap()
    }
}

fn configure() -> Configure {
    let plan = Motion {
        velocity_max: JointVel([1.0; 6]),
        acceleration_max: JointAcc([10.0; 6]),
        jerk_max: JointJerk([500.0; 6]),
    };
    let output = output_least(&plan, Periods { sample: PERIOD, tick: PERIOD }, &CORRECTION);
    let all = |value: f64| [value; 6].into_iter().collect();
    Configure {
        sample_period_ns: 2_000_000,
        tick_period_ns: 2_000_000,
        position_min: all(-3.0),
        position_max: all(3.0),
        plan: MotionLimits::from(&plan),
        output: MotionLimits::from(&output),
        following_error_max: 0.05,
        deviation_max: 0.05,
        correction: CORRECTION,
        flange_from_tcp: [0.0; 6],
        workspace: heapless::Vec::new(),
    }
}

fn estimator() -> EstimatorConfig<6> {
    EstimatorConfig {
        base: BaseConfig {
            tracker_from_nominal: Pose::from_translation(3.0, -1.0, 0.5),
            flange_from_target: Pose::from_translation(0.0, 0.0, 0.1),
            pivot: Vector3::new(0.7, -0.2, 0.4),
            drift: Drift { speed: 3e-3, turn_rate: 2e-4, time: 2.0 },
            swing: Swing::NONE,
            hold: 0.5,
            agreeing: 5,
            limits: BaseLimits {
                translation_max: TRANSLATION_MAX,
                velocity_max: 0.05,
                acceleration_max: 0.5,
                rotation_max: 0.02,
                turn_rate_max: 0.05,
                turn_acceleration_max: 0.5,
            },
            period: PERIOD,
        },
        jerk_density: [1.0; 6],
        encoder_deviation: JointPos([1e-4; 6]),
        joint_deviation: JointPos([3e-4; 6]),
        rate_deviation: JointVel([0.1; 6]),
        start_deviation: State {
            position: JointPos([1e-2; 6]),
            velocity: JointVel([0.1; 6]),
            acceleration: JointAcc([1.0; 6]),
        },
        dead_time: 0.0,
    }
}

fn settings() -> Settings<6> {
    let bounds = Bounds {
        shift_max: 0.05,
        turn_max: 0.05,
        shift_speed_max: 0.05,
        shift_acceleration_max: 0.5,
        turn_speed_max: 0.05,
        turn_acceleration_max: 0.5,
        patience: 2.0,
    };
    let gains = [Gains::for_drive(&Drive { lag: 0.05, inverse_gain: 1e-3 }, 1.0, 0.02); 6];
    Settings {
        gains: ByProcess { deposit: gains, travel: gains, mill: gains },
        bounds: ByProcess { deposit: bounds, travel: bounds, mill: bounds },
        works: Process::Deposit,
        flange_from_tcp: Pose::identity(),
        dead_time: 0.0,
    }
}

#[test]
fn a_base_beyond_its_bound_is_a_fault_until_a_person_leaves_it_and_then_the_loop_goes_on() {
    let mut world = World::new();
    world.ticks(100, 0.001);
    assert_eq!(world.kernel.status().mode, ModeCode::Holding);
    let report = world.ticks(100, 1.5 * TRANSLATION_MAX);
    assert!(matches!(report.estimated, Some(Err(_))), "{report:?}");
    let status = world.kernel.status();
    assert_eq!(status.mode, ModeCode::Faulted);
    let fault = status.fault.unwrap();
    assert!(matches!(fault.fault, Fault::Correction { limit: TRANSLATION_MAX, .. }), "{fault:?}");
    // The base is back, and nobody has looked at it yet.
    let report = world.ticks(300, 0.001);
    assert!(matches!(report.estimated, Some(Err(_))), "{report:?}");
    world.say(&ToKernel::Rearm { fault: fault.number });
    let report = world.ticks(300, 0.001);
    assert!(matches!(report.estimated, Some(Ok(_))), "{report:?}");
    assert_eq!((world.kernel.status().mode, world.kernel.status().fault), (ModeCode::Holding, None));
}
