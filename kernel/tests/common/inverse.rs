//! Forward kinematics of the inverse, at random poses and on and beside singularities.

use super::Random;
use screed_kernel::arm::Arm;
use screed_kernel::ik::{Answer, Branches, IkError, Margins, ur};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use std::f64::consts::PI;

/// What an answer may miss (m, rad).
pub const MISS_MAX: f64 = 1e-12;
/// How far joints may be from those that the pose was made of, times the product of the margins (rad): what rounding does.
/// A joint that moves farther is a jump that the answer does not report.
const JOINT_NOISE: f64 = 2e-14;
/// The same where a joint is free and comes from the seed: that margin does not count then, the other two do.
const JOINT_NOISE_FREE: f64 = 1e-12;

/// A closed form, for a family of arms.
#[derive(Clone, Copy)]
pub struct Family<const N: usize> {
    pub inverse: fn(&Arm<N>, &Pose, &JointPos<N>) -> Result<Branches<N>, IkError>,
    pub nearest: fn(&Arm<N>, &Pose, &JointPos<N>) -> Result<Answer<N>, IkError>,
    /// How far joints are from each singularity, by their definition.
    pub margins: fn(&Arm<N>, &JointPos<N>) -> Margins,
    /// Puts joints so far from a singularity (rad, m; with sign): shoulder, elbow, wrist.
    pub place: [fn(&Arm<N>, &mut JointPos<N>, f64, &mut Random); 3],
}

/// The UR type.
pub const UR: Family<6> = Family {
    inverse: ur::inverse,
    nearest: ur::nearest,
    margins: ur_margins,
    place: [ur_shoulder, ur_elbow, ur_wrist],
};

/// What a campaign found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Found {
    pub poses: u64,
    pub answers: u64,
    /// Answers at a singularity, with a joint from the seed.
    pub free: u64,
    /// The worst miss (m, rad).
    pub position: f64,
    pub rotation: f64,
    /// The worst way from the pose's own joints to the answer on their branch, times the product of its margins (rad).
    pub joints: f64,
}

fn ur_margins(arm: &Arm<6>, joints: &JointPos<6>) -> Margins {
    let (a2, a3, d4, d5) = (arm.dh[1].a, arm.dh[2].a, arm.dh[3].d, arm.dh[4].d);
    let [_, q2, q3, q4, q5, _] = joints.0;
    let along = a2 * q2.cos() + a3 * (q2 + q3).cos() + d5 * (q2 + q3 + q4).sin();
    Margins { shoulder: along.abs() / along.hypot(d4), elbow: q3.sin().abs(), wrist: q5.sin().abs() }
}

fn ur_shoulder(arm: &Arm<6>, joints: &mut JointPos<6>, by: f64, random: &mut Random) {
    let (a2, a3, d5) = (arm.dh[1].a, arm.dh[2].a, arm.dh[4].d);
    let [_, _, q3, q4, _, _] = joints.0;
    let (x, y) = (a2 + a3 * q3.cos() + d5 * (q3 + q4).sin(), d5 * (q3 + q4).cos() - a3 * q3.sin());
    // h = x·cos θ₂ + y·sin θ₂.
    let half = (by / x.hypot(y)).clamp(-1.0, 1.0).acos();
    joints.0[1] = y.atan2(x) + if random.below(2) == 0 { half } else { -half };
}

fn ur_elbow(_: &Arm<6>, joints: &mut JointPos<6>, by: f64, random: &mut Random) {
    // Stretched, and now and then folded.
    joints.0[2] = [0.0, 0.0, 0.0, PI][random.below(4) as usize] + by;
}

fn ur_wrist(_: &Arm<6>, joints: &mut JointPos<6>, by: f64, random: &mut Random) {
    joints.0[4] = [0.0, PI, -PI][random.below(3) as usize] + by;
}

/// Joints uniform within the limits, within ±360° where there are none.
pub fn random_joints<const N: usize>(arm: &Arm<N>, random: &mut Random) -> JointPos<N> {
    JointPos(std::array::from_fn(|joint| {
        let (low, high) = (arm.position_min.0[joint], arm.position_max.0[joint]);
        random.between(low.max(-2.0 * PI), high.min(2.0 * PI))
    }))
}

/// The joints' part of rounding: the product of the margins, and how much of it the answer has to keep.
fn conditioning<const N: usize>(answer: &Answer<N>) -> (f64, f64) {
    let Some(Margins { shoulder, elbow, wrist }) = answer.margins else { return (1.0, JOINT_NOISE) };
    match answer.free {
        None => (shoulder.min(1.0) * elbow * wrist, JOINT_NOISE),
        Some(0) => (elbow * wrist, JOINT_NOISE_FREE),
        Some(_) => (shoulder.min(1.0) * elbow, JOINT_NOISE_FREE),
    }
}

fn distance<const N: usize>(a: &JointPos<N>, b: &JointPos<N>) -> f64 {
    a.0.iter().zip(&b.0).fold(0.0, |far: f64, (a, b)| far.max((a - b).abs()))
}

impl<const N: usize> Family<N> {
    /// Every branch for the pose of some joints, from those joints, from beside them and from far away. Where two
    /// singularities meet, rounding near the one moves what is free at the other: there only the pose is judged.
    fn try_joints(&self, arm: &Arm<N>, joints: &JointPos<N>, random: &mut Random, found: &mut Found) {
        let pose = arm.forward(joints);
        found.poses += 1;
        let Margins { shoulder, elbow, wrist } = (self.margins)(arm, joints);
        let tracks = [shoulder, elbow, wrist].iter().filter(|margin| **margin < 0.01).count() <= 1;
        let all =
            (self.inverse)(arm, &pose, joints).unwrap_or_else(|error| panic!("{} {joints:?}: {error:?}", arm.name));
        self.judge_all(arm, &pose, joints, &all, found);
        // The answer on the seed's own branch is the seed, as far as the margins let it be known.
        let own = all.nearest(joints).expect("an answer");
        if tracks && own.free.is_none() {
            found.joints = found.joints.max(distance(&own.joints, joints) * conditioning(own).0);
        }
        if tracks {
            self.judge_way(arm, joints, own, joints, 0.0);
        }

        let tracked = (self.nearest)(arm, &pose, joints).expect("an answer");
        assert!(distance(&tracked.joints, joints) <= distance(&own.joints, joints) + 1e-15, "{} {joints:?}", arm.name);
        self.judge_pose(arm, &pose, joints, &tracked, found);

        let away = 10_f64.powf(random.between(-12.0, -1.0));
        let mut beside = *joints;
        for position in &mut beside.0 {
            *position += away * random.between(-1.0, 1.0);
        }
        let tracked = (self.nearest)(arm, &pose, &beside).expect("an answer");
        self.judge_pose(arm, &pose, joints, &tracked, found);
        if tracks {
            self.judge_way(arm, joints, &tracked, &beside, away);
        }
        let all = (self.inverse)(arm, &pose, &beside).expect("answers");
        let nearest = all.nearest(&beside).expect("an answer");
        assert!(
            distance(&tracked.joints, &beside) <= distance(&nearest.joints, &beside) + 1e-15,
            "{} {joints:?}",
            arm.name
        );

        let far = random_joints(arm, random);
        let all = (self.inverse)(arm, &pose, &far).unwrap_or_else(|error| panic!("{} {joints:?}: {error:?}", arm.name));
        self.judge_all(arm, &pose, joints, &all, found);
        let tracked = (self.nearest)(arm, &pose, &far).expect("an answer");
        let nearest = all.nearest(&far).expect("an answer");
        assert!(distance(&tracked.joints, &far) <= distance(&nearest.joints, &far), "{} {joints:?}", arm.name);
    }

    fn judge_all(&self, arm: &Arm<N>, pose: &Pose, joints: &JointPos<N>, all: &Branches<N>, found: &mut Found) {
        let answers = all.as_slice();
        for (k, answer) in answers.iter().enumerate() {
            self.judge_pose(arm, pose, joints, answer, found);
            let twice = answers[..k].iter().any(|other| answer.branch.is_some() && other.branch == answer.branch);
            assert!(!twice, "{} {joints:?}: two answers on {:?}", arm.name, answer.branch);
        }
    }

    fn judge_pose(&self, arm: &Arm<N>, pose: &Pose, joints: &JointPos<N>, answer: &Answer<N>, found: &mut Found) {
        let back = arm.forward(&answer.joints);
        let position = (back.translation - pose.translation).norm();
        let rotation = (back.rotation - pose.rotation).norm() / 2_f64.sqrt();
        assert!(
            position <= MISS_MAX && rotation <= MISS_MAX,
            "{} {joints:?}: {position:e} {rotation:e}: {answer:?}",
            arm.name
        );
        for (position, (low, high)) in answer.joints.0.iter().zip(arm.position_min.0.iter().zip(&arm.position_max.0)) {
            assert!(low <= position && position <= high, "{} {joints:?}: beyond limits: {answer:?}", arm.name);
        }
        found.answers += 1;
        found.free += u64::from(answer.free.is_some());
        (found.position, found.rotation) = (found.position.max(position), found.rotation.max(rotation));
    }

    /// An answer is where the joints were, but for what a displaced seed and rounding near a singularity explain.
    fn judge_way(&self, arm: &Arm<N>, joints: &JointPos<N>, answer: &Answer<N>, seed: &JointPos<N>, away: f64) {
        let way = distance(&answer.joints, joints);
        let (product, noise) = conditioning(answer);
        let product = product.max(f64::MIN_POSITIVE);
        // Where a joint is free, the others follow the seed's displacement by the arm's levers.
        let follows = if answer.free.is_some() { 10.0 * away / product } else { 2.0 * away };
        let name = arm.name;
        assert!(way <= follows + noise / product, "{name} {joints:?} from {seed:?}: {way:e}: {answer:?}");
    }

    /// Random joints within the limits.
    pub fn random(&self, arm: &Arm<N>, seed: u64, count: u64) -> Found {
        let (mut random, mut found) = (Random(seed), Found::default());
        for _ in 0..count {
            let joints = random_joints(arm, &mut random);
            self.try_joints(arm, &joints, &mut random, &mut found);
        }
        found
    }

    /// Both sides of the singularities that are named (0 shoulder, 1 elbow, 2 wrist; together where there are several), at
    /// distances from 1e-14 to 1e-3, one in eight exactly on it.
    pub fn singular(&self, arm: &Arm<N>, which: &[usize], seed: u64, count: u64) -> Found {
        let (mut random, mut found) = (Random(seed), Found::default());
        for case in 0..count {
            // Away from the limits: those end a path by themselves where a free joint follows the seed.
            let mut joints = JointPos(random_joints(arm, &mut random).0.map(|position| 0.9 * position));
            // The shoulder's place depends on the other joints.
            for place in which.iter().rev() {
                let size = if case % 8 == 0 { 0.0 } else { 10_f64.powf(random.between(-14.0, -3.0)) };
                let by = if random.below(2) == 0 { size } else { -size };
                self.place[*place](arm, &mut joints, by, &mut random);
            }
            self.try_joints(arm, &joints, &mut random, &mut found);
        }
        found
    }
}
