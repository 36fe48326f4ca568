//! Calls into the kernel, one of each kind that a cycle can hold, with their names: the same calls in the same order whenever
//! it runs, so that a profiler's counts can be matched to them.

use screed_kernel::frame::{self, BatchPart, FRAME_MAX, ModeCode, ToKernel, WIRE_MAX};
use screed_kernel::ramp::{Ramp, RampLimits};
use screed_kernel::setpoint::{Coder, Setpoint};
use screed_kernel::tick::{Command, RECEIVE_MAX, Sensors};
use screed_kernel::units::{JointPos, Nanos};
use screed_tape::cell::{self, SAMPLES_NS, TICK_NS, TapeKernel};
use screed_tape::motion::{JOINTS, Motion, Shape};
use screed_tape::{SEED, Tape};

/// A call that was measured.
#[derive(Clone, Debug)]
pub struct Call {
    /// What kind of call.
    pub class: &'static str,
    /// Which of its kind.
    pub what: String,
    /// Bytes that went in or out.
    pub bytes: usize,
}

/// The three functions of the kernel, each in a frame of its own that a profiler can find by name.
pub mod measured {
    use screed_kernel::tick::{Command, Sensors};
    use screed_kernel::units::Nanos;
    use screed_tape::cell::TapeKernel;
    use screed_tape::motion::JOINTS;

    /// [`screed_kernel::tick::Kernel::receive`]
    #[inline(never)]
    pub fn receive(kernel: &mut TapeKernel, bytes: &[u8]) -> usize {
        kernel.receive(bytes)
    }

    /// [`screed_kernel::tick::Kernel::tick`]
    #[inline(never)]
    pub fn tick(kernel: &mut TapeKernel, now: Nanos, sensors: &Sensors<JOINTS>) -> Command<JOINTS> {
        kernel.tick(now, sensors)
    }

    /// [`screed_kernel::tick::Kernel::poll_transmit`]
    #[inline(never)]
    pub fn transmit(kernel: &mut TapeKernel, out: &mut [u8]) -> usize {
        kernel.poll_transmit(out)
    }
}

/// A kernel with a robot that follows perfectly, and the list of what was called.
pub struct Scenario {
    kernel: Box<TapeKernel>,
    now: Nanos,
    actual: JointPos<JOINTS>,
    calls: Vec<Call>,
}

/// Setpoints in a frame, as the host packs them.
const PER_PART: usize = 38;

/// Runs all of it.
pub fn run() -> Vec<Call> {
    let mut scenario = Scenario::new(SAMPLES_NS[0]);
    scenario.ticks("holding", 200);
    scenario.motion(1.0);
    scenario.ticks("motion at 100 %", 1000);
    scenario.ticks("holding", 400);
    scenario.motion(0.73);
    scenario.ticks("motion interpolated", 1000);
    scenario.say(&ToKernel::Stop);
    scenario.ticks("stopping", 600);
    scenario.fault();
    scenario.corrected();
    scenario.full_budgets();
    let mut calls = scenario.calls;
    let mut slower = Scenario::new(SAMPLES_NS[2]);
    slower.motion(1.0);
    slower.ticks("motion interpolated", 2000);
    calls.append(&mut slower.calls);
    slower.tape(20_000);
    calls.append(&mut slower.calls);
    calls
}

/// Plays motions at 100 %, so many cycles in all, without keeping what was called. For a wall clock.
pub fn stream(cycles: u32) {
    let mut scenario = Scenario::new(SAMPLES_NS[0]);
    let mut out = [0; 256];
    for cycle in 0..cycles {
        if cycle.is_multiple_of(1100) {
            scenario.motion(1.0);
            scenario.calls.clear();
        }
        let command = scenario.cycle(scenario.actual, None);
        scenario.follow(&command);
        measured::transmit(&mut scenario.kernel, &mut out);
    }
}

impl Scenario {
    /// Configured for setpoints so far apart, and holding.
    fn new(sample_ns: u64) -> Self {
        let actual = JointPos([0.1, -0.7, 0.9, -0.4, 0.6, 0.2]);
        let mut scenario = Self { kernel: Box::new(cell::kernel()), now: Nanos(0), actual, calls: vec![] };
        scenario.say(&ToKernel::Configure(cell::configure(sample_ns)));
        scenario.ticks("holding", 10);
        scenario
    }

    /// One measured tick with these sensors.
    fn cycle(&mut self, actual: JointPos<JOINTS>, correction: Option<JointPos<JOINTS>>) -> Command<JOINTS> {
        self.now = self.now.plus(TICK_NS);
        let sensors = Sensors { correction, estimate: correction.map(|_| actual), ..cell::sensors(actual, true) };
        measured::tick(&mut self.kernel, self.now, &sensors)
    }

    /// A motion with an estimate and a correction that grows as fast as it may.
    fn corrected(&mut self) {
        self.motion(0.73);
        let limits = RampLimits {
            slope_max: 0.9 * cell::CORRECTION.velocity_max,
            curvature_max: 0.9 * cell::CORRECTION.acceleration_max,
        };
        let mut ramp = Ramp::at(0.0);
        for k in 1..=600 {
            ramp.step(0.9 * cell::CORRECTION.size_max, &limits, TICK_NS as f64 * 1e-9);
            let command = self.cycle(self.actual, Some(JointPos([ramp.value; JOINTS])));
            self.calls.push(Call { class: "motion corrected", what: format!("tick {k}"), bytes: 0 });
            self.follow(&command);
            self.transmit();
        }
        assert!(self.kernel.status().fault.is_none(), "the scenario's correction is not taken");
        self.say(&ToKernel::Stop);
        self.ticks("stopping", 1000);
    }

    fn receive(&mut self, class: &'static str, what: &str, bytes: &[u8]) {
        let taken = measured::receive(&mut self.kernel, bytes);
        self.calls.push(Call { class, what: what.to_owned(), bytes: taken });
    }

    fn ticks(&mut self, class: &'static str, count: u32) {
        for k in 1..=count {
            self.tick(class, &format!("tick {k}"));
        }
    }

    fn tick(&mut self, class: &'static str, what: &str) {
        let command = self.cycle(self.actual, None);
        self.calls.push(Call { class, what: what.to_owned(), bytes: 0 });
        self.follow(&command);
        self.transmit();
    }

    fn follow(&mut self, command: &Command<JOINTS>) {
        if let Some(joints) = command.joints {
            self.actual = joints;
        }
    }

    fn transmit(&mut self) {
        let mut out = [0; 4096];
        let bytes = measured::transmit(&mut self.kernel, &mut out);
        let what = if bytes == 0 { "nothing waits" } else { "answers wait" };
        self.calls.push(Call { class: "answers out", what: what.to_owned(), bytes });
    }

    fn say(&mut self, message: &ToKernel) {
        let name = format!("{message:?}");
        let name: String = name.chars().take_while(|c| c.is_alphanumeric()).collect();
        let bytes = encode(message);
        self.receive("single message in", &name, &bytes);
    }

    /// Fills the ring with a motion of a thousand setpoints from where the robot is, one frame a tick, and begins to play it.
    fn motion(&mut self, rate: f64) {
        let status = self.kernel.status();
        let start = self.actual;
        let side = if start.0[0] > 0.0 { -1.0 } else { 1.0 };
        let goal = JointPos([0.3, 0.25, 0.2, -0.3, 0.1, -0.2].map(|q| side * q));
        let first_seq = status.end_seq + 1;
        let motion = Motion { start, goal, shape: Shape::Sweep, samples: 1000, brake: None, flow: 2e-5, first_seq };
        let setpoints: Vec<_> = (1..=motion.count()).map(|k| motion.sample(k)).collect();
        for part in parts(first_seq, &setpoints, PER_PART) {
            self.receive("batch frame in", &format!("{PER_PART} setpoints a frame"), &part);
            self.tick("holding", "while a batch comes in");
        }
        self.say(&ToKernel::Rate(rate));
        let epoch = self.kernel.status().epoch;
        self.say(&ToKernel::Resume { epoch });
        assert_eq!(self.kernel.status().mode, ModeCode::Moving, "the scenario does not move");
    }

    /// A robot that stops following.
    fn fault(&mut self) {
        self.motion(1.0);
        self.ticks("motion at 100 %", 300);
        let stuck = self.actual;
        let mut found = false;
        for k in 1..900 {
            let before = self.kernel.status().fault.is_some();
            self.cycle(stuck, None);
            let after = self.kernel.status().fault.is_some();
            let class = if after { "fault: stopping and after" } else { "motion at 100 %" };
            let what = if after && !before { "the fault is found".to_owned() } else { format!("tick {k}, stuck") };
            found |= after;
            self.calls.push(Call { class, what, bytes: 0 });
            self.transmit();
        }
        assert!(found, "the scenario found no fault");
        let fault = self.kernel.status().fault.map_or(0, |report| report.number);
        self.say(&ToKernel::Rearm { fault });
        self.actual = stuck;
        self.ticks("holding", 100);
    }

    /// As many bytes as a tick may take, of the kinds that make most work.
    fn full_budgets(&mut self) {
        let class = "full budget in";
        let still = Setpoint { joints: self.actual, flow: 0.0, deposit: false };
        let first_seq = self.kernel.status().end_seq + 1;
        let dense: Vec<u8> = parts(first_seq, &vec![still; 1000], 120).concat();
        self.receive(class, "setpoints of 8 bytes, all good", budget(&dense));
        self.tick("holding", "after a full budget");
        let stale = encode(&ToKernel::Rearm { fault: u32::MAX }).repeat(RECEIVE_MAX);
        self.receive(class, "shortest messages, each refused", budget(&stale));
        self.tick("holding", "after a full budget, outbox full");
        let hello = encode(&ToKernel::Hello).repeat(RECEIVE_MAX);
        self.receive(class, "shortest messages, each obeyed", budget(&hello));
        self.tick("holding", "after a full budget");
        self.receive(class, "zeros", &[0; RECEIVE_MAX]);
        self.tick("holding", "after a full budget");
        self.receive(class, "ones, never a zero", &[1; RECEIVE_MAX]);
        self.tick("holding", "after a full budget");
        self.receive("single message in", "end of an endless frame", &[0]);
        self.receive(class, "shortest broken frames", &[1, 0].repeat(RECEIVE_MAX / 2));
        self.tick("holding", "after a full budget");
        let mut broken = vec![0xff; FRAME_MAX - 40];
        broken.push(0);
        self.receive(class, "longest broken frames", budget(&broken.repeat(3)));
        self.tick("holding", "after a full budget");
    }

    /// The first ticks of the tape.
    fn tape(&mut self, ticks: u64) {
        *self.kernel = cell::kernel();
        let mut tape = Tape::new(SEED);
        for k in 0..ticks {
            let (now, sensors) = tape.before(&mut self.kernel);
            let command = measured::tick(&mut self.kernel, now, &sensors);
            let what = format!("tick {k} of the tape, {:?}", command.mode.code());
            self.calls.push(Call { class: "tick of the tape", what, bytes: 0 });
            tape.after(&mut self.kernel, &command);
        }
    }
}

fn budget(bytes: &[u8]) -> &[u8] {
    bytes.get(..RECEIVE_MAX).unwrap_or(bytes)
}

fn encode(message: &ToKernel) -> Vec<u8> {
    let mut out = vec![0; WIRE_MAX];
    let used = frame::encode(message, &mut out).expect("the messages here are short");
    out.truncate(used);
    out
}

/// A batch as frames.
fn parts(first_seq: u32, setpoints: &[Setpoint<JOINTS>], per_part: usize) -> Vec<Vec<u8>> {
    let mut coder = Coder::new();
    let count = setpoints.chunks(per_part).len();
    let mut seq = first_seq;
    let mut frames = Vec::with_capacity(count);
    for (k, part) in setpoints.chunks(per_part).enumerate() {
        let mut code = [0; frame::CODE_MAX];
        let mut used = 0;
        for setpoint in part {
            used += coder.encode(setpoint, &mut code[used..]).expect("the motions here are on the grid");
        }
        frames.push(encode(&ToKernel::Batch(BatchPart {
            batch: first_seq,
            first_seq: seq,
            opens: k == 0,
            commits: k + 1 == count,
            after: None,
            code: &code[..used],
        })));
        seq += part.len() as u32;
    }
    frames
}
