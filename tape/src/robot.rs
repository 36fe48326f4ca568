//! The tape's robot: follows, and sometimes does not; an estimator and a corrector stand beside it, people move it.

use crate::cell::{CORRECTION, DEVIATION_MAX, FOLLOWING_MAX, POSITION_MAX, TICK_NS};
use crate::motion::JOINTS;
use crate::random::Random;
use screed_kernel::ramp::{Ramp, RampLimits};
use screed_kernel::tick::{Command, Sensors};
use screed_kernel::units::{JointPos, Nanos};

/// What is wrong for some ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trouble {
    Nothing,
    Lagging,
    NotReady,
    NotANumber,
    Deviating,
    Jumping,
}

/// The robot's side of a cycle.
#[derive(Clone, Debug)]
pub struct Robot {
    random: Random,
    now: Nanos,
    actual: JointPos<JOINTS>,
    /// Where it would be without a correction.
    path: JointPos<JOINTS>,
    trouble: Trouble,
    /// The joint it is about, and ticks that it lasts.
    joint: u32,
    ticks: u32,
    /// The correction under way, if there is any: where it stands and where each joint's leads.
    correction: Option<[(Ramp, f64); JOINTS]>,
    /// Whether the kernel still has a correction in its targets.
    corrected: bool,
}

/// A little slower than the kernel allows.
const RAMP: RampLimits =
    RampLimits { slope_max: 0.9 * CORRECTION.velocity_max, curvature_max: 0.9 * CORRECTION.acceleration_max };

impl Robot {
    /// At rest, all well.
    pub fn new(seed: u64) -> Self {
        let actual = JointPos([0.1, -0.7, 0.9, -0.4, 0.6, 0.2]);
        Self {
            random: Random(seed),
            now: Nanos(0),
            actual,
            path: actual,
            trouble: Trouble::Nothing,
            joint: 0,
            ticks: 0,
            correction: None,
            corrected: false,
        }
    }

    /// Where it is on its path (rad): what a batch goes on from.
    pub const fn path(&self) -> &JointPos<JOINTS> {
        &self.path
    }

    /// The next tick's time and sensors.
    pub fn sense(&mut self) -> (Nanos, Sensors<JOINTS>) {
        let late = if self.random.once_in(500) { self.random.below(20_000_000) } else { self.random.below(100_000) };
        self.now = self.now.plus(TICK_NS + u64::from(late));
        self.change_trouble();
        let mut actual = self.near();
        let mut estimate = if self.random.once_in(3) { None } else { Some(self.near()) };
        let mut correction = self.correct();
        let joint = self.joint;
        match self.trouble {
            Trouble::Nothing | Trouble::NotReady => {}
            Trouble::Lagging => shift(&mut actual, joint, 2.0 * FOLLOWING_MAX),
            Trouble::NotANumber => shift(&mut actual, joint, f64::NAN),
            Trouble::Deviating => estimate.iter_mut().for_each(|joints| shift(joints, joint, 2.0 * DEVIATION_MAX)),
            Trouble::Jumping => correction.iter_mut().for_each(|joints| shift(joints, joint, CORRECTION.size_max)),
        }
        (self.now, Sensors { actual, estimate, correction, ready: self.trouble != Trouble::NotReady })
    }

    /// Follows a command. Where nothing is commanded, people may move the arm, also a little out of its limits.
    pub fn follow(&mut self, command: &Command<JOINTS>) {
        self.corrected = command.correction != JointPos::ZERO;
        match command.joints {
            Some(joints) => self.actual = joints,
            None if self.random.once_in(4) => {
                self.actual = JointPos(core::array::from_fn(|_| self.random.between(-1.0, 1.0)));
                if self.random.once_in(10) {
                    let joint = self.random.below(JOINTS as u32);
                    if let Some(position) = self.actual.0.get_mut(joint as usize) {
                        *position = POSITION_MAX + 1e-6;
                    }
                }
            }
            None => {}
        }
        self.path = self.actual;
        for (position, correction) in self.path.0.iter_mut().zip(&command.correction.0) {
            *position -= correction;
        }
    }

    /// Where it is, give or take what an encoder or an estimator errs.
    fn near(&mut self) -> JointPos<JOINTS> {
        let mut joints = self.actual;
        for position in &mut joints.0 {
            *position += self.random.between(-1e-4, 1e-4);
        }
        joints
    }

    fn change_trouble(&mut self) {
        if self.ticks > 0 {
            self.ticks -= 1;
            return;
        }
        let (trouble, most) = match self.random.below(5000) {
            0 => (Trouble::Lagging, 40),
            1 => (Trouble::NotReady, 300),
            2 => (Trouble::NotANumber, 1),
            3 => (Trouble::Deviating, 40),
            4 => (Trouble::Jumping, 1),
            _ => (Trouble::Nothing, 1),
        };
        self.trouble = trouble;
        self.joint = self.random.below(JOINTS as u32);
        self.ticks = self.random.below(most);
    }

    /// Offsets that wander inside their limits for a while; none at other times.
    fn correct(&mut self) -> Option<JointPos<JOINTS>> {
        if self.random.once_in(400) {
            let wanders = self.correction.is_some() || !self.corrected;
            let bound = 0.9 * CORRECTION.size_max;
            let begun = self.correction.unwrap_or([(Ramp::at(0.0), 0.0); JOINTS]);
            self.correction = (wanders && !self.random.once_in(4))
                .then(|| begun.map(|(ramp, _)| (ramp, self.random.between(-bound, bound))));
        }
        // The kernel lets go of corrections on a fault; they begin again at none.
        let dropped = self.correction.is_some_and(|ramps| ramps.iter().any(|(ramp, _)| ramp.value != 0.0));
        if dropped && !self.corrected {
            self.correction = None;
        }
        let ramps = self.correction.as_mut()?;
        let mut offsets = JointPos::ZERO;
        for (offset, (ramp, target)) in offsets.0.iter_mut().zip(ramps) {
            ramp.step(*target, &RAMP, TICK_NS as f64 * 1e-9);
            *offset = ramp.value;
        }
        Some(offsets)
    }
}

fn shift(joints: &mut JointPos<JOINTS>, joint: u32, by: f64) {
    if let Some(position) = joints.0.get_mut(joint as usize) {
        *position += by;
    }
}
