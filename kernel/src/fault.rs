//! Why the kernel stopped on its own. `docs/faults.md` lists the same codes, causes and actions.

use crate::guard::Quantity;
use serde::{Deserialize, Serialize};

/// What only a tick can find. Each has a code, a cause in words and an action.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Fault {
    /// A joint's actual position is farther from its target than the cell file allows.
    Following {
        /// Joint, 0 for the first.
        joint: u8,
        /// Distance found (rad or m).
        value: f64,
        /// Distance allowed.
        limit: f64,
    },
    /// A measured or estimated position is not finite.
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
        /// Which limit.
        quantity: Quantity,
        /// Joint, 0 for the first.
        joint: u8,
        /// Value found (SI); 0 for [`Quantity::Finite`].
        value: f64,
        /// Value allowed.
        limit: f64,
    },
    /// A joint's estimated position is farther from its target than the cell file allows.
    Deviation {
        /// Joint, 0 for the first.
        joint: u8,
        /// Distance found (rad or m).
        value: f64,
        /// Distance allowed.
        limit: f64,
    },
    /// A correction breaks its limits; the last good one is ramped out.
    Correction {
        /// Which limit; [`Quantity::Position`] is its size.
        quantity: Quantity,
        /// Joint, 0 for the first.
        joint: u8,
        /// Value found (SI); 0 for [`Quantity::Finite`].
        value: f64,
        /// Value allowed.
        limit: f64,
    },
    /// The loop overran again and again, with too few good cycles between: its process does not hold the robot's pace.
    Overrun {
        /// Slots missed in these overruns.
        missed: u32,
        /// Overruns, less the good cycles between, that are too many.
        limit: u32,
    },
}

impl Fault {
    /// One of each kind, in the order of their codes.
    pub const KINDS: [Self; 8] = [
        Self::Following { joint: 0, value: 0.0, limit: 0.0 },
        Self::Sensor { joint: 0 },
        Self::RobotNotReady,
        Self::Output { quantity: Quantity::Finite, joint: 0, value: 0.0, limit: 0.0 },
        Self::Extruder,
        Self::Deviation { joint: 0, value: 0.0, limit: 0.0 },
        Self::Correction { quantity: Quantity::Finite, joint: 0, value: 0.0, limit: 0.0 },
        Self::Overrun { missed: 0, limit: 0 },
    ];

    /// The code in logs and messages.
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Following { .. } => "K1",
            Self::Sensor { .. } => "K2",
            Self::RobotNotReady => "K3",
            Self::Output { .. } => "K4",
            Self::Extruder => "K5",
            Self::Deviation { .. } => "K6",
            Self::Correction { .. } => "K7",
            Self::Overrun { .. } => "K8",
        }
    }

    /// What happened.
    pub const fn cause(&self) -> &'static str {
        match self {
            Self::Following { .. } => "the robot does not follow its setpoints",
            Self::Sensor { .. } => "a measured or estimated position is not a number",
            Self::RobotNotReady => "the robot no longer takes setpoints",
            Self::Output { .. } => "an output broke a limit at the last gate",
            Self::Extruder => "the extruder failed",
            Self::Deviation { .. } => "the estimated position deviates from its target",
            Self::Correction { .. } => "a correction broke its limits",
            Self::Overrun { .. } => "the loop came late again and again",
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
            Self::Output { .. } => "save the log and report it: the plan passed a check that the output did not",
            Self::Extruder => "look at the extruder and its line; then re-arm",
            Self::Deviation { .. } => {
                "check the tracker and its registration, and that nothing moved the base; then re-arm"
            }
            Self::Correction { .. } => "check the tracker, and what moves the base so far or so fast; then re-arm",
            Self::Overrun { .. } => {
                "run screed doctor, and end what else uses the machine or its line to the robot; then re-arm"
            }
        }
    }
}
