use super::*;
use nalgebra::{Matrix3, Vector3};
use screed_kernel::arm::{Arm, Coupling};
use screed_kernel::arms::comau::NJ130;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::units::JointPos;
use serde_json::Value;
use std::f64::consts::FRAC_PI_2;

fn fixture(name: &str) -> String {
    std::fs::read_to_string(screed_fixtures::data("").join(name)).expect("the fixture")
}

fn ends(base: Option<&str>, tip: Option<&str>) -> Ends {
    Ends { base: base.map(str::to_owned), tip: tip.map(str::to_owned) }
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|k| value[k].as_f64().expect("a number"))
}

fn arm<const N: usize>(text: &str, ends: &Ends) -> (Description, Arm<N>) {
    let description = parse(text, "test.urdf", ends).unwrap_or_else(|(_, fault)| panic!("{fault}"));
    let arm = description.arm("test").expect("so many joints");
    (description, arm)
}

/// A seeded URDF with sliding, turning and endless joints, a default axis, fixed links between and branches, against pinocchio.
#[test]
fn a_chain_without_any_pattern_is_pinocchios() {
    let text = fixture("robots/crooked.urdf");
    let (description, arm) = arm::<7>(&text, &ends(None, Some("flange")));
    let file: Value = serde_json::from_str(&fixture("robots/crooked.json")).expect("JSON");
    let mut jacobians = 0;
    for sample in file["samples"].as_array().expect("samples") {
        let (pose, jacobian) = arm.jacobian(&JointPos(numbers(&sample["q"])));
        let rotation = Matrix3::from_fn(|row, column| sample["rotation"][row][column].as_f64().expect("a number"));
        assert!((pose.translation - Vector3::from(numbers::<3>(&sample["position_m"]))).norm() < 1e-13);
        assert!((pose.rotation - rotation).amax() < 1e-13);
        let Some(rows) = sample["jacobian_6xn_in_base"].as_array() else { continue };
        for (row, expected) in rows.iter().enumerate() {
            for (column, expected) in numbers::<7>(expected).into_iter().enumerate() {
                assert!((jacobian[(row, column)] - expected).abs() < 1e-13);
            }
        }
        jacobians += 1;
    }
    assert_eq!(jacobians, 10);
    let names: Vec<_> = description.links.iter().map(|link| link.name.as_str()).collect();
    assert_eq!(names, ["j1", "j2", "j3", "j4", "j5", "j6", "j7"]);
    assert_eq!(
        (description.links[2].position_min, description.links[2].position_max),
        (f64::NEG_INFINITY, f64::INFINITY)
    );
    assert_eq!((description.links[4].position_min, description.links[4].position_max), (-0.3, 0.8));
    assert!(description.links.iter().all(|link| link.velocity_max.is_some_and(|speed| (0.5..3.0).contains(&speed))));
    // The grippers are not on the chain, and that is said.
    let left_out: Vec<_> = description.notes.iter().filter(|note| note.contains("left out")).collect();
    assert!(left_out.len() == 2 && left_out[0].contains("grip_left (prismatic)"), "{:?}", description.notes);
}

/// A tip on a branch, and a base that lies beside the chain on a fixed link.
#[test]
fn any_base_and_tip_can_be_asked_for() {
    let text = fixture("robots/crooked.urdf");
    let (whole, _) = arm::<7>(&text, &ends(None, Some("flange")));
    let (short, _) = arm::<7>(&text, &ends(Some("base"), Some("flange")));
    let world_from_base = {
        let tree = tree::read(&text).expect("sound");
        tree.path("world", "base").expect("a path").1
    };
    let joints = [0.1, 0.2, -0.3, 0.4, 0.5, -0.6, 0.7];
    let (expected, found) = (whole.forward(&joints), world_from_base * short.forward(&joints));
    assert!((expected.translation - found.translation).norm() < 1e-14, "{expected:?} {found:?}");
    let fault = parse(&text, "", &ends(Some("finger_left"), Some("flange"))).expect_err("the finger slides").1;
    assert!(matches!(&fault, UrdfFault::MovingBase { joint, .. } if joint == "grip_left"), "{fault}");
    let fault = parse(&text, "", &ends(None, Some("nozzle"))).expect_err("no such link").1;
    assert!(matches!(&fault, UrdfFault::NoSuchLink { known, .. } if known.len() == 13), "{fault}");
    // The camera stands still against the forearm: a base for the three joints behind it.
    let (behind, _) = arm::<3>(&text, &ends(Some("camera"), Some("flange")));
    assert_eq!(behind.links[0].name, "j5");
}

#[test]
fn a_parallelogram_of_mimic_joints_is_a_coupling() {
    let text = fixture("robots/parallelogram.urdf");
    let (description, arm) = arm::<6>(&text, &ends(None, Some("flange")));
    let couplings: Vec<_> = arm.joints.iter().map(|joint| joint.coupling).collect();
    assert_eq!(couplings, NJ130.joints.map(|joint| joint.coupling));
    assert_eq!(couplings[2], Some(Coupling { joint: 1, factor: 1.0 }));
    let file: Value = serde_json::from_str(&fixture("kinematics/comau_nj130_2_6.json")).expect("JSON");
    for sample in file["samples"].as_array().expect("samples") {
        let joints = JointPos(numbers(&sample["q"]));
        let miss = (arm.forward(&joints).translation - Vector3::from(numbers::<3>(&sample["position_m"]))).norm();
        assert!(miss < 1e-14 * 3.0, "{miss:e}");
        assert!((arm.forward(&joints).rotation - NJ130.forward(&joints).rotation).amax() < 1e-14);
    }
    assert_eq!(description.links[2].name, "j3");
    assert_eq!(description.links[2].position_max, (-10.0_f64).to_radians());
    assert_eq!(
        description.notes.iter().filter(|note| note.contains("told as a coupling")).count(),
        2,
        "{:?}",
        description.notes
    );
}

/// A robot of joints that follow each other along z, `between` what stands in each joint element.
fn robot(joints: &[(&str, &str)]) -> String {
    let mut text = "<robot name=\"r\">\n<link name=\"l0\"/>\n".to_owned();
    for (index, (kind, inside)) in joints.iter().enumerate() {
        let child = index + 1;
        text += &format!(
            "<link name=\"l{child}\"/>\n<joint name=\"j{child}\" type=\"{kind}\"><parent link=\"l{index}\"/><child \
             link=\"l{child}\"/>{inside}</joint>\n"
        );
    }
    text + "</robot>\n"
}

const LIMIT: &str = "<limit lower=\"-1\" upper=\"1\" velocity=\"2\"/>";

#[test]
fn a_ur_is_a_ur() {
    let joint = |xyz: &str, rpy: &str| {
        format!(
            "<origin xyz=\"{xyz}\" rpy=\"{rpy}\"/><axis xyz=\"0 0 1\"/><limit lower=\"-6\" upper=\"6\" velocity=\"0\"/>"
        )
    };
    let turn = format!("{FRAC_PI_2} 0 0");
    let back = format!("{FRAC_PI_2} {} {}", 2.0 * FRAC_PI_2, 2.0 * FRAC_PI_2);
    let inside = [
        joint("0 0 0.1807", "0 0 0"),
        joint("0 0 0", &turn),
        joint("-0.6127 0 0", "0 0 0"),
        joint("-0.57155 0 0.17415", "0 0 0"),
        joint("0 -0.11985 0", &turn),
        joint("0 0.11655 0", &back),
    ];
    let joints: Vec<_> = inside.iter().map(|inside| ("revolute", inside.as_str())).collect();
    let (description, arm) = arm::<6>(&robot(&joints), &Ends::default());
    for (found, expected) in arm.dh.iter().zip(&UR10E.dh) {
        assert_eq!((found.sin_alpha, found.cos_alpha), (expected.sin_alpha, expected.cos_alpha));
        let off = [found.theta, found.d - expected.d, found.a - expected.a];
        assert!(off.iter().all(|off| off.abs() < 1e-15), "{found:?}");
    }
    // A speed of zero is what exporters write for "not known".
    assert_eq!(arm.velocity_max.known(), None);
    assert_eq!(description.notes.iter().filter(|note| note.contains("no highest speed")).count(), 6);
}

#[test]
fn what_cannot_be_told_is_an_error_with_its_place() {
    let good = [("revolute", LIMIT); 4];
    let with = |index: usize, kind: &'static str, inside: &'static str| {
        let mut joints = good;
        joints[index] = (kind, inside);
        robot(&joints)
    };
    let branch = robot(&good).replace("</robot>", "<link name=\"tool\"/><joint name=\"m\" type=\"fixed\"><parent link=\"l4\"/><child link=\"tool\"/></joint><link name=\"probe\"/><joint name=\"n\" type=\"fixed\"><parent link=\"l4\"/><child link=\"probe\"/></joint></robot>");
    let cases = [
        (
            with(1, "floating", ""),
            "joint j2 of the chain is floating: expected revolute, continuous, prismatic or fixed",
        ),
        (with(1, "planar", LIMIT), "joint j2 of the chain is planar"),
        (with(1, "hinge", LIMIT), "joint j2: expected a type revolute, continuous"),
        (with(2, "revolute", ""), "joint j3: expected an element limit, found none"),
        (with(2, "revolute", "<limit upper=\"x\"/>"), "joint j3: limit: upper: expected a finite number, found \"x\""),
        (
            with(2, "revolute", "<limit upper=\"inf\"/>"),
            "joint j3: limit: upper: expected a finite number, found \"inf\"",
        ),
        (
            with(2, "revolute", "<limit velocity=\"1\"/>"),
            "joint j3: limit: expected lower below upper, found \"0 and 0\"",
        ),
        (with(2, "revolute", "<limit lower=\"-1\" upper=\"1\" velocity=\"-1\"/>"), "a velocity that is not negative"),
        (with(2, "revolute", "<axis xyz=\"0 0 0\"/>"), "joint j3: axis: expected a direction"),
        (robot(&good).replace(" name=\"r\"", ""), "robot: expected an attribute name"),
        (
            with(2, "revolute", "<limit lower=\"-1e300\" upper=\"1e300\"/>"),
            "joint j3: limit: lower: expected a number from -628.3 to 628.3, found \"-1e300\"",
        ),
        (
            with(2, "prismatic", "<limit lower=\"0\" upper=\"1e16\"/>"),
            "joint j3: limit: upper: expected a number from -1000.0 to 1000.0, found \"1e16\"",
        ),
        (
            with(2, "revolute", "<limit lower=\"-1\" upper=\"1\" velocity=\"1e300\"/>"),
            "joint j3: limit: velocity: expected a number from -174.5 to 174.5, found \"1e300\"",
        ),
        (
            with(2, "revolute", "<origin xyz=\"0 0 1e300\"/>"),
            "joint j3: xyz: expected three numbers from -1000.0 to 1000.0, found \"0 0 1e300\"",
        ),
        (
            with(2, "revolute", "<axis xyz=\"0 0 1e300\"/>"),
            "joint j3: axis: xyz: expected three numbers from -1000.0 to 1000.0, found \"0 0 1e300\"",
        ),
        (
            with(2, "revolute", "<mimic joint=\"j2\" multiplier=\"1e300\"/>"),
            "joint j3: mimic: multiplier: expected a number from -1000.0 to 1000.0, found \"1e300\"",
        ),
        (with(2, "revolute", "<origin xyz=\"1 2\"/>"), "joint j3: xyz: expected three finite numbers, found \"1 2\""),
        (robot(&good[..2]), "the chain from l0 to l2 has 2 joints: expected 3 to 9"),
        (branch, "the chain's tip link can be tool or probe: expected one"),
        (robot(&good).replace("<parent link=\"l0\"/>", "<parent link=\"l4\"/>"), "is its own ancestor"),
        (robot(&good).replace("<child link=\"l3\"/>", "<child link=\"l2\"/>"), "link l2 has two parents"),
        (robot(&good).replace("<parent link=\"l2\"/>", "<parent link=\"elbow\"/>"), "link elbow is not in the file"),
        (robot(&good).replace("name=\"j2\"", "name=\"j1\""), "joint j1: expected a name of its own"),
        (robot(&good).replace("</robot>", ""), "this is not XML"),
        (
            "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\"><xacro:include/></robot>".to_owned(),
            "this is a xacro file",
        ),
        (with(3, "revolute", "<xacro:axis_of name=\"elbow\"/>"), "this is not XML"),
        (
            robot(&good)
                .replace("<robot", "<robot xmlns:xacro=\"http://ros.org/wiki/xacro\"")
                .replace("<child link=\"l2\"/>", "<child link=\"l2\"/><xacro:origin_of name=\"elbow\"/>"),
            "this is a xacro file, found xacro:origin_of",
        ),
        (robot(&good).replace("</robot>", "<link name=\"l2\"/></robot>"), "link l2 is there twice"),
        (
            with(2, "revolute", "<limit lower=\"-1\" upper=\"1\"/><limit upper=\"2\"/>"),
            "joint j3: expected one element limit",
        ),
        (with(2, "revolute", "<axis xzy=\"0 0 1\"/>"), "joint j3: axis: expected an attribute xyz, found \"xzy\""),
        (
            robot(&good).replacen("<joint ", "<Joint ", 1).replacen("</joint>", "</Joint>", 1),
            "expected an element joint, found \"Joint\"",
        ),
        ("<sdf/>".to_owned(), "the file: expected an element robot, found \"sdf\""),
        (with(3, "revolute", "<mimic joint=\"j9\"/>"), "mimic joint j4 follows joint j9, which is not in the file"),
        (with(3, "prismatic", "<mimic joint=\"j1\"/>"), "mimic joint j4 turns where joint j1 slides"),
        (
            with(3, "revolute", "<origin xyz=\"0 1 0\"/><mimic joint=\"j1\"/>"),
            "mimic joint j4 has no neighbour on its axis",
        ),
        (
            with(3, "revolute", "<mimic joint=\"j3\" multiplier=\"0.5\"/>"),
            "mimic joint j4 makes its axis move 1.5 times as far as joint j3",
        ),
    ];
    for (text, expected) in cases {
        match parse(&text, "test.urdf", &Ends::default()) {
            Err((span, fault)) => {
                assert!(fault.to_string().contains(expected), "{fault}\nexpected {expected}");
                assert!(span.end <= text.len() + 1 && !fault.remedy().is_empty());
            }
            Ok(found) => panic!("{expected}: {:?}", found.links.len()),
        }
    }
}

#[test]
fn what_is_not_read_is_said() {
    let text = robot(&[("revolute", LIMIT); 3]).replace("</robot>", "<grumpf/><gazebo/></robot>").replacen(
        "</joint>",
        "<spring stiffness=\"1\"/></joint>",
        1,
    );
    let notes = parse(&text, "test.urdf", &Ends::default()).expect("a chain").notes;
    for note in
        ["element grumpf is not read", "joint j1 has an element spring, which is not read", "joint j2 has no axis"]
    {
        assert!(notes.iter().any(|found| found.starts_with(note)), "{note}: {notes:?}");
    }
    assert!(!notes.iter().any(|note| note.contains("gazebo")), "{notes:?}");
}

#[test]
fn limits_of_a_mimic_joint_that_its_driver_does_not_keep_are_said() {
    let with = |multiplier: f64, limit: &str| {
        let level = format!("<mimic joint=\"j2\" multiplier=\"{multiplier}\"/>{limit}");
        robot(&[("revolute", LIMIT), ("revolute", LIMIT), ("revolute", LIMIT), ("revolute", &level)])
    };
    let narrow = "<limit lower=\"-0.5\" upper=\"1\" velocity=\"2\"/>";
    let slow = "<limit lower=\"-1\" upper=\"1\" velocity=\"1\"/>";
    for (text, is_said) in [(with(-1.0, LIMIT), false), (with(1.0, narrow), true), (with(1.0, slow), true)] {
        let notes = parse(&text, "test.urdf", &Ends::default()).expect("a chain").notes;
        let said =
            notes.iter().any(|note| note == "joint j2 leads joint j4 beyond limits of its own, which are not read");
        assert_eq!(said, is_said, "{notes:?}");
    }
}

/// Whatever bytes stand in the file, the answer is a description or a fault.
#[test]
fn no_text_makes_it_panic() {
    let text = fixture("robots/parallelogram.urdf");
    let mut bits = 7_u64;
    for round in 0..3_000 {
        bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let at = (bits >> 33) as usize % text.len();
        let mut spoiled = text.clone().into_bytes();
        match round % 3 {
            0 => spoiled.truncate(at),
            1 => spoiled[at] = b"0123456789 <>\"/-.en"[(bits >> 20) as usize % 19],
            _ => drop(spoiled.drain(at..(at + 40).min(text.len()))),
        }
        let spoiled = String::from_utf8_lossy(&spoiled);
        let _ = parse(&spoiled, "spoiled.urdf", &ends(None, Some("flange")));
    }
}
