//! Inverse kinematics on and beside singularities, of every family.

use crate::hash::Fnv;
use crate::random::Random;
use screed_kernel::arm::{Arm, Dh};
use screed_kernel::arms::kuka::KR120_R2500;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ik::{Answer, Family, IkError, turns};
use screed_kernel::units::JointPos;

/// A UR10e whose axes 2 and 3 are `tilt` (rad, small) out of parallel and a long way along them to and fro.
fn tilted(tilt: f64) -> Arm<6> {
    let (sine, cosine) = libm::sincos(tilt);
    let [first, second, third, others @ ..] = UR10E.dh;
    let second = Dh { sin_alpha: sine, cos_alpha: cosine, d: 4.0, ..second };
    let third = Dh { d: -4.0, ..third };
    let [fourth, fifth, sixth] = others;
    Arm { name: "tilted", dh: [first, second, third, fourth, fifth, sixth], ..UR10E }
}

/// A random arm's answers to a pose with a random distance, of none to 1e-3, from a singularity.
pub fn hash(hash: &mut Fnv, random: &mut Random) {
    let arm = match random.below(4) {
        0 | 1 => UR10E,
        2 => KR120_R2500,
        _ => tilted(random.between(-0.1, 0.1)),
    };
    let mut joints = JointPos([0.0; 6]);
    for position in &mut joints.0 {
        *position = random.between(-1.5, 1.5);
    }
    let beside = [0.0, 1e-13, 1e-10, 1e-7, 1e-3][random.below(5) as usize];
    // The elbow, the wrist, both, neither.
    match random.below(4) {
        0 => joints.0[2] = beside,
        1 => joints.0[4] = -beside,
        2 => (joints.0[2], joints.0[4]) = (beside, beside),
        _ => {}
    }
    let mut seed = joints;
    for position in &mut seed.0 {
        *position += random.between(-0.01, 0.01);
    }
    let (pose, family) = (arm.forward(&joints), Family::of(&arm));
    match family.inverse(&arm, &pose, &seed) {
        Ok(found) => found.as_slice().iter().for_each(|found| answer(hash, found)),
        Err(error) => refusal(hash, &error),
    }
    match family.nearest(&arm, &pose, &seed) {
        Ok(found) => {
            answer(hash, &found);
            hash.integer(turns(&arm, &found.joints).count() as u64);
        }
        Err(error) => refusal(hash, &error),
    }
}

fn answer(hash: &mut Fnv, answer: &Answer<6>) {
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
