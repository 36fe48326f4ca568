//! KUKA arms. Base: ROBROOT; flange: z out of it. Joints zero: upper arm and forearm level, along x.
//!
//! Sources: ros-industrial/kuka_experimental, commit e78bbd15edb2b39c9053ff3b963ef2947e10a531 (KR 120 R2500 pro);
//! kroshu/kuka_robot_descriptions, commit 7766e92afcfd71c06d98cd5e54cbb857eabd015d (KR 210 R2700-2).

use super::opw::{Opw, positions, speeds};
use crate::arm::{Arm, Rating};
use core::f64::consts::FRAC_PI_2;

const fn quantec(a1: f64, a2: f64, c1: f64, c3: f64) -> Opw {
    let signs = [-1.0, 1.0, 1.0, -1.0, 1.0, -1.0];
    Opw { a1, a2, b: 0.0, c1, c2: 1.15, c3, c4: 0.215, signs, offsets: [0.0, -FRAC_PI_2, 0.0, 0.0, 0.0, 0.0] }
}

/// KR 120 R2500 pro: 2.5 m reach, 120 kg. No source for accelerations.
pub const KR120_R2500: Arm<6> = Arm {
    position_min: positions([-185.0, -155.0, -130.0, -350.0, -130.0, -350.0]),
    position_max: positions([185.0, 35.0, 154.0, 350.0, 130.0, 350.0]),
    velocity_max: speeds([156.0, 156.0, 156.0, 330.0, 330.0, 615.0]),
    ..quantec(0.35, 0.041, 0.675, 1.0).arm("kr120-r2500-pro")
};

/// KR 210 R2700-2: 2.7 m reach, 210 kg. No reliable source for speeds, none for accelerations.
pub const KR210_R2700: Arm<6> = Arm {
    position_min: positions([-185.0, -140.0, -120.0, -350.0, -125.0, -350.0]),
    position_max: positions([185.0, -5.0, 168.0, 350.0, 125.0, 350.0]),
    velocity_max: Rating::Unknown,
    ..quantec(0.33, -0.115, 0.645, 1.22).arm("kr210-r2700-2")
};
