//! The real-time process of Screed.

use std::process::ExitCode;

fn main() -> ExitCode {
    screed::cli::rt_main()
}
