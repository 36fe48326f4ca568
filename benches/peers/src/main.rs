//! Our kinematics and our filter beside other people's, in one run: first whether both give the same answers, then time and
//! instructions. `.ci/peers` and `.ci/filter_peers` build the workers and start this.

mod arms;
mod check;
mod child;
mod filter;
mod opw;
mod race;
mod record;
mod table;
mod worker;

use child::Outcome;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match arguments[..] {
        ["side-by-side", workers] => table::side_by_side(Path::new(workers)),
        ["filters", workers] => filter::side_by_side(Path::new(workers)),
        [item, arm, inputs] => worker::work(item, arm, Path::new(inputs), None),
        [item, arm, inputs, passes] => counted(item, arm, inputs, passes),
        _ => Err("usage: screed-peers side-by-side WORKERS | filters WORKERS | ITEM ARM INPUTS [PASSES]".into()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn counted(item: &str, arm: &str, inputs: &str, passes: &str) -> Outcome<()> {
    let passes = passes.parse().map_err(|error| format!("passes {passes:?}: {error}"))?;
    worker::work(item, arm, Path::new(inputs), Some(passes))
}
