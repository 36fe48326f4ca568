//! Arguments of `screed robot`: descriptions of robots, and a robot's controller.

use super::samples;
use std::path::PathBuf;

/// `screed robot`
#[derive(Clone, Debug, PartialEq, clap::Subcommand)]
pub enum RobotCommand {
    /// The robots of the catalogue
    List(RobotListArgs),
    /// Print a robot: table, ranges, ratings
    Show(RobotShowArgs),
    /// Prove a robot: round trips, Jacobian, reach
    Check(RobotCheckArgs),
    /// Say how a controller stands, and whether a print could begin
    Status(StatusArgs),
    /// Give power to the motors; asks first
    PowerOn(ActArgs),
    /// Take power from the motors
    PowerOff(ActArgs),
    /// Release the brakes, giving power first where there is none; asks first
    BrakeRelease(ActArgs),
    /// Unlock a protective stop; asks first
    Unlock(ActArgs),
    /// Start the program loaded on the controller, go on with a held one, or upload Screed's own; asks first
    Play(PlayArgs),
    /// Stop the program that runs
    Stop(ActArgs),
    /// Close what pops up on the teach pendant
    ClosePopup(ActArgs),
    /// Write the program that follows Screed's setpoints (URScript)
    Program(ProgramArgs),
    /// Read the calibration of a unit from its controller
    Calibration(ControllerCalibrationArgs),
}

/// `screed robot list`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct RobotListArgs {
    /// As JSON, with the whole tables
    #[arg(long)]
    pub json: bool,
}

/// Which robot.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct RobotOf {
    /// A name of the catalogue, an arm file (.toml) or a URDF (.urdf, .xml)
    #[arg(value_name = "ROBOT")]
    pub robot: String,
    /// The calibration of a UR unit: the controller's .conf or ur_calibration's .yaml
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// The base link of a URDF; without it, the root
    #[arg(long, value_name = "LINK")]
    pub base: Option<String>,
    /// The tip link of a URDF, the flange; without it, the only end that the most joints move
    #[arg(long, value_name = "LINK")]
    pub tip: Option<String>,
}

/// `screed robot show`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct RobotShowArgs {
    /// Which robot
    #[command(flatten)]
    pub robot: RobotOf,
    /// As JSON, in SI units
    #[arg(long)]
    pub json: bool,
}

/// `screed robot check`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct RobotCheckArgs {
    /// Which robot
    #[command(flatten)]
    pub robot: RobotOf,
    /// How many joint vectors to draw
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = samples)]
    pub count: usize,
    /// The seed they follow from
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Draw where the flange can be
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// As JSON, in SI units
    #[arg(long)]
    pub json: bool,
}

/// Which controller.
#[derive(Clone, Debug, PartialEq, clap::Args)]
#[group(required = true, multiple = false)]
pub struct ControllerOf {
    /// The cell file that has its address
    #[arg(long, value_name = "FILE.toml")]
    pub cell: Option<PathBuf>,
    /// Its address instead; a port is that of RTDE, from which the others keep their distance
    #[arg(long, value_name = "HOST[:PORT]", value_parser = address)]
    pub address: Option<Address>,
}

/// Host and RTDE's port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Name or IP address.
    pub host: String,
    /// The port.
    pub port: u16,
}

fn address(text: &str) -> Result<Address, String> {
    let expected = || "expected HOST or HOST:PORT, the port from 6 to 65535".to_owned();
    // An IPv6 address has colons of its own; with a port it stands in brackets.
    let (host, port) = match text.rsplit_once(':') {
        Some((host, port)) if !host.contains(':') || (host.starts_with('[') && host.ends_with(']')) => {
            (host, port.parse().map_err(|_| expected())?)
        }
        _ => (text, 30_004),
    };
    let host = host.trim_start_matches('[').trim_end_matches(']');
    if host.is_empty() || host.contains(char::is_whitespace) || port < 6 {
        return Err(expected());
    }
    Ok(Address { host: host.to_owned(), port })
}

/// `screed robot status`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct StatusArgs {
    /// Which controller
    #[command(flatten)]
    pub controller: ControllerOf,
    /// As JSON, in SI units
    #[arg(long)]
    pub json: bool,
}

/// `screed robot power-on` and the other acts
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct ActArgs {
    /// Which controller
    #[command(flatten)]
    pub controller: ControllerOf,
    /// Do not ask (cells with a simulated robot only)
    #[arg(long, conflicts_with = "address")]
    pub yes: bool,
}

/// `screed robot play`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct PlayArgs {
    /// The act
    #[command(flatten)]
    pub act: ActArgs,
    /// Upload Screed's program for the cell, which starts it
    #[arg(long, conflicts_with = "address")]
    pub upload: bool,
}

/// `screed robot program`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct ProgramArgs {
    /// The cell file
    #[arg(long, value_name = "FILE.toml")]
    pub cell: PathBuf,
    /// Where to write it, instead of the standard output
    #[arg(short, long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// `screed robot calibration`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct ControllerCalibrationArgs {
    /// Which controller
    #[command(flatten)]
    pub controller: ControllerOf,
    /// The nominal robot, one of `screed robot list`; without it, the cell's, or the one that fits what the controller says
    #[arg(long, value_name = "NAME", conflicts_with = "cell")]
    pub model: Option<String>,
    /// Where to write it (.conf), instead of the standard output
    #[arg(short, long, value_name = "FILE.conf")]
    pub out: Option<PathBuf>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_with_and_without_port() {
        for (text, host, port) in [
            ("robot", "robot", 30_004),
            ("10.0.0.2:40004", "10.0.0.2", 40_004),
            ("::1", "::1", 30_004),
            ("[::1]:31004", "::1", 31_004),
        ] {
            assert_eq!(address(text), Ok(Address { host: host.to_owned(), port }), "{text}");
        }
        for text in ["", ":30004", "robot:", "robot:x", "robot:5", "robot:70000", "a b"] {
            assert!(address(text).is_err(), "{text}");
        }
    }
}
