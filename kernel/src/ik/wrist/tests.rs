//! The closed form against forward kinematics: sides, turns, singular poses, refusals.

use super::*;
use crate::arm::{Coupling, Dh, Joint, JointKind, Rating};
use crate::arms::{abb, comau, crane, kuka, opw::Opw, ur::UR10E};

/// SplitMix64.
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * (((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64)
    }

    fn joints<const N: usize>(&mut self, arm: &Arm<N>) -> JointPos<N> {
        JointPos(core::array::from_fn(|j| {
            self.between(arm.position_min.0[j].max(-7.0), arm.position_max.0[j].min(7.0))
        }))
    }
}

const SIGNS: [f64; 6] = [1.0, -1.0, 1.0, -1.0, -1.0, 1.0];
/// Every length is there, the wrist's centre lies beside the arm's plane, and no joint reads zero where its angle is.
const ODD: Arm<6> =
    Opw { a1: 0.2, a2: 0.1, b: 0.15, c1: 0.5, c2: 0.9, c3: 0.8, c4: 0.1, signs: SIGNS, offsets: [0.3; 6] }.arm("odd");
/// Folded, the wrist's centre comes to axis 2.
const EVEN: Arm<6> =
    Opw { a1: 0.0, a2: 0.0, b: 0.0, c1: 0.5, c2: 0.9, c3: 0.9, c4: 0.1, signs: SIGNS, offsets: [0.0; 6] }.arm("even");

/// Upper arm and forearm twisted against each other by half a turn, a length in every row that may have one, a flange
/// that points anywhere, two couplings.
fn twisted() -> Arm<6> {
    let mut arm = Arm { name: "twisted", ..ODD };
    (arm.dh[1].cos_alpha, arm.dh[1].a, arm.dh[2].d) = (-arm.dh[1].cos_alpha, -0.9, 0.07);
    (arm.dh[5].a, arm.dh[5].sin_alpha, arm.dh[5].cos_alpha) = (0.05, 0.6, 0.8);
    arm.base_from_zero = Some(Pose::from_roll_pitch_yaw(Vector3::new(1.0, -2.0, 0.5), 0.3, -1.1, 2.7));
    arm.last_from_flange = Some(Pose::from_roll_pitch_yaw(Vector3::new(0.1, 0.2, 0.3), 0.4, 0.5, 0.6));
    arm.joints[2].coupling = Some(Coupling { joint: 1, factor: -1.0 });
    arm.joints[5].coupling = Some(Coupling { joint: 4, factor: 2.0 });
    arm
}

/// An arm that two joints carry: one that turns, then one that slides along its axis.
fn carried(arm: &Arm<6>) -> Arm<8> {
    let mut joints = [Joint { coupling: None, ..Joint::REVOLUTE }; 8];
    let mut dh = [Dh { theta: 0.2, d: 0.3, a: 0.4, sin_alpha: 0.6, cos_alpha: 0.8 }; 8];
    joints[1] = Joint::PRISMATIC;
    for joint in 0..6 {
        dh[joint + 2] = arm.dh[joint];
        joints[joint + 2] = arm.joints[joint];
        if let Some(coupling) = &mut joints[joint + 2].coupling {
            coupling.joint += 2;
        }
    }
    Arm {
        name: "carried",
        base_from_zero: arm.base_from_zero,
        dh,
        joints,
        last_from_flange: arm.last_from_flange,
        position_min: JointPos([-6.0; 8]),
        position_max: JointPos([6.0; 8]),
        velocity_max: Rating::Unknown,
        acceleration_max: Rating::Unknown,
    }
}

/// Distance (m) and angle between the pose that an answer gives and the one wanted.
fn miss<const N: usize>(arm: &Arm<N>, answer: &Answer<N>, pose: &Pose) -> f64 {
    let back = arm.forward(&answer.joints);
    (back.translation - pose.translation).norm().max((back.rotation - pose.rotation).norm())
}

/// The sides that an answer is on, from the frames of its links instead of from what found it.
fn sides<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>) -> [f64; 3] {
    let frames = arm.frames(joints);
    let zero = if N > 6 { frames[N - 7] } else { arm.base_from_zero.unwrap_or(Pose::identity()) };
    let [one, two, three, four] = [N - 6, N - 5, N - 4, N - 3].map(|link| frames[link]);
    let wrist = four.translation;
    let ahead = one.rotation.column(0).dot(&(wrist - zero.translation));
    let (upper, fore): (Vector3<f64>, Vector3<f64>) =
        (two.rotation.column(0).into(), wrist - three.translation + three.rotation.column(0) * arm.dh[N - 4].a);
    let bend = upper.cross(&fore).dot(&one.rotation.column(2));
    let angle = arm.dh[N - 2].theta + joints.0[N - 2];
    let coupled = arm.joints[N - 2].coupling.map_or(0.0, |coupling| coupling.factor * joints.0[coupling.joint]);
    [ahead, bend, libm::sin(angle + coupled)]
}

fn leads_back<const N: usize>(arm: &Arm<N>, random: &mut Random) {
    for case in 0..4_000 {
        let (goal, other) = (random.joints(arm), random.joints(arm));
        let share = [0.0, 1.0, 0.1, 1e-3, 1e-6][case % 5];
        let mut seed = goal;
        for (seed, other) in seed.0.iter_mut().zip(&other.0).skip(N - 6) {
            *seed += share * (other - *seed);
        }
        let pose = arm.forward(&goal);
        let all = inverse(arm, &pose, &seed).unwrap();
        let mut own = f64::INFINITY;
        for (k, answer) in all.as_slice().iter().enumerate() {
            let name = arm.name;
            assert!(miss(arm, answer, &pose) < 2e-14, "{name} {goal:?}: {answer:?}");
            assert!(all.as_slice()[..k].iter().all(|before| before.branch != answer.branch), "{name}: twice");
            let branch = answer.branch.unwrap();
            let sides = sides(arm, &answer.joints);
            for (side, expected) in [branch.shoulder, branch.elbow, branch.wrist].iter().zip(sides) {
                assert!(side.sign() * expected > -1e-12, "{name} {goal:?}: {answer:?}, {sides:?}");
            }
            assert_eq!(answer.joints.0[..N - 6], seed.0[..N - 6], "what carries the arm moved");
            let way = answer.joints.0.iter().zip(&goal.0).map(|(a, b)| {
                let turns = libm::round((a - b) / (2.0 * PI));
                libm::fabs(a - b - 2.0 * PI * turns)
            });
            own = own.min(way.fold(0.0, f64::max));
        }
        assert!(own < 1e-9, "{} {goal:?}: not among the answers, {own:e}", arm.name);
        let tracked = nearest(arm, &pose, &seed).unwrap();
        let best = all.nearest(&seed).unwrap();
        assert_eq!(distance(&tracked.joints, &seed), distance(&best.joints, &seed), "{} {goal:?}", arm.name);
    }
}

#[test]
fn every_branch_leads_back_and_the_nearest_is_the_nearest_of_all() {
    let mut random = Random(20_261_122);
    for arm in [&kuka::KR120_R2500, &kuka::KR210_R2700, &abb::IRB140, &abb::IRB6700_200, &comau::NJ130] {
        leads_back(arm, &mut random);
    }
    for arm in [&comau::NS12, &ODD, &EVEN, &twisted()] {
        leads_back(arm, &mut random);
    }
    leads_back(&crane::CRANE_NJ130, &mut random);
    leads_back(&carried(&twisted()), &mut random);
}

#[test]
fn on_a_singularity_the_free_joint_is_the_seeds() {
    let mut random = Random(11);
    // Folded, this one's wrist comes to axis 2, in front of axis 1.
    let mut ahead = EVEN;
    ahead.dh[0].a = 0.3;
    for _ in 0..1_000 {
        let seed = JointPos(core::array::from_fn(|_| random.between(-3.0, 3.0)));
        let [roll, pitch, yaw] = core::array::from_fn(|_| random.between(-3.0, 3.0));
        let turned = |x: f64, y: f64, z: f64| {
            let pose = Pose::from_roll_pitch_yaw(Vector3::new(x, y, z), roll, pitch, yaw);
            pose * Pose::from_translation(0.0, 0.0, 0.1)
        };
        for (arm, pose, joint) in [
            (&EVEN, turned(0.0, 0.0, 1.5), 0),
            (&EVEN, turned(5e-14, -3e-14, -0.2), 0),
            (&ahead, turned(0.3, 0.0, 0.5), 1),
            (&ODD, ODD.forward(&JointPos([roll, pitch, 1.0, yaw, -ODD.dh[4].theta, 2.0])), 3),
        ] {
            let all = inverse(arm, &pose, &seed).unwrap();
            let free = all.as_slice().iter().filter(|answer| answer.free == Some(joint));
            assert!(free.clone().count() >= 2, "{joint}: {all:?}");
            for answer in free {
                assert!(libm::fabs(answer.joints.0[joint] - seed.0[joint]) < 1e-15);
                assert!(miss(arm, answer, &pose) < 5e-13, "{answer:?}");
            }
            let tracked = nearest(arm, &pose, &seed).unwrap();
            assert_eq!(distance(&tracked.joints, &seed), distance(&all.nearest(&seed).unwrap().joints, &seed));
        }
    }
}

#[test]
fn full_turns_of_coupled_joints_keep_the_pose() {
    let turns = |low: f64, high: f64| Arm {
        position_min: JointPos([low; 6]),
        position_max: JointPos([high; 6]),
        ..comau::NJ130
    };
    let mut random = Random(7);
    for _ in 0..1_000 {
        let goal = random.joints(&comau::NJ130);
        let pose = comau::NJ130.forward(&goal);
        for (low, high) in [(-20.0, -10.0), (3.0, 11.0), (-3.2, 3.2), (-50.0, 50.0)] {
            let arm = turns(low, high);
            let seed = random.joints(&Arm { position_min: JointPos([low; 6]), ..turns(low, high) });
            for answer in inverse(&arm, &pose, &seed).unwrap().as_slice() {
                assert!(miss(&arm, answer, &pose) < 5e-14, "{answer:?}");
                assert!(answer.joints.0.iter().all(|joint| low <= *joint && *joint <= high), "{answer:?}");
            }
        }
    }
}

#[test]
fn what_cannot_be_reached_is_named() {
    let (arm, zero) = (&kuka::KR120_R2500, JointPos::ZERO);
    // Level, stretched as far as it goes, and 0.1 m farther.
    let fore = libm::hypot(1.0, 0.041);
    let reach = 0.35 + 1.15 + fore + 0.215;
    let level = |x: f64| Pose {
        translation: Vector3::new(x, 0.0, 0.675),
        ..Pose::from_roll_pitch_yaw(Vector3::zeros(), 0.0, core::f64::consts::FRAC_PI_2, 0.0)
    };
    let error = inverse(arm, &level(reach + 0.1), &zero);
    assert!(matches!(error, Err(IkError::OutOfReach { by }) if libm::fabs(by - 0.1) < 1e-12), "{error:?}");
    assert_eq!(nearest(arm, &level(reach + 0.1), &zero), Err(error.unwrap_err()));
    assert!(nearest(arm, &level(reach - 1e-12), &zero).is_ok());
    // Too close: the forearm does not fold that far.
    let mut short = EVEN;
    short.dh[3].d *= 5.0 / 9.0;
    let error = inverse(&short, &Pose::from_translation(0.1, 0.0, 0.6), &zero);
    assert!(matches!(error, Err(IkError::OutOfReach { by }) if libm::fabs(by - 0.3) < 1e-12), "{error:?}");
    // Within b of axis 1.
    let error = inverse(&ODD, &Pose::from_translation(0.1, 0.0, 1.1), &zero);
    assert!(matches!(error, Err(IkError::OutOfReach { by }) if libm::fabs(by - 0.05) < 1e-12), "{error:?}");

    let goal = JointPos([0.3, -1.0, 0.5, 0.2, 1.0, 0.1]);
    let pose = arm.forward(&goal);
    let mut narrow = *arm;
    (narrow.position_min, narrow.position_max) =
        (JointPos(goal.0.map(|q| q - 0.01)), JointPos(goal.0.map(|q| q + 0.01)));
    assert_eq!(inverse(&narrow, &pose, &goal).unwrap().as_slice().len(), 1);
    narrow.position_max.0[3] = 0.195;
    let error = nearest(&narrow, &pose, &goal);
    assert!(
        matches!(error, Err(IkError::Limit { joint: 3, position }) if libm::fabs(position - 0.2) < 1e-12),
        "{error:?}"
    );
    // A crane's slide beyond its stroke is named, not moved.
    let crane = &crane::CRANE_NJ130;
    let seed = JointPos([1.0, 5.0, 3.0, 0.3, 0.1, -1.5, 0.2, 1.0, 0.1]);
    let error = nearest(crane, &crane.forward(&seed), &seed);
    assert_eq!(error, Err(IkError::Limit { joint: 1, position: 5.0 }));

    let nan = Pose { translation: Vector3::new(f64::NAN, 0.0, 0.0), ..pose };
    assert_eq!(inverse(arm, &nan, &zero), Err(IkError::NotFinite));
    assert_eq!(inverse(&UR10E, &pose, &zero), Err(IkError::OtherShape));
    assert_eq!(nearest(&UR10E, &pose, &zero), Err(IkError::OtherShape));
}

#[test]
fn other_shapes_are_not_taken_for_this_one() {
    let changes: [fn(&mut Arm<6>); 10] = [
        |arm| arm.dh[0].cos_alpha = 1e-12,
        |arm| arm.dh[1].sin_alpha = 1e-12,
        |arm| arm.dh[2].cos_alpha = 1e-12,
        |arm| arm.dh[3].a = 1e-12,
        |arm| arm.dh[4].d = 1e-12,
        |arm| arm.dh[4].a = 1e-12,
        |arm| arm.dh[1].a = 0.0,
        |arm| (arm.dh[2].a, arm.dh[3].d) = (0.0, 0.0),
        |arm| arm.joints[5].kind = JointKind::Prismatic,
        |arm| arm.joints[2].coupling = Some(Coupling { joint: 1, factor: 0.5 }),
    ];
    assert!(Geometry::of(&comau::NJ130).is_some());
    for (k, change) in changes.iter().enumerate() {
        let mut arm = comau::NJ130;
        change(&mut arm);
        assert_eq!(Geometry::of(&arm), None, "change {k}");
    }
}
