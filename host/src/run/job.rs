//! The host's side of a print as a state machine: attaches to the real-time process, configures it, keeps its ring filled,
//! starts it when told to, and sees it to the end. Frames in, frames out; no clock, no socket.

mod error;
mod frames;

pub use error::JobError;
pub use frames::frames;

use crate::config::Cell;
use crate::plan::Plan;
use crate::plan::stream::{Batches, Setpoint as Planned};
use crate::run::account::Account;
use crate::run::resend::{LineFigures, Resend};
use crate::run::words;
use screed_kernel::frame::{
    self, BaseRecord, Configure, CycleRecord, FaultReport, FrameError, FromKernel, LoopRecord, ModeCode, Pace, Reader,
    Refusal, Status, ToKernel, WIRE_MAX,
};
use screed_kernel::units::JointPos;
use screed_kernel::wait::CAUGHT_UP;
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
                    Err(error @ JobError::Fault(_)) => self.error = self.error.take().or(Some(error)),
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
                self.resend.iter_mut().for_each(Resend::answered);
            }
            FromKernel::Accepted { .. } => {}
            FromKernel::Refused { batch, reason } => self.on_refused(batch, reason)?,
            FromKernel::Alarm { fatal: true, note } => return Err(JobError::Link(note.as_str().to_owned())),
            // Before the robot is ready there is nothing that could go on.
            FromKernel::Alarm { note, .. } if self.phase == Phase::Configuring => {
                return Err(JobError::Link(note.as_str().to_owned()));
            }
            FromKernel::Alarm { fatal: false, note } => self.alarms.push(note.as_str().to_owned()),
            FromKernel::Cycles(_) => {}
            FromKernel::Path { tick, joints } => self.account.on_path(tick, &joints),
            FromKernel::Loop(record) => self.on_loop(&record),
            // Told as soon as it is found; the job ends once the arm rests, by the status that repeats it.
            FromKernel::Fault(FaultReport { fault, .. }) => {
                self.alarms.push(format!("{}; {}", words::fault(&fault), fault.action()));
            }
        }
        Ok(())
    }

    /// A path that waits for its correction looks like one that is stuck: a person is told.
    fn on_loop(&mut self, record: &LoopRecord) {
        if record.waits && !self.waits {
            // It waits for a tracker before that is given up: what is not behind is not what it waits for.
            let behind =
                |base: &BaseRecord| base.behind.iter().zip(&record.held).any(|(base, tool)| base + tool > CAUGHT_UP);
            let lost = record.base.is_some_and(|base| base.age.is_none() || !behind(&base));
            let what =
                if lost { "the tracker: no pose has been believed for a while" } else { "a correction that is behind" };
            self.alarms.push(format!("the path waits for {what}; it goes on by itself"));
        }
        self.waits = record.waits;
        self.account.on_loop(record);
    }

    fn on_refused(&mut self, batch: u32, reason: Refusal) -> Result<(), JobError> {
        // Once it stops, batches on the way are refused: that is as it should be.
        if matches!(self.phase, Phase::Stopping | Phase::Ended(_)) {
            return Ok(());
        }
        // While the kernel stops for a fault it takes no more; the job ends by the status that says that the arm rests.
        if self.status.is_some_and(|status| status.fault.is_some()) {
            (self.exhausted, self.next) = (true, None);
            if self.unanswered.take_if(|unanswered| *unanswered == batch).is_some() {
                self.resend.iter_mut().for_each(Resend::answered);
            }
            return Ok(());
        }
        if let Some(resend) = &mut self.resend {
            match reason {
                // A part of it did not come.
                Refusal::Sequence if self.unanswered == Some(batch) => {
                    resend.part_missed();
                    return Ok(());
                }
                // An answer to what was said again and has been answered.
                _ if batch != 0 && self.unanswered != Some(batch) => return Ok(()),
                Refusal::Stale | Refusal::Mode if batch == 0 && resend.is_repeated() => return Ok(()),
                // It is there already, and has no room beside itself.
                Refusal::Full if resend.is_repeated() => return Ok(()),
                _ => {}
            }
        }
        if reason == Refusal::TooLate {
            let consumed = self.status.map_or(0, |status| status.consumed);
            return Err(JobError::Underrun { consumed });
        }
        let what = if batch == 0 { "a command".to_owned() } else { format!("batch {batch}") };
        Err(JobError::Refused { what, reason })
    }

    fn on_status(&mut self, status: Status) -> Result<(), JobError> {
        let before = self.status.replace(status);
        self.credits_known = true;
        self.say_again(before.as_ref(), &status)?;
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

    /// Over a line that spoils bytes: says again what should have been answered by now.
    fn say_again(&mut self, before: Option<&Status>, status: &Status) -> Result<(), JobError> {
        let answered = match self.phase {
            Phase::Attaching => status.mode != ModeCode::Faulted,
            Phase::Configuring => status.epoch != self.epoch_before,
            Phase::Streaming => self.unanswered.is_none() && status.mode != ModeCode::Holding,
            Phase::Stopping => status.mode != ModeCode::Moving,
            Phase::Faulted(_) | Phase::PlayingOut | Phase::Ready(_) | Phase::Ended(_) => true,
        };
        let Some(resend) = &mut self.resend else { return Ok(()) };
        if before.is_some_and(|before| status.tick < before.tick) {
            return Err(JobError::Reset);
        }
        // A status that tells of the batch's end is as good as the answer to it.
        let arrived =
            self.unanswered.is_some() && status.end_seq == self.end_seq && self.end_seq != self.end_seq_before;
        if arrived {
            self.unanswered = None;
        }
        if answered || arrived {
            resend.answered();
        }
        match resend.on_status(status.tick, status.frames_broken, self.configure.tick_period_ns) {
            Ok([]) => {}
            Ok(frames) => {
                // The zero ends whatever is left of a spoilt frame.
                self.out.push(0);
                self.out.extend_from_slice(frames);
            }
            Err(tries) => return Err(JobError::Unanswered { tries, figures: resend.figures() }),
        }
        Ok(())
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

    fn on_cycle(&mut self, record: &CycleRecord) -> Option<Planned> {
        let planned = self.account.observe(record);
        // A board does not hear that a host has come: what it is, it says once a second.
        let known = self.resend.is_none() || self.process.is_some();
        if self.phase == Phase::Configuring
            && known
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
