//! The arguments of the simulated controller.

use super::seconds;
use crate::link::rtde::wire::Protocol;
use crate::sim::ur::act::Fault;
use crate::sim::ur::inputs::Fieldbus;
use crate::sim::ur::robot::Generation;
use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;

/// `screed sim ur`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct SimUrArgs {
    /// The robot, one of `screed robot list`; without it, the cell's
    #[arg(long, value_name = "NAME")]
    pub model: Option<String>,
    /// The cell file that gives robot, start joints, tool and program; without it, the demo's cell
    #[arg(long, value_name = "FILE.toml")]
    pub cell: Option<PathBuf>,
    /// Where to listen
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    pub host: IpAddr,
    /// RTDE's port; scripts are taken on the three below it, the dashboard five below; 0 takes free ones, as far apart
    #[arg(long, value_name = "PORT", default_value_t = 30_004)]
    pub port: u16,
    /// The controller: cb3 (software 3.15, 125 Hz) or e-series (5.11, 500 Hz)
    #[arg(long, value_name = "GENERATION", default_value = "e-series")]
    pub controller: Generation,
    /// The newest protocol of RTDE that it accepts: 1, or 2
    #[arg(long, value_name = "VERSION", default_value = "2", value_parser = rtde_protocol)]
    pub rtde_protocol: Protocol,
    /// Start without power, brakes on, no program running
    #[arg(long)]
    pub power_off: bool,
    /// Do not start the program with the controller
    #[arg(long)]
    pub no_autoplay: bool,
    /// Let other machines connect; RTDE, dashboard and scripts have no password
    #[arg(long)]
    pub allow_remote: bool,
    /// The joints it starts with, six numbers in degrees, instead of the cell's
    #[arg(long, value_name = "J1,J2,J3,J4,J5,J6", value_parser = joints_deg, allow_hyphen_values = true)]
    pub start_deg: Option<StartDeg>,
    /// How fast the joints can turn, six numbers in degrees a second, instead of the data sheet's; ur8long and ur18 need it, for
    /// no source gives theirs
    #[arg(long, value_name = "J1,J2,J3,J4,J5,J6", value_parser = speeds_deg)]
    pub joint_speeds_deg_s: Option<SpeedsDeg>,
    /// A robot program (URScript) instead of Screed's own
    #[arg(long, value_name = "FILE")]
    pub program: Option<PathBuf>,
    /// Write what it received, as CSV with a row a cycle
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// End when nobody has been connected for so long
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub exit_when_idle: Option<Duration>,
    /// Registers that a fieldbus writes, so that clients find them in use: off, lower (0 to 23, bits 0 to 63) or all inputs
    #[arg(long, value_name = "WHAT", default_value = "off")]
    pub fieldbus: Fieldbus,
    /// What goes wrong when, for example silence=0.5@10: half a second without a package after ten seconds. Kinds: see --control
    #[arg(long, value_name = "KIND@SECONDS")]
    pub fault: Vec<Fault>,
    /// Take what a person or bad luck does as lines on the standard input: protective-stop, emergency-stop, safeguard-stop off,
    /// reduced, play, pause, stop, popup TEXT, reset, silence S, half S, corrupt KIND, skip N, restart S, fieldbus WHAT,
    /// digital-input N on, analog-input N VOLTS and others; an unknown one is answered by a list of all
    #[arg(long)]
    pub control: bool,
    /// Say where it listens, and what it did, as JSON
    #[arg(long)]
    pub json: bool,
}

/// Six joints as a person types them (degrees).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartDeg(pub [f64; 6]);

fn joints_deg(text: &str) -> Result<StartDeg, String> {
    six(text, -360.0, 360.0).map(StartDeg)
}

/// Speeds of six joints as a person types them (degrees a second).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedsDeg(pub [f64; 6]);

fn speeds_deg(text: &str) -> Result<SpeedsDeg, String> {
    six(text, 0.1, 1000.0).map(SpeedsDeg)
}

fn six(text: &str, least: f64, most: f64) -> Result<[f64; 6], String> {
    let expected = || format!("expected six numbers from {least} to {most}, separated by commas");
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    let found: [f64; 6] = numbers.map_err(|_| expected())?.try_into().map_err(|_| expected())?;
    if found.iter().all(|number| (least..=most).contains(number)) { Ok(found) } else { Err(expected()) }
}

fn rtde_protocol(text: &str) -> Result<Protocol, String> {
    match text {
        "1" => Ok(Protocol::One),
        "2" => Ok(Protocol::Two),
        _ => Err("expected 1 or 2".to_owned()),
    }
}
