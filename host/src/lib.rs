//! Screed's host: models, planning, links, simulated peers, and the processes that run them.

pub mod bench;
pub mod calibrate;
pub mod cli;
pub mod config;
pub mod doctor;
pub mod failure;
pub mod latency;
pub mod link;
pub mod log;
pub mod model;
pub mod plan;
pub mod robot;
pub mod run;
pub mod sim;
mod svg;
pub mod wcet;
