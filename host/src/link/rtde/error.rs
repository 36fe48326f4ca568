//! Why the link to the robot failed.

use super::fields::{self, REGISTERS, REGISTERS_UPPER};
use super::file::RecipeFile;
use super::recipe::Field;
use super::wire::{HEADER_LEN, PackageKind, ShortText};
use super::{ControllerVersion, Phase};
use crate::link::Trouble;
use screed_kernel::fault::Fault;
use screed_kernel::guard::Quantity;
use std::fmt;

/// Every way in which the RTDE link fails. After the first one the client stays failed: a byte stream that lost its
/// package borders must not be read on.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum LinkError {
    /// The wanted rate is none that a controller serves evenly.
    #[error("RTDE rate of {rate_hz} Hz; set rate_hz to 125 or 500")]
    BadRate {
        /// As configured (Hz).
        rate_hz: u32,
    },
    /// The wanted register offset is none that RTDE has.
    #[error(
        "RTDE register offset {offset}; set register_offset to 0, or to 24 where a fieldbus owns the lower registers"
    )]
    BadOffset {
        /// As configured.
        offset: u8,
    },
    /// More than one package can hold.
    #[error(
        "the recipe's {fields} outputs need packages of {size} bytes, 65535 are possible; take fields out of the recipe"
    )]
    RecipeTooLong {
        /// How many outputs.
        fields: usize,
        /// Bytes of the longest package: data, or the names.
        size: usize,
    },
    /// The controller speaks neither protocol.
    #[error("the controller refuses RTDE protocols 2 and 1, which Screed speaks; update the controller, or Screed")]
    ProtocolRefused,
    /// The controller's cycle is slower than the wanted rate.
    #[error(
        "the controller (software {controller}) serves at most 125 Hz, {rate_hz} Hz wanted; set rate_hz = 125, or ask for --rate 125 to record"
    )]
    RateTooHigh {
        /// Its software; major below 5 is a CB3.
        controller: ControllerVersion,
        /// As configured (Hz).
        rate_hz: u32,
    },
    /// The controller sends at another rate than the configured one, which protocol 1 cannot ask for.
    #[error(
        "the controller sends {found_hz:.1} states a second, {rate_hz} are configured, and its protocol 1 cannot be asked for a rate; \
         set rate_hz to the controller's, or update its software for protocol 2"
    )]
    OtherRate {
        /// As configured (Hz).
        rate_hz: u32,
        /// By the least step of the time stamps (Hz).
        found_hz: f64,
    },
    /// The controller does not know a field.
    #[error("{}", not_found(field, controller.as_ref()))]
    FieldNotFound {
        /// The field.
        field: Field,
        /// The controller's software, where it said so before.
        controller: Option<ControllerVersion>,
    },
    /// Another client, or a fieldbus, writes inputs that we need.
    #[error("{}", in_use(field, *used, *of))]
    InUse {
        /// The first of them.
        field: Field,
        /// How many are in use.
        used: u16,
        /// Of how many that were asked for.
        of: u16,
    },
    /// The controller gives a field another type.
    #[error(
        "field {}: type {} expected, the controller answers {found}; correct the recipe, or take a server that is a UR controller",
        field.name,
        field.kind.name()
    )]
    WrongType {
        /// The field, and its type by the recipe.
        field: Field,
        /// What the controller answers.
        found: ShortText<20>,
    },
    /// The controller does not start sending.
    #[error("the controller refuses to start sending; restart its RTDE service or the controller")]
    StartRefused,
    /// A package's size cannot be true for its type.
    #[error(
        "a {kind} package says {size} bytes, {min} to {max} are possible: the byte stream is corrupt or the peer is no RTDE server; \
         check address and port, reconnect"
    )]
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
        "package type {code:#04x} does not exist: the byte stream is corrupt or the peer is no RTDE server; check address and port, reconnect"
    )]
    UnknownPackage {
        /// The type byte.
        code: u8,
    },
    /// A package that cannot come now.
    #[error(
        "a {kind} package while {phase}: the byte stream is corrupt or the peer is no RTDE server; check address and port, reconnect"
    )]
    UnexpectedPackage {
        /// Its type.
        kind: PackageKind,
        /// What the client was doing.
        phase: Phase,
    },
    /// Data for a recipe that was not agreed.
    #[error("data of recipe {id}, {expected} was agreed: the byte stream is corrupt; reconnect")]
    UnknownRecipe {
        /// As received.
        id: u8,
        /// As agreed.
        expected: u8,
    },
    /// A package whose parts contradict each other.
    #[error("a {kind} package whose content does not fit its size: the byte stream is corrupt; reconnect")]
    Malformed {
        /// Its type.
        kind: PackageKind,
    },
    /// A value that the robot cannot have.
    #[error(
        "{field}[{element}] = {value} is impossible (limit {limit}): the byte stream is corrupt or the robot model is wrong; compare model in [robot] with the robot, reconnect"
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
    #[error("nothing from the robot for {} ms while {phase}; check power, cable, address and firewall", waited_ns / 1_000_000)]
    Silent {
        /// Since the last package or request (ns).
        waited_ns: u64,
        /// What the client was doing.
        phase: Phase,
    },
    /// A package began and did not end.
    #[error("{received} bytes of a package of {size} came, the rest not within {} ms: the link is cut or corrupt; check cable and network, reconnect", waited_ns / 1_000_000)]
    Incomplete {
        /// Bytes there.
        received: u16,
        /// Bytes announced; 3, a header, while even that is incomplete.
        size: u16,
        /// Since the last complete package or request (ns).
        waited_ns: u64,
    },
    /// The robot closed the connection.
    #[error("the robot closed the connection while {phase}; see the log on its teach pendant, then reconnect")]
    Closed {
        /// What the client was doing.
        phase: Phase,
    },
    /// A setpoint before the link runs.
    #[error("a setpoint while {phase}; wait for the link to run")]
    NotRunning {
        /// What the client was doing.
        phase: Phase,
    },
    /// A setpoint before the robot's first state.
    #[error("a setpoint before the robot has said where it is; wait for its first state")]
    NoState,
    /// Setpoints faster than they leave.
    #[error("setpoints wait unsent, the robot or the network does not take them; check the network")]
    TransmitFull,
    /// A setpoint that must not go out.
    #[error(
        "setpoint of joint {joint} = {value} rad is not finite, out of the arm's range, or all joints are exactly zero, so it was not \
         sent; compare the robot's model with the cell file's, save the log and report it"
    )]
    ImpossibleSetpoint {
        /// The first joint at fault (0 is the base).
        joint: u8,
        /// Its value (rad).
        value: f64,
    },
    /// A setpoint that the arm cannot reach in time.
    #[error(
        "a setpoint would step joint {joint} by {step:.6} rad in {within:.3} s, {limit:.6} rad are allowed, so it was not sent; \
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

fn not_found(field: &Field, controller: Option<&ControllerVersion>) -> String {
    let name = field.name.to_string();
    let whose = controller.map_or_else(String::new, |version| format!(" (software {version})"));
    let prefixes = ["input_int_register_", "input_double_register_", "output_int_register_", "output_double_register_"];
    let upper = prefixes.iter().any(|prefix| fields::number(&name, prefix, REGISTERS_UPPER..REGISTERS).is_some());
    let cause = if fields::output(&name).is_none() && fields::input(&name).is_some() {
        return format!("the controller{whose} cannot send {name}, which is an input; take it out of the recipe");
    } else if upper {
        "registers from 24 on came with software 3.9 and 5.3"
    } else if fields::output(&name).is_some() {
        "its software is older than the field, or it is no controller of Universal Robots"
    } else {
        "Screed does not know the field either: the recipe has its name wrong, or the controller is older than the field"
    };
    let remedy = match (field.line, upper) {
        (0, true) => "update it, or set register_offset = 0",
        (0, false) => "update it",
        _ => "update it, or take the field out of the recipe",
    };
    format!("the controller{whose} has no field {name}: {cause}; {remedy}")
}

fn in_use(field: &Field, used: u16, of: u16) -> String {
    let name = field.name;
    if used == of {
        let what = "a fieldbus (EtherNet/IP, PROFINET, MODBUS) owns the registers, or another Screed does";
        let remedy = "switch the fieldbus off in the installation or set register_offset to the other of 0 and 24, or end the other \
                      program, or give the print the screed-rt of yours that holds them with --attach";
        return format!("all {of} inputs from {name} on are in use: {what}; {remedy}");
    }
    let what = "another RTDE client writes them, or an old connection of one lingers";
    format!(
        "{used} of {of} inputs are in use, {name} first: {what}; close it, wait some seconds, or set register_offset to the other of 0 and 24"
    )
}

impl LinkError {
    /// What it tells of the robot.
    pub const fn trouble(&self) -> Trouble {
        match self {
            Self::Silent { .. }
            | Self::Incomplete { .. }
            | Self::Closed { .. }
            | Self::NotRunning { .. }
            | Self::NoState
            | Self::TransmitFull => Trouble::Gone,
            Self::InUse { .. } => Trouble::Held,
            Self::BadRate { .. }
            | Self::BadOffset { .. }
            | Self::RecipeTooLong { .. }
            | Self::ProtocolRefused
            | Self::RateTooHigh { .. }
            | Self::OtherRate { .. }
            | Self::FieldNotFound { .. }
            | Self::WrongType { .. } => Trouble::Changed,
            Self::StartRefused
            | Self::BadSize { .. }
            | Self::UnknownPackage { .. }
            | Self::UnexpectedPackage { .. }
            | Self::UnknownRecipe { .. }
            | Self::Malformed { .. }
            | Self::ImpossibleValue { .. }
            | Self::ImpossibleSetpoint { .. }
            | Self::StepTooLarge { .. } => Trouble::Senseless,
        }
    }

    /// The fault of a setpoint that was refused; none of an error of the connection.
    pub const fn refused(&self) -> Option<Fault> {
        match *self {
            Self::StepTooLarge { joint, step, limit, within } => {
                Some(Fault::Output { quantity: Quantity::Velocity, joint, value: step / within, limit: limit / within })
            }
            // The kernel keeps the range of the arm itself: what is left is that all are exactly zero.
            Self::ImpossibleSetpoint { joint, value } => {
                Some(Fault::Output { quantity: Quantity::Position, joint, value, limit: 0.0 })
            }
            _ => None,
        }
    }

    /// The field that it is about.
    const fn field(&self) -> Option<&Field> {
        match self {
            Self::FieldNotFound { field, .. } | Self::InUse { field, .. } | Self::WrongType { field, .. } => {
                Some(field)
            }
            _ => None,
        }
    }
}

/// An error with its place in the recipe file, where it has one: file, line, recipe.
#[derive(Clone, Copy, Debug)]
pub struct Explained<'a> {
    pub(super) error: &'a LinkError,
    pub(super) file: Option<&'a RecipeFile>,
}

impl fmt::Display for Explained<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = self.error.field().map_or(0, |field| field.line);
        if let (Some(file), 1..) = (self.file, line) {
            write!(f, "{}:{line}: ", file.name)?;
            if let Some(recipe) = file.recipe_at(line) {
                write!(f, "recipe {}: ", recipe.key)?;
            }
        }
        write!(f, "{}", self.error)
    }
}
