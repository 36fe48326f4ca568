//! `screed print`

use super::args::PrintArgs;
use super::controller::{self, Wanted, asked, tell_person};
use super::{read_model, say};
use crate::config::{self, Cell};
use crate::failure::{Exit, Failure, Problem};
use crate::link::rtde::program::ProgramState;
use crate::plan::{Options, Plan};
use crate::run::controller::Place;
use crate::run::print::{self, Again, Print};
use crate::run::session::Wishes;
use crate::run::summary::Summary;
use crate::run::virtual_time::{self, Virtual};
use crate::run::{children, demo, signal};
use std::io::{self, IsTerminal};
use std::path::Path;

/// Prints, and says how it went.
pub fn run(args: &PrintArgs) -> Result<(), Failure> {
    let mut cell = config::load(&args.cell)?;
    args.checked(&cell)?;
    let (model, bytes) = read_model(&args.model)?;
    let name = args.model.to_string_lossy();
    let wishes = Wishes {
        plan: Options { from_layer: args.from_layer, layers: args.layers, dry: args.dry },
        stop_after: None,
        first_layer_rate: (!cell.robot.simulated).then_some(cell.robot.first_layer_rate),
    };
    if args.fast {
        controller::tell_nominal(&cell);
    } else {
        // What cannot be planned from anywhere is told before a robot is asked for.
        Plan::new(&model, &cell, &wishes.plan, &cell.robot.start)?;
        robot_is_ready(args, &mut cell)?;
    }
    // From here on Ctrl-C comes to rest on the path; before, it ends a question.
    signal::catch_stop()?;
    let print = Print {
        cell: &cell,
        model: &model,
        wishes,
        log: args.log.clone(),
        source: (&name, &bytes),
        yes: args.yes,
        quiet: args.json,
        again: Some(again(args, &cell)),
    };
    if args.fast {
        let program = demo::program(&cell)?;
        let surroundings = Virtual { program, fault: None, record: args.record.clone(), quiet: args.json };
        return report(&virtual_time::print(&print, surroundings)?, args.json);
    }
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
    if let (true, Some(unit)) = (cell.robot.calibration_of_controller, &cell.robot.calibration) {
        let file = folder.join("unit.conf");
        controller::write_calibration(&file, unit, &cell.robot.model)?;
        command.arg("--calibration").arg(file);
    }
    report(&print::run(&print, print::attach(&socket, Some(command))?)?, args.json)
}

/// What goes on with this print after a failure.
fn again(args: &PrintArgs, cell: &Cell) -> Again {
    let file = |path: &Path| print::quoted(path);
    let mut print = format!("screed print {} --cell {}", file(&args.model), file(&args.cell));
    for (is_given, word) in
        [(!cell.robot.simulated, " --real-robot"), (args.dry, " --dry"), (args.allow_non_rt, " --allow-non-rt")]
    {
        print += if is_given { word } else { "" };
    }
    match (&args.board, &args.attach) {
        (Some(device), _) => print += &format!(" --board {} --baud {}", file(device), args.baud),
        (None, Some(socket)) => print += &format!(" --upload --attach {}", file(socket)),
        (None, None) => print += " --upload",
    }
    let end = args.layers.map(|layers| args.from_layer.saturating_add(layers));
    Again { robot: args.board.is_none().then(|| args.cell.clone()), print, end }
}

/// Whether the robot at the cell's address is the cell's, and stands so that a print can begin; with `--upload` Screed's program
/// is started first. A real robot's serial number is confirmed by a person.
fn robot_is_ready(args: &PrintArgs, cell: &mut Cell) -> Result<(), Failure> {
    if args.board.is_some() {
        if cell.robot.calibration_of_controller {
            let message = "calibration = \"controller\": a board drives an arm of its own";
            return Err(Failure::new(Exit::Input, message, "give the file that the board's arm was made with"));
        }
    } else if args.attach.is_some() && cell.robot.simulated && !args.upload && !cell.robot.calibration_of_controller {
        // A screed-rt that somebody else has started may have its robot elsewhere.
        tell_person("note: the robot of that screed-rt is simulated and not looked at beforehand");
    } else {
        let wanted = Wanted { upload: args.upload, yes: args.yes, held: args.attach.is_some() };
        let prepared = controller::prepare(&Place::of(cell)?, cell, wanted)?;
        if cell.robot.simulated && !prepared.is_simulated && !io::stdin().is_terminal() {
            let message = "nobody can be asked: the standard input is no terminal, and the robot may be real: its controller's \
                           serial number is neither that of screed sim ur nor the cell's";
            return Err(Failure::new(Exit::Failed, message, "start the print at a terminal"));
        }
        if !wanted.held && prepared.program == ProgramState::Following {
            let message = "Screed's program follows setpoints that somebody sends: another print, or a screed-rt, drives the robot";
            let remedy = "end it, or give its socket with --attach; one that has just ended is stopped by its watchdog, then \
                          print again with --upload";
            return Err(Failure::new(Exit::Link, message, remedy));
        }
        if !args.json {
            tell_person(prepared.notes.trim_end());
        }
    }
    if cell.robot.simulated { Ok(()) } else { confirm_serial(args.serial.as_deref(), cell) }
}

/// A person names the robot that may move: the number in the cell file could be that of the one beside it.
fn confirm_serial(given: Option<&str>, cell: &Cell) -> Result<(), Failure> {
    let Some(expected) = &cell.robot.serial else {
        let message = format!("the robot of the cell {} is real: expected serial in [robot], found none", cell.name);
        return Err(Failure::new(
            Exit::Input,
            message,
            "add serial = \"…\" with the number on the plate of the robot's base",
        ));
    };
    let typed = match given {
        Some(given) => given.to_owned(),
        None => asked("Type the serial number on the plate of the robot that shall move: ")?,
    };
    if typed.trim() == expected {
        return Ok(());
    }
    let message = format!("serial number: expected {expected}, found {:?}", typed.trim());
    Err(Failure::new(Exit::Usage, message, "read it on the plate of the robot's base; nothing has moved"))
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
