//! What a calibrated arm may differ in from its table.

use std::fmt;

/// One number that a calibration of an arm seeks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// A motion of the arm's base, in the base frame, against the tracker.
    Base(Motion),
    /// A change of a row of the DH table.
    Link {
        /// The row (0 is the first).
        link: usize,
        /// What changes.
        change: Change,
    },
    /// A motion of the target, in the flange frame.
    Target(Motion),
}

/// A small motion of a frame along or about one of its axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Motion {
    X,
    Y,
    Z,
    AboutX,
    AboutY,
    AboutZ,
}

/// A change of one number of a row, in the order in which a row applies them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Turn about z (rad): the joint's zero, where it is revolute.
    Theta,
    /// Shift along z (m).
    D,
    /// Shift along x (m).
    A,
    /// Turn about y, between the shift along x and the turn about it (rad). A standard row has none; where the axes of
    /// a joint and of the next are parallel, no small change of the other four stands for it (Hayati, Mirmirani,
    /// "Improving the absolute positioning accuracy of robot manipulators", J. Robotic Systems 2(4), 1985).
    Tilt,
    /// Turn about x (rad).
    Alpha,
}

impl Motion {
    /// In the order of a twist: translations, then turns.
    pub const ALL: [Self; 6] = [Self::X, Self::Y, Self::Z, Self::AboutX, Self::AboutY, Self::AboutZ];

    fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::AboutX => "rx",
            Self::AboutY => "ry",
            Self::AboutZ => "rz",
        }
    }
}

impl Change {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Theta, Self::D, Self::A, Self::Tilt, Self::Alpha];

    fn name(self) -> &'static str {
        match self {
            Self::Theta => "theta",
            Self::D => "d",
            Self::A => "a",
            Self::Alpha => "alpha",
            Self::Tilt => "tilt",
        }
    }
}

impl Parameter {
    /// Whether it is in rad; else in m.
    pub const fn is_angle(self) -> bool {
        match self {
            Self::Base(motion) | Self::Target(motion) => {
                matches!(motion, Motion::AboutX | Motion::AboutY | Motion::AboutZ)
            }
            Self::Link { change, .. } => matches!(change, Change::Theta | Change::Alpha | Change::Tilt),
        }
    }
}

/// "base z", "d3" (of the third row), "target rz".
impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Base(motion) => write!(f, "base {}", motion.name()),
            Self::Link { link, change } => write!(f, "{}{}", change.name(), link + 1),
            Self::Target(motion) => write!(f, "target {}", motion.name()),
        }
    }
}
