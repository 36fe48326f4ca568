//! The kernel of arms with other than two or six joints: what the wire, the guard and the path clock do is the same for 3 to 9.

mod common;

use common::Random;
use nalgebra::Vector3;
use screed_kernel::arm::{Arm, Coupling, Dh, Joint, Rating};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::frame::{
    self, BatchPart, CODE_MAX, Configure, FromKernel, JOINTS_MAX, ModeCode, MotionLimits, Reader, Refusal, ToKernel,
    Unsound,
};
use screed_kernel::guard::{Motion, Periods, Plane, Quantity, output_least};
use screed_kernel::setpoint::{Coder, Setpoint, flow_on_grid, joint_on_grid};
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel, Nanos};

const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.01, velocity_max: 0.05, acceleration_max: 0.5 };

struct Bench<const N: usize> {
    arm: Arm<N>,
    kernel: Box<Kernel<N, 4096>>,
    sensors: Sensors<N>,
    answers: Vec<FromKernel>,
    reader: Reader,
    now: u64,
}

/// Every joint has limits of its own, so that one taken for another is noticed.
fn plan<const N: usize>() -> Motion<N> {
    let all = |value: f64| std::array::from_fn(|j| value * (1.0 + 0.1 * j as f64));
    Motion { velocity_max: JointVel(all(1.0)), acceleration_max: JointAcc(all(10.0)), jerk_max: JointJerk(all(500.0)) }
}

fn configure<const N: usize>(sample_ns: u64, tick_ns: u64) -> Configure {
    let periods = Periods { sample: sample_ns as f64 * 1e-9, tick: tick_ns as f64 * 1e-9 };
    let all = |value: f64| [value; N].into_iter().collect();
    Configure {
        sample_period_ns: sample_ns,
        tick_period_ns: tick_ns,
        position_min: all(-2.0),
        position_max: all(2.0),
        plan: MotionLimits::from(&plan::<N>()),
        output: MotionLimits::from(&output_least(&plan::<N>(), periods, &CORRECTION)),
        following_error_max: 0.05,
        deviation_max: 0.05,
        correction: CORRECTION,
        flange_from_tcp: [0.0, 0.0, 0.1, 0.0, 0.0, 0.0],
        workspace: heapless::Vec::new(),
    }
}

impl<const N: usize> Bench<N> {
    /// Joint axes in turn along z and across, each a tenth of a metre further; the second joint slides, the third is coupled to
    /// the first, and the last turns without end.
    fn new() -> Self {
        let dh = Dh { theta: 0.0, d: 0.1, a: 0.05, sin_alpha: 1.0, cos_alpha: 0.0 };
        let mut joints = [Joint::REVOLUTE; N];
        joints[1] = Joint::PRISMATIC;
        joints[2].coupling = Some(Coupling { joint: 0, factor: -1.0 });
        let mut arm = Arm {
            name: "chain",
            base_from_zero: None,
            dh: [dh; N],
            joints,
            last_from_flange: None,
            position_min: JointPos([-3.0; N]),
            position_max: JointPos([3.0; N]),
            velocity_max: Rating::Known(JointVel([3.0; N])),
            acceleration_max: Rating::Unknown,
        };
        arm.position_min.0[N - 1] = f64::NEG_INFINITY;
        arm.position_max.0[N - 1] = f64::INFINITY;
        let sensors = Sensors::robot(JointPos([0.0; N]), true);
        Self { kernel: Box::new(Kernel::new(&arm)), arm, sensors, answers: vec![], reader: Reader::new(), now: 0 }
    }

    fn say(&mut self, message: &ToKernel) -> Option<Refusal> {
        let mut out = [0; frame::WIRE_MAX];
        let used = frame::encode(message, &mut out).unwrap();
        let mut rest = &out[..used];
        while !rest.is_empty() {
            let taken = self.kernel.receive(rest);
            rest = &rest[taken..];
            if taken == 0 {
                self.tick(0);
            }
        }
        self.listen();
        self.answers.drain(..).find_map(|answer| match answer {
            FromKernel::Refused { reason, .. } => Some(reason),
            _ => None,
        })
    }

    fn listen(&mut self) {
        let mut out = [0; 4096];
        let used = self.kernel.poll_transmit(&mut out);
        for &byte in &out[..used] {
            if let Some(message) = self.reader.push(byte) {
                self.answers.push(frame::decode(message.unwrap()).unwrap());
            }
        }
    }

    fn tick(&mut self, tick_ns: u64) -> Command<N> {
        self.now += tick_ns;
        let command = self.kernel.tick(Nanos(self.now), &self.sensors);
        self.sensors.actual = command.joints.unwrap_or(self.sensors.actual);
        command
    }

    fn batch(&mut self, setpoints: &[Setpoint<N>]) -> Option<Refusal> {
        let (mut coder, mut rest, mut first_seq) = (Coder::new(), setpoints, 1);
        while !rest.is_empty() {
            let (mut code, mut used, mut count) = ([0; CODE_MAX], 0, 0);
            while let Some(setpoint) = rest.get(count)
                && let Ok(length) = coder.encode(setpoint, &mut code[used..])
            {
                (used, count) = (used + length, count + 1);
            }
            let (opens, commits) = (first_seq == 1, count == rest.len());
            let part = BatchPart { batch: 1, first_seq, opens, commits, after: None, code: &code[..used] };
            if let Some(refusal) = self.say(&ToKernel::Batch(part)) {
                return Some(refusal);
            }
            (rest, first_seq) = (&rest[count..], first_seq + count as u32);
        }
        None
    }
}

/// Each joint to its own goal on a minimum-jerk course, then still.
fn sweep<const N: usize>(goal: [f64; N], samples: usize) -> Vec<Setpoint<N>> {
    let setpoint = |k: usize| {
        let t = (k as f64 / samples as f64).min(1.0);
        let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        let flow = flow_on_grid(if t < 1.0 { 1e-6 } else { 0.0 });
        Setpoint { joints: JointPos(goal.map(|goal| joint_on_grid(goal * s))), flow, deposit: true }
    };
    (1..=samples + 2).map(setpoint).collect()
}

/// Plays a motion at changing rates with a correction; every output keeps its own joint's limits, and stays on the course.
fn plays<const N: usize>(sample_ns: u64, tick_ns: u64) {
    let mut random = Random(N as u64);
    let mut bench = Bench::<N>::new();
    assert_eq!(bench.say(&ToKernel::Configure(configure::<N>(sample_ns, tick_ns))), None);
    bench.tick(tick_ns);
    let goal = std::array::from_fn(|j| 0.3 - 0.1 * j as f64);
    let motion = sweep(goal, (1.5e9 / sample_ns as f64) as usize);
    assert_eq!(bench.batch(&motion), None);
    let epoch = bench.kernel.status().epoch;
    assert_eq!(bench.say(&ToKernel::Resume { epoch }), None);
    let h = tick_ns as f64 * 1e-9;
    let periods = Periods { sample: sample_ns as f64 * 1e-9, tick: h };
    let limits = output_least(&plan::<N>(), periods, &CORRECTION);
    let (mut last, mut offset, mut ticks) = ([[0.0; N]; 3], 0.0, 0_u32);
    while bench.kernel.status().mode != ModeCode::Holding || bench.kernel.status().consumed == 0 {
        if ticks.is_multiple_of(50) {
            assert_eq!(bench.say(&ToKernel::Rate(random.between(0.3, 1.0))), None);
        }
        offset += 0.4 * h * h * f64::from(ticks.min(20));
        bench.sensors.correction = (ticks < 100).then_some(JointPos([offset; N]));
        let command = bench.tick(tick_ns);
        let (q, corrected) = (command.joints.unwrap().0, command.correction.0);
        let share = (q[0] - corrected[0]) / goal[0];
        for j in 0..N {
            let [a, b, c] = last.map(|joints| joints[j]);
            let differences = [
                ((q[j] - a) / h, limits.velocity_max.0[j]),
                ((q[j] - 2.0 * a + b) / (h * h), limits.acceleration_max.0[j]),
                ((q[j] - 3.0 * (a - b) - c) / (h * h * h), limits.jerk_max.0[j]),
            ];
            assert!(differences.iter().all(|(value, limit)| value.abs() <= limit * 1.001), "{j}: {differences:?}");
            assert!((q[j] - corrected[j] - goal[j] * share).abs() < 1e-9, "joint {j} left the course");
        }
        last = [q, last[0], last[1]];
        ticks += 1;
        assert!(ticks < 20_000, "{:?}", bench.kernel.status());
    }
    assert_eq!(bench.kernel.status().fault, None);
    while bench.tick(tick_ns).correction != JointPos::ZERO {}
    assert_eq!(bench.sensors.actual, motion.last().unwrap().joints);
}

/// Lists of another length, a joint beyond its own limit, and a tool beyond the plane are refused with what is wrong.
fn refuses<const N: usize>() {
    let mut bench = Bench::<N>::new();
    let good = configure::<N>(2_000_000, 2_000_000);
    let mut short = good.clone();
    short.output.jerk_max.pop();
    let unsound = Some(Refusal::Configuration(Unsound::Joints));
    assert_eq!(bench.say(&ToKernel::Configure(short)), unsound);
    let mut long = good.clone();
    if long.plan.velocity_max.push(1.0).is_ok() {
        assert_eq!(bench.say(&ToKernel::Configure(long)), unsound);
    }
    // A joint may turn without end; a configuration still says how far it does.
    for end in [f64::INFINITY, f64::NAN] {
        let unsound = Some(Refusal::Configuration(Unsound::Positions));
        let mut endless = good.clone();
        endless.position_max[N - 1] = end;
        assert_eq!(bench.say(&ToKernel::Configure(endless)), unsound);
        let mut endless = good.clone();
        endless.position_min[N - 1] = -end;
        assert_eq!(bench.say(&ToKernel::Configure(endless)), unsound);
    }
    let mut tight = good.clone();
    tight.output.velocity_max[N - 1] *= 0.99;
    let refusal = bench.say(&ToKernel::Configure(tight));
    let last = N as u8 - 1;
    assert!(
        matches!(refusal, Some(Refusal::NoRoom { quantity: Quantity::Velocity, joint, .. }) if joint == last),
        "{refusal:?}"
    );
    assert_eq!(bench.say(&ToKernel::Configure(good)), None);
    bench.tick(2_000_000);
    let mut motion = sweep([0.05; N], 1000);
    motion[500].joints.0[N - 1] += 0.01;
    let refusal = bench.batch(&motion);
    assert!(
        matches!(refusal, Some(Refusal::DoesNotFit { seq: 501, quantity: Quantity::Velocity, joint, .. }) if joint == last),
        "{refusal:?}"
    );
    assert_eq!(bench.batch(&sweep([0.05; N], 1000)), None);
}

/// A plane across the tool's way is found by the setpoint that passes it, not before and not later.
fn stays_inside<const N: usize>() {
    let mut bench = Bench::<N>::new();
    let motion = sweep([0.5; N], 2000);
    let tool_in_flange = Vector3::new(0.0, 0.0, 0.1);
    let tool = |setpoint: &Setpoint<N>| bench.arm.forward(&setpoint.joints).transform_point(&tool_in_flange);
    let normal = (tool(&motion[2000]) - tool(&motion[0])).normalize();
    let flange = |setpoint: &Setpoint<N>| bench.arm.forward(&setpoint.joints).translation;
    let reached = |setpoint: &Setpoint<N>| normal.dot(&tool(setpoint)).max(normal.dot(&flange(setpoint)));
    let offset = reached(&motion[1500]) + 1e-9;
    let first = motion.iter().position(|setpoint| reached(setpoint) > offset).unwrap();
    assert!(first > 100, "{first}");
    let plane = Plane { normal_in_base: normal.into(), offset };
    let workspace = [plane].into_iter().collect();
    let configure = Configure { workspace, ..configure::<N>(2_000_000, 2_000_000) };
    assert_eq!(bench.say(&ToKernel::Configure(configure)), None);
    bench.tick(2_000_000);
    let refusal = bench.batch(&motion);
    let Some(Refusal::DoesNotFit { seq, quantity: Quantity::Workspace, joint: 0, .. }) = refusal else {
        panic!("{refusal:?}")
    };
    assert_eq!(seq as usize, first + 1);
}

fn works<const N: usize>() {
    for (sample_ns, tick_ns) in [(2_000_000, 2_000_000), (8_000_000, 1_000_000), (7_000_000, 1_000_000)] {
        plays::<N>(sample_ns, tick_ns);
    }
    refuses::<N>();
    stays_inside::<N>();
}

#[test]
fn three_to_nine_joints_are_played_and_judged_each_by_its_own_limits() {
    works::<3>();
    works::<4>();
    works::<5>();
    works::<6>();
    works::<7>();
    works::<8>();
    works::<9>();
    assert_eq!(JOINTS_MAX, 9);
}
