//! The judgement, on what a sound robot tells with one thing changed.

use super::acts::Act;
use super::check::{self, Finding, Verdict};
use super::view::{Standing, View};
use crate::config::{Cell, Robot};
use crate::failure::Exit;
use crate::link::dashboard::{ProgramState, RobotMode, Safety};
use crate::link::primary::Kinematics;
use crate::link::rtde::ControllerVersion;
use crate::link::rtde::look::State;
use crate::robot::calibration;
use screed_kernel::pose::Pose;

fn numbers(pose: &Pose) -> [f64; 6] {
    let (t, r) = (pose.translation, pose.rotation_vector());
    [t.x, t.y, t.z, r.x, r.y, r.z]
}

/// The demo's cell, and what its own robot tells.
fn sound() -> (Cell, View) {
    let mut cell = Cell::demo(125).unwrap();
    cell.robot.serial = Some("20195500123".to_owned());
    let (arm, tool) = (cell.robot.arm, cell.tool.flange_from_tcp);
    let column = |value: fn(&screed_kernel::arm::Dh) -> f64| std::array::from_fn(|joint| value(&arm.dh[joint]));
    let view = View {
        standing: Standing {
            model: Some("UR10".to_owned()),
            serial: cell.robot.serial.clone(),
            software: Some([5, 11, 6, 1]),
            remote: Some(true),
            mode: RobotMode::Running,
            safety: Safety::Normal,
            program: ProgramState::Playing,
            program_name: "screed.urp".to_owned(),
        },
        controller: ControllerVersion { major: 5, minor: 11, bugfix: 6, build: 1 },
        state: State {
            timestamp: 50.0,
            actual_q: cell.robot.start.0,
            actual_tcp_pose: numbers(&(arm.forward(&cell.robot.start) * tool)),
            runtime_state: 2,
            robot_mode: 7,
            safety_status_bits: 1,
            program_state: 1,
            program_count: 41,
            target_speed_fraction: Some(1.0),
            tcp_offset: Some(numbers(&tool)),
            payload: Some(1.5),
            payload_cog: Some([0.0, 0.0, 0.1]),
        },
        is_counting: true,
        kinematics: Kinematics {
            checksum: [0; 6],
            theta: column(|dh| dh.theta),
            a: column(|dh| dh.a),
            d: column(|dh| dh.d),
            alpha: column(|dh| dh.sin_alpha.atan2(dh.cos_alpha)),
            status: 2,
        },
        inputs: Some(Ok(())),
    };
    (cell, view)
}

fn bad(findings: &[Finding]) -> Vec<&'static str> {
    findings
        .iter()
        .filter(|finding| matches!(finding.verdict, Verdict::Bad { .. }))
        .map(|finding| finding.what)
        .collect()
}

#[test]
fn a_sound_robot_is_found_sound() {
    let (mut cell, view) = sound();
    let findings = check::judge(&cell, &view);
    assert_eq!((bad(&findings), check::failure(&findings)), (vec![], None));
    // What the cell does not say is told, not judged.
    let notes = |findings: &[Finding]| findings.iter().filter(|finding| finding.verdict == Verdict::Note).count();
    assert_eq!(notes(&findings), 2);
    (cell.tool.payload, cell.tool.payload_cog) = (Some(1.45), Some([0.0, 0.005, 0.1]));
    assert_eq!(notes(&check::judge(&cell, &view)), 0);
}

#[test]
fn everything_that_is_wrong_is_found_with_its_class_and_an_action() {
    type Change = fn(&mut Cell, &mut View);
    let table: [(&str, Exit, &str, Change); 25] = [
        ("speed slider", Exit::Link, "at 50 %", |_, view| view.state.target_speed_fraction = Some(0.5)),
        ("robot model", Exit::Input, "expected ur10e, found UR5", |_, view| {
            view.standing.model = Some("UR5".to_owned())
        }),
        ("serial number", Exit::Input, "expected 20195500123, found 7", |_, view| {
            view.standing.serial = Some("7".to_owned());
        }),
        ("serial number", Exit::Input, "too old", |_, view| view.standing.serial = None),
        ("serial number", Exit::Input, "add serial = \"20195500123\"", |cell, _| {
            (cell.robot.serial, cell.robot.simulated) = (None, false);
        }),
        ("robot model", Exit::Input, "found UR10 with software 3, a CB3's", |_, view| view.controller.major = 3),
        ("safety", Exit::SafetyStop, "screed robot unlock", |_, view| view.standing.safety = Safety::ProtectiveStop),
        ("safety", Exit::SafetyStop, "emergency stop button", |_, view| {
            view.standing.safety = Safety::RobotEmergencyStop;
        }),
        ("safety", Exit::SafetyStop, "safeguard", |_, view| view.standing.safety = Safety::SafeguardStop),
        ("safety", Exit::SafetyStop, "three-position", |_, view| view.standing.safety = Safety::EnablingStop),
        ("safety", Exit::SafetyStop, "safety system", |_, view| view.standing.safety = Safety::Fault),
        ("robot", Exit::Link, "screed robot power-on", |_, view| view.standing.mode = RobotMode::PowerOff),
        ("robot", Exit::Link, "screed robot brake-release", |_, view| view.standing.mode = RobotMode::Idle),
        ("robot", Exit::Link, "confirm the safety", |_, view| view.standing.mode = RobotMode::ConfirmSafety),
        ("kinematics", Exit::Input, "calibration = \"controller\"", |_, view| view.kinematics.a[1] += 0.002),
        ("kinematics", Exit::Input, "no calibration of a ur10e", |_, view| view.kinematics.a[1] += 0.2),
        ("tool pose", Exit::Input, "calibration = \"controller\"", |_, view| view.state.actual_tcp_pose[2] += 0.0002),
        ("payload", Exit::Input, "expected 2 kg, found 1.5 kg", |cell, _| cell.tool.payload = Some(2.0)),
        ("payload's centre", Exit::Input, "installation", |cell, _| cell.tool.payload_cog = Some([0.02, 0.0, 0.1])),
        ("registers", Exit::Link, "remedy: switch the fieldbus off", |_, view| {
            view.inputs = Some(Err("all 7 inputs are in use: a fieldbus; switch the fieldbus off".to_owned()));
        }),
        ("program", Exit::Link, "--upload", |_, view| view.state.runtime_state = 1),
        ("program", Exit::Link, "close-popup", |_, view| view.state.runtime_state = 4),
        ("program", Exit::Link, "register_offset", |_, view| view.state.program_state = 0),
        ("program", Exit::Link, "screed robot stop", |_, view| view.state.program_state = 77),
        // The register of a program that has ended, while another one plays.
        ("program", Exit::Link, "screed robot stop", |_, view| view.is_counting = false),
    ];
    for (what, exit, text, change) in table {
        let (mut cell, mut view) = sound();
        change(&mut cell, &mut view);
        let findings = check::judge(&cell, &view);
        assert_eq!(bad(&findings), [what], "{text}");
        let failure = check::failure(&findings).unwrap();
        assert_eq!(failure.exit, exit, "{text}");
        let told = failure.to_string();
        assert!(told.contains(text) && told.contains("remedy: "), "{told}");
    }
}

/// At the limits stated in the documentation.
#[test]
fn the_tolerances_are_as_stated() {
    for (beyond, found) in [(0.99, false), (1.01, true)] {
        let (mut cell, mut view) = sound();
        let [distance, angle] = check::POSE_MAX;
        view.state.actual_tcp_pose[0] += distance * beyond;
        assert_eq!(bad(&check::judge(&cell, &view)).contains(&"tool pose"), found);
        let turned = cell.robot.arm.forward(&cell.robot.start)
            * cell.tool.flange_from_tcp
            * Pose::from_rotation_vector([0.0; 3].into(), [0.0, angle * beyond, 0.0].into());
        view.state.actual_tcp_pose = numbers(&turned);
        assert_eq!(bad(&check::judge(&cell, &view)).contains(&"tool pose"), found);
        (cell.tool.payload, cell.tool.payload_cog) = (Some(1.5 + 0.1 * beyond), Some([0.01 * beyond, 0.0, 0.1]));
        let findings = check::judge(&cell, &view);
        assert_eq!(bad(&findings).contains(&"payload"), found);
        assert_eq!(bad(&findings).contains(&"payload's centre"), found);
    }
}

#[test]
fn what_cannot_be_compared_is_told_and_no_obstacle() {
    let (cell, mut view) = sound();
    (view.standing.model, view.standing.remote) = (None, None);
    (view.state.tcp_offset, view.state.payload, view.state.payload_cog) = (None, None, None);
    let findings = check::judge(&cell, &view);
    assert_eq!(bad(&findings), [""; 0]);
    assert!(findings.iter().filter(|finding| finding.verdict == Verdict::Note).count() >= 5, "{findings:?}");
}

/// Models as dashboards name them: without the e-Series' letter, with spaces; a successor's by either name.
#[test]
fn models_are_known_by_the_dashboards_names() {
    for (own, told, major, fits) in [
        ("ur3e", "UR3", 5, true),
        ("ur3", "UR3", 3, true),
        ("ur3", "UR3", 5, false),
        ("ur10e", "UR10", 3, false),
        ("ur10", "UR10", 3, true),
        ("ur10", "UR10", 5, false),
        ("ur20", "UR20", 3, false),
        ("ur8long", "UR8 Long", 5, true),
        ("ur16e", "UR16e", 5, true),
        ("ur7e", "UR5", 5, true),
        ("ur7e", "UR7", 5, true),
        ("ur12e", "UR10", 5, true),
        ("ur20", "UR20", 5, true),
        ("ur20", "UR30", 5, false),
        ("ur5e", "UR3", 5, false),
        ("ur10e", "UR1", 5, false),
    ] {
        let (mut cell, mut view) = sound();
        own.clone_into(&mut cell.robot.model);
        view.standing.model = Some(told.to_owned());
        (view.controller.major, view.standing.software) = (major, Some([major, 15, 0, 0]));
        for findings in [check::judge(&cell, &view), check::identity(&cell, &view.standing)] {
            assert_eq!(!bad(&findings).contains(&"robot model"), fits, "{own} {told} {major}");
        }
    }
}

/// A published calibration, as its controller tells the whole table; written as a file, it is read back the same.
#[test]
fn a_units_table_is_used_and_written_and_read_back() {
    let (mut cell, mut view) = sound();
    let path = screed_fixtures::data("kinematics").join("calibration_ur10e_dh_delta_1.json");
    let file: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let deltas =
        |key: &str| -> [f64; 6] { std::array::from_fn(|joint| file["dh_delta"][key][joint].as_f64().unwrap()) };
    let (theta, a, d, alpha) = (deltas("theta"), deltas("a"), deltas("d"), deltas("alpha"));
    for joint in 0..6 {
        view.kinematics.theta[joint] += theta[joint];
        view.kinematics.a[joint] += a[joint];
        view.kinematics.d[joint] += d[joint];
        view.kinematics.alpha[joint] += alpha[joint];
    }
    let table = super::view::table(&view.kinematics);
    let nominal = cell.robot.arm;
    let unit = calibration::of_table(&table, &nominal).unwrap();
    assert!((0.5e-3..8e-3).contains(&unit.deviation_mean), "{}", unit.deviation_mean);
    view.state.actual_tcp_pose = numbers(&(unit.arm.forward(&cell.robot.start) * cell.tool.flange_from_tcp));
    assert_eq!(bad(&check::judge(&cell, &view)), ["kinematics", "tool pose"]);

    let folder = tempfile::tempdir().unwrap();
    let written = folder.path().join("unit.conf");
    for text in [calibration::conf(&table, &[7; 6], 2, &nominal), calibration::conf_of(&unit, &nominal)] {
        std::fs::write(&written, text).unwrap();
        let read = calibration::load(&written, &nominal).unwrap();
        assert!(calibration::distance(&read.arm, &unit.arm) < 1e-11);
    }
    cell.calibrate(unit);
    assert_eq!(bad(&check::judge(&cell, &view)), [""; 0]);
    // Of another unit.
    view.kinematics.a[2] += 1e-4;
    let told = check::failure(&check::judge(&cell, &view)).unwrap().to_string();
    assert!(told.contains("of another unit"), "{told}");
}

/// 500 Hz of a CB3, whose model is told apart too.
#[test]
fn a_rate_that_a_controller_cannot_serve_is_found() {
    let (mut cell, mut view) = sound();
    (cell.link.rate_hz, view.controller.major) = (500, 3);
    let findings = check::judge(&cell, &view);
    assert_eq!(bad(&findings), ["robot model", "software"]);
    assert!(check::failure(&findings).unwrap().to_string().contains("at most 125"));
}

/// A loopback address may be a forwarded port.
#[test]
fn a_simulated_cells_controller_that_is_none_of_screed_is_told_of() {
    let (mut cell, mut view) = sound();
    cell.robot.serial = None;
    assert!(cell.robot.simulated && !check::is_simulated(&cell, &view.standing));
    let another = Cell { robot: Robot { serial: view.standing.serial.clone(), ..cell.robot.clone() }, ..cell.clone() };
    assert!(check::is_simulated(&another, &view.standing), "the cell says so of this very number");
    assert!(!check::is_simulated(&another, &Standing { serial: None, ..view.standing.clone() }));
    let serial = |cell: &Cell, view: &View| {
        let findings = check::judge(cell, view);
        findings.into_iter().find(|finding| finding.what == "serial number").unwrap()
    };
    let found = serial(&cell, &view);
    assert!(found.verdict == Verdict::Note && found.text.contains("may be a real robot"), "{found:?}");
    view.standing.serial = Some(crate::sim::ur::SERIAL_NUMBER.to_owned());
    assert!(check::is_simulated(&cell, &view.standing));
    assert_eq!(serial(&cell, &view).verdict, Verdict::Good);
}

#[test]
fn what_moves_or_powers_asks_a_person() {
    let (_, view) = sound();
    let mut standing = view.standing;
    let asks = |act: Act, standing: &Standing| act.warning(standing).is_some();
    for (act, wanted) in [
        (Act::PowerOn, true),
        (Act::BrakeRelease, true),
        (Act::Unlock, true),
        (Act::Play, true),
        (Act::PowerOff, false),
        (Act::Stop, false),
        (Act::ClosePopup, false),
    ] {
        assert_eq!(asks(act, &standing), wanted, "{act:?}");
    }
    // A held program may go on when its popup closes.
    standing.program = ProgramState::Paused;
    assert!(asks(Act::ClosePopup, &standing));
}

#[test]
fn only_a_protective_stop_is_unlocked() {
    let (_, view) = sound();
    let at = |safety| Standing { safety, ..view.standing.clone() };
    assert_eq!(Act::Unlock.is_wanted(&at(Safety::ProtectiveStop)), Ok(true));
    for safety in [Safety::Normal, Safety::Reduced] {
        assert_eq!(Act::Unlock.is_wanted(&at(safety)), Ok(false));
        assert_eq!(Act::Play.is_wanted(&at(safety)), Ok(true));
    }
    let failure = Act::Unlock.is_wanted(&at(Safety::SafeguardStop)).unwrap_err();
    let told = failure.to_string();
    assert!(
        failure.exit == Exit::SafetyStop
            && told.contains("SAFEGUARD_STOP")
            && told.contains("close the safeguard and reset it"),
        "{told}"
    );
}
