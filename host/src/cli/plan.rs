//! `screed plan`

use super::args::PlanArgs;
use super::controller::tell_nominal;
use super::{read_model, say};
use crate::config::{self, Cell};
use crate::failure::{Exit, Failure};
use crate::plan::report::Report;
use crate::plan::{Options, Plan, plot};
use std::path::Path;

/// Plans a model from the cell's start joints, without a robot, and tells, writes and draws what comes of it.
pub fn run(args: &PlanArgs) -> Result<(), Failure> {
    let (model, _) = read_model(&args.model)?;
    let cell = match &args.cell {
        Some(path) => config::load(path)?,
        None => Cell::demo(args.rate)?,
    };
    tell_nominal(&cell);
    let options = Options { from_layer: args.from_layer, layers: args.layers, dry: false };
    let plan = Plan::new(&model, &cell, &options, &cell.robot.start)?;
    let report = Report::new(&plan);
    let json = || report.json().map_err(|error| Failure::new(Exit::Failed, error.to_string(), "report this"));
    if let Some(path) = &args.out {
        let csv = path.extension().is_some_and(|ending| ending == "csv");
        write(path, &if csv { report.csv() } else { json()? })?;
    }
    if let Some(path) = &args.plot {
        let title = args.model.file_name().unwrap_or(args.model.as_os_str()).to_string_lossy();
        let svg = plot::svg(&plan, args.from_layer, &title).unwrap_or_default();
        write(path, &svg)?;
    }
    say(&if args.json { json()? + "\n" } else { report.table() })
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|error| {
        let message = format!("cannot write {}: {error}", path.display());
        Failure::new(Exit::Failed, message, "choose a folder that exists and can be written")
    })
}
