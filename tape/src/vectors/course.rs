//! A course as it runs: kernel and loop, a robot that follows, a tracker that errs, a host that talks, and one event.

use super::cell::{self, AnyArm, DEPTH, RING, Stretched, TICK_NS};
use super::traffic::{Line, Sweep};
use super::{Call, Class, Course, Edge, USUAL_POSES, measured};
use crate::random::Random;
use nalgebra::Vector3;
use screed_kernel::arm::Arm;
use screed_kernel::base::Displacement;
use screed_kernel::closed_loop::ClosedLoop;
use screed_kernel::estimator::{EstimatorConfig, POSES_MAX, Robot, TrackerPose};
use screed_kernel::fault::Fault;
use screed_kernel::frame::{ModeCode, ToKernel};
use screed_kernel::mode::Mode;
use screed_kernel::pose::Pose;
use screed_kernel::setpoint::Coder;
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::{JointPos, JointVel, Nanos};

/// Ticks of a course: of its rest while batches come in, and of the path and what is behind it.
const REST: u32 = 12;
const MOVING: u32 = 52;

/// The ticks before a resume where the ring is filled up first.
const FILLING: u32 = 40;

/// Ticks over which a sweep leads.
const SWEEP_TICKS: u32 = 40;

/// Standard deviations of the tracker (m, rad).
const PLACE: f64 = 25e-6;
const TURN: f64 = 1.7e-4;

/// Ticks of which the tracker may speak.
const PAST: usize = 12;

/// Poses a tick, by a byte of the course.
const POSES: [usize; 16] = [0, 0, 1, 1, 1, 1, 1, 1, 1, 2, 2, 3, 4, 8, 15, POSES_MAX];

/// What an arm's limits leave to corrections (rad, m).
const ROOM: f64 = 0.15;

/// How far beside a singularity (rad).
const BESIDE: [f64; 6] = [0.0, 1e-13, 1e-10, 1e-7, 1e-5, 1e-3];

struct Machine<'a, const N: usize> {
    genes: &'a Course,
    arm: &'a Arm<N>,
    kernel: Kernel<N, RING>,
    /// Where there is one.
    around: Option<ClosedLoop<N, DEPTH>>,
    config: EstimatorConfig<N>,
    random: Random,
    now: Nanos,
    actual: JointPos<N>,
    past: [(Nanos, JointPos<N>); PAST],
    base: Displacement,
    sweep: Sweep<N>,
    coder: Coder<N>,
    /// The sample to be sent next, and the number of the batch's first; none when all is sent.
    sending: Option<(u32, u32)>,
    line: Line,
    resumed: bool,
    played: bool,
    faulted_for: u32,
}

pub(super) fn run(course: &Course, meter: &mut impl FnMut(Edge) -> u64, sink: &mut impl FnMut(&Call)) -> bool {
    match cell::arm(course) {
        AnyArm::Six(arm) => run_on(course, &arm, meter, sink),
        AnyArm::Four(arm) => run_on(course, &arm, meter, sink),
        AnyArm::Nine(arm) => run_on(course, &arm, meter, sink),
    }
}

fn run_on<const N: usize>(
    course: &Course,
    stretched: &Stretched<N>,
    meter: &mut impl FnMut(Edge) -> u64,
    sink: &mut impl FnMut(&Call),
) -> bool {
    let genes = course;
    let arm = &stretched.0;
    let [start, goal] = ends(course, arm, singular(course, stretched));
    let config = cell::estimator(arm.forward(&start).translation);
    let kind = genes.0[14] % 16;
    // An arm that cannot tilt its tool cannot follow a tracked base either: what follows is a fault.
    let tracked = kind > if N < 6 { 12 } else { 1 };
    let around = if kind == 0 { None } else { cell::around(arm, &config, tracked) };
    let sample_ticks = [1, 1, 2, 4][genes.0[25] as usize % 4];
    let spread = |byte: u8, most: f64| most * (f64::from(byte) / 127.5 - 1.0);
    let base = Displacement {
        translation: Vector3::new(spread(genes.0[19], 0.015), spread(genes.0[19].rotate_left(3), 0.015), 0.0),
        rotation: Vector3::new(spread(genes.0[20], 0.006), 0.0, spread(genes.0[20].rotate_left(3), 0.006)),
    };
    let seed = u64::from_le_bytes([genes.0[26], genes.0[27], genes.0[19], genes.0[20], 0, 0, 0, 1]);
    let mut machine = Machine {
        genes,
        arm,
        kernel: Kernel::new(arm),
        around,
        config,
        random: Random(seed),
        now: Nanos(1_000_000_000),
        actual: start,
        past: [(Nanos(0), start); PAST],
        base,
        sweep: Sweep { start, goal, samples: SWEEP_TICKS / sample_ticks, deposit: genes.0[14] & 0x40 != 0 },
        coder: Coder::new(),
        sending: Some((1, 1)),
        line: Line::new(),
        resumed: false,
        played: false,
        faulted_for: 0,
    };
    let configure = cell::configure(arm, &start, u64::from(sample_ticks));
    machine.line.say(&ToKernel::Configure(configure));
    let rest = if machine.fills() { REST + FILLING } else { REST };
    for tick in 0..rest + MOVING {
        machine.talk(tick, rest, meter, sink);
        let event = tick.checked_sub(rest).map(|since| (genes.0[21], since == u32::from(genes.0[22] % 40)));
        machine.step(tick, event, meter, sink);
    }
    machine.played
}

/// A posture by the course, put into one of the arm's singularities or beside it.
fn singular<const N: usize>(course: &Course, Stretched(arm, elbow): &Stretched<N>) -> JointPos<N> {
    let mut joints = JointPos::ZERO;
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    let bytes = course.0.iter().skip(3);
    for ((position, (low, high)), byte) in joints.0.iter_mut().zip(limits).zip(bytes) {
        let (low, high) = (low.max(-3.0), high.min(3.0).max(low.max(-3.0)));
        *position = low + (0.1 + 0.8 * f64::from(*byte) / 255.0) * (high - low);
    }
    let Some(carried) = N.checked_sub(6) else { return joints };
    let beside = BESIDE[course.0[2] as usize % BESIDE.len()];
    let kind = course.0[1] % 8;
    if kind == 3 || kind == 5 {
        over_axis(arm, carried, &mut joints);
    }
    let moved = arm.joints.get(carried + 2).and_then(|joint| joint.coupling).map_or(0.0, |coupling| coupling.factor);
    if let Some([_, second, third, _, fifth, _]) = joints.0.get_mut(carried..) {
        if matches!(kind, 2 | 4) {
            *third = elbow + beside - moved * *second;
        }
        if matches!(kind, 1 | 4 | 5) {
            *fifth = beside;
        }
    }
    joints
}

/// Turns joint 2 until the wrist stands over axis 1, where it can: by bisection of its distance along link 1.
fn over_axis<const N: usize>(arm: &Arm<N>, carried: usize, joints: &mut JointPos<N>) {
    let row = arm.dh.get(carried).map_or(0.0, |row| row.a);
    let distance = |second: f64| {
        let mut at = *joints;
        if let Some(position) = at.0.get_mut(carried + 1) {
            *position = second;
        }
        let frames = arm.frames(&at);
        let (Some(first), Some(wrist)) = (frames.get(carried), frames.get(carried + 4)) else { return 0.0 };
        first.inverse().transform_point(&wrist.translation).x + row
    };
    let Some(middle) = joints.0.get(carried + 1).copied() else { return };
    let (mut low, mut high) = (middle - 1.5, middle + 1.5);
    if (distance(low) > 0.0) == (distance(high) > 0.0) {
        return;
    }
    for _ in 0..60 {
        let half = 0.5 * (low + high);
        if (distance(half) > 0.0) == (distance(low) > 0.0) { low = half } else { high = half }
    }
    if let Some(position) = joints.0.get_mut(carried + 1) {
        *position = low;
    }
}

/// Where a sweep begins and ends that has the posture in its middle.
fn ends<const N: usize>(course: &Course, arm: &Arm<N>, middle: JointPos<N>) -> [JointPos<N>; 2] {
    let size = 0.02 * f64::from(course.0[12]) / 255.0;
    let signs = course.0[17].rotate_left(1) ^ course.0[24];
    [-1.0, 1.0].map(|side| {
        let mut end = middle;
        let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
        for ((joint, position), (low, high)) in (0..N).zip(&mut end.0).zip(limits) {
            let sign = if signs >> (joint % 8) & 1 == 1 { side } else { -side };
            *position = (*position + sign * size).clamp(low + ROOM, f64::max(low + ROOM, high - ROOM));
        }
        end
    })
}

impl<const N: usize> Machine<'_, N> {
    const fn fills(&self) -> bool {
        self.genes.0[24].is_multiple_of(16)
    }

    /// What the host says before a tick.
    fn talk(&mut self, tick: u32, rest: u32, meter: &mut impl FnMut(Edge) -> u64, sink: &mut impl FnMut(&Call)) {
        let status = self.kernel.status();
        let most = 12 + u32::from(self.genes.0[24]) / 2;
        self.faulted_for = if status.mode == ModeCode::Faulted { self.faulted_for + 1 } else { 0 };
        if tick > 2 {
            self.line.len = 0;
            if let (Some((next, first)), false) = (self.sending, self.resumed) {
                let (next, whole) = self.line.part(&self.sweep, &mut self.coder, next, first, most);
                self.sending = (!whole).then_some((next, first));
            } else if self.fills() && tick + 2 < rest {
                // Standing still until the ring is full, and once more.
                let end = self.sweep.sample(self.sweep.count()).joints;
                let still = Sweep { start: end, goal: end, samples: 110, deposit: false };
                self.line.part(&still, &mut Coder::new(), 1, status.end_seq + 1, u32::MAX);
            } else if tick == rest - 1 {
                let rate = if self.genes.0[13] < 128 { 1.0 } else { f64::from(self.genes.0[13]) / 256.0 };
                self.line.say(&ToKernel::Rate(rate));
            } else if tick == rest || (tick > rest + 30 && status.mode == ModeCode::Holding) {
                self.resumed = true;
                self.line.say(&ToKernel::Resume { epoch: status.epoch });
            } else if self.faulted_for == 3 {
                self.line.say(&ToKernel::Rearm { fault: status.fault.map_or(0, |report| report.number) });
            } else if tick > rest && tick.is_multiple_of(4) {
                self.line.burden(self.genes, &mut self.random);
            }
        } else if tick > 0 {
            self.line.len = 0;
        }
        if self.line.len > 0 {
            let before = meter(Edge::Before);
            measured::receive(&mut self.kernel, self.line.take());
            let count = meter(Edge::After).wrapping_sub(before);
            sink(&Call { class: Class::Frames, arm: self.genes.arm(), tick, count });
        }
    }

    /// One tick, and the answers when the host listens.
    fn step(
        &mut self,
        tick: u32,
        event: Option<(u8, bool)>,
        meter: &mut impl FnMut(Edge) -> u64,
        sink: &mut impl FnMut(&Call),
    ) {
        self.now = self.now.plus(TICK_NS);
        let before = self.actual;
        let mut robot = Robot { actual: self.near(), rates: None, ready: true };
        let mut dark = self.random.below(256) < u32::from(self.genes.0[9] / 8);
        if let Some((kind, due)) = event {
            self.happen(kind, due, &mut robot, &mut dark);
        }
        self.past.copy_within(..PAST - 1, 1);
        self.past[0] = (self.now, robot.actual);
        if self.genes.0[14] & 0x80 != 0 {
            let mut rates = JointVel::ZERO;
            for (rate, (now, then)) in rates.0.iter_mut().zip(robot.actual.0.iter().zip(&before.0)) {
                *rate = (now - then) * 500.0;
            }
            robot.rates = Some(rates);
        }
        let mut poses = [TrackerPose {
            at: self.now,
            tracker_from_target: Pose::identity(),
            position_deviation: PLACE,
            rotation_deviation: TURN,
        }; POSES_MAX];
        let count = if dark { 0 } else { self.look(&mut poses) };
        let poses = poses.get(..count).unwrap_or(&[]);
        let (class, number, command) = self.tick(&robot, poses, meter);
        sink(&Call { class, arm: self.genes.arm(), tick, count: number });
        self.played |= command.mode == Mode::Moving && command.seq > self.sweep.samples / 2;
        if let Some(joints) = command.joints {
            self.actual = joints;
        }
        // Some hosts never listen.
        if tick.is_multiple_of(8) && self.genes.0[18] & 7 != 0 {
            let mut out = [0; 2048];
            let before = meter(Edge::Before);
            measured::transmit(&mut self.kernel, &mut out);
            let count = meter(Edge::After).wrapping_sub(before);
            sink(&Call { class: Class::Answers, arm: self.genes.arm(), tick, count });
        }
    }

    fn tick(
        &mut self,
        robot: &Robot<N>,
        poses: &[TrackerPose],
        meter: &mut impl FnMut(Edge) -> u64,
    ) -> (Class, u64, Command<N>) {
        let stood = self.kernel.mode().fault().is_some();
        let (command, count, class) = if let Some(around) = &mut self.around {
            let before = meter(Edge::Before);
            let (command, report) = measured::closed(around, &mut self.kernel, self.now, robot, poses);
            let count = meter(Edge::After).wrapping_sub(before);
            // A base that is beyond its bounds or a filter that fails keeps no account of what was done before: it went back if the pose
            // that the filter is told, the last, is from before the tick before this.
            let late = poses.last().is_some_and(|pose| pose.at.plus(TICK_NS) <= self.now);
            let replayed = match report.estimated {
                Some(Ok(estimated)) => estimated.filter.map_or(late, |filter| filter.replayed > 0),
                Some(Err(_)) => late,
                None => false,
            };
            let class = match (replayed, robot.rates.is_some(), poses.is_empty()) {
                (true, _, _) => Class::Replay,
                _ if poses.len() > USUAL_POSES => Class::Burst,
                (false, true, _) => Class::Rates,
                (false, false, false) => Class::Pose,
                (false, false, true) => Class::Motion,
            };
            (command, count, class)
        } else {
            let sensors = Sensors::robot(robot.actual, robot.ready);
            let before = meter(Edge::Before);
            let command = measured::plain(&mut self.kernel, self.now, &sensors);
            let count = meter(Edge::After).wrapping_sub(before);
            (command, count, Class::Plain)
        };
        let faulted = stood || command.mode.fault().is_some();
        let class = if faulted && !matches!(class, Class::Replay | Class::Burst) { Class::Fault } else { class };
        (class, count, command)
    }

    /// What the tracker says at this tick; returns how many poses.
    fn look(&mut self, poses: &mut [TrackerPose; POSES_MAX]) -> usize {
        let count = POSES[self.genes.0[15] as usize % POSES.len()];
        let delay = u32::from(self.genes.0[16] % 12).saturating_sub(2);
        let spread = u32::from(self.genes.0[17] % 8).saturating_sub(3);
        let lies = u32::from(self.genes.0[18] / 16);
        for (index, pose) in poses.iter_mut().take(count).enumerate() {
            let back = delay + self.random.below(spread + 1);
            let Some((at, joints)) = self.past.get(back as usize).copied().filter(|(_, joints)| joints.is_finite())
            else {
                return index;
            };
            let target = self.config.base.tracker_from_nominal
                * self.base.pose(&self.config.base.pivot)
                * self.arm.forward(&joints)
                * self.config.base.flange_from_target;
            let off = Pose::from_rotation_vector(Vector3::zeros(), self.any(1.5 * TURN));
            let lie = if self.random.below(256) < lies { self.any(0.5) } else { self.any(1.5 * PLACE) };
            let earlier = (count - 1 - index) as u64 * TICK_NS / count as u64;
            pose.at = Nanos(at.0.saturating_sub(earlier));
            pose.tracker_from_target =
                Pose { rotation: off.rotation * target.rotation, translation: target.translation + lie };
        }
        count
    }

    /// The event of the course, at its tick or from it on.
    fn happen(&mut self, kind: u8, due: bool, robot: &mut Robot<N>, dark: &mut bool) {
        let joint = self.genes.0[22] as usize % N;
        let moved = |robot: &mut Robot<N>, by: f64| {
            if let Some(position) = robot.actual.0.get_mut(joint) {
                *position += by;
            }
        };
        match (kind % 24, due) {
            (0, true) => moved(robot, f64::NAN),
            (1, true) => moved(robot, 0.2),
            (2, true) => robot.ready = false,
            (3, true) => self.kernel.robot_lost(Fault::Link),
            (4, true) => self.kernel.host_changed(),
            (5, true) => self.kernel.raise(Fault::Extruder),
            (6, true) => self.kernel.quit(),
            (7, true) => self.now = self.now.plus(30_000_000),
            (8, true) => self.now = Nanos(self.now.0 - TICK_NS),
            (9, true) => self.base.translation.x = 0.05,
            (10, true) => self.base.translation = self.any(0.015),
            (11, true) => self.base.rotation = self.any(0.006),
            (12, true) => *dark = true,
            (13, true) => self.obeyed(&ToKernel::Hold),
            (14, true) => self.obeyed(&ToKernel::Stop),
            (15, true) => self.obeyed(&ToKernel::Rate(0.1)),
            // From the first tick on.
            (16, _) => *dark = self.random.once_in(2),
            (17, _) => self.base.translation.y += 1e-5,
            (18, _) => self.base.rotation.z += 5e-6,
            _ => {}
        }
    }

    /// Said outside the measured calls.
    fn obeyed(&mut self, message: &ToKernel) {
        let mut line = Line::new();
        line.say(message);
        self.kernel.receive(line.take());
    }

    /// Where it is, give or take what an encoder errs.
    fn near(&mut self) -> JointPos<N> {
        let mut joints = self.actual;
        for position in &mut joints.0 {
            *position += self.random.between(-2e-5, 2e-5);
        }
        joints
    }

    /// Each component anywhere from −`size` to `size`.
    fn any(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.random.between(-size, size))
    }
}
