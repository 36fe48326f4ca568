//! What the host speaks with a kernel over: the socket of `screed-rt`, or the serial line of a board.

use crate::run::serial::{SerialError, SerialPortNow, read_now, set_non_blocking, write_now};
use std::io;
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::net::UnixStream;
use std::path::Path;

/// The host's end; never waits.
#[derive(Debug)]
pub enum Wire {
    /// Of `screed-rt`: loses nothing, and is closed when the other side has ended.
    Socket(UnixStream),
    /// Of a board, at so many bits a second: may spoil bytes, and is silent when nobody is there.
    Line(SerialPortNow, u32),
}

impl Wire {
    /// The socket.
    ///
    /// # Errors
    /// The system's.
    pub fn socket(stream: UnixStream) -> io::Result<Self> {
        set_non_blocking(stream.as_raw_fd())?;
        Ok(Self::Socket(stream))
    }

    /// The serial line at `device`; `baud` bits a second.
    ///
    /// # Errors
    /// [`SerialError`].
    pub fn line(device: &Path, baud: u32) -> Result<Self, SerialError> {
        Ok(Self::Line(SerialPortNow::open(device, baud)?, baud))
    }

    /// Bits a second, where it is a line: on it bytes may be lost.
    pub const fn baud(&self) -> Option<u32> {
        match self {
            Self::Line(_, baud) => Some(*baud),
            Self::Socket(_) => None,
        }
    }

    /// The descriptor, to wait on.
    pub fn descriptor(&self) -> RawFd {
        match self {
            Self::Socket(stream) => stream.as_raw_fd(),
            Self::Line(port, _) => port.descriptor(),
        }
    }

    /// Reads what is there; 0 bytes when nothing is.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::UnexpectedEof`] when the other side is gone.
    pub fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        read_now(self.descriptor(), buffer)
    }

    /// Writes what is taken at once, which can be less than all.
    ///
    /// # Errors
    /// The system's.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write_now(self.descriptor(), bytes)
    }
}
