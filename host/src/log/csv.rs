//! The log as a table.

use super::{CycleRecord, Flags, LogError, LogReader};
use std::io::{self, Write};

/// Why the table is not whole.
#[derive(Debug, thiserror::Error)]
pub enum CsvError {
    /// The table cannot be written.
    #[error("cannot write the table: {0}")]
    Write(#[from] io::Error),
    /// The log cannot be read on; the rows before are written.
    #[error(transparent)]
    Log(#[from] LogError),
}

/// Writes a header row with units and one row a record. Numbers are written so that they read back as the same f64.
///
/// # Errors
/// [`CsvError::Log`] after all sound rows of a torn or damaged log have been written.
pub fn write_csv(log: LogReader, out: &mut impl Write) -> Result<(), CsvError> {
    let modes = log.metadata().modes.clone();
    write_header(out)?;
    for record in log {
        match record {
            Ok(record) => write_row(out, &record, &modes)?,
            Err(error) => {
                out.flush()?;
                return Err(error.into());
            }
        }
    }
    Ok(out.flush()?)
}

fn write_header(out: &mut impl Write) -> io::Result<()> {
    write!(
        out,
        "tick,readable_ns,received_ns,ticked_ns,sent_ns,robot_timestamp_s,seq,mode,deposit,doubled,skipped,non_rt,missed,\
         overrun_level,layer,rate,flow_m3_s"
    )?;
    for kind in ["commanded", "actual"] {
        for joint in 1..=6 {
            write!(out, ",{kind}_{joint}_rad")?;
        }
    }
    writeln!(out)
}

fn write_row(out: &mut impl Write, record: &CycleRecord, modes: &[String]) -> io::Result<()> {
    let CycleRecord {
        tick,
        readable,
        received,
        ticked,
        sent,
        robot_timestamp,
        seq,
        mode,
        flags,
        layer,
        rate,
        flow,
        ..
    } = record;
    write!(out, "{},{},{},{},{},", tick.0, readable.0, received.0, ticked.0, sent.0)?;
    write!(out, "{robot_timestamp},{seq},")?;
    match modes.get(usize::from(*mode)) {
        // A name cannot break the table.
        Some(name) if !name.contains([',', '"', '\n', '\r']) => write!(out, "{name}")?,
        _ => write!(out, "{mode}")?,
    }
    for flag in [Flags::DEPOSIT, Flags::DOUBLED, Flags::SKIPPED, Flags::NON_RT] {
        write!(out, ",{}", u8::from(flags.contains(flag)))?;
    }
    write!(out, ",{},{},{layer},{rate},{flow}", record.missed, record.overrun_level)?;
    for joint in record.commanded.0.iter().chain(&record.actual.0) {
        write!(out, ",{joint}")?;
    }
    writeln!(out)
}
