//! A kernel at the end of a serial line: what a board does in each period of its own clock, without registers and interrupts.
//!
//! The host speaks with it as with `screed-rt`, in the same frames (docs/frames.md). What is a board's own, its clock, its bytes
//! and its output, stands in `board/mps2.rs`; docs/porting-board.md is about writing it.
#![no_std]
#![forbid(unsafe_code)]

use screed_kernel::arm::Arm;
use screed_kernel::frame::{self, CycleRecord, FromKernel, JointValues};
use screed_kernel::tick::{Command, Kernel, RECEIVE_MAX, Sensors, TRANSMIT_MAX};
use screed_kernel::units::{JointPos, Nanos};

/// Setpoints the ring holds: 8 s at 500 Hz.
pub const RING: usize = 4096;

/// Time between ticks before the host has named one (ns).
pub const PERIOD_NS: u64 = 8_000_000;

/// Most bytes of the host that one cycle takes.
pub const BYTES_MAX: usize = RECEIVE_MAX;

/// Cycles between two messages that say what is at the end of the line: a serial line does not tell when a host has come.
const GREETING_INTERVAL: u64 = 125;

/// The robot or drives, as a cycle finds them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drives<const N: usize> {
    /// Where the joints are (rad or m).
    pub actual: JointPos<N>,
    /// Whether they take setpoints.
    pub ready: bool,
}

/// The kernel, and what it has to tell the host of each cycle.
pub struct Node<const N: usize> {
    kernel: Kernel<N, RING>,
    name: &'static str,
    record: Option<CycleRecord>,
}

impl<const N: usize> Node<N> {
    /// Unconfigured.
    pub const fn new(arm: &Arm<N>) -> Self {
        Self { kernel: Kernel::new(arm), name: arm.name, record: None }
    }

    /// Time until the next cycle (ns): the configuration's.
    pub fn period_ns(&self) -> u64 {
        self.kernel.tick_period_ns().unwrap_or(PERIOD_NS)
    }

    /// One cycle: takes what came of the host since the last, at most [`BYTES_MAX`] bytes (what is over is lost, as on the line),
    /// and moves on by one period. `begun` is the board's clock, `missed` how many periods went by since the last cycle without
    /// one. Returns what to put out.
    pub fn cycle(&mut self, begun: Nanos, missed: u32, bytes: &[u8], drives: &Drives<N>) -> Command<N> {
        self.kernel.receive(bytes);
        let command = self.kernel.tick(begun, &Sensors::robot(drives.actual, drives.ready));
        let list = |joints: &JointPos<N>| -> JointValues { joints.0.iter().copied().collect() };
        self.record = Some(CycleRecord {
            tick: self.kernel.status().tick,
            received_ns: begun.0,
            ticked_ns: 0,
            sent_ns: 0,
            robot_time: begun.0 as f64 * 1e-9,
            missed,
            seq: command.seq,
            mode: command.mode.code(),
            deposit: command.deposit,
            rate: command.rate,
            flow: command.flow,
            commanded: command.joints.as_ref().map(list).unwrap_or_default(),
            actual: list(&drives.actual),
        });
        command
    }

    /// Closes the cycle: `say` gets whole frames for the host. `ticked` is when the tick was over, `sent` when its command was
    /// put out.
    pub fn report(&mut self, ticked: Nanos, sent: Nanos, mut say: impl FnMut(&[u8])) {
        let mut out = [0; TRANSMIT_MAX];
        let used = self.kernel.poll_transmit(&mut out);
        say(out.get(..used).unwrap_or(&[]));
        let Some(record) = self.record.take() else { return };
        let greets = record.tick % GREETING_INTERVAL == 1;
        // Both are far shorter than a frame may be.
        if let Ok(used) =
            frame::encode(&FromKernel::Cycle(CycleRecord { ticked_ns: ticked.0, sent_ns: sent.0, ..record }), &mut out)
        {
            say(out.get(..used).unwrap_or(&[]));
        }
        if greets {
            self.greet(&mut out, say);
        }
    }

    /// Says what is at the end of the line: a loop that nothing else interrupts, for this arm.
    fn greet(&self, out: &mut [u8], mut say: impl FnMut(&[u8])) {
        let mut note = heapless::String::new();
        // A name that has no room is left out.
        let _ = note.push_str("board, ").and_then(|()| note.push_str(self.name));
        if let Ok(used) = frame::encode(&FromKernel::Process { realtime: true, note }, out) {
            say(out.get(..used).unwrap_or(&[]));
        }
    }
}

/// Where the simulated arm stands at first (rad): the demo's cell's `start_deg`.
pub const START: JointPos<6> = {
    const DEG: f64 = core::f64::consts::PI / 180.0;
    JointPos([15.0 * DEG, -90.0 * DEG, -90.0 * DEG, -90.0 * DEG, 90.0 * DEG, -30.0 * DEG])
};

/// Drives that follow what they are told with a lag of first order: what stands in for a robot where there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowingDrives<const N: usize>(pub JointPos<N>);

impl<const N: usize> FollowingDrives<N> {
    /// Share of the way to the target that is gone in a period.
    const SHARE: f64 = 0.25;

    /// One period towards the command's target.
    pub fn follow(&mut self, command: &Command<N>) {
        let Some(target) = &command.joints else { return };
        for (actual, target) in self.0.0.iter_mut().zip(&target.0) {
            *actual += Self::SHARE * (target - *actual);
        }
    }
}
