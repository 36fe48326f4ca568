//! Joint limits, judged on the setpoints themselves: differences over samples, as the robot sees them.

use super::error::JointQuantity;
use super::stream::Setpoint;
use crate::config::Robot;
use screed_kernel::setpoint::JOINT_QUANTUM;
use screed_kernel::units::JointPos;

/// A joint limit that a setpoint breaks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Broken {
    /// The joint, from 0.
    pub joint: usize,
    /// What of it.
    pub quantity: JointQuantity,
    /// How much (rad/s, rad/s², rad/s³).
    pub found: f64,
    /// The limit.
    pub limit: f64,
}

/// Follows setpoints and judges each against the ones before.
#[derive(Clone, Debug)]
pub struct JointCheck<'a> {
    robot: &'a Robot,
    rate: f64,
    /// The last three joint targets, latest first.
    last: [JointPos<6>; 3],
}

impl<'a> JointCheck<'a> {
    /// At rest at `start`, with `rate` setpoints a second.
    pub fn new(robot: &'a Robot, rate: f64, start: &JointPos<6>) -> Self {
        Self { robot, rate, last: [*start; 3] }
    }

    /// The next setpoint.
    ///
    /// # Errors
    /// The first limit that it breaks. Rounding to the grid of [`JOINT_QUANTUM`] is allowed for: half of it a sample.
    pub fn follow(&mut self, setpoint: &Setpoint) -> Result<(), Broken> {
        let (rate, quantum) = (self.rate, JOINT_QUANTUM);
        let [b, c, d] = &self.last;
        for joint in 0..6 {
            let (a, b, c, d) = (setpoint.joints.0[joint], b.0[joint], c.0[joint], d.0[joint]);
            let differences = [
                (JointQuantity::Velocity, a - b, rate, self.robot.joint_velocity_max.0[joint], quantum),
                (
                    JointQuantity::Acceleration,
                    a - 2.0 * b + c,
                    rate.powi(2),
                    self.robot.joint_acceleration_max.0[joint],
                    2.0 * quantum,
                ),
                (
                    JointQuantity::Jerk,
                    (a - d) - 3.0 * (b - c),
                    rate.powi(3),
                    self.robot.joint_jerk_max.0[joint],
                    4.0 * quantum,
                ),
            ];
            for (quantity, difference, per, limit, rounding) in differences {
                let found = difference * per;
                if found.is_nan() || found.abs() > limit + rounding * per {
                    return Err(Broken { joint, quantity, found, limit });
                }
            }
        }
        self.last = [setpoint.joints, self.last[0], self.last[1]];
        Ok(())
    }
}
