//! The last look at a setpoint before it is on the wire: no joint is asked for a step that the arm cannot make in time.

use super::error::LinkError;
use screed_kernel::units::{JointPos, JointVel};

/// By how much a step may be larger than the arm's speed allows: what a path clock and a correction add between samples, and no
/// more. The simulated arm stops at 10 %.
const SPEED_MARGIN: f64 = 0.05;
/// What rounding may add to a step (rad): setpoints lie on a grid of 1.5e-11 rad.
const STEP_ROUNDING: f64 = 1e-9;

/// Judges the step from one setpoint to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepLimit {
    /// Speeds of the arm (rad/s); none where nobody has told them.
    velocity_max: Option<JointVel<6>>,
    /// Time between setpoints (s).
    period: f64,
    /// What was sent last, at which of the robot's time stamps (s).
    last: Option<(f64, JointPos<6>)>,
}

impl StepLimit {
    pub(super) const fn new(velocity_max: Option<JointVel<6>>, rate_hz: u32) -> Self {
        Self { velocity_max, period: 1.0 / rate_hz as f64, last: None }
    }

    pub(super) const fn set_speeds(&mut self, velocity_max: JointVel<6>) {
        self.velocity_max = Some(velocity_max);
    }

    /// Nothing has been sent on this connection.
    pub(super) const fn restart(&mut self) {
        self.last = None;
    }

    /// Judges a setpoint in answer to a state (its time stamp, and where the joints are). The step is from the setpoint before,
    /// in the time between their states; the first one's from where the joints are, in one period.
    ///
    /// # Errors
    /// [`LinkError::StepTooLarge`].
    pub(super) fn check(&self, (now, actual): (f64, &JointPos<6>), joints: &JointPos<6>) -> Result<(), LinkError> {
        let Some(velocity_max) = &self.velocity_max else { return Ok(()) };
        let (then, from) = self.last.as_ref().map_or((now, actual), |(then, last)| (*then, last));
        // By a timer there may be two in a cycle of the robot.
        let within = (now - then).max(self.period);
        for ((joint, (to, from)), speed) in (0..).zip(joints.0.iter().zip(&from.0)).zip(&velocity_max.0) {
            let (step, limit) = (to - from, speed * (1.0 + SPEED_MARGIN) * within + STEP_ROUNDING);
            // Written so that a step that is no number fails.
            if !(-limit..=limit).contains(&step) {
                return Err(LinkError::StepTooLarge { joint, step, limit, within });
            }
        }
        Ok(())
    }

    /// It is on its way.
    pub(super) const fn sent(&mut self, now: f64, joints: &JointPos<6>) {
        self.last = Some((now, *joints));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use screed_kernel::arms::ur::UR10E;

    const AT: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);

    fn moved(joint: usize, by: f64) -> JointPos<6> {
        let mut joints = AT;
        joints.0[joint] += by;
        joints
    }

    #[test]
    fn a_step_is_what_the_arms_speed_allows_in_the_time_between_the_states_and_five_percent() {
        // The data sheet's: 120 deg/s for joints 1 and 2, 180 deg/s for the others.
        let speeds = [120.0, 120.0, 180.0, 180.0, 180.0, 180.0_f64].map(f64::to_radians);
        for rate_hz in [125, 500] {
            let period = 1.0 / f64::from(rate_hz);
            for (joint, speed) in speeds.into_iter().enumerate() {
                for sign in [1.0, -1.0] {
                    let mut limit = StepLimit::new(UR10E.velocity_max.known(), rate_hz);
                    let check = |limit: &StepLimit, now, share: f64, periods: f64| {
                        let joints = moved(joint, sign * speed * period * periods * share);
                        limit.check((now, &AT), &joints)
                    };
                    // The first, from where the joints are.
                    assert_eq!(check(&limit, 41.0, 1.049, 1.0), Ok(()));
                    let found = check(&limit, 41.0, 1.051, 1.0);
                    let Err(LinkError::StepTooLarge { joint: at, step, limit: most, within }) = found else { panic!() };
                    assert_eq!((usize::from(at), within), (joint, period));
                    assert!((step - sign * speed * period * 1.051).abs() < 1e-12);
                    assert!((most - speed * period * 1.05).abs() < 2e-9);
                    // Then from the one before, in one cycle, in ten, and in none.
                    limit.sent(41.0, &AT);
                    for (cycles, periods) in [(1.0, 1.0), (10.0, 10.0), (0.0, 1.0)] {
                        let now = 41.0 + cycles * period;
                        assert_eq!(check(&limit, now, 1.049, periods), Ok(()));
                        assert!(check(&limit, now, 1.051, periods).is_err());
                    }
                }
            }
        }
        let limit = StepLimit::new(UR10E.velocity_max.known(), 500);
        assert!(limit.check((41.0, &AT), &moved(2, f64::NAN)).is_err());
    }

    #[test]
    fn an_arm_without_speeds_is_judged_by_the_cells() {
        let mut limit = StepLimit::new(None, 500);
        assert_eq!(limit.check((41.0, &AT), &moved(0, 1.0)), Ok(()));
        limit.set_speeds(JointVel([1.0; 6]));
        assert!(limit.check((41.0, &AT), &moved(0, 0.0022)).is_err());
        assert_eq!(limit.check((41.0, &AT), &moved(0, 0.002)), Ok(()));
    }
}
