//! `screed-rt tape`: shows that the kernel inside this program gives the same bits as everywhere else.

use crate::failure::{Exit, Failure};
use screed_tape::{EXPECTED, SEED, TICKS, cell, play};

/// Plays the tape and says what it met.
///
/// # Errors
/// [`Failure`] when the tape did not meet everything it is for, or when the bits are others.
pub fn run() -> Result<(), Failure> {
    let mut kernel = Box::new(cell::kernel());
    let outcome = play(&mut kernel, SEED, TICKS);
    super::say(&format!("{TICKS} ticks, seed {SEED}\n{}\nhash {:#018x}\n", outcome.seen, outcome.hash.0))?;
    if !outcome.seen.is_complete() {
        return Err(Failure::new(Exit::Failed, "the tape did not meet everything", "change the tape, not the check"));
    }
    if outcome.hash.0 != EXPECTED {
        let message = format!("the kernel gives other bits: {:#018x} instead of {EXPECTED:#018x}", outcome.hash.0);
        return Err(Failure::new(Exit::Failed, message, "see EXPECTED in the crate screed-tape"));
    }
    Ok(())
}
