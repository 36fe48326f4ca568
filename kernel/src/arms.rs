//! The catalogue of robots.

pub mod ur;
