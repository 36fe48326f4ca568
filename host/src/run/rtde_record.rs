//! Reads what a controller sends over RTDE and writes it as CSV: one recipe's outputs, one row a package. Writes no input.

use crate::failure::{Exit, Failure};
use crate::link::rtde::file::{Recipe, RecipeFile};
use crate::link::rtde::reader::RtdeReader;
use crate::link::rtde::recipe::{Field, Value, values};
use crate::link::rtde::wire::Protocol;
use crate::link::rtde::{ControllerVersion, Phase};
use screed_kernel::units::Nanos;
use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// Longest silence of a controller (ns): at one package a second there is one.
const TIMEOUT_NS: u64 = 3_000_000_000;
/// How often Ctrl-C is looked at.
const LOOK: Duration = Duration::from_millis(20);
/// How often it is told how far it is.
const TELL: Duration = Duration::from_secs(1);
/// Different steps of time that are kept apart; an honest controller makes a handful.
const STEPS_MAX: usize = 4096;

/// What is recorded.
#[derive(Clone, Copy, Debug)]
pub struct RecordOptions<'a> {
    /// The controller.
    pub host: &'a str,
    /// Its port.
    pub port: u16,
    /// The recipes.
    pub file: &'a RecipeFile,
    /// The one of them.
    pub recipe: &'a Recipe,
    /// Packages a second that are asked for.
    pub rate_hz: u32,
    /// How long, by the controller's time (s).
    pub seconds: Option<f64>,
    /// Ends when this says so.
    pub stop: fn() -> bool,
    /// Is told once a second how many packages have come, and over how long (s) by the controller's time.
    pub progress: fn(u64, f64),
}

/// What was recorded.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// Rows written.
    pub packages: u64,
    /// The controller's software.
    pub controller: Option<ControllerVersion>,
    /// The protocol that was agreed on.
    pub protocol: Protocol,
    /// The steps of the time stamps.
    pub steps: Steps,
}

/// Why a record ends early. What came before is written.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// Nobody answers.
    #[error("{host}:{port} does not answer: {source}; check address and port, and that the controller is on")]
    Connect {
        /// The host.
        host: String,
        /// The port.
        port: u16,
        /// Why.
        source: io::Error,
    },
    /// The link failed.
    #[error("{message}")]
    Link {
        /// How, with its place in the recipe file.
        message: String,
    },
    /// The table cannot be written.
    #[error("cannot write the table: {0}; check path, rights and free space")]
    Write(io::Error),
}

impl RecordError {
    /// With how many packages had been written by then.
    fn after(self, packages: u64) -> Self {
        match self {
            Self::Link { message } if packages > 0 => {
                Self::Link { message: format!("after {packages} packages, which are written: {message}") }
            }
            other => other,
        }
    }
}

impl From<RecordError> for Failure {
    fn from(error: RecordError) -> Self {
        let exit = if matches!(error, RecordError::Write(_)) { Exit::Failed } else { Exit::Link };
        Self::told(exit, error.to_string())
    }
}

/// How often time stamps were so far apart: packages that the controller skipped make longer steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steps {
    last: Option<f64>,
    /// By microseconds.
    counts: BTreeMap<u64, u64>,
    /// Steps that went back or nowhere, or were one of too many different ones.
    strange: u64,
}

impl Steps {
    /// The next time stamp (s).
    pub fn add(&mut self, timestamp: f64) {
        let Some(last) = self.last.replace(timestamp) else { return };
        let micros = ((timestamp - last) * 1e6).round();
        // Not a number is nowhere in the range.
        let is_kept = (1.0..=1e18).contains(&micros)
            && (self.counts.len() < STEPS_MAX || self.counts.contains_key(&(micros as u64)));
        match is_kept {
            true => *self.counts.entry(micros as u64).or_default() += 1,
            false => self.strange += 1,
        }
    }

    /// The least step (s).
    pub fn period(&self) -> Option<f64> {
        self.counts.keys().next().map(|micros| *micros as f64 * 1e-6)
    }

    /// Packages that are missing between those that came, by the least step.
    pub fn skipped(&self) -> u64 {
        let least = self.counts.keys().next().copied().unwrap_or(1);
        let missing = |micros: u64| ((micros as f64 / least as f64).round() as u64).saturating_sub(1);
        self.counts.iter().fold(0, |all, (micros, count)| all.saturating_add(missing(*micros).saturating_mul(*count)))
    }

    /// Steps that are no multiple of the least one, to a tenth of it.
    pub fn irregular(&self) -> u64 {
        let least = self.counts.keys().next().copied().unwrap_or(1) as f64;
        let is_odd = |micros: u64| (micros as f64 / least - (micros as f64 / least).round()).abs() > 0.1;
        self.counts.iter().filter(|(micros, _)| is_odd(**micros)).map(|(_, count)| count).sum::<u64>() + self.strange
    }
}

/// Records until the time is up, or until `stop` says so: then the controller is asked to pause.
///
/// # Errors
/// [`RecordError`].
pub fn record(options: &RecordOptions<'_>, out: &mut dyn Write) -> Result<Recorded, RecordError> {
    let mut reader = RtdeReader::new(options.file, options.recipe, options.rate_hz, TIMEOUT_NS)
        .map_err(|error| RecordError::Link { message: error.to_string() })?;
    let mut stream = connect(options)?;
    let mut table = Table {
        out,
        wanted: reader.wanted(),
        seconds: options.seconds,
        head: None,
        first: None,
        since: 0.0,
        ended: false,
        failed: None,
        rows: 0,
    };
    table.head(reader.fields().get(..reader.wanted()).unwrap_or(&[]));
    let mut steps = Steps::default();
    let result = exchange(&mut stream, &mut reader, &mut table, &mut steps, options);
    if result.is_ok() {
        table.write_head();
    }
    let flushed = table.out.flush();
    // Whoever reads the table may have seen enough, as `head` does.
    match table.failed.map_or(flushed, Err) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => return Err(RecordError::Write(error)),
        _ => result.map_err(|error| error.after(table.rows))?,
    }
    Ok(Recorded { packages: table.rows, controller: reader.controller(), protocol: reader.protocol(), steps })
}

fn connect(options: &RecordOptions<'_>) -> Result<TcpStream, RecordError> {
    let (host, port) = (options.host, options.port);
    let fail = |source| RecordError::Connect { host: host.to_owned(), port, source };
    let mut last = io::Error::new(ErrorKind::NotFound, "the name has no address");
    for address in (host, port).to_socket_addrs().map_err(fail)? {
        match TcpStream::connect_timeout(&address, Duration::from_secs(3)) {
            Ok(stream) => {
                stream.set_nodelay(true).and_then(|()| stream.set_read_timeout(Some(LOOK))).map_err(fail)?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(fail(last))
}

fn exchange(
    stream: &mut TcpStream,
    reader: &mut RtdeReader,
    table: &mut Table<'_>,
    steps: &mut Steps,
    options: &RecordOptions<'_>,
) -> Result<(), RecordError> {
    let began = Instant::now();
    let mut told = began;
    let now = || Nanos(u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX));
    let fields = reader.fields().to_vec();
    let mut bytes = [0; 64 * 1024];
    let mut pausing = false;
    loop {
        if !pausing && (table.ended || (options.stop)()) {
            pausing = true;
            // Before it runs there is nothing to pause.
            if reader.pause().is_err() {
                return Ok(());
            }
        }
        if told.elapsed() > TELL {
            told = Instant::now();
            (options.progress)(table.rows, table.since);
        }
        send(stream, reader, now())?;
        if reader.phase() == Phase::Paused {
            return Ok(());
        }
        let result = match stream.read(&mut bytes) {
            Ok(0) => Err(reader.handle_closed()),
            Ok(count) => reader.handle_bytes(now(), bytes.get(..count).unwrap_or(&[]), |row| {
                if !pausing {
                    table.row(&fields, row, steps);
                }
            }),
            Err(error) if is_wait(&error) => reader.handle_timeout(now()),
            Err(_) => Err(reader.handle_closed()),
        };
        while let Some((text, _)) = reader.poll_text() {
            // Whoever started this may have closed it.
            let _ = writeln!(io::stderr(), "the controller says: {}", text.message);
        }
        result.map_err(|error| RecordError::Link { message: reader.explain(&error).to_string() })?;
    }
}

/// Sends what waits.
fn send(stream: &mut TcpStream, reader: &mut RtdeReader, now: Nanos) -> Result<(), RecordError> {
    let mut part = [0; 1024];
    loop {
        match reader.poll_transmit(now, &mut part) {
            0 => return Ok(()),
            count if stream.write_all(part.get(..count).unwrap_or(&[])).is_ok() => {}
            _ => {
                let error = reader.handle_closed();
                return Err(RecordError::Link { message: reader.explain(&error).to_string() });
            }
        }
    }
}

fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// The rows, as far as they are wanted.
struct Table<'a> {
    out: &'a mut dyn Write,
    wanted: usize,
    seconds: Option<f64>,
    /// The first line, until the first row comes: what fails before leaves nothing behind.
    head: Option<String>,
    /// The first time stamp.
    first: Option<f64>,
    /// The time since then (s).
    since: f64,
    ended: bool,
    failed: Option<io::Error>,
    rows: u64,
}

impl Table<'_> {
    /// One column a number: those of a vector are numbered.
    fn head(&mut self, fields: &[Field]) {
        let columns = fields.iter().flat_map(|field| {
            let name = field.name;
            let one = field.kind.elements() == 1;
            (0..field.kind.elements()).map(move |n| if one { name.to_string() } else { format!("{name}_{n}") })
        });
        self.head = Some(columns.collect::<Vec<_>>().join(","));
    }

    fn write_head(&mut self) {
        if let Some(head) = self.head.take() {
            self.keep(&head);
        }
    }

    fn row(&mut self, fields: &[Field], row: &[u8], steps: &mut Steps) {
        let time =
            values(fields, row).find(|(field, _)| field.is_timestamp()).and_then(|(_, mut numbers)| numbers.next());
        let Some(Value::Double(time)) = time else { return };
        // Half a millisecond is less than a cycle, and more than what rounding does to a time.
        let since = time - *self.first.get_or_insert(time);
        if self.ended || self.seconds.is_some_and(|seconds| since > seconds - 5e-4) {
            self.ended = true;
            return;
        }
        self.since = since;
        self.write_head();
        steps.add(time);
        let numbers =
            values(fields, row).take(self.wanted).flat_map(|(_, numbers)| numbers.map(|number| number.to_string()));
        let line = numbers.collect::<Vec<_>>().join(",");
        self.keep(&line);
        self.rows += 1;
    }

    fn keep(&mut self, line: &str) {
        if let Err(error) = writeln!(self.out, "{line}") {
            self.failed.get_or_insert(error);
            self.ended = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_packages_are_counted_by_the_least_step() {
        let mut steps = Steps::default();
        // 125 Hz with two single gaps and one of three; one stamp twice, one a little off.
        for cycle in [0.0, 1.0, 2.0, 4.0, 5.0, 9.0, 10.0, 12.0, 12.0, 13.0, 14.4] {
            steps.add(41.0 + cycle / 125.0);
        }
        assert_eq!((steps.period(), steps.skipped(), steps.irregular()), (Some(0.008), 5, 2));
        let mut wild = Steps::default();
        (1..20_000).for_each(|step| wild.add(f64::from(step * step)));
        wild.add(f64::NAN);
        assert_eq!(wild.counts.len(), STEPS_MAX);
        assert!(wild.strange > 15_000);
    }
}
