//! `screed robot status`, and what a person does to a robot from here.

use super::args::{ActArgs, ControllerCalibrationArgs, ControllerOf, PlayArgs, ProgramArgs, StatusArgs};
use super::say;
use crate::config::{self, Cell};
use crate::failure::{Exit, Failure};
use crate::link::rtde::program::ProgramState;
use crate::robot::{self, calibration};
use crate::run::controller::acts::{self, Act};
use crate::run::controller::check::{self, Finding, Verdict};
use crate::run::controller::view::{self, Standing, View};
use crate::run::controller::{DashboardLine, Place, inputs, program};
use crate::run::demo;
use crate::run::person;
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur;
use serde_json::{Value, json};
use std::io::{self, BufRead, IsTerminal, Write};
use std::path::Path;

/// Where the controller is, and its cell where one was given.
fn target(of: &ControllerOf) -> Result<(Place, Option<Cell>), Failure> {
    match (&of.cell, &of.address) {
        (Some(path), _) => {
            let cell = config::load(path)?;
            Ok((Place::of(&cell)?, Some(cell)))
        }
        (None, Some(address)) => Ok((Place::new(&address.host, address.port)?, None)),
        (None, None) => Err(Failure::new(Exit::Usage, "no robot was named", "give --cell or --address")),
    }
}

/// One act, after a person has agreed.
pub fn act(args: &ActArgs, act: Act) -> Result<(), Failure> {
    let (place, cell) = target(&args.controller)?;
    let mut line = DashboardLine::connect(&place)?;
    // What only stops is sent whatever else the controller may answer.
    if !matches!(act, Act::Stop | Act::PowerOff) {
        let before = view::standing(&mut line)?;
        if let Some(cell) = &cell {
            check::failure(&check::identity(cell, &before)).map_or(Ok(()), Err)?;
        }
        if !act.is_wanted(&before)? {
            return say(&format!("there is nothing to {}: {}\n", act.word(), stands(&before)));
        }
        if let Some(warning) = act.warning(&before) {
            agreed(act.word(), warning, &place, &before, cell.as_ref(), args.yes)?;
        }
    }
    let now = acts::act(&mut line, act)?;
    say(&format!("{} done: {}\n", act.word(), stands(&now)))
}

/// `screed robot play`
pub fn play(args: &PlayArgs) -> Result<(), Failure> {
    let (place, cell) = target(&args.act.controller)?;
    let Some(mut cell) = cell.filter(|_| args.upload) else { return act(&args.act, Act::Play) };
    let Prepared { notes, program, uploaded, .. } =
        prepare(&place, &mut cell, Wanted { upload: true, yes: args.act.yes, held: true })?;
    let told = match (program, uploaded) {
        (ProgramState::Following, _) => {
            "Screed's program plays already and follows setpoints that somebody sends: nothing was uploaded"
        }
        (_, false) => "Screed's program plays already and waits for setpoints: nothing was uploaded",
        (_, true) => "Screed's program plays and waits for setpoints",
    };
    say(&format!("{notes}{told}\n"))
}

/// What is wanted of a robot.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Screed's program is sent where none plays.
    pub upload: bool,
    /// `--yes` was given.
    pub yes: bool,
    /// A `screed-rt` may hold the registers already, as it shall.
    pub held: bool,
}

/// Asks for the registers: of the robot that is meant, at a rate that it has, and not where somebody drives Screed's program by them.
fn look_at_inputs(place: &Place, cell: &Cell, view: &mut View) -> Result<(), Failure> {
    if check::is_meant(cell, view) && check::playing(view) != Some(ProgramState::Following) {
        view.inputs = Some(inputs::inputs(place, cell)?);
    }
    Ok(())
}

/// A robot that a print can begin on.
pub struct Prepared {
    /// What is to be known, as lines.
    pub notes: String,
    /// How far Screed's program is.
    pub program: ProgramState,
    /// Whether it was sent just now.
    pub uploaded: bool,
    /// Whether the controller shows itself as a simulated one.
    pub is_simulated: bool,
}

/// Looks whether the robot is the cell's and a print could begin; with `upload` Screed's program is
/// sent and started where none plays, after a person has agreed.
///
/// # Errors
/// [`Failure`] with everything that is in the way.
pub fn prepare(place: &Place, cell: &mut Cell, wanted: Wanted) -> Result<Prepared, Failure> {
    let Wanted { upload, yes, held } = wanted;
    let mut view = view::view(place, cell.link.register_offset)?;
    if !held {
        look_at_inputs(place, cell, &mut view)?;
    }
    of_controller(cell, &view)?;
    let mut findings = check::judge(cell, &view);
    if yes && cell.robot.simulated {
        yes_is_enough(cell, &view.standing)?;
    }
    let mut uploaded = false;
    if upload && check::playing(&view).is_none() {
        findings.retain(|finding| finding.what != check::PROGRAM);
        check::failure(&findings).map_or(Ok(()), Err)?;
        let warning = "Screed's program is sent and plays; it holds the arm where it is until setpoints come";
        agreed("upload", warning, place, &view.standing, Some(cell), yes)?;
        program::upload(place, cell.link.register_offset, &demo::program(cell)?)?;
        view = View { inputs: view.inputs, ..view::view(place, cell.link.register_offset)? };
        findings = check::judge(cell, &view);
        uploaded = true;
    }
    check::failure(&findings).map_or(Ok(()), Err)?;
    let program = check::playing(&view).unwrap_or(ProgramState::NotStarted);
    Ok(Prepared { notes: tell(&findings), program, uploaded, is_simulated: check::is_simulated(cell, &view.standing) })
}

/// Asks the person at the terminal. `--yes` answers for cells with a simulated robot only.
fn agreed(
    word: &'static str,
    warning: &str,
    place: &Place,
    now: &Standing,
    cell: Option<&Cell>,
    yes: bool,
) -> Result<(), Failure> {
    if yes {
        return match cell {
            Some(cell) if cell.robot.simulated => yes_is_enough(cell, now),
            _ => Err(Failure::new(
                Exit::Usage,
                format!("--yes answers for a person: expected one to confirm {word} of a robot that may be real"),
                "leave --yes out; it goes with --cell and a simulated robot",
            )),
        };
    }
    let model = now.model.as_deref().unwrap_or("model not told");
    let serial = now.serial.as_deref().unwrap_or("not told");
    tell_person(&format!(
        "robot at {}, port {}: {model}, serial number {serial}; {}",
        place.host,
        place.rtde,
        stands(now)
    ));
    tell_person(&format!("{word}: {warning}"));
    match asked(&format!("Type {word} to do it: "))?.as_str() {
        answer if answer == word => Ok(()),
        _ => Err(Failure::new(Exit::Failed, format!("{word} was not confirmed"), "nothing was done; begin again")),
    }
}

/// Whether `--yes` may answer for a person: only where the controller shows itself as the simulated one that is meant.
///
/// # Errors
/// A usage [`Failure`].
fn yes_is_enough(cell: &Cell, now: &Standing) -> Result<(), Failure> {
    if check::is_simulated(cell, now) {
        return Ok(());
    }
    let serial = now.serial.as_deref().unwrap_or("none");
    let message = format!(
        "--yes answers for a person: the cell says simulated = true, but the controller's serial number ({serial}) is neither that of \
         screed sim ur nor the cell's, and it may be a real robot behind a forwarded port"
    );
    Err(Failure::new(
        Exit::Usage,
        message,
        format!(
            "answer at a terminal without --yes; or, where it is another maker's simulation, set serial = \"{serial}\" in [robot]"
        ),
    ))
}

/// What a person types at the terminal.
///
/// # Errors
/// [`Failure`] where there is none.
pub fn asked(question: &str) -> Result<String, Failure> {
    let nobody = |why: &str| {
        let remedy = "type it at a terminal; --yes is for simulated robots";
        Failure::new(Exit::Failed, format!("nobody can be asked: {why}"), remedy)
    };
    if !io::stdin().is_terminal() {
        return Err(nobody("the standard input is no terminal"));
    }
    person::forget_typed();
    let _ = write!(io::stderr(), "{question}").and_then(|()| io::stderr().flush());
    let mut line = String::new();
    io::stdin().lock().read_line(&mut line).map_err(|error| nobody(&error.to_string()))?;
    Ok(line.trim().to_owned())
}

/// A line on standard error; nobody reading it is no failure.
pub fn tell_person(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}

fn stands(now: &Standing) -> String {
    let Standing { mode, safety, program, program_name, .. } = now;
    format!("robot {}, safety {}, program {} {program_name}", mode.name(), safety.name(), program.name())
}

/// `screed robot status`
pub fn status(args: &StatusArgs) -> Result<(), Failure> {
    let (place, cell) = target(&args.controller)?;
    let offset = cell.as_ref().map_or(0, |cell| cell.link.register_offset);
    let mut view = view::view(&place, offset)?;
    let findings = match cell {
        Some(mut cell) => {
            look_at_inputs(&place, &cell, &mut view)?;
            of_controller(&mut cell, &view)?;
            check::judge(&cell, &view)
        }
        None => Vec::new(),
    };
    if args.json {
        say(&format!("{}\n", as_json(&view, &findings)))?;
    } else {
        say(&as_text(&view, &findings))?;
    }
    check::failure(&findings).map_or(Ok(()), Err)
}

/// Takes the controller's own calibration, where the cell says so.
///
/// # Errors
/// [`Failure`] when it is none of the cell's model.
pub fn of_controller(cell: &mut Cell, view: &View) -> Result<(), Failure> {
    if cell.robot.calibration_of_controller {
        let unit = calibration::of_table(&view::table(&view.kinematics), &cell.robot.arm).map_err(|fault| {
            Failure::new(Exit::Input, fault.to_string(), "set model in [robot] to the robot that is there")
        })?;
        cell.calibrate(unit);
    }
    Ok(())
}

/// Says that a cell which takes its controller's calibration is planned without it.
pub fn tell_nominal(cell: &Cell) {
    if cell.robot.calibration_of_controller && cell.robot.calibration.is_none() {
        tell_person("note: planned with nominal geometry; the controller's calibration is read before a print");
    }
}

/// The findings as lines: a mark, what, what was found.
fn tell(findings: &[Finding]) -> String {
    let line = |Finding { what, text, verdict }: &Finding| {
        let mark = match verdict {
            Verdict::Good => "ok  ",
            Verdict::Note => "note",
            Verdict::Bad { .. } => "BAD ",
        };
        format!("  {mark}  {what:<16}  {text}\n")
    };
    findings.iter().map(line).collect()
}

fn as_text(view: &View, findings: &[Finding]) -> String {
    let View { standing, controller: version, .. } = view;
    let told = |text: &Option<String>| text.clone().unwrap_or_else(|| "not told".to_owned());
    let mut text = format!(
        "robot {}, serial number {}, software {}.{}.{}.{}\n{}\n",
        told(&standing.model),
        told(&standing.serial),
        version.major,
        version.minor,
        version.bugfix,
        version.build,
        stands(standing),
    );
    if !findings.is_empty() {
        text += "could a print begin?\n";
        text += &tell(findings);
    }
    text
}

fn as_json(view: &View, findings: &[Finding]) -> Value {
    let View { standing, controller: version, state, kinematics, .. } = view;
    let finding = |Finding { what, text, verdict }: &Finding| {
        let (verdict, action) = match verdict {
            Verdict::Good => ("ok", None),
            Verdict::Note => ("note", None),
            Verdict::Bad { action, .. } => ("bad", Some(action)),
        };
        json!({ "what": what, "verdict": verdict, "found": text, "action": action })
    };
    json!({
        "model": standing.model,
        "serial": standing.serial,
        "software": [version.major, version.minor, version.bugfix, version.build],
        "remote_control": standing.remote,
        "robot_mode": standing.mode.name(),
        "safety": standing.safety.name(),
        "program": standing.program.name(),
        "program_name": standing.program_name,
        "actual_q": state.actual_q,
        "actual_tcp_pose": state.actual_tcp_pose,
        "speed_slider": state.target_speed_fraction,
        "tcp_offset": state.tcp_offset,
        "payload_kg": state.payload,
        "payload_cog_m": state.payload_cog,
        "kinematics": {
            "theta": kinematics.theta,
            "a": kinematics.a,
            "d": kinematics.d,
            "alpha": kinematics.alpha,
            "checksum": kinematics.checksum,
            "status": kinematics.status,
        },
        "checks": findings.iter().map(finding).collect::<Vec<_>>(),
    })
}

/// `screed robot program`
pub fn program(args: &ProgramArgs) -> Result<(), Failure> {
    let text = demo::program(&config::load(&args.cell)?)?;
    written(args.out.as_deref(), &text)
}

/// `screed robot calibration`
pub fn calibration(args: &ControllerCalibrationArgs) -> Result<(), Failure> {
    if let Some(out) = args.out.as_ref().filter(|out| out.extension().is_none_or(|ending| ending != "conf")) {
        let message = format!("expected a name that ends with .conf, found {}", out.display());
        return Err(Failure::new(Exit::Usage, message, "a cell file takes a controller's calibration by this ending"));
    }
    let (place, cell) = target(&args.controller)?;
    let standing = view::standing(&mut DashboardLine::connect(&place)?)?;
    let found = view::kinematics(&place)?;
    let table = view::table(&found);
    let wanted = args.model.clone().or(cell.map(|cell| cell.robot.model));
    let nominal = match &wanted {
        Some(name) => robot::ur(name)?,
        None => fitting(&table, &standing)?,
    };
    let unit = calibration::of_table(&table, &nominal).map_err(|fault| {
        Failure::new(Exit::Input, fault.to_string(), "name the robot that is there with --model, or in the cell file")
    })?;
    let told = standing.serial.as_deref().unwrap_or("not told");
    let head =
        format!("# The calibration of a {} with serial number {told}, as its controller uses it.\n", nominal.name);
    let text = head + &calibration::conf(&table, &found.checksum, found.status, &nominal);
    tell_person(&format!(
        "{}, serial number {told}: the flange is {:.3} mm from the nominal one on average, {:.3} mm at most",
        nominal.name,
        unit.deviation_mean * 1e3,
        unit.deviation_max * 1e3
    ));
    written(args.out.as_deref(), &text)
}

/// The arm of the catalogue whose nominal table is nearest to the controller's.
fn fitting(table: &calibration::ControllerTable, standing: &Standing) -> Result<Arm<6>, Failure> {
    let fits = ur::ALL.iter().filter_map(|arm| Some((arm, calibration::of_table(table, arm).ok()?.deviation_max)));
    fits.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(arm, _)| *arm).ok_or_else(|| {
        let model = standing.model.as_deref().unwrap_or("its model is not told");
        let message = format!("no robot of the catalogue has the controller's geometry ({model})");
        Failure::new(Exit::Input, message, "name the nearest one with --model to see how far it is off")
    })
}

/// Writes the unit's calibration for `screed-rt`.
///
/// # Errors
/// [`Failure`] when the file cannot be written.
pub fn write_calibration(file: &Path, unit: &calibration::Calibrated, model: &str) -> Result<(), Failure> {
    written(Some(file), &calibration::conf_of(unit, &robot::ur(model)?))
}

fn written(out: Option<&Path>, text: &str) -> Result<(), Failure> {
    let Some(path) = out else { return say(text) };
    std::fs::write(path, text).map_err(|error| {
        let message = format!("cannot write {}: {error}", path.display());
        Failure::new(Exit::Failed, message, "choose a folder that exists and can be written")
    })
}
