//! The command line: raw arguments, then checked ones, then one match.

pub mod args;
mod check;
mod log;
mod sim;

use crate::failure::{Exit, Failure};
use args::{CheckArgs, LogArgs, SimCommand};
use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Turns a FIM IFC model into the motion of a robot that prints it.
#[derive(Debug, Parser)]
#[command(name = "screed", version, arg_required_else_help = true)]
#[command(
    after_help = "Exit codes: 0 done, 1 failed, 2 usage, 3 cell file or model, 4 link, 5 safety stop, 130 Ctrl-C."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Say whether a cell file or a model is sound, and what was looked at
    Check(CheckArgs),
    /// Read a cycle log
    Log(LogArgs),
    /// Run a simulated machine
    #[command(subcommand)]
    Sim(SimCommand),
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
        Err(failure) => {
            eprintln!("{failure}");
            failure.exit.into()
        }
    }
}

fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Check(args) => check::run(args),
        Command::Log(args) => log::run(args),
        Command::Sim(SimCommand::Ur(args)) => sim::ur(args),
        Command::Sim(SimCommand::Extruder(args)) => sim::extruder(args),
    }
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
