//! The only place with clocks, sockets and threads.

pub mod serial;
pub mod signal;
