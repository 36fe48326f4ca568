//! The UR10e's kinematics against figures that pinocchio computed from the published description
//! (`fixtures/data/kinematics/ur10e.json`, which names its origin), and the inverse against the forward.

mod common;

use common::Random;
use nalgebra::{Quaternion, Rotation3, UnitQuaternion};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ik::{IkError, ur};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use serde_json::Value;
use std::f64::consts::PI;

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|k| value[k].as_f64().unwrap())
}

fn rotation_distance(pose: &Pose, quaternion: [f64; 4]) -> f64 {
    let [w, x, y, z] = quaternion;
    let expected = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.rotation)).angle_to(&expected)
}

#[test]
fn forward_kinematics_is_pinocchios() {
    let text = std::fs::read_to_string(screed_fixtures::data("kinematics/ur10e.json")).unwrap();
    let file: Value = serde_json::from_str(&text).unwrap();
    let samples = file["samples"].as_array().unwrap();
    assert_eq!(samples.len(), 210);
    for sample in samples {
        let pose = UR10E.forward(&JointPos(numbers(&sample["q"])));
        let position: [f64; 3] = numbers(&sample["position_m"]);
        let miss = (pose.translation - nalgebra::Vector3::from(position)).norm();
        // The description writes right angles as 1.570796327: 4e-10 m and 7e-10 rad from exact ones.
        assert!(miss < 1e-9, "{sample}: {miss:e} m");
        let turn = rotation_distance(&pose, numbers(&sample["quaternion_wxyz"]));
        assert!(turn < 5e-8, "{sample}: {turn:e} rad");
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
