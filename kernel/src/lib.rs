//! The kernel of Screed: everything that runs inside one hard-timed cycle.
#![no_std]
#![forbid(unsafe_code)]

pub mod arm;
pub mod arms;
pub mod clock;
pub mod fault;
pub mod frame;
pub mod guard;
pub mod ik;
pub mod mode;
pub mod pose;
pub mod ring;
pub mod setpoint;
pub mod tick;
pub mod units;
