//! The loop around a kernel: what belongs to the whole of it and to none of its parts.

mod common;

use common::fuzz::envelope;
use nalgebra::Vector3;
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::base::swing::Swing;
use screed_kernel::base::{BaseConfig, BaseLimits, Drift};
use screed_kernel::closed_loop::{ClosedLoop, LoopReport};
use screed_kernel::control::{Bound, Bounds, ControlError, Settings};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::drive::{Drive, Learning};
use screed_kernel::ekf::State;
use screed_kernel::estimator::{Estimator, EstimatorConfig, Robot, TrackerPose};
use screed_kernel::fault::{Fault, Unreached};
use screed_kernel::frame::{
    self, BatchPart, CODE_MAX, Configure, FromKernel, LoopRecord, ModeCode, MotionLimits, ToKernel,
};
use screed_kernel::guard::{Motion, Periods, Quantity, output_least};
use screed_kernel::ik::IkError;
use screed_kernel::pid::{ByProcess, Gains, Process};
use screed_kernel::pose::Pose;
use screed_kernel::setpoint::{Coder, Setpoint, joint_on_grid};
use screed_kernel::tick::{Command, Kernel, STATUS_INTERVAL, TRANSMIT_MAX};
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel, Nanos};

const PERIOD: f64 = 0.002;
const ARM: Arm<6> = UR10E;
const AT: JointPos<6> = JointPos([0.1, -0.9, 1.2, -0.6, 0.8, 0.2]);
const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.05, velocity_max: 0.3, acceleration_max: 10.0 };
const TRANSLATION_MAX: f64 = 0.02;

/// All that a loop and its kernel are made of.
struct Parts {
    estimator: EstimatorConfig<6>,
    settings: Settings<6>,
    drive: Drive,
    learning: Learning,
    configure: Configure,
}

struct World {
    kernel: Box<Kernel<6, 4096>>,
    around: ClosedLoop<6, 8>,
    estimator: EstimatorConfig<6>,
    actual: JointPos<6>,
    now: Nanos,
    /// Whether the tracker sees its target.
    tracked: bool,
    reader: frame::Reader,
    heard: Vec<FromKernel>,
}

impl World {
    fn new() -> Self {
        Self::with(|_| {})
    }

    fn with(change: impl FnOnce(&mut Parts)) -> Self {
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
        let drive = Drive { lag: 0.02, inverse_gain: 1e-4 };
        let mut parts = Parts { estimator: estimator(), settings: settings(), drive, learning, configure: configure() };
        change(&mut parts);
        let Parts { estimator, settings, drive, learning, configure } = parts;
        let made = Estimator::new(&estimator).unwrap();
        let around = ClosedLoop::new(&ARM, Some(made), &settings, &[drive; 6], &learning, PERIOD).unwrap();
        let mut world = Self {
            kernel: Box::new(Kernel::new(&ARM)),
            around,
            estimator,
            actual: AT,
            now: Nanos(1_000_000_000),
            tracked: true,
            reader: frame::Reader::new(),
            heard: Vec::new(),
        };
        world.say(&ToKernel::Configure(configure));
        world
    }

    fn say(&mut self, message: &ToKernel) {
        let mut out = [0; frame::WIRE_MAX];
        let used = frame::encode(message, &mut out).unwrap();
        assert_eq!(self.kernel.receive(&out[..used]), used);
    }

    /// One tick with the base shifted along x (m).
    fn tick(&mut self, shift: f64) -> (Command<6>, LoopReport<6>) {
        self.now = self.now.plus(2_000_000);
        let base = self.estimator.base.tracker_from_nominal * Pose::from_translation(shift, 0.0, 0.0);
        let pose = TrackerPose {
            at: self.now,
            tracker_from_target: base * ARM.forward(&self.actual) * self.estimator.base.flange_from_target,
            position_deviation: 25e-6,
            rotation_deviation: 1.7e-4,
        };
        let robot = Robot { actual: self.actual, rates: Some(JointVel::ZERO), ready: true };
        let poses = if self.tracked { &[pose][..] } else { &[] };
        let (command, report) = self.around.tick(&mut self.kernel, self.now, &robot, poses);
        self.actual = command.joints.unwrap_or(self.actual);
        let mut out = [0; TRANSMIT_MAX];
        let used = self.kernel.poll_transmit(&mut out);
        for &byte in &out[..used] {
            if let Some(message) = self.reader.push(byte) {
                self.heard.push(frame::decode(message.unwrap()).unwrap());
            }
        }
        (command, report)
    }

    fn ticks(&mut self, count: u32, shift: f64) -> LoopReport<6> {
        (0..count).map(|_| self.tick(shift).1).last().unwrap()
    }

    /// Lays material along a way of 0.3 rad of the first joint, in so many seconds; about 0.8 m from the base.
    fn print(&mut self, seconds: f64) {
        let count = (seconds / PERIOD) as usize;
        let at = self.actual;
        let setpoints = (1..=count + 3).map(|k| {
            let u = (k as f64 / count as f64).min(1.0);
            let mut joints = at.0;
            joints[0] += 0.3 * u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
            Setpoint { joints: JointPos(joints.map(joint_on_grid)), flow: 0.0, deposit: true }
        });
        let (mut coder, mut first_seq) = (Coder::new(), 1);
        let setpoints: Vec<_> = setpoints.collect();
        let parts: Vec<_> = setpoints.chunks(20).collect();
        for (index, part) in parts.iter().enumerate() {
            let (mut code, mut used) = ([0; CODE_MAX], 0);
            for setpoint in *part {
                used += coder.encode(setpoint, &mut code[used..]).unwrap();
            }
            let (opens, commits) = (index == 0, index + 1 == parts.len());
            self.say(&ToKernel::Batch(BatchPart {
                batch: 1,
                first_seq,
                opens,
                commits,
                after: None,
                code: &code[..used],
            }));
            first_seq += part.len() as u32;
            self.tick(0.0);
        }
        assert!(self.heard.contains(&FromKernel::Accepted { batch: 1 }), "{:?}", self.heard.last());
    }

    fn resume(&mut self) {
        let epoch = self.kernel.status().epoch;
        self.say(&ToKernel::Resume { epoch });
    }

    /// The first fault that was told.
    fn fault(&self) -> Option<Fault> {
        self.heard.iter().find_map(|message| match message {
            FromKernel::Fault(report) => Some(report.fault),
            _ => None,
        })
    }

    fn loops(&self) -> Vec<&LoopRecord> {
        let records = self.heard.iter().filter_map(|message| match message {
            FromKernel::Loop(record) => Some(record),
            _ => None,
        });
        records.collect()
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
    assert!(matches!(fault.fault, Fault::Base { axis: 0, limit: TRANSLATION_MAX, .. }), "{fault:?}");
    // The base is back, and nobody has looked at it yet.
    let report = world.ticks(300, 0.001);
    assert!(matches!(report.estimated, Some(Err(_))), "{report:?}");
    world.say(&ToKernel::Rearm { fault: fault.number });
    let report = world.ticks(300, 0.001);
    assert!(matches!(report.estimated, Some(Ok(_))), "{report:?}");
    assert_eq!((world.kernel.status().mode, world.kernel.status().fault), (ModeCode::Holding, None));
}

#[test]
fn a_fault_that_is_left_while_the_robots_link_is_gone_is_left_for_the_loop_too() {
    let mut world = World::new();
    world.ticks(100, 0.001);
    world.ticks(100, 1.5 * TRANSLATION_MAX);
    let fault = world.kernel.status().fault.unwrap();
    world.ticks(300, 0.001);
    world.around.robot_lost(&mut world.kernel, Fault::Link);
    assert_eq!(world.kernel.status().fault, Some(fault), "the first is kept");
    let mut bytes = [0; frame::WIRE_MAX];
    let used = frame::encode(&ToKernel::Rearm { fault: fault.number }, &mut bytes).unwrap();
    assert_eq!(world.kernel.receive(&bytes[..used]), used);
    world.around.robot_lost(&mut world.kernel, Fault::Link);
    assert_eq!((world.kernel.status().mode, world.kernel.status().fault), (ModeCode::Unready, None));
    let report = world.ticks(300, 0.001);
    assert!(matches!(report.estimated, Some(Ok(_))), "{report:?}");
    assert_eq!(world.kernel.status().mode, ModeCode::Holding);
}

/// A tick of a print.
struct Printed {
    /// Path clock rate.
    rate: f64,
    /// How fast the path goes (m/s), and how far the tool is from it (m).
    speed: f64,
    miss: f64,
}

/// A path that is slower (m/s) lays nothing to speak of: its cruise is at 100 mm/s.
const SLOW: f64 = 1e-3;

/// Where the base is shifted by 5 mm. `dark` are the ticks in which the beam is broken.
fn printed(hold: f64, dark: std::ops::Range<u32>) -> (Vec<Printed>, World) {
    const SHIFT: f64 = 0.005;
    // This world has no drives that lag, but for the tick from a command to where the arm then is.
    let mut world = World::with(|parts| {
        parts.estimator.base.hold = hold;
        (parts.drive, parts.learning.dead_time) = (Drive::RIGID, PERIOD);
    });
    world.ticks(300, SHIFT);
    // While the frames come in the base is where it should be, and then it is shifted again.
    world.print(6.0);
    world.ticks(800, SHIFT);
    world.resume();
    let (mut seen, mut before) = (Vec::new(), ARM.forward(&AT).translation);
    for tick in 0..7000 {
        world.tracked = !dark.contains(&tick);
        let (command, _) = world.tick(SHIFT);
        let tool = Pose::from_translation(SHIFT, 0.0, 0.0) * ARM.forward(&world.actual);
        let path = ARM.forward(&command.path).translation;
        let (speed, miss) = ((path - before).norm() / PERIOD, (tool.translation - path).norm());
        seen.push(Printed { rate: command.rate, speed, miss });
        before = path;
        if world.kernel.status().mode != ModeCode::Moving {
            break;
        }
    }
    (seen, world)
}

#[test]
fn nothing_is_laid_down_until_the_correction_is_there_and_after_a_break_until_it_is_back() {
    // A break of 3.4 s, longer than the hold of 2 s.
    let (seen, world) = printed(2.0, 1500..3200);
    assert_eq!((world.fault(), world.kernel.status().mode), (None, ModeCode::Holding));
    let most = seen.iter().filter(|tick| tick.speed > SLOW).fold(0.0_f64, |most, tick| most.max(tick.miss));
    assert!(most < 0.5e-3, "{most}");
    // It stood for as long as the base was not known, and then played to the end.
    let stood = seen.iter().skip(1500).filter(|tick| tick.rate == 0.0).count();
    assert!((650..1000).contains(&stood), "{stood}");
    let out = seen.iter().skip(1500).fold(0.0_f64, |most, tick| most.max(tick.miss));
    assert!(out > 4.5e-3, "the correction was ramped out meanwhile: {out}");
    let waits: Vec<_> = world.loops().iter().map(|record| record.waits).collect();
    let changes = waits.windows(2).filter(|pair| pair[0] != pair[1]).count();
    // At the start, and at the break.
    assert_eq!(changes, 4, "{waits:?}");
}

#[test]
fn with_a_short_hold_it_waits_all_the_same_and_goes_on_within_its_bound() {
    let (seen, world) = printed(0.5, 1500..2100);
    assert_eq!((world.fault(), world.kernel.status().mode), (None, ModeCode::Holding));
    // Behind the break: as soon as the clock has come to rest.
    let behind = &seen[2100..];
    let rest = behind.iter().position(|tick| tick.rate == 0.0).unwrap();
    let moving = behind[rest..].iter().filter(|tick| tick.speed > SLOW);
    let most = moving.fold(0.0_f64, |most, tick| most.max(tick.miss));
    assert!(most < 0.5e-3, "{most}");
}

#[test]
fn a_tracker_that_stays_lost_is_a_fault_of_its_own() {
    let (_, world) = printed(0.5, 1500..u32::MAX);
    assert!(matches!(world.fault(), Some(Fault::Tracker { limit: 2.0, .. })), "{:?}", world.fault());
    let last = world.loops().last().and_then(|record| record.base);
    assert!(last.is_some_and(|base| base.age.is_none()), "{last:?}");
}

/// Prints for 8 s on a base that is where it should be; the fault that ends it.
fn fault_of(change: impl FnOnce(&mut Parts), shift: f64) -> Option<Fault> {
    let mut world = World::with(change);
    world.ticks(300, 0.0);
    world.print(7.0);
    world.ticks(10, 0.0);
    world.resume();
    for _ in 0..5000 {
        world.tick(shift);
    }
    world.fault()
}

#[test]
fn each_thing_that_can_be_wrong_with_the_loop_has_a_fault_of_its_own() {
    assert_eq!(fault_of(|_| {}, 0.004), None);
    let narrow = |parts: &mut Parts| parts.settings.bounds.deposit.shift_max = 0.003;
    let fault = fault_of(narrow, 0.004);
    assert!(matches!(fault, Some(Fault::Saturated { bound: Bound::Shift, limit: 0.003, .. })), "{fault:?}");
    let fault = fault_of(|_| {}, 1.2 * TRANSLATION_MAX);
    assert!(matches!(fault, Some(Fault::Base { axis: 0, limit: TRANSLATION_MAX, .. })), "{fault:?}");
    // The robot of this world does not lag, so a lag of 80 ms at least is not its own.
    let lagging = |parts: &mut Parts, memory, size_max| {
        (parts.learning.lag, parts.learning.memory) = ([0.08, 0.2], memory);
        parts.drive.lag = 0.1;
        parts.configure.correction.size_max = size_max;
    };
    let fault = fault_of(|parts| lagging(parts, 1.0, 0.05), 0.0);
    assert!(matches!(fault, Some(Fault::Drive { joint: 0, value, limit: 0.08 }) if value < 0.01), "{fault:?}");
    let fault = fault_of(|parts| lagging(parts, 60.0, 0.0005), 0.0);
    assert!(matches!(fault, Some(Fault::Lead { joint: 0, value, .. }) if value > 1e-3), "{fault:?}");
    let out = Fault::from(ControlError::Unreachable(IkError::OutOfReach { by: 0.25 }));
    assert_eq!(out, Fault::Unreachable { reason: Unreached::Reach, value: 0.25 });
}

#[test]
fn the_loop_tells_of_itself_regularly_and_when_something_changes() {
    let mut world = World::new();
    world.ticks(400, 0.001);
    let loops = world.loops();
    let (first, last) = (loops[0], loops[loops.len() - 1]);
    assert!(first.base.is_some_and(|base| base.age.is_none() && base.taken == 0), "{first:?}");
    let base = last.base.unwrap();
    assert!(base.age == Some(0.0) && base.taken > 350 && base.nis.is_some_and(|nis| nis < 1.0), "{base:?}");
    assert!((base.displacement[0] - 0.001).abs() < 1e-5 && base.behind[0] < 1e-5, "{base:?}");
    assert_eq!((last.lag.as_slice(), last.inverse_gain.as_slice()), (&[0.02; 6][..], &[1e-4; 6][..]));
    for pair in loops.windows(2) {
        let changed = pair[0].base.map(|base| base.age.is_some()) != pair[1].base.map(|base| base.age.is_some());
        assert!(pair[1].tick.is_multiple_of(STATUS_INTERVAL) || changed, "{}", pair[1].tick);
        assert!(pair[1].tick - pair[0].tick <= STATUS_INTERVAL);
    }
}

#[test]
fn a_host_of_1_0_hears_what_1_0_has_and_can_leave_the_fault() {
    let mut world = World::new();
    world.kernel.receive(&envelope(0x10, &[0]));
    world.heard.clear();
    world.ticks(100, 1.5 * TRANSLATION_MAX);
    // The base is back; the fault stays until a person has left it.
    world.ticks(300, 0.001);
    let fault = world.kernel.status().fault.unwrap();
    assert!(matches!(fault.fault, Fault::Base { .. }), "{fault:?}");
    assert_eq!(world.loops().len(), 0);
    assert!(matches!(world.fault(), Some(Fault::Correction { quantity: Quantity::Workspace, .. })));
    for message in &world.heard {
        if let FromKernel::Status(status) = message {
            let told = status.fault.map(|report| (report.number, report.fault.code()));
            assert!(told.is_none_or(|told| told == (fault.number, "K7")), "{told:?}");
        }
    }
    // Message 7 of 1.0, the number in its one byte.
    world.kernel.receive(&envelope(0x10, &[7, fault.number as u8]));
    world.ticks(1, 0.001);
    assert_eq!(world.kernel.status().fault, None);
    // A host of today again.
    world.say(&ToKernel::Hello);
    world.ticks(20, 0.001);
    assert!(!world.loops().is_empty());
}
