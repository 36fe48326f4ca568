//! Simulated peers on the real wires.

pub mod extruder;
