//! The tape's host: says everything a host can say, right and wrong, over a line that garbles some of it.

use crate::cell::{self, SAMPLES_NS, TapeKernel};
use crate::motion::{JOINTS, Motion, Shape};
use crate::random::Random;
use crate::seen::Seen;
use screed_kernel::frame::{
    self, BatchPart, CODE_MAX, FRAME_MAX, FromKernel, ModeCode, Reader, Status, ToKernel, WIRE_MAX,
};
use screed_kernel::setpoint::{CodeError, Coder};
use screed_kernel::units::JointPos;
use serde::Serialize;

/// How a batch is spoilt.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Spoil {
    Nothing,
    /// The batch ends in the middle of the motion.
    Cut,
    /// A byte that no setpoint begins with.
    Code,
    /// The second part says another sequence number than it has.
    Gap,
}

/// Version 2.0, no message, its CRC; in COBS, with the zero at the end.
const FOREIGN: [u8; 7] = [6, 0x20, 0x45, 0xcf, 0x6c, 0xe9, 0];

/// A batch of which some parts have been sent.
#[derive(Clone, Copy, Debug)]
struct Sending {
    motion: Motion,
    /// Sample to send next.
    next: u32,
    after: Option<u32>,
    opens: bool,
    coder: Coder<JOINTS>,
    spoil: Spoil,
}

/// The host's end of the line.
#[derive(Clone, Debug)]
pub struct Host {
    random: Random,
    frame: [u8; WIRE_MAX],
    len: usize,
    sent: usize,
    /// Bytes without a zero still to be sent.
    noise: u32,
    /// Ticks to wait before saying more.
    pause: u32,
    sending: Option<Sending>,
    batch: u32,
    /// From setpoint to setpoint (ns), as said last.
    sample_ns: u64,
    /// The motion that the ring ends with, as far as the host was told.
    plan: Option<Motion>,
    /// The motion of the batch that was sent last.
    offered: Option<Motion>,
    reader: Reader,
}

impl Host {
    /// A host that has said nothing.
    pub fn new(seed: u64) -> Self {
        Self {
            random: Random(seed),
            frame: [0; WIRE_MAX],
            len: 0,
            sent: 0,
            noise: 0,
            pause: 0,
            sending: None,
            batch: 0,
            sample_ns: SAMPLES_NS[0],
            plan: None,
            offered: None,
            reader: Reader::new(),
        }
    }

    /// One tick's worth of talking.
    pub fn talk(&mut self, kernel: &mut TapeKernel, at: &JointPos<JOINTS>, seen: &mut Seen) {
        let mut left = match self.random.below(8) {
            0 => 2 * WIRE_MAX,
            _ => self.random.below(400) as usize,
        };
        self.pause = self.pause.saturating_sub(1);
        while left > 0 {
            if self.sent >= self.len && !self.refill(&kernel.status(), at, seen) {
                return;
            }
            let end = self.len.min(self.sent.saturating_add(left));
            let taken = kernel.receive(self.frame.get(self.sent..end).unwrap_or(&[]));
            seen.bytes += taken as u64;
            self.sent += taken;
            left -= taken.min(left);
            if taken == 0 {
                return;
            }
        }
    }

    /// Hears what the kernel answers.
    pub fn hear(&mut self, bytes: &[u8], seen: &mut Seen) {
        for &byte in bytes {
            let Some(message) = self.reader.push(byte) else { continue };
            match message.and_then(frame::decode::<FromKernel>) {
                Ok(FromKernel::Accepted { batch }) => {
                    seen.accepted += 1;
                    if batch == self.batch {
                        self.plan = self.offered.take();
                    }
                }
                Ok(FromKernel::Refused { batch, reason }) => {
                    seen.refused(&reason);
                    if batch == self.batch {
                        self.sending = None;
                    }
                }
                Ok(FromKernel::Status(status)) => seen.status(&status),
                Ok(FromKernel::Fault(_)) => seen.faults_told += 1,
                Ok(FromKernel::Loop(_)) => seen.loops += 1,
                Ok(_) => {}
                Err(_) => seen.answers_broken += 1,
            }
        }
    }

    /// Puts the next bytes on the line; false when there is nothing to say now.
    fn refill(&mut self, status: &Status, at: &JointPos<JOINTS>, seen: &mut Seen) -> bool {
        (self.len, self.sent) = (0, 0);
        if self.noise > 0 {
            let count = self.noise.min(WIRE_MAX as u32);
            for slot in self.frame.iter_mut().take(count as usize) {
                *slot = self.random.below(255) as u8 + 1;
            }
            (self.noise, self.len) = (self.noise - count, count as usize);
            return true;
        }
        match self.sending.take() {
            Some(sending) => self.say_part(sending, seen),
            None if self.pause > 0 => return false,
            None => self.decide(status, at, seen),
        }
        self.garble();
        true
    }

    /// Some frames lose a byte's worth of truth, some get lost, some follow a piece of something else.
    fn garble(&mut self) {
        match self.random.below(800) {
            0 | 1 => {
                let at = self.random.below(self.len as u32) as usize;
                if let Some(byte) = self.frame.get_mut(at) {
                    *byte ^= 1 << self.random.below(8);
                }
            }
            2 => self.len = self.random.below(self.len as u32) as usize,
            3 => self.sent = self.random.below(self.len as u32) as usize,
            4 => self.noise = self.random.below(2 * FRAME_MAX as u32),
            _ => {}
        }
    }

    fn say(&mut self, message: &impl Serialize, seen: &mut Seen) {
        match frame::encode(message, &mut self.frame) {
            Ok(len) => self.len = len,
            Err(_) => seen.unsaid += 1,
        }
    }

    fn message(&mut self, message: &ToKernel, seen: &mut Seen) {
        seen.said(message);
        self.say(message, seen);
    }

    /// Says something that mostly, but not always, fits where the kernel stands.
    fn decide(&mut self, status: &Status, at: &JointPos<JOINTS>, seen: &mut Seen) {
        let waiting = status.end_seq != status.consumed;
        let moving = status.mode == ModeCode::Moving;
        self.pause = match status.mode {
            ModeCode::Moving | ModeCode::Stopping => self.random.below(240),
            _ => self.random.below(20),
        };
        if !waiting && !moving {
            self.plan = None;
        }
        match (status.mode, self.random.below(40)) {
            (ModeCode::Unready, 0..8) | (_, 0) => self.configure(seen),
            (ModeCode::Holding, 1..8) if !waiting => self.configure(seen),
            (ModeCode::Holding, 8..24) if !waiting => self.batch(status, at, seen),
            (ModeCode::Holding, 1..20) => self.message(&ToKernel::Resume { epoch: status.epoch }, seen),
            (ModeCode::Stopping, 1..10) => self.message(&ToKernel::Resume { epoch: status.epoch }, seen),
            (ModeCode::Faulted, 1..30) => {
                let fault = status.fault.map_or(0, |report| report.number);
                self.message(&ToKernel::Rearm { fault }, seen);
            }
            (_, 24..26) => self.message(&ToKernel::Hold, seen),
            (_, 26) => self.message(&ToKernel::Stop, seen),
            (_, 27..30) => {
                let rate = self.random.between(0.0, 1.3);
                self.message(&ToKernel::Rate(if rate > 1.2 { f64::NAN } else { rate }), seen);
            }
            (_, 30) => self.message(&ToKernel::Resume { epoch: status.epoch.wrapping_add(1) }, seen),
            (_, 31) => self.message(&ToKernel::Rearm { fault: u32::MAX }, seen),
            (_, 32) => self.message(&ToKernel::Hello, seen),
            // A frame of a major version that nobody reads yet.
            (_, 34) if self.random.once_in(2) => {
                self.len = FOREIGN.len();
                self.frame.iter_mut().zip(FOREIGN).for_each(|(slot, byte)| *slot = byte);
            }
            // A message of a later minor version.
            (_, 33) => self.say(&(200_u8, 1000_u32), seen),
            (_, 34) if self.random.once_in(2) => self.message(&ToKernel::Quit, seen),
            _ => self.batch(status, at, seen),
        }
    }

    /// A configuration, every other time with something in it that cannot be.
    fn configure(&mut self, seen: &mut Seen) {
        let sample = SAMPLES_NS.get(self.random.below(SAMPLES_NS.len() as u32) as usize);
        let sample_ns = sample.copied().unwrap_or(self.sample_ns);
        let mut message = cell::configure(sample_ns);
        match self.random.below(20) {
            0 => {
                message.plan.jerk_max.pop();
            }
            1 => message.sample_period_ns += 1,
            2 => message.position_max = message.position_min.clone(),
            3 => message.plan.velocity_max.iter_mut().for_each(|limit| *limit = f64::NAN),
            4 => message.deviation_max = 0.0,
            5 => message.correction.size_max = 0.0,
            6 => message.flange_from_tcp = [f64::INFINITY; 6],
            7 => message.workspace.iter_mut().for_each(|plane| plane.normal_in_base = [2.0, 0.0, 0.0]),
            8 | 9 => message.output = message.plan.clone(),
            _ => self.sample_ns = sample_ns,
        }
        self.message(&ToKernel::Configure(message), seen);
    }

    /// Opens a batch: behind the ring's end, or in place of a part of the last motion, right or wrong.
    fn batch(&mut self, status: &Status, at: &JointPos<JOINTS>, seen: &mut Seen) {
        self.batch = self.batch.wrapping_add(1);
        let spoil = match self.random.below(24) {
            0 => Spoil::Cut,
            1 => Spoil::Code,
            2 => Spoil::Gap,
            _ => Spoil::Nothing,
        };
        let sending = match self.plan {
            Some(plan) if !self.random.once_in(3) => self.replacement(status, plan),
            plan => {
                let start = plan.map_or(*at, |motion| motion.end());
                self.addition(status, start)
            }
        };
        self.offered = Some(sending.motion);
        self.say_part(Sending { spoil, ..sending }, seen);
    }

    fn addition(&mut self, status: &Status, start: JointPos<JOINTS>) -> Sending {
        let mut goal = JointPos(core::array::from_fn(|_| self.random.between(-1.0, 1.0)));
        let mut shape = Shape::Sweep;
        let farthest = |goal: &JointPos<JOINTS>| {
            goal.0.iter().zip(&start.0).map(|(goal, start)| (goal - start).abs()).fold(0.0, f64::max)
        };
        // Highest speed 1.875 Δ/T, acceleration 5.8 Δ/T², jerk 60 Δ/T³; a hump's speed is 3.5 Δ/T.
        let mut seconds = 1.3 * farthest(&goal) + self.random.between(0.3, 0.6);
        match self.random.below(16) {
            0..4 => {
                shape = Shape::Hump;
                goal = start;
                if let Some(joint) = goal.0.get_mut(self.random.below(JOINTS as u32) as usize) {
                    *joint = cell::highest(self.sample_ns);
                }
                seconds = 2.4 * farthest(&goal) + 0.4;
            }
            4 => seconds *= 0.2,
            5 => seconds += 6.0,
            _ => {}
        }
        let samples = (seconds * 1e9 / self.sample_ns as f64) as u32 | 1;
        let first_seq = status.end_seq.wrapping_add(if self.random.once_in(40) { 2 } else { 1 });
        let flow = if self.random.once_in(3) { 0.0 } else { self.random.between(1e-6, 3e-5) };
        let motion = Motion { start, goal, shape, samples, brake: None, flow, first_seq };
        Sending { motion, next: 1, after: None, opens: true, coder: Coder::new(), spoil: Spoil::Nothing }
    }

    /// The same motion from some sample on, or one that ends early.
    fn replacement(&mut self, status: &Status, plan: Motion) -> Sending {
        let after = match self.random.below(8) {
            0 => status.consumed.saturating_sub(self.random.below(10)),
            _ => status.consumed.saturating_add(self.random.below(plan.samples)),
        };
        let after = after.clamp(plan.first_seq, plan.first_seq.saturating_add(plan.count()));
        let kept = after - plan.first_seq + 1;
        let over = 60 + self.random.below(300);
        let brakes = plan.brake.is_none() && kept + over / 2 < plan.samples && !self.random.once_in(3);
        let motion = if brakes { Motion { brake: Some((kept, over)), ..plan } } else { plan };
        Sending { motion, next: kept + 1, after: Some(after), opens: true, coder: Coder::new(), spoil: Spoil::Nothing }
    }

    /// One part of a batch.
    fn say_part(&mut self, mut sending: Sending, seen: &mut Seen) {
        let mut code = [0; CODE_MAX];
        let mut used = 0;
        let first = sending.next;
        let last = match sending.spoil {
            Spoil::Cut => sending.motion.count() / 2,
            _ => sending.motion.count(),
        };
        let until = last.min(first.saturating_add(20 + self.random.below(50)));
        while sending.next <= until {
            // A spoilt batch needs room for one byte more.
            let room = code.get_mut(used..CODE_MAX - 1).unwrap_or(&mut []);
            match sending.coder.encode(&sending.motion.sample(sending.next), room) {
                Ok(length) => used += length,
                Err(CodeError::Short) => break,
                Err(CodeError::Range) => seen.unsaid += 1,
            }
            sending.next += 1;
        }
        if sending.spoil == Spoil::Code
            && let Some(byte) = code.get_mut(used)
        {
            *byte = 7;
            used += 1;
        }
        let number = sending.motion.first_seq.wrapping_add(first - 1);
        let skipped = u32::from(sending.spoil == Spoil::Gap && !sending.opens);
        let commits = sending.next > last;
        let part = BatchPart {
            batch: self.batch,
            first_seq: number.wrapping_add(skipped),
            opens: sending.opens,
            commits,
            after: sending.after.filter(|_| sending.opens),
            code: code.get(..used).unwrap_or(&[]),
        };
        self.message(&ToKernel::Batch(part), seen);
        sending.opens = false;
        if !commits {
            self.sending = Some(sending);
        }
    }
}
