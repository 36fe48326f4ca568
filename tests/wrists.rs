//! Arms with a spherical wrist against figures that pinocchio computed from their published descriptions
//! (`fixtures/data/kinematics`, where each file names its origin), and what carries arms and nozzles.

mod common;

use common::Random;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use screed_kernel::arm::Arm;
use screed_kernel::arms::{abb, comau, crane, gantry, kuka};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use serde_json::Value;

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|k| value[k].as_f64().unwrap())
}

#[test]
fn flanges_and_jacobians_are_pinocchios() {
    let arms = [
        ("kuka_kr120_r2500_pro", &kuka::KR120_R2500),
        ("kuka_kr210_r2700_2", &kuka::KR210_R2700),
        ("abb_irb140", &abb::IRB140),
        ("abb_irb6700_200_260", &abb::IRB6700_200),
        ("comau_nj130_2_6", &comau::NJ130),
    ];
    for (name, arm) in arms {
        let text = std::fs::read_to_string(screed_fixtures::data(&format!("kinematics/{name}.json"))).unwrap();
        let file: Value = serde_json::from_str(&text).unwrap();
        let samples = file["samples"].as_array().unwrap();
        assert!(samples.len() >= 30);
        let mut worst = [0.0_f64; 3];
        for sample in samples {
            let (flange, jacobian) = arm.jacobian(&JointPos(numbers(&sample["q"])));
            let [w, x, y, z] = numbers(&sample["quaternion_wxyz"]);
            let turned = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix();
            let position = Vector3::from(numbers(&sample["position_m"]));
            worst[0] = worst[0].max((flange.translation - position).norm());
            worst[1] = worst[1].max((flange.rotation - turned.matrix()).amax());
            if let Some(rows) = sample["jacobian_6xn_in_base"].as_array() {
                for (row, entries) in rows.iter().enumerate() {
                    for (column, entry) in numbers::<6>(entries).into_iter().enumerate() {
                        worst[2] = worst[2].max((jacobian[(row, column)] - entry).abs());
                    }
                }
            }
        }
        let [position, rotation, jacobian] = worst;
        println!("{name}: {} samples, {position:.1e} m, {rotation:.1e}, Jacobian {jacobian:.1e}", samples.len());
        assert!(position < 1e-14 && rotation < 1e-14 && jacobian < 1e-13, "{name}: {worst:?}");
    }
}

#[test]
fn limits_are_those_of_the_descriptions() {
    // The tables are in degrees; the KR 210's description has the same ones in radians.
    let file = std::fs::read_to_string(screed_fixtures::data("kinematics/kuka_kr210_r2700_2.json")).unwrap();
    let file: Value = serde_json::from_str(&file).unwrap();
    for (joint, limits) in file["limits_rad"].as_array().unwrap().iter().enumerate() {
        let [low, high] = numbers(limits);
        assert!((kuka::KR210_R2700.position_min.0[joint] - low).abs() < 1e-12);
        assert!((kuka::KR210_R2700.position_max.0[joint] - high).abs() < 1e-12);
    }
}

#[test]
fn the_nozzle_of_the_gantry_is_where_its_slides_say() {
    let flange = gantry::CONTOUR_CRAFTER.forward(&JointPos([3.0, 2.0, 1.0, 0.5]));
    assert!((flange.translation - Vector3::new(3.0, 2.0, 1.0)).norm() < 1e-15);
    let (s, c) = 0.5_f64.sin_cos();
    let expected = Matrix3::new(c, s, 0.0, s, -c, 0.0, 0.0, 0.0, -1.0);
    assert!((flange.rotation - expected).amax() < 1e-15, "{flange:?}");
}

#[test]
fn the_arm_hangs_from_the_crane_upside_down() {
    let mut random = Random::new(4);
    let hanging = Pose { rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0), ..Pose::identity() };
    for _ in 0..100 {
        let joints: [f64; 9] = std::array::from_fn(|_| random.between(-2.0, 2.0));
        let [x, y, z, arm @ ..] = joints;
        let expected = Pose::from_translation(x, y, z) * hanging * comau::NJ130.forward(&JointPos(arm));
        let found = crane::CRANE_NJ130.forward(&JointPos(joints));
        assert!((found.translation - expected.translation).norm() < 1e-14);
        assert!((found.rotation - expected.rotation).amax() < 1e-14);
    }
}

/// Largest difference between a Jacobian and central differences of the flange's pose at random joints.
fn jacobian_error<const N: usize>(arm: &Arm<N>, random: &mut Random) -> f64 {
    let low = |joint: usize| arm.position_min.0[joint].max(-7.0);
    let high = |joint: usize| arm.position_max.0[joint].min(7.0);
    let joints = JointPos(std::array::from_fn(|joint| random.between(low(joint), high(joint))));
    let (_, jacobian) = arm.jacobian(&joints);
    let mut worst = 0.0_f64;
    for joint in 0..N {
        let beside = |shift: f64| {
            let mut joints = joints;
            joints.0[joint] += shift;
            arm.forward(&joints)
        };
        let (below, above) = (beside(-1e-5), beside(1e-5));
        let turned = Pose { rotation: above.rotation * below.rotation.transpose(), ..above };
        let linear = (above.translation - below.translation) / 2e-5;
        let angular = turned.rotation_vector() / 2e-5;
        worst = worst.max((jacobian.fixed_view::<3, 1>(0, joint) - linear).norm());
        worst = worst.max((jacobian.fixed_view::<3, 1>(3, joint) - angular).norm());
    }
    worst
}

#[test]
fn jacobians_are_what_small_moves_do() {
    let mut random = Random::new(20_261_122);
    for arm in [&kuka::KR120_R2500, &kuka::KR210_R2700, &abb::IRB140, &abb::IRB6700_200, &comau::NJ130, &comau::NS12] {
        for _ in 0..10_000 {
            let error = jacobian_error(arm, &mut random);
            assert!(error < 1e-7, "{}: {error:e}", arm.name);
        }
    }
    for _ in 0..10_000 {
        assert!(jacobian_error(&gantry::CONTOUR_CRAFTER, &mut random) < 1e-7);
        assert!(jacobian_error(&crane::CRANE_NJ130, &mut random) < 1e-7);
    }
}
