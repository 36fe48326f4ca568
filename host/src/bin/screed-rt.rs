//! The real-time process of Screed.

use screed::run::memory::Counting;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn main() -> ExitCode {
    screed::cli::rt_main()
}
