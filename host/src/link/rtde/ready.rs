//! Whether a UR takes setpoints; and if not, why, and what a person does about it.

use super::RobotState;
use crate::link::Telegram;
use std::fmt;

/// Of `runtime_state`.
const PAUSING: u32 = 3;
const PLAYING: u32 = 2;
const PAUSED: u32 = 4;
const RESUMING: u32 = 5;

/// Of `robot_mode`.
const NO_CONTROLLER: i32 = -1;
const DISCONNECTED: i32 = 0;
const CONFIRM_SAFETY: i32 = 1;
const BOOTING: i32 = 2;
const POWER_OFF: i32 = 3;
const POWER_ON: i32 = 4;
const IDLE: i32 = 5;
const BACKDRIVE: i32 = 6;
const RUNNING: i32 = 7;
const UPDATING_FIRMWARE: i32 = 8;

/// Safety bits with which setpoints are taken: normal (0) or reduced (1).
const SAFETY_MOVING: u32 = 0b11;

/// Those that name what stops it: 2 to 9, and the three-position switch (11).
const SAFETY_STOPS: u32 = 0b1011_1111_1100;

/// Why the robot takes no setpoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotReady {
    /// Of its safety system, the gravest: its `safety_status_bits`.
    Safety(u32),
    /// Its `robot_mode`.
    Mode(i32),
    /// Its `runtime_state`.
    Program(u32),
}

impl NotReady {
    /// What keeps the robot from taking setpoints, the gravest first: none where nothing does.
    pub fn of(state: &RobotState) -> Option<Self> {
        let RobotState { robot_mode, safety_status_bits, runtime_state, .. } = *state;
        let moving = safety_status_bits & SAFETY_MOVING != 0;
        if !moving && safety_status_bits & SAFETY_STOPS != 0 {
            Some(Self::Safety(safety_status_bits))
        } else if robot_mode != RUNNING {
            Some(Self::Mode(robot_mode))
        } else if !moving {
            Some(Self::Safety(safety_status_bits))
        } else {
            (runtime_state != PLAYING).then_some(Self::Program(runtime_state))
        }
    }
}

/// Cause and action.
impl fmt::Display for NotReady {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Safety(bits) => write!(f, "{} (safety status bits {bits:#x})", safety(bits)),
            Self::Mode(mode) => write!(f, "{} (robot mode {mode}, needed {RUNNING})", self::mode(mode)),
            Self::Program(state) => write!(f, "{} (runtime state {state}, needed {PLAYING})", program(state)),
        }
    }
}

/// Bits of `safety_status_bits`, the gravest that is set first: a stop sets "stopped due to safety" (10) beside its own.
const fn safety(bits: u32) -> &'static str {
    match bits {
        _ if bits & 1 << 9 != 0 => {
            "the robot's safety system reports a fault: read the code in its log, clear the cause, restart the controller"
        }
        _ if bits & 1 << 8 != 0 => {
            "the robot's safety system reports a violation: read the code in its log, look where the arm stands, restart the \
             safety system at the teach pendant"
        }
        _ if bits & 1 << 6 != 0 => {
            "the robot's emergency stop is pressed, at its teach pendant or control box: look why, release the button, switch \
             the robot on again"
        }
        _ if bits & 1 << 5 != 0 => {
            "the system's emergency stop is pressed, a button of the cell: look why, release it, switch the robot on again"
        }
        _ if bits & 1 << 7 != 0 => {
            "an emergency stop holds the robot: look which button is pressed and why, release it, switch the robot on again"
        }
        _ if bits & 1 << 11 != 0 => {
            "the three-position switch is released or pressed through: hold it in its middle position, or leave manual mode"
        }
        _ if bits & 1 << 4 != 0 => {
            "a safeguard stop holds the robot: somebody is in the cell, or a gate or light curtain is open; clear it and reset it"
        }
        _ if bits & 1 << 2 != 0 => {
            "the robot is in a protective stop: look what it met or what its log says, wait five seconds, unlock it at the \
             teach pendant"
        }
        _ if bits & 1 << 3 != 0 => {
            "the robot is in recovery mode, outside its safety limits: move it back inside by hand at the teach pendant"
        }
        _ => "the robot's safety system holds it: look at the teach pendant",
    }
}

const fn mode(mode: i32) -> &'static str {
    match mode {
        NO_CONTROLLER => "the robot's controller is not running: restart it",
        DISCONNECTED => {
            "the controller has no arm: check the cable between control box and arm, restart the controller"
        }
        CONFIRM_SAFETY => "the robot wants its safety settings confirmed: confirm them at the teach pendant",
        BOOTING => "the robot is starting: wait for it",
        POWER_OFF => "the robot has no power: switch it on and release its brakes at the teach pendant",
        POWER_ON | IDLE => "the robot's brakes are not released: release them at the teach pendant",
        BACKDRIVE => "the robot is in backdrive, pushed by hand: end that at the teach pendant",
        UPDATING_FIRMWARE => "the robot updates its firmware: wait, then switch it on and release its brakes",
        _ => "the robot is not running: switch it on and release its brakes at the teach pendant",
    }
}

const fn program(state: u32) -> &'static str {
    match state {
        PAUSING | PAUSED => {
            "the robot's program is paused, by its watchdog, a popup or at the teach pendant: close what is shown there, play it"
        }
        RESUMING => "the robot's program is resuming: wait for it",
        _ => "no program is playing on the robot: start Screed's at the teach pendant",
    }
}

impl RobotState {
    /// What every robot says.
    pub fn telegram(&self) -> Telegram {
        Telegram {
            time: self.timestamp,
            joints: self.actual_q,
            arrived: Some(self.arrived as u32),
            not_ready: NotReady::of(self),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_state_that_takes_no_setpoints_has_its_own_cause_and_action() {
        let mut texts: Vec<String> = Vec::new();
        let bits = [9, 8, 6, 5, 7, 11, 4, 2, 3].map(|bit| NotReady::Safety(1 << bit | 1 << 10));
        let modes = [-1, 0, 1, 2, 3, 4, 6, 8].map(NotReady::Mode);
        let programs = [1, 4, 5].map(NotReady::Program);
        for why in bits.into_iter().chain(modes).chain(programs).chain([NotReady::Safety(1 << 10)]) {
            let text = why.to_string();
            let text = text.split(" (").next().unwrap().to_owned();
            assert!(text.contains([':', ';']) && text.len() > 30, "{text}");
            assert!(why.to_string().len() <= screed_kernel::frame::NOTE_MAX);
            assert!(!texts.contains(&text), "{text} stands for two");
            texts.push(text);
        }
    }
}
