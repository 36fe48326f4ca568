//! Comau arms. Joints zero: upper arm and forearm upright.

use super::opw::{Opw, positions, radians, speeds, turned};
use crate::arm::{Arm, Coupling, Joint, JointKind, Rating};
use crate::units::JointAcc;

const SIGNS: [f64; 6] = [-1.0, 1.0, -1.0, -1.0, 1.0, -1.0];

/// NJ130-2.6: 2.6 m reach, 130 kg; the rods of a parallelogram keep the forearm's direction while the upper arm turns, so
/// joint 2 moves the forearm's link as much as joint 3.
///
/// Source: ukaea/CRCOpenROS2Driver, commit 85262f9a5011ca00a1a03b11df98f0f632d1779d. The flange is the description's last
/// link, 165 mm from the wrist's centre, its z axis pointing into it; another source has 210 mm, and neither gives the
/// published reach of 2.980 m: measure the tool from a taught pose. Where sources differ the narrower limits stand here
/// (joint 2: 60°, another source 95°; joint 6: ±720°, another ±2700°).
pub const NJ130: Arm<6> = Arm {
    joints: [
        Joint::REVOLUTE,
        Joint::REVOLUTE,
        Joint { kind: JointKind::Revolute, coupling: Some(Coupling { joint: 1, factor: 1.0 }) },
        Joint::REVOLUTE,
        Joint::REVOLUTE,
        Joint::REVOLUTE,
    ],
    last_from_flange: Some(turned([-1.0, 1.0, -1.0])),
    position_min: positions([-180.0, -75.0, -256.0, -280.0, -120.0, -720.0]),
    position_max: positions([180.0, 60.0, -10.0, 280.0, 120.0, 720.0]),
    velocity_max: speeds([110.0, 110.0, 110.0, 190.0, 190.0, 230.0]),
    acceleration_max: Rating::Known(JointAcc(radians([600.0, 500.0, 850.0, 3400.0, 3300.0, 4200.0]))),
    ..Opw { a1: 0.35, a2: -0.25, b: 0.0, c1: 0.83, c2: 1.16, c3: 1.10558, c4: 0.165, signs: SIGNS, offsets: [0.0; 6] }
        .arm("nj130-2.6")
};

/// NS12-1.85: 1.85 m reach, 12 kg. **Unverified**: lengths and limits are from one source that nothing confirms, which says
/// neither how a2 points nor how the joints count: both are taken here as on the [`NJ130`], without its parallelogram.
/// Compare with poses of your robot before you trust it. The flange's z axis points out of it; ratings are unknown.
pub const NS12: Arm<6> = Arm {
    position_min: positions([-180.0, -60.0, -170.0, -720.0, -120.0, -720.0]),
    position_max: positions([180.0, 155.0, 110.0, 720.0, 120.0, 720.0]),
    ..Opw { a1: 0.3, a2: -0.185, b: 0.0, c1: 0.6, c2: 0.7, c3: 0.83, c4: 0.12, signs: SIGNS, offsets: [0.0; 6] }
        .arm("ns12-1.85")
};
