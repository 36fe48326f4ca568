//! Sans-IO state machines, one per wire.

pub mod dashboard;
pub mod extruder;
pub mod primary;
pub mod rtde;

use rtde::ready::NotReady;
use screed_kernel::units::JointPos;

/// What a robot says of itself in one of its cycles, whatever its wire: all that a loop needs to know of it (docs/porting-link.md).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Telegram {
    /// The robot's own clock (s); it grows.
    pub time: f64,
    /// Where the joints are (rad).
    pub joints: JointPos<6>,
    /// Number of the setpoint that had arrived when this was made; none where the wire does not say.
    pub arrived: Option<u32>,
    /// Why it takes no setpoints; none where it does.
    pub not_ready: Option<NotReady>,
}
