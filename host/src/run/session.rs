//! One print from the host's side, apart from where its bytes and its time come from: plans when the robot is ready, asks,
//! streams, shows progress, logs, and gives the account at the end. The timed print and virtual time both drive it.

use crate::config::Cell;
use crate::log::{CycleRecord as LogRecord, Flags, LogError, LogWriter};
use crate::model::fim::FimModel;
use crate::plan::moves::MoveKind;
use crate::plan::route::Route;
use crate::plan::stream::{Batches, Setpoint as Planned};
use crate::plan::{Options as PlanOptions, Plan, PlanError};
use crate::run::account::Account;
use crate::run::first_layer::FirstLayer;
use crate::run::job::{Job, JobError, Outcome, Phase, Stamps};
use crate::run::summary::Summary;
use screed_kernel::frame::{CycleRecord, FaultReport, ModeCode};
use screed_kernel::units::{JointPos, Nanos, Tick};
use std::sync::Arc;

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
    /// Lay the first layer at this rate of the path clock (0 to 1).
    pub first_layer_rate: Option<f64>,
}

/// What is left to do for whoever drives the session.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Go on.
    Running,
    /// The kernel stands in a fault: show it and ask; then [`Job::rearm`].
    Rearm(FaultReport),
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
    plan: Option<Arc<Plan>>,
    /// Time at which motion began (s, the driver's clock).
    began: Option<f64>,
    /// The path setpoint commanded last.
    at: Option<Planned>,
    /// Where the first layer is laid slower.
    first: Option<FirstLayer>,
    /// The path clock's rate in the last cycle.
    rate: f64,
}

impl<'a> Session<'a> {
    /// A session that attaches first.
    pub fn new(cell: &'a Cell, model: &'a FimModel, wishes: Wishes, log: Option<LogWriter>) -> Self {
        let job = Job::new(cell, Account::new(cell, &model.layers));
        let first = wishes.first_layer_rate.map(FirstLayer::new);
        Self { cell, model, wishes, job, log, log_error: None, plan: None, began: None, at: None, first, rate: 0.0 }
    }

    /// Bytes from the real-time process.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn handle_bytes(&mut self, bytes: &[u8]) -> Result<(), SessionError> {
        let Self { job, log, log_error, at, rate, .. } = self;
        job.handle_bytes(bytes, &mut |record, stamps, planned| {
            *at = planned.or(*at);
            *rate = record.rate;
            if let Some(log) = log
                && log_error.is_none()
            {
                *log_error = log.push(&logged(record, stamps, at.as_ref())).err();
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
                self.plan = Some(Arc::new(Plan::new(self.model, self.cell, &self.wishes.plan, &at)?));
                Ok(Step::Confirm)
            }
            Phase::Streaming => {
                let began = *self.began.get_or_insert(now);
                if let Some(rate) = self.first.as_mut().and_then(|first| first.step(now, self.at.as_ref(), self.rate)) {
                    self.job.set_rate(rate);
                }
                if self.wishes.stop_after.is_some_and(|limit| now - began >= limit) {
                    self.job.stop();
                }
                Ok(Step::Running)
            }
            Phase::Ended(outcome) => Ok(Step::Ended(outcome)),
            Phase::Faulted(report) => Ok(Step::Rearm(report)),
            _ => Ok(Step::Running),
        }
    }

    /// A person has seen the approach and says: move.
    pub fn confirm(&mut self) {
        if let Some(plan) = &self.plan {
            self.job.begin(Batches::new(Arc::clone(plan)));
        }
    }

    /// Comes to rest on the path.
    pub fn stop(&mut self) {
        self.job.stop();
    }

    /// Whether the first layer is being laid slower than planned.
    pub fn is_slow(&self) -> bool {
        self.first.as_ref().is_some_and(|first| !first.is_laid())
    }

    /// The layer that the tool was at last; none before the path has begun.
    pub fn layer(&self) -> Option<usize> {
        self.at.map(|at| at.layer)
    }

    /// The job.
    pub fn job(&mut self) -> &mut Job {
        &mut self.job
    }

    /// The plan, once there is one.
    pub fn plan(&self) -> Option<&Plan> {
        self.plan.as_deref()
    }

    /// Where the tool is on the path, and for how long it has been moving (s).
    pub fn progress(&self, now: f64) -> Option<Progress> {
        let plan = self.plan.as_ref()?;
        let at = self.at?;
        let total = plan.last_seq();
        // Until the first layer is laid, the path clock goes slower.
        let slow = self.first.as_ref().filter(|first| !first.is_laid());
        let later = slow.map_or(0.0, |first| {
            let until = first_layer_end(plan).saturating_sub(at.seq);
            f64::from(until) * (1.0 / first.rate() - 1.0)
        });
        let left = (f64::from(total.saturating_sub(at.seq)) + later) * self.period();
        Some(Progress {
            layer: at.layer,
            kind: at.kind,
            layers: layers(plan),
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
        (summary.outcome, summary.line) = (outcome, self.job.line());
        if let Some((realtime, note)) = self.job.process() {
            summary.scheduling = if realtime { "real time" } else { "NON-RT" };
            summary.scheduling_note = note.to_owned();
        }
        if let Some(plan) = &self.plan {
            let seconds = |periods: u32| f64::from(periods) * self.period();
            let deposits = || plan.moves().iter().filter(|step| step.kind == MoveKind::Deposit);
            summary.layers = layers(plan);
            summary.path_length_m = deposits().map(|step| route_length(&step.route)).sum();
            summary.layer_time_s = deposits().map(|step| seconds(step.periods)).sum();
            summary.between_time_s = plan.moves().iter().map(|step| seconds(step.periods)).sum::<f64>();
            summary.between_time_s -= summary.layer_time_s;
            summary.planned = plan.last_seq();
        }
        summary.figures = self.job.account().figures.clone();
        summary.figures.sensor_to_wire = self.job.account().sensor_to_wire();
        summary.hash = format!("{:016x}", self.job.account().hash());
        summary
    }
}

/// The last setpoint of a plan's first layer: with it that layer is laid.
fn first_layer_end(plan: &Plan) -> u32 {
    plan.moves().iter().find(|step| step.kind == MoveKind::Deposit).map_or(0, |step| step.last_seq)
}

/// Positions in the model of the first layer of a plan and of the one behind its last.
fn layers(plan: &Plan) -> (usize, usize) {
    let mut deposits = plan.moves().iter().filter(|step| step.kind == MoveKind::Deposit);
    let first = deposits.next().map_or(0, |step| step.layer);
    (first, deposits.next_back().map_or(first, |step| step.layer) + 1)
}

fn route_length(route: &Route) -> f64 {
    match route {
        Route::Curves(curves) => curves.length(),
        Route::Joints { .. } => 0.0,
    }
}

/// A cycle as the log has it. While the robot is not ready nothing is commanded; the actual joints then stand in both places.
fn logged(record: &CycleRecord, stamps: &Stamps, at: Option<&Planned>) -> LogRecord {
    let joints = |values: &[f64]| <[f64; 6]>::try_from(values).map(JointPos);
    let actual = joints(&record.actual).unwrap_or(JointPos::ZERO);
    let mut flags = 0;
    if record.deposit {
        flags |= Flags::DEPOSIT.0;
    }
    if record.missed > 0 {
        flags |= Flags::SKIPPED.0;
        // The robot had the setpoint before once more.
        if matches!(record.mode, ModeCode::Moving | ModeCode::Stopping) {
            flags |= Flags::DOUBLED.0;
        }
    }
    if !stamps.realtime {
        flags |= Flags::NON_RT.0;
    }
    LogRecord {
        tick: Tick(record.tick),
        readable: Nanos(stamps.pace.map_or(record.received_ns, |pace| pace.readable_ns)),
        received: Nanos(record.received_ns),
        ticked: Nanos(record.ticked_ns),
        sent: Nanos(record.sent_ns),
        robot_timestamp: record.robot_time,
        seq: record.seq,
        mode: record.mode as u8,
        flags: Flags(flags),
        layer: at.map_or(0, |at| u16::try_from(at.layer).unwrap_or(u16::MAX)),
        rate: record.rate,
        flow: record.flow,
        commanded: joints(&record.commanded).unwrap_or(actual),
        actual,
        missed: record.missed,
        overrun_level: stamps.pace.map_or(0, |pace| pace.level),
    }
}

/// How far a print is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The layer that the move under way belongs to.
    pub layer: usize,
    /// What the move is for.
    pub kind: MoveKind,
    /// Layers of this print: first and one past the last index in the model.
    pub layers: (usize, usize),
    /// Share of the path's setpoints commanded.
    pub share: f64,
    /// Time that the rest of the path takes (s): the rest of a first layer at its own rate, all else at 100 %.
    pub seconds_left: f64,
    /// Time since motion began (s).
    pub seconds: f64,
}

/// Joint angles for a person.
pub fn degrees(joints: &JointPos<6>) -> String {
    joints.0.map(|q| format!("{:7.1}", q.to_degrees())).join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use screed_fixtures::{QuarterCircle, quarter_circle};

    /// Against the sum over the path's setpoints, each at the rate that the first layer asks for there.
    #[test]
    fn the_time_left_counts_the_first_layer_at_its_own_rate() {
        let cell = Cell::demo(125).unwrap();
        let text = quarter_circle(&QuarterCircle { layers: 2, ..QuarterCircle::default() });
        let model = crate::model::fim::parse("wall.ifc", text.as_bytes()).unwrap();
        let plan = Plan::new(&model, &cell, &PlanOptions::default(), &cell.robot.start).unwrap();
        let mut setpoints: Vec<Planned> = Vec::new();
        for batch in plan.batches() {
            let batch = batch.unwrap();
            setpoints.extend(batch.setpoints.iter().take(batch.path_len));
        }
        let plan = Arc::new(plan);
        let total = plan.last_seq();
        let last = |kind| setpoints.iter().find(|at| at.kind == kind).unwrap().seq;
        for rate in [1.0, 0.5, 0.3] {
            for seq in [1, last(MoveKind::Lower), last(MoveKind::Deposit) + 40, last(MoveKind::Lift) + 1, total - 9] {
                let wishes = Wishes { first_layer_rate: Some(rate), ..Wishes::default() };
                let mut session = Session::new(&cell, &model, wishes, None);
                session.plan = Some(Arc::clone(&plan));
                let (mut first, mut expected) = (FirstLayer::new(rate), 0.0);
                for at in setpoints.iter().filter(|at| at.seq <= total) {
                    first.step(0.0, Some(at), rate);
                    if at.seq == seq {
                        (session.at, session.first) = (Some(*at), Some(first.clone()));
                    }
                    if at.seq > seq {
                        expected += if first.is_laid() { 0.008 } else { 0.008 / rate };
                    }
                }
                let left = session.progress(0.0).unwrap().seconds_left;
                assert!((left - expected).abs() < 0.03, "rate {rate}, setpoint {seq}: {left}, {expected}");
            }
        }
    }
}
