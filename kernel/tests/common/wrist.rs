//! Arms with a spherical wrist: where their singularities are, by the formulas of Brandstötter, Angerer, Hofbaur (2014) in the
//! angles of their tables.

use super::Random;
use super::inverse::{Family, Found, MISS_MAX, random_joints};
use screed_kernel::arm::Arm;
use screed_kernel::arms::{abb, comau, crane, kuka};
use screed_kernel::ik::{Margins, gantry, wrist};
use screed_kernel::units::JointPos;
use std::f64::consts::PI;

/// Arms whose last six joints have a spherical wrist.
pub const fn family<const N: usize>() -> Family<N> {
    Family { inverse: wrist::inverse, nearest: wrist::nearest, margins, place: [shoulder, elbow, hand] }
}

/// Those of the catalogue.
pub const ARMS: [Arm<6>; 6] =
    [kuka::KR120_R2500, kuka::KR210_R2700, abb::IRB140, abb::IRB6700_200, comau::NJ130, comau::NS12];

/// The same arm with so much room for its joints that every singularity lies inside.
pub const fn wide<const N: usize>(arm: Arm<N>) -> Arm<N> {
    Arm { position_min: JointPos([-30.0; N]), position_max: JointPos([30.0; N]), ..arm }
}

/// The planar arm of joints 2 and 3: in front of axis 1 (m), upper arm, forearm (m), the forearm's angle in the table, and
/// the sense of joint 3.
fn planar<const N: usize>(arm: &Arm<N>) -> [f64; 5] {
    let [one, two, three, four] = [N - 6, N - 5, N - 4, N - 3].map(|link| arm.dh[link]);
    let across = -two.cos_alpha * three.sin_alpha * four.d;
    [one.a, two.a, three.a.hypot(across), across.atan2(three.a), two.cos_alpha]
}

fn coupled<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>, joint: usize) -> f64 {
    arm.joints[joint].coupling.map_or(0.0, |coupling| coupling.factor * joints.0[coupling.joint])
}

/// The table's angle of one of the last six joints.
fn angle<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>, of: usize) -> f64 {
    let joint = N - 6 + of;
    arm.dh[joint].theta + joints.0[joint] + coupled(arm, joints, joint)
}

/// Gives some of the last six joints their angles; the angles after them stay.
fn set_angles<const N: usize>(arm: &Arm<N>, joints: &mut JointPos<N>, angles: &[(usize, f64)]) {
    let mut all: [f64; 6] = std::array::from_fn(|of| angle(arm, joints, of));
    for (of, angle) in angles {
        all[*of] = *angle;
    }
    for (joint, angle) in (N - 6..N).zip(all) {
        joints.0[joint] = angle - arm.dh[joint].theta - coupled(arm, joints, joint);
    }
}

fn margins<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>) -> Margins {
    let [a1, upper, fore, fore_angle, sense] = planar(arm);
    let [_, theta2, theta3, _, theta5, _] = std::array::from_fn(|of| angle(arm, joints, of));
    let bend = sense * theta3 + fore_angle;
    let ahead = a1 + upper * theta2.cos() + fore * (theta2 + bend).cos();
    Margins { shoulder: ahead.abs() / (upper.abs() + fore), elbow: bend.sin().abs(), wrist: theta5.sin().abs() }
}

/// The wrist's centre so far (m) in front of axis 1; where the elbow is folded too far for that, as near as it comes.
fn shoulder<const N: usize>(arm: &Arm<N>, joints: &mut JointPos<N>, by: f64, random: &mut Random) {
    let [a1, upper, fore, fore_angle, sense] = planar(arm);
    let bend = sense * angle(arm, joints, 2) + fore_angle;
    let (along, across) = (upper + fore * bend.cos(), fore * bend.sin());
    let half = ((by - a1) / along.hypot(across)).clamp(-1.0, 1.0).acos();
    let theta2 = if random.below(2) == 0 { half } else { -half } - across.atan2(along);
    set_angles(arm, joints, &[(1, theta2)]);
}

/// Stretched, and now and then folded.
fn elbow<const N: usize>(arm: &Arm<N>, joints: &mut JointPos<N>, by: f64, random: &mut Random) {
    let [.., fore_angle, sense] = planar(arm);
    let bend = [0.0, 0.0, 0.0, PI][random.below(4) as usize] + by;
    set_angles(arm, joints, &[(2, sense * (bend - fore_angle))]);
}

fn hand<const N: usize>(arm: &Arm<N>, joints: &mut JointPos<N>, by: f64, random: &mut Random) {
    set_angles(arm, joints, &[(4, [0.0, PI, -PI][random.below(3) as usize] + by)]);
}

/// Three slides and a turn: no branches, no singularities.
pub const GANTRY: Family<4> = Family {
    inverse: gantry::inverse,
    nearest: gantry::nearest,
    margins: |_, _| Margins { shoulder: 1.0, elbow: 1.0, wrist: 1.0 },
    place: [|_, _, _, _| (), |_, _, _, _| (), |_, _, _, _| ()],
};

/// Random poses of the arm on the crane, which stands where the pose was made.
pub fn on_the_crane(seed: u64, count: u64) -> Found {
    let (arm, mut random, mut found) = (&crane::CRANE_NJ130, Random(seed), Found::default());
    for _ in 0..count {
        let joints = random_joints(arm, &mut random);
        let pose = arm.forward(&joints);
        let all = wrist::inverse(arm, &pose, &joints).unwrap_or_else(|error| panic!("{joints:?}: {error:?}"));
        found.poses += 1;
        for answer in all.as_slice() {
            let back = arm.forward(&answer.joints);
            let position = (back.translation - pose.translation).norm();
            let rotation = (back.rotation - pose.rotation).norm() / 2_f64.sqrt();
            assert!(position <= MISS_MAX && rotation <= MISS_MAX, "{joints:?}: {position:e} {rotation:e}: {answer:?}");
            assert_eq!(answer.joints.0[..3], joints.0[..3], "the crane moved");
            found.answers += 1;
            found.free += u64::from(answer.free.is_some());
            (found.position, found.rotation) = (found.position.max(position), found.rotation.max(rotation));
        }
        let tracked = wrist::nearest(arm, &pose, &joints).expect("an answer");
        let margins = tracked.margins.expect("margins");
        let way = tracked.joints.0.iter().zip(&joints.0).fold(0.0, |far: f64, (a, b)| far.max((a - b).abs()));
        found.joints = found.joints.max(way * margins.shoulder.min(1.0) * margins.elbow * margins.wrist);
        assert!(tracked.free.is_some() || found.joints < 2e-14, "{joints:?}: {tracked:?}");
    }
    found
}
