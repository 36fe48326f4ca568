//! The timed print: starts or finds `screed-rt` or a board, drives a [`Session`] over its wire, and keeps a person informed.

mod failed;

pub use failed::{Again, quoted};

use crate::config::Cell;
use crate::failure::{Exit, Failure};
use crate::log::{LogWriter, Metadata};
use crate::model::fim::FimModel;
use crate::run::children::{self, Process};
use crate::run::job::Outcome;
use crate::run::person;
use crate::run::session::{Progress, Session, Step, Wishes, degrees};
use crate::run::signal;
use crate::run::summary::Summary;
use crate::run::wire::Wire;
use crate::run::words;
use screed_kernel::frame::{FaultReport, ModeCode};
use std::io::{self, BufRead, IsTerminal, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::{Duration, Instant};

/// How long a stop may take before the host gives up waiting for it.
const STOP_PATIENCE: Duration = Duration::from_secs(5);

/// How long a board may say nothing.
const SILENCE: Duration = Duration::from_secs(2);

/// What to print, where, and how.
pub struct Print<'a> {
    /// The cell.
    pub cell: &'a Cell,
    /// The model.
    pub model: &'a FimModel,
    /// Which part of it, and for how long.
    pub wishes: Wishes,
    /// Where to log.
    pub log: Option<PathBuf>,
    /// The model's file name and bytes, for the log.
    pub source: (&'a str, &'a [u8]),
    /// Whether motion is confirmed beforehand (simulated robots only).
    pub yes: bool,
    /// Whether no progress is shown.
    pub quiet: bool,
    /// What goes on after a failure on the path; none where the robot ends with the print.
    pub again: Option<Again>,
}

/// A connection to a kernel, and its process if this host started it.
pub struct Attached {
    pub(super) wire: Wire,
    pub(super) process: Option<Process>,
    /// The socket or serial device.
    place: PathBuf,
}

/// Attaches to the `screed-rt` that answers at `socket`, or starts it with `command`.
///
/// # Errors
/// [`Failure`] with what `screed-rt` said, if it ended.
pub fn attach(socket: &Path, command: Option<Command>) -> Result<Attached, Failure> {
    let attached = |stream, process| match Wire::socket(stream) {
        Ok(wire) => Ok(Attached { wire, process, place: socket.to_owned() }),
        Err(error) => {
            let message = format!("the socket of screed-rt cannot be used: {error}");
            Err(Failure::new(Exit::Link, message, "start it again"))
        }
    };
    if let Ok(stream) = UnixStream::connect(socket) {
        return attached(stream, None);
    }
    let Some(command) = command else {
        let message = format!("no screed-rt answers at {}", socket.display());
        return Err(Failure::new(Exit::Link, message, "start it, or leave --attach out to have it started"));
    };
    let mut process = Process::spawn("screed-rt", command)?;
    let until = Instant::now() + Duration::from_secs(10);
    loop {
        process.check()?;
        if let Ok(stream) = UnixStream::connect(socket) {
            return attached(stream, Some(process));
        }
        if Instant::now() > until {
            let message = format!("screed-rt does not answer at {}", socket.display());
            return Err(Failure::new(Exit::Link, message, "see whether another process blocks the machine"));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The kernel on a board at the end of the serial line `device`, at `baud` bits a second.
///
/// # Errors
/// [`Failure`] when the device cannot be used. Whether a board is there shows when it speaks.
pub fn attach_board(device: &Path, baud: u32) -> Result<Attached, Failure> {
    let wire = Wire::line(device, baud).map_err(|error| {
        Failure::new(Exit::Link, error.to_string(), "check --board, and that this user may open it")
    })?;
    Ok(Attached { wire, process: None, place: device.to_owned() })
}

/// Opens the log a print asks for.
///
/// # Errors
/// [`Failure`] when it cannot be written.
pub fn open_log(print: &Print<'_>) -> Result<Option<LogWriter>, Failure> {
    let Some(path) = &print.log else { return Ok(None) };
    let cell = print.cell;
    let (name, bytes) = print.source;
    let metadata = Metadata {
        screed: children::VERSION.to_owned(),
        cell: cell.name.clone(),
        model: name.to_owned(),
        model_hash: format!("{:016x}", crate::run::account::fingerprint(bytes)),
        arm: cell.robot.model.clone(),
        rate_hz: cell.link.rate_hz,
        modes: ["unready", "holding", "moving", "stopping", "faulted"].map(str::to_owned).to_vec(),
    };
    Ok(Some(LogWriter::create(path, &metadata)?))
}

/// Prints. The summary says how it ended.
///
/// # Errors
/// [`Failure`]; the ring then still plays to its end, and the arm rests on its path.
pub fn run(print: &Print<'_>, attached: Attached) -> Result<Summary, Failure> {
    let log = open_log(print)?;
    let Attached { wire, process, place } = attached;
    let mut session = Session::new(print.cell, print.model, print.wishes.clone(), log);
    if let Some(baud) = wire.baud() {
        session.job().over_a_line(baud);
    } else if !print.quiet {
        note!("screed-rt answers at {}; should this program be lost, attach another with --attach", place.display());
    }
    let now = Instant::now();
    let mut driver = Driver {
        wire,
        place,
        started: now,
        heard: now,
        shown: None,
        terminal: io::stderr().is_terminal(),
        stays: process.is_none(),
        told: false,
        slow: false,
    };
    let result = driver.drive(&mut session, print).map_err(|failure| {
        // What came together with the end: the fault itself, where the link failed.
        driver.tell_alarms(&mut session);
        let failure = driver.possible(failure);
        match (&print.again, session.layer()) {
            (Some(again), Some(layer)) => failed::going_on(failure, again, layer),
            _ => failure,
        }
    });
    if process.is_some() {
        // Whatever happened: the process comes to rest, closes the extruder's line and ends.
        session.job().quit();
        let _ = driver.exchange(&mut session);
    }
    driver.end_line();
    session.finish()?;
    if let Some(mut process) = process {
        let mut ended = false;
        for _ in 0..150 {
            let _ = driver.exchange(&mut session);
            ended = process.wait(Duration::from_millis(10));
            if ended {
                break;
            }
        }
        if !ended {
            drop(process);
        }
    }
    if result.is_err() {
        tell_account(print, &session.summary(print.source.0, FAILED));
    }
    let mut summary = session.summary(print.source.0, result?);
    summary.log = print.log.as_ref().map(|path| path.display().to_string());
    Ok(summary)
}

/// The outcome of a print that a failure has ended.
pub(super) const FAILED: &str = "failed";

/// The table of what was done until a failure, if anything was; on standard error, where the failure follows.
pub(super) fn tell_account(print: &Print<'_>, summary: &Summary) {
    if !print.quiet && summary.figures.sent > 0 {
        note!("{summary}");
    }
}

struct Driver {
    wire: Wire,
    place: PathBuf,
    started: Instant,
    /// When bytes came last.
    heard: Instant,
    shown: Option<Instant>,
    terminal: bool,
    /// Whether the kernel goes on when this print has ended: one that was attached to, or on a board.
    stays: bool,
    /// Whether it was told what an earlier host has left.
    told: bool,
    /// Whether it was told that the first layer is laid slower.
    slow: bool,
}

impl Driver {
    fn drive(&mut self, session: &mut Session<'_>, print: &Print<'_>) -> Result<&'static str, Failure> {
        let mut answer: Option<Receiver<bool>> = None;
        let mut stopping: Option<Instant> = None;
        loop {
            self.exchange(session)?;
            self.tell_news(session, print);
            match session.step(self.started.elapsed().as_secs_f64())? {
                Step::Running => {}
                Step::Confirm => {
                    self.check_board(session, print.cell)?;
                    answer = self.ask(session, print);
                }
                Step::Rearm(report) if answer.is_none() => answer = Some(self.ask_rearm(&report, print)),
                Step::Rearm(_) => {}
                Step::Ended(Outcome::Complete) => return Ok("complete"),
                Step::Ended(Outcome::Stopped) => {
                    return Ok(if stopping.is_some() { "interrupted" } else { "stopped" });
                }
            }
            if is_confirmed(answer.as_ref())? {
                answer = None;
                // Whichever was asked: the other does nothing now.
                session.job().rearm();
                session.confirm();
            }
            if signal::stop_requested() && stopping.is_none() {
                stopping = Some(Instant::now());
                session.stop();
            }
            if stopping.is_some_and(|since| since.elapsed() > STOP_PATIENCE) {
                let message = "the kernel does not say that the arm rests";
                return Err(Failure::new(Exit::SafetyStop, message, "use the emergency stop if the arm moves"));
            }
            if !print.quiet {
                self.show(session);
            }
        }
    }

    /// What a person has to hear once: what an earlier host has left, alarms, how fast the first layer is laid.
    fn tell_news(&mut self, session: &mut Session<'_>, print: &Print<'_>) {
        if !self.told
            && let Some(status) = session.job().left_behind()
        {
            self.told = true;
            let playing = matches!(status.mode, ModeCode::Moving | ModeCode::Stopping);
            note!(
                "note: an earlier host was lost; its ring {} to its end, where the arm rests on its path: setpoint {} of {}. \
                 To go on with that print, choose the layer with --from-layer.",
                if playing { "is being played" } else { "was played" },
                status.consumed,
                status.end_seq
            );
        }
        self.tell_alarms(session);
        if session.is_slow() != self.slow && session.plan().is_some() {
            self.slow = !self.slow;
            self.end_line();
            let percent = print.wishes.first_layer_rate.unwrap_or(1.0) * 100.0;
            match self.slow {
                true => note!("the first layer is laid at {percent:.0} % of its planned speed"),
                false => note!("the first layer is laid; the next ones go as planned"),
            }
        }
    }

    fn tell_alarms(&mut self, session: &mut Session<'_>) {
        for alarm in session.job().take_alarms() {
            self.end_line();
            note!("alarm: {}", words::possible(&alarm, self.stays));
        }
    }

    /// Without what cannot be done once the kernel has ended.
    fn possible(&self, mut failure: Failure) -> Failure {
        for problem in &mut failure.problems {
            problem.remedy = problem.remedy.take().map(|remedy| words::possible(&remedy, self.stays).to_owned());
        }
        failure
    }

    /// Waits a little for the process, hears it, and says what there is to say.
    fn exchange(&mut self, session: &mut Session<'_>) -> Result<(), Failure> {
        let greeted = session.job().process().is_some();
        let mut line = libc::pollfd { fd: self.wire.descriptor(), events: libc::POLLIN, revents: 0 };
        // SAFETY: one entry, which outlives the call.
        unsafe { libc::poll(&raw mut line, 1, 5) };
        let mut bytes = [0; 65536];
        let count = self.wire.read(&mut bytes).map_err(|_| self.gone(greeted))?;
        if count > 0 {
            self.heard = Instant::now();
            session.handle_bytes(bytes.get(..count).unwrap_or(&[]))?;
        } else if self.wire.baud().is_some() && self.heard.elapsed() > SILENCE {
            return Err(self.silent(greeted));
        }
        let out = session.poll_transmit()?;
        let written = self.wire.write(out).map_err(|_| self.gone(greeted))?;
        out.drain(..written);
        Ok(())
    }

    /// Whether the arm that a board is built for is the cell's: it says so, and there limits and workspace are judged by it.
    fn check_board(&self, session: &mut Session<'_>, cell: &Cell) -> Result<(), Failure> {
        let expected = format!("board, {}", cell.robot.model);
        match session.job().process() {
            Some((_, note)) if self.wire.baud().is_some() && note != expected => {
                let message = format!("the board at {}: expected {expected:?}, found {note:?}", self.place.display());
                Err(Failure::new(
                    Exit::Input,
                    message,
                    "give the cell of that board, or build its firmware for this robot",
                ))
            }
            _ => Ok(()),
        }
    }

    /// What it means that the wire was closed.
    fn gone(&self, greeted: bool) -> Failure {
        if self.wire.baud().is_some() {
            let message = format!("the serial line {} was closed", self.place.display());
            return Failure::new(Exit::Link, message, "plug it in again; the arm rests at the end of what it was sent");
        }
        match greeted {
            true => Failure::new(Exit::Link, "screed-rt has ended", "see where the arm stands, then start again"),
            false => Failure::new(
                Exit::Link,
                format!("the screed-rt at {} is busy: another print is attached to it", self.place.display()),
                "wait until that print has ended, or end it there with Ctrl-C; it comes to rest on its path",
            ),
        }
    }

    /// What it means that a board, which speaks every cycle, says nothing.
    fn silent(&self, greeted: bool) -> Failure {
        let place = self.place.display();
        match greeted {
            true => Failure::new(
                Exit::Link,
                format!("the board at {place} has said nothing for {} s", SILENCE.as_secs()),
                "mend the line, see where the arm stands, then start again; it rests at the end of what it was sent",
            ),
            false => Failure::new(
                Exit::Link,
                format!("no board answers at {place}"),
                "check the device, --baud, and that the board runs",
            ),
        }
    }

    /// Shows the approach and asks, or takes the answer given beforehand.
    fn ask(&mut self, session: &mut Session<'_>, print: &Print<'_>) -> Option<Receiver<bool>> {
        if let Some(plan) = session.plan() {
            let approach = plan.approach();
            if approach.lifted {
                note!("the tool is first lifted straight up to the travel height");
            }
            note!("approach, joints in degrees:");
            note!("  from {}", degrees(&approach.from));
            note!("  to   {}", degrees(&approach.to));
            note!(
                "  {:.1} s; the tool goes {:.3} m, nowhere lower than {:.0} mm above the part's base",
                approach.duration,
                approach.tool_distance,
                approach.tool_lowest * 1e3
            );
        }
        if print.yes {
            session.confirm();
            return None;
        }
        Some(answer_to(print, "The robot will move. Type yes to begin: ", "yes"))
    }

    /// Shows the fault that the process stands in and asks whether to leave it.
    fn ask_rearm(&mut self, report: &FaultReport, print: &Print<'_>) -> Receiver<bool> {
        note!("the kernel stands in fault {}, {}", report.number, words::fault(&report.fault));
        note!("remedy: {}", report.fault.action());
        if print.yes {
            let (sender, receiver) = mpsc::channel();
            let _ = sender.send(true);
            return receiver;
        }
        answer_to(print, "Type re-arm to leave it (nothing moves yet): ", "re-arm")
    }

    /// A line of progress: in place on a terminal, every five seconds elsewhere.
    fn show(&mut self, session: &mut Session<'_>) {
        let every = if self.terminal { Duration::from_millis(200) } else { Duration::from_secs(5) };
        if self.shown.is_some_and(|shown| shown.elapsed() < every) {
            return;
        }
        let Some(progress) = session.progress(self.started.elapsed().as_secs_f64()) else { return };
        self.shown = Some(Instant::now());
        let line = progress_line(session, &progress);
        let _ = if self.terminal { write!(io::stderr(), "\r\x1b[K{line}") } else { writeln!(io::stderr(), "{line}") };
    }

    fn end_line(&mut self) {
        if self.terminal && self.shown.is_some() {
            note!();
            self.shown = None;
        }
    }
}

/// Whether a person who was asked has said yes.
fn is_confirmed(answer: Option<&Receiver<bool>>) -> Result<bool, Failure> {
    match answer.map(Receiver::try_recv) {
        Some(Ok(true)) => Ok(true),
        Some(Ok(false) | Err(TryRecvError::Disconnected)) => {
            let message = "what was asked was not confirmed";
            Err(Failure::new(
                Exit::Failed,
                message,
                "nothing has moved; the watchdog ends Screed's program on the robot, so start again with --upload when it may",
            ))
        }
        Some(Err(TryRecvError::Empty)) | None => Ok(false),
    }
}

/// Asks on standard error; the answer comes from a thread of its own, so that the print is listened to while the person
/// thinks. For a robot that may be real only a terminal answers.
fn answer_to(print: &Print<'_>, question: &str, wanted: &'static str) -> Receiver<bool> {
    let (sender, receiver) = mpsc::channel();
    if !print.cell.robot.simulated && !io::stdin().is_terminal() {
        note!("nobody can be asked: the standard input is no terminal, and the robot may be real");
        let _ = sender.send(false);
        return receiver;
    }
    person::forget_typed();
    let _ = write!(io::stderr(), "{question}");
    std::thread::spawn(move || {
        let mut line = String::new();
        let read = io::stdin().lock().read_line(&mut line);
        let _ = sender.send(read.is_ok() && line.trim() == wanted);
    });
    receiver
}

/// One line: layer, share, time left, errors, cycles missed, scheduling.
pub fn progress_line(session: &mut Session<'_>, progress: &Progress) -> String {
    let realtime = session.job().process().is_some_and(|(realtime, _)| realtime);
    let figures = &session.job().account().figures;
    let millimetres = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{:.3}", value * 1e3));
    format!(
        "layer {} of {} to {}, {}  {:5.1} %  {:.0} s left  contour {} mm, lag {} mm  doubled {}  late {}  overruns {}  {}",
        progress.layer,
        progress.layers.0,
        progress.layers.1.saturating_sub(1),
        progress.kind,
        progress.share * 100.0,
        progress.seconds_left,
        millimetres(figures.commanded_contour.max()),
        millimetres(figures.following.rms()),
        figures.doubled,
        figures.stalls,
        figures.overruns,
        if realtime { "RT" } else { "NON-RT" },
    )
}
