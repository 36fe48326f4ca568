//! The TCP line to the robot: never waits, sends each byte once, and tells when what it reads lay ready.

use screed_kernel::units::Nanos;
use std::io::{self, ErrorKind, Write};
use std::net::TcpStream;
use std::os::fd::{AsRawFd, RawFd};

/// Room for what the line has not taken: a request or some setpoints, each whole before the next is asked for.
const WAITING: usize = 512;
/// A stamp further from now than this tells of a clock that was set (ns).
const AGE_MAX: u64 = 10_000_000_000;

/// What a read gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// So many bytes, the last of which lay ready since so many nanoseconds; not known where the system does not stamp.
    Bytes {
        /// How many.
        count: usize,
        /// Since when.
        age: Option<u64>,
    },
    /// Nothing has come.
    Nothing,
    /// The robot has closed the connection, or it broke.
    Closed,
}

/// The line.
#[derive(Debug)]
pub struct RobotLine {
    stream: TcpStream,
    /// What was to be sent and is not: the rest of a package, whose beginning is on the wire, and whole ones behind it.
    waiting: [u8; WAITING],
    from: usize,
    until: usize,
    blocked: u64,
}

impl RobotLine {
    /// Takes a connection: small packages leave at once (no Nagle), nothing waits, what arrives is stamped by the kernel.
    ///
    /// # Errors
    /// The system's.
    pub fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_nonblocking(true)?;
        let on: libc::c_int = 1;
        // SAFETY: the option's value outlives the call and its size is given. A system that does not stamp may refuse it.
        unsafe {
            let size = size_of::<libc::c_int>() as libc::socklen_t;
            libc::setsockopt(stream.as_raw_fd(), libc::SOL_SOCKET, libc::SO_TIMESTAMPNS, (&raw const on).cast(), size);
        }
        Ok(Self { stream, waiting: [0; WAITING], from: 0, until: 0, blocked: 0 })
    }

    /// The descriptor, to wait on.
    pub fn descriptor(&self) -> RawFd {
        self.stream.as_raw_fd()
    }

    /// Reads what is there, as much as there is room for.
    pub fn read(&mut self, out: &mut [u8]) -> Heard {
        /// Room for one stamp, aligned as the system wants it.
        #[repr(C, align(8))]
        struct Control([u8; 64]);
        let mut control = Control([0; 64]);
        let mut part = libc::iovec { iov_base: out.as_mut_ptr().cast(), iov_len: out.len() };
        // SAFETY: an all-zero msghdr is valid.
        let mut message: libc::msghdr = unsafe { std::mem::zeroed() };
        (message.msg_iov, message.msg_iovlen) = (&raw mut part, 1);
        (message.msg_control, message.msg_controllen) = (control.0.as_mut_ptr().cast(), control.0.len() as _);
        // SAFETY: the message points at `out` and `control`, with their lengths; both outlive the call.
        let result = unsafe { libc::recvmsg(self.stream.as_raw_fd(), &raw mut message, libc::MSG_DONTWAIT) };
        match usize::try_from(result) {
            Ok(0) if !out.is_empty() => Heard::Closed,
            Ok(count) => Heard::Bytes { count, age: stamp(&message).and_then(age) },
            Err(_) => match io::Error::last_os_error().kind() {
                ErrorKind::WouldBlock | ErrorKind::Interrupted => Heard::Nothing,
                _ => Heard::Closed,
            },
        }
    }

    /// Sends what waits and then what `next` gives, until it gives nothing or the line takes no more: then the rest waits here.
    ///
    /// # Errors
    /// The system's, for a connection that broke.
    pub fn send(&mut self, mut next: impl FnMut(&mut [u8]) -> usize) -> io::Result<()> {
        loop {
            if self.is_free() {
                (self.from, self.until) = (0, next(&mut self.waiting).min(WAITING));
            }
            let Some(rest) = self.waiting.get(self.from..self.until).filter(|rest| !rest.is_empty()) else {
                return Ok(());
            };
            match self.stream.write(rest) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => self.from += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    self.blocked += 1;
                    return Ok(());
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Whether the line has taken all that was to be sent.
    pub const fn is_free(&self) -> bool {
        self.from >= self.until
    }

    /// How often the line did not take at once what it was given.
    pub const fn blocked(&self) -> u64 {
        self.blocked
    }

    /// Segments sent again because no answer came in time (TCP_INFO); 0 where the system does not tell.
    pub fn resent(&self) -> u64 {
        // SAFETY: an all-zero tcp_info is valid; it outlives the call, and its size is given.
        unsafe {
            let mut info: libc::tcp_info = std::mem::zeroed();
            let mut size = size_of::<libc::tcp_info>() as libc::socklen_t;
            let (level, name) = (libc::IPPROTO_TCP, libc::TCP_INFO);
            let got = libc::getsockopt(self.stream.as_raw_fd(), level, name, (&raw mut info).cast(), &raw mut size);
            if got == 0 { u64::from(info.tcpi_total_retrans) } else { 0 }
        }
    }
}

/// The kernel's stamp of the last bytes of a message: when they arrived, by the clock of the day (ns).
fn stamp(message: &libc::msghdr) -> Option<u64> {
    // SAFETY: the message was filled by recvmsg; its control data is followed only inside its length.
    unsafe {
        let mut header = libc::CMSG_FIRSTHDR(message);
        while let Some(found) = header.as_ref() {
            if found.cmsg_level == libc::SOL_SOCKET && found.cmsg_type == libc::SCM_TIMESTAMPNS {
                let time: libc::timespec = libc::CMSG_DATA(header).cast::<libc::timespec>().read_unaligned();
                return Some(time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64);
            }
            header = libc::CMSG_NXTHDR(message, header);
        }
    }
    None
}

/// How long ago a time of the day was (ns), unless that clock was set meanwhile.
fn age(stamp: u64) -> Option<u64> {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the structure outlives the call.
    if unsafe { libc::clock_gettime(libc::CLOCK_REALTIME, &raw mut time) } != 0 {
        return None;
    }
    let now = time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64;
    now.checked_sub(stamp).filter(|age| *age < AGE_MAX)
}

impl Heard {
    /// When what was read at `now` lay ready; at `now` where that is not known.
    pub const fn ready_at(&self, now: Nanos) -> Nanos {
        match self {
            Self::Bytes { age: Some(age), .. } => Nanos(now.0.saturating_sub(*age)),
            _ => now,
        }
    }
}
