//! The fields of the RTDE guide: names and types, for the client, for recipe files and for the simulated controller.
//!
//! Names and types as in the field table of the Universal_Robots_Client_Library (`src/rtde/data_package.cpp`).

use super::wire::FieldType;
use std::ops::Range;

/// Integer and double registers, each way.
pub const REGISTERS: usize = 48;
/// The first register of the upper half, which controllers have since 3.9 and 5.3.
pub const REGISTERS_UPPER: usize = 24;

/// Fields with a name of their own, by type.
type Named = (FieldType, &'static str);
/// Fields that differ by a number: what stands before it, and which there are.
type Numbered = (FieldType, &'static str, Range<usize>);

const OUTPUTS: [Named; 8] = [
    (
        FieldType::Double,
        "timestamp actual_execution_time target_execution_time speed_scaling target_speed_fraction actual_momentum \
         actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 \
         standard_analog_output0 standard_analog_output1 io_current actual_robot_energy_consumed \
         actual_robot_braking_energy_dissipated euromap67_24V_voltage euromap67_24V_current tool_analog_input0 \
         tool_analog_input1 tool_output_current tool_temperature tcp_force_scalar joint_position_deviation_ratio \
         collision_detection_ratio payload dexterity tool_output_current_2",
    ),
    (
        FieldType::Vector6d,
        "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current actual_current_window \
         actual_current_as_torque joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose \
         target_TCP_speed tcp_offset actual_TCP_acceleration target_TCP_acceleration joint_temperatures actual_joint_voltage \
         ft_raw_wrench wrench_calc_from_currents payload_inertia target_base_acceleration target_base_wrench",
    ),
    (FieldType::Vector3d, "actual_tool_accelerometer elbow_position elbow_velocity payload_cog target_gravity"),
    (FieldType::Vector6Int32, "joint_mode"),
    (
        FieldType::Uint64,
        "actual_digital_input_bits actual_configurable_digital_input_bits actual_digital_output_bits \
         actual_configurable_digital_output_bits control_step",
    ),
    (
        FieldType::Uint32,
        "runtime_state robot_status_bits safety_status_bits analog_io_types tool_mode tool_analog_input_types \
         script_control_line euromap67_input_bits euromap67_output_bits output_bit_registers0_to_31 \
         output_bit_registers32_to_63",
    ),
    (
        FieldType::Int32,
        "robot_mode safety_mode safety_status tool_output_voltage tool_output_voltage_2 encoder0_raw encoder1_raw \
         time_scale_source",
    ),
    (FieldType::Uint8, "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode"),
];
const OUTPUT_REGISTERS: [Numbered; 3] = [
    (FieldType::Bool, "output_bit_register_", 64..128),
    (FieldType::Int32, "output_int_register_", 0..REGISTERS),
    (FieldType::Double, "output_double_register_", 0..REGISTERS),
];
const INPUTS: [Named; 4] = [
    (FieldType::Uint32, "speed_slider_mask input_bit_registers0_to_31 input_bit_registers32_to_63"),
    (FieldType::Double, "speed_slider_fraction standard_analog_output_0 standard_analog_output_1"),
    (
        FieldType::Uint8,
        "standard_digital_output_mask standard_digital_output configurable_digital_output_mask configurable_digital_output \
         tool_digital_output_mask tool_digital_output standard_analog_output_mask standard_analog_output_type",
    ),
    (FieldType::Vector6d, "external_force_torque"),
];
const INPUT_REGISTERS: [Numbered; 3] = [
    (FieldType::Bool, "input_bit_register_", 64..128),
    (FieldType::Int32, "input_int_register_", 0..REGISTERS),
    (FieldType::Double, "input_double_register_", 0..REGISTERS),
];

/// The type of the output of this name. What clients write to the input registers can be read back.
pub fn output(name: &str) -> Option<FieldType> {
    match name.starts_with("input_") {
        true => input(name),
        false => find(&OUTPUTS, &OUTPUT_REGISTERS, name),
    }
}

/// The type of the input of this name.
pub fn input(name: &str) -> Option<FieldType> {
    find(&INPUTS, &INPUT_REGISTERS, name)
}

/// Every input.
pub fn inputs() -> impl Iterator<Item = (String, FieldType)> {
    all(&INPUTS, &INPUT_REGISTERS)
}

/// Every output but the input registers.
pub fn outputs() -> impl Iterator<Item = (String, FieldType)> {
    all(&OUTPUTS, &OUTPUT_REGISTERS)
}

fn all(named: &'static [Named], numbered: &'static [Numbered]) -> impl Iterator<Item = (String, FieldType)> {
    let named = named.iter().flat_map(|(kind, names)| names.split_whitespace().map(|name| (name.to_owned(), *kind)));
    let numbered = numbered
        .iter()
        .flat_map(|(kind, prefix, numbers)| numbers.clone().map(move |number| (format!("{prefix}{number}"), *kind)));
    named.chain(numbered)
}

fn find(named: &[Named], numbered: &[Numbered], name: &str) -> Option<FieldType> {
    // Most names are in none of the lists: that is found out before one is taken apart.
    let holds = |names: &str| !name.is_empty() && names.contains(name) && names.split(' ').any(|known| known == name);
    let by_name = named.iter().find(|(_, names)| holds(names));
    let by_number = || numbered.iter().find(|(_, prefix, numbers)| number(name, prefix, numbers.clone()).is_some());
    by_name.map(|(kind, _)| *kind).or_else(|| by_number().map(|(kind, ..)| *kind))
}

/// The number behind `prefix`, written as the guide writes it: no sign, no leading zero.
pub fn number(name: &str, prefix: &str, numbers: Range<usize>) -> Option<usize> {
    let digits = name.strip_prefix(prefix)?;
    let plain = digits.bytes().all(|digit| digit.is_ascii_digit()) && (digits == "0" || !digits.starts_with('0'));
    digits.parse().ok().filter(|number| plain && numbers.contains(number))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// The guide's table has 406 outputs, input registers among them, as counted in the client library's list; three more are in
    /// the configuration of newer software.
    #[test]
    fn every_field_is_found_once_under_its_own_name_alone() {
        let registers = inputs().filter(|(name, _)| name.starts_with("input_"));
        let all: Vec<_> = outputs().chain(registers).collect();
        let names: BTreeSet<_> = all.iter().map(|(name, _)| name).collect();
        assert_eq!((all.len(), names.len()), (409, 409));
        for (name, kind) in &all {
            assert_eq!(output(name), Some(*kind), "{name}");
        }
        for (name, kind) in inputs() {
            assert_eq!(input(&name), Some(kind), "{name}");
        }
        let none =
            ["", " ", "timestamp ", "output_int_register_48", "output_int_register_07", "output_int_register_+7"];
        for name in none.iter().chain(&["input_bit_register_63", "output_double_register_", "timestam"]) {
            assert_eq!((output(name), input(name)), (None, None), "{name}");
        }
    }
}
