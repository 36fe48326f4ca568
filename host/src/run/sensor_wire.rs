//! How long it takes from a robot's telegram that lies ready to its answer on the wire, measured by `screed-rt` itself against
//! the simulated controller: the process that a print would have, holding its position.

use crate::config::{Cell, Pacing, Realtime};
use crate::failure::{Exit, Failure};
use crate::latency::{Histogram, Summary};
use crate::run::demo::{Folder, Machines, program};
use crate::run::memory::Memory;
use crate::run::print::{self, Attached};
use crate::run::{self, children};
use screed_kernel::frame::{self, FromKernel, Pace, Reader, ToKernel, WIRE_MAX};
use serde::Serialize;
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Latencies that are told apart (µs): as much as the robot's time-out.
const BINS: usize = 100_000;

/// What is measured.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Cycles a second: 125 or 500.
    pub rate_hz: u32,
    /// The process' scheduling.
    pub realtime: Realtime,
    /// How long.
    pub length: Duration,
    /// Whether it goes on where scheduling is refused.
    pub allow_non_rt: bool,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Wire {
    /// Cycles a second.
    pub rate_hz: u32,
    /// "real time" or "NON-RT".
    pub scheduling: &'static str,
    /// From readable to written; slots missed.
    #[serde(flatten)]
    pub latency: Summary,
    /// Overruns of the process.
    pub overruns: u64,
    /// The most that their leaky counter was.
    pub overrun_counter_max: u32,
    /// What the process took from memory after its start.
    pub memory: Memory,
}

/// Starts robot, extruder and `screed-rt`, and listens.
///
/// # Errors
/// [`Failure`] of any of them; real time that is refused.
pub fn measure(wanted: &Measured) -> Result<Wire, Failure> {
    let cell = Cell::demo(wanted.rate_hz)?;
    let folder = Folder::new()?;
    let write = |name: &str, text: &str| {
        let path: PathBuf = folder.join(name);
        fs::write(&path, text).map(|()| path).map_err(|error| {
            Failure::new(Exit::Failed, format!("{}: {error}", folder.display()), "set TMPDIR to a folder with room")
        })
    };
    let program = write("robot.script", &program(&cell)?)?;
    let cell_file = write("cell.toml", &(Cell::demo_text(wanted.rate_hz)? + &section(&wanted.realtime)))?;
    let machines = Machines::start(&cell_file, &program, None, None)?;
    let socket = folder.join("rt.sock");
    let mut command = children::screed_rt()?;
    command.arg("--cell").arg(&cell_file).arg("--socket").arg(&socket).args(machines.arguments());
    command.args(wanted.allow_non_rt.then_some("--allow-non-rt")).args(["--exit-when-idle", "2"]);
    let Attached { mut wire, process, .. } = print::attach(&socket, Some(command))?;
    let mut listener = Listener::new();
    say(&mut wire, &ToKernel::Configure(cell.configure()))?;
    let heard = listener.listen(&mut wire, wanted.length);
    let told = say(&mut wire, &ToKernel::Quit);
    if let Some(mut process) = process {
        process.wait(Duration::from_secs(2));
    }
    heard.and(told)?;
    listener.found(wanted.rate_hz)
}

/// The cell file's words for the scheduling wanted.
fn section(realtime: &Realtime) -> String {
    let cpu = realtime.cpu.map_or(String::new(), |cpu| format!("cpu = {cpu}\n"));
    let pace = if realtime.pacing == Pacing::Timer { "timer" } else { "robot" };
    let Realtime { priority, overruns_max, .. } = realtime;
    format!("\n[realtime]\npriority = {priority}\n{cpu}pace = \"{pace}\"\noverruns_max = {overruns_max}\n")
}

fn say(line: &mut run::wire::Wire, message: &ToKernel) -> Result<(), Failure> {
    let mut bytes = [0; WIRE_MAX];
    let used = frame::encode(message, &mut bytes)
        .map_err(|error| Failure::new(Exit::Failed, format!("{error:?}"), "report this"))?;
    let bytes = bytes.get(..used).unwrap_or(&[]);
    // A message is small beside the socket's buffer: it is taken whole, or nobody reads.
    if line.write(bytes).ok() == Some(bytes.len()) { Ok(()) } else { Err(gone()) }
}

fn gone() -> Failure {
    Failure::new(Exit::Link, "screed-rt has ended", "start it by hand to see what is wrong")
}

/// What `screed-rt` tells.
struct Listener {
    reader: Reader,
    histogram: Histogram,
    realtime: bool,
    pace: Option<Pace>,
}

impl Listener {
    fn new() -> Self {
        Self { reader: Reader::new(), histogram: Histogram::new(BINS), realtime: false, pace: None }
    }

    fn listen(&mut self, line: &mut run::wire::Wire, length: Duration) -> Result<(), Failure> {
        let until = Instant::now() + length;
        let mut bytes = [0; 65_536];
        while Instant::now() < until {
            let mut poll = libc::pollfd { fd: line.descriptor(), events: libc::POLLIN, revents: 0 };
            // SAFETY: one entry, which outlives the call.
            unsafe { libc::poll(&raw mut poll, 1, 50) };
            let count = line.read(&mut bytes).map_err(|_| gone())?;
            bytes.iter().take(count).for_each(|byte| self.hear(*byte));
        }
        Ok(())
    }

    fn hear(&mut self, byte: u8) {
        let Some(Ok(plain)) = self.reader.push(byte) else { return };
        match frame::decode::<FromKernel>(plain) {
            Ok(FromKernel::Process { realtime, .. }) => self.realtime = realtime,
            Ok(FromKernel::Pace(pace)) => self.pace = Some(pace),
            // Of cycles in which nothing was sent there is nothing to measure.
            Ok(FromKernel::Cycle(record)) if !record.commanded.is_empty() => {
                if let Some(pace) = self.pace.filter(|pace| pace.tick == record.tick) {
                    let latency_us = record.sent_ns.saturating_sub(pace.readable_ns) / 1000;
                    self.histogram.add(u32::try_from(latency_us).unwrap_or(u32::MAX));
                }
            }
            _ => {}
        }
    }

    fn found(&self, rate_hz: u32) -> Result<Wire, Failure> {
        let pace = self.pace.unwrap_or_default();
        let Some(latency) = Summary::of(&self.histogram, pace.slots_missed) else {
            let message = "the robot was never answered in the time to measure";
            return Err(Failure::new(Exit::Failed, message, "measure for longer"));
        };
        let Pace { allocations, faults_minor, faults_major, overruns, level_max, .. } = pace;
        Ok(Wire {
            rate_hz,
            scheduling: if self.realtime { "real time" } else { "NON-RT" },
            latency,
            overruns,
            overrun_counter_max: level_max,
            memory: Memory { allocations, faults_minor, faults_major },
        })
    }
}
