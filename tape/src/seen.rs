//! What a run of the tape has met, so that a hash that says nothing is noticed.

use core::fmt;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{ModeCode, Refusal, Status, ToKernel};
use screed_kernel::mode::Mode;

/// Counts; each of them has to be above zero for a tape to be worth its name, but for the last two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Bytes taken by the kernel.
    pub bytes: u64,
    /// Ticks in each mode: unready, holding, moving, stopping, faulted.
    pub modes: [u64; 5],
    /// Messages said: hello, configure, batch part, rate, hold, resume, stop, re-arm, quit.
    pub said: [u64; 9],
    /// Faults reported: following, sensor, robot not ready, extruder, output.
    pub faults: [u64; 5],
    /// Batches accepted.
    pub accepted: u64,
    /// Messages refused: mode, configuration, full, too late, sequence, code, does not fit, not at rest, rate, stale.
    pub refused: [u64; 10],
    /// Statuses told.
    pub statuses: u64,
    /// Frames that the kernel dropped as broken.
    pub frames_broken: u64,
    /// Answers whose bytes did not arrive whole, which only a full outbox or a changed host explains.
    pub answers_broken: u64,
    /// What could not be put into a frame: has to stay zero.
    pub unsaid: u64,
}

impl Seen {
    /// Counts a message of the host.
    pub fn said(&mut self, message: &ToKernel) {
        let kind = match message {
            ToKernel::Hello => 0,
            ToKernel::Configure(_) => 1,
            ToKernel::Batch(_) => 2,
            ToKernel::Rate(_) => 3,
            ToKernel::Hold => 4,
            ToKernel::Resume { .. } => 5,
            ToKernel::Stop => 6,
            ToKernel::Rearm { .. } => 7,
            ToKernel::Quit => 8,
        };
        count(&mut self.said, kind);
    }

    /// Counts a refusal.
    pub fn refused(&mut self, reason: &Refusal) {
        let kind = match reason {
            Refusal::Mode => 0,
            Refusal::Configuration => 1,
            Refusal::Full => 2,
            Refusal::TooLate => 3,
            Refusal::Sequence => 4,
            Refusal::Code => 5,
            Refusal::DoesNotFit { .. } => 6,
            Refusal::NotAtRest => 7,
            Refusal::Rate => 8,
            Refusal::Stale => 9,
        };
        count(&mut self.refused, kind);
    }

    /// Counts a status and the fault in it.
    pub fn status(&mut self, status: &Status) {
        self.statuses += 1;
        self.frames_broken = u64::from(status.frames_broken);
        if let Some(report) = status.fault {
            let kind = match report.fault {
                Fault::Following { .. } => 0,
                Fault::Sensor { .. } => 1,
                Fault::RobotNotReady => 2,
                Fault::Extruder => 3,
                Fault::Output { .. } => 4,
            };
            count(&mut self.faults, kind);
        }
    }

    /// Counts a tick by its mode.
    pub fn mode(&mut self, mode: &Mode) {
        let kind = match mode.code() {
            ModeCode::Unready => 0,
            ModeCode::Holding => 1,
            ModeCode::Moving => 2,
            ModeCode::Stopping => 3,
            ModeCode::Faulted => 4,
        };
        count(&mut self.modes, kind);
    }

    /// Whether everything was met.
    pub fn is_complete(&self) -> bool {
        let lists = [&self.modes[..], &self.said, &self.faults, &self.refused];
        let singles = [self.bytes, self.accepted, self.statuses, self.frames_broken];
        lists.iter().all(|list| list.iter().all(|&n| n > 0)) && singles.iter().all(|&n| n > 0) && self.unsaid == 0
    }
}

fn count(counts: &mut [u64], kind: usize) {
    if let Some(count) = counts.get_mut(kind) {
        *count += 1;
    }
}

impl fmt::Display for Seen {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "bytes taken      {}", self.bytes)?;
        writeln!(f, "ticks by mode    {:?} (unready, holding, moving, stopping, faulted)", self.modes)?;
        writeln!(
            f,
            "messages said    {:?} (hello, configure, batch, rate, hold, resume, stop, re-arm, quit)",
            self.said
        )?;
        writeln!(f, "faults reported  {:?} (following, sensor, not ready, extruder, output)", self.faults)?;
        writeln!(
            f,
            "refusals heard   {:?} (mode, configuration, full, too late, sequence, code, does not fit, not at rest, rate, stale)",
            self.refused
        )?;
        writeln!(f, "batches accepted {}, statuses heard {}", self.accepted, self.statuses)?;
        write!(f, "frames broken    {}, answers broken {}", self.frames_broken, self.answers_broken)
    }
}
