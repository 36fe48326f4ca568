//! Inverse kinematics of calibrated arms: real UR units against poses that pinocchio computed of them, arms with a spherical
//! wrist with seeded deltas, and all of them against a dense search around their singularities. Five times as many cases:
//! `SCREED_CASES=5 cargo test --release -p screed --test inverse -- --nocapture`.

mod common;

use common::Random;
use nalgebra::{Matrix6, Quaternion, UnitQuaternion, Vector3};
use screed::robot::{self, calibration};
use screed_kernel::arm::{Arm, Dh};
use screed_kernel::arms::ur::{UR10, UR10E};
use screed_kernel::arms::{SPHERICAL_WRISTS, comau};
use screed_kernel::ik::{Family, IkError, Singularity, numeric};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use serde_json::Value;
use std::f64::consts::PI;
use std::fmt::Write;

/// How many cases, times `SCREED_CASES` where that is set.
fn cases(count: usize) -> usize {
    count * std::env::var("SCREED_CASES").map_or(1, |times| times.parse().unwrap())
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|k| value[k].as_f64().unwrap())
}

fn fixture(file: &str) -> Value {
    let path = screed_fixtures::data("kinematics").join(file);
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// An arm with limits wide enough that no answer is lost for them.
fn wide(arm: &Arm<6>) -> Arm<6> {
    Arm { position_min: JointPos([-10.0; 6]), position_max: JointPos([10.0; 6]), ..*arm }
}

/// A unit's table: nominal plus delta, as the controller stores it; and poses of it with their joints.
fn unit(file: &str, nominal: &Arm<6>) -> (Arm<6>, Vec<(JointPos<6>, Pose)>) {
    let file = fixture(file);
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

/// The unit of a kinematics file.
fn loaded(file: &str, model: &str) -> Arm<6> {
    let value = fixture(file);
    let mut text = "kinematics:\n".to_owned();
    for joint in ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"] {
        writeln!(text, "  {joint}:").unwrap();
        for key in ["x", "y", "z", "roll", "pitch", "yaw"] {
            writeln!(text, "    {key}: {}", value["kinematics"][joint][key].as_f64().unwrap()).unwrap();
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("unit.yaml");
    std::fs::write(&path, text).unwrap();
    calibration::load(&path, &robot::ur(model).unwrap()).unwrap().arm
}

/// The arm with deltas of millimetres and milliradians.
fn off(nominal: &Arm<6>, random: &mut Random) -> Arm<6> {
    let mut arm = *nominal;
    for row in &mut arm.dh {
        row.theta += random.between(-3e-3, 3e-3);
        row.d += random.between(-1e-3, 1e-3);
        row.a += random.between(-1e-3, 1e-3);
        let alpha = row.sin_alpha.atan2(row.cos_alpha) + random.between(-2e-3, 2e-3);
        (row.sin_alpha, row.cos_alpha) = alpha.sin_cos();
    }
    arm
}

/// Every real unit of the fixtures, and a seeded one of each arm with a spherical wrist; with the nominal arm.
fn units() -> Vec<(String, Arm<6>, Arm<6>)> {
    let mut random = Random::new(77);
    let deltas = [
        ("calibration_ur10_dh_delta_1.json", UR10),
        ("calibration_ur10e_dh_delta_1.json", UR10E),
        ("calibration_ur10e_dh_delta_2.json", UR10E),
    ];
    let files = [
        ("calibration_ur10_calib_15120592593058779304.json", "ur10"),
        ("calibration_ur10e_calib_3437785250745286433.json", "ur10e"),
        ("calibration_ur3e_calib_13312600673477018527.json", "ur3e"),
        ("calibration_ur5e_calib_17107847223675855653.json", "ur5e"),
    ];
    let deltas = deltas.map(|(file, nominal)| (file.to_owned(), nominal, unit(file, &nominal).0));
    let files = files.map(|(file, model)| (file.to_owned(), robot::ur(model).unwrap(), loaded(file, model)));
    let wrists = SPHERICAL_WRISTS.map(|nominal| (nominal.name.to_owned(), nominal, off(&nominal, &mut random)));
    deltas.into_iter().chain(files).chain(wrists).collect()
}

/// How far apart joints are at least, by full turns.
fn turn_between(a: &JointPos<6>, b: &JointPos<6>) -> f64 {
    let turns = a.0.iter().zip(&b.0).map(|(a, b)| ((a - b + PI).rem_euclid(2.0 * PI) - PI).abs());
    turns.fold(0.0, f64::max)
}

fn miss<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>, pose: &Pose) -> f64 {
    let back = arm.forward(joints);
    let turn = Pose { rotation: back.rotation * pose.rotation.transpose(), ..*pose };
    (back.translation - pose.translation).norm().max(turn.rotation_vector().norm())
}

fn determinant(arm: &Arm<6>, joints: &JointPos<6>) -> f64 {
    Matrix6::from_iterator(arm.jacobian(joints).1.iter().copied()).determinant()
}

/// Leads a joint to a place where the unit's own Jacobian loses rank; `None` if there is none within 0.15 rad.
fn made_singular(arm: &Arm<6>, joints: &JointPos<6>, joint: usize, around: f64) -> Option<JointPos<6>> {
    let at = |position: f64| {
        let mut joints = *joints;
        joints.0[joint] = position;
        (joints, determinant(arm, &joints))
    };
    let (mut low, mut high) = (around - 0.15, around + 0.15);
    let sign = at(low).1;
    if sign * at(high).1 > 0.0 {
        return None;
    }
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        *(if at(middle).1 * sign > 0.0 { &mut low } else { &mut high }) = middle;
    }
    Some(at(0.5 * (low + high)).0)
}

/// Seeded joints of the unit at a singularity of its own.
fn singular(arm: &Arm<6>, singularity: Singularity, random: &mut Random) -> Option<JointPos<6>> {
    let joints = JointPos(std::array::from_fn(|_| random.between(-PI, PI)));
    let joint = match singularity {
        Singularity::Shoulder => 1,
        Singularity::Elbow => 2,
        Singularity::Wrist => 4,
    };
    let start = random.between(-PI, 0.3 - PI);
    let places = (0..21).map(|k| start + 0.3 * f64::from(k));
    // Joint 3 also comes to the shoulder's: of what is found, that whose nearest singularity is the one asked for.
    let Family::Calibrated(geometry) = Family::of(arm) else { panic!("calibrated") };
    let mut found = places.filter_map(|around| made_singular(arm, &joints, joint, around)).filter(|joints| {
        let margins = geometry.posture(arm, joints).1;
        let mut others = [margins.shoulder, margins.elbow, margins.wrist];
        others.sort_by(f64::total_cmp);
        margins.nearest().0 == singularity && others[1] > 0.25
    });
    found.next()
}

/// What more than a thousand starts around the pose lead to: the nominal arm's answers for poses displaced at random.
fn dense(nominal: &Arm<6>, arm: &Arm<6>, pose: &Pose, joints: &JointPos<6>, random: &mut Random) -> Vec<JointPos<6>> {
    let endless = Arm { position_min: JointPos([-1e3; 6]), position_max: JointPos([1e3; 6]), ..*arm };
    let closed = Family::of(&wide(nominal));
    let mut all: Vec<JointPos<6>> = vec![*joints];
    for size in [1.0, 0.5, 0.2, 0.05].into_iter().cycle().take(40) {
        let mut vector = |most: f64| Vector3::from_fn(|_, _| size * random.between(-most, most));
        let beside = Pose::from_rotation_vector(vector(0.06), vector(0.15));
        let beside =
            Pose { rotation: beside.rotation * pose.rotation, translation: pose.translation + beside.translation };
        let Ok(starts) = closed.inverse(&wide(nominal), &beside, joints) else { continue };
        for start in starts.as_slice() {
            let Ok(answer) = numeric::nearest(&endless, pose, &start.joints) else { continue };
            if miss(arm, &answer.joints, pose) < 2e-12 && !all.iter().any(|a| turn_between(a, &answer.joints) < 1e-3) {
                all.push(answer.joints);
            }
        }
    }
    all
}

#[test]
fn calibrated_units_are_solved_on_every_branch() {
    let mut random = Random::new(20_261_122);
    for (name, nominal, arm) in units() {
        let arm = wide(&arm);
        let family = Family::of(&arm);
        assert!(matches!(family, Family::Calibrated(_)), "{name}");
        let (mut answers, mut worst) = (0, 0.0_f64);
        for case in 0..cases(200) {
            let joints = JointPos(std::array::from_fn(|_| random.between(-PI, PI)));
            let pose = arm.forward(&joints);
            let far = JointPos(std::array::from_fn(|_| random.between(-PI, PI)));
            let all = family.inverse(&arm, &pose, &far).unwrap_or_else(|error| panic!("{name} {joints:?}: {error:?}"));
            worst = all.as_slice().iter().map(|answer| miss(&arm, &answer.joints, &pose)).fold(worst, f64::max);
            assert!(worst < 1e-10, "{name} {joints:?}: {worst:e}");
            answers += all.as_slice().len();
            let dense = if case % 20 == 0 { dense(&nominal, &arm, &pose, &joints, &mut random) } else { vec![joints] };
            for other in dense {
                let found =
                    all.as_slice().iter().map(|answer| turn_between(&answer.joints, &other)).fold(9.0, f64::min);
                assert!(found < 1e-6, "{name} {joints:?}: no {other:?}");
            }
            let beside = JointPos(joints.0.map(|position| position + random.between(-0.01, 0.01)));
            let tracked = family.nearest(&arm, &pose, &beside).unwrap();
            assert!(turn_between(&tracked.joints, &joints) < 0.02, "{name} {joints:?}: {tracked:?}");
        }
        println!("{name}: {answers} answers, the worst misses by {worst:e}");
        assert!(answers > 5 * cases(200), "{name}: {answers}");
    }
}

#[test]
fn calibrated_units_stand_where_pinocchio_says() {
    for (file, nominal) in [
        ("calibration_ur10_dh_delta_1.json", &UR10),
        ("calibration_ur10e_dh_delta_1.json", &UR10E),
        ("calibration_ur10e_dh_delta_2.json", &UR10E),
    ] {
        let (arm, samples) = unit(file, nominal);
        assert!(samples.len() >= 12, "{file}");
        for (joints, pose) in samples {
            let all = Family::of(&arm).inverse(&arm, &pose, &joints).unwrap();
            assert!(all.as_slice().iter().any(|answer| turn_between(&answer.joints, &joints) < 1e-7), "{file}");
        }
    }
}

/// Cases, answers that the dense search knows or the pose was made of, and those of them that are not found; and the worst
/// miss of an answer.
fn around(
    (name, nominal, arm): &(String, Arm<6>, Arm<6>),
    singularity: Singularity,
    count: usize,
    random: &mut Random,
) -> ([usize; 3], f64) {
    let arm = wide(arm);
    let family = Family::of(&arm);
    let joint = if singularity == Singularity::Shoulder { 1 } else { singularity as usize * 2 };
    let (mut cases, mut known, mut lost, mut worst) = (0, 0, 0, 0.0_f64);
    while cases < count {
        let Some(mut joints) = singular(&arm, singularity, random) else { continue };
        let size = if cases % 8 == 0 { 0.0 } else { 10_f64.powf(random.between(-9.0, -1.5)) };
        joints.0[joint] += if random.between(0.0, 1.0) < 0.5 { size } else { -size };
        cases += 1;
        let pose = arm.forward(&joints);
        let far = JointPos(std::array::from_fn(|_| random.between(-PI, PI)));
        let all = family.inverse(&arm, &pose, &far);
        let all = all.unwrap_or_else(|error| panic!("{name} {singularity:?} {joints:?}: {error:?}"));
        worst = all.as_slice().iter().map(|answer| miss(&arm, &answer.joints, &pose)).fold(worst, f64::max);
        // From beside them the joints are tracked.
        let beside = JointPos(joints.0.map(|position| position + random.between(-1e-3, 1e-3)));
        let tracked = family.nearest(&arm, &pose, &beside).unwrap();
        assert!(turn_between(&tracked.joints, &joints) < 3e-3, "{name} {singularity:?} {joints:?}: {tracked:?}");
        let dense = if cases % 4 == 0 { dense(nominal, &arm, &pose, &joints, random) } else { vec![joints] };
        for other in dense {
            known += 1;
            // Where answers nearly meet, 1e-10 of the pose is this far in the joints.
            let near = |joints: &JointPos<6>| turn_between(joints, &other) < 3e-3;
            if !all.as_slice().iter().any(|answer| near(&answer.joints)) {
                println!("{name} {singularity:?} {joints:?} {size:e}: no {other:?}");
                lost += 1;
            }
        }
    }
    ([cases, known, lost], worst)
}

#[test]
fn no_branch_is_lost_beside_a_singularity_of_the_unit() {
    let mut random = Random::new(31);
    let mut circles = [0; 2];
    for unit in units() {
        for singularity in [Singularity::Shoulder, Singularity::Elbow, Singularity::Wrist] {
            let ([cases, known, lost], worst) = around(&unit, singularity, cases(15), &mut random);
            println!("{} {singularity:?}: {cases} poses, {known} answers known, {lost} lost, miss {worst:.1e}", unit.0);
            assert!(worst <= 1e-10, "{worst:e}");
            let is_fold = singularity == Singularity::Elbow
                || singularity == Singularity::Shoulder && unit.1.name.starts_with("ur");
            if is_fold {
                assert_eq!(lost, 0, "{} {singularity:?}", unit.0);
            } else {
                circles = [circles[0] + known, circles[1] + lost];
            }
        }
    }
    // Of three or four answers that nearly meet at once, some: kernel/src/ik/calibrated.rs.
    println!("where circles break up: {} of {} lost", circles[1], circles[0]);
    assert!(circles[1] * 100 <= circles[0], "{circles:?}");
}

#[test]
fn what_the_unit_alone_cannot_reach_is_named() {
    let mut random = Random::new(8);
    let (mut short, mut turned) = (0, 0);
    for (name, nominal, arm) in units() {
        let (arm, family, closed) = (wide(&arm), Family::of(&arm), Family::of(&wide(&nominal)));
        for _ in 0..cases(100) {
            // A pose that the nominal arm reaches almost stretched, so that the unit may not.
            let mut joints = JointPos(std::array::from_fn(|_| random.between(-PI, PI)));
            joints.0[2] = if name.contains("ur") { random.between(-0.05, 0.05) } else { joints.0[2] };
            let pose = nominal.forward(&joints);
            assert!(closed.inverse(&wide(&nominal), &pose, &joints).is_ok());
            match family.inverse(&arm, &pose, &joints) {
                Ok(_) => {}
                Err(IkError::OutOfReach { by }) => {
                    assert!(by > 1e-10 && by < 0.02, "{name} {joints:?}: {by}");
                    short += 1;
                }
                Err(IkError::Singular { singularity: Singularity::Wrist, distance }) => {
                    assert!(distance < 0.05, "{name} {joints:?}: {distance}");
                    turned += 1;
                }
                Err(error) => panic!("{name} {joints:?}: {error:?}"),
            }
        }
        // Far out of every arm's reach.
        let far = Pose::from_translation(9.0, 0.0, 0.5);
        assert!(matches!(family.inverse(&arm, &far, &JointPos::ZERO), Err(IkError::OutOfReach { by }) if by > 3.0));
    }
    println!("{short} poses too far for the unit, {turned} out of its wrist's range");
    assert!(short > 20, "{short}");
}

#[test]
fn a_calibrated_arm_on_a_crane_is_solved_where_the_crane_stands() {
    let mut random = Random::new(5);
    let arm = off(&comau::NJ130, &mut random);
    let mut carried = screed_kernel::arms::crane::CRANE_NJ130;
    carried.dh[3..].copy_from_slice(&arm.dh);
    let family = Family::of(&carried);
    assert!(matches!(family, Family::Calibrated(_)));
    for _ in 0..300 {
        let joints = JointPos(std::array::from_fn(|joint| {
            random.between(carried.position_min.0[joint], carried.position_max.0[joint])
        }));
        let pose = carried.forward(&joints);
        let all = family.inverse(&carried, &pose, &joints).unwrap();
        let own = |answer: &JointPos<9>| answer.0.iter().zip(&joints.0).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(all.as_slice().iter().any(|answer| own(&answer.joints)), "{joints:?}");
        for answer in all.as_slice() {
            assert_eq!(answer.joints.0[..3], joints.0[..3], "the crane moved");
            assert!(miss(&carried, &answer.joints, &pose) <= 1e-10);
        }
    }
}
