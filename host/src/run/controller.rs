//! The host's way to a robot's controller beside `screed-rt`: dashboard, uploads, kinematics, and a look at its state, over
//! sockets with time-outs. Nothing here moves or powers a robot but [`acts::act`] and [`program::upload`], which are called after a
//! person's own command.

pub mod acts;
pub mod check;
pub mod inputs;
pub mod program;
#[cfg(test)]
mod tests;
pub mod view;

use crate::config::Cell;
use crate::failure::{Exit, Failure};
use crate::link::dashboard::{Dashboard, DashboardError, Request};
use crate::link::primary::PrimaryError;
use crate::link::rtde::LinkError;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// How long a connection may take.
const CONNECT: Duration = Duration::from_secs(3);
/// How long an answer may take: a controller loads and starts programs before it answers.
const PATIENCE: Duration = Duration::from_secs(10);

/// Where a controller is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Name or IP address.
    pub host: String,
    /// Port of the dashboard.
    pub dashboard: u16,
    /// Port of the primary interface.
    pub primary: u16,
    /// Port of RTDE.
    pub rtde: u16,
}

impl Place {
    /// With RTDE on `rtde` the others are as far away as on a robot, where it is 30004: the primary interface three below, the
    /// dashboard five.
    ///
    /// # Errors
    /// A usage [`Failure`] when there is no room below.
    pub fn new(host: &str, rtde: u16) -> Result<Self, Failure> {
        Self::with(host, rtde, None, None)
    }

    /// The cell's.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of(cell: &Cell) -> Result<Self, Failure> {
        let link = &cell.link;
        Self::with(&link.address, link.port, link.dashboard_port, link.primary_port)
    }

    fn with(host: &str, rtde: u16, dashboard: Option<u16>, primary: Option<u16>) -> Result<Self, Failure> {
        let below = |distance| rtde.checked_sub(distance).filter(|port| *port > 0);
        match (dashboard.or(below(5)), primary.or(below(3))) {
            (Some(dashboard), Some(primary)) => Ok(Self { host: host.to_owned(), dashboard, primary, rtde }),
            _ => Err(Failure::new(
                Exit::Usage,
                format!("port {rtde} of RTDE leaves no room for the controller's other ports below it"),
                "give the port of RTDE, 30004 on a robot, or dashboard_port and primary_port in [link] of a cell file",
            )),
        }
    }
}

/// Why a controller cannot be asked.
#[derive(Debug, thiserror::Error)]
pub enum ControllerError {
    /// Nobody listens.
    #[error(
        "{service} at {address} does not answer: {source}; check power, cable and address, and that the controller lets it be used"
    )]
    Unreachable {
        /// Which of its services.
        service: &'static str,
        /// Where.
        address: String,
        /// Why.
        source: io::Error,
    },
    /// Somebody listens and says nothing.
    #[error("{service} at {address} says nothing for {} s; see whether the controller has started", patience.as_secs())]
    Silent {
        /// Which of its services.
        service: &'static str,
        /// Where.
        address: String,
        /// For how long.
        patience: Duration,
    },
    /// The dashboard.
    #[error(transparent)]
    Dashboard(#[from] DashboardError),
    /// The primary interface.
    #[error(transparent)]
    Primary(#[from] PrimaryError),
    /// RTDE.
    #[error(transparent)]
    Rtde(#[from] LinkError),
}

impl From<ControllerError> for Failure {
    fn from(error: ControllerError) -> Self {
        Self::told(Exit::Link, error.to_string())
    }
}

/// A socket to one of a controller's services, read with a deadline.
pub(crate) struct Line {
    service: &'static str,
    address: String,
    stream: TcpStream,
}

impl Line {
    pub(crate) fn connect(service: &'static str, host: &str, port: u16) -> Result<Self, ControllerError> {
        let address = if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") };
        let fail = |source| ControllerError::Unreachable { service, address: address.clone(), source };
        let mut last = io::Error::new(ErrorKind::NotFound, "the name has no address");
        for candidate in (host, port).to_socket_addrs().map_err(fail)? {
            match TcpStream::connect_timeout(&candidate, CONNECT) {
                Ok(stream) => {
                    let ready = stream.set_nodelay(true).and_then(|()| stream.set_write_timeout(Some(CONNECT)));
                    ready.map_err(fail)?;
                    return Ok(Self { service, address, stream });
                }
                Err(error) => last = error,
            }
        }
        Err(fail(last))
    }

    pub(crate) fn send(&mut self, bytes: &[u8]) -> Result<(), ControllerError> {
        self.stream.write_all(bytes).map_err(|error| self.failed(error))
    }

    /// Reads what is there, waiting until `until` at most; `None` when nothing came by then, `Some(0)` at the end of the stream.
    pub(crate) fn receive(&mut self, bytes: &mut [u8], until: Instant) -> Result<Option<usize>, ControllerError> {
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            self.stream.set_read_timeout(Some(left)).map_err(|error| self.failed(error))?;
            match self.stream.read(bytes) {
                Ok(count) => return Ok(Some(count)),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                // Cut by the other end.
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return Ok(Some(0)),
                Err(error) => return Err(self.failed(error)),
            }
        }
    }

    pub(crate) fn silent(&self, patience: Duration) -> ControllerError {
        ControllerError::Silent { service: self.service, address: self.address.clone(), patience }
    }

    pub(crate) fn closed(&self) -> ControllerError {
        self.failed(io::Error::other("it closed the connection"))
    }

    fn failed(&self, source: io::Error) -> ControllerError {
        ControllerError::Unreachable { service: self.service, address: self.address.clone(), source }
    }
}

/// A connection to the dashboard.
pub struct DashboardLine {
    line: Line,
    client: Dashboard,
    patience: Duration,
}

impl DashboardLine {
    /// Connects.
    ///
    /// # Errors
    /// [`ControllerError::Unreachable`].
    pub fn connect(place: &Place) -> Result<Self, ControllerError> {
        let line = Line::connect("the dashboard", &place.host, place.dashboard)?;
        Ok(Self { line, client: Dashboard::default(), patience: PATIENCE })
    }

    /// Waits no longer than this for an answer.
    pub const fn set_patience(&mut self, patience: Duration) {
        self.patience = patience;
    }

    /// Asks, and waits for the answer.
    ///
    /// # Errors
    /// [`ControllerError`]; after [`DashboardError::Refused`] and [`DashboardError::NotKnown`] it can be asked on.
    pub fn ask<T>(&mut self, request: &Request<T>) -> Result<T, ControllerError> {
        self.client.ask(request)?;
        let until = Instant::now() + self.patience;
        let mut bytes = [0; 1024];
        loop {
            let count = self.client.poll_transmit(&mut bytes);
            if count > 0 {
                self.line.send(bytes.get(..count).unwrap_or(&[]))?;
            }
            match self.line.receive(&mut bytes, until)? {
                None => return Err(self.line.silent(self.patience)),
                Some(0) => self.client.handle_closed(),
                Some(count) => self.client.handle_bytes(bytes.get(..count).unwrap_or(&[])),
            }
            if let Some(answer) = self.client.take_answer(request)? {
                return Ok(answer);
            }
        }
    }

    /// Asks what old software does not know: nothing then.
    ///
    /// # Errors
    /// As [`Self::ask`] otherwise.
    pub fn ask_if_known<T>(&mut self, request: &Request<T>) -> Result<Option<T>, ControllerError> {
        match self.ask(request) {
            Ok(answer) => Ok(Some(answer)),
            Err(ControllerError::Dashboard(DashboardError::NotKnown { .. })) => Ok(None),
            Err(error) => Err(error),
        }
    }
}
