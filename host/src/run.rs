//! The only place with clocks, sockets and threads; and the machines that it drives.

pub mod account;
pub mod children;
pub mod core;
pub mod demo;
pub mod job;
pub mod print;
pub mod realtime;
pub mod rt;
pub mod serial;
pub mod session;
pub mod signal;
pub mod summary;
pub mod virtual_time;
pub mod words;
