//! A print in virtual time: host, kernel, link, robot and extruder in one thread, the same bytes through the same machines
//! as in a timed print, as fast as they go.

use crate::config::Cell;
use crate::failure::{Exit, Failure};
use crate::link::rtde::LinkError;
use crate::run::core::{Core, CoreError};
use crate::run::job::Outcome;
use crate::run::print::{self, Print};
use crate::run::session::{Session, SessionError, Step};
use crate::run::signal;
use crate::run::summary::Summary;
use crate::sim::extruder::{Extruder, TIME_CONSTANT};
use crate::sim::line::{BadLine, LineFault};
use crate::sim::ur::record::Record;
use crate::sim::ur::{ClientId, Controller, Options};
use screed_kernel::units::Nanos;
use std::path::PathBuf;
use std::time::Duration;

/// The robot's own cycle (ns): e-Series.
const CYCLE_NS: u64 = 2_000_000;
/// Virtual time between two lines of progress (ns).
const PROGRESS_NS: u64 = 60_000_000_000;

/// Why a print in virtual time failed.
#[derive(Debug, thiserror::Error)]
pub enum VirtualError {
    /// The host's side.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The link.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The cell.
    #[error(transparent)]
    Core(#[from] CoreError),
}

/// The machines that take part, and what is between them.
pub struct World {
    core: Core,
    controller: Controller,
    client: ClientId,
    extruder: Extruder,
    line: BadLine,
    now: Nanos,
}

impl World {
    /// The real-time process' machine, connected to a controller and an extruder. `fault` spoils one package of the robot.
    ///
    /// # Errors
    /// [`CoreError`] when the cell's link or extruder line cannot be.
    pub fn new(
        cell: &Cell,
        mut controller: Controller,
        extruder: Extruder,
        fault: Option<LineFault>,
    ) -> Result<Self, CoreError> {
        let client = controller.connect();
        let mut core = Core::new(cell, false, "virtual time")?;
        core.on_host_attached();
        Ok(Self { core, controller, client, extruder, line: BadLine::new(fault), now: Nanos(0) })
    }

    /// Seconds of virtual time.
    pub fn seconds(&self) -> f64 {
        self.now.0 as f64 * 1e-9
    }

    /// The real-time process' machine.
    pub const fn core(&self) -> &Core {
        &self.core
    }

    /// The robot.
    pub const fn controller(&self) -> &Controller {
        &self.controller
    }

    /// One cycle of the robot, with everything that follows from it.
    ///
    /// # Errors
    /// [`VirtualError`].
    pub fn step(&mut self, session: &mut Session<'_>) -> Result<Step, VirtualError> {
        self.now = self.now.plus(CYCLE_NS);
        self.controller.step();
        let link = self.exchange_robot();
        self.exchange_extruder();
        // What the process has to say of a broken link reaches the host first: it has the words for it.
        let heard = session.handle_bytes(self.core.to_host());
        let count = self.core.to_host().len();
        self.core.sent_to_host(count);
        heard?;
        link?;
        let step = session.step(self.seconds())?;
        let out = session.poll_transmit()?;
        let taken = self.core.on_host(out);
        out.drain(..taken);
        Ok(step)
    }

    fn exchange_robot(&mut self) -> Result<(), LinkError> {
        let mut bytes = [0; 2048];
        loop {
            let count = self.controller.poll_transmit(self.client, &mut bytes);
            if count == 0 {
                break;
            }
            let received = self.line.pass(bytes.get(..count).unwrap_or(&[]));
            self.core.on_robot(self.now, received)?;
        }
        self.core.on_time(self.now)?;
        loop {
            let count = self.core.to_robot(self.now, &mut bytes);
            if count == 0 {
                break;
            }
            self.controller.handle_bytes(self.client, bytes.get(..count).unwrap_or(&[]));
        }
        self.core.finish_cycle(self.now, self.now);
        Ok(())
    }

    fn exchange_extruder(&mut self) {
        let mut bytes = [0; 512];
        let count = self.core.to_extruder(self.now, &mut bytes);
        self.extruder.handle_bytes(bytes.get(..count).unwrap_or(&[]));
        self.extruder.step(CYCLE_NS as f64 * 1e-9);
        let count = self.extruder.poll_transmit(&mut bytes);
        self.core.on_extruder(self.now, bytes.get(..count).unwrap_or(&[]));
    }
}

/// The simulated surroundings of a print in virtual time.
#[derive(Clone, Debug)]
pub struct Virtual {
    /// The robot's program.
    pub program: String,
    /// Spoils one package of the robot.
    pub fault: Option<LineFault>,
    /// Where to write what the robot received and did, a row a cycle.
    pub record: Option<PathBuf>,
    /// Whether to show no progress.
    pub quiet: bool,
}

/// Prints in virtual time; the motion is confirmed as soon as there is a plan, as everything here is simulated.
///
/// # Errors
/// [`Failure`].
pub fn print(print: &Print<'_>, surroundings: Virtual) -> Result<Summary, Failure> {
    let cell = print.cell;
    let options = Options {
        start_q: cell.robot.start,
        flange_from_tcp: cell.tool.flange_from_tcp,
        register_offset: cell.link.register_offset,
        program: surroundings.program,
        autoplay: true,
    };
    let controller =
        Controller::new(&cell.robot.arm, options).map_err(|error| Failure::told(Exit::Input, error.to_string()))?;
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT)?;
    let mut world = World::new(cell, controller, extruder, surroundings.fault).map_err(VirtualError::from)?;
    let mut record = surroundings.record.as_deref().map(Record::create).transpose()?;
    let mut session = Session::new(cell, print.model, print.wishes.clone(), print::open_log(print)?);
    let result = play(&mut world, &mut session, record.as_mut(), surroundings.quiet);
    session.finish()?;
    record.as_mut().map_or(Ok(()), Record::finish)?;
    let mut summary = session.summary(print.source.0, result?);
    (summary.scheduling, summary.scheduling_note) = ("virtual time", String::new());
    summary.log = print.log.as_ref().map(|path| path.display().to_string());
    Ok(summary)
}

/// Steps the world until the session ends; says how.
fn play(
    world: &mut World,
    session: &mut Session<'_>,
    mut record: Option<&mut Record>,
    quiet: bool,
) -> Result<&'static str, Failure> {
    let mut interrupted = false;
    loop {
        let step = world.step(session)?;
        if let Some(record) = &mut record {
            record.row(world.controller.last_cycle(), Duration::ZERO)?;
        }
        match step {
            Step::Running => {}
            Step::Confirm => session.confirm(),
            // A fresh kernel has none.
            Step::Rearm(_) => session.job().rearm(),
            Step::Ended(Outcome::Complete) => return Ok("complete"),
            Step::Ended(Outcome::Stopped) => return Ok(if interrupted { "interrupted" } else { "stopped" }),
        }
        if signal::stop_requested() && !interrupted {
            interrupted = true;
            session.stop();
        }
        if !quiet
            && world.now.0.is_multiple_of(PROGRESS_NS)
            && let Some(progress) = session.progress(world.seconds())
        {
            note!("{}", print::progress_line(session, &progress));
        }
    }
}

impl From<VirtualError> for Failure {
    fn from(error: VirtualError) -> Self {
        match error {
            VirtualError::Session(error) => error.into(),
            VirtualError::Core(error) => Self::told(Exit::Input, error.to_string()),
            VirtualError::Link(error) => Self::told(Exit::Link, error.to_string()),
        }
    }
}
