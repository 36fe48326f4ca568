//! The extruder's serial line, seen from Screed: a state machine without clock or port. `docs/extruder.md` is the protocol.
//!
//! It lives in the real-time process: nothing here allocates, and all memory is inside [`ExtruderLine`]. Per cycle the
//! caller hands in what the port received, asks for the time-out, and sends what [`ExtruderLine::poll_transmit`] gives.

#[cfg(test)]
mod tests;
pub mod wire;

use screed_kernel::units::Nanos;
use wire::{Answer, Command, DeviceFault, Line, Lines};

/// A changed flow is sent at most this often: 50 Hz.
const SPACING_NS: u64 = 20_000_000;
/// An unchanged flow is sent again after this, well within [`WATCHDOG_NS`].
const KEEP_ALIVE_NS: u64 = 100_000_000;
/// The extruder stops by itself when it gets no valid line for this long.
pub const WATCHDOG_NS: u64 = 500_000_000;
/// A line without an answer is followed by another after this, so that a few damaged ones are no silence.
const RETRY_NS: u64 = 50_000_000;
/// Flow above the maximum that an answer may report (a drive overshoots a little).
const OVERSHOOT: f64 = 1.05;

/// Why the extruder cannot be used, or no longer.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ExtruderError {
    /// A maximum that the wire cannot carry.
    #[error("the extruder's highest flow is {found:e} m³/s: expected more than 0 and at most 4e-3")]
    FlowMax {
        /// As given (m³/s).
        found: f64,
    },
    /// A flow that the extruder must not be asked for.
    #[error("a flow of {found:e} m³/s was asked for: expected 0 to {flow_max:e}")]
    FlowRefused {
        /// As asked for (m³/s).
        found: f64,
        /// The highest (m³/s).
        flow_max: f64,
    },
    /// No answer to what was sent.
    #[error("the extruder has not answered for {} ms", waited_ns / 1_000_000)]
    Silent {
        /// Since the oldest line without an answer (ns).
        waited_ns: u64,
    },
    /// The extruder says that it has stopped.
    #[error("the extruder reports a fault: {fault}")]
    Faulted {
        /// What it says.
        fault: DeviceFault,
    },
    /// The extruder says that it extrudes more than it can.
    #[error("the extruder reports a flow of {found:e} m³/s: expected at most {flow_max:e}")]
    FlowImpossible {
        /// As reported (m³/s).
        found: f64,
        /// The highest (m³/s).
        flow_max: f64,
    },
}

impl ExtruderError {
    /// What to do about it.
    pub const fn remedy(&self) -> &'static str {
        match self {
            Self::FlowMax { .. } | Self::FlowImpossible { .. } => {
                "set flow_max_mm3_s in [extruder] of the cell file to the pump's figure"
            }
            Self::FlowRefused { .. } => "lower the layer's speed, or raise flow_max_mm3_s if the pump allows it",
            Self::Silent { .. } => "check the device in [extruder] of the cell file, its cable and its power",
            Self::Faulted { fault } => fault.remedy(),
        }
    }
}

/// What is known of the extruder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExtruderStatus {
    /// Whether it has answered and has no fault; until then it is only ever told to stand still.
    pub ready: bool,
    /// The flow last sent (m³/s).
    pub commanded: f64,
    /// The flow it last reported (m³/s).
    pub actual: f64,
    /// Number of the last line sent; 0 before the first.
    pub sent: u32,
    /// Number of the last line it answered; 0 before the first.
    pub acknowledged: u32,
    /// Lines that were damaged on the way here.
    pub damaged_lines: u32,
    /// Sound lines that answer nothing we sent (left over from an earlier run).
    pub foreign_lines: u32,
}

/// Screed's end of the line.
#[derive(Clone, Debug)]
pub struct ExtruderLine {
    flow_max: f64,
    timeout_ns: u64,
    wanted_nl_s: u32,
    status: ExtruderStatus,
    incoming: Lines,
    outgoing: Line,
    /// How much of `outgoing` has been handed out.
    handed_out: usize,
    sent_at: Option<Nanos>,
    sent_nl_s: u32,
    /// When the oldest line without an answer was sent.
    waiting_since: Option<Nanos>,
}

impl ExtruderLine {
    /// A line to an extruder with this highest flow (m³/s); an answer that takes longer than `timeout_ns` is an error.
    ///
    /// # Errors
    /// [`ExtruderError::FlowMax`].
    pub fn new(flow_max: f64, timeout_ns: u64) -> Result<Self, ExtruderError> {
        // The comparison is false for NaN.
        if !(flow_max > 0.0 && flow_max <= 4e-3) {
            return Err(ExtruderError::FlowMax { found: flow_max });
        }
        Ok(Self {
            flow_max,
            timeout_ns,
            wanted_nl_s: 0,
            status: ExtruderStatus::default(),
            incoming: Lines::new(),
            outgoing: Line::empty(),
            handed_out: 0,
            sent_at: None,
            sent_nl_s: 0,
            waiting_since: None,
        })
    }

    /// The flow from now on (m³/s), sent as whole nanolitres a second.
    ///
    /// # Errors
    /// [`ExtruderError::FlowRefused`]; the extruder is then told to stop.
    pub fn set_flow(&mut self, flow: f64) -> Result<(), ExtruderError> {
        self.wanted_nl_s = 0;
        // The comparison is false for NaN.
        if !(0.0..=self.flow_max).contains(&flow) {
            return Err(ExtruderError::FlowRefused { found: flow, flow_max: self.flow_max });
        }
        self.wanted_nl_s = wire::nanolitres(flow);
        Ok(())
    }

    /// What the port received. Damaged lines are counted and dropped; if none comes through, the time-out says so.
    ///
    /// # Errors
    /// [`ExtruderError::Faulted`] or [`ExtruderError::FlowImpossible`]; the flow is then 0 until set again. All bytes
    /// have been taken in either case.
    pub fn handle_bytes(&mut self, now: Nanos, bytes: &[u8]) -> Result<(), ExtruderError> {
        let mut first_error = Ok(());
        for &byte in bytes {
            let Some(line) = self.incoming.push(byte) else { continue };
            match Answer::decode(line) {
                None => self.status.damaged_lines = self.status.damaged_lines.saturating_add(1),
                Some(answer) => first_error = first_error.and(self.handle_answer(now, &answer)),
            }
        }
        first_error
    }

    fn handle_answer(&mut self, now: Nanos, answer: &Answer) -> Result<(), ExtruderError> {
        let ExtruderStatus { sent, acknowledged, .. } = self.status;
        if answer.seq == 0 || sent.wrapping_sub(answer.seq) > sent.wrapping_sub(acknowledged) {
            self.status.foreign_lines = self.status.foreign_lines.saturating_add(1);
            return Ok(());
        }
        self.status.acknowledged = answer.seq;
        self.status.actual = wire::cubic_metres(answer.flow_nl_s);
        self.waiting_since = if answer.seq == sent { None } else { Some(now) };
        let error = if answer.fault != DeviceFault::None {
            ExtruderError::Faulted { fault: answer.fault }
        } else if self.status.actual > self.flow_max * OVERSHOOT {
            ExtruderError::FlowImpossible { found: self.status.actual, flow_max: self.flow_max }
        } else {
            self.status.ready = true;
            return Ok(());
        };
        self.status.ready = false;
        self.wanted_nl_s = 0;
        Err(error)
    }

    /// Bytes for the port, at most `out.len()`; what does not fit comes with the next call.
    pub fn poll_transmit(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        if self.outgoing.bytes().len() <= self.handed_out && self.due().is_none_or(|due| due <= now) {
            self.compose(now);
        }
        let left = self.outgoing.bytes().get(self.handed_out..).unwrap_or_default();
        let count = left.len().min(out.len());
        if let (Some(target), Some(source)) = (out.get_mut(..count), left.get(..count)) {
            target.copy_from_slice(source);
        }
        self.handed_out += count;
        count
    }

    /// When to call [`ExtruderLine::handle_timeout`] and [`ExtruderLine::poll_transmit`] again at the latest; `None` is now.
    pub fn poll_timeout(&self) -> Option<Nanos> {
        let silent = self.waiting_since.map(|since| since.plus(self.timeout_ns));
        let due = self.due()?;
        Some(silent.map_or(due, |silent| silent.min(due)))
    }

    /// Checks for silence. Hand in what the port has received first: a machine that stood still must not blame the extruder.
    ///
    /// # Errors
    /// [`ExtruderError::Silent`].
    pub fn handle_timeout(&mut self, now: Nanos) -> Result<(), ExtruderError> {
        match self.waiting_since {
            Some(since) if now.since(since) >= self.timeout_ns => {
                self.status.ready = false;
                Err(ExtruderError::Silent { waited_ns: now.since(since) })
            }
            _ => Ok(()),
        }
    }

    /// What is known of the extruder.
    pub fn status(&self) -> &ExtruderStatus {
        &self.status
    }

    /// When the next line is to be sent; `None` before the first.
    fn due(&self) -> Option<Nanos> {
        let wait = match self.waiting_since {
            _ if self.flow_to_send() != self.sent_nl_s => SPACING_NS,
            Some(_) => RETRY_NS,
            None => KEEP_ALIVE_NS,
        };
        self.sent_at.map(|at| at.plus(wait))
    }

    /// Until the extruder has answered without a fault it is only told to stand still, which also clears its fault.
    fn flow_to_send(&self) -> u32 {
        if self.status.ready { self.wanted_nl_s } else { 0 }
    }

    fn compose(&mut self, now: Nanos) {
        self.sent_nl_s = self.flow_to_send();
        // 0 is kept for "none yet".
        self.status.sent = self.status.sent.wrapping_add(1).max(1);
        self.status.commanded = wire::cubic_metres(self.sent_nl_s);
        self.outgoing = Command { seq: self.status.sent, flow_nl_s: self.sent_nl_s }.encode();
        self.handed_out = 0;
        self.sent_at = Some(now);
        self.waiting_since = self.waiting_since.or(Some(now));
    }
}
