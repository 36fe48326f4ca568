//! `screed print`

use super::args::PrintArgs;
use super::{read_model, say};
use crate::config;
use crate::failure::{Exit, Failure, Problem};
use crate::plan::{Options, Plan};
use crate::run::print::{self, Print};
use crate::run::session::Wishes;
use crate::run::summary::Summary;
use crate::run::virtual_time::{self, Virtual};
use crate::run::{children, demo, signal};

/// Prints, and says how it went.
pub fn run(args: &PrintArgs) -> Result<(), Failure> {
    let cell = config::load(&args.cell)?;
    args.checked(&cell)?;
    let (model, bytes) = read_model(&args.model)?;
    let name = args.model.to_string_lossy();
    let print = Print {
        cell: &cell,
        model: &model,
        wishes: Wishes {
            plan: Options { from_layer: args.from_layer, layers: args.layers, dry: args.dry },
            stop_after: None,
        },
        log: args.log.clone(),
        source: (&name, &bytes),
        yes: args.yes,
        quiet: args.json,
    };
    signal::catch_stop()?;
    if args.fast {
        let program = demo::program(&cell)?;
        let surroundings = Virtual { program, fault: None, record: args.record.clone(), quiet: args.json };
        return report(&virtual_time::print(&print, surroundings)?, args.json);
    }
    // What cannot be planned from anywhere is told before a robot is asked for.
    Plan::new(&model, &cell, &print.wishes.plan, &cell.robot.start)?;
    if let Some(device) = &args.board {
        return report(&print::run(&print, print::attach_board(device, args.baud)?)?, args.json);
    }
    if let Some(socket) = &args.attach {
        return report(&print::run(&print, print::attach(socket, None)?)?, args.json);
    }
    let folder = demo::Folder::new()?;
    let socket = folder.join("rt.sock");
    let mut command = children::screed_rt()?;
    command.arg("--cell").arg(&args.cell).arg("--socket").arg(&socket);
    command.args(args.allow_non_rt.then_some("--allow-non-rt"));
    report(&print::run(&print, print::attach(&socket, Some(command))?)?, args.json)
}

/// The table, or JSON, on standard output. A print that a person interrupted is told as such to the shell.
pub fn report(summary: &Summary, json: bool) -> Result<(), Failure> {
    if json {
        let text = serde_json::to_string_pretty(summary)
            .map_err(|error| Failure::new(Exit::Failed, error.to_string(), "report this"))?;
        say(&(text + "\n"))?;
    } else {
        say(&summary.to_string())?;
    }
    if summary.outcome == "interrupted" {
        return Err(Failure { exit: Exit::Interrupted, problems: Vec::<Problem>::new() });
    }
    Ok(())
}
