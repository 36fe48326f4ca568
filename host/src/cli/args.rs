//! The arguments of every command, as clap reads them. What needs the cell to be judged has a `checked` of its own.

mod realtime;
mod robot;
mod rtde;
mod sim;
mod wcet;

use crate::config::Cell;
use crate::failure::{Exit, Failure};
use crate::sim::line::LineFault;
use std::path::PathBuf;
use std::time::Duration;

pub use realtime::{DoctorArgs, LatencyArgs, Yardstick};
pub use robot::{
    ActArgs, ControllerCalibrationArgs, ControllerOf, PlayArgs, ProgramArgs, RobotCheckArgs, RobotCommand,
    RobotListArgs, RobotOf, RobotShowArgs, StatusArgs,
};
pub use rtde::{RtdeCommand, RtdeRecordArgs};
pub use sim::{SimUrArgs, SpeedsDeg, StartDeg};
pub use wcet::WcetArgs;

/// `screed demo`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct DemoArgs {
    /// How many layers to print
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub layers: u16,
    /// Setpoints a second: 125 or 500
    #[arg(long, value_name = "HZ", default_value_t = 125, value_parser = rate)]
    pub rate: u32,
    /// Stop under control after so many seconds of motion
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
    pub stop_after: Option<Duration>,
    /// Virtual time, in one thread: the same bytes through the same state machines
    #[arg(long)]
    pub fast: bool,
    /// Spoil one package of the robot: size, type, short, nan or impossible, after so many packages
    #[arg(long, value_name = "KIND@COUNT", requires = "fast", hide = true)]
    pub line_fault: Option<LineFault>,
    /// A robot program instead of Screed's own
    #[arg(long, value_name = "FILE")]
    pub program: Option<PathBuf>,
    /// Write the cycle log
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// Write what the robot received, as CSV with a row a cycle
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Write what the extruder was told and did, as CSV with a row every 5 ms (not with --fast)
    #[arg(long, value_name = "FILE", conflicts_with = "fast")]
    pub record_extruder: Option<PathBuf>,
    /// The table at the end as JSON, and no progress
    #[arg(long)]
    pub json: bool,
}

/// `screed bench`
#[derive(Clone, Debug, PartialEq, clap::Subcommand)]
pub enum BenchCommand {
    /// Filter a noisy pose, half of it missing, as figure 6 of the KRAKEN paper does
    Fig6(Fig6Args),
    /// Print the demo's wall on a servo that is not what the cell file says, with its lag compensated and without
    Servoj(JsonArgs),
    /// Lead seeded plants on drifting bases along a circle, corrected and not, and find the margins of their loops
    Base(BaseArgs),
}

/// `screed bench base`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct BaseArgs {
    /// How many plants, half of them like an NJ130 and half like a UR10e
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u64).range(2..=10_000))]
    pub plants: u64,
    /// Every plant as JSON
    #[arg(long)]
    pub json: bool,
}

/// The figures of a bench
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct JsonArgs {
    /// The table as JSON
    #[arg(long)]
    pub json: bool,
}

/// `screed bench fig6`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct Fig6Args {
    /// Try the filter's jerk density on the seeds for tuning, instead of scoring it on the others
    #[arg(long, conflicts_with_all = ["plot", "json"])]
    pub tune: bool,
    /// Draw the first scored run of the first case
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// The table as JSON
    #[arg(long)]
    pub json: bool,
}

/// `screed plan`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct PlanArgs {
    /// The FIM model, IFC
    #[arg(value_name = "FILE.ifc")]
    pub model: PathBuf,
    /// The cell file; without it, the demo's cell
    #[arg(long, value_name = "FILE.toml")]
    pub cell: Option<PathBuf>,
    /// Setpoints a second in the demo's cell: 125 or 500
    #[arg(long, value_name = "HZ", default_value_t = 125, value_parser = rate, conflicts_with = "cell")]
    pub rate: u32,
    /// Begin with this layer; the first is 0. It is the one drawn
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub from_layer: usize,
    /// How many layers; without it, all that are left
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    pub layers: Option<usize>,
    /// Write the plan as CSV or JSON, by the file's ending
    #[arg(long, value_name = "FILE", value_parser = table)]
    pub out: Option<PathBuf>,
    /// Draw path and speed
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// The report as JSON
    #[arg(long)]
    pub json: bool,
}

/// `screed print`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct PrintArgs {
    /// The FIM model, IFC
    #[arg(value_name = "FILE.ifc")]
    pub model: PathBuf,
    /// The cell file
    #[arg(long, value_name = "FILE.toml")]
    pub cell: PathBuf,
    /// Begin with this layer; the first is 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub from_layer: usize,
    /// How many layers; without it, all that are left
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    pub layers: Option<usize>,
    /// Move without flow
    #[arg(long)]
    pub dry: bool,
    /// Do not ask before the first motion (simulated robots only)
    #[arg(long)]
    pub yes: bool,
    /// The robot of the cell file is real and may move
    #[arg(long)]
    pub real_robot: bool,
    /// The serial number of the real robot that may move; without it, it is asked for
    #[arg(long, value_name = "NUMBER", requires = "real_robot")]
    pub serial: Option<String>,
    /// Send Screed's program to the controller and start it, where none plays; asks first
    #[arg(long, conflicts_with_all = ["fast", "board"])]
    pub upload: bool,
    /// Simulate it: robot, extruder and time, in one thread
    #[arg(long, conflicts_with_all = ["real_robot", "attach"])]
    pub fast: bool,
    /// With --fast: write what the robot received, as CSV with a row a cycle
    #[arg(long, value_name = "FILE", requires = "fast")]
    pub record: Option<PathBuf>,
    /// Go on, stamped NON-RT, where the system refuses screed-rt real-time scheduling
    #[arg(long, conflicts_with_all = ["fast", "attach"])]
    pub allow_non_rt: bool,
    /// Use the screed-rt that answers at this socket, instead of starting one
    #[arg(long, value_name = "SOCKET")]
    pub attach: Option<PathBuf>,
    /// Print by the kernel on a board at the end of this serial line, which paces it and drives the arm
    #[arg(long, value_name = "DEVICE", conflicts_with_all = ["attach", "fast", "allow_non_rt"])]
    pub board: Option<PathBuf>,
    /// Bits a second on that line
    #[arg(long, default_value_t = 921_600, requires = "board", value_parser = clap::value_parser!(u32).range(9_600..=12_000_000))]
    pub baud: u32,
    /// Write the cycle log
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// The table at the end as JSON, and no progress
    #[arg(long)]
    pub json: bool,
}

impl PrintArgs {
    /// Whether what was said about the robot fits the cell: a real robot moves only with `--real-robot` and after a person
    /// has answered the question; a simulated one is not passed off as real.
    ///
    /// # Errors
    /// A usage [`Failure`].
    pub fn checked(&self, cell: &Cell) -> Result<&Self, Failure> {
        let name = &cell.name;
        let (message, remedy) = match (cell.robot.simulated, self.real_robot, self.yes) {
            (false, false, _) => (
                format!("the robot of the cell {name} is real: expected --real-robot, found none"),
                "give --real-robot when nobody is within its reach",
            ),
            (false, true, true) => (
                "--yes answers for a person: expected a person to confirm the motion of a real robot".to_owned(),
                "leave --yes out",
            ),
            (true, true, _) => (
                format!("the robot of the cell {name} is simulated: expected no --real-robot"),
                "leave --real-robot out, or set simulated = false in [robot] of the cell file",
            ),
            (true, false, _) | (false, true, false) => return Ok(self),
        };
        Err(Failure::new(Exit::Usage, message, remedy))
    }
}

/// `screed check`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct CheckArgs {
    /// A cell file (.toml) or a FIM model (.ifc)
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Whether the model can be printed in this cell
    #[arg(long, value_name = "FILE.toml")]
    pub cell: Option<PathBuf>,
}

/// `screed calibrate`
#[derive(Clone, Debug, PartialEq, clap::Subcommand)]
pub enum CalibrateCommand {
    /// Where a frame lies in another, from points measured in both
    Frame(CalibrateArgs),
    /// Where a tool's tip is, from touches of one point
    Tcp(CalibrateArgs),
    /// Where a tracker stands and its target sits on the flange, from poses
    Target(CalibrateArgs),
    /// What an arm's DH table really is, from poses that a tracker measured
    Arm(CalibrateArgs),
}

/// The arguments of each calibration.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct CalibrateArgs {
    /// The measurements; docs/calibration.md has an example of each kind
    #[arg(value_name = "FILE.toml")]
    pub file: PathBuf,
    /// The result as JSON, in m and rad, with covariance and residuals
    #[arg(long)]
    pub json: bool,
}

/// `screed log`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct LogArgs {
    /// The cycle log
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Print it as a table with a row a cycle, or write that to OUT
    #[arg(long, value_name = "OUT", num_args = 0..=1)]
    pub csv: Option<Option<PathBuf>>,
}

/// `screed sim`
#[derive(Clone, Debug, PartialEq, clap::Subcommand)]
pub enum SimCommand {
    /// A UR controller: an RTDE server and a robot that follows servoj
    Ur(Box<SimUrArgs>),
    /// A clay extruder on a pseudo-terminal
    Extruder(SimExtruderArgs),
}

/// `screed sim extruder`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct SimExtruderArgs {
    /// The cell file that gives its highest flow; without it, the demo's cell
    #[arg(long, value_name = "FILE.toml")]
    pub cell: Option<PathBuf>,
    /// Write time, flows and volume, as CSV with a row every 5 ms
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// End when no valid line has come for so long
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub exit_when_idle: Option<Duration>,
    /// Say its device, and what it extruded, as JSON
    #[arg(long)]
    pub json: bool,
}

fn rate(text: &str) -> Result<u32, String> {
    match text {
        "125" => Ok(125),
        "500" => Ok(500),
        _ => Err("expected 125 or 500".to_owned()),
    }
}

/// A duration up to a month; longer ones are slips.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "expected a number of seconds".to_owned())?;
    if seconds > 0.0 && seconds <= 2.6e6 {
        Ok(Duration::from_secs_f64(seconds))
    } else {
        Err("expected more than 0 and at most 2600000 seconds".to_owned())
    }
}

fn samples(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if (1..=10_000_000).contains(&count) => Ok(count),
        _ => Err("expected a whole number from 1 to 10000000".to_owned()),
    }
}

fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count >= 1 => Ok(count),
        _ => Err("expected a whole number from 1".to_owned()),
    }
}

fn table(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("csv" | "json") => Ok(path),
        _ => Err("expected a name that ends with .csv or .json".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    enum All {
        Demo(DemoArgs),
        Plan(PlanArgs),
        Print(PrintArgs),
        #[command(subcommand)]
        Sim(SimCommand),
    }

    fn parse(line: &str) -> Result<All, String> {
        let words = std::iter::once("screed").chain(line.split_whitespace());
        All::try_parse_from(words).map_err(|error| error.to_string())
    }

    #[test]
    fn sound_command_lines_are_taken() {
        let Ok(All::Demo(demo)) = parse("demo --layers 2 --rate 500 --for 1.5 --fast --line-fault short@100 --json")
        else {
            panic!("a sound line")
        };
        assert_eq!((demo.layers, demo.rate, demo.stop_after), (2, 500, Some(Duration::from_millis(1500))));
        assert!(demo.fast && demo.json && demo.line_fault.is_some());
        let Ok(All::Sim(SimCommand::Ur(ur))) = parse("sim ur --port 0 --start-deg -1,2,3,-4.5,5,6 --json") else {
            panic!("a sound line")
        };
        assert_eq!(ur.start_deg, Some(StartDeg([-1.0, 2.0, 3.0, -4.5, 5.0, 6.0])));
        assert!(parse("plan a.ifc --cell c.toml --out p.csv --plot p.svg").is_ok());
        assert!(parse("print a.ifc --cell c.toml --from-layer 2 --layers 1 --dry --yes --log l").is_ok());
    }

    #[test]
    fn senseless_command_lines_are_refused_with_what_was_expected() {
        for (line, expected) in [
            ("demo --rate 250", "expected 125 or 500"),
            ("demo --layers 0", "1..=1000"),
            ("demo --for -1", "unexpected argument"),
            ("demo --for=nan", "expected more than 0"),
            ("demo --line-fault short@3", "--fast"),
            ("demo --fast --line-fault long@3", "expected size, type, short, nan or impossible"),
            ("plan", "FILE.ifc"),
            ("plan a.ifc --out p.txt", ".csv or .json"),
            ("print a.ifc", "--cell"),
            ("print a.ifc --cell c.toml --layers 0", "from 1"),
            ("sim ur --start-deg 1,2,3", "six numbers"),
            ("sim ur --start-deg 1,2,3,4,5,nan", "six numbers"),
            ("sim ur --port 65536", "65536"),
        ] {
            let message = parse(line).err().unwrap_or_default();
            assert!(message.contains(expected), "{line}: {message}");
        }
    }

    #[test]
    fn a_real_robot_needs_its_option_and_a_person() {
        let simulated = Cell::demo(125).unwrap_or_else(|error| panic!("{error}"));
        let mut real = simulated.clone();
        real.robot.simulated = false;
        let args = |options: &str| match parse(&format!("print a.ifc --cell c.toml {options}")) {
            Ok(All::Print(args)) => args,
            other => panic!("{other:?}"),
        };
        for (options, with_simulated, with_real) in [
            ("", true, false),
            ("--yes", true, false),
            ("--real-robot", false, true),
            ("--real-robot --yes", false, false),
        ] {
            let args = args(options);
            assert_eq!(args.checked(&simulated).is_ok(), with_simulated, "{options}");
            assert_eq!(args.checked(&real).is_ok(), with_real, "{options}");
        }
        assert_eq!(args("").checked(&real).err().map(|failure| failure.exit), Some(Exit::Usage));
    }
}
