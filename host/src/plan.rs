//! Where the tool goes, in which order, and when.
//!
//! A [`Plan`] is made from a model and a cell, and verified before anything moves: every setpoint that will be sent, stop
//! tails included, is computed once and judged. [`Plan::batches`] computes the same setpoints again, seconds ahead of need.

pub mod approach;
pub mod check;
pub mod contour;
pub mod error;
pub mod moves;
pub mod path;
pub mod plot;
pub mod profile;
pub mod report;
pub mod route;
pub mod stream;
pub mod tooling;

pub use error::{Place, PlanError};

use crate::config::Cell;
use crate::model::fim::{FimModel, Layer};
use approach::Approach;
use check::JointCheck;
use error::JointQuantity;
use moves::{Move, MoveKind};
use path::Point;
use route::Route;
use screed_kernel::guard::{Quantity, Violation};
use screed_kernel::units::JointPos;
use stream::{Batches, Setpoint};
use tooling::{Tooling, on_grid};

/// Which part of a model is printed, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// The first layer, as a position in the model's layers, from 0.
    pub from_layer: usize,
    /// How many layers at most; none for all.
    pub layers: Option<usize>,
    /// The same motion without flow.
    pub dry: bool,
}

/// A verified job.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    moves: Vec<Move>,
    approach: Approach,
    start: JointPos<6>,
    tooling: Tooling,
    /// Setpoints a second.
    rate: f64,
    layer_names: Vec<String>,
}

impl Plan {
    /// Plans the wanted layers of a model, from where the robot stands, and verifies every setpoint. Of the arm's branches
    /// it takes the one nearest to `start` on which the whole job stays within limits.
    ///
    /// # Errors
    /// [`PlanError`], for the nearest branch when there is none.
    pub fn new(model: &FimModel, cell: &Cell, options: &Options, start: &JointPos<6>) -> Result<Self, PlanError> {
        let start = on_grid(&checked_start(cell, start)?);
        let first = options.from_layer;
        let count = options.layers.unwrap_or(model.layers.len().saturating_sub(first));
        let wanted = first.checked_add(count).and_then(|end| model.layers.get(first..end)).unwrap_or(&[]);
        let [first_layer, ..] = wanted else {
            return Err(PlanError::NoSuchLayers { from_layer: first, count, layers: model.layers.len() });
        };
        let rate = f64::from(cell.link.rate_hz);
        let mut moves = moves::cartesian(wanted, first, cell, 1.0 / rate)?;
        if options.dry {
            moves.iter_mut().for_each(|step| step.bead = 0.0);
        }
        let tooling = Tooling::new(cell);
        let layer_names = model.layers.iter().map(|layer| layer.name.clone()).collect();
        let nowhere =
            Approach { lifted: false, from: start, to: start, duration: 0.0, tool_distance: 0.0, tool_lowest: 0.0 };
        let plan = Self { moves, approach: nowhere, start, tooling, rate, layer_names };
        let mut refused = None;
        for to in plan.branches()? {
            match plan.clone().approaching(cell, first_layer, to) {
                Ok(plan) => return Ok(plan),
                Err(error) => refused = refused.or(Some(error)),
            }
        }
        Err(refused.unwrap_or(PlanError::NoSuchLayers { from_layer: first, count, layers: model.layers.len() }))
    }

    /// The branches from which the first layer can be begun, the one nearest to the start first. A second look, from joints
    /// all zero, finds those that the start's full turns leave out.
    fn branches(&self) -> Result<Vec<JointPos<6>>, PlanError> {
        let above = match self.moves.first() {
            Some(Move { route: Route::Curves(curves), .. }) => curves.point_at(0.0).0,
            _ => return Ok(Vec::new()),
        };
        let layer = self.moves.first().map_or(0, |step| step.layer);
        let inverse = |seed: &JointPos<6>| self.tooling.branches_at(&above, seed);
        let found = inverse(&self.start).map_err(|why| PlanError::OutOfReach {
            place: Box::new(self.place(MoveKind::Approach, layer, Some(above), None)),
            why,
        })?;
        let others = inverse(&JointPos::ZERO);
        let others = others.iter().flat_map(|others| others.as_slice());
        let mut branches: Vec<_> =
            found.as_slice().iter().chain(others).map(|answer| on_grid(&answer.joints)).collect();
        let turn = |joints: &JointPos<6>| {
            joints.0.iter().zip(&self.start.0).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
        };
        branches.sort_by(|a, b| turn(a).total_cmp(&turn(b)));
        branches.dedup();
        Ok(branches)
    }

    /// The plan with its approach, numbered and verified.
    fn approaching(mut self, cell: &Cell, layer: &Layer, to: JointPos<6>) -> Result<Self, PlanError> {
        let index = self.moves.first().map_or(0, |step| step.layer);
        let (lift, from) = self.lift_off(cell, layer, index, &to)?;
        let (step, approach) = approach::approach(&self.tooling, cell, index, [from, to], 1.0 / self.rate)?;
        self.approach = Approach { lifted: lift.is_some(), ..approach };
        self.moves.splice(0..0, lift.into_iter().chain(step));
        // Setpoint 1 is the start itself.
        let mut seq = 1_u32;
        for step in &mut self.moves {
            seq = seq.checked_add(step.periods).ok_or(PlanError::TooLong)?;
            step.last_seq = seq;
        }
        // The padding behind the last one counts on.
        seq.checked_add(16).ok_or(PlanError::TooLong)?;
        self.verified(cell)?;
        Ok(self)
    }

    /// When the tool stands upright and lower than where the approach leads, it may stand in what was printed: first straight
    /// up. Returns that move, and the joints it ends at.
    fn lift_off(
        &self,
        cell: &Cell,
        layer: &Layer,
        index: usize,
        to: &JointPos<6>,
    ) -> Result<(Option<Move>, JointPos<6>), PlanError> {
        let (tooling, start) = (&self.tooling, &self.start);
        let point = tooling.point_in_part(start);
        let above = Point::new(point.x, point.y, tooling.point_in_part(to).z);
        if !tooling.is_upright(start) || above.z - point.z < path::LENGTH_MIN {
            return Ok((None, *start));
        }
        let step = moves::connection(MoveKind::Lift, layer, index, [point, above], cell, 1.0 / self.rate)?;
        let joints = tooling.joints_at(&above, start).map_err(|why| PlanError::OutOfReach {
            place: Box::new(self.place(MoveKind::Lift, index, Some(above), None)),
            why,
        })?;
        Ok((step, joints))
    }

    fn verified(&self, cell: &Cell) -> Result<(), PlanError> {
        let mut path = JointCheck::new(cell, &self.start)?;
        let judge = |check: &mut JointCheck, setpoints: &[Setpoint]| {
            setpoints
                .iter()
                .try_for_each(|setpoint| check.follow(setpoint).map_err(|limit| self.broken(cell, setpoint, limit)))
        };
        for batch in self.batches() {
            let batch = batch?;
            let (path_part, tail_part) = batch.setpoints.split_at(batch.path_len);
            judge(&mut path, path_part)?;
            judge(&mut path.clone(), tail_part)?;
        }
        Ok(())
    }

    fn broken(&self, cell: &Cell, setpoint: &Setpoint, violation: Violation) -> PlanError {
        let point = self.tooling.point_in_part(&setpoint.joints);
        let segment = match self.move_of(setpoint.seq).map(|step| &step.route) {
            Some(Route::Curves(curves)) => Some(curves.nearest_segment(&point)),
            _ => None,
        };
        let place = Box::new(self.place(setpoint.kind, setpoint.layer, Some(point), segment));
        let Violation { quantity, joint, value: found, limit } = violation;
        let joint = usize::from(joint);
        let quantity = match quantity {
            Quantity::Velocity => JointQuantity::Velocity,
            Quantity::Acceleration => JointQuantity::Acceleration,
            Quantity::Jerk => JointQuantity::Jerk,
            Quantity::Finite | Quantity::Position => {
                return PlanError::JointRange { place, joint, position: found, limit };
            }
            Quantity::Workspace => {
                let bound = cell.workspace.get(joint).map_or("", |bound| bound.key);
                return PlanError::Workspace { place, bound, by: found - limit };
            }
        };
        PlanError::JointLimit { place, joint, quantity, found, limit }
    }

    /// The moves, in order.
    pub fn moves(&self) -> &[Move] {
        &self.moves
    }

    /// The approach.
    pub fn approach(&self) -> &Approach {
        &self.approach
    }

    /// Setpoints a second.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Where points of the part lie, and which joints reach them.
    pub fn tooling(&self) -> &Tooling {
        &self.tooling
    }

    /// Sequence number of the last path setpoint; the first is 1.
    pub fn last_seq(&self) -> u32 {
        self.moves.last().map_or(0, |step| step.last_seq)
    }

    /// The move that a setpoint belongs to; the first setpoint, where the robot stands, to the first.
    pub fn move_of(&self, seq: u32) -> Option<&Move> {
        self.moves.get(self.moves.partition_point(|step| step.last_seq < seq))
    }

    /// The setpoints, in batches that each end at rest, made as they are asked for.
    pub fn batches(&self) -> Batches<&Self> {
        Batches::new(self)
    }

    /// A layer's name in the model, by its position there.
    pub fn layer_name(&self, layer: usize) -> &str {
        self.layer_names.get(layer).map_or("", String::as_str)
    }

    /// Where a message places something.
    fn place(&self, kind: MoveKind, layer: usize, point_in_part: Option<Point>, segment: Option<usize>) -> Place {
        let segment = segment.filter(|_| kind == MoveKind::Deposit);
        Place { layer: self.layer_name(layer).to_owned(), kind, segment, point_in_part }
    }
}

/// The joints when they are a position of this robot.
fn checked_start(cell: &Cell, start: &JointPos<6>) -> Result<JointPos<6>, PlanError> {
    let arm = &cell.robot.arm;
    for (joint, &position) in start.0.iter().enumerate() {
        let (low, high) = (arm.position_min.0[joint], arm.position_max.0[joint]);
        if !(low..=high).contains(&position) {
            return Err(PlanError::Start { joint, position, low, high });
        }
    }
    Ok(*start)
}

#[cfg(test)]
mod tests;
