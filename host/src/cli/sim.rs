//! `screed sim`

use super::args::{SimExtruderArgs, SimUrArgs, StartDeg};
use crate::config::{self, Cell};
use crate::failure::{Exit, Failure};
use crate::robot;
use crate::run::{demo, signal};
use crate::sim::extruder::serve as extruder_server;
use crate::sim::ur::Options;
use crate::sim::ur::server as ur_server;
use screed_kernel::arm::Arm;
use screed_kernel::units::JointPos;
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
        arm: arm(args.model.as_deref(), &cell)?,
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
fn arm(model: Option<&str>, cell: &Cell) -> Result<Arm<6>, Failure> {
    match model {
        Some(model) if model != cell.robot.model => Ok(robot::ur(model)?),
        _ => Ok(cell.robot.arm),
    }
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
