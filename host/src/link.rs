//! Sans-IO state machines, one per wire; and what every link to a robot gives the loop (docs/porting-link.md).
//!
//! [`RobotLink`] is the one place where the links are told apart: one more is a module, a kind in the cell file, and an arm in each
//! match here, which the compiler asks for.

pub mod cycles;
pub mod dashboard;
pub mod extruder;
pub mod primary;
pub mod rtde;

use crate::config::{Cell, LinkKind};
use cycles::CycleCount;
use rtde::RtdeClient;
use screed_kernel::fault::Fault;
use screed_kernel::frame::NOTE_MAX;
use screed_kernel::units::{JointPos, Nanos};
use std::fmt;

/// What a robot says of itself in one of its cycles, whatever its wire: all that a loop needs to know of it.
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

/// Why a robot takes no setpoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotReady {
    /// The cause, and what a person does about it.
    pub remedy: Remedy,
    /// What the robot itself calls it.
    pub code: Code,
}

/// A cause, and what a person does about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Remedy {
    /// What is the matter.
    pub cause: &'static str,
    /// What to do, with the commands that do it.
    pub action: &'static str,
}

/// A robot's own word for how it stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// A set of bits: what they are, and which are set.
    Bits(&'static str, u32),
    /// A number: of what, which, and the one with which it moves.
    Number(&'static str, i64, i64),
}

impl fmt::Display for NotReady {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Remedy { cause, action } = self.remedy;
        match self.code {
            Code::Bits(what, bits) => write!(f, "{cause}: {action} ({what} {bits:#x})"),
            Code::Number(what, number, wanted) => write!(f, "{cause}: {action} ({what} {number}, needed {wanted})"),
        }
    }
}

/// What a link has to tell.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "moved once per event, and the real-time process must not allocate")]
pub enum Event {
    /// All is agreed: telegrams follow, setpoints may be sent.
    Running,
    /// The robot's newest telegram.
    Telegram {
        /// As received and checked.
        telegram: Telegram,
        /// Older ones that came since the last poll and were overtaken by this one.
        skipped: u32,
    },
    /// The robot has something to say to a person.
    Text(heapless::String<NOTE_MAX>),
}

/// Why a link failed, or refused a setpoint: with cause and action.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum LinkError {
    /// RTDE.
    #[error(transparent)]
    Rtde(#[from] rtde::LinkError),
}

/// What the failure of a link tells of the robot, for who makes it anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// Nobody answers, or no longer.
    Gone,
    /// Somebody holds what we need; it may be the robot itself, for a connection of ours that failed.
    Held,
    /// What answers is not what it was, or not any more as it was: another controller, other software, another installation.
    Changed,
    /// What answers makes no sense, or refuses for a reason of its own.
    Senseless,
}

impl LinkError {
    /// What it tells of the robot.
    pub const fn trouble(&self) -> Trouble {
        match self {
            Self::Rtde(error) => error.trouble(),
        }
    }

    /// The fault of a setpoint that was refused while the link stays usable; none where the link has failed.
    pub const fn refused(&self) -> Option<Fault> {
        match self {
            Self::Rtde(error) => error.refused(),
        }
    }
}

/// A link to a robot: bytes and time go in, bytes and events come out. It owns no socket, no clock and no thread, and takes no
/// memory after [`Self::new`]. What each call has to keep stands in docs/porting-link.md.
#[derive(Clone, Debug)]
pub enum RobotLink {
    /// Universal Robots' Real-Time Data Exchange.
    Rtde(RtdeClient),
}

impl RobotLink {
    /// As the cell has it: all that is configured is checked, all memory taken.
    ///
    /// # Errors
    /// [`LinkError`] where the cell's link cannot be.
    pub fn new(cell: &Cell) -> Result<Self, LinkError> {
        match cell.link.kind {
            LinkKind::Rtde => Ok(Self::Rtde(RtdeClient::of(cell)?)),
        }
    }

    /// For a fresh connection: everything is agreed anew, and nothing is known of the robot. Only [`Self::cycles`] goes on.
    pub fn restart(&mut self) {
        match self {
            Self::Rtde(client) => client.restart(),
        }
    }

    /// Takes what came: of a stream, split anywhere; of datagrams, one a call.
    ///
    /// # Errors
    /// Why the link failed; the same again from then on.
    pub fn handle_bytes(&mut self, now: Nanos, bytes: &[u8]) -> Result<(), LinkError> {
        match self {
            Self::Rtde(client) => Ok(client.handle_bytes(now, bytes)?),
        }
    }

    /// The robot closed the connection; gives the error to report.
    pub fn handle_closed(&mut self) -> LinkError {
        match self {
            Self::Rtde(client) => client.handle_closed().into(),
        }
    }

    /// The next thing to tell; none is left where it gives none. No telegram comes of a link that failed.
    pub fn poll_event(&mut self) -> Option<Event> {
        match self {
            Self::Rtde(client) => client.poll_told(),
        }
    }

    /// Queues one setpoint (rad) in answer to the newest telegram; `number` counts them, and comes back in [`Telegram::arrived`].
    ///
    /// # Errors
    /// One that is [refused](LinkError::refused): nothing is queued, and the link stays usable. Else why the link failed.
    pub fn send_setpoint(&mut self, number: u32, joints: &JointPos<6>) -> Result<(), LinkError> {
        match self {
            Self::Rtde(client) => Ok(client.send_setpoint(number, joints)?),
        }
    }

    /// Moves bytes for the robot into `out`; how many, 0 when there are none. Of a datagram link, one datagram a call.
    pub fn poll_transmit(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        match self {
            Self::Rtde(client) => client.poll_transmit(now, out),
        }
    }

    /// When [`Self::handle_timeout`] wants to be called.
    pub fn poll_timeout(&self) -> Option<Nanos> {
        match self {
            Self::Rtde(client) => client.poll_timeout(),
        }
    }

    /// Checks whether the robot has been silent for too long.
    ///
    /// # Errors
    /// That it has; the error of a failed link, again.
    pub fn handle_timeout(&mut self, now: Nanos) -> Result<(), LinkError> {
        match self {
            Self::Rtde(client) => Ok(client.handle_timeout(now)?),
        }
    }

    /// What became of the robot's cycles.
    pub const fn cycles(&mut self) -> &mut CycleCount {
        match self {
            Self::Rtde(client) => client.cycles(),
        }
    }

    /// An error of this link, with its place in a file where it is about one.
    pub const fn explain<'a>(&'a self, error: &'a LinkError) -> Explained<'a> {
        Explained { link: self, error }
    }
}

/// An error in words, with all that the link knows of it.
#[derive(Clone, Copy, Debug)]
pub struct Explained<'a> {
    link: &'a RobotLink,
    error: &'a LinkError,
}

impl fmt::Display for Explained<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.link, self.error) {
            (RobotLink::Rtde(client), LinkError::Rtde(error)) => client.explain(error).fmt(f),
        }
    }
}
