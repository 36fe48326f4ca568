//! The only place with clocks, sockets and threads; and the machines that it drives.

pub mod account;
pub mod core;
pub mod job;
