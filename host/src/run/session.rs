//! One print from the host's side, apart from where its bytes and its time come from: plans when the robot is ready, asks,
//! streams, shows progress, logs, and gives the account at the end. The timed print and virtual time both drive it.

use crate::config::Cell;
use crate::log::{LogError, LogWriter};
use crate::model::fim::FimModel;
use crate::plan::stream::Planned;
use crate::plan::{Plan, PlanError, PlanOptions};
use crate::run::account::Account;
use crate::run::job::{Job, JobError, Outcome, Phase};
use crate::run::summary::Summary;
use screed_kernel::units::JointPos;

/// Why a print failed.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// It cannot be planned.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// It cannot go on.
    #[error(transparent)]
    Job(#[from] JobError),
    /// The log cannot be written.
    #[error(transparent)]
    Log(#[from] LogError),
}

/// What a person asked for.
#[derive(Clone, Debug, Default)]
pub struct Wishes {
    /// Which layers, and whether without flow.
    pub plan: PlanOptions,
    /// Stop on the path after so many seconds of motion.
    pub stop_after: Option<f64>,
}

/// What is left to do for whoever drives the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Go on.
    Running,
    /// The plan is there: show the approach and ask; then [`Session::confirm`].
    Confirm,
    /// It is over.
    Ended(Outcome),
}

/// One print.
pub struct Session<'a> {
    cell: &'a Cell,
    model: &'a FimModel,
    wishes: Wishes,
    job: Job,
    log: Option<LogWriter>,
    log_error: Option<LogError>,
    plan: Option<Plan>,
    /// Time at which motion began (s, the driver's clock).
    began: Option<f64>,
    /// The path setpoint commanded last.
    at: Option<Planned>,
}

impl<'a> Session<'a> {
    /// A session that attaches first.
    pub fn new(cell: &'a Cell, model: &'a FimModel, wishes: Wishes, log: Option<LogWriter>) -> Self {
        let job = Job::new(cell, Account::new(cell, &model.layers));
        Self { cell, model, wishes, job, log, log_error: None, plan: None, began: None, at: None }
    }

    /// Bytes from the real-time process.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn handle_bytes(&mut self, bytes: &[u8]) -> Result<(), SessionError> {
        let Self { job, log, log_error, at, .. } = self;
        job.handle_bytes(bytes, &mut |record, planned| {
            *at = planned.or(*at);
            if let Some(log) = log
                && log_error.is_none()
            {
                *log_error = log.push(record, at.as_ref().and_then(|planned| planned.layer)).err();
            }
        })?;
        self.log_error.take().map_or(Ok(()), |error| Err(error.into()))
    }

    /// Bytes for the real-time process; the caller clears what it sent.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn poll_transmit(&mut self) -> Result<&mut Vec<u8>, SessionError> {
        Ok(self.job.poll_transmit()?)
    }

    /// Looks where the job stands at `now` (s, any origin).
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn step(&mut self, now: f64) -> Result<Step, SessionError> {
        match self.job.phase() {
            Phase::Ready(at) if self.plan.is_none() => {
                self.plan = Some(Plan::new(self.model, self.cell, &self.wishes.plan, &at)?);
                Ok(Step::Confirm)
            }
            Phase::Streaming => {
                let began = *self.began.get_or_insert(now);
                if self.wishes.stop_after.is_some_and(|limit| now - began >= limit) {
                    self.job.stop();
                }
                Ok(Step::Running)
            }
            Phase::Ended(outcome) => Ok(Step::Ended(outcome)),
            _ => Ok(Step::Running),
        }
    }

    /// A person has seen the approach and says: move.
    pub fn confirm(&mut self) {
        if let Some(plan) = &self.plan {
            self.job.begin(plan.stream());
        }
    }

    /// Comes to rest on the path.
    pub fn stop(&mut self) {
        self.job.stop();
    }

    /// The job.
    pub fn job(&mut self) -> &mut Job {
        &mut self.job
    }

    /// The plan, once there is one.
    pub const fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }

    /// Where the tool is on the path, and for how long it has been moving (s).
    pub fn progress(&self, now: f64) -> Option<Progress> {
        let plan = self.plan.as_ref()?;
        let at = self.at?;
        let total = plan.setpoints();
        let left = f64::from(total.saturating_sub(at.seq)) * self.period();
        Some(Progress {
            layer: at.layer,
            layers: plan.layers(),
            share: f64::from(at.seq) / f64::from(total.max(1)),
            seconds_left: left,
            seconds: self.began.map_or(0.0, |began| now - began),
        })
    }

    /// Ends the log.
    ///
    /// # Errors
    /// [`LogError`].
    pub fn finish(&mut self) -> Result<(), LogError> {
        self.log.take().map_or(Ok(()), LogWriter::finish)
    }

    fn period(&self) -> f64 {
        1.0 / f64::from(self.cell.link.rate_hz)
    }
}

impl Session<'_> {
    /// The table at the end.
    pub fn summary(&self, model: &str, outcome: &'static str) -> Summary {
        let mut summary = Summary::of(self.cell, model);
        summary.outcome = outcome;
        if let Some((realtime, note)) = self.job.process() {
            summary.scheduling = if realtime { "real time" } else { "NON-RT" };
            summary.scheduling_note = note.to_owned();
        }
        if let Some(plan) = &self.plan {
            summary.layers = plan.layers();
            summary.path_length_m = plan.deposit_length();
            summary.layer_time_s = plan.deposit_time();
            summary.between_time_s = plan.duration() - plan.deposit_time();
            summary.planned = plan.setpoints();
        }
        summary.figures = self.job.account().figures.clone();
        summary.hash = format!("{:016x}", self.job.account().hash());
        summary
    }
}

/// How far a print is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The layer being printed, or printed last; `None` before the first.
    pub layer: Option<usize>,
    /// Layers of this print: first and one past the last index in the model.
    pub layers: (usize, usize),
    /// Share of the path's setpoints commanded.
    pub share: f64,
    /// Time that the rest of the path takes at 100 % (s).
    pub seconds_left: f64,
    /// Time since motion began (s).
    pub seconds: f64,
}

/// Joint angles for a person.
pub fn degrees(joints: &JointPos<6>) -> String {
    joints.0.map(|q| format!("{:7.1}", q.to_degrees())).join(" ")
}
