//! What a tick is given, what it asks whoever corrects the path, and what it gives.

use crate::correction::{Correction, CorrectionLimits};
use crate::mode::Mode;
use crate::units::{JointAcc, JointPos, JointVel};

/// What is known at one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensors<const N: usize> {
    /// Actual joint positions as the robot says them (rad or m).
    pub actual: JointPos<N>,
    /// Joint positions by an estimator (rad or m), if there is one.
    pub estimate: Option<JointPos<N>>,
    /// Joint offsets to add to the path (rad or m). `None` takes those under way out, within their limits.
    pub correction: Option<JointPos<N>>,
    /// Whether the robot takes setpoints now: powered, no safety stop, its program running; and whatever else has to work
    /// before anything moves.
    pub ready: bool,
}

impl<const N: usize> Sensors<N> {
    /// A robot that says where it is, and nothing else.
    pub const fn robot(actual: JointPos<N>, ready: bool) -> Self {
        Self { actual, estimate: None, correction: None, ready }
    }
}

/// What the path asks for at a tick, for whoever corrects it.
#[derive(Clone, Copy, Debug)]
pub struct Reference<const N: usize> {
    /// The path (rad or m).
    pub joints: JointPos<N>,
    /// How it moves.
    pub velocity: JointVel<N>,
    /// How that changes.
    pub acceleration: JointAcc<N>,
    /// Whether it is one along which material is laid.
    pub deposit: bool,
    /// Whether the path is being played; else it stands.
    pub plays: bool,
    /// The correction in what was sent last.
    pub correction: Correction<N>,
    /// What the next one has to keep.
    pub limits: CorrectionLimits,
    /// From tick to tick (s).
    pub period: f64,
}

/// What whoever corrects the path answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corrected<const N: usize> {
    /// Joint offsets to add to the path (rad or m). `None` takes those under way out, within their limits.
    pub joints: Option<JointPos<N>>,
    /// Whether the path clock shall wait: its rate then goes to 0, and from there back to what the host asked for.
    pub waits: bool,
}

/// What is to happen at this cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command<const N: usize> {
    /// Joint targets (rad or m); `None` while the robot's position is not known: then nothing may be sent.
    pub joints: Option<JointPos<N>>,
    /// The path here (rad or m): the targets without their correction.
    pub path: JointPos<N>,
    /// The setpoint they stand for, or were interpolated behind; 0 before the first.
    pub seq: u32,
    /// Extrusion rate (m³/s).
    pub flow: f64,
    /// Whether the path here is one along which material is laid; at rest there too, when nothing flows.
    pub deposit: bool,
    /// Path clock rate, 0 to 1.
    pub rate: f64,
    /// The correction in the targets (rad or m).
    pub correction: JointPos<N>,
    /// Mode.
    pub mode: Mode,
}
