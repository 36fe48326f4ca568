//! Against pinocchio's figures of published calibrations, as `fixtures/data/kinematics` has them.

use super::*;
use crate::failure::Failure;
use crate::robot;
use serde_json::Value;

fn reference(name: &str) -> Value {
    let path = screed_fixtures::data("kinematics").join(format!("calibration_{name}.json"));
    serde_json::from_str(&std::fs::read_to_string(path).expect("the fixture")).expect("JSON")
}

/// The kinematics file that `ur_calibration` wrote, from its numbers.
fn yaml_file(file: &Value) -> String {
    let mut text = "kinematics:\n".to_owned();
    for joint in JOINTS {
        text += &format!("  {joint}:\n");
        for value in VALUES {
            text += &format!("    {value}: {}\n", file["kinematics"][joint][value].as_f64().expect("a number"));
        }
    }
    text + &format!("  hash: {}\n", file["hash"].as_str().expect("a text"))
}

/// The controller's file, from its deltas.
fn conf_file(file: &Value) -> String {
    let list = |key: &str| format!("delta_{key} = {}\n", file["dh_delta"][key]);
    let lists: String = ["theta", "a", "d", "alpha"].map(list).concat();
    format!(
        "[mounting]\n{lists}joint_checksum = [0x01, 0x02, 0x03, 0x04, 0x05, 0x06]\ncalibration_status = 2 # Linearised\n"
    )
}

fn load_text(text: &str, ending: &str, model: &str) -> Result<Calibrated, RobotError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(format!("unit.{ending}"));
    std::fs::write(&path, text).expect("a file");
    load(&path, &robot::ur(model).expect("a UR"))
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|k| value[k].as_f64().expect("a number"))
}

/// Largest distance of positions (m), and of rotation matrices, to the samples whose keys end with `suffix`.
fn worst(arm: &Arm<6>, file: &Value, suffix: &str) -> [f64; 2] {
    let mut worst = [0.0_f64; 2];
    let samples = file["samples"].as_array().expect("samples");
    assert!(samples.len() >= 12);
    for sample in samples {
        let pose = arm.forward(&JointPos(numbers(&sample["q"])));
        let position: [f64; 3] = numbers(&sample[format!("position_m{suffix}")]);
        let [w, x, y, z] = numbers(&sample[format!("quaternion_wxyz{suffix}")]);
        let turn =
            nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z)).to_rotation_matrix();
        worst[0] = worst[0].max((pose.translation - Vector3::from(position)).norm());
        worst[1] = worst[1].max((pose.rotation - turn.matrix()).amax());
    }
    worst
}

/// Mean and largest deviation from nominal as an independent computation found them over other poses (m).
fn known_deviation(file: &Value) -> [f64; 2] {
    ["mean_mm", "max_mm"].map(|key| file["tcp_distance_from_nominal"][key].as_f64().expect("a number") * 1e-3)
}

#[test]
fn dh_deltas_give_the_controllers_chain() {
    for (name, model) in [("ur10_dh_delta_1", "ur10"), ("ur10e_dh_delta_1", "ur10e"), ("ur10e_dh_delta_2", "ur10e")] {
        let file = reference(name);
        let unit = load_text(&conf_file(&file), "conf", model).unwrap_or_else(|error| panic!("{name}: {error}"));
        let [position, rotation] = worst(&unit.arm, &file, "");
        assert!(position < 1e-11 && rotation < 1e-13, "{name}: {position:e} m, {rotation:e}");
        let mut jacobians = 0;
        for sample in file["samples"].as_array().expect("samples") {
            let Some(rows) = sample["jacobian_6xn_in_base"].as_array() else { continue };
            let (_, jacobian) = unit.arm.jacobian(&JointPos(numbers(&sample["q"])));
            for (row, expected) in rows.iter().enumerate() {
                for (column, expected) in numbers::<6>(expected).into_iter().enumerate() {
                    assert!((jacobian[(row, column)] - expected).abs() < 1e-11, "{name}");
                }
            }
            jacobians += 1;
        }
        assert!(jacobians >= 4);
        let [mean, max] = known_deviation(&file);
        assert!(
            (unit.deviation_mean - mean).abs() < 0.1 * mean && (unit.deviation_max - max).abs() < 0.1 * max,
            "{unit:?}"
        );
    }
}

#[test]
fn kinematics_files_are_read_in_the_order_of_angles_in_which_they_were_written() {
    for (name, model) in [
        ("ur10_calib_15120592593058779304", "ur10"),
        ("ur10e_calib_3437785250745286433", "ur10e"),
        ("ur3e_calib_13312600673477018527", "ur3e"),
        ("ur5e_calib_17107847223675855653", "ur5e"),
    ] {
        let file = reference(name);
        let unit = load_text(&yaml_file(&file), "yaml", model).unwrap_or_else(|error| panic!("{name}: {error}"));
        let [position, rotation] = worst(&unit.arm, &file, "_rx_ry_rz");
        assert!(position < 1e-11 && rotation < 1e-13, "{name}: {position:e} m, {rotation:e}");
        // The other order is as far away as the figures say.
        let difference = file["rpy_order"]["max_difference_mm"].as_f64().expect("a number") * 1e-3;
        let [position, _] = worst(&unit.arm, &file, "");
        assert!(position > 0.2 * difference && position < 1.1 * difference, "{name}: {position:e} {difference:e}");
        let [mean, max] = known_deviation(&file);
        assert!(
            (unit.deviation_mean - mean).abs() < 0.1 * mean && (unit.deviation_max - max).abs() < 0.15 * max,
            "{unit:?}"
        );
    }
}

/// Read as a URDF reads it, the chain is the other half of the figures: also a test of the conversion to a table.
#[test]
fn the_same_numbers_read_as_a_urdf_are_the_urdfs() {
    for name in
        ["ur10_calib_15120592593058779304", "ur3e_calib_13312600673477018527", "ur5e_calib_17107847223675855653"]
    {
        let file = reference(name);
        let step = |joint: &str| {
            let [x, y, z, roll, pitch, yaw] =
                VALUES.map(|value| file["kinematics"][joint][value].as_f64().expect("a number"));
            let link = Description::of(&robot::ur("ur10").expect("a UR"), "").links.remove(0);
            let previous_from_joint = Pose::from_roll_pitch_yaw(Vector3::new(x, y, z), roll, pitch, yaw);
            Step { previous_from_joint, axis: Vector3::z_axis(), link }
        };
        let chain = Chain { steps: JOINTS.map(step).into(), last_from_flange: Pose::identity() };
        let arm = chain.table("unit", "a test").arm::<6>("unit").expect("six joints");
        let [position, rotation] = worst(&arm, &file, "");
        assert!(position < 1e-11 && rotation < 1e-13, "{name}: {position:e} m, {rotation:e}");
    }
}

#[test]
fn a_published_file_that_is_wrong_is_refused_with_the_reason() {
    let file = reference("suspect_ur5e_calib_1282784419969490140");
    let error = load_text(&yaml_file(&file), "yaml", "ur5e").expect_err("784 mm off");
    let RobotError::Calibration {
        fault: CalibrationFault::Deviation { model: "ur5e", mean, max, backwards: true },
        ..
    } = &error
    else {
        panic!("{error}")
    };
    let [known_mean, known_max] = known_deviation(&file);
    assert!((mean - known_mean).abs() < 1e-3 && (max - known_max).abs() < 1e-3, "{error}");
    let text = Failure::from(error).to_string();
    assert!(
        text.contains("784.4 mm on average")
            && text.contains("forearm points backwards")
            && text.contains("remedy: take calibration.conf"),
        "{text}"
    );
    // And the calibration of another model.
    let other = load_text(&conf_file(&reference("ur10e_dh_delta_1")), "conf", "ur5e");
    assert!(
        matches!(other, Err(RobotError::Calibration { fault: CalibrationFault::Deviation { .. }, .. })),
        "{other:?}"
    );
}

#[test]
fn a_broken_file_is_named_with_its_place() {
    let yaml = yaml_file(&reference("ur5e_calib_17107847223675855653"));
    let conf = conf_file(&reference("ur10e_dh_delta_1"));
    let cases = [
        (
            yaml.replacen("    pitch: ", "    pich: ", 1),
            "yaml",
            ":7:1: one of x, y, z, roll, pitch, yaw expected, \"pich\" found",
        ),
        (yaml.replacen("roll: 0", "roll: nan", 1), "yaml", ":6:1: a finite number expected, \"nan\" found"),
        (
            yaml.replacen("  forearm:", "  elbow:", 1),
            "yaml",
            "one of shoulder, upper_arm, forearm, wrist_1, wrist_2, wrist_3 expected",
        ),
        (
            yaml.lines().take(20).map(|line| format!("{line}\n")).collect(),
            "yaml",
            "kinematics: forearm: pitch is missing",
        ),
        (yaml.replacen("    x: 0\n", "    x: 0\n    x: 0\n", 1), "yaml", ":4:1: each value once expected"),
        (String::new(), "yaml", "kinematics: shoulder: x is missing"),
        ("no colon".to_owned(), "yaml", ":1:1: a line `name: value` expected"),
        (conf.replacen("delta_a ", "delta_b ", 1), "conf", "delta_a is missing"),
        (conf.replacen("delta_theta = [", "delta_theta = [1,", 1), "conf", ":2:1: six finite numbers expected"),
        (conf.replacen("status = 2", "status = 1", 1), "conf", "calibration_status is 1: expected 2"),
        ("[mounting".to_owned(), "conf", "a section [mounting] with lists of six numbers expected"),
        (conf, "json", "expected a controller's calibration.conf (.conf) or a kinematics file (.yaml)"),
    ];
    for (text, ending, expected) in cases {
        let model = if ending == "yaml" { "ur5e" } else { "ur10e" };
        let error = load_text(&text, ending, model).expect_err(expected).to_string();
        assert!(error.contains(expected), "{error}\n{expected}");
    }
}
