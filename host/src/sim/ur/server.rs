//! The simulated controller as a process: TCP servers, and a clock that steps it in real time.
//!
//! Ports lie as on a real robot: RTDE on 30004, scripts on 30001 to 30003, the dashboard on 29999; with another port for RTDE
//! the others move along.
//!
//! One thread. Sockets are read right before each cycle and written right after it. Cycles lie on an absolute grid of the
//! controller's period, and never closer than three quarters of it. When the machine stalls, the grid is shifted and nothing
//! is made up for: simulated time stands still meanwhile, so that packages never come in bursts, and the stall is counted.

mod connection;
mod orders;
#[cfg(test)]
mod tests;

use super::act::{Act, Fault};
use super::dashboard;
use super::inputs::Fieldbus;
use super::record::Record;
use super::script::upload::Upload;
use super::streams::{Port, Stream};
use super::{Controller, ControllerError, Options};
use crate::failure::{Exit, Failure};
use crate::link::rtde::wire::Protocol;
use connection::{Connection, Peer};
use orders::{Orders, say};
use screed_kernel::arm::Arm;
use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Connections at once; more are closed at once.
const CLIENTS_MAX: usize = 128;

/// How the server is started.
#[derive(Clone, Debug)]
pub struct ServeOptions {
    /// The arm.
    pub arm: Arm<6>,
    /// The controller.
    pub controller: Options,
    /// Where to listen.
    pub host: IpAddr,
    /// The port, 30004 on a real robot; 0 takes a free one.
    pub port: u16,
    /// Whether other machines may connect; RTDE knows no password.
    pub allow_remote: bool,
    /// A CSV file with a row for each cycle.
    pub record: Option<PathBuf>,
    /// The newest protocol of RTDE that it accepts.
    pub rtde_protocol: Protocol,
    /// Ends when nobody is connected for so long.
    pub exit_when_idle: Option<Duration>,
    /// Prints JSON instead of sentences.
    pub json: bool,
    /// What a fieldbus writes.
    pub fieldbus: Fieldbus,
    /// What goes wrong, and when.
    pub faults: Vec<Fault>,
    /// Takes acts from the standard input, a line each.
    pub control: bool,
    /// Ends when this says so; looked at in every cycle.
    pub stop: fn() -> bool,
}

/// Why the server ends other than asked.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// There is no such controller.
    #[error(transparent)]
    Controller(#[from] ControllerError),
    /// The robot program cannot be run.
    #[error("{fault}; correct the program, or leave it out for Screed's own")]
    Program {
        /// What is wrong with it.
        fault: String,
    },
    /// Listening for other machines was not asked for.
    #[error(
        "{host} can be reached from other machines and RTDE has no password; use 127.0.0.1, or allow remote clients"
    )]
    NotLoopback {
        /// As asked for.
        host: IpAddr,
    },
    /// Another process listens there.
    #[error("{address} is in use; stop the process that listens there, or choose another port (0 takes a free one)")]
    AddressInUse {
        /// As asked for.
        address: SocketAddr,
    },
    /// The other ports lie below that of RTDE.
    #[error("port {port} leaves no room for the five ports below it; choose a port above 5, or 0 for free ones")]
    NoRoom {
        /// As asked for.
        port: u16,
    },
    /// Listening failed.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// As asked for.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The record cannot be written.
    #[error("cannot write {}: {source}; choose a writable place with room", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// What it has to say cannot be said.
    #[error("cannot write to the standard output: {source}")]
    Output {
        /// Why.
        source: io::Error,
    },
}

impl From<SimError> for Failure {
    fn from(error: SimError) -> Self {
        let exit = match &error {
            SimError::Controller(_) | SimError::Program { .. } => Exit::Input,
            SimError::NotLoopback { .. } | SimError::NoRoom { .. } => Exit::Usage,
            SimError::AddressInUse { .. } | SimError::Listen { .. } => Exit::Link,
            SimError::Record { .. } | SimError::Output { .. } => Exit::Failed,
        };
        Self::told(exit, error.to_string())
    }
}

/// What a server did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Control cycles.
    pub cycles: u64,
    /// Times that the machine came more than half a period late.
    pub stalls: u64,
    /// By which simulated time fell behind in all.
    pub stalled: Duration,
}

/// What a port is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Service {
    Rtde,
    Script(Port),
    Dashboard,
}

/// By how much ports lie below that of RTDE.
const SERVICES: [(Service, u16); 5] = [
    (Service::Rtde, 0),
    (Service::Script(Port::Primary), 3),
    (Service::Script(Port::Secondary), 2),
    (Service::Script(Port::Realtime), 1),
    (Service::Dashboard, 5),
];

/// A listening controller.
pub struct Server {
    controller: Controller,
    listeners: Vec<Listener>,
    period: Duration,
    connections: Vec<Connection>,
    record: Option<Record>,
    exit_when_idle: Option<Duration>,
    summary: Summary,
    orders: Orders,
    /// Periods since the start; those of a restart count too.
    ticks: u64,
    /// The period in which the controller is back from a restart, and where it listened.
    restart: Option<(u64, Vec<(Service, SocketAddr)>)>,
}

/// Listens, says where in one line, and steps the controller until it is told to stop; says then what it did.
///
/// # Errors
/// [`SimError`].
pub fn serve(options: &ServeOptions) -> Result<(), SimError> {
    let mut server = Server::bind(options)?;
    let address = server.address();
    let [rtde, primary, secondary, realtime, dashboard] = server.addresses().map(|address| address.to_string());
    say(&if options.json {
        format!(
            "{{\"listening\":\"{rtde}\",\"primary\":\"{primary}\",\"secondary\":\"{secondary}\",\
             \"realtime\":\"{realtime}\",\"dashboard\":\"{dashboard}\"}}"
        )
    } else {
        format!("listening on {address} (scripts: {primary}, {secondary}, {realtime}; dashboard: {dashboard})")
    })?;
    let Summary { cycles, stalls, stalled } = server.run(options.stop)?;
    let seconds = stalled.as_secs_f64();
    say(&if options.json {
        format!("{{\"cycles\":{cycles},\"stalls\":{stalls},\"stalled_s\":{seconds}}}")
    } else {
        format!("{cycles} cycles; the machine stalled {stalls} times, {seconds:.3} s in all")
    })
}

impl Server {
    /// Switches the controller on and listens.
    ///
    /// # Errors
    /// [`SimError`].
    pub fn bind(options: &ServeOptions) -> Result<Self, SimError> {
        if !options.host.is_loopback() && !options.allow_remote {
            return Err(SimError::NotLoopback { host: options.host });
        }
        let mut controller = Controller::new(&options.arm, options.controller.clone())?;
        controller.install(options.fieldbus);
        controller.limit_protocol(options.rtde_protocol);
        if let Some(fault) = controller.program_fault() {
            return Err(SimError::Program { fault: fault.to_owned() });
        }
        let listeners = listen_on_all(options.host, options.port)?;
        let record = options.record.as_deref().map(Record::create).transpose()?;
        let rate = options.controller.generation.cycle_rate();
        Ok(Self {
            controller,
            listeners,
            period: Duration::from_secs(1) / rate,
            connections: Vec::new(),
            record,
            exit_when_idle: options.exit_when_idle,
            summary: Summary::default(),
            orders: Orders::new(&options.faults, rate, options.control, options.json),
            ticks: 0,
            restart: None,
        })
    }

    /// Where it listens for RTDE.
    pub fn address(&self) -> SocketAddr {
        let [rtde, ..] = self.addresses();
        rtde
    }

    /// Where it listens: RTDE, the three ports for scripts from 30001 on, dashboard.
    pub fn addresses(&self) -> [SocketAddr; SERVICES.len()] {
        let mut found = [SocketAddr::from(([0, 0, 0, 0], 0)); SERVICES.len()];
        for (found, (_, _, address)) in found.iter_mut().zip(&self.listeners) {
            *found = *address;
        }
        found
    }

    /// Steps the controller in real time until `stop`, or until nobody is connected for long enough.
    ///
    /// # Errors
    /// [`SimError::Record`].
    pub fn run(&mut self, stop: impl Fn() -> bool) -> Result<Summary, SimError> {
        let mut due = Instant::now() + self.period;
        let mut last = Instant::now();
        let mut last_connected = Instant::now();
        while !stop() {
            let stalled = self.wait_until(&mut due, &mut last);
            if !stalled.is_zero() {
                self.summary.stalls += 1;
                self.summary.stalled += stalled;
            }
            due += self.period;
            self.ticks += 1;
            self.obey()?;
            if self.is_down()? {
                // Nobody can be.
                last_connected = Instant::now();
                continue;
            }
            self.controller.stand_still(stalled.as_secs_f64());
            self.accept();
            self.read();
            self.controller.step();
            self.write();
            for told in self.controller.take_announced() {
                self.orders.announce(self.ticks, &told);
            }
            self.summary.cycles += 1;
            if let Some(record) = &mut self.record {
                record.row(self.controller.last_cycle(), stalled)?;
            }
            if !self.connections.is_empty() {
                last_connected = Instant::now();
            }
            if self.exit_when_idle.is_some_and(|idle| last_connected.elapsed() >= idle) {
                break;
            }
        }
        if let Some(record) = &mut self.record {
            record.finish()?;
        }
        Ok(self.summary)
    }

    /// Sleeps until the cycle is due. Much too late: shifts the grid and gives by how much. A little too late: the grid stays,
    /// and the next cycle keeps its distance from this one.
    fn wait_until(&self, due: &mut Instant, last: &mut Instant) -> Duration {
        let earliest = (*due).max(*last + self.period * 3 / 4);
        if let Some(rest) = earliest.checked_duration_since(Instant::now()) {
            std::thread::sleep(rest);
        }
        let now = Instant::now();
        *last = now;
        let late = now.saturating_duration_since(earliest);
        if late < self.period / 2 {
            return Duration::ZERO;
        }
        *due = now;
        late
    }

    /// Does what is due.
    fn obey(&mut self) -> Result<(), SimError> {
        while let Some((act, text)) = self.orders.next(self.ticks)? {
            let done = self.controller.act(&act).is_ok();
            match act {
                Act::Reset => {
                    for connection in self.connections.drain(..) {
                        connection.reset(&mut self.controller);
                    }
                }
                Act::Restart(seconds) => {
                    // First nobody listens, so that nobody whose connection ends is let in again.
                    let places = self.listeners.drain(..).map(|(service, _, address)| (service, address)).collect();
                    for connection in self.connections.drain(..) {
                        connection.close(&mut self.controller);
                    }
                    let periods = (seconds / self.period.as_secs_f64()).round() as u64;
                    self.restart = Some((self.ticks + periods, places));
                }
                _ => {}
            }
            self.orders.report(self.ticks, &text, done)?;
        }
        Ok(())
    }

    /// Whether the controller is not there at the moment; it listens again where it did once it is.
    fn is_down(&mut self) -> Result<bool, SimError> {
        let Some((_, places)) = self.restart.take_if(|(back, _)| *back <= self.ticks) else {
            return Ok(self.restart.is_some());
        };
        for (service, address) in places {
            self.listeners.push(listen(service, address)?);
        }
        Ok(false)
    }

    fn accept(&mut self) {
        for (service, listener, _) in &self.listeners {
            // An error here concerns a client that has gone again, or no client at all.
            while let Ok((stream, _)) = listener.accept() {
                let ready = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true));
                connection::shrink(&stream);
                if ready.is_ok() && self.connections.len() < CLIENTS_MAX {
                    let peer = match service {
                        Service::Rtde => Peer::Rtde(self.controller.connect()),
                        Service::Script(port) => Peer::Script(Upload::default(), Stream::new(*port)),
                        Service::Dashboard => Peer::Dashboard(dashboard::Session::default()),
                    };
                    self.connections.push(Connection { peer, stream, pending: Vec::new() });
                }
            }
        }
    }

    fn read(&mut self) {
        let controller = &mut self.controller;
        self.connections.retain_mut(|connection| {
            let alive = connection.read(controller);
            if !alive {
                // Who has said its last word may still listen: it gets its answers.
                let _ = connection.write(controller);
                connection.end(controller);
            }
            alive
        });
    }

    fn write(&mut self) {
        let controller = &mut self.controller;
        let gone = self.connections.extract_if(.., |connection| {
            connection.feed(controller);
            connection.write(controller).is_err() || !connection.is_wanted(controller)
        });
        for connection in gone.collect::<Vec<_>>() {
            connection.close(controller);
        }
    }
}

type Listener = (Service, TcpListener, SocketAddr);

/// Sets of free ports that are tried: the system chooses RTDE's, and one of those below it may be taken.
const TRIES: u32 = 200;

/// All ports, with RTDE's as told; 0 takes free ones that lie as far apart as a real robot's.
fn listen_on_all(host: IpAddr, port: u16) -> Result<Vec<Listener>, SimError> {
    let mut tries = if port == 0 { TRIES } else { 1 };
    loop {
        tries -= 1;
        match listen_below(host, port) {
            Err(SimError::AddressInUse { .. } | SimError::NoRoom { .. }) if tries > 0 => {}
            result => return result,
        }
    }
}

fn listen_below(host: IpAddr, mut rtde: u16) -> Result<Vec<Listener>, SimError> {
    let mut listeners = Vec::new();
    for (service, below) in SERVICES {
        let port = match rtde {
            0 => 0,
            _ => rtde.checked_sub(below).filter(|port| *port > 0).ok_or(SimError::NoRoom { port: rtde })?,
        };
        let listener = listen(service, SocketAddr::new(host, port))?;
        if service == Service::Rtde {
            rtde = listener.2.port();
        }
        listeners.push(listener);
    }
    Ok(listeners)
}

fn listen(service: Service, address: SocketAddr) -> Result<Listener, SimError> {
    let failed = |source: io::Error| match source.kind() {
        io::ErrorKind::AddrInUse => SimError::AddressInUse { address },
        _ => SimError::Listen { address, source },
    };
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    Ok((service, listener, address))
}
