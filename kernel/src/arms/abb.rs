//! ABB arms. Joints zero: upper arm upright, forearm level, along x. No source for accelerations.
//!
//! Sources: fbarbosac/ABB_IRB140_UNAL, commit 459f6c8ed9bc6de4beb47d2ff857adbf274cde7d (IRB 140: a university's description,
//! not ABB's); ros-industrial/abb_experimental, commit 20b9cf86ad274e4f98540b9c9efe59f94245d2d1 (IRB 6700).

use super::opw::{Opw, positions, speeds};
use crate::arm::Arm;
use crate::pose::Pose;
use core::f64::consts::FRAC_PI_2;
use nalgebra::{Matrix3, Vector3};

const UPRIGHT: [f64; 6] = [0.0, 0.0, -FRAC_PI_2, 0.0, 0.0, 0.0];

/// IRB 140: 0.8 m reach, 6 kg. The flange's x axis points out of it, as in the description.
pub const IRB140: Arm<6> = Arm {
    last_from_flange: Some(Pose {
        rotation: Matrix3::new(0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0),
        translation: Vector3::new(0.0, 0.0, 0.0),
    }),
    position_min: positions([-180.0, -90.0, -230.0, -200.0, -115.0, -400.0]),
    position_max: positions([180.0, 110.0, 50.0, 200.0, 115.0, 400.0]),
    velocity_max: speeds([200.0, 200.0, 260.0, 360.0, 360.0, 450.0]),
    ..Opw { a1: 0.07, a2: 0.0, b: 0.0, c1: 0.352, c2: 0.36, c3: 0.38, c4: 0.065, signs: [1.0; 6], offsets: UPRIGHT }
        .arm("irb140")
};

/// IRB 6700-200/2.60: 2.6 m reach, 200 kg. The flange's z axis points out of it.
pub const IRB6700_200: Arm<6> = Arm {
    position_min: positions([-170.0, -65.0, -180.0, -300.0, -130.0, -360.0]),
    position_max: positions([170.0, 85.0, 70.0, 300.0, 130.0, 360.0]),
    velocity_max: speeds([110.0, 110.0, 110.0, 190.0, 150.0, 210.0]),
    ..Opw { a1: 0.32, a2: -0.2, b: 0.0, c1: 0.78, c2: 1.125, c3: 1.1425, c4: 0.2, signs: [1.0; 6], offsets: UPRIGHT }
        .arm("irb6700-200-2.60")
};
