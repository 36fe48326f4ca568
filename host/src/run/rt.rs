//! The timed process, `screed-rt`: owns the robot's socket, the extruder's line and the host's socket, and drives [`Core`].
//!
//! The robot's telegram is the clock: each one is read, answered and stamped before anything else is looked at. For robots
//! without a clock of their own it is the timer, on a grid.

use crate::config::{self, Cell, ConfigError, Pacing};
use crate::failure::{Exit, Failure};
use crate::link::LinkError;
use crate::run::core::{Core, CoreError, Slot, Usage};
use crate::run::dial::{Dial, Dialled};
use crate::run::grid::Grid;
use crate::run::line::{Heard, RobotLine};
use crate::run::memory::{self, Memory};
use crate::run::serial::{SerialError, SerialPortNow};
use crate::run::{grid, realtime, signal, wake};
use screed_kernel::frame::Pace;
use screed_kernel::tick::RECEIVE_MAX;
use screed_kernel::units::Nanos;
use std::fs;
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Most reads of the robot's line before an answer: some hundred of its telegrams, more than its time-out leaves.
const READS_MAX: usize = 64;

/// How long the end may wait for the extruder and the host.
const LAST_WORDS: Duration = Duration::from_millis(200);

/// Arguments of `screed-rt`.
#[derive(Clone, Debug, clap::Args)]
pub struct RtArgs {
    /// The cell file
    #[arg(long)]
    pub cell: PathBuf,
    /// The Unix socket on which the host is answered
    #[arg(long)]
    pub socket: PathBuf,
    /// The unit's calibration, for a cell that takes the controller's
    #[arg(long, value_name = "FILE.conf")]
    pub calibration: Option<PathBuf>,
    /// The robot's address, instead of the cell file's
    #[arg(long, value_name = "HOST:PORT")]
    pub robot: Option<String>,
    /// The extruder's serial device, instead of the cell file's
    #[arg(long, value_name = "DEVICE")]
    pub extruder: Option<PathBuf>,
    /// Go on, stamped NON-RT, where the system refuses real-time scheduling, locked memory or the processor
    #[arg(long)]
    pub allow_non_rt: bool,
    /// End when no host has been attached for so long and the arm is at rest
    #[arg(long, value_name = "SECONDS")]
    pub exit_when_idle: Option<u64>,
    /// Allocate once and touch a fresh page after the start: shows that the account counts both
    #[arg(long, hide = true)]
    pub take_memory: bool,
}

/// Why the process cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum RtError {
    /// The cell file.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The loop would not be hard-timed.
    #[error("no real time: {0}")]
    NotRealTime(String),
    /// Nobody answers at the robot's address.
    #[error(
        "the robot at {address} does not answer: {source}; check address and port in [link] of the cell file, and that the controller is on"
    )]
    Robot {
        /// Where.
        address: String,
        /// Why.
        source: io::Error,
    },
    /// The link to the robot failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The extruder's device cannot be opened.
    #[error("the extruder: {0}; check [extruder] in the cell file and that the device is there")]
    Extruder(#[from] SerialError),
    /// Ctrl-C and termination cannot be caught.
    #[error(transparent)]
    Signals(#[from] signal::SignalError),
    /// The machine cannot be made from the cell.
    #[error(transparent)]
    Core(#[from] CoreError),
    /// The host's socket cannot be made.
    #[error("the socket {path} cannot be made: {source}; choose another, with --socket or TMPDIR", path = .path.display())]
    Socket {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Waiting for the lines failed.
    #[error("waiting for the robot failed: {0}")]
    Wait(io::Error),
}

impl From<RtError> for Failure {
    fn from(error: RtError) -> Self {
        match error {
            RtError::Config(error) => error.into(),
            RtError::Signals(error) => error.into(),
            error @ RtError::NotRealTime(_) => Self::new(
                Exit::NotRealTime,
                error.to_string(),
                "grant what was refused, or run stamped NON-RT with --allow-non-rt",
            ),
            RtError::Core(error) => Self::told(Exit::Input, error.to_string()),
            RtError::Socket { .. } | RtError::Wait(_) => Self::told(Exit::Failed, error.to_string()),
            RtError::Robot { .. } | RtError::Link(_) | RtError::Extruder(_) => {
                Self::told(Exit::Link, error.to_string())
            }
        }
    }
}

/// Runs until the host says quit, or (with `exit_when_idle`) nobody has been there for long.
///
/// # Errors
/// [`RtError`].
pub fn run(args: &RtArgs) -> Result<(), RtError> {
    signal::catch_stop()?;
    let cell = config::load_to_move(&args.cell, args.calibration.as_deref())?;
    let scheduling = realtime::enter(&cell.realtime);
    if !scheduling.realtime && !args.allow_non_rt {
        return Err(RtError::NotRealTime(scheduling.note));
    }
    let core = Core::new(&cell, scheduling.realtime, &scheduling.note)?;
    let extruder = open_extruder(&cell, args)?;
    let (robot, dial) = connect(&cell, args)?;
    let host = HostSide::listen(&args.socket)?;
    let mut process = Process {
        core,
        robot: Some(robot),
        dial,
        before: Usage::default(),
        extruder,
        extruder_gone: false,
        host,
        start: wake::now().map_err(RtError::Wait)?,
        grid: None,
        period_ns: 1_000_000_000 / u64::from(cell.link.rate_hz),
        memory: Memory::now(),
    };
    if cell.realtime.pacing == Pacing::Timer {
        process.grid = Some(Grid::new(process.period_ns, 0));
    }
    process.memory = Memory::now();
    if args.take_memory {
        memory::take_some();
    }
    let result = process.serve(args.exit_when_idle);
    let _ = fs::remove_file(&args.socket);
    // Whoever started this process may have gone.
    let _ = writeln!(io::stdout(), "{}", ending(&process.core.pace(), scheduling.realtime));
    result
}

/// The account at the end, in one line.
fn ending(pace: &Pace, realtime: bool) -> String {
    let Pace { tick, overruns, slots_missed, level_max, writes_blocked, segments_resent, .. } = pace;
    let Pace { allocations, faults_minor, faults_major, .. } = pace;
    let stamp = if realtime { "real time" } else { "NON-RT" };
    format!(
        "screed-rt, {stamp}: {tick} ticks, {overruns} overruns, {slots_missed} slots missed, counter at most {level_max}, \
         {writes_blocked} writes blocked, {segments_resent} segments resent; since its start {allocations} allocations, \
         {faults_minor} minor and {faults_major} major page faults"
    )
}

fn connect(cell: &Cell, args: &RtArgs) -> Result<(RobotLine, Dial), RtError> {
    let address = args.robot.clone().unwrap_or_else(|| format!("{}:{}", cell.link.address, cell.link.port));
    Dial::first(&address).map_err(|source| RtError::Robot { address, source })
}

fn open_extruder(cell: &Cell, args: &RtArgs) -> Result<SerialPortNow, RtError> {
    let device = args.extruder.clone().unwrap_or_else(|| cell.extruder.device.clone());
    Ok(SerialPortNow::open(&device, cell.extruder.baud)?)
}

/// The host's end: a listener, at most one host, and bytes of it that the kernel has not taken yet.
struct HostSide {
    listener: UnixListener,
    stream: Option<UnixStream>,
    waiting: Vec<u8>,
    idle_since: Instant,
}

impl HostSide {
    /// What to wait on: a host that asks, or one that speaks while there is room for what it says. Negative is nothing.
    fn fd(&self) -> RawFd {
        match &self.stream {
            None => self.listener.as_raw_fd(),
            Some(stream) if self.waiting.len() < RECEIVE_MAX => stream.as_raw_fd(),
            Some(_) => -1,
        }
    }

    fn listen(path: &PathBuf) -> Result<Self, RtError> {
        let fail = |source| RtError::Socket { path: path.clone(), source };
        if UnixStream::connect(path).is_ok() {
            return Err(fail(io::Error::new(ErrorKind::AddrInUse, "another screed-rt answers there")));
        }
        // Nobody answers: what lies there is left over.
        let _ = fs::remove_file(path);
        let listener = UnixListener::bind(path).map_err(fail)?;
        fs::set_permissions(path, fs::Permissions::from_mode(0o600)).map_err(fail)?;
        listener.set_nonblocking(true).map_err(fail)?;
        Ok(Self { listener, stream: None, waiting: Vec::with_capacity(2 * RECEIVE_MAX), idle_since: Instant::now() })
    }

    /// A host that asks while none is attached, or in place of one that is gone.
    fn accept(&mut self, core: &mut Core) {
        while let Ok((stream, _)) = self.listener.accept() {
            // A second host is turned away: its connection closes at once.
            if self.stream.is_none() && stream.set_nonblocking(true).is_ok() {
                self.stream = Some(stream);
                self.waiting.clear();
                core.on_host_attached();
            }
        }
    }

    fn exchange(&mut self, core: &mut Core) {
        let mut gone = false;
        if let Some(stream) = &mut self.stream {
            let mut bytes = [0; RECEIVE_MAX];
            let room = bytes.len().saturating_sub(self.waiting.len());
            match stream.read(bytes.get_mut(..room).unwrap_or(&mut [])) {
                Ok(0) if room > 0 => gone = true,
                Ok(count) => self.waiting.extend_from_slice(bytes.get(..count).unwrap_or(&[])),
                Err(error) => gone = !is_wait(&error),
            }
            let taken = core.on_host(&self.waiting);
            self.waiting.drain(..taken);
            match stream.write(core.to_host()) {
                Ok(count) => core.sent_to_host(count),
                Err(error) => gone |= !is_wait(&error),
            }
        }
        if gone {
            self.stream = None;
            self.idle_since = Instant::now();
        }
    }
}

struct Process {
    core: Core,
    /// None after the link has failed, until it is made anew.
    robot: Option<RobotLine>,
    dial: Dial,
    /// What connections before this one met with.
    before: Usage,
    extruder: SerialPortNow,
    extruder_gone: bool,
    host: HostSide,
    /// Of the monotonic clock (ns).
    start: u64,
    /// Where the timer paces.
    grid: Option<Grid>,
    period_ns: u64,
    /// What had been taken before the loop began.
    memory: Memory,
}

impl Process {
    fn serve(&mut self, exit_when_idle: Option<u64>) -> Result<(), RtError> {
        let result = self.cycles(exit_when_idle);
        self.core.stop_extruder();
        // The extruder confirms that it stands, and the host hears the last of it, or they take too long.
        let until = Instant::now() + LAST_WORDS;
        loop {
            self.exchange_extruder();
            self.host.exchange(&mut self.core);
            let told = self.host.stream.is_none() || self.core.to_host().is_empty();
            if (told && self.core.extruder_stands()) || Instant::now() > until {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        result
    }

    fn cycles(&mut self, exit_when_idle: Option<u64>) -> Result<(), RtError> {
        let mut ending = false;
        loop {
            self.send_to_robot()?;
            let slot = self.wait()?;
            self.dial_robot();
            self.hear_robot(slot)?;
            self.exchange_extruder();
            let result = self.core.on_time(self.now());
            self.look(result)?;
            // In this order: a host that has just gone makes room for the next.
            self.host.exchange(&mut self.core);
            self.host.accept(&mut self.core);
            let idle = self.host.stream.is_none()
                && exit_when_idle.is_some_and(|limit| self.host.idle_since.elapsed().as_secs() >= limit);
            if !ending && signal::stop_requested() {
                ending = true;
                self.core.quit_by_signal();
            } else if !ending && idle {
                ending = true;
                self.core.quit();
            }
            if self.core.may_quit() {
                return Ok(());
            }
        }
    }

    /// Reads all that the robot sent, answers the newest, and only then stamps and reports the cycle.
    fn hear_robot(&mut self, slot: Option<grid::Slot>) -> Result<(), RtError> {
        let mut bytes = [0; 4096];
        let mut began = None;
        let mut closed = false;
        // After a stall there may be many: all of them are heard before one is answered, so that one stall is one overrun.
        for _ in 0..READS_MAX {
            let Some(heard) = self.robot.as_mut().map(|robot| robot.read(&mut bytes)) else { break };
            let now = self.now();
            match heard {
                Heard::Bytes { count, .. } => {
                    let result = self.core.on_robot(now, bytes.get(..count).unwrap_or(&[]));
                    self.look(result)?;
                    began = Some(heard.ready_at(now));
                }
                Heard::Nothing => break,
                Heard::Closed => {
                    closed = true;
                    break;
                }
            }
        }
        let missed = slot.map_or(0, |slot| u32::try_from(slot.missed).unwrap_or(u32::MAX));
        if let Some(began) = slot.map(|slot| Nanos(slot.due)).or(began) {
            let now = self.now();
            let line_free = self.robot.as_ref().is_some_and(RobotLine::is_free);
            let result = self.core.answer(now, Slot { began, missed, line_free });
            self.look(result)?;
            let ticked = self.now();
            self.send_to_robot()?;
            let sent = self.now();
            self.core.account(self.usage());
            self.core.finish_cycle(ticked, sent);
        }
        if closed {
            let result = self.core.on_robot_closed(self.now());
            self.look(result)?;
        }
        Ok(())
    }

    /// What a failed link means: the process ends where it never ran, else the connection is dropped and made anew.
    fn look(&mut self, result: Result<(), LinkError>) -> Result<(), RtError> {
        if let Err(error) = result
            && !self.core.may_reconnect()
        {
            return Err(error.into());
        }
        if self.core.is_disconnected() {
            self.before = self.usage();
            self.robot = None;
        }
        Ok(())
    }

    /// Makes the connection anew, where there is none.
    fn dial_robot(&mut self) {
        if self.robot.is_some() {
            return;
        }
        match self.dial.poll(self.now()) {
            Dialled::Waiting => {}
            Dialled::Connected(line) => {
                self.robot = Some(line);
                self.core.reconnect();
            }
            Dialled::Failed(why) => self.core.reconnect_failed(&why),
        }
    }

    fn send_to_robot(&mut self) -> Result<(), RtError> {
        let Self { robot, core, start, .. } = self;
        let now = Nanos(since(*start));
        let Some(robot) = robot else { return Ok(()) };
        if robot.send(|out| core.to_robot(now, out)).is_err() {
            let result = core.on_robot_closed(now);
            self.look(result)?;
        }
        Ok(())
    }

    fn usage(&self) -> Usage {
        let line = self.robot.as_ref();
        Usage {
            writes_blocked: self.before.writes_blocked + line.map_or(0, RobotLine::blocked),
            segments_resent: self.before.segments_resent + line.map_or(0, RobotLine::resent),
            memory: Memory::now().since(&self.memory),
        }
    }

    fn exchange_extruder(&mut self) {
        let now = self.now();
        let mut bytes = [0; 512];
        match self.extruder.read(&mut bytes) {
            Ok(count) => self.core.on_extruder(now, bytes.get(..count).unwrap_or(&[])),
            // Unplugged: its silence becomes a fault in due time; until then there is nothing to wait for on it.
            Err(_) => self.extruder_gone = true,
        }
        let mut out = [0; 256];
        let count = self.core.to_extruder(now, &mut out);
        if count > 0 {
            // A line that does not take its bytes shows by the answers that do not come.
            let _ = self.extruder.write(out.get(..count).unwrap_or(&[]));
        }
    }

    /// Waits until there is something to do: where the timer paces, for its next point, which it gives; else for any line, at
    /// most until the next deadline.
    fn wait(&mut self) -> Result<Option<grid::Slot>, RtError> {
        if let Some(grid) = &mut self.grid {
            wake::sleep_until(self.start + grid.due()).map_err(RtError::Wait)?;
            return Ok(Some(grid.wake(since(self.start))));
        }
        let entry = |fd: RawFd, events| libc::pollfd { fd, events, revents: 0 };
        let extruder = if self.extruder_gone { -1 } else { self.extruder.descriptor() };
        let robot = match &self.robot {
            Some(robot) if robot.is_free() => entry(robot.descriptor(), libc::POLLIN),
            Some(robot) => entry(robot.descriptor(), libc::POLLIN | libc::POLLOUT),
            None => entry(self.dial.descriptor(), libc::POLLOUT),
        };
        let mut lines = [robot, entry(self.host.fd(), libc::POLLIN), entry(extruder, libc::POLLIN)];
        let dial = self.robot.is_none().then(|| self.dial.deadline());
        let deadline = [self.core.deadline(), dial].into_iter().flatten().min();
        let until = deadline.map_or(100_000_000, |deadline| deadline.since(self.now()));
        let milliseconds = until.div_ceil(1_000_000).min(100) as libc::c_int;
        // SAFETY: the array outlives the call and its length is given.
        let ready = unsafe { libc::poll(lines.as_mut_ptr(), lines.len() as libc::nfds_t, milliseconds) };
        if ready < 0 {
            let error = io::Error::last_os_error();
            if error.kind() != ErrorKind::Interrupted {
                return Err(RtError::Wait(error));
            }
        }
        Ok(None)
    }

    fn now(&self) -> Nanos {
        Nanos(since(self.start))
    }
}

/// Nanoseconds since a point of the monotonic clock, which cannot fail.
fn since(start: u64) -> u64 {
    wake::now().map_or(0, |now| now.saturating_sub(start))
}

fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted | ErrorKind::TimedOut)
}
