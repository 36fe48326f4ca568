//! Why the link to the robot failed.

use super::Phase;
use super::wire::{FieldType, HEADER_LEN, PackageKind};

/// Every way in which the RTDE link fails. After the first one the client stays failed: a byte stream that lost its
/// package borders must not be read on.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum LinkError {
    /// The wanted rate is none that a controller serves evenly.
    #[error("RTDE rate of {rate_hz} Hz: set rate_hz to 125 or 500")]
    BadRate {
        /// As configured (Hz).
        rate_hz: u32,
    },
    /// The wanted register offset is none that RTDE has.
    #[error(
        "RTDE register offset {offset}: set register_offset to 0, or to 24 where a fieldbus owns the lower registers"
    )]
    BadOffset {
        /// As configured.
        offset: u8,
    },
    /// The controller does not speak protocol 2.
    #[error("the controller refuses RTDE protocol 2: update it to PolyScope 3.5 / 5.0 or newer")]
    ProtocolRefused,
    /// The controller's cycle is slower than the wanted rate.
    #[error("controller version {major} serves at most 125 Hz, {rate_hz} Hz wanted: set rate_hz = 125")]
    RateTooHigh {
        /// Major version of the controller's software; below 5 it is a CB3.
        major: u32,
        /// As configured (Hz).
        rate_hz: u32,
    },
    /// The controller does not know a field.
    #[error(
        "the controller has no field {name}: its software is too old for register offset 24 (needs 3.9 / 5.3), or is no UR controller"
    )]
    FieldNotFound {
        /// The field.
        name: &'static str,
    },
    /// Another client, or a fieldbus, writes an input that we need.
    #[error(
        "{name} is in use: close the other RTDE client, switch off EtherNet/IP, PROFINET or MODBUS in the installation, or set \
         register_offset to the other of 0 and 24"
    )]
    InUse {
        /// The input.
        name: &'static str,
    },
    /// The controller gives a field another type than the protocol's documentation.
    #[error("the controller's type of {name} is not {}: not a controller that this program knows", expected.name())]
    WrongType {
        /// The field.
        name: &'static str,
        /// Its type by the documentation.
        expected: FieldType,
    },
    /// The controller does not start sending.
    #[error("the controller refuses to start sending: restart its RTDE service or the controller")]
    StartRefused,
    /// A package's size cannot be true for its type.
    #[error("a {kind} package says {size} bytes, {min} to {max} are possible: the byte stream is corrupt, reconnect")]
    BadSize {
        /// Type by its header.
        kind: PackageKind,
        /// Size by its header.
        size: u16,
        /// Least possible.
        min: u16,
        /// Most possible.
        max: u16,
    },
    /// A type byte that the protocol does not have.
    #[error(
        "package type {code:#04x} does not exist: the byte stream is corrupt or the peer is no RTDE server, reconnect"
    )]
    UnknownPackage {
        /// The type byte.
        code: u8,
    },
    /// A package that cannot come now.
    #[error("a {kind} package while {phase}: the byte stream is corrupt or the peer is no RTDE server, reconnect")]
    UnexpectedPackage {
        /// Its type.
        kind: PackageKind,
        /// What the client was doing.
        phase: Phase,
    },
    /// Data for a recipe that was not agreed.
    #[error("data of recipe {id}, {expected} was agreed: the byte stream is corrupt, reconnect")]
    UnknownRecipe {
        /// As received.
        id: u8,
        /// As agreed.
        expected: u8,
    },
    /// A package whose parts contradict each other.
    #[error("a {kind} package whose content does not fit its size: the byte stream is corrupt, reconnect")]
    Malformed {
        /// Its type.
        kind: PackageKind,
    },
    /// A value that the robot cannot have.
    #[error(
        "{field}[{element}] = {value} is impossible (limit {limit}): the byte stream is corrupt or the robot model is wrong, reconnect"
    )]
    ImpossibleValue {
        /// The field.
        field: &'static str,
        /// Which element of a vector, 0 for a scalar.
        element: u8,
        /// As received, for a step the step (SI).
        value: f64,
        /// The bound it breaks (SI).
        limit: f64,
    },
    /// Nothing came.
    #[error("nothing from the robot for {} ms while {phase}: check power, cable, address and firewall", waited_ns / 1_000_000)]
    Silent {
        /// Since the last package or request (ns).
        waited_ns: u64,
        /// What the client was doing.
        phase: Phase,
    },
    /// A package began and did not end.
    #[error("{received} bytes of a package of {size} came, the rest not within {} ms: the link is cut or corrupt, reconnect", waited_ns / 1_000_000)]
    Incomplete {
        /// Bytes there.
        received: u16,
        /// Bytes announced; 3, a header, while even that is incomplete.
        size: u16,
        /// Since the last complete package or request (ns).
        waited_ns: u64,
    },
    /// The robot closed the connection.
    #[error("the robot closed the connection while {phase}: see the log on its teach pendant, then reconnect")]
    Closed {
        /// What the client was doing.
        phase: Phase,
    },
    /// A setpoint before the link runs.
    #[error("a setpoint while {phase}: wait for the link to run")]
    NotRunning {
        /// What the client was doing.
        phase: Phase,
    },
    /// A setpoint before the robot's first state.
    #[error("a setpoint before the robot has said where it is: wait for its first state")]
    NoState,
    /// Setpoints faster than they leave.
    #[error("setpoints wait unsent: the robot or the network does not take them")]
    TransmitFull,
    /// A setpoint that must not go out.
    #[error(
        "setpoint of joint {joint} = {value} rad is not finite, out of the arm's range, or all joints are exactly zero"
    )]
    ImpossibleSetpoint {
        /// The first joint at fault (0 is the base).
        joint: u8,
        /// Its value (rad).
        value: f64,
    },
    /// A setpoint that the arm cannot reach in time.
    #[error(
        "a setpoint would step joint {joint} by {step:.6} rad in {within:.3} s, {limit:.6} rad are allowed: it was not sent; \
         compare the robot's model with the cell file's, save the log and report it"
    )]
    StepTooLarge {
        /// The first joint at fault (0 is the base).
        joint: u8,
        /// From the setpoint before, or from where the joint is (rad).
        step: f64,
        /// The most that the arm's speed allows (rad).
        limit: f64,
        /// Time for it (s).
        within: f64,
    },
}

impl LinkError {
    /// The error of a time-out: silence, or a package that never ended.
    pub(super) fn timed_out(waiting: usize, announced: Option<u16>, waited_ns: u64, phase: Phase) -> Self {
        match u16::try_from(waiting) {
            Ok(0) | Err(_) => Self::Silent { waited_ns, phase },
            Ok(received) => Self::Incomplete { received, size: announced.unwrap_or(HEADER_LEN as u16), waited_ns },
        }
    }
}
