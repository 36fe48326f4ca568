//! Frames: all that crosses between host and kernel.
//!
//! On the wire a frame is COBS (Cheshire and Baker, "Consistent Overhead Byte Stuffing", 1999) of
//! `version · postcard(message) · CRC-32 (little-endian)`, ended by one zero byte. A reader that meets garbage is in step
//! again at the next zero.

use crate::guard::{Limits, Quantity};
use crate::units::{JointAcc, JointJerk, JointPos, JointVel};
use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::{Deserialize, Serialize};

/// Version of envelope and messages. A reader refuses any other.
pub const VERSION: u8 = 1;

/// Most joints a message can speak of.
pub const JOINTS_MAX: usize = 9;

/// Longest frame before COBS: version, message, CRC.
pub const FRAME_MAX: usize = 2048;

/// Longest frame on the wire: COBS adds one byte in 254, and the final zero.
pub const WIRE_MAX: usize = FRAME_MAX + FRAME_MAX / 254 + 2;

/// Room for setpoint code in one [`ToKernel::Batch`]: what is left of [`FRAME_MAX`] by its other fields at their longest.
pub const CODE_MAX: usize = FRAME_MAX - 48;

/// Longest text in a message (bytes).
pub const NOTE_MAX: usize = 480;

const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// One value a joint.
pub type JointValues = heapless::Vec<f64, JOINTS_MAX>;

/// What the host says.
// The large variant comes once a job, and without an allocator it cannot be boxed.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToKernel<'a> {
    /// Asks for a [`Status`]; drops a batch that was left half sent.
    Hello,
    /// Sets limits and period. Refused unless the kernel is unconfigured or holding with an empty ring.
    Configure(Configure),
    /// Part of a batch of setpoints.
    Batch(#[serde(borrow)] BatchPart<'a>),
    /// Path clock rate to play at, 0 to 1.
    Rate(f64),
    /// Comes to rest on the path; the ring stays.
    Hold,
    /// Plays on (or begins). A person's command: refused unless `epoch` is the kernel's, so that it speaks of this ring.
    Resume {
        /// Epoch from the last [`Status`].
        epoch: u32,
    },
    /// Comes to rest on the path, then drops the ring.
    Stop,
    /// Leaves a fault. A person's command: refused unless `fault` is the present fault's number.
    Rearm {
        /// Number from [`Status::fault`].
        fault: u32,
    },
    /// Ends the real-time process, which first comes to rest.
    Quit,
}

/// A batch comes in parts small enough for one frame each; the last part commits it, and it is taken whole or not at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BatchPart<'a> {
    /// Number of the batch, chosen by the host, repeated in the answer.
    pub batch: u32,
    /// Sequence number of this part's first setpoint.
    pub first_seq: u32,
    /// The first part opens the batch.
    pub opens: bool,
    /// The last part commits it.
    pub commits: bool,
    /// In the first part: the batch replaces what follows this setpoint. Without it follows the ring's end.
    pub after: Option<u32>,
    /// Setpoints by [`crate::setpoint::Coder`], whole ones only.
    pub code: &'a [u8],
}

/// Limits and period; SI units, one value a joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Configure {
    /// Period of setpoints and ticks (ns).
    pub period_ns: u64,
    /// Lowest positions (rad or m).
    pub position_min: JointValues,
    /// Highest positions (rad or m).
    pub position_max: JointValues,
    /// Highest speeds (rad/s or m/s).
    pub velocity_max: JointValues,
    /// Highest accelerations (rad/s² or m/s²).
    pub acceleration_max: JointValues,
    /// Highest jerks (rad/s³ or m/s³).
    pub jerk_max: JointValues,
    /// Farthest that any joint's actual position may be from its target (rad or m).
    pub following_error_max: f64,
}

impl Configure {
    /// The limits for an arm of N joints, if every list has N values.
    pub fn limits<const N: usize>(&self) -> Option<Limits<N>> {
        let list = |values: &JointValues| <[f64; N]>::try_from(values.as_slice()).ok();
        Some(Limits {
            position_min: JointPos(list(&self.position_min)?),
            position_max: JointPos(list(&self.position_max)?),
            velocity_max: JointVel(list(&self.velocity_max)?),
            acceleration_max: JointAcc(list(&self.acceleration_max)?),
            jerk_max: JointJerk(list(&self.jerk_max)?),
        })
    }
}

/// What the kernel's process says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromKernel {
    /// Where the kernel stands: on [`ToKernel::Hello`], on every change of mode, and regularly.
    Status(Status),
    /// The batch is in the ring.
    Accepted {
        /// Its number.
        batch: u32,
    },
    /// The message was not obeyed; nothing changed.
    Refused {
        /// Number of the batch, or 0 for any other message.
        batch: u32,
        /// Why.
        reason: Refusal,
    },
    /// One cycle, as it was.
    Cycle(CycleRecord),
    /// To a host that has just attached: what kind of process it speaks to.
    Process {
        /// Whether the process has the scheduling and the locked memory that the cell file asks for.
        realtime: bool,
        /// What was refused, in words for a person; empty when nothing was.
        note: heapless::String<NOTE_MAX>,
    },
    /// Something failed outside the kernel: the link to the robot or to the extruder.
    Alarm {
        /// Whether the process ends.
        fatal: bool,
        /// Cause and action, in words for a person.
        note: heapless::String<NOTE_MAX>,
    },
}

/// Why a message was not obeyed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal {
    /// The message does not fit the present mode.
    Mode,
    /// Configuration with a wrong count of joints, a period of zero, or a limit that is not finite or not positive.
    Configuration,
    /// No room: wait for credits.
    Full,
    /// The setpoint to replace after has been consumed.
    TooLate,
    /// Sequence numbers do not continue what the ring holds, or a part is missing.
    Sequence,
    /// The code of a setpoint is broken.
    Code,
    /// A setpoint breaks a limit; the batch was refused whole.
    DoesNotFit {
        /// Its sequence number.
        seq: u32,
        /// Which limit.
        quantity: Quantity,
        /// Joint, 0 for the first.
        joint: u8,
        /// Value found (SI).
        value: f64,
        /// Value allowed (SI).
        limit: f64,
    },
    /// The batch does not end at rest: its last two setpoints differ, or material still flows.
    NotAtRest,
    /// The rate is not in 0 to 1.
    Rate,
    /// The epoch or fault number is not the present one: look at the status and decide again.
    Stale,
}

/// Mode without its data, as it crosses the wire and stands in the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum ModeCode {
    /// No configuration, or the robot's position is not known: nothing is put out.
    Unready = 0,
    /// At rest.
    Holding = 1,
    /// Playing the ring.
    Moving = 2,
    /// Coming to rest on the path.
    Stopping = 3,
    /// At rest after a fault.
    Faulted = 4,
}

/// Where the kernel stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Ticks since start.
    pub tick: u64,
    /// Counts configurations and dropped rings: what a host knew of another epoch no longer holds.
    pub epoch: u32,
    /// Mode.
    pub mode: ModeCode,
    /// Present fault, if any.
    pub fault: Option<FaultReport>,
    /// Setpoint consumed last; what follows it can be replaced.
    pub consumed: u32,
    /// Last setpoint held.
    pub end_seq: u32,
    /// Setpoints the ring can take.
    pub credits: u32,
    /// Path clock rate.
    pub rate: f64,
    /// Frames dropped as broken since start.
    pub frames_broken: u32,
}

/// A fault as it crosses the wire; the words are in [`crate::fault`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultReport {
    /// Counts faults from 1: what [`ToKernel::Rearm`] must name.
    pub number: u32,
    /// What happened.
    pub fault: crate::fault::Fault,
    /// At which tick.
    pub tick: u64,
}

/// One cycle of the real-time process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CycleRecord {
    /// Tick.
    pub tick: u64,
    /// The robot's telegram was read (ns, monotonic clock).
    pub received_ns: u64,
    /// The tick was over (ns).
    pub ticked_ns: u64,
    /// The answer was written (ns).
    pub sent_ns: u64,
    /// The robot's own time stamp (s).
    pub robot_time: f64,
    /// Robot cycles that went by since the record before without an answer of their own.
    pub missed: u32,
    /// Setpoint commanded; 0 before the first.
    pub seq: u32,
    /// Mode.
    pub mode: ModeCode,
    /// Whether material is being laid.
    pub deposit: bool,
    /// Path clock rate.
    pub rate: f64,
    /// Flow commanded (m³/s).
    pub flow: f64,
    /// Joints commanded (rad or m).
    pub commanded: JointValues,
    /// Joints as the robot says they are (rad or m).
    pub actual: JointValues,
}

/// A frame that cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// Longer than [`FRAME_MAX`], or no room for the encoded frame.
    TooLong,
    /// Not valid COBS.
    Stuffing,
    /// Shorter than version and CRC, or the CRC does not match.
    Crc,
    /// Another version.
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
    let room = rest.get_mut(..FRAME_MAX - 5).ok_or(FrameError::TooLong)?;
    let body = 1 + postcard::to_slice(message, room).map_err(|_| FrameError::TooLong)?.len();
    let crc = CRC.checksum(plain.get(..body).ok_or(FrameError::TooLong)?).to_le_bytes();
    plain.get_mut(body..body + 4).ok_or(FrameError::TooLong)?.copy_from_slice(&crc);
    stuff(plain.get(..body + 4).ok_or(FrameError::TooLong)?, out)
}

/// COBS: runs of up to 254 bytes without a zero, each behind a byte that gives its length plus one.
fn stuff(plain: &[u8], out: &mut [u8]) -> Result<usize, FrameError> {
    let (mut code_at, mut used, mut code) = (0, 1, 1_u8);
    let mut put = |at: usize, byte: u8| out.get_mut(at).map(|slot| *slot = byte).ok_or(FrameError::TooLong);
    for &byte in plain {
        if code == u8::MAX {
            put(code_at, code)?;
            (code_at, used, code) = (used, used + 1, 1);
        }
        if byte == 0 {
            put(code_at, code)?;
            (code_at, used, code) = (used, used + 1, 1);
        } else {
            put(used, byte)?;
            used += 1;
            code += 1;
        }
    }
    put(code_at, code)?;
    put(used, 0)?;
    Ok(used + 1)
}

/// Takes bytes one at a time, undoes COBS on the way, and hands out whole frames. Constant work a byte, but for the CRC of a
/// finished frame, which is linear in its length.
#[derive(Clone, Debug)]
pub struct Reader {
    plain: [u8; FRAME_MAX],
    len: usize,
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
        Self { plain: [0; FRAME_MAX], len: 0, left: 0, zero_follows: false, failed: None, started: false }
    }

    /// Takes one byte. At the end of a frame returns its message bytes (version and CRC checked and removed) or what was
    /// wrong with it; until then `None`.
    pub fn push(&mut self, byte: u8) -> Option<Result<&[u8], FrameError>> {
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
            self.store(byte);
            self.left -= 1;
        }
        None
    }

    fn store(&mut self, byte: u8) {
        match self.plain.get_mut(self.len) {
            Some(slot) => {
                *slot = byte;
                self.len += 1;
            }
            None => self.failed = Some(FrameError::TooLong),
        }
    }

    fn finish(&mut self) -> Option<Result<&[u8], FrameError>> {
        let (len, left, failed, started) = (self.len, self.left, self.failed, self.started);
        (self.len, self.left, self.zero_follows, self.failed, self.started) = (0, 0, false, None, false);
        if !started {
            return None;
        }
        Some(match failed {
            Some(error) => Err(error),
            None if left != 0 => Err(FrameError::Stuffing),
            None => open(self.plain.get(..len).unwrap_or(&[])),
        })
    }
}

impl Default for Reader {
    fn default() -> Self {
        Self::new()
    }
}

fn open(plain: &[u8]) -> Result<&[u8], FrameError> {
    let (checked, crc) = plain.split_last_chunk::<4>().ok_or(FrameError::Crc)?;
    if CRC.checksum(checked) != u32::from_le_bytes(*crc) {
        return Err(FrameError::Crc);
    }
    match checked.split_first() {
        Some((&VERSION, message)) => Ok(message),
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

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::vec::Vec;

    fn wire(message: &ToKernel) -> Vec<u8> {
        let mut out = [0; WIRE_MAX];
        let used = encode(message, &mut out).unwrap();
        out[..used].to_vec()
    }

    #[test]
    fn every_length_of_payload_comes_back() {
        let payload: Vec<u8> = (0..CODE_MAX).map(|k| (k * 7 % 256) as u8).collect();
        let mut reader = Reader::new();
        for len in (0..600).chain([1000, CODE_MAX]) {
            for flat in [None, Some(0_u8), Some(1)] {
                let code: Vec<u8> = payload[..len].iter().map(|&b| flat.unwrap_or(b)).collect();
                let part =
                    BatchPart { batch: 7, first_seq: 9, opens: true, commits: false, after: Some(8), code: &code };
                let bytes = wire(&ToKernel::Batch(part));
                assert_eq!(bytes.iter().filter(|&&b| b == 0).count(), 1);
                let (last, head) = bytes.split_last().unwrap();
                assert!(head.iter().all(|&byte| reader.push(byte).is_none()));
                let message = reader.push(*last).unwrap().unwrap();
                assert_eq!(decode::<ToKernel>(message), Ok(ToKernel::Batch(part)));
            }
        }
    }

    #[test]
    fn a_flipped_bit_or_a_lost_byte_is_noticed_and_the_next_frame_is_read() {
        let good = wire(&ToKernel::Resume { epoch: 3 });
        for at in 0..good.len() {
            for bit in 0..9 {
                let mut bad = good.clone();
                if bit == 8 {
                    bad.remove(at);
                } else {
                    bad[at] ^= 1 << bit;
                }
                bad.push(0);
                bad.extend(&good);
                let mut reader = Reader::new();
                let mut messages = 0;
                for &byte in &bad {
                    if let Some(Ok(message)) = reader.push(byte) {
                        assert_eq!(decode::<ToKernel>(message), Ok(ToKernel::Resume { epoch: 3 }));
                        messages += 1;
                    }
                }
                // Losing only the final zero loses nothing: another zero follows.
                let expected = if at == good.len() - 1 && bit == 8 { 2 } else { 1 };
                assert_eq!(messages, expected, "byte {at}, bit {bit}");
            }
        }
    }
}
