//! The host's side of a print as a state machine: attaches to the real-time process, configures it, keeps its ring filled,
//! starts it when told to, and sees it to the end. Frames in, frames out; no clock, no socket.

mod error;
mod frames;
mod heard;

pub use error::JobError;
pub use frames::frames;

use crate::config::Cell;
use crate::plan::Plan;
use crate::plan::stream::{Batches, Setpoint as Planned};
use crate::run::account::Account;
use crate::run::resend::{LineFigures, Resend};
use screed_kernel::frame::{
    self, Configure, CycleRecord, FaultReport, FrameError, FromKernel, ModeCode, Pace, Reader, Status, ToKernel,
    WIRE_MAX,
};
use screed_kernel::units::JointPos;
use std::sync::Arc;

/// How far ahead of the path clock the ring is kept filled (s).
pub const LOOK_AHEAD: f64 = 4.0;

/// Sees every cycle's record, how the pace had been kept by then, and the path setpoint that was newly commanded.
pub type OnCycle<'a> = &'a mut dyn FnMut(&CycleRecord, &Stamps, Option<Planned>);

/// What the log has of a cycle besides its record.
#[derive(Clone, Copy, Debug)]
pub struct Stamps {
    /// How the pace had been kept; nothing from a process of version 1.0.
    pub pace: Option<Pace>,
    /// Whether the process has what a hard-timed loop needs.
    pub realtime: bool,
}

/// How a print ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The whole path was played.
    Complete,
    /// It was asked to stop, and rests on the path.
    Stopped,
}

/// Where the job stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// Waits for the first status.
    Attaching,
    /// The kernel stands in a fault: waits for a person to leave it.
    Faulted(FaultReport),
    /// Waits for a ring left by an earlier host to be played out.
    PlayingOut,
    /// Limits are sent; waits for the robot to be ready.
    Configuring,
    /// The robot holds here: a plan can start.
    Ready(JointPos<6>),
    /// The ring is being filled and played.
    Streaming,
    /// Comes to rest.
    Stopping,
    /// Over.
    Ended(Outcome),
}

/// A batch as frames, sent when the ring has room for it.
struct Outgoing {
    batch: u32,
    len: u32,
    /// Last setpoint of its path, and of its stop tail.
    path_end: u32,
    end_seq: u32,
    frames: Vec<u8>,
}

/// One print.
pub struct Job {
    configure: Configure,
    look_ahead: u32,
    reader: Reader,
    phase: Phase,
    status: Option<Status>,
    /// The epoch before the limits were sent: what is heard of it is older than they are.
    epoch_before: u32,
    /// Number of the fault that was left, 0 for none.
    rearmed: u32,
    /// Whether the status is from after the last batch was taken: its credits count.
    credits_known: bool,
    /// What the process said of itself: real-time or not, and why not.
    process: Option<(bool, String)>,
    out: Vec<u8>,
    stream: Option<Batches<Arc<Plan>>>,
    next: Option<Outgoing>,
    /// The batch whose answer has not come.
    unanswered: Option<u32>,
    batches: u32,
    /// Last setpoint of the last batch sent, and of the one before.
    end_seq: u32,
    end_seq_before: u32,
    /// Last setpoint of that batch's path: from there on the next batch takes over, so that only this far the ring is filled.
    path_end: u32,
    started: bool,
    exhausted: bool,
    left_behind: Option<Status>,
    alarms: Vec<String>,
    /// The last of them all: why a link has failed is told before the fault for it.
    last_alarm: Option<String>,
    error: Option<JobError>,
    account: Account,
    /// Messages that are not known here.
    unknown: u64,
    /// Over a line that spoils bytes: what is said again.
    resend: Option<Resend>,
    /// Whether the path waits for its correction.
    waits: bool,
}

impl Job {
    /// A job that begins by asking the process for its status.
    pub fn new(cell: &Cell, account: Account) -> Self {
        let mut job = Self {
            configure: cell.configure(),
            look_ahead: (LOOK_AHEAD * f64::from(cell.link.rate_hz)) as u32,
            reader: Reader::new(),
            phase: Phase::Attaching,
            status: None,
            epoch_before: 0,
            rearmed: 0,
            credits_known: false,
            process: None,
            out: Vec::new(),
            stream: None,
            next: None,
            unanswered: None,
            batches: 0,
            end_seq: 0,
            end_seq_before: 0,
            path_end: 0,
            started: false,
            exhausted: false,
            left_behind: None,
            alarms: Vec::new(),
            last_alarm: None,
            error: None,
            account,
            unknown: 0,
            resend: None,
            waits: false,
        };
        job.say(&ToKernel::Hello);
        job
    }

    /// The frames go over a line of `baud` bits a second that may spoil bytes: spoilt ones are counted, and what is not answered
    /// is said again.
    pub fn over_a_line(&mut self, baud: u32) {
        self.resend = Some(Resend::new(baud));
        // Ends whatever an earlier host left half said.
        self.out.insert(0, 0);
    }

    /// What happened on the line, if it is one that may spoil bytes.
    pub fn line(&self) -> Option<LineFigures> {
        self.resend.as_ref().map(Resend::figures)
    }

    /// Where the job stands.
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// The newest status of the kernel.
    pub const fn status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// Whether the process has real-time scheduling, and what was refused.
    pub fn process(&self) -> Option<(bool, &str)> {
        self.process.as_ref().map(|(realtime, note)| (*realtime, note.as_str()))
    }

    /// What an earlier host left behind, if this one attached to a process that had been at work.
    pub const fn left_behind(&self) -> Option<&Status> {
        self.left_behind.as_ref()
    }

    /// The account so far.
    pub const fn account(&self) -> &Account {
        &self.account
    }

    /// Messages of the process that are not known here: it is of a later version.
    pub const fn unknown(&self) -> u64 {
        self.unknown
    }

    /// Alarms of links since the last call.
    pub fn take_alarms(&mut self) -> Vec<String> {
        std::mem::take(&mut self.alarms)
    }

    /// Leaves the fault it found: a person has said so.
    pub fn rearm(&mut self) {
        if let Phase::Faulted(report) = self.phase {
            self.ask(&ToKernel::Rearm { fault: report.number });
            self.rearmed = report.number;
            self.phase = Phase::Attaching;
        }
    }

    /// Begins to fill the ring from `stream` and plays it: a person has said so.
    pub fn begin(&mut self, stream: Batches<Arc<Plan>>) {
        if matches!(self.phase, Phase::Ready(_)) {
            self.stream = Some(stream);
            self.phase = Phase::Streaming;
        }
    }

    /// Asks for another rate of the path clock (0 to 1). Cycle records tell the one it has.
    pub fn set_rate(&mut self, rate: f64) {
        self.say(&ToKernel::Rate(rate));
    }

    /// Comes to rest on the path, within a second.
    pub fn stop(&mut self) {
        match self.phase {
            Phase::Streaming if self.started => {
                self.ask(&ToKernel::Stop);
                self.phase = Phase::Stopping;
            }
            Phase::Stopping | Phase::Ended(_) => {}
            _ => self.phase = Phase::Ended(Outcome::Stopped),
        }
    }

    /// Asks the process to end once the arm is at rest.
    pub fn quit(&mut self) {
        self.say(&ToKernel::Quit);
    }

    /// Takes bytes from the process; `on_cycle` sees every cycle's record.
    ///
    /// # Errors
    /// The first [`JobError`]; the kernel's ring then still plays to its end.
    pub fn handle_bytes(&mut self, bytes: &[u8], on_cycle: OnCycle<'_>) -> Result<(), JobError> {
        for &byte in bytes {
            let Some(frame) = self.reader.push(byte) else { continue };
            match frame.and_then(frame::decode::<FromKernel>) {
                // What came along is heard all the same: the cycle in which the arm came to rest belongs in the log.
                Ok(message) => match self.handle(message, on_cycle) {
                    Err(error @ (JobError::Fault(_) | JobError::Link(_))) => {
                        self.error = self.error.take().or(Some(error))
                    }
                    handled => handled?,
                },
                // A later minor version may say more than is known here.
                Err(FrameError::Message) => self.unknown += 1,
                Err(error @ FrameError::Version(_)) => return Err(JobError::Frame(error)),
                Err(error) => match &mut self.resend {
                    Some(resend) => resend.spoilt(),
                    None => return Err(JobError::Frame(error)),
                },
            }
        }
        self.error.take().map_or(Ok(()), Err)
    }

    /// Bytes for the process; the caller clears them.
    ///
    /// # Errors
    /// [`JobError::Plan`], [`JobError::Code`].
    pub fn poll_transmit(&mut self) -> Result<&mut Vec<u8>, JobError> {
        if self.phase == Phase::Streaming {
            self.fill()?;
        }
        Ok(&mut self.out)
    }

    fn configure(&mut self, mode: ModeCode, status: &Status) {
        let begins = self.out.len();
        if mode == ModeCode::Holding && status.end_seq > status.consumed {
            // A ring held by an earlier host: drop it before new limits are set.
            self.say(&ToKernel::Stop);
        }
        self.epoch_before = status.epoch;
        let configure = self.configure.clone();
        self.say(&ToKernel::Configure(configure));
        self.expect_answer(begins);
        self.phase = Phase::Configuring;
    }

    /// Keeps the ring filled to the look-ahead, or as far as it has room, one batch on the way at a time, and starts it then.
    fn fill(&mut self) -> Result<(), JobError> {
        let Some(status) = self.status else { return Ok(()) };
        if self.unanswered.is_some() || !self.credits_known {
            return Ok(());
        }
        if self.path_end.saturating_sub(status.consumed) < self.look_ahead && !self.exhausted {
            if self.next.is_none() {
                self.next = self.draw()?;
            }
            if let Some(next) = self.next.take_if(|next| next.len <= status.credits) {
                let begins = self.out.len();
                self.out.extend_from_slice(&next.frames);
                self.expect_answer(begins);
                self.unanswered = Some(next.batch);
                self.end_seq_before = self.end_seq;
                (self.path_end, self.end_seq) = (next.path_end, next.end_seq);
                return Ok(());
            }
        }
        if !self.started && self.end_seq > 0 {
            self.ask(&ToKernel::Resume { epoch: status.epoch });
            self.started = true;
        }
        Ok(())
    }

    /// The stream's next batch as frames.
    fn draw(&mut self) -> Result<Option<Outgoing>, JobError> {
        let Some(batch) = self.stream.as_mut().and_then(Iterator::next).transpose()? else {
            self.exhausted = true;
            return Ok(None);
        };
        self.batches += 1;
        let frames = frames(self.batches, &batch)?;
        let (path, _) = batch.setpoints.split_at_checked(batch.path_len).unwrap_or_default();
        self.account.expect(path);
        let last = |setpoints: &[Planned]| setpoints.last().map_or(self.end_seq, |last| last.seq);
        let (path_end, end_seq) = (last(path), last(&batch.setpoints));
        Ok(Some(Outgoing { batch: self.batches, len: batch.setpoints.len() as u32, path_end, end_seq, frames }))
    }

    /// Says what a status will show to have come.
    fn ask(&mut self, message: &ToKernel) {
        let begins = self.out.len();
        self.say(message);
        self.expect_answer(begins);
    }

    /// What is to be sent from position `begins` on will be answered.
    fn expect_answer(&mut self, begins: usize) {
        let tick = self.status.map_or(0, |status| status.tick);
        if let Some(resend) = &mut self.resend {
            resend.expect(self.out.get(begins..).unwrap_or(&[]), tick);
        }
    }

    fn say(&mut self, message: &ToKernel) {
        let mut bytes = [0; WIRE_MAX];
        match frame::encode(message, &mut bytes) {
            Ok(used) => self.out.extend_from_slice(bytes.get(..used).unwrap_or(&[])),
            Err(error) => self.error = Some(JobError::Frame(error)),
        }
    }
}

#[cfg(test)]
mod tests;
