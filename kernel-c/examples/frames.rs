//! Writes the frames that `example/loop.c` plays, and says what it has to say at its end:
//! `cargo run -p screed-kernel-c --example frames -- FILE`.

use screed_kernel::frame::{self, BatchPart, CODE_MAX, ModeCode, ToKernel, WIRE_MAX};
use screed_kernel::setpoint::Coder;
use screed_kernel::units::{JointPos, Nanos};
use screed_tape::cell::{self, TICK_NS, TapeKernel};
use screed_tape::hash::Fnv;
use screed_tape::motion::{JOINTS, Motion, Shape};
use std::error::Error;

/// Where the loop's robot stands.
const START: [f64; JOINTS] = [0.1, -0.7, 0.9, -0.4, 0.6, 0.2];

/// Setpoints in a frame.
const PER_PART: u32 = 38;

/// A loop that runs into this many cycles has not come to rest.
const CYCLES_MAX: u32 = 30_000;

/// The same loop as the one in C, over the kernel itself.
struct Loop {
    kernel: Box<TapeKernel>,
    actual: JointPos<JOINTS>,
    cycles: u32,
    hash: Fnv,
    file: Vec<u8>,
}

impl Loop {
    fn cycle(&mut self, frame: &[u8]) {
        assert_eq!(self.kernel.receive(frame), frame.len(), "a frame is less than a tick takes");
        let now = Nanos(u64::from(self.cycles) * TICK_NS);
        let command = cell::tick(&mut self.kernel, now, &cell::sensors(self.actual, true));
        self.actual = command.joints.unwrap_or(self.actual);
        let joints = command.joints.unwrap_or(JointPos::ZERO);
        joints.0.iter().chain([&command.flow]).for_each(|value| self.hash.number(*value));
        self.kernel.poll_transmit(&mut [0; 1024]);
        self.cycles += 1;
    }

    fn say(&mut self, message: &ToKernel) {
        let mut wire = [0; WIRE_MAX];
        let used = frame::encode(message, &mut wire).expect("the messages here are short");
        self.file.extend_from_slice(&wire[..used]);
        self.cycle(&wire[..used]);
    }

    fn send(&mut self, motion: &Motion) {
        let mut coder = Coder::new();
        let mut first = 1;
        while first <= motion.count() {
            let last = motion.count().min(first + PER_PART - 1);
            let mut code = [0; CODE_MAX];
            let mut used = 0;
            for number in first..=last {
                used += coder.encode(&motion.sample(number), &mut code[used..]).expect("the motion is on the grid");
            }
            let (opens, commits) = (first == 1, last == motion.count());
            let first_seq = motion.first_seq + first - 1;
            self.say(&ToKernel::Batch(BatchPart {
                batch: 1,
                first_seq,
                opens,
                commits,
                after: None,
                code: &code[..used],
            }));
            first = last + 1;
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name the file to write")?;
    let kernel = Box::new(cell::kernel());
    let mut run = Loop { kernel, actual: JointPos(START), cycles: 0, hash: Fnv::new(), file: vec![] };
    run.say(&ToKernel::Configure(cell::configure(TICK_NS)));
    let goal = JointPos([-0.4, -0.3, 0.5, 0.1, 0.2, 0.7]);
    run.send(&Motion {
        start: JointPos(START),
        goal,
        shape: Shape::Sweep,
        samples: 1000,
        brake: None,
        flow: 2e-5,
        first_seq: 1,
    });
    run.say(&ToKernel::Rate(0.8));
    let epoch = run.kernel.status().epoch;
    run.say(&ToKernel::Resume { epoch });
    loop {
        let status = run.kernel.status();
        if status.mode == ModeCode::Holding && status.consumed > 0 && status.consumed == status.end_seq {
            break;
        }
        if run.cycles >= CYCLES_MAX || status.fault.is_some() {
            return Err(format!("the motion was not played: {status:?}").into());
        }
        run.cycle(&[]);
    }
    std::fs::write(&path, &run.file)?;
    println!("setpoints {} cycles {} hash {:016x}", run.kernel.status().consumed, run.cycles, run.hash.0);
    Ok(())
}
