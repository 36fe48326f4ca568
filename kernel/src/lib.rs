//! The kernel of Screed: everything that runs inside one hard-timed cycle.
#![no_std]
#![forbid(unsafe_code)]

pub mod arm;
pub mod arms;
pub mod base;
pub mod clock;
pub mod closed_loop;
pub mod config;
pub mod control;
pub mod correction;
pub mod delay;
pub mod dexterity;
pub mod drive;
pub mod ekf;
pub mod estimator;
pub mod fault;
pub mod frame;
pub mod guard;
pub mod ik;
pub mod interpolate;
pub mod mode;
pub mod pid;
pub mod pose;
pub mod ramp;
pub mod registration;
pub mod ring;
pub mod setpoint;
#[cfg(test)]
mod steps;
pub mod tick;
pub mod units;
pub mod wait;
