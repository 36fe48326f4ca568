//! A clay extruder on the extruder's own wire: a state machine without clock or port.
//!
//! The flow follows its target with a first-order lag, a model (a real pump's lag depends on clay and hose). Its safety
//! behaviour is that of `docs/extruder.md`: it stops when no valid line comes for 500 ms or when it is told too high a
//! flow, and then extrudes again only after it has been told to stand still.

pub mod serve;
#[cfg(test)]
mod tests;

use crate::failure::{Exit, Failure};
use crate::link::extruder::WATCHDOG_NS;
use crate::link::extruder::wire::{Answer, Command, DeviceFault, Lines, cubic_metres, nanolitres};
use std::io;
use std::path::PathBuf;

/// The watchdog's time (s).
const WATCHDOG: f64 = WATCHDOG_NS as f64 * 1e-9;
/// Lag of the flow (s, time to 63 %) of a small clay pump; a guess that a measured pump replaces.
pub const TIME_CONSTANT: f64 = 0.05;
/// Answers that nobody fetches are dropped beyond this many bytes, as a UART would.
const OUTGOING_MAX: usize = 1024;

/// Why there is no simulated extruder.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// A figure that cannot be.
    #[error("the simulated extruder's {what} is {found}: expected {expected}")]
    Impossible {
        /// Which figure, with its unit.
        what: &'static str,
        /// What it may be.
        expected: &'static str,
        /// As given.
        found: f64,
    },
    /// The system refused a pseudo-terminal, or took it away.
    #[error("the simulated extruder cannot {action}: {source}")]
    Terminal {
        /// What it was about to do.
        action: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// The record cannot be written.
    #[error("cannot write the extruder's record {}: {source}", file.display())]
    Record {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl From<SimError> for Failure {
    fn from(error: SimError) -> Self {
        let (exit, remedy) = match error {
            SimError::Impossible { .. } => (Exit::Usage, "give a figure within that range"),
            SimError::Terminal { .. } => (Exit::Failed, "pseudo-terminals are needed: check that /dev/pts is mounted"),
            SimError::Record { .. } => (Exit::Failed, "check the path, the rights and the free space"),
        };
        Self::new(exit, error.to_string(), remedy)
    }
}

/// A simulated extruder.
#[derive(Clone, Debug)]
pub struct Extruder {
    flow_max: f64,
    time_constant: f64,
    target: f64,
    actual: f64,
    volume: f64,
    fault: DeviceFault,
    drive_failed: bool,
    /// Seconds since the last valid line; `None` before the first.
    since_valid: Option<f64>,
    last_seq: u32,
    valid_lines: u64,
    damaged_lines: u64,
    incoming: Lines,
    outgoing: Vec<u8>,
}

impl Extruder {
    /// An extruder at rest with this highest flow (m³/s) and this lag (s, time to 63 %; 0 follows at once).
    ///
    /// # Errors
    /// [`SimError::Impossible`].
    pub fn new(flow_max: f64, time_constant: f64) -> Result<Self, SimError> {
        // The comparisons are false for NaN.
        if !(flow_max > 0.0 && flow_max <= 4e-3) {
            let what = "highest flow (m³/s)";
            return Err(SimError::Impossible { what, expected: "more than 0 and at most 4e-3", found: flow_max });
        }
        if !(0.0..=10.0).contains(&time_constant) {
            return Err(SimError::Impossible { what: "lag (s)", expected: "0 to 10", found: time_constant });
        }
        Ok(Self {
            flow_max,
            time_constant,
            target: 0.0,
            actual: 0.0,
            volume: 0.0,
            fault: DeviceFault::None,
            drive_failed: false,
            since_valid: None,
            last_seq: 0,
            valid_lines: 0,
            damaged_lines: 0,
            incoming: Lines::new(),
            outgoing: Vec::new(),
        })
    }

    /// What came over the line. Damaged lines are counted and not answered.
    pub fn handle_bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            let Some(line) = self.incoming.push(byte) else { continue };
            match Command::decode(line) {
                None => self.damaged_lines += 1,
                Some(command) => self.handle_command(&command),
            }
        }
    }

    fn handle_command(&mut self, command: &Command) {
        self.valid_lines += 1;
        self.since_valid = Some(0.0);
        self.last_seq = command.seq;
        let flow = cubic_metres(command.flow_nl_s);
        if self.drive_failed {
            self.fault = DeviceFault::Drive;
        } else if command.flow_nl_s == 0 {
            self.fault = DeviceFault::None;
        } else if flow > self.flow_max * (1.0 + 1e-9) {
            self.fault = DeviceFault::FlowRefused;
        }
        self.target = if self.fault == DeviceFault::None { flow } else { 0.0 };
        self.answer();
    }

    /// Time passes (s); a step that is not more than 0 is none.
    pub fn step(&mut self, dt: f64) {
        let Some(since_valid) = self.since_valid.filter(|_| dt > 0.0) else { return };
        let before_watchdog = (WATCHDOG - since_valid).clamp(0.0, dt);
        self.flow(before_watchdog);
        self.since_valid = Some(since_valid + dt);
        if since_valid < WATCHDOG && since_valid + dt >= WATCHDOG {
            self.target = 0.0;
            if self.fault == DeviceFault::None {
                self.fault = DeviceFault::Watchdog;
            }
            self.answer();
        }
        self.flow(dt - before_watchdog);
    }

    /// The exact solution of τ·q̇ = target − q over `dt` with a constant target, and its integral.
    fn flow(&mut self, dt: f64) {
        let (decay, area) = if self.time_constant > 0.0 {
            let decay = (-dt / self.time_constant).exp();
            (decay, self.time_constant * (1.0 - decay))
        } else {
            (0.0, 0.0)
        };
        let excess = self.actual - self.target;
        self.volume += self.target * dt + excess * area;
        self.actual = self.target + excess * decay;
    }

    /// The drive breaks: it stands still and says so from now on.
    pub fn fail_drive(&mut self) {
        self.drive_failed = true;
        self.fault = DeviceFault::Drive;
        self.target = 0.0;
        if self.since_valid.is_some() {
            self.answer();
        }
    }

    fn answer(&mut self) {
        let flow_nl_s = nanolitres(self.actual);
        let line = Answer { seq: self.last_seq, flow_nl_s, fault: self.fault }.encode();
        if self.outgoing.len() + line.bytes().len() <= OUTGOING_MAX {
            self.outgoing.extend(line.bytes());
        }
    }

    /// Bytes for the line, at most `out.len()`; what does not fit comes with the next call.
    pub fn poll_transmit(&mut self, out: &mut [u8]) -> usize {
        let count = self.outgoing.len().min(out.len());
        for (slot, byte) in out.iter_mut().zip(self.outgoing.drain(..count)) {
            *slot = byte;
        }
        count
    }

    /// The flow it was told (m³/s); 0 in a fault.
    pub fn target(&self) -> f64 {
        self.target
    }

    /// The flow it extrudes (m³/s).
    pub fn actual(&self) -> f64 {
        self.actual
    }

    /// The volume extruded since start (m³).
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// What is wrong with it.
    pub fn fault(&self) -> DeviceFault {
        self.fault
    }

    /// Count of valid lines, and of damaged ones.
    pub fn lines(&self) -> (u64, u64) {
        (self.valid_lines, self.damaged_lines)
    }
}
