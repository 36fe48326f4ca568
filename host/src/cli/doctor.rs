//! `screed doctor`

use super::args::DoctorArgs;
use super::say;
use crate::config::{self, Cell};
use crate::doctor::Diagnosis;
use crate::failure::{Exit, Failure};
use std::path::Path;

/// Says whether this machine can hold the loop, and what to change.
///
/// # Errors
/// A cell file that cannot be read, and [`Exit::NotRealTime`] where something bad was found.
pub fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let cell = match &args.cell {
        Some(path) => config::load(path)?,
        None => Cell::demo(125)?,
    };
    let diagnosis = Diagnosis::of(Path::new("/"), &cell.realtime);
    if args.json {
        let text = serde_json::to_string_pretty(&diagnosis)
            .map_err(|error| Failure::new(Exit::Failed, error.to_string(), "report this"))?;
        say(&(text + "\n"))?;
    } else {
        say(&diagnosis.to_string())?;
    }
    if diagnosis.can_hold { Ok(()) } else { Err(Failure { exit: Exit::NotRealTime, problems: Vec::new() }) }
}
