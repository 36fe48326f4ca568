//! The fields of the RTDE guide: names, types, and what the simulated controller has to say about each.
//!
//! Names and types as in the field table of the Universal_Robots_Client_Library (`src/rtde/data_package.cpp`).

use crate::link::rtde::wire::{FieldType, PayloadReader};
use std::collections::HashMap;

/// Integer and double registers, each way.
pub(super) const REGISTERS: usize = 48;

/// Inputs that are no registers.
const NAMED_INPUTS: [(&str, FieldType); 13] = [
    ("speed_slider_mask", FieldType::Uint32),
    ("speed_slider_fraction", FieldType::Double),
    ("standard_digital_output_mask", FieldType::Uint8),
    ("standard_digital_output", FieldType::Uint8),
    ("configurable_digital_output_mask", FieldType::Uint8),
    ("configurable_digital_output", FieldType::Uint8),
    ("tool_digital_output_mask", FieldType::Uint8),
    ("tool_digital_output", FieldType::Uint8),
    ("standard_analog_output_mask", FieldType::Uint8),
    ("standard_analog_output_type", FieldType::Uint8),
    ("standard_analog_output_0", FieldType::Double),
    ("standard_analog_output_1", FieldType::Double),
    ("external_force_torque", FieldType::Vector6d),
];

/// The value of an input: the bytes of its type, big-endian, as they came.
type Raw = [u8; 48];

/// Every input by name, with the last value received. A place in this table stands for the input.
#[derive(Clone, Debug)]
pub(super) struct InputValues {
    places: HashMap<String, (usize, FieldType)>,
    raw: Vec<Raw>,
    first_int: usize,
    first_double: usize,
}

impl InputValues {
    /// All zero, as after the controller's start.
    pub(super) fn new() -> Self {
        let mut fields: Vec<(String, FieldType)> = Vec::new();
        fields.extend(NAMED_INPUTS.map(|(name, kind)| (name.to_owned(), kind)));
        fields.extend(["0_to_31", "32_to_63"].map(|n| (format!("input_bit_registers{n}"), FieldType::Uint32)));
        fields.extend((64..128).map(|n| (format!("input_bit_register_{n}"), FieldType::Bool)));
        let first_int = fields.len();
        fields.extend((0..REGISTERS).map(|n| (format!("input_int_register_{n}"), FieldType::Int32)));
        let first_double = fields.len();
        fields.extend((0..REGISTERS).map(|n| (format!("input_double_register_{n}"), FieldType::Double)));
        let raw = vec![[0; 48]; fields.len()];
        let places = fields.into_iter().enumerate().map(|(place, (name, kind))| (name, (place, kind))).collect();
        Self { places, raw, first_int, first_double }
    }

    /// How many inputs there are.
    pub(super) fn len(&self) -> usize {
        self.raw.len()
    }

    /// The place and type of the input of this name.
    pub(super) fn find(&self, name: &[u8]) -> Option<(usize, FieldType)> {
        self.places.get(std::str::from_utf8(name).ok()?).copied()
    }

    /// Takes a new value.
    pub(super) fn set(&mut self, place: usize, value: &[u8]) {
        if let Some(slot) = self.raw.get_mut(place).and_then(|raw| raw.get_mut(..value.len())) {
            slot.copy_from_slice(value);
        }
    }

    fn raw(&self, place: usize) -> &[u8] {
        self.raw.get(place).map_or(&[], |raw| raw)
    }

    fn named(&self, name: &str) -> PayloadReader<'_> {
        PayloadReader::new(self.places.get(name).map_or(&[], |(place, _)| self.raw(*place)))
    }

    /// An integer register, 0 where there is none.
    pub(super) fn int(&self, register: usize) -> i32 {
        PayloadReader::new(self.raw(self.first_int + register)).i32().unwrap_or(0)
    }

    /// A double register, 0 where there is none.
    pub(super) fn double(&self, register: usize) -> f64 {
        PayloadReader::new(self.raw(self.first_double + register)).f64().unwrap_or(0.0)
    }

    /// The bits of a digital output group after its mask was applied to `before`.
    pub(super) fn digital(&self, group: &str, before: u8) -> u8 {
        let mask = self.named(&format!("{group}_mask")).u8().unwrap_or(0);
        let wanted = self.named(group).u8().unwrap_or(0);
        (before & !mask) | (wanted & mask)
    }

    /// The fraction of the speed slider, 1 until a client sets it.
    pub(super) fn speed_slider(&self) -> f64 {
        let mask = self.named("speed_slider_mask").u32().unwrap_or(0);
        if mask == 0 { 1.0 } else { self.named("speed_slider_fraction").f64().unwrap_or(1.0) }
    }
}

/// What the robot says of itself in one cycle, for the outputs that mean something in the simulation (SI).
#[derive(Clone, Debug)]
pub(super) struct Snapshot {
    pub timestamp: f64,
    pub cycle: u64,
    pub target_q: [f64; 6],
    pub target_qd: [f64; 6],
    pub target_qdd: [f64; 6],
    pub tcp_pose: [f64; 6],
    pub tcp_speed: [f64; 6],
    pub tcp_offset: [f64; 6],
    pub target_speed_fraction: f64,
    pub runtime_state: u32,
    pub robot_mode: i32,
    pub robot_status_bits: u32,
    pub safety_mode: i32,
    pub safety_status_bits: u32,
    pub digital_outputs: u64,
    pub output_int: [i32; REGISTERS],
}

/// Joint mode "running" of every joint.
const JOINT_RUNNING: i32 = 253;

/// Where an output's value comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Timestamp,
    ControlStep,
    TargetQ,
    TargetQd,
    TargetQdd,
    TcpPose,
    TcpSpeed,
    TcpOffset,
    /// 1: nothing scales the speed here.
    One,
    SpeedFraction,
    RuntimeState,
    RobotMode,
    RobotStatusBits,
    SafetyMode,
    SafetyStatusBits,
    JointMode,
    DigitalOutputs,
    OutputInt(usize),
    /// An input register read back.
    Input(usize),
    /// Not simulated: zero of the right type.
    Zero,
}

/// Outputs that the simulation gives a meaning.
const SIMULATED: [(&str, FieldType, Source); 25] = [
    ("timestamp", FieldType::Double, Source::Timestamp),
    ("control_step", FieldType::Uint64, Source::ControlStep),
    ("target_q", FieldType::Vector6d, Source::TargetQ),
    ("target_qd", FieldType::Vector6d, Source::TargetQd),
    ("target_qdd", FieldType::Vector6d, Source::TargetQdd),
    ("actual_q", FieldType::Vector6d, Source::TargetQ),
    ("actual_qd", FieldType::Vector6d, Source::TargetQd),
    ("actual_TCP_pose", FieldType::Vector6d, Source::TcpPose),
    ("target_TCP_pose", FieldType::Vector6d, Source::TcpPose),
    ("actual_TCP_speed", FieldType::Vector6d, Source::TcpSpeed),
    ("target_TCP_speed", FieldType::Vector6d, Source::TcpSpeed),
    ("tcp_offset", FieldType::Vector6d, Source::TcpOffset),
    ("speed_scaling", FieldType::Double, Source::One),
    ("target_speed_fraction", FieldType::Double, Source::SpeedFraction),
    ("runtime_state", FieldType::Uint32, Source::RuntimeState),
    ("robot_mode", FieldType::Int32, Source::RobotMode),
    ("robot_status_bits", FieldType::Uint32, Source::RobotStatusBits),
    ("safety_mode", FieldType::Int32, Source::SafetyMode),
    ("safety_status", FieldType::Int32, Source::SafetyMode),
    ("safety_status_bits", FieldType::Uint32, Source::SafetyStatusBits),
    ("joint_mode", FieldType::Vector6Int32, Source::JointMode),
    ("actual_digital_output_bits", FieldType::Uint64, Source::DigitalOutputs),
    ("actual_configurable_digital_output_bits", FieldType::Uint64, Source::Zero),
    ("actual_digital_input_bits", FieldType::Uint64, Source::Zero),
    ("actual_configurable_digital_input_bits", FieldType::Uint64, Source::Zero),
];

/// Outputs that exist and are answered with zero: no load, no current, no temperature is simulated.
const ZERO_DOUBLES: &str = "actual_execution_time target_execution_time actual_momentum actual_main_voltage \
    actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 standard_analog_output0 \
    standard_analog_output1 io_current actual_robot_energy_consumed actual_robot_braking_energy_dissipated \
    euromap67_24V_voltage euromap67_24V_current tool_analog_input0 tool_analog_input1 tool_output_current \
    tool_temperature tcp_force_scalar joint_position_deviation_ratio collision_detection_ratio payload";
const ZERO_VECTORS_6: &str = "target_current target_moment actual_current actual_current_window \
    actual_current_as_torque joint_control_output actual_TCP_force actual_TCP_acceleration target_TCP_acceleration \
    joint_temperatures actual_joint_voltage ft_raw_wrench wrench_calc_from_currents payload_inertia \
    target_base_acceleration target_base_wrench";
const ZERO_VECTORS_3: &str = "actual_tool_accelerometer elbow_position elbow_velocity payload_cog target_gravity";
const ZERO_UINT32: &str = "analog_io_types tool_mode tool_analog_input_types script_control_line \
    euromap67_input_bits euromap67_output_bits output_bit_registers0_to_31 output_bit_registers32_to_63";
const ZERO_INT32: &str = "tool_output_voltage encoder0_raw encoder1_raw time_scale_source";
const ZERO_UINT8: &str = "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode";

/// The type and the source of the output of this name.
pub(super) fn output(name: &[u8], inputs: &InputValues) -> Option<(FieldType, Source)> {
    if let Some((_, kind, source)) = SIMULATED.iter().find(|(known, ..)| known.as_bytes() == name) {
        return Some((*kind, *source));
    }
    if name.starts_with(b"input_") {
        return inputs.find(name).map(|(place, kind)| (kind, Source::Input(place)));
    }
    let text = std::str::from_utf8(name).ok()?;
    if let Some(register) = numbered(text, "output_int_register_", 0, REGISTERS) {
        return Some((FieldType::Int32, Source::OutputInt(register)));
    }
    if numbered(text, "output_double_register_", 0, REGISTERS).is_some() {
        return Some((FieldType::Double, Source::Zero));
    }
    if numbered(text, "output_bit_register_", 64, 128).is_some() {
        return Some((FieldType::Bool, Source::Zero));
    }
    let zeros = [
        (ZERO_DOUBLES, FieldType::Double),
        (ZERO_VECTORS_6, FieldType::Vector6d),
        (ZERO_VECTORS_3, FieldType::Vector3d),
        (ZERO_UINT32, FieldType::Uint32),
        (ZERO_INT32, FieldType::Int32),
        (ZERO_UINT8, FieldType::Uint8),
    ];
    let (_, kind) = zeros.into_iter().find(|(names, _)| names.split_whitespace().any(|known| known == text))?;
    Some((kind, Source::Zero))
}

/// The number behind `prefix`, written as the guide writes it: no sign, no leading zero.
fn numbered(name: &str, prefix: &str, from: usize, to: usize) -> Option<usize> {
    let digits = name.strip_prefix(prefix)?;
    (from..to).find(|number| number.to_string() == digits)
}

impl Snapshot {
    /// Appends one output's bytes.
    pub(super) fn write(&self, out: &mut Vec<u8>, kind: FieldType, source: Source, inputs: &InputValues) {
        let mut doubles = |values: &[f64]| values.iter().for_each(|value| out.extend(value.to_be_bytes()));
        match source {
            Source::Timestamp => doubles(&[self.timestamp]),
            Source::TargetQ => doubles(&self.target_q),
            Source::TargetQd => doubles(&self.target_qd),
            Source::TargetQdd => doubles(&self.target_qdd),
            Source::TcpPose => doubles(&self.tcp_pose),
            Source::TcpSpeed => doubles(&self.tcp_speed),
            Source::TcpOffset => doubles(&self.tcp_offset),
            Source::One => doubles(&[1.0]),
            Source::SpeedFraction => doubles(&[self.target_speed_fraction]),
            Source::ControlStep => out.extend(self.cycle.to_be_bytes()),
            Source::DigitalOutputs => out.extend(self.digital_outputs.to_be_bytes()),
            Source::RuntimeState => out.extend(self.runtime_state.to_be_bytes()),
            Source::RobotStatusBits => out.extend(self.robot_status_bits.to_be_bytes()),
            Source::SafetyStatusBits => out.extend(self.safety_status_bits.to_be_bytes()),
            Source::RobotMode => out.extend(self.robot_mode.to_be_bytes()),
            Source::SafetyMode => out.extend(self.safety_mode.to_be_bytes()),
            Source::JointMode => out.extend([JOINT_RUNNING; 6].iter().flat_map(|mode| mode.to_be_bytes())),
            Source::OutputInt(register) => {
                out.extend(self.output_int.get(register).copied().unwrap_or(0).to_be_bytes());
            }
            Source::Input(place) => out.extend(inputs.raw(place).iter().take(kind.size())),
            Source::Zero => out.resize(out.len() + kind.size(), 0),
        }
    }
}
