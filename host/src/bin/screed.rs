//! The command line of Screed.

use screed::run::memory::Counting;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn main() -> ExitCode {
    screed::cli::main()
}
