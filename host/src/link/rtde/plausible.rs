//! Whether what the robot says of itself can be true.

use super::error::LinkError;
use super::recipe::RobotState;
use screed_kernel::arm::Arm;
use screed_kernel::units::{JointPos, JointVel};
use std::f64::consts::TAU;

/// A rotation vector is at most half a turn long; some clients write it longer.
const TURN_MAX: f64 = TAU * 1.01;
/// Encoders may read a little beyond the arm's range.
const RANGE_MARGIN: f64 = 1.01;
/// Of a joint that turns without end: what setpoints can hold (rad).
const ENDLESS_MAX: f64 = 1024.0;
/// A joint may measure faster than its limit for a moment, by noise and overshoot.
const SPEED_MARGIN: f64 = 1.5;
/// What encoder noise may add to a step (rad).
const STEP_NOISE: f64 = 1e-3;
/// No UR arm and tool reach farther from the base (m).
const REACH_MAX: f64 = 5.0;
/// A controller closes a connection that lags about ten seconds behind; so no honest gap is longer (s).
const GAP_MAX: f64 = 10.0;
/// A controller is restarted before it runs this long: 30 years (s).
const UPTIME_MAX: f64 = 1e9;
/// Of an arm whose data sheet gives no speeds no speed is impossible.
const UNRATED: JointVel<6> = JointVel([f64::MAX; 6]);

/// Whether states are possible, alone and after the one before.
///
/// RTDE has no checksum: a wrong value that is possible cannot be recognised, here or anywhere. States of program, robot and safety
/// that are not known are possible, as newer software may have more of them: with those the robot takes no setpoints.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plausibility {
    position_max: [f64; 6],
    velocity_max: JointVel<6>,
    last: Option<(f64, JointPos<6>)>,
}

impl Plausibility {
    pub(super) fn new(arm: &Arm<6>) -> Self {
        let mut position_max = [0.0; 6];
        let range = arm.position_min.0.iter().zip(&arm.position_max.0);
        for (limit, (low, high)) in position_max.iter_mut().zip(range) {
            *limit = low.abs().max(high.abs()).min(ENDLESS_MAX) * RANGE_MARGIN;
        }
        Self { position_max, velocity_max: arm.velocity_max.known().unwrap_or(UNRATED), last: None }
    }

    /// Time stamp (s) and joints of the last state.
    pub(super) const fn last(&self) -> Option<(f64, JointPos<6>)> {
        self.last
    }

    /// Checks a state and keeps it for the next check.
    pub(super) fn check(&mut self, state: &RobotState) -> Result<(), LinkError> {
        scalar("timestamp", state.timestamp, 0.0, UPTIME_MAX)?;
        elements("actual_q", &state.actual_q.0, &self.position_max)?;
        elements(
            "actual_qd",
            &state.actual_qd.0,
            &self.velocity_max.0.map(|limit| (limit * SPEED_MARGIN).min(f64::MAX)),
        )?;
        elements("target_q", &state.target_q.0, &self.position_max)?;
        let (reach, turn) = (REACH_MAX, TURN_MAX);
        elements("actual_TCP_pose", &state.actual_tcp_pose, &[reach, reach, reach, turn, turn, turn])?;
        if let Some((timestamp, actual_q)) = self.last {
            let dt = state.timestamp - timestamp;
            if dt <= 0.0 || dt > GAP_MAX {
                return Err(impossible("timestamp step", 0, dt, GAP_MAX));
            }
            let mut step = state.actual_q.0;
            let mut step_max = self.velocity_max.0;
            for (now, before) in step.iter_mut().zip(&actual_q.0) {
                *now -= before;
            }
            for limit in &mut step_max {
                *limit = (*limit * dt * SPEED_MARGIN + STEP_NOISE).min(f64::MAX);
            }
            elements("actual_q step", &step, &step_max)?;
        }
        self.last = Some((state.timestamp, state.actual_q));
        Ok(())
    }
}

fn scalar(field: &'static str, value: f64, min: f64, max: f64) -> Result<(), LinkError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(impossible(field, 0, value, if value < min { min } else { max }))
}

/// NaN is inside no range, so it fails here too.
fn elements(field: &'static str, values: &[f64; 6], limits: &[f64; 6]) -> Result<(), LinkError> {
    for ((element, value), limit) in (0..).zip(values).zip(limits) {
        if !(-limit..=*limit).contains(value) {
            return Err(impossible(field, element, *value, *limit));
        }
    }
    Ok(())
}

const fn impossible(field: &'static str, element: u8, value: f64, limit: f64) -> LinkError {
    LinkError::ImpossibleValue { field, element, value, limit }
}
