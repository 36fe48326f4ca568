//! Why a job cannot be run: where, what is wrong, what to do about it.

use super::moves::MoveKind;
use super::path::{PathError, Point};
use screed_kernel::frame::Refusal;
use screed_kernel::ik::IkError;

/// A place in a job.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// The layer's name in the model.
    pub layer: String,
    /// What the tool does there.
    pub kind: MoveKind,
    /// The segment within the layer, from 0, while depositing.
    pub segment: Option<usize>,
    /// Where the tool centre point is, in the part frame (m); none on the approach, which runs in joint space.
    pub point_in_part: Option<Point>,
}

impl core::fmt::Display for Place {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(out, "{} of layer \"{}\"", self.kind, self.layer)?;
        if let Some(segment) = self.segment {
            write!(out, ", segment {}", segment + 1)?;
        }
        if let Some(point) = self.point_in_part {
            let [x, y, z] = [point.x, point.y, point.z].map(|metres| metres * 1e3);
            write!(out, ", at ({x:.2}, {y:.2}, {z:.2}) mm in the part frame")?;
        }
        Ok(())
    }
}

/// What of a joint is limited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointQuantity {
    /// Speed (rad/s).
    Velocity,
    /// Acceleration (rad/s²).
    Acceleration,
    /// Jerk (rad/s³).
    Jerk,
}

impl JointQuantity {
    /// The name, and the unit that stands behind rad.
    const fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Velocity => ("speed", "/s"),
            Self::Acceleration => ("acceleration", "/s²"),
            Self::Jerk => ("jerk", "/s³"),
        }
    }
}

/// Why there is no plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Layers that the model does not have are wanted.
    #[error(
        "{count} layers from layer {from_layer} on are wanted, but the model has {layers} (counted from 0); choose others with \
         --from-layer and --layers"
    )]
    NoSuchLayers {
        /// The first layer wanted.
        from_layer: usize,
        /// How many are wanted.
        count: usize,
        /// How many layers the model has.
        layers: usize,
    },
    /// A layer without curves.
    #[error("layer \"{layer}\" has no segments; give it a path in the model or remove it")]
    EmptyLayer {
        /// Its name.
        layer: String,
    },
    /// A process value is zero, negative or not finite.
    #[error("layer \"{layer}\": {what} is {found}; it must be a positive number: correct it in the model")]
    Process {
        /// The layer's name.
        layer: String,
        /// Which value.
        what: &'static str,
        /// What it is (SI).
        found: f64,
    },
    /// Two consecutive segments do not meet.
    #[error(
        "layer \"{layer}\": segment {} begins {:.4} mm from where the one before ends; a gap may be {} mm at most, \
         and 1/10,000 of the segment: close it in the model", segment + 1, gap * 1e3, super::route::GAP_MAX * 1e3
    )]
    Gap {
        /// The layer's name.
        layer: String,
        /// The segment after the gap, from 0.
        segment: usize,
        /// The distance (m).
        gap: f64,
    },
    /// A connecting move cannot be made.
    #[error("the {kind} of layer \"{layer}\" cannot be planned: {source}")]
    Connection {
        /// The layer's name.
        layer: String,
        /// Which move.
        kind: MoveKind,
        /// What is wrong with it.
        source: PathError,
    },
    /// The layer time cannot be met.
    #[error(
        "layer \"{layer}\" is to take {wanted} s, but within the limits it takes at least {shortest:.3} s; allow more time or higher limits"
    )]
    LayerTimeTooShort {
        /// The layer's name.
        layer: String,
        /// The layer time of the model (s).
        wanted: f64,
        /// The shortest time within the limits (s).
        shortest: f64,
    },
    /// The extruder cannot give enough.
    #[error(
        "layer \"{layer}\" needs a flow of {:.0} mm³/s, the extruder gives at most {:.0} mm³/s; allow more layer time or a larger extruder.flow_max_mm3_s",
        flow * 1e9, flow_max * 1e9
    )]
    FlowTooHigh {
        /// The layer's name.
        layer: String,
        /// The highest flow needed (m³/s).
        flow: f64,
        /// The extruder's limit (m³/s).
        flow_max: f64,
    },
    /// The job takes more setpoints than a sequence number counts.
    #[error("the job takes more than 4,294,967,295 setpoints; print fewer layers at a time")]
    TooLong,
    /// The real-time process has no room for a piece of the path and the way to rest from it.
    #[error(
        "the {kind} of layer \"{layer}\" takes so long to come to rest that {needed:.1} s of setpoints would have to be sent ahead, \
         the ring holds {room:.1} s; allow more acceleration, or a rate_hz of 125 in the cell file"
    )]
    StopTooLong {
        /// The layer's name.
        layer: String,
        /// The move.
        kind: MoveKind,
        /// What would have to be in the ring at once (s).
        needed: f64,
        /// What the ring holds (s).
        room: f64,
    },
    /// The joints to start from are no position of this robot.
    #[error("joint {} of the start is {position} rad, outside {low:.4} to {high:.4} rad; move the robot into its range", joint + 1)]
    Start {
        /// The joint, from 0.
        joint: usize,
        /// Where it is (rad).
        position: f64,
        /// The lowest position (rad).
        low: f64,
        /// The highest position (rad).
        high: f64,
    },
    /// The arm cannot get there.
    #[error("{place}: {}; move the part (part.xyz_mm, part.rpy_deg) or the robot", reach(why))]
    OutOfReach {
        /// Where.
        place: Box<Place>,
        /// What the inverse kinematics says.
        why: IkError,
    },
    /// The kernel would not take the cell's limits.
    #[error("the kernel would refuse the cell file: {}; correct it", crate::run::words::refusal(.0))]
    Refused(Refusal),
    /// A joint would have to be where it must not.
    #[error(
        "{place}: joint {} would have to be at {:.3}°, beyond {:.3}°; move the part (part.xyz_mm, part.rpy_deg) or the robot",
        joint + 1, position.to_degrees(), limit.to_degrees()
    )]
    JointRange {
        /// Where.
        place: Box<Place>,
        /// The joint, from 0.
        joint: usize,
        /// Where it would have to be (rad).
        position: f64,
        /// Where its range ends (rad), less what lies between setpoints.
        limit: f64,
    },
    /// Flange or nozzle would leave the workspace.
    #[error(
        "{place}: flange or nozzle would be {:.2} mm beyond workspace.{bound}; move the part (part.xyz_mm, part.rpy_deg) or the bound",
        by * 1e3
    )]
    Workspace {
        /// Where.
        place: Box<Place>,
        /// The bound's key in the cell file.
        bound: &'static str,
        /// How far beyond it (m).
        by: f64,
    },
    /// A joint would have to move faster than it may.
    #[error(
        "{place}: joint {} would need a {} of {found:.3} rad{}, its limit is {limit:.3}; {}",
        joint + 1, quantity.words().0, quantity.words().1, remedy(*found, *limit)
    )]
    JointLimit {
        /// Where.
        place: Box<Place>,
        /// The joint, from 0.
        joint: usize,
        /// What is limited.
        quantity: JointQuantity,
        /// What the path needs (rad/s, rad/s², rad/s³).
        found: f64,
        /// What the cell file allows.
        limit: f64,
    },
}

fn reach(error: &IkError) -> String {
    match error {
        IkError::NotFinite => "the pose is not finite".to_owned(),
        IkError::NotRotation { by } => format!("the pose's axes are {by:e} from a rotation's"),
        IkError::OtherShape => "the arm's table does not have the shape that is asked for".to_owned(),
        IkError::Orientation { by } => format!("the arm misses the orientation by {:.3}°", by.to_degrees()),
        IkError::Singular { singularity, distance } => {
            format!("{distance:.1e} from the {} singularity, no joints are found", singularity.name())
        }
        IkError::NotConverged { residual } => format!("no joints are found, {residual:.1e} m or rad are left"),
        IkError::OutOfReach { by } => format!("out of the arm's reach by {:.2} mm", by * 1e3),
        IkError::Limit { joint, position } => {
            format!("joint {} would have to be at {:.2}°, beyond its range", joint + 1, position.to_degrees())
        }
    }
}

fn remedy(found: f64, limit: f64) -> &'static str {
    if found.abs() > 10.0 * limit {
        "there the arm passes a singularity or would have to change its branch: move the part (part.xyz_mm, part.rpy_deg)"
    } else {
        "lower the speeds (layer time, travel.velocity_max_mm_s) or move the part away from the singularity"
    }
}

impl From<PlanError> for crate::failure::Failure {
    fn from(error: PlanError) -> Self {
        Self::told(crate::failure::Exit::Input, error.to_string())
    }
}
