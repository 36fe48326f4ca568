//! Calls into the kernel, one of each kind that a cycle can hold, with their names: the same calls in the same order whenever
//! it runs, so that a profiler's counts can be matched to them.

use screed_kernel::frame::{self, BatchPart, FRAME_MAX, ModeCode, ToKernel, WIRE_MAX};
use screed_kernel::setpoint::{Coder, Setpoint};
use screed_kernel::tick::{Command, RECEIVE_MAX};
use screed_kernel::units::JointPos;
use screed_tape::cell::{self, TapeKernel};
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
    use screed_tape::cell::TapeKernel;
    use screed_tape::motion::JOINTS;

    /// [`screed_kernel::tick::Kernel::receive`]
    #[inline(never)]
    pub fn receive(kernel: &mut TapeKernel, bytes: &[u8]) -> usize {
        kernel.receive(bytes)
    }

    /// [`screed_kernel::tick::Kernel::tick`]
    #[inline(never)]
    pub fn tick(kernel: &mut TapeKernel, sensors: &Sensors<JOINTS>) -> Command<JOINTS> {
        kernel.tick(sensors)
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
    actual: JointPos<JOINTS>,
    calls: Vec<Call>,
}

/// Setpoints in a frame, as the host packs them.
const PER_PART: u32 = 60;

/// Runs all of it.
pub fn run() -> Vec<Call> {
    let mut scenario = Scenario {
        kernel: Box::new(cell::kernel()),
        actual: JointPos([0.1, -0.7, 0.9, -0.4, 0.6, 0.2]),
        calls: vec![],
    };
    scenario.say(&ToKernel::Configure(cell::configure()));
    scenario.ticks("holding", 200);
    scenario.motion(1.0);
    scenario.ticks("motion at 100 %", 1000);
    scenario.ticks("holding", 400);
    scenario.motion(0.73);
    scenario.ticks("motion interpolated", 1000);
    scenario.say(&ToKernel::Stop);
    scenario.ticks("stopping", 600);
    scenario.ticks("holding", 200);
    scenario.fault();
    scenario.full_budgets();
    scenario.tape(20_000);
    scenario.calls
}

/// Plays motions at 100 % without measuring calls: so many ticks in so many calls of whole cycles. For a wall clock.
pub fn stream(cycles: u32) {
    let mut scenario = Scenario { kernel: Box::new(cell::kernel()), actual: JointPos([0.1; JOINTS]), calls: vec![] };
    scenario.say(&ToKernel::Configure(cell::configure()));
    let sensors = cell::sensors(scenario.actual, true);
    scenario.kernel.tick(&sensors);
    let mut out = [0; 256];
    let mut done = 0;
    while done < cycles {
        scenario.motion(1.0);
        scenario.calls.clear();
        for _ in 0..1100 {
            let sensors = cell::sensors(scenario.actual, true);
            let command = measured::tick(&mut scenario.kernel, &sensors);
            scenario.follow(&command);
            measured::transmit(&mut scenario.kernel, &mut out);
            done += 1;
        }
    }
}

impl Scenario {
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
        let sensors = cell::sensors(self.actual, true);
        let command = measured::tick(&mut self.kernel, &sensors);
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
        for part in parts(first_seq, &setpoints, PER_PART as usize) {
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
            let sensors = cell::sensors(stuck, true);
            measured::tick(&mut self.kernel, &sensors);
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
        let dense: Vec<u8> = parts(first_seq, &vec![still; 1000], 245).concat();
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
            let sensors = tape.before(&mut self.kernel);
            let command = measured::tick(&mut self.kernel, &sensors);
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
