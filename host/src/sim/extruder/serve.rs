//! `screed sim extruder`: the simulated extruder on a pseudo-terminal, until it is told to stop.

use super::{Extruder, SimError};
use crate::run::serial::{read_now, set_non_blocking, write_now};
use serialport::{SerialPort, TTYPort};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Lag of the flow (s, time to 63 %).
const LAG: f64 = 0.05;
/// How often the extruder looks at its line.
const PERIOD: Duration = Duration::from_millis(5);
/// A longer step means that this machine stood still; the extruder's time then stands still too, and the stall is counted.
const STEP_MAX: Duration = Duration::from_millis(50);

/// What to serve.
#[derive(Clone, Debug)]
pub struct ServeOptions {
    /// Highest flow (m³/s).
    pub flow_max: f64,
    /// Where to write time, flows and volume, one row every 5 ms.
    pub record: Option<PathBuf>,
    /// Ends when no valid line has come for this long.
    pub exit_when_idle: Option<Duration>,
    /// The lines on standard output are JSON.
    pub json: bool,
    /// Ends when this says so; looked at every 5 ms.
    pub stop: fn() -> bool,
}

/// Opens a pseudo-terminal, says its path on one line of standard output, and simulates until it is told to stop or is idle;
/// then says what was extruded, on one more line.
///
/// # Errors
/// [`SimError`].
pub fn serve(options: &ServeOptions) -> Result<(), SimError> {
    let mut extruder = Extruder::new(options.flow_max, LAG)?;
    let mut record = options.record.as_deref().map(Record::create).transpose()?;
    let (master, device) = open_terminal()?;
    let announced = announce(&device, options.json);
    announced.map_err(|source| SimError::Terminal { action: "say its device", source })?;

    let (mut simulated, mut stalls) = (Duration::ZERO, 0u64);
    let (mut last, mut last_valid) = (Instant::now(), (Instant::now(), 0));
    while !(options.stop)() {
        std::thread::sleep(PERIOD);
        exchange(&mut extruder, &master)?;
        let now = Instant::now();
        let elapsed = now.duration_since(last);
        last = now;
        stalls += u64::from(elapsed > STEP_MAX);
        let step = elapsed.min(STEP_MAX);
        simulated += step;
        extruder.step(step.as_secs_f64());
        if let Some(record) = &mut record {
            record.row(simulated, &extruder)?;
        }
        if extruder.lines().0 != last_valid.1 {
            last_valid = (now, extruder.lines().0);
        }
        if options.exit_when_idle.is_some_and(|idle| now.duration_since(last_valid.0) >= idle) {
            break;
        }
    }
    if let Some(record) = record {
        record.finish()?;
    }
    match farewell(&extruder, stalls, options.json) {
        // Whoever started it has gone, or has read the device and closed its end.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        said => said.map_err(|source| SimError::Terminal { action: "say what it extruded", source }),
    }
}

/// The master's end, and the path of the other one. The other end is not kept open: the lock of a client that was killed
/// must go with it.
fn open_terminal() -> Result<(TTYPort, String), SimError> {
    let failed =
        |error: serialport::Error| SimError::Terminal { action: "open a pseudo-terminal", source: error.into() };
    let (master, slave) = TTYPort::pair().map_err(failed)?;
    let name = slave.name().ok_or_else(|| SimError::Terminal {
        action: "name its pseudo-terminal",
        source: io::ErrorKind::NotFound.into(),
    })?;
    set_non_blocking(master.as_raw_fd())
        .map_err(|source| SimError::Terminal { action: "make its terminal non-blocking", source })?;
    Ok((master, name))
}

/// Reads, and writes the answers. Without a client the kernel reports an input/output error, which is nobody there.
fn exchange(extruder: &mut Extruder, master: &TTYPort) -> Result<(), SimError> {
    let mut buffer = [0; 512];
    loop {
        match read_now(master.as_raw_fd(), &mut buffer) {
            Ok(0) => break,
            Ok(count) => extruder.handle_bytes(buffer.get(..count).unwrap_or_default()),
            Err(error) if error.raw_os_error() == Some(libc::EIO) => break,
            Err(source) => return Err(SimError::Terminal { action: "read its line", source }),
        }
    }
    let count = extruder.poll_transmit(&mut buffer);
    match write_now(master.as_raw_fd(), buffer.get(..count).unwrap_or_default()) {
        // What a full line or an absent client does not take is lost, as on a real wire.
        Ok(_) => Ok(()),
        Err(error) if error.raw_os_error() == Some(libc::EIO) => Ok(()),
        Err(source) => Err(SimError::Terminal { action: "write its line", source }),
    }
}

fn announce(device: &str, json: bool) -> io::Result<()> {
    let mut out = io::stdout().lock();
    if json {
        writeln!(out, "{}", serde_json::json!({ "device": device }))?;
    } else {
        writeln!(out, "simulated extruder at {device}")?;
    }
    out.flush()
}

fn farewell(extruder: &Extruder, stalls: u64, json: bool) -> io::Result<()> {
    let (valid, damaged) = extruder.lines();
    let volume_mm3 = extruder.volume() * 1e9;
    let mut out = io::stdout().lock();
    if json {
        let said = serde_json::json!({
            "volume_mm3": volume_mm3, "valid_lines": valid, "damaged_lines": damaged, "stalls": stalls,
        });
        writeln!(out, "{said}")?;
    } else {
        writeln!(
            out,
            "extruded {volume_mm3:.1} mm³; {valid} valid lines, {damaged} damaged; the machine stood still {stalls} times"
        )?;
    }
    out.flush()
}

/// Time, flows and volume as a table.
struct Record {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Record {
    fn create(path: &Path) -> Result<Self, SimError> {
        let file = File::create(path).and_then(|file| {
            let mut file = BufWriter::new(file);
            writeln!(file, "time_s,commanded_m3_s,actual_m3_s,volume_m3")?;
            Ok(file)
        });
        match file {
            Ok(file) => Ok(Self { path: path.to_owned(), file }),
            Err(source) => Err(SimError::Record { file: path.to_owned(), source }),
        }
    }

    fn row(&mut self, time: Duration, extruder: &Extruder) -> Result<(), SimError> {
        let (target, actual, volume) = (extruder.target(), extruder.actual(), extruder.volume());
        writeln!(self.file, "{},{target},{actual},{volume}", time.as_secs_f64())
            .map_err(|source| SimError::Record { file: self.path.clone(), source })
    }

    fn finish(mut self) -> Result<(), SimError> {
        self.file.flush().map_err(|source| SimError::Record { file: self.path, source })
    }
}
