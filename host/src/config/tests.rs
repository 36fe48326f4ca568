use super::error::MANUAL;
use super::*;
use nalgebra::{Matrix3, Vector3};
use screed_kernel::ik::ur;

const DEMO: &str = include_str!("../../../fixtures/cells/demo.toml");
const FIM_FIXTURE: &str = include_str!("../../../fixtures/cells/fim_fixture.toml");

/// What is wrong with the demo cell once `from` is replaced by `to`.
fn findings(from: &str, to: &str) -> Vec<Finding> {
    assert!(DEMO.contains(from), "the demo cell has no {from:?}");
    match parse("cell.toml", &DEMO.replacen(from, to, 1)) {
        Err(ConfigError::Invalid { findings }) => findings,
        other => panic!("{from:?} -> {to:?} gave {other:?}"),
    }
}

/// Line and column of the text `at` within `to`, once it has replaced `from`.
fn place(from: &str, to: &str, at: &str) -> (usize, usize) {
    let text = DEMO.replacen(from, to, 1);
    let offset = text.find(to).and_then(|start| Some(start + to.rfind(at)?)).expect("the text is there");
    let before = text.get(..offset).unwrap_or_default();
    (before.matches('\n').count() + 1, offset - before.rfind('\n').map_or(0, |newline| newline + 1) + 1)
}

/// One finding at the text `at`, its message and its remedy.
fn check(from: &str, to: &str, at: &str, message: &str, remedy: &str) {
    let [finding] = findings(from, to).try_into().unwrap_or_else(|all| panic!("{all:#?}"));
    assert_eq!((finding.place.line, finding.place.column), place(from, to, at), "{finding}");
    assert_eq!(finding.fault.to_string(), message);
    assert_eq!(finding.fault.remedy(MANUAL), remedy);
}

#[test]
fn the_demo_cell_is_read_in_si() {
    let cell = Cell::demo(500).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(cell.name, "demo");
    assert_eq!(cell.robot.arm, screed_kernel::arms::ur::UR10E);
    assert_eq!(Some(cell.robot.joint_velocity_max), screed_kernel::arms::ur::UR10E.velocity_max.known());
    assert_eq!(cell.robot.start.0[1], -std::f64::consts::FRAC_PI_2);
    assert_eq!(cell.tool.flange_from_tcp, Pose::from_translation(0.0, 0.0, 0.2));
    let x_axis_of_part = cell.part.base_from_part.rotation.column(0).into_owned();
    assert!((x_axis_of_part - Vector3::new(0.5f64.sqrt(), -(0.5f64.sqrt()), 0.0)).norm() < 1e-15);
    assert_eq!(cell.limits, Limits { path_velocity_max: 0.25, path_acceleration_max: 0.25, path_jerk_max: 10.0 });
    assert_eq!((cell.travel.lift, cell.link.timeout, cell.link.watchdog), (0.05, 0.5, 0.5));
    assert_eq!((cell.link.port, cell.link.rate_hz, cell.link.register_offset), (30_004, 500, 0));
    assert_eq!((cell.extruder.baud, cell.extruder.flow_max), (115_200, 1e-4));
    assert_eq!(cell.realtime, Realtime::default());
    assert!(matches!(Cell::demo(250), Err(ConfigError::DemoRate { found: 250 })));
}

#[test]
fn a_slip_in_a_key_is_named_with_the_key_that_was_meant() {
    check(
        "lift_mm",
        "lift_m",
        "lift_m",
        "lift_m has the wrong unit: expected lift_mm, in millimetres",
        "write lift_mm and give the value in millimetres",
    );
    check(
        "lift_mm",
        "lift",
        "lift",
        "lift has the wrong unit: expected lift_mm, in millimetres",
        "write lift_mm and give the value in millimetres",
    );
    check("servoj_gain", "servo_gain", "servo_gain", "servo_gain is not a key of [link]", "did you mean servoj_gain?");
    check(
        "kind =",
        "colour = 3\nkind =",
        "colour",
        "colour is not a key of [link]",
        "remove it; docs/cell.md lists every key",
    );
    check(
        "[link]",
        "[nozzle]\n[link]",
        "nozzle",
        "nozzle is not a section of the top of the file",
        "remove it; docs/cell.md lists every section",
    );
    check("name =", "nmae =", "nmae", "nmae is not a key of the top of the file", "did you mean name?");
}

#[test]
fn a_value_of_another_type_is_named_with_the_line_to_write() {
    let number = "expected a number from 1 to 1000 (millimetres), found";
    check(
        "lift_mm = 50",
        "lift_mm = \"20 mm\"",
        "\"20",
        &format!("lift_mm: {number} the text \"20 mm\""),
        "write lift_mm = 20",
    );
    check(
        "lift_mm = 50",
        "lift_mm = true",
        "true",
        &format!("lift_mm: {number} true"),
        "give lift_mm a number from 1 to 1000 (millimetres)",
    );
    check(
        "rate_hz = 125",
        "rate_hz = 125.0",
        "125.0",
        "rate_hz: expected 125 or 500, found the number 125.0",
        "give rate_hz 125 or 500",
    );
    check(
        "simulated = true",
        "simulated = \"yes\"",
        "\"yes\"",
        "simulated: expected true or false, found the text \"yes\"",
        "give simulated true or false",
    );
    check(
        "xyz_mm = [0, 0, 200]",
        "xyz_mm = [0, 200]",
        "[0",
        "xyz_mm: expected 3 numbers from -100000 to 100000 (millimetres), found 2 values",
        "set xyz_mm to 3 numbers from -100000 to 100000 (millimetres)",
    );
    check(
        "[link]",
        "[[link]]",
        "[[link]]",
        "link: expected a section, written [link], found a list of 1 values",
        "give link a section, written [link]",
    );
}

#[test]
fn a_value_that_cannot_be_is_named_with_what_it_may_be() {
    let cases = [
        (
            "acceleration_max_mm_s2 = 250",
            "acceleration_max_mm_s2 = 0",
            "0",
            "a number from 1 to 100000 (millimetres per second squared), found 0",
        ),
        (
            "velocity_max_mm_s = 250",
            "velocity_max_mm_s = -5",
            "-5",
            "a number from 0.1 to 10000 (millimetres per second), found -5",
        ),
        ("lift_mm = 50", "lift_mm = nan", "nan", "a number from 1 to 1000 (millimetres), found NaN"),
        ("lift_mm = 50", "lift_mm = inf", "inf", "a number from 1 to 1000 (millimetres), found inf"),
        ("rate_hz = 125", "rate_hz = 250", "250", "125 or 500, found 250"),
        ("rate_hz = 125", "rate_hz = 125\nregister_offset = 12", "12", "0 or 24, found 12"),
        ("rate_hz = 125", "rate_hz = 125\nport = 70000", "70000", "a whole number from 1 to 65535, found 70000"),
        (
            "rate_hz = 125",
            "rate_hz = 125\nport = 99999999999999999999",
            "99999999999999999999",
            "a whole number from 1 to 65535, found 99999999999999999999",
        ),
        (
            "servoj_lookahead_s = 0.1",
            "servoj_lookahead_s = 0.02",
            "0.02",
            "a number from 0.03 to 0.2 (seconds), found 0.02",
        ),
        ("servoj_gain = 300", "servoj_gain = 99", "99", "a number from 100 to 2000 (no unit), found 99"),
        ("watchdog_ms = 500", "watchdog_ms = 10", "10", "at least 16, two cycles at 125 Hz, found 10"),
        (
            "xyz_mm = [150,",
            "xyz_mm = [150000,",
            "150000",
            "a number from -100000 to 100000 (millimetres), found 150000",
        ),
        (
            "[120, 120, 180",
            "[120, 121, 180",
            "[120",
            "no more than the data sheet's 120.0 deg/s for joint 2, found 121.0 deg/s",
        ),
        (
            "model = \"ur10e\"",
            "model = \"ur9\"",
            "\"ur9\"",
            "one of ur3, ur5, ur10, ur3e, ur5e, ur7e, ur10e, ur12e, ur16e, ur8long, ur15, ur18, ur20, ur30, found \"ur9\"",
        ),
        ("kind = \"rtde\"", "kind = \"rsi\"", "\"rsi\"", "\"rtde\", found \"rsi\""),
        ("name = \"demo\"", "name = \" \"", "\" \"", "a text in quotes, not empty, found \" \""),
        (
            "address = \"127.0.0.1\"",
            "address = \"127.0.0.1:30004\"",
            "\"127",
            "a host name or IP address alone (the port is a key of its own), found \"127.0.0.1:30004\"",
        ),
        (
            "address = \"127.0.0.1\"",
            "address = \"192.168.0.9\"",
            "\"192",
            "\"127.0.0.1\" for a simulated robot (or [robot] simulated = false), found \"192.168.0.9\"",
        ),
        (
            "flow_max_mm3_s = 100000",
            "flow_max_mm3_s = 100000\n[realtime]\npriority = 0",
            "0",
            "a whole number from 1 to 99, found 0",
        ),
    ];
    for (from, to, at, expected_and_found) in cases {
        let [finding] = findings(from, to).try_into().unwrap_or_else(|all| panic!("{all:#?}"));
        let message = finding.fault.to_string();
        assert!(message.ends_with(&format!(": expected {expected_and_found}")), "{message}");
        assert!(finding.fault.remedy(MANUAL).starts_with("set "), "{}", finding.fault.remedy(MANUAL));
        assert_eq!((finding.place.line, finding.place.column), place(from, to, at), "{finding}");
    }
}

#[test]
fn speeds_that_no_data_sheet_gives_stand_in_the_cell() {
    let text = Cell::demo_text(125).unwrap_or_else(|error| panic!("{error}"));
    let [with, key] = ["model = \"ur18\"", "joint_velocity_max_deg_s = [120, 120, 180, 180, 180, 180]\n"];
    let text = text.replacen("model = \"ur10e\"", with, 1);
    let cell = parse("cell.toml", &text).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(cell.robot.arm.velocity_max.known(), Some(cell.robot.joint_velocity_max));
    let error = parse("cell.toml", &text.replacen(key, "", 1)).expect_err("a cell without speeds").to_string();
    assert!(error.contains("[robot] lacks joint_velocity_max_deg_s: expected 6 numbers"), "{error}");
    // A data sheet's speeds are the default.
    assert!(parse("cell.toml", &text.replacen("ur18", "ur12e", 1).replacen(key, "", 1)).is_ok());
}

#[test]
fn a_calibration_lies_beside_the_cell_file_and_is_judged() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cell.toml");
    let text = Cell::demo_text(125).unwrap_or_else(|error| panic!("{error}"));
    let with = text.replacen("model = \"ur10e\"\n", "model = \"ur10e\"\ncalibration = \"unit.conf\"\n", 1);
    std::fs::write(&file, with).expect("a file");
    let error = load(&file).expect_err("no such calibration").to_string();
    assert!(error.contains("calibration: expected the calibration of a unit of ur10e, found cannot read"), "{error}");
    let lists = |d: f64| {
        format!(
            "delta_theta = {0}\ndelta_a = {0}\ndelta_d = [0, 0, 0, 0, 0, {d}]\ndelta_alpha = {0}\n",
            "[0, 0, 0, 0, 0, 0]"
        )
    };
    let calibration =
        |d| std::fs::write(folder.path().join("unit.conf"), format!("[mounting]\n{}", lists(d))).expect("a file");
    calibration(0.003);
    let unit = load(&file).unwrap_or_else(|error| panic!("{error}")).robot;
    assert!(
        (unit.arm.dh[5].d - 0.11955).abs() < 1e-15
            && unit.calibration.is_some_and(|unit| (unit.deviation_max - 0.003).abs() < 1e-6)
    );
    calibration(0.3);
    let error = load(&file).expect_err("300 mm off").to_string();
    assert!(error.contains("it moves the flange by 300.0 mm on average"), "{error}");
}

#[test]
fn a_unit_is_named_and_may_be_calibrated_by_its_controller() {
    let robot = |keys: &str| DEMO.replacen("simulated = true\n", &format!("simulated = true\n{keys}\n"), 1);
    let usual = parse("cell.toml", DEMO).unwrap();
    assert_eq!((usual.robot.serial, usual.robot.first_layer_rate), (None, 0.5));
    assert_eq!((usual.tool.payload, usual.tool.payload_cog), (None, None));
    let ports =
        parse("cell.toml", &DEMO.replacen("[link]", "[link]\ndashboard_port = 7\nprimary_port = 8", 1)).unwrap();
    assert_eq!((ports.link.dashboard_port, ports.link.primary_port), (Some(7), Some(8)));
    let text = robot("serial = \"20195500123\"\ncalibration = \"controller\"\nfirst_layer_rate = 0.3").replacen(
        "[tool]\n",
        "[tool]\npayload_kg = 4.5\npayload_cog_mm = [0, -20, 85]\n",
        1,
    );
    let cell = parse("cell.toml", &text).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((cell.robot.serial.as_deref(), cell.robot.first_layer_rate), (Some("20195500123"), 0.3));
    assert_eq!((cell.tool.payload, cell.tool.payload_cog), (Some(4.5), Some([0.0, -0.02, 0.085])));
    assert!(cell.robot.calibration_of_controller && cell.robot.calibration.is_none());
    for (keys, expected) in [
        ("first_layer_rate = 1.5", "first_layer_rate: expected a number from 0.05 to 1"),
        ("first_layer_rate = 0", "first_layer_rate: expected a number from 0.05 to 1"),
        ("serial = 20195500123", "serial: expected a text in quotes"),
    ] {
        let error = parse("cell.toml", &robot(keys)).expect_err(keys).to_string();
        assert!(error.contains(expected), "{error}");
    }

    // What moves the robot has to have the unit's table, and takes none where the cell wants none.
    let folder = tempfile::tempdir().expect("a folder");
    let (file, unit) = (folder.path().join("cell.toml"), folder.path().join("unit.conf"));
    let zero = "[0, 0, 0, 0, 0, 0]";
    let lists =
        format!("delta_theta = {zero}\ndelta_a = {zero}\ndelta_d = [0, 0, 0, 0, 0, 0.003]\ndelta_alpha = {zero}\n");
    std::fs::write(&unit, format!("[mounting]\n{lists}")).expect("a file");
    std::fs::write(&file, &text).expect("a file");
    assert!(matches!(load_to_move(&file, None), Err(ConfigError::ControllersCalibration { is_wanted: true })));
    let cell = load_to_move(&file, Some(&unit)).unwrap_or_else(|error| panic!("{error}"));
    assert!((cell.robot.arm.dh[5].d - 0.11955).abs() < 1e-15 && cell.robot.calibration.is_some());
    assert!(matches!(load_to_move(&file, Some(&file)), Err(ConfigError::Calibration(_))));
    std::fs::write(&file, DEMO).expect("a file");
    assert!(matches!(load_to_move(&file, Some(&unit)), Err(ConfigError::ControllersCalibration { is_wanted: false })));
    assert!(load_to_move(&file, None).is_ok());
}

#[test]
fn everything_missing_is_reported_at_once() {
    let ConfigError::Invalid { findings } = parse("cell.toml", "name = \"empty\"").expect_err("an empty cell") else {
        panic!("another error")
    };
    let missing: Vec<_> = findings
        .iter()
        .filter_map(|finding| match &finding.fault {
            Fault::MissingSection { section, .. } => Some(*section),
            _ => None,
        })
        .collect();
    assert_eq!(missing, ["robot", "tool", "base", "part", "limits", "travel", "link", "extruder"]);
    check(
        "[travel]\n# Clears three fresh layers.\nlift_mm = 50\n",
        "[travel]\n",
        "travel",
        "[travel] lacks lift_mm: expected a number from 1 to 1000 (millimetres)",
        "add a line `lift_mm = …` below [travel]",
    );
}

#[test]
fn a_text_that_is_no_toml_gives_its_place_and_nothing_guessed() {
    let findings = findings("lift_mm = 50", "lift_mm = 5 0");
    assert!(findings.iter().all(|finding| matches!(finding.fault, Fault::Syntax { .. })), "{findings:#?}");
    let line = DEMO.lines().position(|line| line == "lift_mm = 50").map(|index| index + 1);
    assert_eq!(findings.first().map(|finding| finding.place.line), line);
}

#[test]
fn mutilated_cell_files_give_errors_and_no_panic() {
    for end in (0..DEMO.len()).filter(|&end| DEMO.is_char_boundary(end)) {
        // A cut inside the last comment or number can leave a whole cell; anything earlier cannot.
        let cut = parse("cut.toml", DEMO.get(..end).unwrap_or_default());
        assert!(cut.is_err() || end + 8 > DEMO.len(), "cut at {end}");
    }
    // A linear congruential generator (Knuth's MMIX constants), seed 1.
    let mut state = 1u64;
    let mut next = move |bound: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % bound
    };
    let alphabet = b"[]{}=\"'.,#-0e \n\xc3";
    for _ in 0..3000 {
        let mut bytes = DEMO.as_bytes().to_vec();
        for _ in 0..=next(3) {
            let at = next(bytes.len());
            if let (Some(byte), Some(&new)) = (bytes.get_mut(at), alphabet.get(next(alphabet.len()))) {
                *byte = new;
            }
        }
        // Whether it is an error depends on the place; that it neither panics nor hangs does not.
        drop(parse("mutated.toml", &String::from_utf8_lossy(&bytes)));
    }
}

#[test]
fn a_missing_file_is_named() {
    let error = load(Path::new("no/such/cell.toml")).expect_err("there is no such file");
    assert!(matches!(error, ConfigError::Read { .. }));
    assert!(error.to_string().contains("no/such/cell.toml"));
}

#[test]
fn a_workspace_is_planes_in_the_base_frame_and_may_be_left_out() {
    assert!(Cell::demo(125).unwrap_or_else(|error| panic!("{error}")).workspace.is_empty());
    let text = DEMO.replacen("[limits]", "[workspace]\nx_max_mm = 1200\nz_min_mm = -150\n\n[limits]", 1);
    let cell = parse("cell.toml", &text).unwrap_or_else(|error| panic!("{error}"));
    let bound = |key, normal_in_base, offset| Bound { key, plane: Plane { normal_in_base, offset } };
    let expected = [bound("x_max_mm", [1.0, 0.0, 0.0], 1.2), bound("z_min_mm", [0.0, 0.0, -1.0], 0.15)];
    assert_eq!(cell.workspace, expected);
    check(
        "[limits]",
        "[workspace]\ny_min_mm = 5\ny_max_mm = 5\n\n[limits]",
        "5\n\n",
        "y_max_mm: expected more than 5 mm, where the workspace begins, found 5",
        "set y_max_mm to more than 5 mm, where the workspace begins",
    );
}

#[test]
fn the_deviation_is_a_key_of_its_own_and_by_default_that_of_the_following_error() {
    let following = "following_error_max_deg = 8";
    let configured = |text: &str| {
        let robot = parse("cell.toml", text).unwrap().configure();
        [robot.following_error_max, robot.deviation_max].map(f64::to_degrees)
    };
    let near = |[a, b]: [f64; 2], [c, d]: [f64; 2]| assert!((a - c).abs() < 1e-12 && (b - d).abs() < 1e-12, "{a} {b}");
    near(configured(DEMO), [8.0, 8.0]);
    near(configured(&DEMO.replace(following, &format!("{following}\ndeviation_max_deg = 0.5"))), [8.0, 0.5]);
    let [wrong] = findings(following, &format!("{following}\ndeviation_max_deg = 0")).try_into().unwrap();
    let expected = "deviation_max_deg: expected a number from 0.01 to 30 (degrees), found 0";
    assert_eq!(wrong.fault.to_string(), expected);
}

#[test]
fn the_manual_lists_every_key_with_its_range() {
    let manual = include_str!("../../../docs/cell.md");
    for key in keys::ALL {
        let range = format!("{} … {}", key.low, key.high);
        let row = manual.lines().find(|line| line.contains(&format!("`{}`", key.name)) && line.contains(&range));
        assert!(row.is_some(), "docs/cell.md has no row with {} and {range}", key.name);
    }
}

/// Joints that put the nozzle, pointing down, on a point of the part frame.
fn joints_at(cell: &Cell, point_in_part: Vector3<f64>, seed: &JointPos<6>) -> JointPos<6> {
    let down = Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);
    let part_from_tcp = Pose { rotation: down, translation: point_in_part };
    let base_from_flange = cell.part.base_from_part * part_from_tcp * cell.tool.flange_from_tcp.inverse();
    let joints = ur::nearest(&cell.robot.arm, &base_from_flange, seed);
    let joints = joints.unwrap_or_else(|error| panic!("{point_in_part:?}: {error:?}")).joints;
    let reached = cell.robot.arm.forward(&joints);
    assert!((reached.translation - base_from_flange.translation).norm() < 1e-9);
    assert!((reached.rotation - base_from_flange.rotation).norm() < 1e-9);
    joints
}

fn farthest(a: &JointPos<6>, b: &JointPos<6>) -> f64 {
    a.0.iter().zip(&b.0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// How far (rad) a joint turns at most for a metre of the tool in any direction.
fn joint_gain(cell: &Cell, point_in_part: Vector3<f64>, joints: &JointPos<6>) -> f64 {
    const STEP: f64 = 1e-6;
    let columns = [Vector3::x(), Vector3::y(), Vector3::z()]
        .map(|direction: Vector3<f64>| joints_at(cell, point_in_part + direction * STEP, joints));
    let gain = |joint: usize| columns.iter().map(|moved| (moved.0[joint] - joints.0[joint]).powi(2)).sum::<f64>();
    (0..6).map(gain).fold(0.0, f64::max).sqrt() / STEP
}

/// Walks all over the wall from the start joints and checks that one branch reaches it, far from singular, with the joint
/// limits far above what the path's limits need.
fn check_wall(text: &str, points_in_layer: &[Vector3<f64>], heights: &[f64], gain_expected: f64) {
    let cell = parse("wall.toml", text).unwrap_or_else(|error| panic!("{error}"));
    let mut joints = cell.robot.start;
    let mut gain_max: f64 = 0.0;
    for (index, height) in heights.iter().enumerate() {
        for (step, point) in points_in_layer.iter().enumerate() {
            let point = point + Vector3::z() * *height;
            let next = joints_at(&cell, point, &joints);
            // The first step is the approach from the start joints.
            let limit: f64 = if (index, step) == (0, 0) { 80.0 } else { 25.0 };
            assert!(farthest(&next, &joints) < limit.to_radians(), "{point:?}: {joints:?} -> {next:?}");
            joints = next;
            assert!(farthest(&joints, &cell.robot.start) < 80f64.to_radians(), "{point:?}: {joints:?}");
            // Wrist singular at sin θ5 = 0, elbow at sin θ3 = 0.
            assert!(joints.0[4].sin().abs() > 0.99 && joints.0[2].sin().abs() > 0.5, "{point:?}: {joints:?}");
            // Shoulder singular where the wrist is d4 = 0.174 m from the base's axis; the nozzle is below the wrist.
            let point_in_base = cell.part.base_from_part.transform_point(&point);
            assert!(point_in_base.xy().norm() > 0.5, "{point_in_base:?}");
            gain_max = gain_max.max(joint_gain(&cell, point, &joints));
        }
    }
    // The figure that the cell file's comment gives.
    assert!((gain_max - gain_expected).abs() < 0.1, "{gain_max} rad/m");
    for joint in 0..6 {
        let head_room = 3.0 * gain_max;
        assert!(cell.limits.path_velocity_max * gain_max * 1.5 < cell.robot.joint_velocity_max.0[joint]);
        assert!(cell.limits.path_acceleration_max * head_room < cell.robot.joint_acceleration_max.0[joint]);
        assert!(cell.limits.path_jerk_max * head_room < cell.robot.joint_jerk_max.0[joint]);
    }
}

/// An arc to and fro over the annulus, so that consecutive points are neighbours.
fn annulus(radii: &[f64]) -> Vec<Vector3<f64>> {
    let arc = |(index, radius): (usize, &f64)| {
        let radius = *radius;
        (0..=45).map(move |step| {
            let step = if index % 2 == 0 { step } else { 45 - step };
            let angle = f64::from(step * 2).to_radians();
            Vector3::new(radius * angle.cos(), radius * angle.sin(), 0.0)
        })
    };
    radii.iter().enumerate().flat_map(arc).collect()
}

/// Up along the layers, then to the lift above the last one.
fn heights(layers: u8, lift: f64) -> Vec<f64> {
    let mut heights: Vec<f64> = (1..=layers).map(|layer| f64::from(layer) * 0.015).collect();
    heights.push(f64::from(layers) * 0.015 + lift);
    heights
}

#[test]
fn the_robot_of_the_demo_reaches_all_of_the_quarter_circle() {
    // An even number of arcs ends where the next height begins; the margin covers half a bead and lead-ins.
    check_wall(DEMO, &annulus(&[0.52, 0.55, 0.58, 0.62, 0.65, 0.68]), &heights(10, 0.05), 2.3);
}

#[test]
fn the_robot_of_the_larger_cell_reaches_all_of_its_wall_and_tail() {
    let mut points = annulus(&[0.90, 0.92, 0.96, 1.0, 1.08, 1.10]);
    // The tail bulges to 30 mm on either side of the wall's end.
    points.extend([Vector3::new(0.92, 0.0, 0.0), Vector3::new(0.94, -0.03, 0.0), Vector3::new(1.0, -0.03, 0.0)]);
    points.extend([Vector3::new(1.0, 0.03, 0.0), Vector3::new(0.92, 0.03, 0.0)]);
    check_wall(FIM_FIXTURE, &points, &heights(5, 0.05), 2.75);
}
