//! Why a UR does not move, and what a person does about it: the one table of it, whether RTDE tells of the state or the dashboard.

use super::{RobotMode, Safety};
use crate::link::Remedy;

const fn remedy(cause: &'static str, action: &'static str) -> Option<Remedy> {
    Some(Remedy { cause, action })
}

/// After any emergency stop.
const RELEASE_BUTTON: &str = "look which emergency stop button is pressed and why; release it when nobody is in danger, then screed \
                              robot power-on and screed robot brake-release";

/// Some emergency stop, of the robot or of the cell.
pub const EMERGENCY_STOP: Remedy = Remedy { cause: "an emergency stop holds the robot", action: RELEASE_BUTTON };

/// The safety system, without saying why.
pub const HELD: Remedy = Remedy {
    cause: "the robot's safety system holds it, and does not say why",
    action: "look at the teach pendant, then at screed robot status",
};

/// The safety system says something that software newer than this may say.
pub const UNKNOWN_SAFETY: Remedy = Remedy {
    cause: "the robot's safety system reports what Screed does not know, which may be a stop",
    action: "look at the teach pendant; where the robot is well there, its software is newer than this Screed: update Screed",
};

/// Likewise the robot's mode.
pub const UNKNOWN_MODE: Remedy = Remedy {
    cause: "the robot is in a mode that Screed does not know",
    action: "look at the teach pendant; where the robot is running there, its software is newer than this Screed: update Screed",
};

/// Likewise the program's state.
pub const UNKNOWN_PROGRAM: Remedy = Remedy {
    cause: "the robot's program is in a state that Screed does not know",
    action: "look at the teach pendant; where it plays there, the robot's software is newer than this Screed: update Screed",
};

/// No program runs.
pub const NO_PROGRAM: Remedy = Remedy {
    cause: "no program is playing on the robot",
    action: "close what pops up on the teach pendant, there or with screed robot close-popup; then screed robot play --upload, or \
             start Screed's program at the teach pendant",
};

/// It is on its way to playing again.
pub const RESUMING: Remedy = Remedy { cause: "the robot's program is resuming", action: "wait for it" };

/// It is held, and its watchdog may have done so.
pub const PAUSED: Remedy = Remedy {
    cause: "the robot's program is paused, by a popup that waits on the teach pendant, by somebody there, or by its watchdog for \
            want of setpoints",
    action: "read the popup, or look at the network where there is none; screed robot stop, screed robot close-popup, then print with \
             --upload and --from-layer; only one that waits for its first setpoint goes on with close-popup and play",
};

/// It is held though setpoints came: its watchdog has not done so.
pub const POPUP: Remedy = Remedy {
    cause: "the robot's program is paused, and setpoints did come: a popup waits on the teach pendant, or somebody paused it there",
    action: "read the popup and look who was at the pendant; screed robot stop, screed robot close-popup, then print with --upload and \
             --from-layer: what is played on would jump to the newest setpoint",
};

impl Safety {
    /// Why the robot may not move, and what to do; none where it may.
    pub const fn remedy(self) -> Option<Remedy> {
        match self {
            Self::Normal | Self::Reduced => None,
            Self::ProtectiveStop => remedy(
                "the robot is in a protective stop",
                "look what it met, and at its log; five seconds after the stop screed robot unlock, then screed robot stop, and print \
                 with --upload and --from-layer",
            ),
            Self::Recovery => remedy(
                "the robot is in recovery mode, outside its safety limits",
                "move it back inside by hand at the teach pendant",
            ),
            Self::SafeguardStop => remedy(
                "a safeguard stop holds the robot: somebody is in the cell, or a gate or light curtain is open",
                "clear the cell, close the safeguard and reset it",
            ),
            Self::AutomaticModeSafeguardStop => remedy(
                "the safeguard of the automatic mode holds the robot",
                "clear the cell, close that safeguard and reset it",
            ),
            Self::SystemEmergencyStop => {
                remedy("the system's emergency stop is pressed, a button of the cell", RELEASE_BUTTON)
            }
            Self::RobotEmergencyStop => {
                remedy("the robot's emergency stop is pressed, at its teach pendant or control box", RELEASE_BUTTON)
            }
            Self::Violation => remedy(
                "the robot's safety system reports a violation",
                "read the safety system's code in the robot's log, look where the arm stands, restart it at the teach pendant",
            ),
            Self::Fault => remedy(
                "the robot's safety system reports a fault",
                "read the safety system's code in the robot's log, clear the cause, restart the controller",
            ),
            Self::EnablingStop => remedy(
                "the three-position switch is released or pressed through",
                "hold the three-position switch in its middle position, or leave manual mode",
            ),
        }
    }
}

impl RobotMode {
    /// What is missing until programs can run, and what to do; none where nothing is.
    pub const fn remedy(self) -> Option<Remedy> {
        match self {
            Self::Running => None,
            Self::NoController => {
                remedy("the robot's controller does not run", "wait until it has started, or restart it")
            }
            Self::Booting => remedy("the robot is starting", "wait until the controller has started"),
            Self::UpdatingFirmware => remedy(
                "the robot updates its firmware",
                "wait until it has, then screed robot power-on and screed robot brake-release",
            ),
            Self::Disconnected => remedy(
                "the controller has no arm",
                "check the cable between control box and arm, restart the controller",
            ),
            Self::ConfirmSafety => remedy(
                "the robot wants its safety settings confirmed",
                "confirm the safety settings at the teach pendant",
            ),
            Self::PowerOff => {
                remedy("the robot has no power", "screed robot power-on, then screed robot brake-release")
            }
            Self::PowerOn => remedy(
                "the robot's motors are getting power",
                "wait until they have it, then screed robot brake-release",
            ),
            Self::Idle => remedy("the robot's brakes are on", "screed robot brake-release"),
            Self::Backdrive => remedy(
                "the robot is in backdrive, pushed by hand",
                "let go of the arm and leave freedrive at the teach pendant",
            ),
        }
    }
}
