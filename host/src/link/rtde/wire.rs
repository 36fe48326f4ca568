//! The bytes of RTDE, shared by the client and by the simulated controller. Everything is big-endian; a package is its size
//! (u16, these three header bytes included), a type byte and a payload.
//!
//! Source: Universal Robots' RTDE guide, and the package classes of the Universal_Robots_Client_Library (`src/rtde`).

use std::fmt;

/// Bytes before the payload.
pub const HEADER_LEN: usize = 3;
/// The largest package its size field can announce.
pub const PACKAGE_MAX: usize = u16::MAX as usize;
/// Longest message or source in a text package of protocol 2: its length is one byte.
pub const TEXT_MAX: usize = u8::MAX as usize;

/// The version of the protocol. Before one is agreed, packages have the form of the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// No rate in a setup of outputs, no recipe in its answer and in data for the client, texts without a source.
    One,
    /// With all of them.
    Two,
}

impl Protocol {
    /// The number on the wire.
    pub const fn number(self) -> u16 {
        match self {
            Self::One => 1,
            Self::Two => 2,
        }
    }
}

/// What a package is; one byte of its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PackageKind {
    /// `V`: the protocol version the client wants; the answer accepts or not.
    ProtocolVersion,
    /// `v`: the controller's software version.
    ControllerVersion,
    /// `M`: a line of text for a person.
    Text,
    /// `U`: values of a recipe.
    Data,
    /// `O`: which outputs the client wants.
    SetupOutputs,
    /// `I`: which inputs the client will write.
    SetupInputs,
    /// `S`: start sending outputs.
    Start,
    /// `P`: stop sending outputs.
    Pause,
}

impl PackageKind {
    /// The type byte.
    pub const fn code(self) -> u8 {
        match self {
            Self::ProtocolVersion => b'V',
            Self::ControllerVersion => b'v',
            Self::Text => b'M',
            Self::Data => b'U',
            Self::SetupOutputs => b'O',
            Self::SetupInputs => b'I',
            Self::Start => b'S',
            Self::Pause => b'P',
        }
    }

    /// The kind with this type byte.
    pub const fn from_code(code: u8) -> Option<Self> {
        Some(match code {
            b'V' => Self::ProtocolVersion,
            b'v' => Self::ControllerVersion,
            b'M' => Self::Text,
            b'U' => Self::Data,
            b'O' => Self::SetupOutputs,
            b'I' => Self::SetupInputs,
            b'S' => Self::Start,
            b'P' => Self::Pause,
            _ => return None,
        })
    }
}

impl fmt::Display for PackageKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            Self::ProtocolVersion => "protocol version",
            Self::ControllerVersion => "controller version",
            Self::Text => "text message",
            Self::Data => "data",
            Self::SetupOutputs => "output setup",
            Self::SetupInputs => "input setup",
            Self::Start => "start",
            Self::Pause => "pause",
        };
        write!(f, "{name} ('{}')", char::from(self.code()))
    }
}

/// The type of a field in a recipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldType {
    /// One byte, 0 or 1.
    Bool,
    /// One byte.
    Uint8,
    /// Four bytes, unsigned.
    Uint32,
    /// Four bytes, two's complement.
    Int32,
    /// Eight bytes, unsigned.
    Uint64,
    /// IEEE 754 binary64.
    Double,
    /// Three doubles.
    Vector3d,
    /// Six doubles.
    Vector6d,
    /// Six Int32.
    Vector6Int32,
    /// Six Uint32.
    Vector6Uint32,
}

impl FieldType {
    const ALL: [Self; 10] = [
        Self::Bool,
        Self::Uint8,
        Self::Uint32,
        Self::Int32,
        Self::Uint64,
        Self::Double,
        Self::Vector3d,
        Self::Vector6d,
        Self::Vector6Int32,
        Self::Vector6Uint32,
    ];

    /// The name in the answer to a setup.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bool => "BOOL",
            Self::Uint8 => "UINT8",
            Self::Uint32 => "UINT32",
            Self::Int32 => "INT32",
            Self::Uint64 => "UINT64",
            Self::Double => "DOUBLE",
            Self::Vector3d => "VECTOR3D",
            Self::Vector6d => "VECTOR6D",
            Self::Vector6Int32 => "VECTOR6INT32",
            Self::Vector6Uint32 => "VECTOR6UINT32",
        }
    }

    /// How many numbers it has.
    pub const fn elements(self) -> usize {
        match self {
            Self::Vector3d => 3,
            Self::Vector6d | Self::Vector6Int32 | Self::Vector6Uint32 => 6,
            _ => 1,
        }
    }

    /// The names of all types, for messages.
    pub fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }

    /// The type with this name.
    pub fn from_name(name: &[u8]) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name().as_bytes() == name)
    }

    /// Bytes on the wire.
    pub const fn size(self) -> usize {
        match self {
            Self::Bool | Self::Uint8 => 1,
            Self::Uint32 | Self::Int32 => 4,
            Self::Uint64 | Self::Double => 8,
            Self::Vector3d | Self::Vector6Int32 | Self::Vector6Uint32 => 24,
            Self::Vector6d => 48,
        }
    }
}

/// Entries of a comma-separated list; a trailing comma, which some clients send, adds none.
pub fn list_entries(list: &[u8]) -> impl Iterator<Item = &[u8]> {
    let list = list.strip_suffix(b",").unwrap_or(list);
    list.split(|&byte| byte == b',').filter(move |_| !list.is_empty())
}

/// Writes one package into the caller's memory.
#[derive(Debug)]
pub struct PackageWriter<'a> {
    out: &'a mut [u8],
    /// Bytes written so far, or, once they no longer fit, bytes wanted.
    len: usize,
}

impl<'a> PackageWriter<'a> {
    /// Starts a package of this kind at the start of `out`.
    pub fn new(out: &'a mut [u8], kind: PackageKind) -> Self {
        let mut writer = Self { out, len: 0 };
        writer.bytes(&[0, 0, kind.code()]);
        writer
    }

    /// Appends raw bytes.
    pub fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        let end = self.len.saturating_add(bytes.len());
        if let Some(place) = self.out.get_mut(self.len..end) {
            place.copy_from_slice(bytes);
        }
        self.len = end;
        self
    }

    /// Appends a byte.
    pub fn u8(&mut self, value: u8) -> &mut Self {
        self.bytes(&[value])
    }

    /// Appends a double.
    pub fn f64(&mut self, value: f64) -> &mut Self {
        self.bytes(&value.to_be_bytes())
    }

    /// Appends doubles.
    pub fn f64s(&mut self, values: &[f64]) -> &mut Self {
        for value in values {
            self.f64(*value);
        }
        self
    }

    /// Sets the size; the package's length, or None when it did not fit into the memory or into the size field.
    pub fn finish(self) -> Option<usize> {
        let size = u16::try_from(self.len).ok()?;
        self.out.get(..self.len)?;
        self.out.get_mut(..2)?.copy_from_slice(&size.to_be_bytes());
        Some(self.len)
    }
}

/// Reads a payload from its start; None once it ends too early.
#[derive(Clone, Debug)]
pub struct PayloadReader<'a> {
    rest: &'a [u8],
}

impl<'a> PayloadReader<'a> {
    /// Starts at the first byte.
    pub const fn new(payload: &'a [u8]) -> Self {
        Self { rest: payload }
    }

    /// The next `count` bytes.
    pub fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(head)
    }

    /// All bytes that are left.
    pub const fn rest(&self) -> &'a [u8] {
        self.rest
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.rest.split_first_chunk::<N>()?;
        self.rest = rest;
        Some(*head)
    }

    /// The next byte.
    pub fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|[byte]| byte)
    }

    /// The next u16.
    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_be_bytes)
    }

    /// The next u32.
    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_be_bytes)
    }

    /// The next i32.
    pub fn i32(&mut self) -> Option<i32> {
        self.array().map(i32::from_be_bytes)
    }

    /// The next u64.
    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_be_bytes)
    }

    /// The next double.
    pub fn f64(&mut self) -> Option<f64> {
        self.array().map(f64::from_be_bytes)
    }

    /// The next `N` doubles.
    pub fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Some(values)
    }
}

/// A package's first three bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Size of the whole package, header included.
    pub size: u16,
    /// The type byte, not yet judged.
    pub code: u8,
}

/// Cuts a byte stream into packages. Its memory is allocated once; who owns it judges every header before the package
/// is complete, so that a broken size is noticed at once and not waited for.
#[derive(Clone, Debug)]
pub struct Deframer {
    buffer: Box<[u8]>,
    len: usize,
}

impl Deframer {
    /// Room for one package of at most `capacity` bytes.
    pub fn new(capacity: usize) -> Self {
        Self { buffer: vec![0; capacity.max(HEADER_LEN)].into_boxed_slice(), len: 0 }
    }

    /// Takes as many bytes as fit; how many.
    pub fn push(&mut self, bytes: &[u8]) -> usize {
        let free = self.buffer.get_mut(self.len..).unwrap_or(&mut []);
        let taken = free.len().min(bytes.len());
        if let (Some(place), Some(bytes)) = (free.get_mut(..taken), bytes.get(..taken)) {
            place.copy_from_slice(bytes);
        }
        self.len += taken;
        taken
    }

    /// The header of the package at the front, once its three bytes are there.
    pub fn header(&self) -> Option<Header> {
        let mut reader = PayloadReader::new(self.buffer.get(..self.len)?);
        Some(Header { size: reader.u16()?, code: reader.u8()? })
    }

    /// The payload of the package at the front, once all `size` bytes are there.
    pub fn payload(&self, size: u16) -> Option<&[u8]> {
        self.buffer.get(..self.len)?.get(HEADER_LEN..usize::from(size))
    }

    /// Drops `size` bytes at the front.
    pub fn consume(&mut self, size: u16) {
        let size = usize::from(size).min(self.len);
        self.buffer.copy_within(size..self.len, 0);
        self.len -= size;
    }

    /// Drops all of it: another stream begins.
    pub const fn clear(&mut self) {
        self.len = 0;
    }

    /// Bytes of the package at the front that are there.
    pub const fn waiting(&self) -> usize {
        self.len
    }
}

/// Up to `N` bytes of text in fixed memory, `N` at most 255.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct ShortText<const N: usize = TEXT_MAX> {
    bytes: [u8; N],
    len: u8,
}

impl<const N: usize> ShortText<N> {
    /// The text as it came; None when it is longer.
    pub fn new(text: &[u8]) -> Option<Self> {
        let mut short = Self { bytes: [0; N], len: u8::try_from(text.len()).ok()? };
        short.bytes.get_mut(..text.len())?.copy_from_slice(text);
        Some(short)
    }

    /// The beginning of a text, as much as there is room for.
    pub fn cut(text: &[u8]) -> Self {
        let len = text.len().min(N).min(TEXT_MAX);
        let mut short = Self { bytes: [0; N], len: len as u8 };
        for (to, from) in short.bytes.iter_mut().zip(text).take(len) {
            *to = *from;
        }
        short
    }

    /// The bytes; a controller may send any, UTF-8 or not.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }
}

impl<const N: usize> fmt::Display for ShortText<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for chunk in self.as_bytes().utf8_chunks() {
            f.write_str(chunk.valid())?;
            if !chunk.invalid().is_empty() {
                f.write_str("\u{fffd}")?;
            }
        }
        Ok(())
    }
}

impl<const N: usize> fmt::Debug for ShortText<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{self}\"")
    }
}

/// How serious a text message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextLevel {
    /// An exception in the controller.
    Exception,
    /// An error.
    Error,
    /// A warning.
    Warning,
    /// For information.
    Info,
}

impl TextLevel {
    /// The level with this number.
    pub const fn from_code(code: u8) -> Option<Self> {
        Some(match code {
            0 => Self::Exception,
            1 => Self::Error,
            2 => Self::Warning,
            3 => Self::Info,
            _ => return None,
        })
    }

    /// The number on the wire.
    pub const fn code(self) -> u8 {
        match self {
            Self::Exception => 0,
            Self::Error => 1,
            Self::Warning => 2,
            Self::Info => 3,
        }
    }
}

/// A line of text from the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextMessage {
    /// How serious it is.
    pub level: TextLevel,
    /// Which part of the controller speaks.
    pub source: ShortText,
    /// What it says.
    pub message: ShortText,
}

impl TextMessage {
    /// Decodes a payload. Protocol 2 has length, message, length, source, level, and nothing behind; protocol 1 has level and
    /// message, of which what is longer than 255 bytes is cut.
    pub fn decode(protocol: Protocol, payload: &[u8]) -> Option<Self> {
        if protocol == Protocol::One {
            let (level, message) = payload.split_first()?;
            let (message, source) = (ShortText::cut(message), ShortText::cut(b""));
            return Some(Self { level: TextLevel::from_code(*level)?, source, message });
        }
        let mut reader = PayloadReader::new(payload);
        let mut text = || {
            let len = reader.u8()?;
            ShortText::new(reader.bytes(usize::from(len))?)
        };
        let (message, source) = (text()?, text()?);
        let level = TextLevel::from_code(reader.u8()?)?;
        reader.rest().is_empty().then_some(Self { level, source, message })
    }
}
