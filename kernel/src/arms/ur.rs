//! Universal Robots arms, nominal: a real unit ships its own calibration, which moves the tool centre point by millimetres.
//!
//! Geometry and speeds: `config/*/default_kinematics.yaml` and `joint_limits.yaml` of Universal_Robots_ROS2_Description,
//! commit 2221ec0f720fb1af99339eb891639b499b62f1da (UR3, 5, 10, 3e, 5e, 10e, 16e, 20, 30), and `ur_description/config` of
//! ros-industrial/universal_robot (UR12e at 2f33925, UR15 at 499e728, UR18 at 34b1371, UR8 Long at 31e2294). The speeds of the
//! UR8 Long and the UR18 stand in none of them. The UR7e is taken to be a UR5e: no published kinematics file was found.
//! Ranges are the controller's, ±360°, the last joint of UR3 and UR3e without end; the elbow's ±180° there is a planning choice.
//! Nobody publishes accelerations.

use super::opw::speeds;
use crate::arm::{Arm, Dh, Joint, Rating};
use crate::units::{JointPos, JointVel};
use core::f64::consts::PI;

/// Every arm of this file.
pub const ALL: [Arm<6>; 14] = [UR3, UR5, UR10, UR3E, UR5E, UR7E, UR10E, UR12E, UR16E, UR8_LONG, UR15, UR18, UR20, UR30];

/// UR3, CB series.
pub const UR3: Arm<6> = endless(arm("ur3", 0.1519, -0.24365, -0.21325, [0.11235, 0.08535, 0.0819], speeds(SMALL)));
/// UR5, CB series.
pub const UR5: Arm<6> = arm("ur5", 0.089159, -0.425, -0.39225, [0.10915, 0.09465, 0.0823], speeds([180.0; 6]));
/// UR10, CB series.
pub const UR10: Arm<6> = arm("ur10", 0.1273, -0.612, -0.5723, [0.163941, 0.1157, 0.0922], speeds(LARGE));
/// UR3e.
pub const UR3E: Arm<6> = endless(arm("ur3e", 0.15185, -0.24355, -0.2132, [0.13105, 0.08535, 0.0921], speeds(SMALL)));
/// UR5e.
pub const UR5E: Arm<6> = arm("ur5e", 0.1625, -0.425, -0.3922, [0.1333, 0.0997, 0.0996], speeds([180.0; 6]));
/// UR7e: the figures of the UR5e, whose successor it is; unverified.
pub const UR7E: Arm<6> = Arm { name: "ur7e", ..UR5E };
/// UR10e: 1.3 m reach, 12.5 kg.
pub const UR10E: Arm<6> = arm("ur10e", 0.1807, -0.6127, -0.57155, [0.17415, 0.11985, 0.11655], speeds(LARGE));
/// UR12e.
pub const UR12E: Arm<6> = Arm { name: "ur12e", ..UR10E };
/// UR16e.
pub const UR16E: Arm<6> = arm("ur16e", 0.1807, -0.4784, -0.36, [0.17415, 0.11985, 0.11655], speeds(LARGE));
/// UR8 Long.
pub const UR8_LONG: Arm<6> = arm("ur8long", 0.2186, -0.8989, -0.7149, WRIST_15, Rating::Unknown);
/// UR15.
pub const UR15: Arm<6> =
    arm("ur15", 0.2186, -0.6475, -0.5164, WRIST_15, speeds([180.0, 180.0, 240.0, 300.0, 300.0, 300.0]));
/// UR18.
pub const UR18: Arm<6> = arm("ur18", 0.2186, -0.475, -0.3389, WRIST_15, Rating::Unknown);
/// UR20.
pub const UR20: Arm<6> = arm("ur20", 0.2363, -0.862, -0.7287, WRIST_20, speeds(HEAVY));
/// UR30.
pub const UR30: Arm<6> = arm("ur30", 0.2363, -0.637, -0.5037, WRIST_20, speeds(HEAVY));

const SMALL: [f64; 6] = [180.0, 180.0, 180.0, 360.0, 360.0, 360.0];
const LARGE: [f64; 6] = [120.0, 120.0, 180.0, 180.0, 180.0, 180.0];
const HEAVY: [f64; 6] = [120.0, 120.0, 150.0, 210.0, 210.0, 210.0];
const WRIST_15: [f64; 3] = [0.1824, 0.1361, 0.1434];
const WRIST_20: [f64; 3] = [0.2010, 0.1593, 0.1543];

/// The same arm with a last joint that turns without end.
const fn endless(mut arm: Arm<6>) -> Arm<6> {
    arm.position_min.0[5] = f64::NEG_INFINITY;
    arm.position_max.0[5] = f64::INFINITY;
    arm
}

const fn arm(
    name: &'static str,
    d1: f64,
    a2: f64,
    a3: f64,
    wrist: [f64; 3],
    velocity_max: Rating<JointVel<6>>,
) -> Arm<6> {
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
        velocity_max,
        acceleration_max: Rating::Unknown,
    }
}
