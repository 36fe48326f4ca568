//! What the simulated controller has to say about each field of [`crate::link::rtde::fields`], and the inputs' values.

use crate::link::rtde::fields;
pub(super) use crate::link::rtde::fields::REGISTERS;
use crate::link::rtde::wire::{FieldType, PayloadReader};
use screed_kernel::arm::Arm;
use screed_kernel::units::JointPos;
use std::collections::HashMap;

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
        let fields: Vec<_> = fields::inputs().collect();
        let first = |name: &str| fields.iter().position(|(known, _)| known == name).unwrap_or(fields.len());
        let (first_int, first_double) = (first("input_int_register_0"), first("input_double_register_0"));
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

    /// A bit register: the first 64 come in two words, the others one by one; false where there is none.
    pub(super) fn bit(&self, register: usize) -> bool {
        let in_word = |name, bit: usize| self.named(name).u32().is_some_and(|word| word >> bit & 1 == 1);
        match register {
            0..32 => in_word("input_bit_registers0_to_31", register),
            32..64 => in_word("input_bit_registers32_to_63", register - 32),
            _ => self.named(&format!("input_bit_register_{register}")).u8() == Some(1),
        }
    }

    /// Whether a client has written one of the inputs of a group of digital outputs, by the places that were.
    pub(super) fn is_digital_updated(&self, group: &str, updated: &[bool]) -> bool {
        let written = |name: &str| self.places.get(name).is_some_and(|(place, _)| updated.get(*place) == Some(&true));
        written(group) || written(&format!("{group}_mask"))
    }

    /// The bits of a digital output group after its mask was applied to `before`.
    pub(super) fn digital(&self, group: &str, before: u8) -> u8 {
        let mask = self.named(&format!("{group}_mask")).u8().unwrap_or(0);
        let wanted = self.named(group).u8().unwrap_or(0);
        (before & !mask) | (wanted & mask)
    }

    /// Analog outputs that a client writes: mask, domain (1: voltage) and share of the range, of outputs 0 and 1.
    pub(super) fn analog(&self) -> [(bool, bool, f64); 2] {
        let mask = self.named("standard_analog_output_mask").u8().unwrap_or(0);
        let voltage = self.named("standard_analog_output_type").u8().unwrap_or(0);
        let share = |name| self.named(name).f64().unwrap_or(0.0);
        let shares = [share("standard_analog_output_0"), share("standard_analog_output_1")];
        [(mask & 1 != 0, voltage & 1 != 0, shares[0]), (mask & 2 != 0, voltage & 2 != 0, shares[1])]
    }

    /// The fraction of the speed slider, 1 until a client sets it.
    pub(super) fn speed_slider(&self) -> f64 {
        let mask = self.named("speed_slider_mask").u32().unwrap_or(0);
        if mask == 0 { 1.0 } else { self.named("speed_slider_fraction").f64().unwrap_or(1.0) }
    }
}

/// An analog output's range: 0 to 10 V, or 4 to 20 mA.
const VOLTAGE_MOST: f64 = 10.0;
const CURRENT_LEAST: f64 = 0.004;
const CURRENT_MOST: f64 = 0.020;

/// What a program writes: output registers, and the digital outputs that clients write too.
#[derive(Clone, Debug)]
pub(super) struct Outputs {
    ints: [i32; REGISTERS],
    doubles: [f64; REGISTERS],
    bits: u128,
    /// Standard, configurable, tool.
    pub digital: [u8; 3],
    /// Whether an analog output is a voltage, and its value (V, A).
    pub analog: [(bool, f64); 2],
}

impl Outputs {
    /// All zero, as after the controller's start.
    pub(super) const fn new() -> Self {
        Self {
            ints: [0; REGISTERS],
            doubles: [0.0; REGISTERS],
            bits: 0,
            digital: [0; 3],
            analog: [(false, CURRENT_LEAST); 2],
        }
    }

    /// An integer register, 0 where there is none.
    pub(super) fn int(&self, register: usize) -> i32 {
        self.ints.get(register).copied().unwrap_or(0)
    }

    /// A double register, 0 where there is none.
    pub(super) fn double(&self, register: usize) -> f64 {
        self.doubles.get(register).copied().unwrap_or(0.0)
    }

    /// A bit register, false where there is none.
    pub(super) const fn bit(&self, register: usize) -> bool {
        register < 128 && self.bits >> register & 1 == 1
    }

    /// The bit registers 0 to 31, or 32 to 63.
    pub(super) const fn bit_word(&self, upper: bool) -> u32 {
        if upper { (self.bits >> 32) as u32 } else { self.bits as u32 }
    }

    /// Writes an integer register.
    pub(super) fn set_int(&mut self, register: usize, value: i32) {
        if let Some(place) = self.ints.get_mut(register) {
            *place = value;
        }
    }

    /// Writes a double register.
    pub(super) fn set_double(&mut self, register: usize, value: f64) {
        if let Some(place) = self.doubles.get_mut(register) {
            *place = value;
        }
    }

    /// Writes a bit register.
    pub(super) const fn set_bit(&mut self, register: usize, on: bool) {
        if register < 128 {
            self.bits = self.bits & !(1 << register) | (on as u128) << register;
        }
    }

    /// Sets an analog output to a share of its range; what lies outside it is refused.
    pub(super) fn set_analog(&mut self, place: usize, is_voltage: bool, share: f64) {
        if let Some(output) = self.analog.get_mut(place).filter(|_| (0.0..=1.0).contains(&share)) {
            let current = CURRENT_LEAST + share * (CURRENT_MOST - CURRENT_LEAST);
            *output = (is_voltage, if is_voltage { share * VOLTAGE_MOST } else { current });
        }
    }

    /// `analog_io_types`: bits 2 and 3 tell which of the outputs is a voltage; both inputs are.
    fn analog_types(&self) -> u32 {
        let [(first, _), (second, _)] = self.analog;
        0b11 | u32::from(first) << 2 | u32::from(second) << 3
    }

    /// Writes a digital output of a group.
    pub(super) fn set_digital(&mut self, group: usize, place: usize, on: bool) {
        if let Some(bits) = self.digital.get_mut(group).filter(|_| place < 8) {
            *bits = *bits & !(1 << place) | u8::from(on) << place;
        }
    }
}

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
    pub safety_status_bits: u32,
    pub speed_scaling: f64,
    pub joint_mode: i32,
    pub payload: f64,
    pub payload_cog: [f64; 3],
    pub payload_inertia: [f64; 6],
    pub arm: &'a Arm<6>,
    pub digital_outputs: u64,
    pub outputs: Outputs,
}

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
    SpeedScaling,
    Payload,
    PayloadCog,
    PayloadInertia,
    Elbow,
    SpeedFraction,
    RuntimeState,
    RobotMode,
    RobotStatusBits,
    SafetyMode,
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

/// Outputs that the simulation gives a meaning.
const SIMULATED: [(&str, Source); 31] = [
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
    ("safety_status", Source::SafetyMode),
    ("safety_status_bits", Source::SafetyStatusBits),
    ("joint_mode", Source::JointMode),
    ("actual_digital_output_bits", Source::DigitalOutputs),
];

/// The type and the source of the output of this name: zero where no load, no current, no temperature is simulated.
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
    /// Where the elbow is (m, base frame): computed for those who ask only.
    pub(super) fn elbow(&self) -> [f64; 3] {
        let [_, elbow, ..] = self.arm.frames(&JointPos(self.target_q));
        elbow.translation.into()
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
            Source::Payload => doubles(&[self.payload]),
            Source::PayloadCog => doubles(&self.payload_cog),
            Source::PayloadInertia => doubles(&self.payload_inertia),
            Source::Elbow => doubles(&self.elbow()),
            Source::SpeedFraction => doubles(&[self.target_speed_fraction]),
            Source::ControlStep => out.extend(self.cycle.to_be_bytes()),
            Source::DigitalOutputs => out.extend(self.digital_outputs.to_be_bytes()),
            Source::RuntimeState => out.extend(self.runtime_state.to_be_bytes()),
            Source::RobotStatusBits => out.extend(self.robot_status_bits.to_be_bytes()),
            Source::SafetyStatusBits => out.extend(self.safety_status_bits.to_be_bytes()),
            Source::RobotMode => out.extend(self.robot_mode.to_be_bytes()),
            Source::SafetyMode => out.extend(self.safety_mode.to_be_bytes()),
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
