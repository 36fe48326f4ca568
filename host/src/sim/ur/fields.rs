//! What the simulated controller has to say about each field of [`crate::link::rtde::fields`].

use super::body::Body;
use super::cell::CellInputs;
use super::inputs::InputValues;
use super::outputs::Outputs;
use crate::link::rtde::fields::{self, REGISTERS};
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
const SIMULATED: [(&str, Source); 52] = [
    ("timestamp", Source::Timestamp),
    ("control_step", Source::ControlStep),
    ("target_q", Source::TargetQ),
    ("target_qd", Source::TargetQd),
    ("target_qdd", Source::TargetQdd),
    ("actual_q", Source::TargetQ),
    ("actual_qd", Source::TargetQd),
    ("actual_TCP_pose", Source::TcpPose),
    ("target_TCP_pose", Source::TcpPose),
    ("actual_TCP_speed", Source::TcpSpeed),
    ("target_TCP_speed", Source::TcpSpeed),
    ("tcp_offset", Source::TcpOffset),
    ("speed_scaling", Source::SpeedScaling),
    ("standard_analog_output0", Source::AnalogOutput(0)),
    ("standard_analog_output1", Source::AnalogOutput(1)),
    ("analog_io_types", Source::AnalogTypes),
    ("payload", Source::Payload),
    ("payload_cog", Source::PayloadCog),
    ("payload_inertia", Source::PayloadInertia),
    ("elbow_position", Source::Elbow),
    ("output_bit_registers0_to_31", Source::OutputBits(false)),
    ("output_bit_registers32_to_63", Source::OutputBits(true)),
    ("target_speed_fraction", Source::SpeedFraction),
    ("runtime_state", Source::RuntimeState),
    ("robot_mode", Source::RobotMode),
    ("robot_status_bits", Source::RobotStatusBits),
    ("safety_mode", Source::SafetyMode),
    ("safety_status", Source::SafetyStatus),
    ("safety_status_bits", Source::SafetyStatusBits),
    ("joint_mode", Source::JointMode),
    ("actual_digital_output_bits", Source::DigitalOutputs),
    ("actual_configurable_digital_output_bits", Source::ConfigurableOutputs),
    ("actual_digital_input_bits", Source::DigitalInputs),
    ("actual_configurable_digital_input_bits", Source::ConfigurableInputs),
    ("actual_momentum", Source::Momentum),
    ("actual_TCP_acceleration", Source::TcpAcceleration),
    ("target_TCP_acceleration", Source::TcpAcceleration),
    ("actual_tool_accelerometer", Source::Accelerometer),
    ("target_gravity", Source::Gravity),
    ("elbow_velocity", Source::ElbowSpeed),
    ("script_control_line", Source::ScriptLine),
    ("tool_mode", Source::ToolMode),
    ("standard_analog_input0", Source::AnalogInput(0)),
    ("standard_analog_input1", Source::AnalogInput(1)),
    ("tool_analog_input0", Source::AnalogInput(2)),
    ("tool_analog_input1", Source::AnalogInput(3)),
    ("tool_analog_input_types", Source::Bits(VOLTAGES)),
    ("actual_main_voltage", Source::Constant(VOLTAGE)),
    ("actual_robot_voltage", Source::Constant(VOLTAGE)),
    ("actual_joint_voltage", Source::Constant(VOLTAGE)),
    ("joint_temperatures", Source::Constant(TEMPERATURE)),
    ("tool_temperature", Source::Constant(TEMPERATURE)),
];

/// The type and the source of the output of this name: zero where nothing is simulated, for no mass but the payload's, no current
/// and no contact is.
pub(super) fn output(name: &[u8], inputs: &InputValues) -> Option<(FieldType, Source)> {
    let name = std::str::from_utf8(name).ok()?;
    let kind = fields::output(name)?;
    let simulated = || SIMULATED.iter().find(|(known, _)| *known == name).map(|(_, source)| *source);
    let input = || inputs.find(name.as_bytes()).map(|(place, _)| Source::Input(place));
    let register = |prefix, numbers| fields::number(name, prefix, numbers);
    let source = simulated()
        .or_else(input)
        .or_else(|| register("output_int_register_", 0..REGISTERS).map(Source::OutputInt))
        .or_else(|| register("output_double_register_", 0..REGISTERS).map(Source::OutputDouble))
        .or_else(|| register("output_bit_register_", 64..128).map(Source::OutputBit));
    Some((kind, source.unwrap_or(Source::Zero)))
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
