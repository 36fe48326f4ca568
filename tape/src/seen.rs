//! What a run of the tape has met, so that a hash that says nothing is noticed.

use crate::motion::JOINTS;
use core::fmt;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{Refusal, Status, ToKernel};
use screed_kernel::tick::Command;
use screed_kernel::units::JointPos;

/// Counts; each of them has to be above zero for a tape to be worth its name, but for the last two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Bytes taken by the kernel.
    pub bytes: u64,
    /// Ticks in each mode: unready, holding, moving, stopping, faulted.
    pub modes: [u64; 5],
    /// Ticks with a correction in the targets.
    pub corrected: u64,
    /// Messages said: hello, configure, batch part, rate, hold, resume, stop, re-arm, quit.
    pub said: [u64; 9],
    /// Statuses with each fault, K1 to K15. Of K9, a path out of reach, there is none: this base stays near.
    pub faults: [u64; 15],
    /// Batches accepted.
    pub accepted: u64,
    /// Messages refused: mode, configuration, no room, full, too late, sequence, code, does not fit, not at rest, rate,
    /// stale.
    pub refused: [u64; 11],
    /// Configurations refused for: joints, periods, positions, motion, errors, correction, tool, workspace.
    pub unsound: [u64; 8],
    /// Setpoints refused for: finite (which no code can say, and is not counted), position, speed, acceleration, jerk, workspace.
    pub misfits: [u64; 6],
    /// Statuses told.
    pub statuses: u64,
    /// Faults told at the tick that found them.
    pub faults_told: u64,
    /// Frames that the kernel dropped as broken, and those whose message it does not know.
    pub frames: [u64; 2],
    /// Ticks that came late.
    pub late: u64,
    /// Of the base: poses taken, gated, acquiring, acquired, refused; ticks in excess, without trust.
    pub base: [u64; 7],
    /// Poses solved: UR type, spherical wrist, with a parallelogram, calibrated UR, calibrated wrist, by iteration, gantry.
    pub solved: [u64; 7],
    /// Frames from points: found, refused.
    pub registered: [u64; 2],
    /// With the loop closed, ticks with feedback, the base trusted, a replay, a pose gated, an excess, the tool held back, the path
    /// waiting.
    pub closed: [u64; 7],
    /// What the loop has said of itself.
    pub loops: u64,
    /// Answers whose bytes did not arrive whole, which only a changed host explains.
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
            Refusal::Configuration(unsound) => {
                count(&mut self.unsound, *unsound as usize);
                1
            }
            Refusal::NoRoom { .. } => 2,
            Refusal::Full => 3,
            Refusal::TooLate => 4,
            Refusal::Sequence => 5,
            Refusal::Code => 6,
            Refusal::DoesNotFit { quantity, .. } => {
                count(&mut self.misfits, *quantity as usize);
                7
            }
            Refusal::NotAtRest => 8,
            Refusal::Rate => 9,
            Refusal::Stale => 10,
        };
        count(&mut self.refused, kind);
    }

    /// Counts a status and the fault in it.
    pub fn status(&mut self, status: &Status) {
        self.statuses += 1;
        self.frames = [status.frames_broken, status.frames_unknown].map(u64::from);
        self.late = u64::from(status.ticks_late);
        if let Some(report) = status.fault {
            let kind = match report.fault {
                Fault::Following { .. } => 0,
                Fault::Sensor { .. } => 1,
                Fault::RobotNotReady => 2,
                Fault::Output { .. } => 3,
                Fault::Extruder => 4,
                Fault::Deviation { .. } => 5,
                Fault::Correction { .. } => 6,
                Fault::Saturated { .. } => 7,
                Fault::Unreachable { .. } => 8,
                Fault::Base { .. } => 9,
                Fault::Drive { .. } => 10,
                Fault::Lead { .. } => 11,
                Fault::Tracker { .. } => 12,
                Fault::Overrun { .. } => 13,
                Fault::Link => 14,
            };
            count(&mut self.faults, kind);
        }
    }

    /// Counts a tick by its mode.
    pub fn command(&mut self, command: &Command<JOINTS>) {
        count(&mut self.modes, command.mode.code() as usize);
        self.corrected += u64::from(command.correction != JointPos::ZERO);
    }

    /// Counts a pose by the kind of arm that solved it.
    pub fn solved(&mut self, arm: usize) {
        count(&mut self.solved, arm);
    }

    /// Counts a frame, found or refused.
    pub fn registered(&mut self, found: bool) {
        count(&mut self.registered, usize::from(!found));
    }

    /// Whether everything was met.
    pub fn is_complete(&self) -> bool {
        let [_, misfits @ ..] = &self.misfits;
        let [k1, k2, k3, k4, k5, k6, k7, k8, _, loops @ ..] = self.faults;
        let faults = [k1, k2, k3, k4, k5, k6, k7, k8];
        let lists = [
            &self.modes[..],
            &self.said,
            &faults,
            &loops,
            &self.refused,
            &self.unsound,
            misfits,
            &self.frames,
            &self.base,
            &self.solved,
            &self.registered,
            &self.closed,
        ];
        let singles =
            [self.bytes, self.corrected, self.accepted, self.statuses, self.faults_told, self.late, self.loops];
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
        let [broken, unknown] = self.frames;
        writeln!(f, "bytes taken        {}, frames broken {broken}, unknown {unknown}", self.bytes)?;
        writeln!(f, "ticks by mode      {:?} (unready, holding, moving, stopping, faulted)", self.modes)?;
        writeln!(f, "ticks corrected    {}, late {}", self.corrected, self.late)?;
        writeln!(f, "messages           {:?} (hello configure batch rate hold resume stop re-arm quit)", self.said)?;
        writeln!(f, "statuses by fault  {:?} (K1 to K15)", self.faults)?;
        writeln!(f, "refusals           {:?} (mode configuration no-room full too-late", self.refused)?;
        writeln!(f, "                   sequence code does-not-fit not-at-rest rate stale)")?;
        writeln!(f, "  configuration    {:?} (joints periods positions motion errors", self.unsound)?;
        writeln!(f, "                   correction tool workspace)")?;
        writeln!(f, "  does not fit     {:?} (- position speed acceleration jerk workspace)", self.misfits)?;
        writeln!(f, "base               {:?} (taken gated acquiring acquired refused, excess untrusted)", self.base)?;
        writeln!(
            f,
            "poses solved       {:?} (UR wrist parallelogram, calibrated UR wrist, iterated gantry)",
            self.solved
        )?;
        writeln!(f, "frames registered  {:?} (found refused)", self.registered)?;
        writeln!(
            f,
            "loop closed        {:?} (feedback trusted replay gated excess held waits), said {}",
            self.closed, self.loops
        )?;
        let Self { accepted, statuses, faults_told, .. } = self;
        writeln!(f, "batches accepted   {accepted}, statuses {statuses}, faults told {faults_told}")?;
        write!(f, "answers broken     {}, unsaid {}", self.answers_broken, self.unsaid)
    }
}
