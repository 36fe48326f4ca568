//! What the benches share.

pub mod scenario;
