//! The kernel of Screed: everything that runs inside one hard-timed cycle.
#![no_std]
#![forbid(unsafe_code)]

pub mod arm;
pub mod arms;
pub mod ik;
pub mod pose;
pub mod units;
