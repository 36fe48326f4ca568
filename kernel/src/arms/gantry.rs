//! A contour-crafting gantry: a nozzle over a building site.

use super::opw::radians;
use crate::arm::{Arm, Dh, Joint, Rating};
use crate::pose::Pose;
use crate::units::JointPos;
use nalgebra::{Matrix3, Vector3};

/// Slides along the base's x, y and z axis, in this order; frame 3 has the base's axes.
pub(super) const SLIDES: [Dh; 3] = [
    Dh { theta: 0.0, d: 0.0, a: 0.0, sin_alpha: 1.0, cos_alpha: 0.0 },
    Dh { theta: core::f64::consts::FRAC_PI_2, d: 0.0, a: 0.0, sin_alpha: 1.0, cos_alpha: 0.0 },
    Dh { theta: 0.0, d: 0.0, a: 0.0, sin_alpha: 0.0, cos_alpha: 1.0 },
];

/// Frame 0 of [`SLIDES`] in the base frame: z along the base's x.
pub(super) const BASE_FROM_ZERO: Pose = Pose {
    rotation: Matrix3::new(0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0),
    translation: Vector3::new(0.0, 0.0, 0.0),
};

/// Three slides over a site of 12 m by 8 m by 4 m and a nozzle that turns about the vertical between stops at ±360° (Zhang
/// and Khoshnevis, "Optimal machine operation planning for construction by Contour Crafting", Automation in Construction 29,
/// 2013). The paper gives the stops only: the strokes are those of no machine, to be replaced by yours, and ratings are
/// unknown. Flange: z down, out of the nozzle; with the nozzle at zero, x along the base's x.
pub const CONTOUR_CRAFTER: Arm<4> = Arm {
    name: "contour-crafter",
    base_from_zero: Some(BASE_FROM_ZERO),
    dh: [SLIDES[0], SLIDES[1], SLIDES[2], Dh { theta: 0.0, d: 0.0, a: 0.0, sin_alpha: 0.0, cos_alpha: -1.0 }],
    joints: [Joint::PRISMATIC, Joint::PRISMATIC, Joint::PRISMATIC, Joint::REVOLUTE],
    last_from_flange: None,
    position_min: JointPos([0.0, 0.0, 0.0, radians([-360.0])[0]]),
    position_max: JointPos([12.0, 8.0, 4.0, radians([360.0])[0]]),
    velocity_max: Rating::Unknown,
    acceleration_max: Rating::Unknown,
};
