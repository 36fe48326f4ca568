//! The catalogue's kinematics against figures that pinocchio computed from published descriptions
//! (`fixtures/data/kinematics`, whose files name their origin), Jacobians against differences, and the inverse against the
//! forward.

mod common;

use common::Random;
use nalgebra::{Quaternion, Rotation3, UnitQuaternion};
use screed_kernel::arm::{Arm, Jacobian};
use screed_kernel::arms::ur::{self as urs, UR10, UR10E};
use screed_kernel::ik::{IkError, ur};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use serde_json::Value;
use std::f64::consts::PI;

fn reference(file: &str) -> Value {
    let path = screed_fixtures::data("kinematics").join(file);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).unwrap()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|k| value[k].as_f64().unwrap())
}

fn rotation_distance(pose: &Pose, quaternion: [f64; 4]) -> f64 {
    let [w, x, y, z] = quaternion;
    let expected = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)).to_rotation_matrix();
    let turn = Rotation3::from_matrix_unchecked(pose.rotation.transpose() * expected.matrix());
    // Of a nearly unturned matrix the skew part is the angle; an arc cosine would lose half the digits.
    let r = turn.matrix();
    let skew = nalgebra::Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]) / 2.0;
    skew.norm().atan2((r.trace() - 1.0) / 2.0)
}

/// Largest differences to a file's samples: position (m), rotation (rad), Jacobian; and how many samples and Jacobians.
fn compare<const N: usize>(arm: &Arm<N>, file: &Value) -> ([f64; 3], [usize; 2]) {
    let (mut worst, mut counts) = ([0.0_f64; 3], [0, 0]);
    for sample in file["samples"].as_array().unwrap() {
        let (pose, jacobian) = arm.jacobian(&JointPos(numbers(&sample["q"])));
        let position: [f64; 3] = numbers(&sample["position_m"]);
        worst[0] = worst[0].max((pose.translation - nalgebra::Vector3::from(position)).norm());
        counts[0] += 1;
        if sample["quaternion_wxyz"].is_array() {
            worst[1] = worst[1].max(rotation_distance(&pose, numbers(&sample["quaternion_wxyz"])));
        }
        if let Some(rows) = sample["jacobian_6xn_in_base"].as_array() {
            let expected = Jacobian::<N>::from_fn(|row, column| rows[row][column].as_f64().unwrap());
            worst[2] = worst[2].max((jacobian - expected).amax());
            counts[1] += 1;
        }
    }
    (worst, counts)
}

#[test]
fn forward_kinematics_and_jacobians_of_ur_arms_are_pinocchios() {
    for arm in urs::ALL {
        // No kinematics file of a UR7e is published: it is a UR5e by assumption, and only that can be said.
        if arm.name == "ur7e" {
            assert_eq!(arm, Arm { name: "ur7e", ..urs::UR5E });
            continue;
        }
        let file = reference(&format!("{}.json", arm.name));
        let ([position, rotation, jacobian], [samples, jacobians]) = compare(&arm, &file);
        assert!(samples >= 30 && jacobians >= 10, "{}: {samples} samples, {jacobians} Jacobians", arm.name);
        // The descriptions write right angles as 1.570796327: 4e-10 m and 7e-10 rad from exact ones.
        assert!(
            position < 1e-9 && rotation < 1e-9 && jacobian < 5e-9,
            "{}: {position:e} m, {rotation:e} rad, {jacobian:e}",
            arm.name
        );
        let speeds = arm.velocity_max.known();
        for (joint, speed) in file["max_speed_rad_s"].as_array().unwrap().iter().enumerate() {
            let rated = speeds.map(|speeds| speeds.0[joint]);
            assert!(
                rated.is_some() == speed.is_number()
                    && (rated.unwrap_or(0.0) - speed.as_f64().unwrap_or(0.0)).abs() < 1e-12
            );
        }
    }
}

#[test]
fn a_ur10_stands_where_its_maker_says() {
    let file = reference("ur10_positions_published_by_ur.json");
    // Exact right angles here, 1.570796327 there.
    let ([position, ..], [samples, _]) = compare(&UR10, &file);
    assert!(samples == 2 && position < 1e-9, "{position:e} m");
}

/// Largest difference between a Jacobian's columns and central differences of poses, over seeded joints.
fn largest_difference<const N: usize>(arm: &Arm<N>, random: &mut Random, count: usize) -> f64 {
    const STEP: f64 = 1e-5;
    let mut worst = 0.0_f64;
    for _ in 0..count {
        let joints = JointPos(std::array::from_fn(|joint| {
            let (low, high) = (arm.position_min.0[joint].max(-2.0 * PI), arm.position_max.0[joint].min(2.0 * PI));
            random.between(low, high)
        }));
        let (_, jacobian) = arm.jacobian(&joints);
        for joint in 0..N {
            let beside = |shift: f64| {
                let mut joints = joints;
                joints.0[joint] += shift;
                arm.forward(&joints)
            };
            let (below, above) = (beside(-STEP), beside(STEP));
            let turned = Pose { rotation: above.rotation * below.rotation.transpose(), ..above };
            let linear = (above.translation - below.translation) / (2.0 * STEP);
            let angular = turned.rotation_vector() / (2.0 * STEP);
            worst = worst.max((jacobian.fixed_view::<3, 1>(0, joint) - linear).amax());
            worst = worst.max((jacobian.fixed_view::<3, 1>(3, joint) - angular).amax());
        }
    }
    worst
}

#[test]
fn jacobians_are_central_differences_at_ten_thousand_poses_an_arm() {
    let mut random = Random::new(20_261_123);
    for arm in urs::ALL {
        let worst = largest_difference(&arm, &mut random, 10_000);
        assert!(worst < 1e-7, "{}: {worst:e}", arm.name);
    }
}

#[test]
fn the_inverse_leads_back_to_the_pose_and_to_the_seed() {
    let mut random = Random::new(20_261_122);
    for _ in 0..100_000 {
        let seed = JointPos(std::array::from_fn(|_| random.between(-PI, PI)));
        let pose = UR10E.forward(&seed);
        let branches = ur::inverse(&UR10E, &pose, &seed).unwrap();
        for answer in branches.as_slice() {
            let back = UR10E.forward(&answer.joints);
            assert!((back.translation - pose.translation).norm() < 1e-11, "{seed:?}");
            assert!((back.rotation - pose.rotation).norm() < 1e-11, "{seed:?}");
        }
        // Near a singularity the joints are worse determined than the pose; the pose is what is asked for.
        let nearest = ur::nearest(&UR10E, &pose, &seed).unwrap();
        let far = nearest.joints.0.iter().zip(&seed.0).fold(0.0, |far: f64, (a, b)| far.max((a - b).abs()));
        assert!(far < 1e-6, "{seed:?}: {far:e}");
    }
}

#[test]
fn what_cannot_be_reached_is_named() {
    let far = Pose::from_translation(2.0, 0.0, 0.5);
    let zero = JointPos::ZERO;
    assert!(matches!(ur::inverse(&UR10E, &far, &zero), Err(IkError::OutOfReach { by }) if (0.5..1.2).contains(&by)));
    let nowhere = Pose::from_translation(f64::NAN, 0.0, 0.5);
    assert_eq!(ur::inverse(&UR10E, &nowhere, &zero), Err(IkError::NotFinite));
    let axis = Pose::from_translation(0.0, 0.05, 0.9);
    assert!(matches!(ur::inverse(&UR10E, &axis, &zero), Err(IkError::OutOfReach { .. })));
}
