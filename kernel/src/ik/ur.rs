//! Closed-form inverse kinematics of UR-type arms: joints 2, 3 and 4 parallel, joint 5 square to them.
//!
//! Derivation from the DH table in [`crate::arms::ur`]; the same geometry as Hawkins, "Analytic Inverse Kinematics for the
//! Universal Robots UR-5/UR-10 Arms" (Georgia Tech, 2013). With n = (sin θ₁, −cos θ₁, 0), the common axis of joints 2 to 4,
//! and X, Y, Z the flange axes: n·Z = cos θ₅, n·X = sin θ₅ cos θ₆, n·Y = −sin θ₅ sin θ₆.

use super::{Answer, Branches, IkError, Missed, check, distance, turn_between, turned};
use crate::arm::Arm;
use crate::pose::Pose;
use crate::units::JointPos;
use core::f64::consts::FRAC_PI_2;
use nalgebra::Vector3;

/// Lengths (m) within which rounding, not geometry, decides that a pose is out of reach.
const REACH_TOLERANCE: f64 = 1e-10;
/// |sin θ₅| below which joints 4 and 6 are collinear and θ₆ is taken from the seed.
const WRIST_SINGULAR: f64 = 1e-12;

/// Every branch (shoulder × wrist × elbow) that reaches the pose, each joint turned by full turns to lie nearest to `seed`
/// and inside the limits. At the wrist singularity θ₆ is the seed's.
///
/// # Errors
/// [`IkError`] when the pose is not finite, out of reach, or only reached beyond the joint limits.
pub fn inverse(arm: &Arm<6>, base_from_flange: &Pose, seed: &JointPos<6>) -> Result<Branches<6>, IkError> {
    check(base_from_flange, seed)?;
    let mut found = Branches::empty();
    let mut missed = Missed::nothing();
    let shoulder = shoulder(arm, base_from_flange)?;
    for (theta1, wrist) in shoulder.iter().flat_map(|&theta1| [(theta1, 1.0), (theta1, -1.0)]) {
        let forearm = Forearm::new(base_from_flange, seed, theta1, wrist);
        match forearm.elbows(arm, base_from_flange) {
            Ok(elbows) => {
                for theta3 in elbows.bends {
                    match turned(arm, &forearm.joints(arm, &elbows, theta3), seed) {
                        Ok(joints) => found.push(answer(joints)),
                        Err(beyond) => missed.limit(beyond),
                    }
                }
            }
            Err(by) => missed.reach(by),
        }
    }
    if found.as_slice().is_empty() { Err(missed.error()) } else { Ok(found) }
}

const fn answer(joints: JointPos<6>) -> Answer<6> {
    Answer { joints, branch: None, margins: None, free: None }
}

/// The branch nearest to `seed`, by the largest joint difference. Branches that one joint alone puts farther away than the
/// best so far are not computed: when the seed is near, one of eight is.
///
/// # Errors
/// As [`inverse`].
pub fn nearest(arm: &Arm<6>, base_from_flange: &Pose, seed: &JointPos<6>) -> Result<Answer<6>, IkError> {
    check(base_from_flange, seed)?;
    let mut best = (f64::INFINITY, *seed);
    let [mut near, mut far] = shoulder(arm, base_from_flange)?;
    if turn_between(far, seed.0[0]) < turn_between(near, seed.0[0]) {
        (near, far) = (far, near);
    }
    let side = if libm::sin(seed.0[4]) < 0.0 { -1.0 } else { 1.0 };
    for (theta1, wrist) in [(near, side), (near, -side), (far, side), (far, -side)] {
        if turn_between(theta1, seed.0[0]) >= best.0 {
            continue;
        }
        let forearm = Forearm::new(base_from_flange, seed, theta1, wrist);
        if turn_between(forearm.theta5, seed.0[4]) >= best.0 {
            continue;
        }
        let Ok(elbows) = forearm.elbows(arm, base_from_flange) else { continue };
        for theta3 in elbows.bends {
            if turn_between(theta3, seed.0[2]) >= best.0 {
                continue;
            }
            if let Ok(joints) = turned(arm, &forearm.joints(arm, &elbows, theta3), seed) {
                let distance = distance(&joints, seed);
                if distance < best.0 {
                    best = (distance, joints);
                }
            }
        }
    }
    if best.0.is_finite() {
        return Ok(answer(best.1));
    }
    // Only to say why: every branch was tried.
    inverse(arm, base_from_flange, seed).map(|_| answer(best.1))
}

/// θ₁: frame 5's origin keeps the distance d₄ from the plane of the upper arm.
fn shoulder(arm: &Arm<6>, base_from_flange: &Pose) -> Result<[f64; 2], IkError> {
    let wrist = base_from_flange.translation - base_from_flange.rotation.column(2) * arm.dh[5].d;
    let d4 = arm.dh[3].d;
    let squared = wrist.x * wrist.x + wrist.y * wrist.y - d4 * d4;
    let missing = libm::fabs(d4) - libm::hypot(wrist.x, wrist.y);
    if missing > REACH_TOLERANCE {
        return Err(IkError::OutOfReach { by: missing });
    }
    let direction = libm::atan2(wrist.y, wrist.x) + FRAC_PI_2;
    let half = libm::atan2(libm::sqrt(squared.max(0.0)), d4);
    Ok([direction + half, direction - half])
}

/// For one θ₁ and one sign of sin θ₅: the wrist's joints, and what the arm's plane sees of them.
struct Forearm {
    theta1: f64,
    theta5: f64,
    theta6: f64,
    /// The arm's plane, horizontally.
    along: Vector3<f64>,
    /// sin and cos of θ₂ + θ₃ + θ₄.
    sine234: f64,
    cosine234: f64,
}

/// Where frame 4's origin lies in the arm's plane, seen from the shoulder, and the two bends of the elbow that reach it.
struct Elbows {
    px: f64,
    py: f64,
    bends: [f64; 2],
}

impl Forearm {
    fn new(pose: &Pose, seed: &JointPos<6>, theta1: f64, wrist: f64) -> Self {
        let (s1, c1) = libm::sincos(theta1);
        let along = Vector3::new(c1, s1, 0.0);
        let normal = Vector3::new(s1, -c1, 0.0);
        let (x6, y6, z6) = (pose.rotation.column(0), pose.rotation.column(1), pose.rotation.column(2));
        let (nx, ny) = (normal.dot(&x6), normal.dot(&y6));
        let s5 = wrist * libm::hypot(nx, ny);
        let theta5 = libm::atan2(s5, normal.dot(&z6));
        let theta6 = if libm::fabs(s5) < WRIST_SINGULAR { seed.0[5] } else { libm::atan2(-ny * wrist, nx * wrist) };

        // Frame 5's y axis is minus frame 4's z axis; its components in the arm's plane give θ₂ + θ₃ + θ₄.
        let (s6, c6) = libm::sincos(theta6);
        let y5 = x6 * s6 + y6 * c6;
        Self { theta1, theta5, theta6, along, sine234: -along.dot(&y5), cosine234: y5.z }
    }

    /// Or by how much (m) the planar part is too short.
    fn elbows(&self, arm: &Arm<6>, pose: &Pose) -> Result<Elbows, f64> {
        let elbow_to_wrist = pose.translation - pose.rotation.column(2) * arm.dh[5].d;
        let px = self.along.dot(&elbow_to_wrist) - arm.dh[4].d * self.sine234;
        let py = elbow_to_wrist.z - arm.dh[0].d + arm.dh[4].d * self.cosine234;
        let (upper, fore) = (libm::fabs(arm.dh[1].a), libm::fabs(arm.dh[2].a));
        let reach = libm::hypot(px, py);
        let missing = (reach - (upper + fore)).max(libm::fabs(upper - fore) - reach);
        if missing > REACH_TOLERANCE {
            return Err(missing);
        }
        // Half-angle form of the law of cosines: accurate also where the elbow is nearly straight.
        let straight = ((upper + fore) - reach) * ((upper + fore) + reach);
        let folded = (reach - (upper - fore)) * (reach + (upper - fore));
        let bend = 2.0 * libm::atan2(libm::sqrt(straight.max(0.0)), libm::sqrt(folded.max(0.0)));
        Ok(Elbows { px, py, bends: [bend, -bend] })
    }

    fn joints(&self, arm: &Arm<6>, elbows: &Elbows, theta3: f64) -> JointPos<6> {
        let (a2, a3) = (arm.dh[1].a, arm.dh[2].a);
        let (s3, c3) = libm::sincos(theta3);
        let theta2 = libm::atan2(elbows.py, elbows.px) - libm::atan2(a3 * s3, a2 + a3 * c3);
        let theta234 = libm::atan2(self.sine234, self.cosine234);
        JointPos([self.theta1, theta2, theta3, theta234 - theta2 - theta3, self.theta5, self.theta6])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arms::ur::UR10E;
    use core::f64::consts::PI;

    /// splitmix64, as a number in [-π, π].
    fn angle(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 * PI - PI
    }

    #[test]
    fn nearest_is_the_nearest_of_all_branches_from_near_and_far_seeds() {
        let mut state = 5;
        let mut joints = || JointPos(core::array::from_fn(|_| angle(&mut state)));
        for case in 0..20_000 {
            let (goal, other) = (joints(), joints());
            let share = [1.0, 0.1, 1e-3, 1e-6][case % 4];
            let seed = JointPos(core::array::from_fn(|i| goal.0[i] + share * other.0[i]));
            let pose = UR10E.forward(&goal);
            let distance = |joints: &JointPos<6>| {
                joints.0.iter().zip(&seed.0).fold(0.0, |far: f64, (a, b)| far.max(libm::fabs(a - b)))
            };
            let nearest = nearest(&UR10E, &pose, &seed).unwrap();
            let all = inverse(&UR10E, &pose, &seed).unwrap();
            assert!(all.as_slice().contains(&nearest), "seed {seed:?}");
            let least = all.as_slice().iter().map(|answer| distance(&answer.joints)).fold(f64::INFINITY, f64::min);
            assert_eq!(distance(&nearest.joints), least, "seed {seed:?}");
        }
    }
}
