//! Random programs of everything a host, a robot and a bad line can do.

use super::fuzz::envelope;
use super::motion::{CORRECTION, Judge, PERIODS_NS, PLAN, POSITION_MAX, Source};
use super::{Bench, Random, both, configure};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, Configure, ModeCode, Refusal, ToKernel};
use screed_kernel::guard::{Limits, Periods, output_least, plan_limits};
use screed_kernel::ramp::{Ramp, RampLimits};
use screed_kernel::setpoint::{JOINT_QUANTUM, Setpoint, joint_on_grid};
use screed_kernel::tick::{Command, Sensors};
use screed_kernel::units::JointPos;

const CAP: usize = 512;

/// Kinds of operations: batches taken, batches refused, and what else a program does.
const OPERATIONS: usize = 21;

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
    /// How far setpoints may go.
    positions: [f64; 2],
    configure: Configure,
    correction: Option<[Ramp; 2]>,
    last: Command<2>,
    stuck: bool,
    ran: [u32; OPERATIONS],
}

impl Program {
    fn new(seed: u64) -> Self {
        let mut random = Random(seed);
        let (sample_ns, tick_ns) = PERIODS_NS[random.below(PERIODS_NS.len() as u64) as usize];
        // Without corrections the limits are only what path clock and interpolation need.
        let limits = [CorrectionLimits::NONE, CORRECTION][random.below(2) as usize];
        let configure = Configure {
            position_min: both(-POSITION_MAX),
            position_max: both(POSITION_MAX),
            ..configure(&PLAN, sample_ns, tick_ns, limits)
        };
        let periods = Periods { sample: sample_ns as f64 * 1e-9, tick: tick_ns as f64 * 1e-9 };
        let most = JointPos([POSITION_MAX; 2]);
        let least = Limits { position_min: JointPos([-POSITION_MAX; 2]), position_max: most, motion: PLAN };
        let positions = plan_limits(&least, &PLAN, periods, &limits).position_max.0;
        let mut bench = Bench::new(configure.clone());
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
            positions,
            configure,
            base: (0, Source::at_rest([0.1, 0.2].map(joint_on_grid))),
            taken: Vec::new(),
            correction: None,
            last,
            stuck: false,
            ran: [0; OPERATIONS],
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
        assert!(moving || (command.flow == 0.0 && command.rate == 0.0));
        // Nothing flows back, and not more than was asked for.
        assert!((0.0..=1e-5 * (1.0 + 1e-9)).contains(&command.flow), "a flow of {}", command.flow);
        assert!((0.0..=1.0).contains(&command.rate), "a rate of {}", command.rate);
        let status = self.bench.status();
        assert!(status.consumed <= status.end_seq && status.credits <= CAP as u32, "{status:?}");
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
            // A hold or a resume leaves the ring, or the last of what the clock has taken from it.
            let plays = matches!(status.mode, ModeCode::Moving | ModeCode::Stopping);
            if plays || status.end_seq > status.consumed {
                return;
            }
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

    /// Whether setpoints behind `after` keep every limit by their own differences, those before the seam among them, and end at
    /// rest; `None` where the last bits decide. Shares no code with the guard.
    fn fits(&self, after: u32, samples: &[(Setpoint<2>, Source)]) -> Option<bool> {
        let at = |seq: u32| match seq.checked_sub(self.base.0 + 1) {
            Some(index) => self.taken[index as usize].0.joints.0,
            None => self.base.1.q,
        };
        let before = [2, 1, 0].map(|back| at(after.saturating_sub(back).max(self.base.0)));
        let all: Vec<[f64; 2]> = before.into_iter().chain(samples.iter().map(|(s, _)| s.joints.0)).collect();
        let h = self.sample;
        let mut largest = 0.0_f64;
        for (j, position_max) in self.positions.into_iter().enumerate() {
            for w in all.windows(4) {
                let [d, c, b, a] = [w[0][j], w[1][j], w[2][j], w[3][j]];
                let share = |value: f64, limit: f64, order: i32| {
                    value.abs() / (limit * h.powi(order) + f64::from(1 << order) * JOINT_QUANTUM * 0.5)
                };
                let shares = [
                    a.abs() / position_max,
                    share(a - b, PLAN.velocity_max.0[j], 1),
                    share((a - b) - (b - c), PLAN.acceleration_max.0[j], 2),
                    share((a - b) - 2.0 * (b - c) + (c - d), PLAN.jerk_max.0[j], 3),
                ];
                largest = shares.into_iter().fold(largest, f64::max);
            }
        }
        let rests = all.iter().rev().take(3).all(|q| Some(q) == all.last());
        let dry = samples.last().is_some_and(|(last, _)| last.flow == 0.0);
        if (largest - 1.0).abs() < 1e-6 { None } else { Some(largest < 1.0 && rests && dry) }
    }

    /// Moves some of the setpoints by anything from less than a limit to far more.
    fn bend(&mut self, samples: &mut [(Setpoint<2>, Source)]) {
        let size = 10_f64.powf(self.random.between(-11.0, -1.0)) * [1.0, -1.0][self.random.below(2) as usize];
        let (from, j) = (self.random.below(samples.len() as u64) as usize, self.random.below(2) as usize);
        let shape = self.random.below(4) as i32;
        for (k, (setpoint, source)) in samples[from..].iter_mut().enumerate() {
            let by = joint_on_grid(match shape {
                3 => [size, 0.0][usize::from(k > 0)],
                order => size * (k as f64 / 10.0).min(10.0).powi(order),
            });
            setpoint.joints.0[j] += by;
            source.q[j] += by;
        }
    }

    /// A batch that the kernel must take unless it is late, has no room, or is not listening; or one that may be anything.
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
            match self.random.below(6) {
                0 => first_seq += 1 + self.random.below(3) as u32,
                1 => samples.truncate(at + 1),
                _ => self.bend(&mut samples),
            }
        }
        let fits = self.fits(after, &samples).map(|fits| fits && first_seq == after + 1);
        let setpoints: Vec<_> = samples.iter().map(|(setpoint, _)| *setpoint).collect();
        let replaces = (!appended || self.random.below(2) == 0).then_some(after);
        let mut frames = self.bench.frames(first_seq, replaces, &setpoints);
        let mut spoilt = self.random.below(8) == 0 && self.spoil(&mut frames);
        if self.random.below(30) == 0 && frames.len() > 1 {
            // Out of order: no part is taken in another's place.
            let at = self.random.below(frames.len() as u64 - 1) as usize;
            frames.swap(at, at + 1);
            spoilt = true;
        }
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
                assert_ne!(fits, Some(false), "a bad batch was taken");
                self.taken.truncate((after - self.base.0) as usize);
                self.taken.extend(samples);
                self.ran[0] += 1;
            }
            Some(Err(reason)) if fits == Some(true) && !spoilt => {
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
            let operation = self.random.below(OPERATIONS as u64);
            self.ran[operation as usize] += u32::from(operation > 1);
            match operation {
                0..=3 => self.send_batch(true),
                4 | 5 => self.send_batch(false),
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
                15 => self.flutter(),
                16 => self.say(&ToKernel::Configure(self.configure.clone())),
                17 => self.nonsense(),
                18 => {
                    // What waits is not for the next host: a fault told then is in its first status.
                    self.bench.listen();
                    self.bench.kernel.host_changed();
                }
                19 if self.random.below(4) == 0 => self.lose_robot(),
                20 => self.say(&ToKernel::Hello),
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

    /// Another mind at every tick.
    fn flutter(&mut self) {
        let kind = self.random.below(2);
        for _ in 0..self.random.below(150) {
            if kind == 0 {
                let rate = [0.0, 1.0, self.random.between(0.0, 1.0)][self.random.below(3) as usize];
                self.say(&ToKernel::Rate(rate));
            } else if self.random.below(2) == 0 {
                self.say(&ToKernel::Hold);
            } else {
                self.say(&ToKernel::Resume { epoch: self.bench.status().epoch });
            }
            self.tick();
        }
        self.say(&ToKernel::Rate(1.0));
    }

    /// What is no frame, no message, of a version to come, or speaks of something else: counted or refused, and nothing else.
    fn nonsense(&mut self) {
        let before = self.bench.status();
        let (broken, unknown) = match self.random.below(4) {
            0 => {
                let noise: Vec<u8> = (0..=self.random.below(5000)).map(|_| 1 + self.random.below(255) as u8).collect();
                self.send(&noise);
                self.send(&[0]);
                (1, 0)
            }
            1 => {
                self.send(&envelope(frame::VERSION + 1, &[200, 1, 2, 3]));
                (0, 1)
            }
            2 => {
                self.send(&envelope(frame::VERSION + 0x10, &[6]));
                (1, 0)
            }
            _ => {
                self.say(&ToKernel::Resume { epoch: before.epoch.wrapping_sub(1) });
                let no_rate = [f64::NAN, f64::INFINITY, -1e-300, 1.0 + 1e-15][self.random.below(4) as usize];
                self.say(&ToKernel::Rate(no_rate));
                self.say(&ToKernel::Rearm { fault: u32::MAX });
                (0, 0)
            }
        };
        let after = self.bench.status();
        let counted = (after.frames_broken - before.frames_broken, after.frames_unknown - before.frames_unknown);
        assert_eq!(counted, (broken, unknown));
    }

    fn lose_robot(&mut self) {
        self.bench.kernel.robot_lost(Fault::Link);
        assert!(!matches!(self.bench.status().mode, ModeCode::Holding | ModeCode::Moving | ModeCode::Stopping));
        self.judge.last = None;
        self.correction = None;
        self.tick();
    }

    /// Something goes wrong outside the kernel.
    fn disturb(&mut self) {
        match self.random.below(7) {
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
            5 => {
                self.bench.sensors.correction =
                    Some(JointPos([0.0, [f64::NAN, f64::INFINITY][self.random.below(2) as usize]]));
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
    let (mut used, mut ran) = ([0.0_f64; 3], [0_u32; OPERATIONS]);
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
    assert!(used[0] > 0.95 && used[1] > 0.8 && used[2] > 0.65, "{used:?}");
}
