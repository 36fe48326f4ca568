//! Random programs of everything a host, a robot and a bad line can do.

use super::{Bench, Random, configure};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, Configure, ModeCode, Refusal, ToKernel};
use screed_kernel::guard::{Motion, Periods, output_least};
use screed_kernel::ramp::{Ramp, RampLimits};
use screed_kernel::setpoint::{JOINT_QUANTUM, Setpoint, flow_on_grid, joint_on_grid};
use screed_kernel::tick::{Command, Sensors};
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};

const CAP: usize = 512;
const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.02, velocity_max: 0.05, acceleration_max: 0.5 };
/// One joint whose stops are felt most as acceleration, one whose jerks are.
const PLAN: Motion<2> = Motion {
    velocity_max: JointVel([1.5, 1.0]),
    acceleration_max: JointAcc([3.0, 12.0]),
    jerk_max: JointJerk([40.0, 400.0]),
};
/// Sample and tick periods (ns).
const PERIODS_NS: [(u64, u64); 5] = [
    (8_000_000, 8_000_000),
    (8_000_000, 2_000_000),
    (8_000_000, 1_000_000),
    (2_000_000, 2_000_000),
    (6_000_000, 2_000_000),
];

/// Judges outputs by their own differences, against the limits they were configured with. Shares no code with the guard.
#[derive(Clone)]
struct Judge {
    limits: Motion<2>,
    period: f64,
    last: Option<[[f64; 2]; 3]>,
    /// Largest share of each limit that was used: speed, acceleration, jerk.
    used: [f64; 3],
}

impl Judge {
    fn see(&mut self, command: &Command<2>) {
        let Some(JointPos(q)) = command.joints else {
            self.last = None;
            return;
        };
        let [a, b, c] = self.last.unwrap_or([q; 3]);
        let h = self.period;
        for j in 0..2 {
            assert!(q[j].is_finite() && q[j].abs() <= 3.0, "joint {j} at {}", q[j]);
            let differences = [
                ((q[j] - a[j]) / h, self.limits.velocity_max.0[j]),
                ((q[j] - 2.0 * a[j] + b[j]) / (h * h), self.limits.acceleration_max.0[j]),
                ((q[j] - 3.0 * a[j] + 3.0 * b[j] - c[j]) / (h * h * h), self.limits.jerk_max.0[j]),
            ];
            for (k, (value, limit)) in differences.into_iter().enumerate() {
                let rounding = 4.0 * JOINT_QUANTUM / h.powi(k as i32 + 1);
                assert!(value.abs() <= limit + rounding, "joint {j}, difference {}: {value} above {limit}", k + 1);
                self.used[k] = self.used[k].max((value.abs() - rounding) / limit);
            }
        }
        self.last = Some([q, a, b]);
    }
}

/// Motion along which a batch can be left at any sample: speeds that go to random targets as fast as the limits allow.
#[derive(Clone, Copy)]
struct Source {
    q: [f64; 2],
    v: [Ramp; 2],
    flow: f64,
}

impl Source {
    fn at_rest(q: [f64; 2]) -> Self {
        Self { q, v: [Ramp::at(0.0); 2], flow: 0.0 }
    }

    fn step(&mut self, targets: [f64; 2], flow: f64, period: f64) -> Setpoint<2> {
        for (j, target) in targets.into_iter().enumerate() {
            let (slope_max, curvature_max) = (PLAN.acceleration_max.0[j], PLAN.jerk_max.0[j]);
            self.v[j].step(target, &RampLimits { slope_max, curvature_max }, period);
            self.q[j] += self.v[j].value * period;
        }
        self.flow = flow_on_grid(flow);
        Setpoint { joints: JointPos(self.q.map(joint_on_grid)), flow: self.flow, deposit: flow > 0.0 }
    }

    /// Speeds towards random places near the middle, often the highest.
    fn targets(&self, random: &mut Random) -> [f64; 2] {
        std::array::from_fn(|j| {
            let speed = PLAN.velocity_max.0[j] * [1.0, random.between(0.0, 1.0)][random.below(2) as usize];
            if self.q[j] > random.between(-1.0, 1.0) { -speed } else { speed }
        })
    }

    /// A random piece of motion and its stop tail, with the source as it was behind every sample.
    fn batch(mut self, random: &mut Random, period: f64) -> Vec<(Setpoint<2>, Self)> {
        let mut samples = Vec::new();
        for _ in 0..1 + random.below(4) {
            // Now and then every sample has its own targets: then every third difference has its own sign.
            let shaky = random.below(4) == 0;
            let flow = [0.0, 1e-5][random.below(2) as usize];
            let mut targets = self.targets(random);
            for _ in 0..1 + random.below(40) {
                if shaky {
                    targets = self.targets(random);
                }
                samples.push((self.step(targets, flow, period), self));
            }
        }
        while self.v != [Ramp::at(0.0); 2] || self.flow > 0.0 {
            samples.push((self.step([0.0; 2], 0.0, period), self));
        }
        for _ in 0..2 {
            samples.push((self.step([0.0; 2], 0.0, period), self));
        }
        samples
    }
}

/// One program.
struct Program {
    random: Random,
    bench: Bench<CAP>,
    judge: Judge,
    sample: f64,
    epoch: u32,
    /// Where the arm stood when the epoch began, and the setpoint consumed before.
    base: (u32, Source),
    /// What the kernel has taken behind that.
    taken: Vec<(Setpoint<2>, Source)>,
    corrects: bool,
    correction: Option<[Ramp; 2]>,
    last: Command<2>,
    stuck: bool,
    ran: [u32; 12],
}

impl Program {
    fn new(seed: u64) -> Self {
        let mut random = Random(seed);
        let (sample_ns, tick_ns) = PERIODS_NS[random.below(PERIODS_NS.len() as u64) as usize];
        // Without corrections the limits are only what path clock and interpolation need.
        let limits = [CorrectionLimits::NONE, CORRECTION][random.below(2) as usize];
        let configure: Configure = configure(&PLAN, sample_ns, tick_ns, limits);
        let periods = Periods { sample: sample_ns as f64 * 1e-9, tick: tick_ns as f64 * 1e-9 };
        let mut bench = Bench::new(configure);
        let last = bench.tick();
        let judge =
            Judge { limits: output_least(&PLAN, periods, &limits), period: periods.tick, last: None, used: [0.0; 3] };
        Self {
            random,
            epoch: bench.status().epoch,
            bench,
            judge,
            sample: periods.sample,
            corrects: limits != CorrectionLimits::NONE,
            base: (0, Source::at_rest([0.1, 0.2].map(joint_on_grid))),
            taken: Vec::new(),
            correction: None,
            last,
            stuck: false,
            ran: [0; 12],
        }
    }

    fn tick(&mut self) {
        let actual = self.bench.sensors.actual;
        let offsets = self.correction.as_mut().map(|ramps| {
            let target = self.random.between(-0.017, 0.017);
            let tick = self.judge.period;
            let limits = RampLimits { slope_max: 0.049, curvature_max: 0.49 };
            ramps.iter_mut().for_each(|ramp| _ = ramp.step(target, &limits, tick));
            JointPos(ramps.map(|ramp| ramp.value))
        });
        self.bench.sensors.correction = offsets;
        let command = self.bench.tick();
        if self.stuck {
            self.bench.sensors.actual = actual;
        }
        self.see(&command);
    }

    fn see(&mut self, command: &Command<2>) {
        self.judge.see(command);
        if let Some(fault) = command.mode.fault() {
            assert!(!matches!(fault, Fault::Output { .. }), "the last gate had to hold: {fault:?}");
            let told = (self.bench.faults.len() as u32, self.bench.faults.last().copied());
            let present = self.bench.status().fault;
            assert_eq!(told, (present.map_or(0, |report| report.number), present), "each fault is told once");
        }
        let moving = matches!(command.mode.code(), ModeCode::Moving | ModeCode::Stopping);
        let index = (command.seq as usize).wrapping_sub(self.base.0 as usize + 1);
        if let (true, Some(joints), Some((setpoint, _))) = (moving, command.joints, self.taken.get(index)) {
            for j in 0..2 {
                let far = (joints.0[j] - command.correction.0[j] - setpoint.joints.0[j]).abs();
                assert!(far <= PLAN.velocity_max.0[j] * self.sample * 1.1, "away from setpoint {}: {far}", command.seq);
            }
        }
        assert!(moving || command.flow == 0.0);
        if command.joints.is_none() || command.mode.fault().is_some() {
            self.correction = None;
        }
        self.last = *command;
        self.follow_epoch();
    }

    /// When the ring is gone, the next batch starts where the arm rests.
    fn follow_epoch(&mut self) {
        let status = self.bench.status();
        if status.epoch != self.epoch {
            self.epoch = status.epoch;
            let joints = self.last.joints.unwrap_or(self.bench.sensors.actual);
            let path = std::array::from_fn(|j| joints.0[j] - self.last.correction.0[j]);
            self.base = (status.consumed, Source::at_rest(path));
            self.taken.clear();
        }
    }

    fn source(&self, seq: u32) -> Source {
        match (seq - self.base.0).checked_sub(1) {
            Some(index) => self.taken[index as usize].1,
            None => self.base.1,
        }
    }

    /// A batch that the kernel must take unless it is late, has no room, or is not listening; or one that it must not.
    fn send_batch(&mut self, good: bool) {
        self.follow_epoch();
        let status = self.bench.status();
        let end = status.end_seq;
        let appended = self.random.below(3) == 0;
        let after = if appended {
            end
        } else {
            status.consumed + self.random.below(u64::from(end - status.consumed) + 1) as u32
        };
        let source = self.source(after);
        let mut samples = source.batch(&mut self.random, self.sample);
        let mut first_seq = after + 1;
        if !good {
            let at = self.random.below(samples.len() as u64) as usize;
            match self.random.below(3) {
                0 => first_seq += 1 + self.random.below(3) as u32,
                1 => samples[at].0.joints.0[self.random.below(2) as usize] += joint_on_grid(0.02),
                _ => samples.truncate(samples.len() - 3),
            }
        }
        let setpoints: Vec<_> = samples.iter().map(|(setpoint, _)| *setpoint).collect();
        let replaces = (!appended || self.random.below(2) == 0).then_some(after);
        let mut frames = self.bench.frames(first_seq, replaces, &setpoints);
        let spoilt = self.random.below(8) == 0 && self.spoil(&mut frames);
        for frame in &frames {
            let split = self.random.below(frame.len() as u64) as usize;
            self.send(&frame[..split]);
            self.send(&frame[split..]);
            if self.random.below(4) == 0 {
                self.tick();
            }
        }
        if spoilt {
            // A garbled end would take the next frame with it.
            self.send(&[0]);
        }
        self.bench.listen();
        let answer = self.bench.answer();
        let same_ring = self.bench.status().epoch == status.epoch;
        match answer {
            Some(Ok(())) => {
                assert!(good || spoilt, "a bad batch was taken");
                self.taken.truncate((after - self.base.0) as usize);
                self.taken.extend(samples);
                self.ran[0] += 1;
            }
            Some(Err(reason)) if good && !spoilt => {
                // The ring went on, or was dropped, while the parts came in.
                let excused = matches!(reason, Refusal::TooLate | Refusal::Full | Refusal::Mode)
                    || (reason == Refusal::Sequence && !same_ring);
                let now = self.bench.status();
                assert!(excused, "a good batch was refused: {reason:?}, {status:?}, {now:?}");
            }
            Some(Err(_)) => self.ran[1] += 1,
            None => assert!(spoilt, "no answer"),
        }
        self.bench.answers.clear();
    }

    fn send(&mut self, bytes: &[u8]) {
        let mut taken = self.bench.kernel.receive(bytes);
        while taken < bytes.len() {
            self.tick();
            taken += self.bench.kernel.receive(&bytes[taken..]);
        }
    }

    fn say(&mut self, message: &ToKernel) {
        let mut out = [0; frame::WIRE_MAX];
        let used = frame::encode(message, &mut out).unwrap();
        self.send(&out[..used]);
    }

    /// Loses, doubles or garbles one frame.
    fn spoil(&mut self, frames: &mut Vec<Vec<u8>>) -> bool {
        let at = self.random.below(frames.len() as u64) as usize;
        match self.random.below(3) {
            0 => _ = frames.remove(at),
            1 => frames.insert(at, frames[at].clone()),
            _ => {
                let byte = self.random.below(frames[at].len() as u64) as usize;
                frames[at][byte] ^= 1 << self.random.below(8);
            }
        }
        true
    }

    fn run(&mut self, operations: u32) {
        for _ in 0..operations {
            let operation = self.random.below(20);
            self.ran[operation.min(11) as usize] += u32::from(operation > 1);
            match operation {
                0..=4 => self.send_batch(true),
                5 => self.send_batch(false),
                6 => {
                    let rate = [0.0, 1.0, self.random.between(0.2, 1.0)][self.random.below(3) as usize];
                    self.say(&ToKernel::Rate(rate));
                }
                7 => self.say(&ToKernel::Hold),
                8..=11 => self.say(&ToKernel::Resume { epoch: self.bench.status().epoch }),
                12 => self.say(&ToKernel::Stop),
                13 => self.disturb(),
                14 if self.correction.is_some() => self.correction = None,
                14 if !self.corrects => {}
                14 if self.last.correction == JointPos::ZERO && self.last.mode.fault().is_none() => {
                    self.correction = Some([Ramp::at(0.0); 2]);
                }
                _ => {}
            }
            self.recover();
            for _ in 0..self.random.below(120) {
                self.tick();
            }
            if self.random.below(4) == 0 {
                self.end_from_here();
            }
        }
    }

    /// Something goes wrong outside the kernel.
    fn disturb(&mut self) {
        match self.random.below(6) {
            0 => self.stuck = true,
            1 => self.bench.sensors.ready = false,
            2 => self.bench.sensors.actual.0[1] = f64::NAN,
            3 => self.bench.sensors.estimate = Some(JointPos([9.0; 2])),
            4 => {
                // A step in the correction.
                self.bench.sensors.correction = Some(JointPos([0.019, 0.0]));
                let command = self.bench.tick();
                self.correction = None;
                self.see(&command);
            }
            _ => self.bench.kernel.raise(Fault::Extruder),
        }
        for _ in 0..self.random.below(300) {
            self.tick();
        }
        self.stuck = false;
        self.bench.sensors = Sensors { ready: true, estimate: None, ..self.bench.sensors };
        if let Some(joints) = self.last.joints {
            self.bench.sensors.actual = joints;
        } else if !self.bench.sensors.actual.is_finite() {
            self.bench.sensors.actual = JointPos(self.base.1.q);
        }
    }

    /// A person leads out of a fault, now and then with the wrong number first.
    fn recover(&mut self) {
        let Some(report) = self.bench.status().fault else { return };
        if self.bench.status().mode != ModeCode::Faulted || self.random.below(2) == 0 {
            return;
        }
        self.say(&ToKernel::Rearm { fault: report.number + 1 });
        assert_eq!(self.bench.status().mode, ModeCode::Faulted);
        self.say(&ToKernel::Rearm { fault: report.number });
        assert_eq!(self.bench.status().mode, ModeCode::Unready);
        self.judge.last = None;
        self.tick();
    }

    /// From this state, once without another word, once with a stop: at rest in good time, on limits all the way.
    fn end_from_here(&mut self) {
        for stop in [false, true] {
            let (mut bench, mut judge) = (self.bench.clone(), self.judge.clone());
            bench.sensors.correction = None;
            // With a fresh budget the stop is heard at once.
            judge.see(&bench.tick());
            if stop {
                bench.say(&ToKernel::Stop);
            }
            let length = f64::from(bench.status().end_seq - bench.status().consumed) * self.sample;
            // At the lowest rate drawn, the change of rate, the interpolation's samples, the correction's way out.
            let longest = if stop { 1.0 } else { length / 0.2 + 2.0 } + 10.0 * self.sample / 0.2 + 1.5;
            let ticks = (longest / judge.period) as u32;
            let mut standing = 0;
            for tick in 0.. {
                let command = bench.tick();
                judge.see(&command);
                let still = judge.last.is_none_or(|[a, b, _]| a == b) && command.flow == 0.0;
                standing = if still { standing + 1 } else { 0 };
                let settled = !matches!(command.mode.code(), ModeCode::Moving | ModeCode::Stopping)
                    || (bench.status().rate == 0.0 && !stop);
                if standing >= 20 && settled {
                    break;
                }
                assert!(tick < ticks, "not at rest after {longest} s: {:?}", bench.status());
            }
            self.judge.used = std::array::from_fn(|k| judge.used[k].max(self.judge.used[k]));
        }
    }
}

/// Runs a program for every seed, and says what they did.
pub fn programs(seeds: std::ops::Range<u64>) {
    let (mut used, mut ran) = ([0.0_f64; 3], [0_u32; 12]);
    for seed in seeds {
        let mut program = Program::new(seed);
        let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| program.run(25)));
        assert!(ended.is_ok(), "the program of seed {seed}");
        used = std::array::from_fn(|k| used[k].max(program.judge.used[k]));
        ran = std::array::from_fn(|k| ran[k] + program.ran[k]);
    }
    println!(
        "largest share of the output limits used: speed {:.3}, acceleration {:.3}, jerk {:.3}",
        used[0], used[1], used[2]
    );
    println!("batches taken {}, refused {}; operations {:?}", ran[0], ran[1], &ran[2..]);
    assert!(ran.iter().all(|count| *count > 0), "the programs missed something: {ran:?}");
    // The limits are met, not only kept: a smaller sum would not do.
    assert!(used[0] > 0.95 && used[1] > 0.7 && used[2] > 0.5, "{used:?}");
}
