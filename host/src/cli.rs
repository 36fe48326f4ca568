//! The command line: raw arguments, then checked ones, then one match.

pub mod args;
mod bench;
mod calibrate;
mod check;
mod controller;
mod demo;
mod doctor;
mod latency;
mod log;
mod plan;
mod print;
mod robot;
mod rtde;
mod sim;
mod soak;
mod tape;
mod wcet;

use crate::failure::{Exit, Failure};
use crate::model::fim::{self, FimModel};
use crate::run::children::VERSION;
use crate::run::rt::{self, RtArgs};
use args::{
    BenchCommand, CalibrateCommand, CheckArgs, DemoArgs, DoctorArgs, LatencyArgs, LogArgs, PlanArgs, PrintArgs,
    RobotCommand, RtdeCommand, SimCommand, WcetArgs,
};
use clap::{Parser, Subcommand};
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::process::ExitCode;

/// Turns a FIM IFC model into the motion of a robot that prints it.
#[derive(Debug, Parser)]
#[command(name = "screed", version = VERSION, arg_required_else_help = true)]
#[command(
    after_help = "Exit codes: 0 done, 1 failed, 2 usage, 3 cell file or model, 4 link, 5 safety stop, 6 no real time, 130 Ctrl-C."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show it working: a simulated UR10e and extruder print a wall
    Demo(DemoArgs),
    /// Plan a FIM model: layers, lengths, times, volumes, limits
    Plan(PlanArgs),
    /// Print a FIM model on the robot of a cell
    Print(PrintArgs),
    /// Say whether a cell file or a model is sound, and what was looked at
    Check(CheckArgs),
    /// Say whether this machine can hold a hard-timed loop, and what to change
    Doctor(DoctorArgs),
    /// Measure how late a loop wakes on this machine, alone or beside cyclictest
    Latency(LatencyArgs),
    /// Report how long a cycle can take: instructions, times, stack, and what their worst is
    Wcet(WcetArgs),
    /// Find frames, tools and an arm's geometry from measurements
    #[command(subcommand)]
    Calibrate(CalibrateCommand),
    /// Read a cycle log
    Log(LogArgs),
    /// Do a published experiment again
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Name robots, show one, or prove a description of one
    #[command(subcommand)]
    Robot(RobotCommand),
    /// Listen to a controller over RTDE; nothing is written to it
    #[command(subcommand)]
    Rtde(RtdeCommand),
    /// Run a simulated machine
    #[command(subcommand)]
    Sim(SimCommand),
    /// The real-time process (what the program screed-rt does)
    #[command(hide = true)]
    Rt(RtArgs),
}

/// Runs the program on the process' own arguments. Everything that fails is said here, once.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are no failure, and a closed output is none either.
            let _ = error.print();
            return if error.use_stderr() { Exit::Usage.into() } else { ExitCode::SUCCESS };
        }
    };
    match run(&cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => tell(&failure),
    }
}

fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Demo(args) => demo::run(args),
        Command::Plan(args) => plan::run(args),
        Command::Print(args) => print::run(args),
        Command::Rt(args) => Ok(rt::run(args)?),
        Command::Check(args) => check::run(args),
        Command::Doctor(args) => doctor::run(args),
        Command::Latency(args) => latency::run(args),
        Command::Wcet(args) => wcet::run(args),
        Command::Calibrate(command) => calibrate::run(command),
        Command::Log(args) => log::run(args),
        Command::Robot(command) => robot::run(command),
        Command::Rtde(RtdeCommand::Record(args)) => rtde::record(args),
        Command::Bench(command) => bench::run(command),
        Command::Sim(SimCommand::Ur(args)) => sim::ur(args),
        Command::Sim(SimCommand::Extruder(args)) => sim::extruder(args),
    }
}

/// `screed-rt`: the real-time process alone.
#[derive(Debug, Parser)]
#[command(name = "screed-rt", version = VERSION)]
#[command(args_conflicts_with_subcommands = true, arg_required_else_help = true)]
struct RtCli {
    #[command(flatten)]
    args: Option<RtArgs>,
    #[command(subcommand)]
    command: Option<RtCommand>,
}

#[derive(Debug, Subcommand)]
enum RtCommand {
    /// Play the kernel's test tape and compare what it gives with the expected bits
    #[command(hide = true)]
    Tape,
    /// Run many ticks unpaced and say what they took from memory
    #[command(hide = true)]
    Soak(soak::SoakArgs),
}

/// The program `screed-rt` on the process' own arguments.
pub fn rt_main() -> ExitCode {
    let cli = match RtCli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            return if error.use_stderr() { Exit::Usage.into() } else { ExitCode::SUCCESS };
        }
    };
    let result = match (&cli.command, &cli.args) {
        (Some(RtCommand::Tape), _) => tape::run(),
        (Some(RtCommand::Soak(args)), _) => soak::run(args),
        (None, Some(args)) => rt::run(args).map_err(Failure::from),
        // Without any argument there was the help to read; with some, clap asks for those that are needed.
        (None, None) => Err(Failure::new(Exit::Usage, "there is nothing to run", "give --cell and --socket")),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => tell(&failure),
    }
}

/// Says once what failed; the exit code is its class. Whoever started this process may have gone.
fn tell(failure: &Failure) -> ExitCode {
    if !failure.problems.is_empty() {
        let _ = writeln!(std::io::stderr(), "{failure}");
    }
    failure.exit.into()
}

/// Writes to standard output; a reader that has had enough (`| head`) is no failure.
fn say(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            let message = format!("standard output cannot be written: {error}");
            Err(Failure::new(Exit::Failed, message, "send it to a place with room"))
        }
        _ => Ok(()),
    }
}

/// A model and the bytes it was read from.
fn read_model(path: &Path) -> Result<(FimModel, Vec<u8>), Failure> {
    let name = path.to_string_lossy();
    let bytes = std::fs::read(path).map_err(|error| {
        Failure::new(
            Exit::Input,
            format!("cannot read the model {name}: {error}"),
            "check the path and the permissions",
        )
    })?;
    let model = fim::parse(&name, &bytes).map_err(|error| error.into_failure(&name, &bytes))?;
    Ok((model, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
        RtCli::command().debug_assert();
    }
}
