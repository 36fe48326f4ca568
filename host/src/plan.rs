//! Where the tool goes, in which order, and when.

pub mod path;
pub mod profile;
