//! The only place with clocks, sockets and threads; and the machines that it drives.

/// A line on standard error. Unlike `eprintln!` it goes on when nobody reads: a print must not break off because a terminal
/// was closed.
macro_rules! note {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($text)*);
    }};
}

pub mod account;
pub mod children;
pub mod controller;
pub mod core;
pub mod demo;
pub mod dial;
pub mod first_layer;
pub mod grid;
pub mod job;
pub mod line;
pub mod memory;
pub mod overruns;
pub mod person;
pub mod print;
pub mod realtime;
pub mod resend;
pub mod rt;
pub mod rtde_record;
pub mod sensor_wire;
pub mod serial;
pub mod session;
pub mod signal;
pub mod soak;
pub mod summary;
pub mod virtual_time;
pub mod wake;
pub mod wire;
pub mod words;
