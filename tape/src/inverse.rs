//! Kinematics on and beside singularities: every family of inverse, the Jacobian and what it says.

use crate::hash::Fnv;
use crate::random::Random;
use screed_kernel::arm::{Arm, Dh};
use screed_kernel::arms::comau::NJ130;
use screed_kernel::arms::gantry::CONTOUR_CRAFTER;
use screed_kernel::arms::kuka::KR120_R2500;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::dexterity::Dexterity;
use screed_kernel::ik::{Answer, Family, IkError, turns};
use screed_kernel::units::JointPos;

/// How far from its limits' middle a joint goes at most (rad, m).
const FAR: f64 = 4.0;

/// A UR10e whose axes 2 and 3 are `tilt` (rad, small) out of parallel and a long way along them to and fro.
pub(crate) fn tilted(tilt: f64) -> Arm<6> {
    let (sine, cosine) = libm::sincos(tilt);
    let [first, second, third, others @ ..] = UR10E.dh;
    let second = Dh { sin_alpha: sine, cos_alpha: cosine, d: 4.0, ..second };
    let third = Dh { d: -4.0, ..third };
    let [fourth, fifth, sixth] = others;
    Arm { name: "tilted", dh: [first, second, third, fourth, fifth, sixth], ..UR10E }
}

/// The arm with axis 6 `offset` (m) beside axis 5 and turned by as many rad: a unit's wrist while that is small, no wrist at all
/// when it is not.
pub(crate) fn displaced(arm: &Arm<6>, offset: f64) -> Arm<6> {
    let (sine, cosine) = libm::sincos(offset);
    let [first, second, third, fourth, fifth, sixth] = arm.dh;
    let (sin_alpha, cos_alpha) =
        (fifth.sin_alpha * cosine + fifth.cos_alpha * sine, fifth.cos_alpha * cosine - fifth.sin_alpha * sine);
    let fifth = Dh { a: fifth.a + offset, sin_alpha, cos_alpha, ..fifth };
    Arm { name: "displaced", dh: [first, second, third, fourth, fifth, sixth], ..*arm }
}

/// A random arm's answers to a pose with a random distance, of none to 1e-3, from a singularity. Returns which arm it was:
/// UR type, spherical wrist, with a parallelogram, either of the two calibrated, by iteration alone, gantry.
pub fn hash(hash: &mut Fnv, random: &mut Random) -> usize {
    // Where joint 3 stretches the arm, with joint 2 at zero: axis 4 in line with axes 2 and 3.
    let stretched = |a2: f64, c3: f64| libm::atan2(a2, c3);
    match random.below(12) {
        0 | 1 => {
            solve(&UR10E, 0.0, hash, random);
            0
        }
        2 | 3 => {
            solve(&KR120_R2500, -stretched(0.041, 1.0), hash, random);
            1
        }
        4 | 5 => {
            solve(&NJ130, stretched(-0.25, 1.10558), hash, random);
            2
        }
        6 => {
            solve(&tilted(random.between(-0.04, 0.04)), 0.0, hash, random);
            3
        }
        7 => {
            let arm = displaced(&KR120_R2500, random.between(-0.003, 0.003));
            solve(&arm, -stretched(0.041, 1.0), hash, random);
            4
        }
        8 => {
            solve(&displaced(&UR10E, 0.3), 0.0, hash, random);
            5
        }
        _ => {
            solve(&CONTOUR_CRAFTER, 0.0, hash, random);
            6
        }
    }
}

/// `elbow`: where joint 3 stretches an arm of six joints.
fn solve<const N: usize>(arm: &Arm<N>, elbow: f64, hash: &mut Fnv, random: &mut Random) {
    let joints = posture(arm, elbow, random);
    let mut seed = joints;
    for position in &mut seed.0 {
        *position += random.between(-0.01, 0.01);
    }
    let (pose, jacobian) = arm.jacobian(&joints);
    let Dexterity { manipulability, singular_value_min, singular_value_max } = Dexterity::of(&jacobian);
    for value in jacobian.iter().chain(&[manipulability, singular_value_min, singular_value_max]) {
        hash.number(*value);
    }
    let family = Family::of(arm);
    hash.bytes(family.name().as_bytes());
    match family.inverse(arm, &pose, &seed) {
        Ok(found) => {
            found.as_slice().iter().for_each(|found| answer(hash, found));
            hash.number(found.residual(arm, &pose));
        }
        Err(error) => refusal(hash, &error),
    }
    match family.nearest(arm, &pose, &seed) {
        Ok(found) => {
            answer(hash, &found);
            hash.integer(turns(arm, &found.joints).count() as u64);
        }
        Err(error) => refusal(hash, &error),
    }
}

/// Joints inside the limits or a little beyond; now and then the elbow, the wrist or both (almost) singular.
fn posture<const N: usize>(arm: &Arm<N>, elbow: f64, random: &mut Random) -> JointPos<N> {
    let mut joints = JointPos::ZERO;
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    for (position, (low, high)) in joints.0.iter_mut().zip(limits) {
        let middle = 0.5 * (low + high);
        let half = (0.5 * (high - low) + 0.02).min(FAR);
        *position = random.between(middle - half, middle + half);
    }
    let beside = [0.0, 1e-13, 1e-10, 1e-7, 1e-3][random.below(5) as usize];
    let which = random.below(4);
    if let [_, second, third, _, fifth, _] = joints.0.as_mut_slice() {
        let moved = arm.joints.get(2).and_then(|joint| joint.coupling).map_or(0.0, |coupling| coupling.factor);
        if which == 0 || which == 2 {
            *third = elbow + beside - moved * *second;
        }
        if which == 1 || which == 2 {
            *fifth = -beside;
        }
    }
    joints
}

fn answer<const N: usize>(hash: &mut Fnv, answer: &Answer<N>) {
    for position in &answer.joints.0 {
        hash.number(*position);
    }
    if let Some(margins) = &answer.margins {
        hash.number(margins.nearest().1);
    }
    hash.integer(answer.free.map_or(0, |joint| joint as u64 + 1));
}

fn refusal(hash: &mut Fnv, error: &IkError) {
    let (kind, value) = match error {
        IkError::OutOfReach { by } => (1, *by),
        IkError::Limit { position, .. } => (2, *position),
        IkError::NotConverged { residual } => (3, *residual),
        _ => (4, 0.0),
    };
    hash.integer(kind);
    hash.number(value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arms_are_of_the_families_that_they_stand_for() {
        assert!(matches!(Family::of(&UR10E), Family::Ur(_)));
        assert!(matches!(Family::of(&KR120_R2500), Family::Wrist(_)));
        assert!(matches!(Family::of(&NJ130), Family::Wrist(_)));
        for size in [-1.0, -0.5, 0.3, 1.0] {
            assert!(matches!(Family::of(&tilted(0.04 * size)), Family::Calibrated(_)));
            assert!(matches!(Family::of(&displaced(&KR120_R2500, 0.003 * size)), Family::Calibrated(_)));
        }
        assert!(matches!(Family::of(&displaced(&UR10E, 0.3)), Family::Numeric));
        assert!(matches!(Family::of(&CONTOUR_CRAFTER), Family::Gantry(_)));
    }
}
