//! The host's side of a print as a state machine: attaches to the real-time process, configures it, keeps its ring filled,
//! starts it when told to, and sees it to the end. Frames in, frames out; no clock, no socket.

use crate::config::Cell;
use crate::plan::stream::{Batch, Batches, Setpoint as Planned};
use crate::plan::{Plan, PlanError};
use crate::run::account::Account;
use crate::run::words;
use screed_kernel::frame::{
    self, BatchPart, CODE_MAX, Configure, CycleRecord, FaultReport, FrameError, FromKernel, ModeCode, Pace, Reader,
    Refusal, Status, ToKernel, WIRE_MAX,
};
use screed_kernel::setpoint::{CodeError, Coder, Setpoint};
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

/// Why a print cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// The plan broke off.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The kernel refused a message.
    #[error("the kernel refused {what}: {}", words::refusal(reason))]
    Refused {
        /// What was sent.
        what: String,
        /// Why it was not taken.
        reason: Refusal,
    },
    /// A frame from the real-time process was broken.
    #[error("the real-time process sent a broken frame ({0:?}); is it from the same build of Screed?")]
    Frame(FrameError),
    /// A setpoint cannot be put into a frame.
    #[error("setpoint {seq} cannot be put into a frame ({error:?})")]
    Code {
        /// Sequence number.
        seq: u32,
        /// Why.
        error: CodeError,
    },
    /// The kernel stopped on its own.
    #[error("{}", words::fault(&.0.fault))]
    Fault(FaultReport),
    /// The link to the robot failed.
    #[error("{0}")]
    Link(String),
    /// The host did not keep up: the ring was played to its end, where the arm rests on its path.
    #[error("the ring ran dry at setpoint {consumed}: the planner or this machine was too slow")]
    Underrun {
        /// Setpoint at which the arm rests.
        consumed: u32,
    },
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
    /// Last setpoint of the last batch sent.
    end_seq: u32,
    /// Last setpoint of that batch's path: from there on the next batch takes over, so that only this far the ring is filled.
    path_end: u32,
    started: bool,
    exhausted: bool,
    left_behind: Option<Status>,
    alarms: Vec<String>,
    error: Option<JobError>,
    account: Account,
    /// Messages that are not known here.
    unknown: u64,
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
            path_end: 0,
            started: false,
            exhausted: false,
            left_behind: None,
            alarms: Vec::new(),
            error: None,
            account,
            unknown: 0,
        };
        job.say(&ToKernel::Hello);
        job
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
            self.say(&ToKernel::Rearm { fault: report.number });
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

    /// Comes to rest on the path, within a second.
    pub fn stop(&mut self) {
        match self.phase {
            Phase::Streaming if self.started => {
                self.say(&ToKernel::Stop);
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
                Ok(message) => self.handle(message, on_cycle)?,
                // A later minor version may say more than is known here.
                Err(FrameError::Message) => self.unknown += 1,
                Err(error) => return Err(JobError::Frame(error)),
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

    fn handle(&mut self, message: FromKernel, on_cycle: OnCycle<'_>) -> Result<(), JobError> {
        match message {
            FromKernel::Process { realtime, note } => self.process = Some((realtime, note.as_str().to_owned())),
            FromKernel::Status(status) => self.on_status(status)?,
            FromKernel::Cycle(record) => {
                let planned = self.on_cycle(&record);
                let pace = self.account.pace().filter(|pace| pace.tick == record.tick);
                let realtime = self.process.as_ref().is_some_and(|(realtime, _)| *realtime);
                on_cycle(&record, &Stamps { pace, realtime }, planned);
            }
            FromKernel::Pace(pace) => self.account.observe_pace(&pace),
            FromKernel::Accepted { batch } if self.unanswered == Some(batch) => {
                self.unanswered = None;
                self.credits_known = false;
            }
            FromKernel::Accepted { .. } => {}
            FromKernel::Refused { batch, reason } => self.on_refused(batch, reason)?,
            FromKernel::Alarm { fatal: true, note } => return Err(JobError::Link(note.as_str().to_owned())),
            // Before the robot is ready there is nothing that could go on.
            FromKernel::Alarm { note, .. } if self.phase == Phase::Configuring => {
                return Err(JobError::Link(note.as_str().to_owned()));
            }
            FromKernel::Alarm { fatal: false, note } => self.alarms.push(note.as_str().to_owned()),
            // Told as soon as it is found; the job ends once the arm rests, by the status that repeats it.
            FromKernel::Fault(FaultReport { fault, .. }) => {
                self.alarms.push(format!("{}; {}", words::fault(&fault), fault.action()));
            }
        }
        Ok(())
    }

    fn on_refused(&mut self, batch: u32, reason: Refusal) -> Result<(), JobError> {
        // Once it stops, batches on the way are refused: that is as it should be.
        if matches!(self.phase, Phase::Stopping | Phase::Ended(_)) {
            return Ok(());
        }
        if let Some(fault) = self.status.and_then(|status| status.fault) {
            return Err(JobError::Fault(fault));
        }
        if reason == Refusal::TooLate {
            let consumed = self.status.map_or(0, |status| status.consumed);
            return Err(JobError::Underrun { consumed });
        }
        let what = if batch == 0 { "a command".to_owned() } else { format!("batch {batch}") };
        Err(JobError::Refused { what, reason })
    }

    fn on_status(&mut self, status: Status) -> Result<(), JobError> {
        self.status = Some(status);
        self.credits_known = true;
        match (self.phase, status.mode) {
            (Phase::Attaching | Phase::PlayingOut, ModeCode::Faulted) => {
                // A status from before the command to leave the fault may still be on its way.
                if let Some(fault) = status.fault.filter(|fault| fault.number != self.rearmed) {
                    self.phase = Phase::Faulted(fault);
                }
            }
            (Phase::Faulted(_), _) => {}
            (Phase::Attaching, mode) => {
                if status.consumed > 0 && status.fault.is_none() {
                    self.left_behind = Some(status);
                }
                if matches!(mode, ModeCode::Moving | ModeCode::Stopping) {
                    self.phase = Phase::PlayingOut;
                } else {
                    self.configure(mode, &status);
                }
            }
            (Phase::PlayingOut, mode @ (ModeCode::Holding | ModeCode::Unready)) => self.configure(mode, &status),
            (Phase::Stopping, ModeCode::Holding | ModeCode::Unready) => self.phase = Phase::Ended(Outcome::Stopped),
            (Phase::Streaming, ModeCode::Holding) if self.started && status.consumed > 0 => {
                if !self.exhausted || self.unanswered.is_some() || self.next.is_some() {
                    return Err(JobError::Underrun { consumed: status.consumed });
                }
                if status.consumed == self.end_seq {
                    self.phase = Phase::Ended(Outcome::Complete);
                }
            }
            (_, ModeCode::Faulted) => {
                if let Some(fault) = status.fault {
                    return Err(JobError::Fault(fault));
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn configure(&mut self, mode: ModeCode, status: &Status) {
        if mode == ModeCode::Holding && status.end_seq > status.consumed {
            // A ring held by an earlier host: drop it before new limits are set.
            self.say(&ToKernel::Stop);
        }
        self.epoch_before = status.epoch;
        let configure = self.configure.clone();
        self.say(&ToKernel::Configure(configure));
        self.phase = Phase::Configuring;
    }

    fn on_cycle(&mut self, record: &CycleRecord) -> Option<Planned> {
        let planned = self.account.observe(record);
        if self.phase == Phase::Configuring
            && self.status.is_some_and(|status| status.epoch != self.epoch_before)
            && record.mode == ModeCode::Holding
            && record.seq == 0
            && let Ok(at) = <[f64; 6]>::try_from(record.commanded.as_slice())
        {
            self.phase = Phase::Ready(JointPos(at));
        }
        planned
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
                self.out.extend_from_slice(&next.frames);
                self.unanswered = Some(next.batch);
                (self.path_end, self.end_seq) = (next.path_end, next.end_seq);
                return Ok(());
            }
        }
        if !self.started && self.end_seq > 0 {
            self.say(&ToKernel::Resume { epoch: status.epoch });
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

    fn say(&mut self, message: &ToKernel) {
        let mut bytes = [0; WIRE_MAX];
        match frame::encode(message, &mut bytes) {
            Ok(used) => self.out.extend_from_slice(bytes.get(..used).unwrap_or(&[])),
            Err(error) => self.error = Some(JobError::Frame(error)),
        }
    }
}

/// A batch as the frames of its parts.
///
/// # Errors
/// [`JobError::Code`] when a setpoint is not finite or beyond the grid.
pub fn frames(number: u32, batch: &Batch) -> Result<Vec<u8>, JobError> {
    let mut frames = Vec::new();
    let mut coder = Coder::new();
    let mut code = [0; CODE_MAX];
    let mut rest = batch.setpoints.as_slice();
    let mut opens = true;
    while let Some(first) = rest.first() {
        let mut used = 0;
        let mut taken = 0;
        for planned in rest {
            let setpoint = Setpoint { joints: planned.joints, flow: planned.flow, deposit: planned.deposit };
            match coder.encode(&setpoint, code.get_mut(used..).unwrap_or(&mut [])) {
                Ok(length) => (used, taken) = (used + length, taken + 1),
                Err(CodeError::Short) if taken > 0 => break,
                Err(error) => return Err(JobError::Code { seq: planned.seq, error }),
            }
        }
        rest = rest.get(taken..).unwrap_or(&[]);
        let part = BatchPart {
            batch: number,
            first_seq: first.seq,
            opens,
            commits: rest.is_empty(),
            after: batch.after.filter(|_| opens),
            code: code.get(..used).unwrap_or(&[]),
        };
        let mut bytes = [0; WIRE_MAX];
        let length = frame::encode(&ToKernel::Batch(part), &mut bytes).map_err(JobError::Frame)?;
        frames.extend_from_slice(bytes.get(..length).unwrap_or(&[]));
        opens = false;
    }
    Ok(frames)
}
