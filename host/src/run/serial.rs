//! A serial port that never waits: for the real-time loop, which must not.

use serialport::{ClearBuffer, SerialPort, TTYPort};
use std::io;
use std::os::fd::{AsRawFd, RawFd};
use std::path::{Path, PathBuf};

/// A port opened for reading and writing without waiting: raw, 8 data bits, no parity, 1 stop bit, no flow control, and
/// closed to other processes.
#[derive(Debug)]
pub struct SerialPortNow {
    port: TTYPort,
}

/// Why a serial device cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SerialError {
    /// It cannot be opened.
    #[error("cannot open the serial device {} at {baud} baud: {reason}", device.display())]
    Open {
        /// The device.
        device: PathBuf,
        /// Bits a second.
        baud: u32,
        /// What the system said.
        reason: String,
    },
}

impl SerialPortNow {
    /// Opens the device and drops what it had received before. This allocates; nothing after it does.
    ///
    /// # Errors
    /// [`SerialError::Open`].
    pub fn open(device: &Path, baud: u32) -> Result<Self, SerialError> {
        let failed = |reason: String| SerialError::Open { device: device.to_owned(), baud, reason };
        let path = device.to_str().ok_or_else(|| failed("its path is not UTF-8".to_owned()))?;
        let port = TTYPort::open(&serialport::new(path, baud)).map_err(|error| failed(error.to_string()))?;
        port.clear(ClearBuffer::Input).map_err(|error| failed(error.to_string()))?;
        set_non_blocking(port.as_raw_fd()).map_err(|error| failed(error.to_string()))?;
        Ok(Self { port })
    }

    /// The descriptor, to wait on.
    pub fn descriptor(&self) -> RawFd {
        self.port.as_raw_fd()
    }

    /// Reads what is there; 0 bytes when nothing is.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::UnexpectedEof`] when the device was unplugged.
    pub fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        read_now(self.port.as_raw_fd(), buffer)
    }

    /// Writes what the port takes at once, which can be less than all.
    ///
    /// # Errors
    /// The system's, for example when the device was unplugged.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write_now(self.port.as_raw_fd(), bytes)
    }
}

/// Makes reads and writes on the descriptor return at once.
///
/// # Errors
/// The system's.
pub(crate) fn set_non_blocking(descriptor: RawFd) -> io::Result<()> {
    // SAFETY: fcntl with these commands reads and writes no memory of ours.
    let flags = unsafe { libc::fcntl(descriptor, libc::F_GETFL) };
    // SAFETY: as above.
    if flags < 0 || unsafe { libc::fcntl(descriptor, libc::F_SETFL, flags | libc::O_NONBLOCK) } < 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}

/// Reads from a non-blocking descriptor; 0 bytes when nothing is there. (The serialport crate's own `read` builds an
/// allocated error for every read that finds nothing.)
///
/// # Errors
/// The system's.
pub(crate) fn read_now(descriptor: RawFd, buffer: &mut [u8]) -> io::Result<usize> {
    // SAFETY: the pointer and length are those of a live, exclusively borrowed slice.
    let result = unsafe { libc::read(descriptor, buffer.as_mut_ptr().cast(), buffer.len()) };
    // A raw terminal without bytes says "would block"; it says 0 only once it has hung up.
    if result == 0 && !buffer.is_empty() {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    count_or_nothing(result)
}

/// Writes to a non-blocking descriptor; 0 bytes when it takes nothing.
///
/// # Errors
/// The system's.
pub(crate) fn write_now(descriptor: RawFd, bytes: &[u8]) -> io::Result<usize> {
    // SAFETY: the pointer and length are those of a live slice.
    count_or_nothing(unsafe { libc::write(descriptor, bytes.as_ptr().cast(), bytes.len()) })
}

fn count_or_nothing(result: libc::ssize_t) -> io::Result<usize> {
    usize::try_from(result).or_else(|_| {
        let error = io::Error::last_os_error();
        match error.kind() {
            io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted => Ok(0),
            _ => Err(error),
        }
    })
}
