//! The loop closed around the tape's kernel: a tracker that errs, lies, comes late and is lost sight of, on a base that moves.

use crate::base;
use crate::cell::{ARM, TICK_NS, TapeKernel};
use crate::hash::Fnv;
use crate::motion::JOINTS;
use crate::random::Random;
use nalgebra::Vector3;
use screed_kernel::base::{Displacement, Trust};
use screed_kernel::closed_loop::{ClosedLoop, LoopReport};
use screed_kernel::control::{Bounds, Settings};
use screed_kernel::drive::{Drive, Learning};
use screed_kernel::ekf::State;
use screed_kernel::estimator::{Estimator, EstimatorConfig, Robot, TrackerPose};
use screed_kernel::pid::{ByProcess, Gains, Process};
use screed_kernel::pose::Pose;
use screed_kernel::tick::{Command, Sensors};
use screed_kernel::units::{JointAcc, JointPos, JointVel, Nanos};

/// Ticks that the estimator remembers.
const DEPTH: usize = 8;

/// Standard deviations of the tracker (m, rad).
const PLACE: f64 = 25e-6;
const TURN: f64 = 1.7e-4;

/// From a command to its effect (s).
const DEAD_TIME: f64 = 4e-3;

/// Loop, tracker and base, and what became of it.
#[derive(Clone, Debug)]
pub struct Closed {
    random: Random,
    config: EstimatorConfig<JOINTS>,
    /// None only if a configuration were refused.
    around: Option<ClosedLoop<JOINTS, DEPTH>>,
    /// What the tracker says at the next tick.
    poses: [Option<TrackerPose>; 2],
    /// Where the arm was at the last ticks, the newest first.
    before: [(Nanos, JointPos<JOINTS>); 4],
    truth: Displacement,
    rate: Vector3<f64>,
    dark: u32,
    report: Option<LoopReport<JOINTS>>,
    /// Ticks with feedback, with the base trusted, with a replay, with a pose gated, with an excess, with the tool held back, with
    /// the path waiting.
    pub met: [u64; 7],
}

impl Closed {
    pub fn new(seed: u64) -> Self {
        let config = estimator();
        let around = Estimator::new(&config).ok().and_then(|estimator| {
            let period = TICK_NS as f64 * 1e-9;
            let drives = [Drive { lag: 0.02, inverse_gain: 1e-4 }; JOINTS];
            ClosedLoop::new(&ARM, Some(estimator), &settings(), &drives, &learning(), period).ok()
        });
        let nowhere = (Nanos(0), JointPos::ZERO);
        Self {
            random: Random(seed),
            config,
            around,
            poses: [None; 2],
            before: [nowhere; 4],
            truth: Displacement::zero(),
            rate: Vector3::zeros(),
            dark: 0,
            report: None,
            met: [0; 7],
        }
    }

    /// What the tracker has to say of an arm that is there at this tick.
    pub fn look(&mut self, now: Nanos, actual: &JointPos<JOINTS>) {
        let [a, b, c, _] = self.before;
        self.before = [(now, *actual), a, b, c];
        self.truth.translation += self.rate * self.config.base.period;
        match self.random.below(1200) {
            0 => self.truth.translation = self.any(0.004),
            1 => self.truth.rotation = self.any(0.002),
            2..5 => self.rate = self.any(0.003),
            5 => self.dark = self.random.below(600),
            // Farther than a base may be.
            6 if self.random.once_in(4) => self.truth.translation.x = 0.03,
            // Farther than the tool may be moved for it.
            7 if self.random.once_in(8) => self.truth.translation.x = 0.015,
            _ => self.dark = self.dark.saturating_sub(1),
        }
        self.poses = [None; 2];
        if self.dark == 0 && actual.is_finite() {
            self.poses = [self.pose(), self.pose()];
        }
    }

    /// A pose of one of the last ticks; now and then none, or one that lies.
    fn pose(&mut self) -> Option<TrackerPose> {
        let (at, joints) = *self.before.get(self.random.below(4) as usize)?;
        if self.random.once_in(3) || !joints.is_finite() {
            return None;
        }
        let base = self.config.base.tracker_from_nominal * self.truth.pose(&self.config.base.pivot);
        let target = base * ARM.forward(&joints) * self.config.base.flange_from_target;
        let off = Pose::from_rotation_vector(Vector3::zeros(), self.any(1.5 * TURN));
        let lie = if self.random.once_in(60) { self.any(1.0) } else { self.any(1.5 * PLACE) };
        let measured = Pose { rotation: off.rotation * target.rotation, translation: target.translation + lie };
        Some(TrackerPose { at, tracker_from_target: measured, position_deviation: PLACE, rotation_deviation: TURN })
    }

    /// The whole cycle in place of the kernel's own tick.
    pub fn tick(&mut self, kernel: &mut TapeKernel, now: Nanos, sensors: &Sensors<JOINTS>) -> Command<JOINTS> {
        let Some(around) = &mut self.around else { return kernel.tick(now, sensors) };
        let robot = Robot { actual: sensors.actual, rates: Some(JointVel::ZERO), ready: sensors.ready };
        let (command, report) = match self.poses {
            [Some(a), Some(b)] => around.tick(kernel, now, &robot, &[a, b]),
            [Some(a), None] | [None, Some(a)] => around.tick(kernel, now, &robot, &[a]),
            [None, None] => around.tick(kernel, now, &robot, &[]),
        };
        self.report = Some(report);
        command
    }

    /// All that the last cycle came to.
    pub fn hash(&mut self, hash: &mut Fnv) {
        let (Some(around), Some(LoopReport { control, estimated, waits })) = (&self.around, self.report.take()) else {
            return;
        };
        for drive in around.identification().learnt() {
            hash.number(drive.lag);
            hash.number(drive.inverse_gain);
        }
        for number in [control.shift, control.turn, control.behind].into_iter().chain(control.held) {
            hash.number(number);
        }
        hash.integer(u64::from(control.closed));
        self.count(0, control.closed);
        self.count(5, control.held.iter().any(|held| *held > 0.0));
        hash.integer(u64::from(waits));
        self.count(6, waits);
        match estimated {
            Some(Ok(estimated)) => {
                estimated.joints.0.iter().for_each(|number| hash.number(*number));
                let base = estimated.base.nominal_from_base;
                base.rotation.iter().chain(base.translation.iter()).for_each(|number| hash.number(*number));
                self.count(1, matches!(estimated.base.trust, Trust::Held { .. }));
                if let Ok(filter) = estimated.filter {
                    hash.integer(filter.replayed as u64);
                    hash.integer(filter.gated as u64);
                    self.count(2, filter.replayed > 0);
                    self.count(3, filter.gated > 0);
                }
            }
            Some(Err(excess)) => {
                hash.number(excess.value);
                self.count(4, true);
            }
            None => {}
        }
    }

    /// Each component anywhere from −`size` to `size`.
    fn any(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.random.between(-size, size))
    }

    fn count(&mut self, which: usize, happened: bool) {
        if let Some(count) = self.met.get_mut(which) {
            *count += u64::from(happened);
        }
    }
}

fn estimator() -> EstimatorConfig<JOINTS> {
    EstimatorConfig {
        base: base::config(TICK_NS, 0.2),
        jerk_density: [1.0; JOINTS],
        encoder_deviation: JointPos([1e-4; JOINTS]),
        joint_deviation: JointPos([3e-4; JOINTS]),
        rate_deviation: JointVel([1.0; JOINTS]),
        start_deviation: State {
            position: JointPos([1e-2; JOINTS]),
            velocity: JointVel([0.1; JOINTS]),
            acceleration: JointAcc([1.0; JOINTS]),
        },
        dead_time: DEAD_TIME,
    }
}

fn settings() -> Settings<JOINTS> {
    let bounds = Bounds {
        shift_max: 0.01,
        turn_max: 0.01,
        shift_speed_max: 0.01,
        shift_acceleration_max: 0.1,
        turn_speed_max: 0.01,
        turn_acceleration_max: 0.1,
        patience: 0.4,
    };
    let gains = |crossover| [Gains::for_drive(&Drive { lag: 0.05, inverse_gain: 1e-3 }, crossover, 0.02); JOINTS];
    Settings {
        gains: ByProcess { deposit: gains(1.0), travel: gains(0.5), mill: gains(2.0) },
        bounds: ByProcess { deposit: bounds, travel: bounds, mill: bounds },
        works: Process::Deposit,
        flange_from_tcp: Pose::from_rotation_vector(Vector3::new(0.0, 0.0, 0.15), Vector3::zeros()),
        dead_time: DEAD_TIME,
    }
}

const fn learning() -> Learning {
    Learning {
        // The tape's robot does not lag: that is noticed in the end.
        lag: [0.015, 0.05],
        inverse_gain: [0.0, 0.01],
        dead_time: DEAD_TIME,
        filter_time: 0.05,
        velocity_min: 0.01,
        memory: 0.5,
        noise: 1e-4,
        adoption: 0.3,
    }
}
