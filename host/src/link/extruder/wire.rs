//! The extruder's lines as bytes: shared by Screed's end and by the simulated extruder. Nothing here allocates.

use std::fmt::{self, Write};

/// Bytes of the longest line with its newline, `A 4294967295 4294967295 3*FFFF\n`, and one to spare.
const LINE_MAX: usize = 32;
/// CRC-16/IBM-3740 (polynomial 0x1021, start 0xFFFF): finds every error of up to three bits in lines this short.
const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// The wire's unit, nl/s, as m³/s. Divides, so that 10,000,000 nl/s is the f64 nearest to 1e-5 m³/s.
pub fn cubic_metres(flow_nl_s: u32) -> f64 {
    f64::from(flow_nl_s) / 1e12
}

/// A flow (m³/s) in the wire's unit, rounded; callers have checked that it is 0 to 4e-3.
pub fn nanolitres(flow: f64) -> u32 {
    (flow * 1e12).round() as u32
}

/// What the extruder says is wrong with it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceFault {
    /// 0: nothing.
    #[default]
    None,
    /// 1: it got no valid line for 500 ms and stopped.
    Watchdog,
    /// 2: it was told a flow above its own maximum and stopped.
    FlowRefused,
    /// 3: its drive failed.
    Drive,
}

impl DeviceFault {
    const fn code(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Watchdog => 1,
            Self::FlowRefused => 2,
            Self::Drive => 3,
        }
    }

    fn from_code(code: u32) -> Option<Self> {
        [Self::None, Self::Watchdog, Self::FlowRefused, Self::Drive].into_iter().find(|fault| fault.code() == code)
    }

    /// What to do about it.
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::None => "nothing",
            Self::Watchdog => {
                "look at the bead for a gap, then start from that layer; a busy machine or a bad cable does this"
            }
            Self::FlowRefused => "set flow_max_mm3_s in [extruder] of the cell file to the pump's own maximum",
            Self::Drive => "look at the pump: it stands still until its drive is repaired or reset",
        }
    }
}

impl fmt::Display for DeviceFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "none",
            Self::Watchdog => "it got no valid line for 500 ms and stopped",
            Self::FlowRefused => "the flow is above its own maximum; it stopped",
            Self::Drive => "its drive failed",
        })
    }
}

/// Screed to extruder: `F <seq> <flow>*<crc>`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Command {
    /// Number of the line.
    pub seq: u32,
    /// The flow from now on (nl/s).
    pub flow_nl_s: u32,
}

impl Command {
    /// The line, newline included.
    pub fn encode(&self) -> Line {
        Line::seal(format_args!("F {} {}", self.seq, self.flow_nl_s))
    }

    /// The command in a line without its newline; `None` when it is none or damaged.
    pub fn decode(line: &[u8]) -> Option<Self> {
        let [seq, flow_nl_s] = numbers(line, "F")?;
        Some(Self { seq, flow_nl_s })
    }
}

/// Extruder to Screed: `A <seq> <flow> <fault>*<crc>`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Number of the last valid line it got.
    pub seq: u32,
    /// Its actual flow (nl/s).
    pub flow_nl_s: u32,
    /// What is wrong.
    pub fault: DeviceFault,
}

impl Answer {
    /// The line, newline included.
    pub fn encode(&self) -> Line {
        Line::seal(format_args!("A {} {} {}", self.seq, self.flow_nl_s, self.fault.code()))
    }

    /// The answer in a line without its newline; `None` when it is none or damaged.
    pub fn decode(line: &[u8]) -> Option<Self> {
        let [seq, flow_nl_s, fault] = numbers(line, "A")?;
        Some(Self { seq, flow_nl_s, fault: DeviceFault::from_code(fault)? })
    }
}

/// Checks letter and checksum, and gives the N numbers between them.
fn numbers<const N: usize>(line: &[u8], letter: &str) -> Option<[u32; N]> {
    let (payload, seal) = line.split_at_checked(line.len().checked_sub(5)?)?;
    let seal = std::str::from_utf8(seal).ok()?.strip_prefix('*')?;
    // from_str_radix would also take a sign and small letters.
    let is_hex = seal.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'A'..=b'F'));
    if !is_hex || u16::from_str_radix(seal, 16).ok()? != CRC.checksum(payload) {
        return None;
    }
    let mut words = std::str::from_utf8(payload).ok()?.split(' ');
    if words.next()? != letter {
        return None;
    }
    let mut found = [0; N];
    for number in &mut found {
        let word = words.next()?;
        if !word.bytes().all(|byte| byte.is_ascii_digit()) {
            return None;
        }
        *number = word.parse().ok()?;
    }
    words.next().is_none().then_some(found)
}

/// One line to send, in fixed memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    bytes: [u8; LINE_MAX],
    len: usize,
}

impl Line {
    /// No bytes.
    pub const fn empty() -> Self {
        Self { bytes: [0; LINE_MAX], len: 0 }
    }

    /// The bytes to send.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    fn seal(payload: fmt::Arguments<'_>) -> Self {
        let mut line = Self::empty();
        // The longest line fits, see LINE_MAX; one that did not would be empty and never leave.
        if line.write_fmt(payload).is_err() {
            return Self::empty();
        }
        let checksum = CRC.checksum(line.bytes());
        if writeln!(line, "*{checksum:04X}").is_err() {
            return Self::empty();
        }
        line
    }
}

impl Write for Line {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let end = self.len + text.len();
        self.bytes.get_mut(self.len..end).ok_or(fmt::Error)?.copy_from_slice(text.as_bytes());
        self.len = end;
        Ok(())
    }
}

/// Cuts received bytes into lines, in fixed memory.
#[derive(Clone, Debug)]
pub struct Lines {
    bytes: [u8; LINE_MAX],
    /// Bytes since the last newline; more than the memory holds when the line is too long.
    len: usize,
}

impl Lines {
    /// Waiting for the first byte.
    pub const fn new() -> Self {
        Self { bytes: [0; LINE_MAX], len: 0 }
    }

    /// Takes one byte; gives the line without its newline when this byte ends it. Of a line that is too long the beginning
    /// is given, which no checksum fits.
    pub fn push(&mut self, byte: u8) -> Option<&[u8]> {
        if byte == b'\n' {
            let len = std::mem::take(&mut self.len).min(LINE_MAX);
            return self.bytes.get(..len);
        }
        if let Some(slot) = self.bytes.get_mut(self.len) {
            *slot = byte;
        }
        self.len = self.len.saturating_add(1);
        None
    }
}

impl Default for Lines {
    fn default() -> Self {
        Self::new()
    }
}
