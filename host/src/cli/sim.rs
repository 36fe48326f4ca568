//! `screed sim`

use super::args::{SimExtruderArgs, SimUrArgs, SpeedsDeg, StartDeg};
use crate::config::{self, Cell};
use crate::failure::{Exit, Failure};
use crate::robot;
use crate::run::{demo, signal};
use crate::sim::extruder::serve as extruder_server;
use crate::sim::ur::Options;
use crate::sim::ur::server as ur_server;
use screed_kernel::arm::{Arm, Rating};
use screed_kernel::units::{JointPos, JointVel};
use std::path::Path;

/// The simulated controller, until it is told to stop.
pub fn ur(args: &SimUrArgs) -> Result<(), Failure> {
    let cell = cell(args.cell.as_deref())?;
    let program = match &args.program {
        Some(path) => std::fs::read_to_string(path).map_err(|error| {
            let message = format!("cannot read the robot program {}: {error}", path.display());
            Failure::new(Exit::Input, message, "check the path and that the file may be read")
        })?,
        None => demo::program(&cell)?,
    };
    let start_q = args.start_deg.map_or(cell.robot.start, |StartDeg(joints)| JointPos(joints.map(f64::to_radians)));
    let controller = Options {
        start_q,
        generation: args.controller,
        powered: !args.power_off,
        autoplay: !args.no_autoplay,
        ..Options::of(&cell, program)
    };
    signal::catch_stop()?;
    ur_server::serve(&ur_server::ServeOptions {
        arm: arm(args.model.as_deref(), &cell, args.joint_speeds_deg_s)?,
        controller,
        host: args.host,
        port: args.port,
        allow_remote: args.allow_remote,
        record: args.record.clone(),
        rtde_protocol: args.rtde_protocol,
        exit_when_idle: args.exit_when_idle,
        json: args.json,
        fieldbus: args.fieldbus,
        faults: args.fault.clone(),
        control: args.control,
        stop: signal::stop_requested,
    })?;
    Ok(())
}

/// The cell's arm when it is the one asked for, because its speeds may be the cell file's; else the catalogue's.
fn arm(model: Option<&str>, cell: &Cell, speeds: Option<SpeedsDeg>) -> Result<Arm<6>, Failure> {
    let mut arm = match model {
        Some(model) if model != cell.robot.model => robot::ur(model)?,
        _ => cell.robot.arm,
    };
    if let Some(SpeedsDeg(speeds)) = speeds {
        arm.velocity_max = Rating::Known(JointVel(speeds.map(f64::to_radians)));
    }
    Ok(arm)
}

/// The simulated extruder, until it is told to stop.
pub fn extruder(args: &SimExtruderArgs) -> Result<(), Failure> {
    let cell = cell(args.cell.as_deref())?;
    signal::catch_stop()?;
    extruder_server::serve(&extruder_server::ServeOptions {
        flow_max: cell.extruder.flow_max,
        record: args.record.clone(),
        exit_when_idle: args.exit_when_idle,
        json: args.json,
        stop: signal::stop_requested,
    })?;
    Ok(())
}

fn cell(path: Option<&Path>) -> Result<Cell, Failure> {
    Ok(path.map_or_else(|| Cell::demo(125), config::load)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::ur::{Controller, ControllerError};
    use clap::Parser;
    use screed_kernel::arms::ur;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        args: SimUrArgs,
    }

    fn controller(options: &str) -> Result<Controller, ControllerError> {
        let Line { args } = Line::try_parse_from(format!("ur {options}").split_whitespace()).expect("a sound line");
        let cell = Cell::demo(125).expect("a sound cell");
        let arm = arm(args.model.as_deref(), &cell, args.joint_speeds_deg_s).expect("a model of the catalogue");
        Controller::new(&arm, Options::of(&cell, String::new()))
    }

    #[test]
    fn every_model_starts_by_its_name_or_by_the_line_that_the_error_prints() {
        let mut told = Vec::new();
        for known in &ur::ALL {
            if let Err(error) = controller(&format!("--model {}", known.name)) {
                let text = error.to_string();
                let (_, line) = text.split_once("screed sim ur ").expect("a command");
                let line = line.split(')').next().expect("its end");
                assert!(controller(line).is_ok(), "{line}");
                told.push(known.name);
            }
        }
        assert_eq!(told, ["ur8long", "ur18"]);
    }

    #[test]
    fn joint_speeds_of_the_command_line_go_before_the_data_sheets() {
        let speeds = SpeedsDeg([90.0, 90.0, 90.0, 180.0, 180.0, 180.0]);
        let arm = arm(Some("ur5e"), &Cell::demo(125).expect("a sound cell"), Some(speeds)).expect("a model");
        assert_eq!(arm.velocity_max.known().map(|known| known.0[5]), Some(std::f64::consts::PI));
        for wrong in ["1,2,3", "1,2,3,4,5,0", "1,2,3,4,5,x"] {
            assert!(Line::try_parse_from(["ur", "--joint-speeds-deg-s", wrong]).is_err(), "{wrong}");
        }
    }
}
