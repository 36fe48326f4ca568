//! The setpoints of a plan, in batches that each end at rest.
//!
//! A batch is a piece of the path followed by a stop tail that brings the tool to rest on the path; the next batch takes
//! the tail's place. Batches are made one at a time, on demand, and follow from the plan alone.

use super::Plan;
use super::error::PlanError;
use super::moves::{Move, MoveKind};
use super::profile::{Brake, State};
use super::route::Route;
use super::tooling::on_grid;
use crate::run::core::RING;
use screed_kernel::setpoint::flow_on_grid;
use screed_kernel::units::JointPos;
use std::ops::Deref;

/// A batch's path takes at least this long (s), unless the job ends before.
const BATCH_TIME_MIN: f64 = 1.0;
/// Where no cruise and no rest has come for this long (s), a batch may also end while the speed changes.
const BATCH_TIME_PATIENT: f64 = 2.0;
/// While a batch is on its way to the real-time process, this much of the path before it may be left in the ring (s).
const HANDOVER: f64 = 1.0;
/// Equal setpoints that end a tail, so that differences of its last setpoints are zero.
const PADDING: usize = 2;

/// One sample of the commanded motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Counts from 1 without gaps.
    pub seq: u32,
    /// Joint target (rad), on the grid of [`screed_kernel::setpoint::JOINT_QUANTUM`].
    pub joints: JointPos<6>,
    /// Volume flow of the extruder (m³/s), on the grid of [`screed_kernel::setpoint::FLOW_QUANTUM`]; 0 where nothing is deposited.
    pub flow: f64,
    /// Whether this is part of a layer's path.
    pub deposit: bool,
    /// What the move is for.
    pub kind: MoveKind,
    /// The layer, as a position in the model's layers.
    pub layer: usize,
}

/// Setpoints that end at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// The setpoint that this batch continues; what was sent behind it is replaced. None for the first batch.
    pub after: Option<u32>,
    /// Path setpoints, then the stop tail.
    pub setpoints: Vec<Setpoint>,
    /// How many of them are path.
    pub path_len: usize,
}

const AT_START: State = State { s: 0.0, velocity: 0.0, acceleration: 0.0 };

/// How a batch comes to rest.
enum Tail {
    /// It is at rest already.
    Rest,
    /// By braking from where the path is left.
    Brake(Brake),
    /// As planned, up to the rest at this time of the move (s).
    Planned { until: f64 },
}

/// The batches of a plan, in order. Ends after an error.
#[derive(Clone, Debug)]
pub struct Batches<P> {
    plan: P,
    /// The move under way, and how many periods of it are over.
    at: (usize, u32),
    /// Along that move.
    state: State,
    last: Setpoint,
    /// Setpoints of the stop tail before.
    tail_len: usize,
    done: bool,
}

impl<P: Deref<Target = Plan>> Batches<P> {
    /// The batches of a plan, which is borrowed or shared.
    pub fn new(plan: P) -> Self {
        let (kind, layer) = plan.moves.first().map_or((MoveKind::Approach, 0), |first| (first.kind, first.layer));
        let last = Setpoint { seq: 0, joints: plan.start, flow: 0.0, deposit: false, kind, layer };
        let done = plan.moves.is_empty();
        Self { plan, at: (0, 0), state: AT_START, last, tail_len: 0, done }
    }

    fn batch(&mut self) -> Result<Batch, PlanError> {
        let samples = |time: f64| (time * self.plan.rate).round() as usize;
        let (least, patient) = (samples(BATCH_TIME_MIN), samples(BATCH_TIME_PATIENT));
        let mut setpoints = Vec::with_capacity(3 * least);
        let after = (self.last.seq > 0).then_some(self.last.seq);
        if after.is_none() {
            // Where the robot stands comes first: what the motion starts from is part of what was sent.
            self.last.seq = 1;
            setpoints.push(self.last);
        }
        while let Some((index, periods)) = self.plan.after(self.at) {
            let Some(step) = self.plan.moves.get(index) else { break };
            self.at = (index, periods);
            self.state = step.state_at(periods, self.plan.rate);
            self.last = self.plan.setpoint(step, self.state, &self.last)?;
            setpoints.push(self.last);
            let tail = if setpoints.len() >= least { self.tail(step, setpoints.len() >= patient) } else { None };
            if let Some(tail) = tail {
                return self.ended(after, setpoints, step, &tail);
            }
        }
        self.done = true;
        let path_len = setpoints.len();
        pad(&mut setpoints, self.last);
        Ok(Batch { after, setpoints, path_len })
    }

    /// The batch, if the ring can take it while the one before is played: the end of that path and its tail are still held
    /// then.
    fn fitting(&mut self, batch: Batch) -> Result<Batch, PlanError> {
        let held = (HANDOVER * self.plan.rate) as usize + self.tail_len;
        if held + batch.setpoints.len() > RING {
            return Err(PlanError::StopTooLong {
                layer: self.plan.layer_name(self.last.layer).to_owned(),
                kind: self.last.kind,
                needed: (held + batch.setpoints.len()) as f64 / self.plan.rate,
                room: RING as f64 / self.plan.rate,
            });
        }
        self.tail_len = batch.setpoints.len() - batch.path_len;
        Ok(batch)
    }

    /// How the path can be left at the last setpoint; none where a batch must not end.
    fn tail(&self, step: &Move, patient: bool) -> Option<Tail> {
        let time = f64::from(self.at.1) / self.plan.rate;
        if self.plan.after(self.at).is_none() {
            // The last batch ends with the job.
            None
        } else if self.at.1 == step.periods {
            Some(Tail::Rest)
        } else if step.profile.comes_to_rest(time) {
            let [until, _] = step.profile.next_rest(time);
            let brake = step.brake_at(time, self.state, 1.0 / self.plan.rate);
            let sooner = brake.filter(|brake| brake.duration() < until - time);
            Some(sooner.map_or(Tail::Planned { until }, Tail::Brake))
        } else if self.state.acceleration == 0.0 || patient {
            step.brake_at(time, self.state, 1.0 / self.plan.rate).map(Tail::Brake)
        } else {
            None
        }
    }

    /// The batch with its tail.
    fn ended(&self, after: Option<u32>, path: Vec<Setpoint>, step: &Move, tail: &Tail) -> Result<Batch, PlanError> {
        let rate = self.plan.rate;
        let time = f64::from(self.at.1) / rate;
        let duration = match tail {
            Tail::Rest => 0.0,
            Tail::Brake(brake) => brake.duration(),
            Tail::Planned { until } => until - time,
        };
        let (path_len, mut setpoints, mut last) = (path.len(), path, self.last);
        for i in 1..=(duration * rate).ceil() as u32 {
            let since = (f64::from(i) / rate).min(duration);
            let state = match tail {
                Tail::Brake(brake) => {
                    let state = brake.state_at(since);
                    State { s: self.state.s + state.s, ..state }
                }
                Tail::Rest | Tail::Planned { .. } => step.profile.state_at(time + since),
            };
            last = self.plan.setpoint(step, state, &last)?;
            setpoints.push(last);
        }
        pad(&mut setpoints, last);
        Ok(Batch { after, setpoints, path_len })
    }
}

impl<P: Deref<Target = Plan>> Iterator for Batches<P> {
    type Item = Result<Batch, PlanError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done {
            return None;
        }
        let batch = self.batch().and_then(|batch| self.fitting(batch));
        self.done |= batch.is_err();
        Some(batch)
    }
}

impl Plan {
    /// The period after this one: its move and its number, from 1. None when the job is over.
    fn after(&self, (index, periods): (usize, u32)) -> Option<(usize, u32)> {
        let step = self.moves.get(index)?;
        if periods < step.periods {
            return Some((index, periods + 1));
        }
        let next =
            (index + 1..self.moves.len()).find(|&next| self.moves.get(next).is_some_and(|step| step.periods > 0))?;
        Some((next, 1))
    }

    /// The setpoint behind `last`, in this state of this move.
    fn setpoint(&self, step: &Move, state: State, last: &Setpoint) -> Result<Setpoint, PlanError> {
        let joints = match &step.route {
            Route::Joints { from, to } => on_grid(&Route::joints_between(from, to, state.s)),
            Route::Curves(curves) => {
                let (point, segment) = curves.point_at(state.s);
                self.tooling.joints_at(&point, &last.joints).map_err(|why| PlanError::OutOfReach {
                    place: Box::new(self.place(step.kind, step.layer, Some(point), Some(segment))),
                    why,
                })?
            }
        };
        let flow = flow_on_grid(step.bead * state.velocity);
        let deposit = step.kind == MoveKind::Deposit;
        Ok(Setpoint { seq: last.seq + 1, joints, flow, deposit, kind: step.kind, layer: step.layer })
    }
}

impl Move {
    /// After so many periods, at rest at the end after the last.
    fn state_at(&self, periods: u32, rate: f64) -> State {
        let time = f64::from(periods) / rate;
        self.profile.state_at(if periods >= self.periods { time.max(self.profile.duration()) } else { time })
    }

    /// The quickest brake from a state of this move that keeps its limits wherever it passes, if there is one. Tried with
    /// what the curve here leaves of the acceleration, then with what the sharpest curve ahead leaves.
    fn brake_at(&self, time: f64, from: State, period: f64) -> Option<Brake> {
        let [_, rest] = self.profile.next_rest(time);
        let here = self.curvature_between(from.s, from.s);
        let mut curvature = here;
        for _ in 0..2 {
            let speed = self.speed_bound(from);
            let left = self.limits.acceleration_max.powi(2) - (speed * speed * curvature).powi(2);
            let brake = Brake::new(from.velocity, from.acceleration, left.max(0.0).sqrt(), self.limits.jerk_max)?;
            if self.keeps_limits(&brake, from, rest, left.max(0.0).sqrt(), period) {
                return Some(brake);
            }
            curvature = self.curvature_between(from.s, from.s + brake.state_at(brake.duration()).s);
        }
        None
    }

    /// No speed of a brake from this state is higher: an acceleration under way goes to zero first.
    fn speed_bound(&self, from: State) -> f64 {
        from.velocity + 0.5 * from.acceleration.max(0.0).powi(2) / self.limits.jerk_max
    }

    /// Whether the whole acceleration stays within its limit and the brake ends before `rest`, judged period by period with
    /// the greatest speed, deceleration and curvature of each.
    fn keeps_limits(&self, brake: &Brake, from: State, rest: f64, deceleration: f64, period: f64) -> bool {
        let along = deceleration.max(from.acceleration);
        let mut before = State { s: 0.0, velocity: self.speed_bound(from), acceleration: from.acceleration };
        let count = (brake.duration() / period).ceil();
        if !(0.0..1e6).contains(&count) {
            return false;
        }
        for i in 1..=count as u32 {
            let state = brake.state_at(f64::from(i) * period);
            let speed = if before.acceleration > 0.0 { self.speed_bound(from) } else { before.velocity };
            let turning = speed * speed * self.curvature_between(from.s + before.s, from.s + state.s);
            if turning.hypot(along) > self.limits.acceleration_max * (1.0 + 1e-9) || from.s + state.s > rest {
                return false;
            }
            before = state;
        }
        true
    }
}

fn pad(setpoints: &mut Vec<Setpoint>, last: Setpoint) {
    setpoints.extend((1..=PADDING as u32).map(|i| Setpoint { seq: last.seq + i, ..last }));
}
