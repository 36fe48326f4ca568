//! Frames: all that crosses between host and kernel. `docs/frames.md` has every byte.
//!
//! On the wire a frame is COBS (Cheshire and Baker, "Consistent Overhead Byte Stuffing", 1999) of
//! `version · postcard(message) · CRC-32 (little-endian)`, ended by one zero byte. A reader that meets garbage is in step
//! again at the next zero.
//!
//! The version is major and minor, four bits each. A reader refuses another major. A higher minor has only appended messages
//! (and variants within them), never changed one: what is not known here is [`FrameError::Message`], is counted, and stops
//! nothing; old bytes stay readable.

mod message;

pub use message::*;

use serde::{Deserialize, Serialize};

/// Version of envelope and messages, major in the upper four bits, minor in the lower: 1.1.
pub const VERSION: u8 = 0x11;

/// Longest frame before COBS: version, message, CRC.
pub const FRAME_MAX: usize = 1024;

/// Longest frame on the wire: COBS adds one byte in 254, and the final zero.
pub const WIRE_MAX: usize = FRAME_MAX + FRAME_MAX / 254 + 2;

/// Version and CRC.
const ENVELOPE: usize = 5;

/// A frame that cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// Longer than [`FRAME_MAX`], or no room for the encoded frame.
    TooLong,
    /// Not valid COBS.
    Stuffing,
    /// Shorter than version and CRC, or the CRC does not match.
    Crc,
    /// Another major version.
    Version(u8),
    /// The message is not one of those known here.
    Message,
}

/// Writes one frame, its zero byte included, and returns its length.
///
/// # Errors
/// [`FrameError::TooLong`] when the message or `out` is too large or too small.
pub fn encode<M: Serialize>(message: &M, out: &mut [u8]) -> Result<usize, FrameError> {
    let mut plain = [0_u8; FRAME_MAX];
    let [version, rest @ ..] = &mut plain;
    *version = VERSION;
    let room = rest.get_mut(..FRAME_MAX - ENVELOPE).ok_or(FrameError::TooLong)?;
    let body = postcard::to_slice(message, room).map_err(|_| FrameError::TooLong)?.len().saturating_add(1);
    let crc = plain.iter().take(body).fold(CRC_START, |crc, &byte| crc_step(crc, byte));
    let place = plain.get_mut(body..).and_then(|rest| rest.first_chunk_mut());
    *place.ok_or(FrameError::TooLong)? = (!crc).to_le_bytes();
    stuff(plain.get(..body.saturating_add(4)).ok_or(FrameError::TooLong)?, out)
}

/// COBS: runs of up to 254 bytes without a zero, each behind a byte that gives its length plus one.
fn stuff(plain: &[u8], out: &mut [u8]) -> Result<usize, FrameError> {
    let mut put = |at: usize, byte: u8| out.get_mut(at).map(|slot| *slot = byte).ok_or(FrameError::TooLong);
    // Where the present run's length stands is known only when the run ends; until then its place is kept.
    put(0, 0)?;
    let (mut code_at, mut used, mut code) = (0, 1, 1_u8);
    for &byte in plain {
        if code == u8::MAX {
            put(code_at, code)?;
            put(used, 0)?;
            (code_at, used, code) = (used, used + 1, 1);
        }
        put(used, byte)?;
        if byte == 0 {
            put(code_at, code)?;
            (code_at, code) = (used, 1);
        } else {
            code += 1;
        }
        used += 1;
    }
    put(code_at, code)?;
    put(used, 0)?;
    Ok(used + 1)
}

/// Takes bytes one at a time, undoes COBS and checks the CRC on the way, and hands out whole frames. The work for a byte is
/// constant, also for a frame's last.
#[derive(Clone, Debug)]
pub struct Reader {
    plain: [u8; FRAME_MAX],
    len: usize,
    crc: u32,
    /// Bytes left in the present run.
    left: u8,
    /// Whether a zero stands behind the present run.
    zero_follows: bool,
    failed: Option<FrameError>,
    started: bool,
}

impl Reader {
    /// A reader that stands at the beginning of a frame.
    pub const fn new() -> Self {
        let plain = [0; FRAME_MAX];
        Self { plain, len: 0, crc: CRC_START, left: 0, zero_follows: false, failed: None, started: false }
    }

    /// Takes one byte. At the end of a frame returns its message bytes (version and CRC checked and removed) or what was
    /// wrong with it; until then `None`.
    pub fn push(&mut self, byte: u8) -> Option<Result<&[u8], FrameError>> {
        #[cfg(test)]
        crate::steps::count();
        if byte == 0 {
            return self.finish();
        }
        if self.left == 0 {
            if self.zero_follows {
                self.store(0);
            }
            self.left = byte - 1;
            // A run of 254 stands without a zero behind it.
            self.zero_follows = byte != u8::MAX;
            self.started = true;
        } else {
            self.left -= 1;
            self.store(byte);
        }
        None
    }

    fn store(&mut self, byte: u8) {
        let len = self.len;
        match self.plain.get_mut(len) {
            Some(slot) => {
                *slot = byte;
                self.len = len + 1;
                self.crc = crc_step(self.crc, byte);
            }
            None => self.failed = Some(FrameError::TooLong),
        }
    }

    fn finish(&mut self) -> Option<Result<&[u8], FrameError>> {
        let Self { len, crc, left, failed, started, .. } = *self;
        (self.len, self.crc, self.left, self.zero_follows) = (0, CRC_START, 0, false);
        (self.failed, self.started) = (None, false);
        if !started {
            return None;
        }
        Some(match failed {
            Some(error) => Err(error),
            None if left != 0 => Err(FrameError::Stuffing),
            None if len < ENVELOPE || crc != CRC_RESIDUE => Err(FrameError::Crc),
            None => open(self.plain.get(..len - 4).unwrap_or(&[])),
        })
    }
}

impl Default for Reader {
    fn default() -> Self {
        Self::new()
    }
}

fn open(checked: &[u8]) -> Result<&[u8], FrameError> {
    match checked.split_first() {
        Some((&version, message)) if version >> 4 == VERSION >> 4 => Ok(message),
        Some((&version, _)) => Err(FrameError::Version(version)),
        None => Err(FrameError::Crc),
    }
}

/// Reads a message out of a frame's bytes.
///
/// # Errors
/// [`FrameError::Message`] when the bytes are no message of this kind.
pub fn decode<'a, M: Deserialize<'a>>(message: &'a [u8]) -> Result<M, FrameError> {
    match postcard::take_from_bytes(message) {
        Ok((message, [])) => Ok(message),
        _ => Err(FrameError::Message),
    }
}

/// CRC-32/ISO-HDLC (ITU-T V.42; the catalogue's check value for "123456789" is 0xCBF43926), reflected, byte by byte.
const CRC_TABLE: [u32; 256] = {
    let mut table = [0_u32; 256];
    let mut index = 0;
    while index < 256 {
        let mut crc = index as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
            bit += 1;
        }
        table[index] = crc;
        index += 1;
    }
    table
};

const CRC_START: u32 = u32::MAX;

/// What the register holds when a frame's own CRC has gone through it as well.
const CRC_RESIDUE: u32 = 0xdebb_20e3;

fn crc_step(crc: u32, byte: u8) -> u32 {
    let [low, ..] = crc.to_le_bytes();
    CRC_TABLE[usize::from(low ^ byte)] ^ (crc >> 8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crc_is_the_catalogues() {
        let register = b"123456789".iter().fold(CRC_START, |crc, &byte| crc_step(crc, byte));
        assert_eq!(!register, 0xcbf4_3926);
        let residue = (!register).to_le_bytes().iter().fold(register, |crc, &byte| crc_step(crc, byte));
        assert_eq!(residue, CRC_RESIDUE);
    }

    #[test]
    fn cobs_is_that_of_the_papers_examples() {
        // The examples of the paper, section III, as every implementation gives them.
        for (plain, expected) in [
            (&[0][..], &[1, 1, 0][..]),
            (&[0, 0], &[1, 1, 1, 0]),
            (&[0x11, 0x22, 0, 0x33], &[3, 0x11, 0x22, 2, 0x33, 0]),
            (&[0x11, 0x22, 0x33, 0x44], &[5, 0x11, 0x22, 0x33, 0x44, 0]),
        ] {
            let mut out = [0xee; 16];
            let used = stuff(plain, &mut out).unwrap();
            assert_eq!(&out[..used], expected);
        }
    }
}
