//! The command line: raw arguments, then checked ones, then one match.

pub mod args;
mod check;
mod demo;
mod log;
mod print;
mod sim;

use crate::failure::{Exit, Failure};
use crate::run::children::VERSION;
use crate::run::rt::{self, RtArgs};
use args::{CheckArgs, DemoArgs, LogArgs, PrintArgs, SimCommand};
use clap::{Parser, Subcommand};
use std::io::Write;
use std::process::ExitCode;

/// Turns a FIM IFC model into the motion of a robot that prints it.
#[derive(Debug, Parser)]
#[command(name = "screed", version = VERSION, arg_required_else_help = true)]
#[command(
    after_help = "Exit codes: 0 done, 1 failed, 2 usage, 3 cell file or model, 4 link, 5 safety stop, 130 Ctrl-C."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show it working: a simulated UR10e and extruder print a wall
    Demo(DemoArgs),
    /// Print a FIM model on the robot of a cell
    Print(PrintArgs),
    /// Say whether a cell file or a model is sound, and what was looked at
    Check(CheckArgs),
    /// Read a cycle log
    Log(LogArgs),
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
        Command::Print(args) => print::run(args),
        Command::Rt(args) => Ok(rt::run(args)?),
        Command::Check(args) => check::run(args),
        Command::Log(args) => log::run(args),
        Command::Sim(SimCommand::Ur(args)) => sim::ur(args),
        Command::Sim(SimCommand::Extruder(args)) => sim::extruder(args),
    }
}

/// `screed-rt`: the real-time process alone.
#[derive(Debug, Parser)]
#[command(name = "screed-rt", version = VERSION)]
struct RtCli {
    #[command(flatten)]
    args: RtArgs,
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
    match rt::run(&cli.args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => tell(&error.into()),
    }
}

/// Says once what failed; the exit code is its class. Whoever started this process may have gone.
fn tell(failure: &Failure) -> ExitCode {
    let _ = writeln!(std::io::stderr(), "{failure}");
    failure.exit.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }
}
