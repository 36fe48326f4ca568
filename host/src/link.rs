//! Sans-IO state machines, one per wire.

pub mod dashboard;
pub mod extruder;
pub mod primary;
pub mod rtde;
