//! The simulated controller as a process: TCP servers, and a clock that steps it in real time.
//!
//! Ports lie as on a real robot: RTDE on 30004, scripts on 30001 to 30003, the dashboard on 29999; with another port for RTDE
//! the others move along.
//!
//! One thread. Sockets are read right before each cycle and written right after it. Cycles lie on an absolute grid of the
//! controller's period;
//! when the machine stalls, the grid is shifted and nothing is made up for: simulated time stands still meanwhile, so that
//! packages never come in bursts, and the stall is counted.

use super::dashboard;
use super::record::Record;
use super::script::upload::Upload;
use super::streams::{Port, Stream};
use super::{ClientId, Controller, ControllerError, Options};
use crate::failure::{Exit, Failure};
use crate::link::rtde::wire::Protocol;
use screed_kernel::arm::Arm;
use std::io::{self, Read, Write};
use std::net::{IpAddr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Connections at once; more are closed at once.
const CLIENTS_MAX: usize = 128;
/// Bytes read from a client in one cycle; the rest waits.
const READ_MAX: usize = 64 * 1024;
/// Bytes taken from the controller for a socket at once.
const CHUNK: usize = 16 * 1024;

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

/// The other end's state, where the controller does not keep it.
enum Peer {
    Rtde(ClientId),
    Script(Upload, Stream),
    Dashboard(dashboard::Session),
}

struct Connection {
    peer: Peer,
    stream: TcpStream,
    /// Taken from the peer and not yet by the socket.
    pending: Vec<u8>,
}

/// A listening controller.
pub struct Server {
    controller: Controller,
    listeners: Vec<(Service, TcpListener, SocketAddr)>,
    period: Duration,
    connections: Vec<Connection>,
    record: Option<Record>,
    exit_when_idle: Option<Duration>,
    summary: Summary,
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

/// One line, at once; whoever started this process may be waiting for it.
fn say(line: &str) -> Result<(), SimError> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).map_err(|source| SimError::Output { source })
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
        controller.limit_protocol(options.rtde_protocol);
        if let Some(fault) = controller.program_fault() {
            return Err(SimError::Program { fault: fault.to_owned() });
        }
        let mut listeners = Vec::new();
        for (service, below) in SERVICES {
            listeners.push(listen(service, SocketAddr::new(options.host, port_of(options.port, below)?))?);
        }
        let record = options.record.as_deref().map(Record::create).transpose()?;
        let period = Duration::from_secs(1) / options.controller.generation.cycle_rate();
        let (exit_when_idle, connections, summary) = (options.exit_when_idle, Vec::new(), Summary::default());
        Ok(Self { controller, listeners, period, connections, record, exit_when_idle, summary })
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
        let mut last_connected = Instant::now();
        while !stop() {
            let stalled = self.wait_until(&mut due);
            self.controller.stand_still(stalled.as_secs_f64());
            self.accept();
            self.read();
            self.controller.step();
            self.write();
            self.summary.cycles += 1;
            if let Some(record) = &mut self.record {
                record.row(self.controller.last_cycle(), stalled)?;
            }
            due += self.period;
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

    /// Sleeps until the cycle is due. Much too late: shifts the grid and gives by how much.
    fn wait_until(&mut self, due: &mut Instant) -> Duration {
        let now = Instant::now();
        if let Some(rest) = due.checked_duration_since(now) {
            std::thread::sleep(rest);
        }
        let now = Instant::now();
        let late = now.saturating_duration_since(*due);
        // Later than that, two packages would come closer than half a period.
        if late < self.period / 2 {
            return Duration::ZERO;
        }
        *due = now;
        self.summary.stalls += 1;
        self.summary.stalled += late;
        late
    }

    fn accept(&mut self) {
        for (service, listener, _) in &self.listeners {
            // An error here concerns a client that has gone again, or no client at all.
            while let Ok((stream, _)) = listener.accept() {
                let ready = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true));
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
                connection.end(controller);
            }
            alive
        });
    }

    fn write(&mut self) {
        let controller = &mut self.controller;
        self.connections.retain_mut(|connection| {
            connection.feed(controller);
            let alive = connection.write(controller).is_ok() && connection.is_wanted(controller);
            if !alive {
                connection.end(controller);
                // Closing follows anyway when the stream is dropped.
                let _ = connection.stream.shutdown(Shutdown::Both);
            }
            alive
        });
    }
}

/// The port so far below that of RTDE; 0 takes a free one.
fn port_of(rtde: u16, below: u16) -> Result<u16, SimError> {
    match rtde {
        0 => Ok(0),
        _ => rtde.checked_sub(below).filter(|port| *port > 0).ok_or(SimError::NoRoom { port: rtde }),
    }
}

fn listen(service: Service, address: SocketAddr) -> Result<(Service, TcpListener, SocketAddr), SimError> {
    let failed = |source: io::Error| match source.kind() {
        io::ErrorKind::AddrInUse => SimError::AddressInUse { address },
        _ => SimError::Listen { address, source },
    };
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    Ok((service, listener, address))
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
    fn is_wanted(&self, controller: &Controller) -> bool {
        match &self.peer {
            Peer::Rtde(client) => controller.is_connected(*client),
            // Its last words have to leave first.
            Peer::Dashboard(session) => session.is_open() || !self.pending.is_empty(),
            Peer::Script(upload, _) => !upload.is_overflown(),
        }
    }

    /// The state after the cycle, on the ports that send it unasked; nothing while the socket still has the last one.
    fn feed(&mut self, controller: &Controller) {
        if let Peer::Script(_, stream) = &mut self.peer
            && self.pending.is_empty()
        {
            controller.feed(stream);
        }
    }

    fn end(&self, controller: &mut Controller) {
        if let Peer::Rtde(client) = &self.peer {
            controller.disconnect(*client);
        }
    }

    /// Hands over what has come; false when the client has gone.
    fn read(&mut self, controller: &mut Controller) -> bool {
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
    fn write(&mut self, controller: &mut Controller) -> io::Result<()> {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::rtde::program::{Program, WatchdogAction};
    use crate::link::rtde::{Event, RtdeClient};
    use crate::sim::ur::robot::Generation;
    use screed_kernel::arms::ur::UR10E;
    use screed_kernel::pose::Pose;
    use screed_kernel::units::{JointPos, Nanos};

    fn options(record: Option<PathBuf>) -> ServeOptions {
        let watchdog_action = WatchdogAction::Stop;
        let (lookahead, gain, watchdog) = (0.1, 300.0, 0.5);
        let program = Program { rate_hz: 500, register_offset: 24, lookahead, gain, watchdog, watchdog_action };
        ServeOptions {
            arm: UR10E,
            controller: Options {
                start_q: JointPos([0.0, -1.0, 1.0, -1.5, -1.5, 0.0]),
                flange_from_tcp: Pose::identity(),
                register_offset: 24,
                program: program.text().expect("legal"),
                autoplay: true,
                generation: Generation::ESeries,
                powered: true,
            },
            host: [127, 0, 0, 1].into(),
            port: 0,
            allow_remote: false,
            record,
            rtde_protocol: Protocol::Two,
            exit_when_idle: Some(Duration::from_millis(200)),
            json: false,
            stop: || false,
        }
    }

    /// Runs the client over a real socket until it has `wanted` states; their timestamps.
    fn timestamps(address: SocketAddr, wanted: usize) -> Vec<f64> {
        let mut stream = TcpStream::connect(address).expect("a server");
        stream.set_read_timeout(Some(Duration::from_millis(20))).expect("a socket");
        let origin = Instant::now();
        let mut client = RtdeClient::new(&UR10E, 500, 24, 2_000_000_000).expect("legal");
        let (mut stamps, mut bytes) = (Vec::new(), [0; 4096]);
        while stamps.len() < wanted {
            let now = Nanos(origin.elapsed().as_nanos() as u64);
            let count = client.poll_transmit(now, &mut bytes);
            stream.write_all(&bytes[..count]).expect("a connection");
            if let Ok(count) = stream.read(&mut bytes) {
                client.handle_bytes(now, &bytes[..count]).expect("sound bytes");
            }
            client.handle_timeout(now).expect("a robot that talks");
            while let Some(event) = client.poll_event() {
                if let Event::State { state, skipped } = event {
                    stamps.push(state.timestamp);
                    stamps.extend((0..skipped).map(|_| f64::NAN));
                    client.send_setpoint(stamps.len() as u32, &state.actual_q).expect("running");
                }
            }
        }
        stamps
    }

    #[test]
    fn over_a_socket_stamps_are_exact_cycles_and_the_record_has_each() {
        let folder = std::env::temp_dir().join(format!("screed-server-test-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let path = folder.join("record.csv");
        let mut server = Server::bind(&options(Some(path.clone()))).expect("a free port");
        let address = server.address();
        let client = std::thread::spawn(move || timestamps(address, 250));
        let summary = server.run(|| false).expect("a record");
        let stamps = client.join().expect("the client");
        for pair in stamps.windows(2).filter(|pair| pair.iter().all(|stamp| stamp.is_finite())) {
            let cycles = (pair[1] - pair[0]) * 500.0;
            assert!((cycles - cycles.round()).abs() < 1e-9 && cycles > 0.5, "{pair:?}");
        }
        let text = std::fs::read_to_string(&path).expect("the record");
        assert_eq!(text.lines().count() as u64, summary.cycles + 1);
        let packages: u32 = text.lines().skip(1).filter_map(|row| row.split(',').nth(2)?.parse::<u32>().ok()).sum();
        assert!(packages > 200, "{packages} setpoints in the record");
        let columns = text.lines().map(|row| row.split(',').count());
        assert!(columns.into_iter().all(|count| count == 4 + 6 + 6 + 2));
        std::fs::remove_dir_all(folder).expect("cleaning up");
    }

    #[test]
    fn a_port_in_use_and_an_open_address_are_refused() {
        let first = Server::bind(&options(None)).expect("a free port");
        let mut second = options(None);
        second.port = first.address().port();
        assert!(matches!(Server::bind(&second), Err(SimError::AddressInUse { .. })));
        let mut open = options(None);
        open.host = [0, 0, 0, 0].into();
        assert!(matches!(Server::bind(&open), Err(SimError::NotLoopback { .. })));
        let mut broken = options(None);
        broken.controller.program.push_str("hello()\n");
        assert!(matches!(Server::bind(&broken), Err(SimError::Program { .. })));
    }
}
