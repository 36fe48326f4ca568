//! The command line of Screed.

use std::process::ExitCode;

fn main() -> ExitCode {
    screed::cli::main()
}
