//! Inverse kinematics of real, calibrated units against poses that pinocchio computed of them, and of arms without a closed
//! form.

mod common;

use common::Random;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use screed_kernel::arm::{Arm, Dh};
use screed_kernel::arms::ur::{UR10, UR10E};
use screed_kernel::ik::{Family, calibrated, ur};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use serde_json::Value;
use std::f64::consts::PI;

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|k| value[k].as_f64().unwrap())
}

/// A unit's table: nominal plus delta, as the controller stores it; and poses of it with their joints.
fn unit(file: &str, nominal: &Arm<6>) -> (Arm<6>, Vec<(JointPos<6>, Pose)>) {
    let path = screed_fixtures::data("kinematics").join(file);
    let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let sum = |name: &str| -> [f64; 6] {
        let (nominal, delta): ([f64; 6], [f64; 6]) =
            (numbers(&file["dh_nominal"][name]), numbers(&file["dh_delta"][name]));
        std::array::from_fn(|row| nominal[row] + delta[row])
    };
    let (theta, d, a, alpha) = (sum("theta"), sum("d"), sum("a"), sum("alpha"));
    let dh = std::array::from_fn(|row| Dh {
        theta: theta[row],
        d: d[row],
        a: a[row],
        sin_alpha: alpha[row].sin(),
        cos_alpha: alpha[row].cos(),
    });
    let samples = file["samples"].as_array().unwrap().iter().map(|sample| {
        let [w, x, y, z] = numbers(&sample["quaternion_wxyz"]);
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix().into_inner();
        let translation = Vector3::from(numbers::<3>(&sample["position_m"]));
        (JointPos(numbers(&sample["q"])), Pose { rotation, translation })
    });
    (Arm { name: "unit", dh, ..*nominal }, samples.collect())
}

/// How far apart joints are at least, by full turns.
fn turn_between(a: &JointPos<6>, b: &JointPos<6>) -> f64 {
    let turns = a.0.iter().zip(&b.0).map(|(a, b)| ((a - b + PI).rem_euclid(2.0 * PI) - PI).abs());
    turns.fold(0.0, f64::max)
}

fn miss<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>, pose: &Pose) -> f64 {
    let back = arm.forward(joints);
    (back.translation - pose.translation).norm().max((back.rotation - pose.rotation).norm())
}

#[test]
fn calibrated_units_are_solved_on_every_branch() {
    let mut random = Random::new(20_261_122);
    for (file, nominal) in [
        ("calibration_ur10_dh_delta_1.json", &UR10),
        ("calibration_ur10e_dh_delta_1.json", &UR10E),
        ("calibration_ur10e_dh_delta_2.json", &UR10E),
    ] {
        let (arm, samples) = unit(file, nominal);
        assert_eq!(ur::Geometry::of(&arm), None);
        assert!(matches!(Family::of(&arm), Family::Calibrated(_)), "{file}");
        let near = ur::Geometry::near(&arm).expect("near the nominal arm");
        assert!(samples.len() >= 12, "{file}");
        // The file's own poses, then more by our own forward kinematics, which those check.
        let more = std::iter::repeat_with(|| JointPos(std::array::from_fn(|_| random.between(-PI, PI))));
        let more: Vec<_> = more.take(1_000).map(|joints| (joints, arm.forward(&joints))).collect();
        let (mut answers, mut lost, mut worst) = (0, 0, 0.0_f64);
        for (joints, pose) in samples.iter().chain(&more) {
            let far = JointPos(std::array::from_fn(|_| random.between(-PI, PI)));
            let all = calibrated::inverse(&near, &arm, pose, &far).unwrap_or_else(|error| panic!("{file}: {error:?}"));
            for answer in all.as_slice() {
                worst = worst.max(miss(&arm, &answer.joints, pose));
            }
            assert!(worst < 1.5e-10, "{file} {joints:?}: {worst:e}");
            answers += all.as_slice().len();
            let own = all.as_slice().iter().map(|answer| turn_between(&answer.joints, joints)).fold(9.0, f64::min);
            // Beside a singularity the unit's branches meet elsewhere than its nominal's, and one may have no start.
            let margin = near.posture(joints).1.nearest().1;
            lost += usize::from(own > 1e-7);
            assert!(own < 1e-7 || margin < 0.1, "{file} {joints:?}: {own:e}, {margin}");
            let beside = JointPos(joints.0.map(|position| position + random.between(-0.01, 0.01)));
            let tracked = calibrated::nearest(&near, &arm, pose, &beside).unwrap();
            let tracked = turn_between(&tracked.joints, joints);
            assert!(tracked < 1e-7 || (margin < 0.02 && tracked < 0.02), "{file} {joints:?}: {tracked:e}, {margin}");
        }
        println!("{file}: {answers} answers, the worst misses by {worst:e}; {lost} branches lost");
        assert!(answers > 4_000 && lost < 30, "{file}: {answers}, {lost}");
    }
}
