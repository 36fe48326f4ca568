//! UR's primary interface, port 30001: what a controller sends unasked. Of it the kinematics of the unit and messages for a
//! person are read; everything else is passed over. Programs are sent on the same
//! port ([`program`]).
//!
//! Layouts after the maker's "Client interfaces" (5.10 and 3.15), and the readers of the Universal_Robots_Client_Library
//! (`src/primary`). All is big-endian: a package is its size (u32, with its 5 header bytes), a type, and its content; a robot
//! state is made of such packages.

#[cfg(test)]
mod tests;

use super::rtde::wire::PayloadReader;
use std::collections::VecDeque;

/// The port on a robot.
pub const PORT: u16 = 30_001;
/// Bytes of a package's header.
const HEADER_LEN: usize = 5;
/// Largest package that is believed to be one; those of a real controller are a few thousand bytes.
const PACKAGE_MAX: u32 = 1 << 20;
/// Largest package whose content is kept to be read.
const KEPT_MAX: usize = 1 << 16;
/// Messages kept until they are polled; older ones go.
const MESSAGES_MAX: usize = 32;
/// Longest text of a message that is kept (characters).
const TEXT_MAX: usize = 400;

/// Types of packages, of parts of a robot state, and of messages.
const ROBOT_STATE: u8 = 16;
const ROBOT_MESSAGE: u8 = 20;
const KINEMATICS: u8 = 5;
const TEXT: u8 = 0;
const ERROR_CODE: u8 = 6;
const KEY: u8 = 7;
const RUNTIME_EXCEPTION: u8 = 10;

/// The arm's table as the controller has it, its unit's calibration included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    /// A checksum over each joint's row, the controller's own.
    pub checksum: [u32; 6],
    /// Turn about z (rad).
    pub theta: [f64; 6],
    /// Shift along the new x (m).
    pub a: [f64; 6],
    /// Shift along z (m).
    pub d: [f64; 6],
    /// Turn about the new x (rad).
    pub alpha: [f64; 6],
    /// 0 not initialised, 1 not linearised, 2 linearised, as `calibration.conf` names them.
    pub status: u32,
}

/// Something for a person.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Whether it tells of an error in the program.
    pub is_exception: bool,
    /// What it says.
    pub text: String,
}

/// Why the stream cannot be read on; the reader stays failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PrimaryError {
    /// No package is of this size.
    #[error("a package of {size} bytes on the primary interface; check the address and the port, then connect again")]
    BadSize {
        /// As it says.
        size: u32,
    },
    /// Too short for its type, or numbers that cannot be.
    #[error(
        "a package of type {kind} on the primary interface whose {what} cannot be read; update the controller's software"
    )]
    Malformed {
        /// Its type.
        kind: u8,
        /// What it is.
        what: &'static str,
    },
}

/// The reader.
#[derive(Clone, Debug, Default)]
pub struct Primary {
    header: [u8; HEADER_LEN],
    /// Bytes of the header that are there.
    headed: usize,
    /// Bytes of the content that have not come.
    missing: usize,
    content: Vec<u8>,
    kinematics: Option<Kinematics>,
    messages: VecDeque<Message>,
    failed: Option<PrimaryError>,
}

impl Primary {
    /// Takes bytes of the controller, split anywhere.
    ///
    /// # Errors
    /// [`PrimaryError`], the same again from then on.
    pub fn handle_bytes(&mut self, bytes: &[u8]) -> Result<(), PrimaryError> {
        self.failed.clone().map_or(Ok(()), Err)?;
        let result = self.take(bytes);
        self.failed = result.clone().err();
        result
    }

    /// The table, once it was told: with the first robot state of a connection.
    pub const fn kinematics(&self) -> Option<&Kinematics> {
        self.kinematics.as_ref()
    }

    /// The next message for a person, oldest first.
    pub fn poll_message(&mut self) -> Option<Message> {
        self.messages.pop_front()
    }

    fn take(&mut self, mut bytes: &[u8]) -> Result<(), PrimaryError> {
        loop {
            while self.headed < HEADER_LEN {
                let Some((first, rest)) = bytes.split_first() else { return Ok(()) };
                if let Some(place) = self.header.get_mut(self.headed) {
                    *place = *first;
                }
                (self.headed, bytes) = (self.headed + 1, rest);
                if self.headed == HEADER_LEN {
                    self.begin()?;
                }
            }
            let (now, rest) = bytes.split_at(self.missing.min(bytes.len()));
            if self.is_kept() {
                self.content.extend_from_slice(now);
            }
            (self.missing, bytes) = (self.missing - now.len(), rest);
            if self.missing > 0 {
                return Ok(());
            }
            self.headed = 0;
            let content = std::mem::take(&mut self.content);
            match self.kind() {
                ROBOT_STATE => self.state(&content)?,
                ROBOT_MESSAGE => self.message(&content)?,
                _ => {}
            }
            // Its memory serves the next one.
            self.content = content;
            self.content.clear();
        }
    }

    const fn kind(&self) -> u8 {
        self.header[4]
    }

    const fn is_kept(&self) -> bool {
        matches!(self.kind(), ROBOT_STATE | ROBOT_MESSAGE)
    }

    fn begin(&mut self) -> Result<(), PrimaryError> {
        let [a, b, c, d, _] = self.header;
        let size = u32::from_be_bytes([a, b, c, d]);
        let content = (size as usize).checked_sub(HEADER_LEN).filter(|_| size <= PACKAGE_MAX);
        let content = content.filter(|content| !self.is_kept() || *content <= KEPT_MAX);
        self.missing = content.ok_or(PrimaryError::BadSize { size })?;
        Ok(())
    }

    fn state(&mut self, content: &[u8]) -> Result<(), PrimaryError> {
        let malformed = |what| PrimaryError::Malformed { kind: ROBOT_STATE, what };
        let mut reader = PayloadReader::new(content);
        while !reader.rest().is_empty() {
            let mut part = || {
                let size = usize::try_from(reader.u32()?).ok()?;
                let kind = reader.u8()?;
                Some((kind, reader.bytes(size.checked_sub(HEADER_LEN)?)?))
            };
            let (kind, part) = part().ok_or_else(|| malformed("parts"))?;
            if kind == KINEMATICS {
                self.kinematics = Some(kinematics(part).ok_or_else(|| malformed("kinematics"))?);
            }
        }
        Ok(())
    }

    fn message(&mut self, content: &[u8]) -> Result<(), PrimaryError> {
        let malformed = |what| PrimaryError::Malformed { kind: ROBOT_MESSAGE, what };
        let mut reader = PayloadReader::new(content);
        // A time and who speaks.
        let kind = reader.bytes(9).and_then(|_| reader.u8()).ok_or_else(|| malformed("type"))?;
        let message = match kind {
            TEXT => Some((false, shown(reader.rest()))),
            KEY => keyed(&mut reader).map(|text| (false, text)),
            ERROR_CODE => coded(&mut reader).map(|text| (true, text)),
            RUNTIME_EXCEPTION => reader
                .i32()
                .zip(reader.i32())
                .map(|(line, column)| (true, format!("line {line}, column {column}: {}", shown(reader.rest())))),
            _ => return Ok(()),
        };
        let (is_exception, text) = message.ok_or_else(|| malformed("message"))?;
        if self.messages.len() >= MESSAGES_MAX {
            self.messages.pop_front();
        }
        self.messages.push_back(Message { is_exception, text });
        Ok(())
    }
}

fn kinematics(part: &[u8]) -> Option<Kinematics> {
    let mut reader = PayloadReader::new(part);
    let mut checksum = [0; 6];
    for joint in &mut checksum {
        *joint = reader.u32()?;
    }
    let [theta, a, d, alpha] = [reader.f64s()?, reader.f64s()?, reader.f64s()?, reader.f64s()?];
    let finite = [&theta, &a, &d, &alpha].into_iter().flatten().all(|value: &f64| value.is_finite());
    let status = reader.u32()?;
    finite.then_some(Kinematics { checksum, theta, a, d, alpha, status })
}

/// A code, its argument, a title and a text.
fn keyed(reader: &mut PayloadReader<'_>) -> Option<String> {
    let (code, argument) = (reader.i32()?, reader.i32()?);
    let length = usize::from(reader.u8()?);
    let title = shown(reader.bytes(length)?);
    Some(format!("C{code}A{argument} {title}: {}", shown(reader.rest())))
}

/// A code, its argument, how grave it is, and what comes along.
fn coded(reader: &mut PayloadReader<'_>) -> Option<String> {
    let (code, argument) = (reader.i32()?, reader.i32()?);
    let (_level, _data_type, _data) = (reader.i32()?, reader.u32()?, reader.u32()?);
    Some(format!("C{code}A{argument} {}", shown(reader.rest())).trim_end().to_owned())
}

/// Text for a terminal: no control characters, of a bounded length.
fn shown(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    text.trim_matches(|c: char| c.is_whitespace() || c.is_control())
        .chars()
        .take(TEXT_MAX)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}

/// The bytes of a program for the controller: its text, which ends in a line break. The controller starts it at once.
pub fn program(text: &str) -> Vec<u8> {
    let mut bytes = text.trim_end().as_bytes().to_vec();
    bytes.push(b'\n');
    bytes
}
