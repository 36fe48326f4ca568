//! Why the kernel stopped on its own.

use serde::{Deserialize, Serialize};

/// What only a tick can find. Each has a code, a cause in words and an action.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Fault {
    /// A joint is farther from its target than the cell file allows.
    Following {
        /// Joint, 0 for the first.
        joint: u8,
        /// Distance found (rad or m).
        value: f64,
        /// Distance allowed.
        limit: f64,
    },
    /// A sensor value is not finite.
    Sensor {
        /// Joint, 0 for the first.
        joint: u8,
    },
    /// The robot stopped taking commands while the path was played: its program, power or safety state changed.
    RobotNotReady,
    /// The extruder does not answer or reports a fault of its own.
    Extruder,
    /// The output would break a limit; the last good output is held.
    Output {
        /// Joint, 0 for the first.
        joint: u8,
        /// Value found (SI).
        value: f64,
        /// Value allowed.
        limit: f64,
    },
}

impl Fault {
    /// The code in logs and messages.
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Following { .. } => "K1",
            Self::Sensor { .. } => "K2",
            Self::RobotNotReady => "K3",
            Self::Output { .. } => "K4",
            Self::Extruder => "K5",
        }
    }

    /// What happened.
    pub const fn cause(&self) -> &'static str {
        match self {
            Self::Following { .. } => "the robot does not follow its setpoints",
            Self::Sensor { .. } => "the robot reports a position that is not a number",
            Self::RobotNotReady => "the robot no longer takes setpoints",
            Self::Extruder => "the extruder failed",
            Self::Output { .. } => "a setpoint broke a limit at the last gate",
        }
    }

    /// What to do.
    pub const fn action(&self) -> &'static str {
        match self {
            Self::Following { .. } => {
                "check that the robot's program runs its servoj line with the registers of the cell file, and that nothing \
                 holds the arm; then re-arm"
            }
            Self::Sensor { .. } => "check the link and the controller's state; then re-arm",
            Self::RobotNotReady => "look at the robot's program and safety state, start it again by hand; then re-arm",
            Self::Extruder => "look at the extruder and its line; then re-arm",
            Self::Output { .. } => "save the log and report it: the plan passed a check that the output did not",
        }
    }
}
