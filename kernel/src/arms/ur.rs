//! Universal Robots arms, nominal (a real unit ships its own calibration, which moves the tool centre point by millimetres).
//!
//! Source: `config/ur10e/default_kinematics.yaml` and `joint_limits.yaml` of Universal_Robots_ROS2_Description, commit
//! 2221ec0f720fb1af99339eb891639b499b62f1da; joint range by the controller (the elbow's ±180° there is a planning choice).

use crate::arm::{Arm, Dh, Joint, Rating};
use crate::units::{JointPos, JointVel};
use core::f64::consts::PI;

const fn arm(name: &'static str, d1: f64, a2: f64, a3: f64, wrist: [f64; 3], velocity_max_deg_s: [f64; 6]) -> Arm<6> {
    let mut velocity_max = [0.0; 6];
    let mut joint = 0;
    while joint < 6 {
        velocity_max[joint] = velocity_max_deg_s[joint] * (PI / 180.0);
        joint += 1;
    }
    Arm {
        name,
        base_from_zero: None,
        dh: [
            Dh { theta: 0.0, d: d1, a: 0.0, sin_alpha: 1.0, cos_alpha: 0.0 },
            Dh { theta: 0.0, d: 0.0, a: a2, sin_alpha: 0.0, cos_alpha: 1.0 },
            Dh { theta: 0.0, d: 0.0, a: a3, sin_alpha: 0.0, cos_alpha: 1.0 },
            Dh { theta: 0.0, d: wrist[0], a: 0.0, sin_alpha: 1.0, cos_alpha: 0.0 },
            Dh { theta: 0.0, d: wrist[1], a: 0.0, sin_alpha: -1.0, cos_alpha: 0.0 },
            Dh { theta: 0.0, d: wrist[2], a: 0.0, sin_alpha: 0.0, cos_alpha: 1.0 },
        ],
        joints: [Joint::REVOLUTE; 6],
        last_from_flange: None,
        position_min: JointPos([-2.0 * PI; 6]),
        position_max: JointPos([2.0 * PI; 6]),
        velocity_max: Rating::Known(JointVel(velocity_max)),
        acceleration_max: Rating::Unknown,
    }
}

/// UR10e: 1.3 m reach, 12.5 kg.
pub const UR10E: Arm<6> =
    arm("ur10e", 0.1807, -0.6127, -0.57155, [0.17415, 0.11985, 0.11655], [120.0, 120.0, 180.0, 180.0, 180.0, 180.0]);
