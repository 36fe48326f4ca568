//! The catalogue of robots.

pub mod abb;
pub mod comau;
pub mod crane;
pub mod gantry;
pub mod kuka;
pub mod opw;
pub mod ur;
