//! `screed robot`

use super::args::{RobotCheckArgs, RobotCommand, RobotListArgs, RobotOf, RobotShowArgs};
use super::{controller, say};
use crate::failure::{Exit, Failure};
use crate::robot::urdf::Ends;
use crate::robot::{self, Description, calibration, examine, file, plot, report, urdf};
use crate::run::controller::acts::Act;
use std::path::Path;

/// One of them.
pub fn run(command: &RobotCommand) -> Result<(), Failure> {
    match command {
        RobotCommand::List(args) => list(args),
        RobotCommand::Show(args) => show(args),
        RobotCommand::Check(args) => check(args),
        RobotCommand::Status(args) => controller::status(args),
        RobotCommand::PowerOn(args) => controller::act(args, Act::PowerOn),
        RobotCommand::PowerOff(args) => controller::act(args, Act::PowerOff),
        RobotCommand::BrakeRelease(args) => controller::act(args, Act::BrakeRelease),
        RobotCommand::Unlock(args) => controller::act(args, Act::Unlock),
        RobotCommand::Play(args) => controller::play(args),
        RobotCommand::Stop(args) => controller::act(args, Act::Stop),
        RobotCommand::ClosePopup(args) => controller::act(args, Act::ClosePopup),
        RobotCommand::Program(args) => controller::program(args),
        RobotCommand::Calibration(args) => controller::calibration(args),
    }
}

fn list(args: &RobotListArgs) -> Result<(), Failure> {
    let catalogue = robot::catalogue();
    if args.json {
        let all: Vec<_> = catalogue.iter().map(|description| report::json(description, None)).collect();
        return say(&format!("{}\n", serde_json::Value::from(all)));
    }
    let known = |all: bool| if all { "known" } else { "unknown" };
    let mut text = format!("{:<18}  joints  speeds   accelerations  from\n", "name");
    for Description { name, origin, links, .. } in &catalogue {
        let speeds = known(links.iter().all(|link| link.velocity_max.is_some()));
        let accelerations = known(links.iter().all(|link| link.acceleration_max.is_some()));
        text += &format!("{name:<18}  {:>6}  {speeds:<7}  {accelerations:<13}  {origin}\n", links.len());
    }
    say(&text)
}

fn show(args: &RobotShowArgs) -> Result<(), Failure> {
    let description = description(&args.robot)?;
    match args.json {
        true => say(&format!("{}\n", report::json(&description, None))),
        false => say(&report::describe(&description)),
    }
}

fn check(args: &RobotCheckArgs) -> Result<(), Failure> {
    let description = description(&args.robot)?;
    let found = examine::examine(&description, args.count, args.seed).ok_or_else(|| {
        Failure::new(Exit::Input, format!("{} has not 3 to 9 joints", description.name), "describe another chain")
    })?;
    if let Some(path) = &args.plot {
        std::fs::write(path, plot::svg(&description, &found)).map_err(|error| {
            let message = format!("cannot write {}: {error}", path.display());
            Failure::new(Exit::Failed, message, "choose a folder that exists and can be written")
        })?;
    }
    match args.json {
        true => say(&format!("{}\n", report::json(&description, Some(&found))))?,
        false => say(&(report::describe(&description) + &report::tell(&found)))?,
    }
    if found.misses == 0 {
        return Ok(());
    }
    let message = format!("{} of {} round trips of {} failed", found.misses, found.count, description.name);
    Err(Failure::new(Exit::Input, message, "compare the table with the robot; docs/robots.md says what is checked"))
}

/// A file by its ending, or a name of the catalogue.
fn description(of: &RobotOf) -> Result<Description, Failure> {
    let path = Path::new(&of.robot);
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let ends = Ends { base: of.base.clone(), tip: of.tip.clone() };
    let usage = |option: &str, goes_with: &str| {
        Failure::new(
            Exit::Usage,
            format!("{option} goes with {goes_with}: found {}", of.robot),
            format!("leave {option} out"),
        )
    };
    let is_urdf = matches!(ending.as_deref(), Some("urdf" | "xml"));
    if !is_urdf && (of.base.is_some() || of.tip.is_some()) {
        return Err(usage("--base or --tip", "a URDF"));
    }
    if let Some(path) = &of.calibration {
        let is_other = is_urdf || ending.as_deref() == Some("toml") || robot::named(&of.robot).is_ok();
        let nominal = robot::ur(&of.robot).map_err(|unknown| match is_other {
            true => usage("--calibration", "a UR of the catalogue"),
            false => unknown.into(),
        })?;
        let unit = calibration::load(path, &nominal)?;
        let origin = format!("the calibration {} of a {}", path.display(), nominal.name);
        let mut description = Description::of(&unit.arm, &origin);
        description.notes.push(format!(
            "its flange is {:.2} mm from the nominal one on average, {:.2} mm at most",
            unit.deviation_mean * 1e3,
            unit.deviation_max * 1e3
        ));
        return Ok(description);
    }
    match ending.as_deref() {
        Some("toml") => Ok(file::load(path)?),
        _ if is_urdf => Ok(urdf::load(path, &ends)?),
        _ => Ok(robot::named(&of.robot)?),
    }
}
