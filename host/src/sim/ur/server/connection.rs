//! One client's socket.

use super::super::dashboard;
use super::super::script::upload::Upload;
use super::super::streams::Stream;
use super::super::{ClientId, Controller};
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::os::fd::AsRawFd;

/// Bytes read from a client in one cycle; the rest waits.
const READ_MAX: usize = 64 * 1024;
/// Bytes taken from the controller for a socket at once.
const CHUNK: usize = 16 * 1024;

/// The other end's state, where the controller does not keep it.
pub(super) enum Peer {
    Rtde(ClientId),
    Script(Upload, Stream),
    Dashboard(dashboard::Session),
}

pub(super) struct Connection {
    pub peer: Peer,
    pub stream: TcpStream,
    /// Taken from the peer and not yet by the socket.
    pub pending: Vec<u8>,
}

impl Peer {
    fn handle_bytes(&mut self, bytes: &[u8], controller: &mut Controller) {
        match self {
            Self::Rtde(client) => controller.handle_bytes(*client, bytes),
            Self::Dashboard(session) => session.handle_bytes(bytes, controller),
            Self::Script(upload, _) => {
                upload.handle_bytes(bytes);
                for program in upload.take_programs() {
                    controller.upload(&program);
                }
            }
        }
    }

    fn poll_transmit(&mut self, controller: &mut Controller, out: &mut [u8]) -> usize {
        match self {
            Self::Rtde(client) => controller.poll_transmit(*client, out),
            Self::Dashboard(session) => session.poll_transmit(out),
            Self::Script(_, stream) => stream.poll_transmit(out),
        }
    }
}

impl Connection {
    /// Whether the other end has not been given up.
    pub(super) fn is_wanted(&self, controller: &Controller) -> bool {
        match &self.peer {
            Peer::Rtde(client) => controller.is_connected(*client),
            // Its last words have to leave first.
            Peer::Dashboard(session) => session.is_open() || !self.pending.is_empty(),
            Peer::Script(upload, _) => !upload.is_overflown(),
        }
    }

    /// The state after the cycle, on the ports that send it unasked; nothing while the socket still has the last one.
    pub(super) fn feed(&mut self, controller: &Controller) {
        if let Peer::Script(_, stream) = &mut self.peer
            && self.pending.is_empty()
        {
            controller.feed(stream);
        }
    }

    pub(super) fn end(&self, controller: &mut Controller) {
        if let Peer::Rtde(client) = &self.peer {
            controller.disconnect(*client);
        }
    }

    /// Hands over what has come; false when the client has gone.
    pub(super) fn read(&mut self, controller: &mut Controller) -> bool {
        let mut bytes = [0; 4096];
        let mut total = 0;
        while total < READ_MAX {
            match self.stream.read(&mut bytes) {
                Ok(0) => return false,
                Ok(count) => {
                    self.peer.handle_bytes(bytes.get(..count).unwrap_or(&[]), controller);
                    total += count;
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return true,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        true
    }

    /// Sends as much as the socket takes; what it does not take piles up in the controller, which cuts the client off.
    pub(super) fn write(&mut self, controller: &mut Controller) -> io::Result<()> {
        loop {
            if self.pending.is_empty() {
                self.pending.resize(CHUNK, 0);
                let count = self.peer.poll_transmit(controller, &mut self.pending);
                self.pending.truncate(count);
            }
            if self.pending.is_empty() {
                return Ok(());
            }
            match self.stream.write(&self.pending) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(count) => _ = self.pending.drain(..count),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Closes it at once, from either side's view; what was not sent is lost.
    pub(super) fn close(self, controller: &mut Controller) {
        self.end(controller);
        // Closing follows anyway when the stream is dropped.
        let _ = self.stream.shutdown(Shutdown::Both);
    }

    /// Ends it by a reset (RST), as when the other end's machine has lost its memory of it.
    pub(super) fn reset(self, controller: &mut Controller) {
        self.end(controller);
        let linger = libc::linger { l_onoff: 1, l_linger: 0 };
        set(&self.stream, libc::SO_LINGER, &linger);
    }
}

/// What the system keeps for a client that does not read (bytes): little, so that the controller notices.
const SEND_BUFFER: libc::c_int = 64 * 1024;

/// Bounds what the system keeps for a client that does not read.
pub(super) fn shrink(stream: &TcpStream) {
    set(stream, libc::SO_SNDBUF, &SEND_BUFFER);
}

/// Sets an option of a socket. A system that refuses it leaves it as it is.
fn set<T>(stream: &TcpStream, option: libc::c_int, value: &T) {
    let size = size_of::<T>() as libc::socklen_t;
    // SAFETY: the descriptor is open as long as the stream lives, and the value's type is the option's, of this size.
    unsafe { libc::setsockopt(stream.as_raw_fd(), libc::SOL_SOCKET, option, (&raw const *value).cast(), size) };
}
