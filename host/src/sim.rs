//! Simulated peers on the real wires, and a line that spoils what it carries.

pub mod extruder;
pub mod line;
pub mod plant;
pub mod ur;
