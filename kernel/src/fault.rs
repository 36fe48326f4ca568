//! Why the kernel stopped on its own. `docs/faults.md` lists the same codes, causes and actions.

use crate::control::Bound;
use crate::guard::Quantity;
use crate::ik::IkError;
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
    /// What the loop wants to add moves the tool too far, or could not be added fast enough for too long. Since 1.1.
    Saturated {
        /// Which bound.
        bound: Bound,
        /// What was asked for (m, rad, s).
        value: f64,
        /// What is allowed.
        limit: f64,
    },
    /// No joints put the flange on its path from where the base is now. Since 1.1.
    Unreachable {
        /// Why.
        reason: Unreached,
        /// How far (m, rad), where the reason has a figure; else 0.
        value: f64,
    },
    /// The base is displaced by more than a correction may be. Since 1.1.
    Base {
        /// 0 to 2: along x, y, z of the nominal base frame; 3 to 5: about them.
        axis: u8,
        /// Displacement found, or where it could be braken (m, rad).
        value: f64,
        /// Displacement allowed.
        limit: f64,
    },
    /// A drive's lag was identified at a bound for as long as what is learnt counts. Since 1.1.
    Drive {
        /// Joint, 0 for the first.
        joint: u8,
        /// Lag that the motion asks for (s).
        value: f64,
        /// The bound (s).
        limit: f64,
    },
    /// While material was laid, a joint's corrections and lead stayed behind for too long: their limits are too narrow. Since 1.1.
    Lead {
        /// Joint, 0 for the first.
        joint: u8,
        /// How far behind (rad or m).
        value: f64,
        /// How far it may be for long.
        limit: f64,
    },
    /// The tracker was not to be trusted for longer than the path may wait for it. Since 1.1.
    Tracker {
        /// For how long the path has waited (s).
        value: f64,
        /// For how long it may.
        limit: f64,
    },
    /// The loop overran again and again, with too few good cycles between: its process does not hold the robot's pace. Since 1.1.
    Overrun {
        /// Slots missed in these overruns.
        missed: u32,
        /// Overruns, less the good cycles between, that are too many.
        limit: u32,
    },
    /// The link to the robot failed: where the robot is, is no longer known. Since 1.1.
    Link,
}

/// Why a pose cannot be reached: [`IkError`] as it crosses the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Unreached {
    /// It lies outside of what the arm can reach; by so many metres.
    Reach,
    /// The arm cannot give the flange this orientation; by so many rad.
    Orientation,
    /// A joint would have to be beyond its limits, there (rad, m).
    Limit,
    /// So close to a singularity that the joints cannot be found; as near to it as this.
    Singular,
    /// The solution was not found: a pose that is none, an arm of another shape, or the iteration's cap.
    Unsolved,
}

impl From<IkError> for Fault {
    fn from(error: IkError) -> Self {
        let (reason, value) = match error {
            IkError::OutOfReach { by } => (Unreached::Reach, by),
            IkError::Orientation { by } => (Unreached::Orientation, by),
            IkError::Limit { position, .. } => (Unreached::Limit, position),
            IkError::Singular { distance, .. } => (Unreached::Singular, distance),
            IkError::NotFinite | IkError::NotRotation { .. } | IkError::OtherShape | IkError::NotConverged { .. } => {
                (Unreached::Unsolved, 0.0)
            }
        };
        Self::Unreachable { reason, value }
    }
}

impl Fault {
    /// One of each kind, in the order of their codes.
    pub const KINDS: [Self; 15] = [
        Self::Following { joint: 0, value: 0.0, limit: 0.0 },
        Self::Sensor { joint: 0 },
        Self::RobotNotReady,
        Self::Output { quantity: Quantity::Finite, joint: 0, value: 0.0, limit: 0.0 },
        Self::Extruder,
        Self::Deviation { joint: 0, value: 0.0, limit: 0.0 },
        Self::Correction { quantity: Quantity::Finite, joint: 0, value: 0.0, limit: 0.0 },
        Self::Saturated { bound: Bound::Shift, value: 0.0, limit: 0.0 },
        Self::Unreachable { reason: Unreached::Reach, value: 0.0 },
        Self::Base { axis: 0, value: 0.0, limit: 0.0 },
        Self::Drive { joint: 0, value: 0.0, limit: 0.0 },
        Self::Lead { joint: 0, value: 0.0, limit: 0.0 },
        Self::Tracker { value: 0.0, limit: 0.0 },
        Self::Overrun { missed: 0, limit: 0 },
        Self::Link,
    ];

    /// The same for a reader of this minor version: what 1.0 does not know is to it a correction outside the workspace. So it
    /// sees that the kernel stands in a fault, and can leave it by its number.
    pub const fn told_to(self, minor: u8) -> Self {
        let (joint, value, limit) = match self {
            Self::Saturated { value, limit, .. } | Self::Tracker { value, limit } => (0, value, limit),
            Self::Unreachable { value, .. } => (0, value, 0.0),
            Self::Base { axis, value, limit } => (axis, value, limit),
            Self::Drive { joint, value, limit } | Self::Lead { joint, value, limit } => (joint, value, limit),
            Self::Overrun { missed, limit } => (0, missed as f64, limit as f64),
            Self::Link => (0, 0.0, 0.0),
            _ => return self,
        };
        if minor > 0 { self } else { Self::Correction { quantity: Quantity::Workspace, joint, value, limit } }
    }

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
            Self::Saturated { .. } => "K8",
            Self::Unreachable { .. } => "K9",
            Self::Base { .. } => "K10",
            Self::Drive { .. } => "K11",
            Self::Lead { .. } => "K12",
            Self::Tracker { .. } => "K13",
            Self::Overrun { .. } => "K14",
            Self::Link => "K15",
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
            Self::Saturated { .. } => "the loop would have to move the tool farther or faster than it may",
            Self::Unreachable { .. } => "the arm cannot reach its path from where the base is now",
            Self::Base { .. } => "the base has moved farther than may be corrected",
            Self::Drive { .. } => "a drive lags more or less than it can",
            Self::Lead { .. } => "what is sent cannot lead the path as it should",
            Self::Tracker { .. } => "the tracker has been lost for too long",
            Self::Overrun { .. } => "the loop came late again and again",
            Self::Link => "the link to the robot failed",
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
            Self::Saturated { .. } => {
                "look at what moves the base or bends the arm; check the tracker's mounting and the bounds of [control]; then \
                 re-arm"
            }
            Self::Unreachable { .. } => "bring the base back, or plan the part nearer to it; then re-arm",
            Self::Base { .. } => {
                "look at the base and what carries it; register it anew, or widen the bounds of [shift]; then re-arm"
            }
            Self::Drive { .. } => {
                "compare look-ahead, gain and dead time of the cell file with what the robot runs, and the bounds of [lead]; \
                 then re-arm"
            }
            Self::Lead { .. } => "widen the limits of [lead], or plan slower; then re-arm",
            Self::Tracker { .. } => "clear the beam and look at the tracker; then re-arm",
            Self::Overrun { .. } => {
                "run screed doctor, and end what else uses the machine or its line to the robot; then re-arm"
            }
            Self::Link => {
                "see in the message before it why; look where the arm stands, mend the link and start the robot's program again by \
                 hand; then re-arm"
            }
        }
    }
}
