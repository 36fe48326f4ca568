//! An arm on a crane.

use super::comau::NJ130;
use super::gantry::{BASE_FROM_ZERO, SLIDES};
use crate::arm::{Arm, Coupling, Joint, Rating};
use crate::units::JointPos;

/// Lengthwise, crosswise and upward slides of an overhead crane, with an [`NJ130`] hanging upside down from the last: the
/// platform of Crivelli et al. (KRAKEN). Its workspace of 22 m by 4 m by 2 m is published and taken as the slides' strokes;
/// where the upward stroke begins is not, and is 2.5 m above the floor here; nor are its speeds and accelerations: replace
/// what your crane has otherwise. Base: on the floor, x along the rails, z up. Slide 3 reads the height of the plane that the
/// arm hangs from.
pub const CRANE_NJ130: Arm<9> = Arm {
    name: "crane-nj130",
    base_from_zero: Some(BASE_FROM_ZERO),
    dh: {
        let [x, y, z] = SLIDES;
        let [first, second, third, fourth, fifth, sixth] = NJ130.dh;
        [x, y, z, first, second, third, fourth, fifth, sixth]
    },
    joints: {
        let mut joints = [Joint::PRISMATIC; 9];
        let mut joint = 0;
        while joint < 6 {
            joints[joint + 3] = carried(NJ130.joints[joint]);
            joint += 1;
        }
        joints
    },
    last_from_flange: NJ130.last_from_flange,
    position_min: after([0.0, 0.0, 2.5], NJ130.position_min),
    position_max: after([22.0, 4.0, 4.5], NJ130.position_max),
    velocity_max: Rating::Unknown,
    acceleration_max: Rating::Unknown,
};

/// The joint of an arm that three slides carry.
const fn carried(joint: Joint) -> Joint {
    match joint.coupling {
        Some(Coupling { joint: moving, factor }) => {
            Joint { coupling: Some(Coupling { joint: moving + 3, factor }), ..joint }
        }
        None => joint,
    }
}

const fn after(slides: [f64; 3], arm: JointPos<6>) -> JointPos<9> {
    let [x, y, z] = slides;
    let [first, second, third, fourth, fifth, sixth] = arm.0;
    JointPos([x, y, z, first, second, third, fourth, fifth, sixth])
}
