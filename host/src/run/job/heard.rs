//! What the kernel and its process say, and where the job stands after it.

use super::{Job, JobError, OnCycle, Outcome, Phase, Stamps};
use crate::plan::stream::Setpoint as Planned;
use crate::run::resend::Resend;
use crate::run::words;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{BaseRecord, CycleRecord, FaultReport, FromKernel, LoopRecord, ModeCode, Refusal, Status};
use screed_kernel::units::JointPos;
use screed_kernel::wait::CAUGHT_UP;

impl Job {
    pub(super) fn handle(&mut self, message: FromKernel, on_cycle: OnCycle<'_>) -> Result<(), JobError> {
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
            FromKernel::Alarm { fatal: false, note } => {
                self.last_alarm = Some(note.as_str().to_owned());
                self.alarms.push(note.as_str().to_owned());
            }
            FromKernel::Cycles(cycles) => self.account.observe_cycles(&cycles),
            FromKernel::Path { tick, joints } => self.account.on_path(tick, &joints),
            FromKernel::Loop(record) => self.on_loop(&record),
            // Told as soon as it is found; the job ends once the arm rests, by the status that repeats it.
            FromKernel::Fault(FaultReport { fault, .. }) => {
                self.alarms.push(told(&fault));
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
                if let Some(report) = status.fault {
                    return Err(self.stopped_by(report));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// A fault has ended the job. Of a failed link the process has said why just before.
    fn stopped_by(&mut self, report: FaultReport) -> JobError {
        match report.fault {
            Fault::Link => JobError::Link(self.last_alarm.take().unwrap_or_else(|| told(&report.fault))),
            _ => JobError::Fault(report),
        }
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
}

fn told(fault: &Fault) -> String {
    format!("{}; {}", words::fault(fault), fault.action())
}
