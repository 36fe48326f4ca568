//! `screed sim`

use super::args::{SimExtruderArgs, SimUrArgs, StartDeg};
use crate::config::{self, Cell};
use crate::failure::{Exit, Failure};
use crate::link::rtde::program::{Program, WatchdogAction};
use crate::run::signal;
use crate::sim::extruder::serve as extruder_server;
use crate::sim::ur::Options;
use crate::sim::ur::server as ur_server;
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
        None => own_program(&cell)?,
    };
    let start_q = args.start_deg.map_or(cell.robot.start, |StartDeg(joints)| JointPos(joints.map(f64::to_radians)));
    let controller = Options {
        start_q,
        flange_from_tcp: cell.tool.flange_from_tcp,
        register_offset: cell.link.register_offset,
        program,
        autoplay: true,
    };
    catch_stop()?;
    ur_server::serve(&ur_server::ServeOptions {
        model: args.model.clone(),
        controller,
        host: args.host,
        port: args.port,
        allow_remote: args.allow_remote,
        record: args.record.clone(),
        exit_when_idle: args.exit_when_idle,
        json: args.json,
        stop: signal::stop_requested,
    })?;
    Ok(())
}

/// The simulated extruder, until it is told to stop.
pub fn extruder(args: &SimExtruderArgs) -> Result<(), Failure> {
    let cell = cell(args.cell.as_deref())?;
    catch_stop()?;
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

/// The program that a person would load into the real robot for this cell.
fn own_program(cell: &Cell) -> Result<String, Failure> {
    let program = Program {
        rate_hz: cell.link.rate_hz,
        register_offset: cell.link.register_offset,
        lookahead: cell.link.servoj_lookahead,
        gain: cell.link.servoj_gain,
        watchdog: cell.link.watchdog,
        watchdog_action: WatchdogAction::Stop,
    };
    program.text().map_err(|error| Failure::new(Exit::Input, error.to_string(), "correct [link] in the cell file"))
}

fn catch_stop() -> Result<(), Failure> {
    signal::catch_stop().map_err(|error| {
        Failure::new(Exit::Failed, format!("signals cannot be caught: {error}"), "check the system's limits")
    })
}

impl From<ur_server::SimError> for Failure {
    fn from(error: ur_server::SimError) -> Self {
        use ur_server::SimError;
        let exit = match error {
            SimError::Controller(_) | SimError::Program { .. } => Exit::Input,
            SimError::NotLoopback { .. } => Exit::Usage,
            SimError::AddressInUse { .. } | SimError::Listen { .. } => Exit::Link,
            SimError::Record { .. } | SimError::Output { .. } => Exit::Failed,
        };
        Self::told(exit, error.to_string())
    }
}
