//! What the robot program writes, and the levels of its outputs.

use super::inputs::Wishes;
use crate::link::rtde::fields::REGISTERS;

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
    pub(super) fn analog_types(&self) -> u32 {
        let [(first, _), (second, _)] = self.analog;
        0b11 | u32::from(first) << 2 | u32::from(second) << 3
    }

    /// Writes a digital output of a group.
    pub(super) fn set_digital(&mut self, group: usize, place: usize, on: bool) {
        if let Some(bits) = self.digital.get_mut(group).filter(|_| place < 8) {
            *bits = *bits & !(1 << place) | u8::from(on) << place;
        }
    }

    /// What clients asked for; what they wrote before may have been overwritten by the program.
    pub(super) fn apply(&mut self, wishes: &Wishes) {
        for (bits, (mask, levels)) in self.digital.iter_mut().zip(wishes.digital) {
            *bits = *bits & !mask | levels & mask;
        }
        for (place, wish) in wishes.analog.iter().enumerate() {
            if let Some((is_voltage, share)) = wish {
                self.set_analog(place, *is_voltage, *share);
            }
        }
    }
}
