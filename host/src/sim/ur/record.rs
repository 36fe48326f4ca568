//! The record of every cycle.

use super::CycleRecord;
use super::server::SimError;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A CSV file with a row for each cycle: what the robot received and did, for independent judging.
pub struct Record {
    path: PathBuf,
    out: BufWriter<File>,
}

impl Record {
    /// Creates the file and writes the header.
    ///
    /// # Errors
    /// [`SimError::Record`].
    pub fn create(path: &Path) -> Result<Self, SimError> {
        let failed = |source| SimError::Record { path: path.to_owned(), source };
        let mut out = BufWriter::with_capacity(256 * 1024, File::create(path).map_err(failed)?);
        let numbered = |name: &str| (0..6).map(|n| format!(",{name}_{n}")).collect::<String>();
        let (registers, actual_q) = (numbered("register"), numbered("actual_q"));
        let header = format!("cycle,timestamp,packages,seq{registers}{actual_q},runtime_state,stalled_ns");
        writeln!(out, "{header}").map_err(failed)?;
        Ok(Self { path: path.to_owned(), out })
    }

    /// Adds a cycle; `stalled` is by how much the machine came late to it. Numbers are written with as many digits as give
    /// back the same number.
    ///
    /// # Errors
    /// [`SimError::Record`].
    pub fn row(&mut self, cycle: &CycleRecord, stalled: Duration) -> Result<(), SimError> {
        let CycleRecord { cycle: count, timestamp, packages, seq, .. } = cycle;
        let mut write = || {
            write!(self.out, "{count},{timestamp},{packages},{seq}")?;
            for value in cycle.registers.iter().chain(&cycle.actual_q.0) {
                write!(self.out, ",{value}")?;
            }
            writeln!(self.out, ",{},{}", cycle.runtime_state.code(), stalled.as_nanos())
        };
        write().map_err(|source| SimError::Record { path: self.path.clone(), source })
    }

    /// Writes what is left.
    ///
    /// # Errors
    /// [`SimError::Record`].
    pub fn finish(&mut self) -> Result<(), SimError> {
        self.out.flush().map_err(|source| SimError::Record { path: self.path.clone(), source })
    }
}
