//! What the cell around the robot applies to its inputs, as a person sets it while the simulation runs.

/// Levels of the digital inputs, voltages of the analog ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct CellInputs {
    /// Standard inputs in bits 0 to 7, configurable in 8 to 15, the tool's in 16 and 17.
    pub digital: u64,
    /// Standard 0 and 1, tool 0 and 1 (V).
    pub analog: [f64; 4],
}

impl CellInputs {
    pub(super) const fn set_digital(&mut self, place: usize, on: bool) {
        if place < 18 {
            self.digital = self.digital & !(1 << place) | (on as u64) << place;
        }
    }

    pub(super) fn set_analog(&mut self, place: usize, volts: f64) {
        if let Some(input) = self.analog.get_mut(place) {
            *input = volts;
        }
    }
}
