//! `screed-rt soak`: shows that the loop takes nothing from memory once it runs.

use super::say;
use crate::config::Realtime;
use crate::failure::{Exit, Failure};
use crate::run::memory::Memory;
use crate::run::{realtime, soak};

/// Arguments of `screed-rt soak`.
#[derive(Clone, Debug, clap::Args)]
pub struct SoakArgs {
    /// How many ticks
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub ticks: u64,
    /// Allocate once and touch a fresh page in the loop: shows that the account counts both
    #[arg(long)]
    pub take_memory: bool,
}

/// Plays the ticks and says what they took.
///
/// # Errors
/// [`Failure`] when they took anything, or memory cannot be locked.
pub fn run(args: &SoakArgs) -> Result<(), Failure> {
    let scheduling = realtime::enter(&Realtime::default());
    if !scheduling.realtime {
        let message = format!("no real time: {}", scheduling.note);
        return Err(Failure::new(Exit::NotRealTime, message, "grant what was refused"));
    }
    let taken = soak::soak(args.ticks, args.take_memory)?;
    let Memory { allocations, faults_minor, faults_major } = taken;
    say(&format!(
        "{} ticks unpaced: {allocations} allocations, {faults_minor} minor and {faults_major} major page faults\n",
        args.ticks
    ))?;
    if taken == Memory::default() {
        return Ok(());
    }
    Err(Failure::new(Exit::Failed, "the loop took something from memory after its start", "find what does"))
}
