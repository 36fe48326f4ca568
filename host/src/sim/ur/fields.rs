//! The fields of the RTDE guide: names, types, and what the simulated controller has to say about each.
//!
//! Names and types as in the field table of the Universal_Robots_Client_Library (`src/rtde/data_package.cpp`).

use super::body::Body;
use super::cell::CellInputs;
use super::inputs::{InputValues, REGISTERS};
use super::outputs::Outputs;
use crate::link::rtde::wire::FieldType;

/// What the robot says of itself in one cycle, for the outputs that mean something in the simulation (SI).
#[derive(Clone, Debug)]
pub(super) struct Snapshot<'a> {
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
    pub safety_status: i32,
    pub safety_status_bits: u32,
    pub speed_scaling: f64,
    pub joint_mode: i32,
    /// The line that the program is in.
    pub script_line: u32,
    pub body: &'a Body,
    pub cell: CellInputs,
    pub digital_outputs: u64,
    pub outputs: Outputs,
}

/// Where an output's value comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Source {
    Timestamp,
    ControlStep,
    TargetQ,
    TargetQd,
    TargetQdd,
    TcpPose,
    TcpSpeed,
    TcpOffset,
    SpeedScaling,
    Payload,
    PayloadCog,
    PayloadInertia,
    Momentum,
    TcpAcceleration,
    Accelerometer,
    Gravity,
    Elbow,
    ElbowSpeed,
    ScriptLine,
    ToolMode,
    DigitalInputs,
    ConfigurableInputs,
    ConfigurableOutputs,
    AnalogInput(usize),
    /// Every number of it: a constant of the simulation.
    Constant(f64),
    /// The same, of an integer.
    Bits(u32),
    SpeedFraction,
    RuntimeState,
    RobotMode,
    RobotStatusBits,
    SafetyMode,
    SafetyStatus,
    SafetyStatusBits,
    JointMode,
    DigitalOutputs,
    AnalogOutput(usize),
    AnalogTypes,
    OutputInt(usize),
    OutputDouble(usize),
    OutputBit(usize),
    /// Registers 32 to 63, or 0 to 31.
    OutputBits(bool),
    /// An input register read back.
    Input(usize),
    /// Not simulated: zero of the right type.
    Zero,
}

/// Voltages of the robot and its main board (V), and temperatures (°C): plausible, and always the same.
pub(super) const VOLTAGE: f64 = 48.0;
pub(super) const TEMPERATURE: f64 = 25.0;
/// Both inputs of a pair are voltages.
const VOLTAGES: u32 = 0b11;

/// Outputs that the simulation gives a meaning.
const SIMULATED: [(&str, FieldType, Source); 54] = [
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
    ("speed_scaling", FieldType::Double, Source::SpeedScaling),
    ("standard_analog_output0", FieldType::Double, Source::AnalogOutput(0)),
    ("standard_analog_output1", FieldType::Double, Source::AnalogOutput(1)),
    ("analog_io_types", FieldType::Uint32, Source::AnalogTypes),
    ("payload", FieldType::Double, Source::Payload),
    ("payload_cog", FieldType::Vector3d, Source::PayloadCog),
    ("payload_inertia", FieldType::Vector6d, Source::PayloadInertia),
    ("elbow_position", FieldType::Vector3d, Source::Elbow),
    ("output_bit_registers0_to_31", FieldType::Uint32, Source::OutputBits(false)),
    ("output_bit_registers32_to_63", FieldType::Uint32, Source::OutputBits(true)),
    ("target_speed_fraction", FieldType::Double, Source::SpeedFraction),
    ("runtime_state", FieldType::Uint32, Source::RuntimeState),
    ("robot_mode", FieldType::Int32, Source::RobotMode),
    ("robot_status_bits", FieldType::Uint32, Source::RobotStatusBits),
    ("safety_mode", FieldType::Int32, Source::SafetyMode),
    ("safety_status", FieldType::Int32, Source::SafetyStatus),
    ("safety_status_bits", FieldType::Uint32, Source::SafetyStatusBits),
    ("joint_mode", FieldType::Vector6Int32, Source::JointMode),
    ("actual_digital_output_bits", FieldType::Uint64, Source::DigitalOutputs),
    ("actual_configurable_digital_output_bits", FieldType::Uint64, Source::ConfigurableOutputs),
    ("actual_digital_input_bits", FieldType::Uint64, Source::DigitalInputs),
    ("actual_configurable_digital_input_bits", FieldType::Uint64, Source::ConfigurableInputs),
    ("actual_momentum", FieldType::Double, Source::Momentum),
    ("actual_TCP_acceleration", FieldType::Vector6d, Source::TcpAcceleration),
    ("target_TCP_acceleration", FieldType::Vector6d, Source::TcpAcceleration),
    ("actual_tool_accelerometer", FieldType::Vector3d, Source::Accelerometer),
    ("target_gravity", FieldType::Vector3d, Source::Gravity),
    ("elbow_velocity", FieldType::Vector3d, Source::ElbowSpeed),
    ("script_control_line", FieldType::Uint32, Source::ScriptLine),
    ("tool_mode", FieldType::Uint32, Source::ToolMode),
    ("standard_analog_input0", FieldType::Double, Source::AnalogInput(0)),
    ("standard_analog_input1", FieldType::Double, Source::AnalogInput(1)),
    ("tool_analog_input0", FieldType::Double, Source::AnalogInput(2)),
    ("tool_analog_input1", FieldType::Double, Source::AnalogInput(3)),
    ("tool_analog_input_types", FieldType::Uint32, Source::Bits(VOLTAGES)),
    ("actual_main_voltage", FieldType::Double, Source::Constant(VOLTAGE)),
    ("actual_robot_voltage", FieldType::Double, Source::Constant(VOLTAGE)),
    ("actual_joint_voltage", FieldType::Vector6d, Source::Constant(VOLTAGE)),
    ("joint_temperatures", FieldType::Vector6d, Source::Constant(TEMPERATURE)),
    ("tool_temperature", FieldType::Double, Source::Constant(TEMPERATURE)),
    // In the configuration of newer software only.
    ("dexterity", FieldType::Double, Source::Zero),
    ("tool_output_voltage_2", FieldType::Int32, Source::Zero),
];

/// Outputs that exist and are answered with zero: no mass but the payload's, no current, no contact is simulated.
const ZERO_DOUBLES: &str = "actual_execution_time target_execution_time actual_robot_current io_current \
    actual_robot_energy_consumed actual_robot_braking_energy_dissipated euromap67_24V_voltage euromap67_24V_current \
    tool_output_current tool_output_current_2 tcp_force_scalar joint_position_deviation_ratio collision_detection_ratio";
const ZERO_VECTORS_6: &str = "target_current target_moment actual_current actual_current_window \
    actual_current_as_torque joint_control_output actual_TCP_force ft_raw_wrench wrench_calc_from_currents \
    target_base_acceleration target_base_wrench";
const ZERO_UINT32: &str = "euromap67_input_bits euromap67_output_bits";
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
    if let Some(register) = numbered(text, "output_double_register_", 0, REGISTERS) {
        return Some((FieldType::Double, Source::OutputDouble(register)));
    }
    if let Some(register) = numbered(text, "output_bit_register_", 64, 128) {
        return Some((FieldType::Bool, Source::OutputBit(register)));
    }
    let zeros = [
        (ZERO_DOUBLES, FieldType::Double),
        (ZERO_VECTORS_6, FieldType::Vector6d),
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

impl Snapshot<'_> {
    /// Of the payload, as if it sat at the tool centre point: the only mass there is (kg·m/s).
    pub(super) fn momentum(&self) -> f64 {
        let [x, y, z, ..] = self.tcp_speed;
        self.body.payload.mass * x.hypot(y).hypot(z)
    }

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
            Source::SpeedScaling => doubles(&[self.speed_scaling]),
            Source::Payload => doubles(&[self.body.payload.mass]),
            Source::PayloadCog => doubles(&self.body.payload.centre),
            Source::PayloadInertia => doubles(&self.body.payload.inertia),
            Source::Momentum => doubles(&[self.momentum()]),
            Source::TcpAcceleration => doubles(&self.body.tool_acceleration()),
            Source::Accelerometer => doubles(&self.body.accelerometer()),
            Source::Gravity => doubles(&self.body.gravity),
            Source::Elbow => doubles(&self.body.elbow().0),
            Source::ElbowSpeed => doubles(&self.body.elbow().1),
            Source::AnalogInput(place) => doubles(&[self.cell.analog.get(place).copied().unwrap_or(0.0)]),
            Source::Constant(value) => (0..kind.size() / 8).for_each(|_| doubles(&[value])),
            Source::Bits(bits) => out.extend(bits.to_be_bytes()),
            Source::ScriptLine => out.extend(self.script_line.to_be_bytes()),
            Source::ToolMode => out.extend(self.joint_mode.to_be_bytes()),
            Source::DigitalInputs => out.extend(self.cell.digital.to_be_bytes()),
            Source::ConfigurableInputs => out.extend((self.cell.digital >> 8 & 0xff).to_be_bytes()),
            Source::ConfigurableOutputs => out.extend((self.digital_outputs >> 8 & 0xff).to_be_bytes()),
            Source::SpeedFraction => doubles(&[self.target_speed_fraction]),
            Source::ControlStep => out.extend(self.cycle.to_be_bytes()),
            Source::DigitalOutputs => out.extend(self.digital_outputs.to_be_bytes()),
            Source::RuntimeState => out.extend(self.runtime_state.to_be_bytes()),
            Source::RobotStatusBits => out.extend(self.robot_status_bits.to_be_bytes()),
            Source::SafetyStatusBits => out.extend(self.safety_status_bits.to_be_bytes()),
            Source::RobotMode => out.extend(self.robot_mode.to_be_bytes()),
            Source::SafetyMode => out.extend(self.safety_mode.to_be_bytes()),
            Source::SafetyStatus => out.extend(self.safety_status.to_be_bytes()),
            Source::JointMode => out.extend([self.joint_mode; 6].iter().flat_map(|mode| mode.to_be_bytes())),
            Source::AnalogOutput(place) => {
                doubles(&[self.outputs.analog.get(place).map_or(0.0, |(_, value)| *value)]);
            }
            Source::AnalogTypes => out.extend(self.outputs.analog_types().to_be_bytes()),
            Source::OutputInt(register) => out.extend(self.outputs.int(register).to_be_bytes()),
            Source::OutputDouble(register) => doubles(&[self.outputs.double(register)]),
            Source::OutputBit(register) => out.push(u8::from(self.outputs.bit(register))),
            Source::OutputBits(upper) => out.extend(self.outputs.bit_word(upper).to_be_bytes()),
            Source::Input(place) => out.extend(inputs.raw(place).iter().take(kind.size())),
            Source::Zero => out.resize(out.len() + kind.size(), 0),
        }
    }
}
