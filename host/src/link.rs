//! Sans-IO state machines, one per wire.

pub mod extruder;
pub mod rtde;
