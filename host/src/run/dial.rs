//! Connections to the robot. The first one is waited for, and the name looked up for it; those after a failure are made beside the
//! loop, which never waits for them and takes nothing from memory for them.

use crate::run::line::RobotLine;
use screed_kernel::units::Nanos;
use std::fmt;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::os::fd::{AsRawFd, FromRawFd, RawFd};
use std::time::Duration;

/// How long the first connection may take.
const FIRST: Duration = Duration::from_secs(3);
/// From the beginning of one try to the next (ns): so long a connection may take as well.
const INTERVAL_NS: u64 = 1_000_000_000;

/// Makes connections to the robot.
#[derive(Debug)]
pub struct Dial {
    /// What the robot's name stood for at the start; tried in turn.
    addresses: Vec<SocketAddr>,
    next: usize,
    /// A connection that is being made.
    attempt: Option<TcpStream>,
    /// When the next try begins.
    due: Nanos,
}

/// What became of a try.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "moved once a connection, and the real-time process must not allocate")]
pub enum Dialled {
    /// Nothing yet.
    Waiting,
    /// It stands.
    Connected(RobotLine),
    /// It does not.
    Failed(DialError),
}

/// Why a try failed; in words that take nothing from memory.
#[derive(Debug)]
pub struct DialError(io::Error);

impl fmt::Display for DialError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0.kind())?;
        self.0.raw_os_error().map_or(Ok(()), |code| write!(f, " (error {code} of the system)"))
    }
}

impl Dial {
    /// Looks the address up, `host:port`, and makes the first connection.
    ///
    /// # Errors
    /// The system's, of the last address tried.
    pub fn first(address: &str) -> io::Result<(RobotLine, Self)> {
        let addresses: Vec<SocketAddr> = address.to_socket_addrs()?.collect();
        let mut last = io::Error::new(ErrorKind::NotFound, "the name has no address");
        for (index, candidate) in addresses.iter().enumerate() {
            match TcpStream::connect_timeout(candidate, FIRST) {
                Ok(stream) => {
                    let dial = Self { next: index, addresses, attempt: None, due: Nanos(0) };
                    return Ok((RobotLine::new(stream)?, dial));
                }
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    /// Moves on, without waiting. To be called while there is no connection: a try begins at once, or a second after the one before.
    pub fn poll(&mut self, now: Nanos) -> Dialled {
        let result = match self.attempt.take() {
            Some(stream) if is_decided(&stream) => {
                stream.take_error().and_then(|error| error.map_or(Ok(Some(stream)), Err))
            }
            Some(_) if now >= self.due => Err(ErrorKind::TimedOut.into()),
            Some(stream) => {
                self.attempt = Some(stream);
                Ok(None)
            }
            None if now >= self.due => {
                self.due = now.plus(INTERVAL_NS);
                self.begin()
            }
            None => Ok(None),
        };
        match result.and_then(|stream| stream.map(RobotLine::new).transpose()) {
            Ok(Some(line)) => Dialled::Connected(line),
            Ok(None) => Dialled::Waiting,
            Err(error) => Dialled::Failed(DialError(error)),
        }
    }

    /// What to wait on until it can be written to; negative is nothing.
    pub fn descriptor(&self) -> RawFd {
        self.attempt.as_ref().map_or(-1, AsRawFd::as_raw_fd)
    }

    /// When [`Self::poll`] wants to be called.
    pub const fn deadline(&self) -> Nanos {
        self.due
    }

    /// Begins with the next address; gives a connection that stands at once.
    fn begin(&mut self) -> io::Result<Option<TcpStream>> {
        let index = self.next % self.addresses.len().max(1);
        self.next = index + 1;
        let address = self.addresses.get(index).ok_or(ErrorKind::NotFound)?;
        let (stream, stands) = connect(address)?;
        if stands {
            return Ok(Some(stream));
        }
        self.attempt = Some(stream);
        Ok(None)
    }
}

/// A socket on its way to an address, and whether it has arrived.
fn connect(address: &SocketAddr) -> io::Result<(TcpStream, bool)> {
    let family = if address.is_ipv4() { libc::AF_INET } else { libc::AF_INET6 };
    // SAFETY: no pointer is passed.
    let descriptor = unsafe { libc::socket(family, libc::SOCK_STREAM | libc::SOCK_NONBLOCK | libc::SOCK_CLOEXEC, 0) };
    if descriptor < 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: the descriptor was just made and has no other owner.
    let stream = unsafe { TcpStream::from_raw_fd(descriptor) };
    let result = match address {
        SocketAddr::V4(address) => {
            // SAFETY: an all-zero sockaddr_in is valid.
            let mut name: libc::sockaddr_in = unsafe { std::mem::zeroed() };
            name.sin_family = libc::AF_INET as libc::sa_family_t;
            name.sin_port = address.port().to_be();
            name.sin_addr.s_addr = u32::from_ne_bytes(address.ip().octets());
            // SAFETY: the name outlives the call and its size is given.
            unsafe { libc::connect(descriptor, (&raw const name).cast(), size_of_val(&name) as libc::socklen_t) }
        }
        SocketAddr::V6(address) => {
            // SAFETY: an all-zero sockaddr_in6 is valid.
            let mut name: libc::sockaddr_in6 = unsafe { std::mem::zeroed() };
            name.sin6_family = libc::AF_INET6 as libc::sa_family_t;
            name.sin6_port = address.port().to_be();
            name.sin6_addr.s6_addr = address.ip().octets();
            (name.sin6_flowinfo, name.sin6_scope_id) = (address.flowinfo(), address.scope_id());
            // SAFETY: the name outlives the call and its size is given.
            unsafe { libc::connect(descriptor, (&raw const name).cast(), size_of_val(&name) as libc::socklen_t) }
        }
    };
    if result == 0 {
        return Ok((stream, true));
    }
    let error = io::Error::last_os_error();
    match error.raw_os_error() {
        Some(libc::EINPROGRESS | libc::EINTR) => Ok((stream, false)),
        _ => Err(error),
    }
}

/// Whether a connection stands or has failed: then its socket can be written to.
fn is_decided(stream: &TcpStream) -> bool {
    let mut entry = libc::pollfd { fd: stream.as_raw_fd(), events: libc::POLLOUT, revents: 0 };
    // SAFETY: one entry, which outlives the call; it does not wait.
    unsafe { libc::poll(&raw mut entry, 1, 0) > 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;
    use std::time::Instant;

    const fn at(milliseconds: u64) -> Nanos {
        Nanos(milliseconds * 1_000_000)
    }

    #[test]
    fn a_try_a_second_is_made_and_none_is_waited_for() {
        for host in ["127.0.0.1", "[::1]"] {
            let Ok(listener) = TcpListener::bind(format!("{host}:0")) else { continue };
            let address = listener.local_addr().unwrap();
            let (_, mut dial) = Dial::first(&address.to_string()).unwrap();
            drop(listener);
            // Nobody listens there.
            let mut tries = Vec::new();
            for now in 0..3500 {
                if let Dialled::Failed(why) = dial.poll(at(now)) {
                    assert!(why.to_string().starts_with("connection refused"), "{why}");
                    tries.push(now / 1000);
                }
            }
            assert_eq!(tries, [0, 1, 2, 3]);
            // Somebody does again.
            let _listener = TcpListener::bind(address).unwrap();
            let until = Instant::now() + Duration::from_secs(10);
            while !matches!(dial.poll(at(4000)), Dialled::Connected(_)) {
                assert!(Instant::now() < until);
            }
            assert!(matches!(dial.poll(at(4001)), Dialled::Waiting));
        }
    }

    #[test]
    fn a_connection_that_is_not_answered_is_given_up_after_a_second_and_the_next_address_tried() {
        // A network for documentation (RFC 5737): nobody answers, or the system knows no way there.
        let silent: SocketAddr = "192.0.2.1:30004".parse().unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let addresses = vec![silent, listener.local_addr().unwrap()];
        let mut dial = Dial { addresses, next: 0, attempt: None, due: Nanos(0) };
        let began = Instant::now();
        let first = dial.poll(at(0));
        assert!(matches!(first, Dialled::Waiting | Dialled::Failed(_)), "{first:?}");
        if dial.descriptor() >= 0 {
            assert!(matches!(dial.poll(at(999)), Dialled::Waiting | Dialled::Failed(_)));
        }
        if dial.descriptor() >= 0 {
            assert!(matches!(dial.poll(at(1000)), Dialled::Failed(_)));
        }
        assert!(began.elapsed() < Duration::from_millis(500), "it waits for nothing");
        let until = Instant::now() + Duration::from_secs(10);
        while !matches!(dial.poll(at(1001)), Dialled::Connected(_)) {
            assert!(Instant::now() < until);
        }
    }
}
