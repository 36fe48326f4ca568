//! Record and replay: the cycle log, a compact binary file with one record a cycle. `docs/log.md` is its manual.
//!
//! Records stand in blocks with a checksum each, and an end mark closes the file. A writer that was killed loses at most
//! the block it was filling, and the reader says so; a damaged block is an error and is never handed out.

mod csv;
mod reader;
#[cfg(test)]
mod tests;
mod writer;

pub use csv::{CsvError, write_csv};
pub use reader::LogReader;
pub use writer::LogWriter;

use crate::failure::{Exit, Failure};
use screed_kernel::units::{JointPos, Nanos, Tick};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

const MAGIC: [u8; 8] = *b"SCREEDLG";
const VERSION: u16 = 2;
/// Bytes of one record.
const RECORD_SIZE: usize = 176;
/// Records of a full block: half a second at 125 Hz.
const BLOCK_RECORDS: usize = 64;
/// More than any metadata needs; a larger figure is damage.
const METADATA_SIZE_MAX: usize = 1 << 20;
/// The checksum of Ethernet and ZIP.
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// What the whole log is about.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Metadata {
    /// Screed's version.
    pub screed: String,
    /// The cell's name.
    pub cell: String,
    /// The model's file name.
    pub model: String,
    /// A hash of the model's bytes, hexadecimal.
    pub model_hash: String,
    /// The robot's name in the catalogue.
    pub arm: String,
    /// Cycles a second (Hz).
    pub rate_hz: u32,
    /// What the mode numbers of the records mean: the name of mode k is the k-th.
    pub modes: Vec<String>,
}

/// One cycle of the real-time process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CycleRecord {
    /// Count of cycles since the real-time process started.
    pub tick: Tick,
    /// When the robot's state lay ready to be read, or the timer's slot began.
    pub readable: Nanos,
    /// When the robot's state had been received (monotonic clock; virtual time in a fast run).
    pub received: Nanos,
    /// When the kernel's tick had ended.
    pub ticked: Nanos,
    /// When the setpoint had been handed to the network.
    pub sent: Nanos,
    /// The robot's own time stamp (s).
    pub robot_timestamp: f64,
    /// Sequence number of the setpoint that was sent; 0 before the first.
    pub seq: u32,
    /// The kernel's mode; [`Metadata::modes`] has the names.
    pub mode: u8,
    /// What else is true of this cycle.
    pub flags: Flags,
    /// Index of the layer, the first is 0.
    pub layer: u16,
    /// Rate of the path clock, 0 to 1.
    pub rate: f64,
    /// Commanded volume flow of the extruder (m³/s).
    pub flow: f64,
    /// Commanded joints (rad).
    pub commanded: JointPos<6>,
    /// The robot's joints by its encoders (rad).
    pub actual: JointPos<6>,
    /// Slots before this cycle that went without an answer; above 0 it is an overrun.
    pub missed: u32,
    /// The leaky counter of overruns, this one included.
    pub overrun_level: u32,
}

/// What is true of a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags(pub u8);

impl Flags {
    /// The tool deposits.
    pub const DEPOSIT: Self = Self(1);
    /// While the path was played, the robot had a setpoint once more: at least one of its states went without an answer.
    pub const DOUBLED: Self = Self(2);
    /// At least one state of the robot before this one went without an answer.
    pub const SKIPPED: Self = Self(4);

    /// The process had not all that a hard-timed loop needs.
    pub const NON_RT: Self = Self(8);

    /// Whether all flags of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl std::ops::BitOr for Flags {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl CycleRecord {
    /// Little-endian, in the order of the fields.
    fn encode(&self, out: &mut Vec<u8>) {
        for stamp in [self.tick.0, self.readable.0, self.received.0, self.ticked.0, self.sent.0] {
            out.extend(stamp.to_le_bytes());
        }
        out.extend(self.robot_timestamp.to_le_bytes());
        out.extend(self.seq.to_le_bytes());
        out.extend([self.mode, self.flags.0]);
        out.extend(self.layer.to_le_bytes());
        for value in [self.rate, self.flow].iter().chain(&self.commanded.0).chain(&self.actual.0) {
            out.extend(value.to_le_bytes());
        }
        out.extend(self.missed.to_le_bytes());
        out.extend(self.overrun_level.to_le_bytes());
    }

    /// `None` when fewer bytes than a record are left.
    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        let tick = Tick(u64::from_le_bytes(take(bytes)?));
        let readable = Nanos(u64::from_le_bytes(take(bytes)?));
        let received = Nanos(u64::from_le_bytes(take(bytes)?));
        let ticked = Nanos(u64::from_le_bytes(take(bytes)?));
        let sent = Nanos(u64::from_le_bytes(take(bytes)?));
        let robot_timestamp = f64::from_le_bytes(take(bytes)?);
        let seq = u32::from_le_bytes(take(bytes)?);
        let [mode, flags] = take(bytes)?;
        let layer = u16::from_le_bytes(take(bytes)?);
        let rate = f64::from_le_bytes(take(bytes)?);
        let flow = f64::from_le_bytes(take(bytes)?);
        let mut joints = || {
            let mut joints = JointPos::ZERO;
            for joint in &mut joints.0 {
                *joint = f64::from_le_bytes(take(bytes)?);
            }
            Some(joints)
        };
        let (commanded, actual) = (joints()?, joints()?);
        let flags = Flags(flags);
        let missed = u32::from_le_bytes(take(bytes)?);
        let overrun_level = u32::from_le_bytes(take(bytes)?);
        Some(Self {
            tick,
            readable,
            received,
            ticked,
            sent,
            robot_timestamp,
            seq,
            mode,
            flags,
            layer,
            rate,
            flow,
            commanded,
            actual,
            missed,
            overrun_level,
        })
    }
}

/// The first N bytes, which are then gone from the slice.
fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}

/// Why a log cannot be written or read on.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file system refused.
    #[error("cannot {action} the log {}: {source}", file.display())]
    Io {
        /// "create", "write", "read", …
        action: &'static str,
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file does not begin like a log.
    #[error("{} is no Screed log: expected the first bytes {MAGIC:?}, found {found:?}", file.display())]
    NotALog {
        /// The file.
        file: PathBuf,
        /// Its first bytes.
        found: Vec<u8>,
    },
    /// The log is of another version of the format.
    #[error("{} is a log of format {found}: expected format {VERSION}", file.display())]
    Version {
        /// The file.
        file: PathBuf,
        /// Its version.
        found: u16,
    },
    /// The file's beginning is damaged: nothing of it can be read.
    #[error("{}: the header is damaged: {what}", file.display())]
    Header {
        /// The file.
        file: PathBuf,
        /// How.
        what: String,
    },
    /// The file ends without its end mark. All records before it are whole.
    #[error(
        "{}: the log ends at byte {offset} without its end mark, after {records} whole records: its writer was stopped or \
         the file was cut", file.display()
    )]
    Torn {
        /// The file.
        file: PathBuf,
        /// Where the first byte that does not belong to a whole block stands.
        offset: u64,
        /// Count of whole records before it.
        records: u64,
    },
    /// A block is not as it was written. All records before it are whole.
    #[error("{}: the block at byte {offset} is damaged ({what}), after {records} whole records", file.display())]
    Corrupt {
        /// The file.
        file: PathBuf,
        /// Where the block begins.
        offset: u64,
        /// How it was noticed.
        what: String,
        /// Count of whole records before it.
        records: u64,
    },
}

impl LogError {
    /// What to do about it.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Io { .. } => "check the path, the rights and the free space",
            Self::NotALog { .. } => "give a file that `screed print --log` or `screed demo` wrote",
            Self::Version { .. } => "read it with the version of Screed that wrote it",
            Self::Header { .. } => "take another copy of the file; of this one nothing can be trusted",
            Self::Torn { .. } => "the rows given are sound; up to 64 last cycles may be missing",
            Self::Corrupt { .. } => "the rows given are sound; take another copy of the file for the rest",
        }
    }
}

impl From<LogError> for Failure {
    fn from(error: LogError) -> Self {
        Self::new(Exit::Failed, error.to_string(), error.remedy())
    }
}
