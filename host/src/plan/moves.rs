//! The moves of a job, in order: approach, then for each layer lower, deposit, lift, and travel to the next.

use super::error::PlanError;
use super::path::{LENGTH_MIN, Point, Segment};
use super::profile::{PathLimits, Profile, Stretch};
use super::route::{Curves, Route};
use crate::config::Cell;
use crate::model::fim::Layer;
use nalgebra::Vector3;

/// What a move is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MoveKind {
    /// In joint space, from where the robot stands to above the first layer's start.
    Approach,
    /// Straight down to a layer's start.
    Lower,
    /// Along a layer's curves.
    Deposit,
    /// Straight up from a layer's end.
    Lift,
    /// Straight from above a layer's end to above the next layer's start.
    Travel,
}

impl core::fmt::Display for MoveKind {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        out.write_str(match self {
            Self::Approach => "approach",
            Self::Lower => "lower",
            Self::Deposit => "deposit",
            Self::Lift => "lift",
            Self::Travel => "travel",
        })
    }
}

/// One move, from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// What it is for.
    pub kind: MoveKind,
    /// The layer it belongs to, as a position in the model's layers; the approach and a travel lead to it.
    pub layer: usize,
    /// Where it leads.
    pub route: Route,
    /// When it is where.
    pub profile: Profile,
    /// The limits it keeps; on the approach per share of the way.
    pub limits: PathLimits,
    /// Cross-section of the bead laid down (m²), 0 when nothing is.
    pub bead: f64,
    /// How many sample periods it takes.
    pub periods: u32,
    /// Sequence number of its last setpoint.
    pub last_seq: u32,
    /// Where stretches begin (m) and how they curve at most (1/m).
    bends: Vec<[f64; 2]>,
}

impl Move {
    /// A move along `route`; `period` is the sample period (s).
    pub fn new(
        kind: MoveKind,
        layer: usize,
        route: Route,
        stretches: &[Stretch],
        profile: Profile,
        limits: PathLimits,
        period: f64,
    ) -> Result<Self, PlanError> {
        // A duration is right to 1e-9 s; that much over a whole number of periods is no further period.
        let periods = (profile.duration() / period - 1e-6).ceil();
        if !(0.0..=f64::from(u32::MAX)).contains(&periods) {
            return Err(PlanError::TooLong);
        }
        let mut start = 0.0;
        let bends = stretches.iter().map(|stretch| {
            let bend = [start, stretch.curvature_max];
            start += stretch.length;
            bend
        });
        let bends = bends.collect();
        Ok(Self { kind, layer, route, profile, limits, bead: 0.0, periods: periods as u32, last_seq: 0, bends })
    }

    /// The greatest curvature between two arc lengths (1/m).
    pub fn curvature_between(&self, from: f64, to: f64) -> f64 {
        let first = self.bends.partition_point(|bend| bend[0] <= from).saturating_sub(1);
        let touched = self.bends.iter().skip(first).take_while(|bend| bend[0] <= to);
        touched.fold(0.0, |max, bend| bend[1].max(max))
    }
}

/// The limits while depositing: the model's within the cell's.
pub fn deposit_limits(layer: &Layer, cell: &Cell) -> PathLimits {
    let velocity_max = layer.process.velocity_max.unwrap_or(f64::INFINITY);
    PathLimits {
        velocity_max: cell.limits.path_velocity_max.min(velocity_max),
        acceleration_max: cell.limits.path_acceleration_max.min(layer.process.acceleration_max),
        jerk_max: cell.limits.path_jerk_max,
    }
}

/// The limits without flow.
pub fn travel_limits(cell: &Cell) -> PathLimits {
    PathLimits {
        velocity_max: cell.travel.velocity_max,
        acceleration_max: cell.travel.acceleration_max,
        jerk_max: cell.travel.jerk_max,
    }
}

/// Every move after the approach, in order, without sequence numbers yet.
pub fn cartesian(layers: &[Layer], first: usize, cell: &Cell, period: f64) -> Result<Vec<Move>, PlanError> {
    let mut moves = Vec::with_capacity(4 * layers.len());
    let mut above: Option<Point> = None;
    for (offset, layer) in layers.iter().enumerate() {
        let deposit = deposit(layer, first + offset, cell, period)?;
        let (Some(start), Some(end)) = (layer.segments.first(), layer.segments.last()) else {
            return Err(PlanError::EmptyLayer { layer: layer.name.clone() });
        };
        let (start, end) = (start.start(), end.end());
        let lift = Vector3::new(0.0, 0.0, cell.travel.lift);
        let line = |kind, from, to| connection(kind, layer, first + offset, [from, to], cell, period);
        if let Some(above) = above {
            moves.extend(line(MoveKind::Travel, above, start + lift)?);
        }
        moves.extend(line(MoveKind::Lower, start + lift, start)?);
        moves.push(deposit);
        moves.extend(line(MoveKind::Lift, end, end + lift)?);
        above = Some(end + lift);
    }
    Ok(moves)
}

fn deposit(layer: &Layer, index: usize, cell: &Cell, period: f64) -> Result<Move, PlanError> {
    let name = || layer.name.clone();
    let process = &layer.process;
    for (what, found) in [
        ("the layer time", process.layer_time),
        ("the acceleration limit", process.acceleration_max),
        ("the speed limit", process.velocity_max.unwrap_or(1.0)),
        ("the layer height", process.layer_height),
        ("the filament width", process.filament_width),
    ] {
        if !(found.is_finite() && found > 0.0) {
            return Err(PlanError::Process { layer: name(), what, found });
        }
    }
    let curves = Curves::new(&layer.segments).map_err(|gap| PlanError::Gap {
        layer: name(),
        segment: gap.segment,
        gap: gap.gap,
    })?;
    let (stretches, limits) = (curves.stretches(), deposit_limits(layer, cell));
    let wanted = process.layer_time;
    let profile = Profile::lasting(&stretches, &limits, wanted).map_err(|short| PlanError::LayerTimeTooShort {
        layer: name(),
        wanted,
        shortest: short.shortest,
    })?;
    let bead = process.layer_height * process.filament_width;
    let (flow, flow_max) = (bead * profile.velocity_max(), cell.extruder.flow_max);
    if flow > flow_max {
        return Err(PlanError::FlowTooHigh { layer: name(), flow, flow_max });
    }
    let deposit = Move::new(MoveKind::Deposit, index, Route::Curves(curves), &stretches, profile, limits, period)?;
    Ok(Move { bead, ..deposit })
}

/// A straight move without flow; none between points that coincide.
pub(super) fn connection(
    kind: MoveKind,
    layer: &Layer,
    index: usize,
    [from, to]: [Point; 2],
    cell: &Cell,
    period: f64,
) -> Result<Option<Move>, PlanError> {
    if (to - from).norm() < LENGTH_MIN {
        return Ok(None);
    }
    let line =
        Segment::line(from, to).map_err(|source| PlanError::Connection { layer: layer.name.clone(), kind, source })?;
    let stretches = [Stretch { length: line.length(), curvature_max: 0.0, rest_after: true }];
    let curves = Curves::new(&[line]).map_err(|gap| PlanError::Gap {
        layer: layer.name.clone(),
        segment: gap.segment,
        gap: gap.gap,
    })?;
    let limits = travel_limits(cell);
    let profile = Profile::quickest(&stretches, &limits);
    let mut step = Move::new(kind, index, Route::Curves(curves), &stretches, profile, limits, period)?;
    if kind == MoveKind::Lower {
        // Standing still at its end belongs to the move. A minute at most, by the cell file's range.
        step.periods = step.periods.saturating_add((cell.travel.settle / period).round() as u32);
    }
    Ok(Some(step))
}
