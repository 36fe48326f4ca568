//! The whole table of outputs, on both controllers and in both versions of the protocol.

use super::wire::{START, Wire, double, int};
use crate::sim::ur::act::Act;
use crate::sim::ur::robot::Generation;
use screed_kernel::arms::ur::UR10E;

/// Names by type, as the RTDE guide lists them; registers are added by number.
const NAMED: [(&str, usize, &str); 7] = [
    (
        "DOUBLE",
        8,
        "timestamp actual_execution_time target_execution_time speed_scaling target_speed_fraction actual_momentum \
         actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 \
         standard_analog_output0 standard_analog_output1 io_current actual_robot_energy_consumed \
         actual_robot_braking_energy_dissipated euromap67_24V_voltage euromap67_24V_current tool_analog_input0 \
         tool_analog_input1 tool_output_current tool_temperature tcp_force_scalar joint_position_deviation_ratio \
         collision_detection_ratio payload",
    ),
    (
        "VECTOR6D",
        48,
        "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current actual_current_window \
         actual_current_as_torque joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose \
         target_TCP_speed tcp_offset actual_TCP_acceleration target_TCP_acceleration joint_temperatures \
         actual_joint_voltage ft_raw_wrench wrench_calc_from_currents payload_inertia target_base_acceleration \
         target_base_wrench",
    ),
    ("VECTOR3D", 24, "actual_tool_accelerometer elbow_position elbow_velocity payload_cog target_gravity"),
    (
        "UINT64",
        8,
        "actual_digital_input_bits actual_configurable_digital_input_bits actual_digital_output_bits \
         actual_configurable_digital_output_bits control_step",
    ),
    (
        "UINT32",
        4,
        "runtime_state robot_status_bits safety_status_bits analog_io_types tool_mode tool_analog_input_types \
         script_control_line euromap67_input_bits euromap67_output_bits output_bit_registers0_to_31 \
         output_bit_registers32_to_63 input_bit_registers0_to_31 input_bit_registers32_to_63",
    ),
    (
        "INT32",
        4,
        "robot_mode safety_mode safety_status tool_output_voltage encoder0_raw encoder1_raw time_scale_source",
    ),
    ("UINT8", 1, "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode"),
];

/// Name, type, size.
fn table() -> Vec<(String, &'static str, usize)> {
    let mut found = vec![("joint_mode".to_owned(), "VECTOR6INT32", 24)];
    for (kind, size, names) in NAMED {
        found.extend(names.split_whitespace().map(|name| (name.to_owned(), kind, size)));
    }
    for way in ["input", "output"] {
        found.extend((64..128).map(|bit| (format!("{way}_bit_register_{bit}"), "BOOL", 1)));
        found.extend((0..48).map(|register| (format!("{way}_int_register_{register}"), "INT32", 4)));
        found.extend((0..48).map(|register| (format!("{way}_double_register_{register}"), "DOUBLE", 8)));
    }
    found
}

#[test]
fn every_output_is_answered_with_its_type_by_both_controllers_in_both_protocols() {
    let table = table();
    assert_eq!(table.len(), 406);
    let names: Vec<&str> = table.iter().map(|(name, ..)| name.as_str()).collect();
    let types: Vec<&str> = table.iter().map(|(_, kind, _)| *kind).collect();
    let size: usize = table.iter().map(|(.., size)| size).sum();
    for generation in [Generation::ESeries, Generation::Cb3] {
        for protocol in [1, 2] {
            let mut wire = Wire::new(generation);
            wire.protocol(protocol);
            // All at once, as an exhaustive recipe does, and each alone.
            let (_, found) = wire.outputs(&names.join(","), 125.0);
            assert_eq!(found, types.join(","), "{generation:?}, protocol {protocol}");
            wire.start();
            let packages = wire.run(30);
            assert!(packages.len() > 3 && packages.iter().all(|package| package.len() == size));
            for (name, kind, size) in &table {
                wire.send(b'P', &[]);
                wire.packages();
                assert_eq!(wire.outputs(name, 125.0).1, *kind, "{name}");
                wire.start();
                let package = wire.run(20).pop().unwrap_or_else(|| panic!("{name}: no package"));
                assert_eq!(package.len(), *size, "{name}");
            }
        }
    }
}

#[test]
fn names_that_do_not_exist_are_not_found_and_the_others_still_typed() {
    let mut wire = Wire::new(Generation::ESeries);
    wire.protocol(2);
    let names = "timestamp,input_bit_register_63,output_int_register_48,output_int_register_01,Timestamp,xyz";
    let (id, types) = wire.outputs(names, 500.0);
    assert_eq!((id, types.as_str()), (0, "DOUBLE,NOT_FOUND,NOT_FOUND,NOT_FOUND,NOT_FOUND,NOT_FOUND"));
    // Nothing to start.
    assert_eq!(wire.ask(b'S', &[]), [0]);
    let (id, types) = wire.inputs("input_int_register_0,input_bit_register_3,timestamp");
    assert_eq!((id, types.as_str()), (0, "INT32,NOT_FOUND,NOT_FOUND"));
}

#[test]
fn the_cells_inputs_are_what_they_were_set_to() {
    let names = "actual_digital_input_bits,actual_configurable_digital_input_bits,standard_analog_input0,\
        standard_analog_input1,tool_analog_input0,tool_analog_input1";
    let mut wire = Wire::streaming(Generation::ESeries, names);
    for text in [
        "digital-input 0 on",
        "digital-input 9 on",
        "digital-input 17 on",
        "digital-input 9 off",
        "digital-input 10 on",
    ] {
        wire.controller.act(&text.parse().expect("an act")).expect("possible");
    }
    for (place, volts) in [1.5, 2.5, 3.5, 4.5].into_iter().enumerate() {
        wire.controller.act(&Act::AnalogInput(place, volts)).expect("possible");
    }
    let package = wire.next();
    assert_eq!(package[..8], (1_u64 | 1 << 10 | 1 << 17).to_be_bytes());
    assert_eq!(package[8..16], (1_u64 << 2).to_be_bytes());
    assert_eq!([16, 24, 32, 40].map(|at| double(&package, at)), [1.5, 2.5, 3.5, 4.5]);
}

/// The readings of the tool against differences of what the robot sent before and after.
#[test]
fn speeds_accelerations_and_the_accelerometer_belong_to_the_motion() {
    let program = "def test():\n  set_tcp(p[0.1, 0, 0.2, 0, 0.3, 0])\n  movej([0.9, -0.8, 1.5, -2.0, -1.2, 0.6], a=1.0, v=0.5)\nend\n";
    let mut wire = Wire::of(&UR10E, START, Generation::ESeries, program);
    wire.protocol(2);
    let names = "actual_TCP_pose,actual_TCP_speed,actual_TCP_acceleration,actual_tool_accelerometer,elbow_position,\
        elbow_velocity,script_control_line,target_gravity";
    assert_eq!(wire.outputs(names, 500.0).0, 1);
    wire.start();
    let found = wire.run(400);
    let column = |package: &[u8], at: usize| -> [f64; 3] { std::array::from_fn(|axis| double(package, at + 8 * axis)) };
    let (pose, speed, acceleration, felt, elbow, elbow_speed) = (0, 48, 96, 144, 168, 192);
    let mut fastest: f64 = 0.0;
    for pair in found[50..].windows(2) {
        let [before, now] = [&pair[0], &pair[1]];
        for axis in 0..3 {
            let change = |at: usize| (column(now, at)[axis] - column(before, at)[axis]) / 0.002;
            // A chord of the path: off by half its bend.
            assert!((change(pose) - column(now, speed)[axis]).abs() < 1e-3, "speed");
            assert!((change(elbow) - column(now, elbow_speed)[axis]).abs() < 1e-9, "elbow");
            assert!((change(speed) - column(now, acceleration)[axis]).abs() < 1e-9, "acceleration");
        }
        fastest = column(now, speed).iter().fold(fastest, |fastest, speed| fastest.max(speed.abs()));
        // Turning does not change what is felt: its size is that of acceleration and gravity together.
        let [x, y, z] = column(now, acceleration);
        let size = |vector: [f64; 3]| vector.iter().map(|value| value * value).sum::<f64>().sqrt();
        assert!((size(column(now, felt)) - size([x, y, z + 9.82])).abs() < 1e-9);
        assert_eq!(int(now, 216), 3, "the line of movej");
        assert_eq!(column(now, 220), [0.0, 0.0, 9.82]);
    }
    assert!(fastest > 0.1, "{fastest}");
}

#[test]
fn constants_are_the_same_on_every_port() {
    let mut wire =
        Wire::streaming(Generation::Cb3, "actual_main_voltage,actual_joint_voltage,joint_temperatures,tool_mode");
    let package = wire.next();
    assert_eq!((0..7).map(|place| double(&package, 8 * place)).collect::<Vec<_>>(), [48.0; 7]);
    assert_eq!((7..13).map(|place| double(&package, 8 * place)).collect::<Vec<_>>(), [25.0; 6]);
    assert_eq!(int(&package, 104), 253);
    wire.controller.power_off();
    assert_eq!(int(&wire.next(), 104), 239);
}
