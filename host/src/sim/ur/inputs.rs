//! The inputs of the RTDE guide: what clients write. Registers are read when the program asks for them; what is asked of the
//! outputs and the speed slider is collected package by package, for a mask holds for its own package only.

use crate::link::rtde::fields;
use crate::link::rtde::wire::{FieldType, PayloadReader};
use std::collections::HashMap;

/// Registers below these are a fieldbus's where one is installed, the others the RTDE clients'.
const FIELDBUS_REGISTERS: usize = 24;

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

    /// The name of the input at this place.
    pub(super) fn name(&self, place: usize) -> &str {
        self.places.iter().find(|(_, (known, _))| *known == place).map_or("", |(name, _)| name)
    }

    /// Takes a new value.
    pub(super) fn set(&mut self, place: usize, value: &[u8]) {
        if let Some(slot) = self.raw.get_mut(place).and_then(|raw| raw.get_mut(..value.len())) {
            slot.copy_from_slice(value);
        }
    }

    pub(super) fn raw(&self, place: usize) -> &[u8] {
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

    fn byte(&self, name: &str) -> u8 {
        self.named(name).u8().unwrap_or(0)
    }

    /// Whether a fieldbus that takes `what` takes this input.
    pub(super) fn is_of(&self, what: Fieldbus, place: usize) -> bool {
        match what {
            Fieldbus::Off => false,
            Fieldbus::All => true,
            Fieldbus::Lower => {
                let words = self.places.get("input_bit_registers0_to_31").map_or(place, |(first, _)| *first);
                let lower = |first: usize| (first..first + FIELDBUS_REGISTERS).contains(&place);
                (words..words + 2).contains(&place) || lower(self.first_int) || lower(self.first_double)
            }
        }
    }

    /// Adds to `wishes` what a package asks for that has just been taken and has these inputs.
    pub(super) fn read_wishes(&self, package: &[(usize, FieldType)], wishes: &mut Wishes) {
        let has = |name: &str| {
            self.places.get(name).is_some_and(|(place, _)| package.iter().any(|(written, _)| written == place))
        };
        for (group, name) in ["standard", "configurable", "tool"].into_iter().enumerate() {
            let (bits, mask) = (format!("{name}_digital_output"), format!("{name}_digital_output_mask"));
            if (has(&bits) || has(&mask))
                && let Some((asked, levels)) = wishes.digital.get_mut(group)
            {
                let (bits, mask) = (self.byte(&bits), self.byte(&mask));
                (*asked, *levels) = (*asked | mask, *levels & !mask | bits & mask);
            }
        }
        if has("standard_analog_output_mask") {
            let (mask, voltage) = (self.byte("standard_analog_output_mask"), self.byte("standard_analog_output_type"));
            for (place, wish) in wishes.analog.iter_mut().enumerate() {
                if mask >> place & 1 == 1 {
                    let share = self.named(&format!("standard_analog_output_{place}")).f64().unwrap_or(0.0);
                    *wish = Some((voltage >> place & 1 == 1, share));
                }
            }
        }
        if has("speed_slider_mask") && self.named("speed_slider_mask").u32().is_some_and(|mask| mask != 0) {
            let fraction = self.named("speed_slider_fraction").f64().unwrap_or(1.0);
            // The slider has ends.
            wishes.speed_slider = Some(fraction).filter(|fraction| (0.0..=1.0).contains(fraction));
        }
    }
}

/// What clients have asked for since the last cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wishes {
    /// Standard, configurable, tool: which outputs, and their levels.
    pub digital: [(u8, u8); 3],
    /// Whether it shall be a voltage, and the share of its range.
    pub analog: [Option<(bool, f64)>; 2],
    /// Where the speed slider shall stand.
    pub speed_slider: Option<f64>,
}

/// What a fieldbus writes, so that RTDE clients cannot: an input of its is `IN_USE`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fieldbus {
    /// None is installed.
    #[default]
    Off,
    /// The lower registers: integers and doubles 0 to 23, bits 0 to 63.
    Lower,
    /// All inputs, as users of EtherNet/IP report it.
    All,
}

impl std::str::FromStr for Fieldbus {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "off" => Ok(Self::Off),
            "lower" => Ok(Self::Lower),
            "all" => Ok(Self::All),
            _ => Err(format!("expected off, lower or all, found {text:?}")),
        }
    }
}
