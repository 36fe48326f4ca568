//! From ISO 10303-21 text to what is to be built.
//!
//! Three steps, each knowing only the one before: [`p21`] reads the text into entities, [`ifc`] knows what IFC's units,
//! placements and curves mean, [`fim`] finds the wall to print and its layers.

pub mod error;
pub mod fim;
pub mod ifc;
pub mod p21;

pub use error::{Entity, ModelError, Place};
pub use fim::{FimModel, Layer, Process, parse, read};
