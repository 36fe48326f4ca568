//! What the host of a course says: a configuration, batches, commands, and what makes a kernel work hardest for nothing.

use super::Course;
use crate::random::Random;
use screed_kernel::frame::{self, BatchPart, CODE_MAX, ToKernel, WIRE_MAX};
use screed_kernel::setpoint::{Coder, Setpoint};
use screed_kernel::tick::RECEIVE_MAX;
use screed_kernel::units::JointPos;

/// Samples at the end of a motion that stand still.
const STILL: u32 = 3;

/// A motion from rest to rest with least jerk: s(u) = u³(10 − 15u + 6u²).
#[derive(Clone, Copy, Debug)]
pub(super) struct Sweep<const N: usize> {
    pub start: JointPos<N>,
    pub goal: JointPos<N>,
    pub samples: u32,
    pub deposit: bool,
}

impl<const N: usize> Sweep<N> {
    /// Samples, those that stand still included.
    pub fn count(&self) -> u32 {
        self.samples + STILL
    }

    /// The sample with this number, 1 for the first.
    pub fn sample(&self, number: u32) -> Setpoint<N> {
        let u = f64::from(number.min(self.samples)) / f64::from(self.samples);
        let share = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let mut joints = self.start;
        for (joint, goal) in joints.0.iter_mut().zip(&self.goal.0) {
            *joint += (goal - *joint) * share;
        }
        let flows = self.deposit && number < self.samples;
        Setpoint { joints, flow: if flows { 16e-6 * u * (1.0 - u) } else { 0.0 }, deposit: self.deposit }
    }
}

/// The bytes for one tick.
pub(super) struct Line {
    pub bytes: [u8; WIRE_MAX],
    pub len: usize,
}

impl Line {
    pub const fn new() -> Self {
        Self { bytes: [0; WIRE_MAX], len: 0 }
    }

    pub fn take(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&[])
    }

    pub fn say(&mut self, message: &ToKernel) {
        self.len = frame::encode(message, &mut self.bytes).unwrap_or(0);
    }

    /// The next part of a motion, up to so many setpoints; returns the sample that comes next, and whether the batch is whole.
    pub fn part<const N: usize>(
        &mut self,
        sweep: &Sweep<N>,
        coder: &mut Coder<N>,
        next: u32,
        first_seq: u32,
        most: u32,
    ) -> (u32, bool) {
        let mut code = [0; CODE_MAX];
        let (mut used, mut sample) = (0, next);
        while sample <= sweep.count() && sample < next.saturating_add(most) {
            let room = code.get_mut(used..).unwrap_or(&mut []);
            let before = *coder;
            match coder.encode(&sweep.sample(sample), room) {
                Ok(length) => used += length,
                Err(_) => {
                    *coder = before;
                    break;
                }
            }
            sample += 1;
        }
        let commits = sample > sweep.count();
        self.say(&ToKernel::Batch(BatchPart {
            batch: first_seq,
            first_seq: first_seq + next - 1,
            opens: next == 1,
            commits,
            after: None,
            code: code.get(..used).unwrap_or(&[]),
        }));
        (sample, commits)
    }

    /// A whole budget of what is repeated.
    fn repeat(&mut self, message: &ToKernel) {
        self.say(message);
        let once = self.len.max(1);
        for at in once..RECEIVE_MAX {
            let byte = self.bytes.get(at - once).copied().unwrap_or(0);
            if let Some(slot) = self.bytes.get_mut(at) {
                *slot = byte;
            }
        }
        self.len = RECEIVE_MAX;
    }

    fn fill(&mut self, mut byte: impl FnMut(usize) -> u8) {
        self.bytes.iter_mut().enumerate().for_each(|(at, slot)| *slot = byte(at));
        self.len = RECEIVE_MAX;
    }

    /// What a host says beside its work, by the course: nothing, or as many bytes as a tick takes of one of the kinds that make most
    /// work.
    pub fn burden(&mut self, course: &Course, random: &mut Random) {
        match course.0[23] % 16 {
            0 => self.fill(|_| 0),
            1 => self.fill(|_| 1),
            2 => self.fill(|at| (at % 2) as u8),
            3 => self.repeat(&ToKernel::Rearm { fault: u32::MAX }),
            4 => self.repeat(&ToKernel::Hello),
            5 => self.repeat(&ToKernel::Rate(2.0)),
            // The longest frames, their check sum wrong.
            6 => self.fill(|at| if (at + 1).is_multiple_of(1000) { 0 } else { 0xff }),
            7 => self.fill(|_| random.below(256) as u8),
            8 => {
                // One message with one bit that is wrong.
                self.say(&ToKernel::Resume { epoch: 1 });
                let at = random.below(self.len as u32) as usize;
                if let Some(byte) = self.bytes.get_mut(at) {
                    *byte ^= 1 << random.below(8);
                }
            }
            9 => {
                // A batch that fits nowhere.
                let code = [0; CODE_MAX];
                let part =
                    BatchPart { batch: 1, first_seq: 1, opens: true, commits: true, after: Some(0), code: &code };
                self.say(&ToKernel::Batch(part));
            }
            _ => self.len = 0,
        }
    }
}
