//! The tape: from one seed, everything that can happen to the kernel, and the hash of everything it does about it.
//!
//! The same tape is played in debug and release builds, inside the host's real-time program and on another processor, and has
//! to give the same hash everywhere: that is what "the same bits" means here. No clock, no memory from a heap, no file.
//!
//! [`EXPECTED`] changes only with a change of the kernel that is meant to change what it puts out or says, or with a change
//! of the tape itself; `.ci/same_bits` prints the new value, and the commit that changes it says why it did.
#![no_std]
#![forbid(unsafe_code)]

mod base;
pub mod cell;
mod closed;
pub mod hash;
mod host;
mod inverse;
pub mod motion;
pub mod random;
mod registration;
mod robot;
pub mod seen;
pub mod vectors;

use base::Shifting;
use cell::{ARM, TapeKernel};
use closed::Closed;
use hash::Fnv;
use host::Host;
use motion::JOINTS;
use random::Random;
use robot::Robot;
use screed_kernel::fault::Fault;
use screed_kernel::ik;
use screed_kernel::pose::Pose;
use screed_kernel::tick::{Command, Sensors};
use screed_kernel::units::{JointPos, Nanos};
use seen::Seen;

/// Seed of the tape that is compared.
pub const SEED: u64 = 20_260_324;

/// Ticks of the tape that is compared.
pub const TICKS: u64 = 120_000;

/// Ticks of it before the loop is closed.
pub const OPEN_TICKS: u64 = 100_000;

/// Hash of that tape.
pub const EXPECTED: u64 = 0x7910_4654_0d3b_7181;

/// What a run gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Of every bit that was commanded and every byte that was transmitted.
    pub hash: Fnv,
    /// What was met on the way.
    pub seen: Seen,
}

/// A tape that is being played.
#[derive(Clone, Debug)]
pub struct Tape {
    host: Host,
    robot: Robot,
    random: Random,
    base: Shifting,
    /// In the last part of the tape the loop is closed around the kernel.
    closed: Closed,
    ticked: u64,
    outcome: Outcome,
}

impl Tape {
    /// A tape at its beginning.
    pub fn new(seed: u64) -> Self {
        let mut random = Random(seed);
        Self {
            host: Host::new(random.bits()),
            robot: Robot::new(random.bits()),
            random,
            base: Shifting::new(seed),
            closed: Closed::new(seed),
            ticked: 0,
            outcome: Outcome { hash: Fnv::new(), seen: Seen::default() },
        }
    }

    /// What the run gave so far.
    pub const fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    /// What comes before a tick: bytes from the host, events around the kernel. Returns the tick's time and sensors.
    pub fn before(&mut self, kernel: &mut TapeKernel) -> (Nanos, Sensors<JOINTS>) {
        self.host.talk(kernel, self.robot.path(), &mut self.outcome.seen);
        match self.random.below(6000) {
            0 if self.ticked.is_multiple_of(2) => kernel.raise(Fault::Extruder),
            0 => kernel.raise(Fault::Overrun { missed: 20, limit: 10 }),
            1 => kernel.robot_lost(Fault::Link),
            2 => kernel.host_changed(),
            3 => kernel.quit(),
            _ => {}
        }
        let (now, sensors) = self.robot.sense();
        self.ticked += 1;
        if self.is_closed() {
            self.closed.look(now, &sensors.actual);
        }
        (now, sensors)
    }

    /// The tick itself: the kernel's, or that of the loop around it.
    pub fn tick(&mut self, kernel: &mut TapeKernel, now: Nanos, sensors: &Sensors<JOINTS>) -> Command<JOINTS> {
        match self.is_closed() {
            true => self.closed.tick(kernel, now, sensors),
            false => cell::tick(kernel, now, sensors),
        }
    }

    /// Whether the loop is closed at the tick that comes or was last.
    pub const fn is_closed(&self) -> bool {
        self.ticked > OPEN_TICKS
    }

    /// What comes after it: the command and the answers are hashed, the robot follows.
    pub fn after(&mut self, kernel: &mut TapeKernel, command: &Command<JOINTS>) {
        self.outcome.seen.command(command);
        self.hash_command(command);
        self.outcome.hash.integer(u64::from(kernel.may_quit()));
        self.robot.follow(command);
        self.closed.hash(&mut self.outcome.hash);
        self.outcome.seen.closed = self.closed.met;
        if let Some(joints) = &command.joints {
            self.hash_kinematics(joints);
        }
        // Now and then nobody listens, and the outbox fills up.
        if !self.random.once_in(4) {
            let mut out = [0; 700];
            let count = kernel.poll_transmit(&mut out);
            let bytes = out.get(..count).unwrap_or(&[]);
            self.outcome.hash.bytes(bytes);
            self.host.hear(bytes, &mut self.outcome.seen);
        }
    }

    fn hash_command(&mut self, command: &Command<JOINTS>) {
        let hash = &mut self.outcome.hash;
        let Command { joints, path, seq, flow, deposit, rate, correction, mode } = command;
        hash.integer(u64::from(joints.is_some()));
        for position in joints.iter().chain([path, correction]).flat_map(|joints| &joints.0) {
            hash.number(*position);
        }
        hash.integer(u64::from(*seq));
        hash.number(*flow);
        hash.integer(u64::from(*deposit));
        hash.number(*rate);
        hash.integer(mode.code() as u64);
        hash.bytes(mode.fault().map_or("", |fault| fault.code()).as_bytes());
    }

    /// Forward and inverse kinematics of where the arm is, from a seed nearby.
    fn hash_kinematics(&mut self, joints: &JointPos<JOINTS>) {
        let Pose { rotation, translation } = ARM.forward(joints);
        for value in rotation.iter().chain(translation.iter()) {
            self.outcome.hash.number(*value);
        }
        if self.random.once_in(8) {
            self.base.step(joints, &mut self.outcome.hash);
            self.outcome.seen.base = self.base.met;
            let mut seed = *joints;
            for position in &mut seed.0 {
                *position += self.random.between(-0.3, 0.3);
            }
            match ik::ur::nearest(&ARM, &Pose { rotation, translation }, &seed) {
                Ok(found) => found.joints.0.iter().for_each(|position| self.outcome.hash.number(*position)),
                Err(_) => self.outcome.hash.integer(1),
            }
        }
        if self.random.once_in(64) {
            let Outcome { hash, seen } = &mut self.outcome;
            seen.solved(inverse::hash(hash, &mut self.random));
            seen.registered(registration::hash(hash, &mut self.random));
        }
    }
}

/// Plays a tape on a kernel that knows nothing yet.
pub fn play(kernel: &mut TapeKernel, seed: u64, ticks: u64) -> Outcome {
    let mut tape = Tape::new(seed);
    for _ in 0..ticks {
        let (now, sensors) = tape.before(kernel);
        let command = tape.tick(kernel, now, &sensors);
        tape.after(kernel, &command);
    }
    tape.outcome
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::boxed::Box;
    use std::println;

    #[test]
    fn the_tape_meets_everything_and_gives_the_expected_bits() {
        let mut kernel = Box::new(cell::kernel());
        let outcome = play(&mut kernel, SEED, TICKS);
        println!("{}\nhash {:#018x}", outcome.seen, outcome.hash.0);
        assert!(outcome.seen.is_complete());
        assert_eq!(outcome.hash.0, EXPECTED);
    }
}
