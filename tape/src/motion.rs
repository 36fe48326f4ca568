//! Motions that a host could plan: from rest to rest, as functions of the sample, so that any part can be sent again.

use screed_kernel::setpoint::Setpoint;
use screed_kernel::units::JointPos;

/// Joints of the tape's arm.
pub const JOINTS: usize = 6;

/// How a motion runs over its samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// From start to goal with least jerk: s(u) = u³(10 − 15u + 6u²).
    Sweep,
    /// To the goal and back, s(u) = 64u³(1−u)³; scaled so that the two samples next to the middle lie on the goal and the
    /// path between them a little beyond.
    Hump,
}

/// A motion from rest to rest.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// Where it starts (rad).
    pub start: JointPos<JOINTS>,
    /// Where it leads (rad).
    pub goal: JointPos<JOINTS>,
    /// Shape.
    pub shape: Shape,
    /// Samples from start to end.
    pub samples: u32,
    /// Samples from the start after which it slows down to end early, and samples that this takes.
    pub brake: Option<(u32, u32)>,
    /// Largest flow (m³/s).
    pub flow: f64,
    /// Sequence number of the first sample.
    pub first_seq: u32,
}

/// Samples at the end that stand still.
const STILL: u32 = 3;

impl Motion {
    /// Samples, those that stand still included.
    pub fn count(&self) -> u32 {
        self.brake.map_or(self.samples, |(from, over)| from + over) + STILL
    }

    /// Where it ends at rest.
    pub fn end(&self) -> JointPos<JOINTS> {
        self.sample(self.count()).joints
    }

    /// The sample with this number, 1 for the first.
    pub fn sample(&self, number: u32) -> Setpoint<JOINTS> {
        let last = self.count() - STILL;
        let number = number.min(last);
        let time = match self.brake {
            // Speed falls from 1 to 0 over `over` samples: u − u³ + u⁴/2 has slope 1 and 0, and no curvature at either end.
            Some((from, over)) if number > from => {
                let u = f64::from(number - from) / f64::from(over);
                f64::from(from) + f64::from(over) * (u - u * u * u + 0.5 * u * u * u * u)
            }
            _ => f64::from(number),
        };
        let u = (time / f64::from(self.samples)).min(1.0);
        let share = match self.shape {
            Shape::Sweep => u * u * u * (10.0 - 15.0 * u + 6.0 * u * u),
            Shape::Hump => hump(u) / hump(0.5 - 0.5 / f64::from(self.samples)),
        };
        let mut joints = self.start;
        for (joint, goal) in joints.0.iter_mut().zip(&self.goal.0) {
            *joint += (goal - *joint) * share;
        }
        let flow = if number < last { self.flow * 16.0 * u * u * (1.0 - u) * (1.0 - u) } else { 0.0 };
        Setpoint { joints, flow, deposit: self.flow > 0.0 }
    }
}

fn hump(u: f64) -> f64 {
    let half = u * (1.0 - u);
    64.0 * half * half * half
}
