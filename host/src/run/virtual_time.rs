//! A print in virtual time: host, kernel, link, robot and extruder in one thread, the same bytes through the same machines
//! as in a timed print, as fast as they go.

use crate::config::Cell;
use crate::link::rtde::LinkError;
use crate::run::core::{Core, CoreError};
use crate::run::job::Outcome;
use crate::run::session::{Session, SessionError, Step};
use crate::sim::extruder::Extruder;
use crate::sim::line::{BadLine, LineFault};
use crate::sim::ur::{ClientId, Controller, CycleRecord as RobotCycle};
use screed_kernel::units::Nanos;

/// The robot's own cycle (ns): e-Series.
const CYCLE_NS: u64 = 2_000_000;

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

    /// One cycle of the robot, with everything that follows from it; `on_cycle` sees what the robot received and did.
    ///
    /// # Errors
    /// [`VirtualError`].
    pub fn step(
        &mut self,
        session: &mut Session<'_>,
        on_cycle: &mut dyn FnMut(&RobotCycle),
    ) -> Result<Step, VirtualError> {
        self.now = self.now.plus(CYCLE_NS);
        self.controller.step();
        on_cycle(self.controller.last_cycle());
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

/// Plays a session to its end; the motion is confirmed as soon as there is a plan, as everything here is simulated.
///
/// # Errors
/// [`VirtualError`].
pub fn play(
    world: &mut World,
    session: &mut Session<'_>,
    on_cycle: &mut dyn FnMut(&RobotCycle),
    mut on_second: impl FnMut(&mut Session<'_>, f64),
) -> Result<Outcome, VirtualError> {
    loop {
        match world.step(session, on_cycle)? {
            Step::Running => {}
            Step::Confirm => session.confirm(),
            Step::Ended(outcome) => return Ok(outcome),
        }
        if world.now.0.is_multiple_of(1_000_000_000) {
            on_second(session, world.seconds());
        }
    }
}
