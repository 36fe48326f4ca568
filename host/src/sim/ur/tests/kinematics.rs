//! Joints and pose on the wire against figures and formulas that are not the kernel's.

use super::wire::{IDLE, Wire, double};
use crate::sim::ur::robot::Generation;
use crate::sim::ur::{Controller, Options};
use screed_kernel::arm::{Arm, Dh, Rating};
use screed_kernel::arms::ur::{self as urs, UR10, UR10E};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, JointVel};
use serde_json::Value;

type Matrix = [[f64; 4]; 4];

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|row| std::array::from_fn(|column| (0..4).map(|k| a[row][k] * b[k][column]).sum()))
}

/// A joint's transform in the standard convention, from its four elementary ones.
fn joint(theta: f64, d: f64, a: f64, alpha: f64) -> Matrix {
    let turn_z = [
        [theta.cos(), -theta.sin(), 0.0, 0.0],
        [theta.sin(), theta.cos(), 0.0, 0.0],
        [0.0, 0.0, 1.0, d],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let turn_x = [
        [1.0, 0.0, 0.0, a],
        [0.0, alpha.cos(), -alpha.sin(), 0.0],
        [0.0, alpha.sin(), alpha.cos(), 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];
    times(&turn_z, &turn_x)
}

/// A pose as URScript writes it, by Rodrigues' formula.
fn pose(values: [f64; 6]) -> Matrix {
    let [x, y, z, rx, ry, rz] = values;
    let angle = (rx * rx + ry * ry + rz * rz).sqrt();
    let (s, c) = if angle > 0.0 { (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle)) } else { (1.0, 0.5) };
    let cross = [[0.0, -rz, ry], [rz, 0.0, -rx], [-ry, rx, 0.0]];
    let mut out = [[0.0, 0.0, 0.0, x], [0.0, 0.0, 0.0, y], [0.0, 0.0, 0.0, z], [0.0, 0.0, 0.0, 1.0]];
    for row in 0..3 {
        for column in 0..3 {
            let square: f64 = (0..3).map(|k| cross[row][k] * cross[k][column]).sum();
            out[row][column] = f64::from(u8::from(row == column)) + s * cross[row][column] + c * square;
        }
    }
    out
}

fn quaternion(position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Matrix {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y), position[0]],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x), position[1]],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y), position[2]],
        [0.0, 0.0, 0.0, 1.0],
    ]
}

fn farthest(a: &Matrix, b: &Matrix) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn reference(file: &str) -> Value {
    let path = screed_fixtures::data("kinematics").join(file);
    serde_json::from_str(&std::fs::read_to_string(path).expect("a file of the project")).expect("JSON")
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|k| value[k].as_f64().expect("a number"))
}

/// Speeds for those whose data sheets give none, so that the controller can be made.
fn with_speeds(arm: Arm<6>) -> Arm<6> {
    let known = arm.velocity_max.known().unwrap_or(JointVel([2.0; 6]));
    Arm { velocity_max: Rating::Known(known), ..arm }
}

/// The arm of a unit: the deltas that its controller stores, added to the table as the controller reports it.
#[expect(clippy::approx_constant, reason = "the controller's figure, not the constant")]
fn calibrated(file: &Value, nominal: Arm<6>) -> Arm<6> {
    const RIGHT_ANGLE: f64 = 1.570_796_327;
    let delta = |name: &str| numbers::<6>(&file["dh_delta"][name]);
    let (theta, a, d, alpha) = (delta("theta"), delta("a"), delta("d"), delta("alpha"));
    let nominal_alpha = [RIGHT_ANGLE, 0.0, 0.0, RIGHT_ANGLE, -RIGHT_ANGLE, 0.0];
    let dh = std::array::from_fn(|k| {
        let alpha = nominal_alpha[k] + alpha[k];
        let row = &nominal.dh[k];
        Dh {
            a: row.a + a[k],
            d: row.d + d[k],
            sin_alpha: alpha.sin(),
            cos_alpha: alpha.cos(),
            theta: row.theta + theta[k],
        }
    });
    Arm { dh, ..nominal }
}

/// What a client reads of an arm at these joints: joints, pose, tool. None where the arm cannot be there.
fn read(arm: &Arm<6>, joints: [f64; 6], tool: Option<[f64; 6]>) -> Option<[[f64; 6]; 3]> {
    let options = Options {
        start_q: JointPos(joints),
        flange_from_tcp: Pose::identity(),
        register_offset: 0,
        program: IDLE.to_owned(),
        autoplay: true,
        generation: Generation::ESeries,
        powered: true,
    };
    Controller::new(arm, options).ok()?;
    let mut wire = Wire::of(arm, JointPos(joints), Generation::ESeries, IDLE);
    if let Some([x, y, z, rx, ry, rz]) = tool {
        wire.controller.upload(&format!("sec tool():\n  set_tcp(p[{x},{y},{z},{rx},{ry},{rz}])\nend\n"));
    }
    wire.protocol(2);
    wire.outputs("actual_q,actual_TCP_pose,tcp_offset", 500.0);
    wire.start();
    let package = wire.run(10).pop().expect("data");
    Some([0, 48, 96].map(|at| std::array::from_fn(|k| double(&package, at + 8 * k))))
}

#[test]
fn the_pose_on_the_wire_is_the_one_of_the_joints_on_every_model_and_of_calibrated_units() {
    let mut arms: Vec<(Arm<6>, Value)> = Vec::new();
    for arm in urs::ALL {
        // A UR7e is taken for a UR5e.
        let file = if arm.name == "ur7e" { "ur5e.json".to_owned() } else { format!("{}.json", arm.name) };
        arms.push((arm, reference(&file)));
    }
    assert_eq!(arms.len(), 14);
    for (file, nominal) in [
        ("calibration_ur10_dh_delta_1.json", UR10),
        ("calibration_ur10e_dh_delta_1.json", UR10E),
        ("calibration_ur10e_dh_delta_2.json", UR10E),
    ] {
        let file = reference(file);
        arms.push((calibrated(&file, nominal), file));
    }
    for (arm, file) in arms {
        let arm = with_speeds(arm);
        let mut seen = 0;
        for sample in file["samples"].as_array().expect("samples") {
            let joints: [f64; 6] = numbers(&sample["q"]);
            let tool = (seen % 2 == 1).then_some([0.03, -0.1, 0.25, 0.4, -0.7, 1.1]);
            let Some([q, tcp, offset]) = read(&arm, joints, tool) else { continue };
            assert_eq!(q, joints, "{}", arm.name);
            assert!(farthest(&pose(offset), &pose(tool.unwrap_or([0.0; 6]))) < 1e-12, "{}", arm.name);
            let base_from_tcp = pose(tcp);
            // Formulas of this file, to what doubles can hold.
            let mut chain = pose([0.0; 6]);
            for (row, q) in arm.dh.iter().zip(q) {
                chain = times(&chain, &joint(q + row.theta, row.d, row.a, row.sin_alpha.atan2(row.cos_alpha)));
            }
            let with_tool = times(&chain, &pose(tool.unwrap_or([0.0; 6])));
            assert!(
                farthest(&with_tool, &base_from_tcp) < 1e-12,
                "{}: {:e}",
                arm.name,
                farthest(&with_tool, &base_from_tcp)
            );
            // Figures of another tool, which writes right angles to nine digits.
            let flange = quaternion(numbers(&sample["position_m"]), numbers(&sample["quaternion_wxyz"]));
            let expected = times(&flange, &pose(tool.unwrap_or([0.0; 6])));
            assert!(
                farthest(&expected, &base_from_tcp) < 1.5e-9,
                "{}: {:e}",
                arm.name,
                farthest(&expected, &base_from_tcp)
            );
            seen += 1;
        }
        assert!(seen >= 10, "{}: {seen} poses", arm.name);
    }
}
