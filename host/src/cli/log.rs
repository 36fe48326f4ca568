//! `screed log`

use super::args::LogArgs;
use super::say;
use crate::failure::{Exit, Failure};
use crate::latency::{Histogram, Summary};
use crate::log::{CsvError, Flags, LogReader, write_csv};
use std::fs::File;
use std::io::{self, BufWriter, ErrorKind};
use std::path::Path;

/// Latencies that are told apart (µs).
const WIRE_BINS: usize = 20_000;

/// Prints the log as a table, or looks through all of it and says what is in it.
pub fn run(args: &LogArgs) -> Result<(), Failure> {
    let log = LogReader::open(&args.file)?;
    match &args.csv {
        None => summarise(log),
        Some(None) => table(log, &mut BufWriter::new(io::stdout().lock())),
        Some(Some(path)) => table(log, &mut BufWriter::new(create(path)?)),
    }
}

fn create(path: &Path) -> Result<File, Failure> {
    File::create(path).map_err(|error| {
        let message = format!("cannot create {}: {error}", path.display());
        Failure::new(Exit::Failed, message, "check the path, the rights and the free space")
    })
}

fn table(log: LogReader, out: &mut impl io::Write) -> Result<(), Failure> {
    match write_csv(log, out) {
        Ok(()) => Ok(()),
        // Whoever reads the table has seen enough, as `head` does.
        Err(CsvError::Write(error)) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(CsvError::Write(error)) => {
            let message = format!("cannot write the table: {error}");
            Err(Failure::new(Exit::Failed, message, "check the free space"))
        }
        Err(CsvError::Log(error)) => Err(error.into()),
    }
}

fn summarise(mut log: LogReader) -> Result<(), Failure> {
    let metadata = log.metadata();
    let mut text = format!(
        "cell {}, robot {}, {} Hz, written by screed {}\nmodel {} ({})\n",
        metadata.cell, metadata.arm, metadata.rate_hz, metadata.screed, metadata.model, metadata.model_hash
    );
    let (mut cycles, mut doubled, mut skipped, mut first, mut last) = (0u64, 0u64, 0u64, None, None);
    let (mut overruns, mut missed, mut level_max, mut non_rt) = (0_u64, 0_u64, 0, 0_u64);
    let mut wire = Histogram::new(WIRE_BINS);
    let result = log.try_for_each(|record| {
        record.map(|record| {
            cycles += 1;
            doubled += u64::from(record.flags.contains(Flags::DOUBLED));
            skipped += u64::from(record.flags.contains(Flags::SKIPPED));
            overruns += u64::from(record.missed > 0);
            missed += u64::from(record.missed);
            level_max = level_max.max(record.overrun_level);
            non_rt += u64::from(record.flags.contains(Flags::NON_RT));
            wire.add(u32::try_from(record.sent.since(record.readable) / 1000).unwrap_or(u32::MAX));
            first = first.or(Some(record));
            last = Some(record);
        })
    });
    text += &format!("{cycles} cycles, {doubled} with a doubled setpoint, {skipped} after a skipped robot state\n");
    text += &format!("{overruns} overruns, {missed} slots missed, overrun counter at most {level_max}\n");
    text += &format!("{} cycles stamped NON-RT, {} real time\n", non_rt, cycles - non_rt);
    if let Some(wire) = Summary::of(&wire, missed) {
        text += &format!("sensor in to wire out {wire}\n");
    }
    if let (Some(first), Some(last)) = (first, last) {
        let seconds = last.received.since(first.received) as f64 * 1e-9;
        text += &format!("ticks {} to {}, {seconds:.3} s, setpoints to {}\n", first.tick.0, last.tick.0, last.seq);
    }
    say(&text)?;
    Ok(result?)
}
