//! A print in virtual time: host, kernel, link, robot and extruder in one thread, the same bytes through the same machines
//! as in a timed print, as fast as they go.

mod mishaps;

pub use mishaps::{Cut, Stalled};

use crate::config::{Cell, Pacing};
use crate::failure::{Exit, Failure};
use crate::link::LinkError;
use crate::run::core::{Core, CoreError, Slot};
use crate::run::grid::Grid;
use crate::run::job::Outcome;
use crate::run::memory::{self, Memory};
use crate::run::print::{self, Print};
use crate::run::session::{Session, SessionError, Step};
use crate::run::signal;
use crate::run::summary::Summary;
use crate::sim::extruder::{Extruder, TIME_CONSTANT};
use crate::sim::line::{BadLine, LineFault};
use crate::sim::ur::record::Record;
use crate::sim::ur::{ClientId, Controller, Options};
use mishaps::Stall;
use screed_kernel::estimator::TrackerPose;
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
#[derive(Clone)]
pub struct World {
    core: Core,
    controller: Controller,
    client: ClientId,
    /// Connections of before.
    clients: Vec<ClientId>,
    extruder: Extruder,
    line: BadLine,
    /// How the line is cut, if it is, and whether half a package is still to pass.
    cut: Option<Cut>,
    half: bool,
    /// Telegrams that do not come.
    skip: u32,
    /// Whether the next answer is held up, and what is.
    delays: bool,
    delayed: Vec<u8>,
    now: Nanos,
    /// The robot's cycle by this clock (ns).
    cycle_ns: u64,
    /// Where the timer paces.
    grid: Option<Grid>,
    stall: Option<Stall>,
    /// What has come from the robot and is not read.
    waiting: Vec<u8>,
    /// What the process took from memory in its own calls, if that is looked at.
    memory: Option<Memory>,
}

impl World {
    /// The real-time process' machine, connected to a controller and an extruder. `fault` spoils one package of the robot.
    ///
    /// # Errors
    /// [`CoreError`] when the cell's link or extruder line cannot be.
    pub fn new(
        cell: &Cell,
        controller: Controller,
        extruder: Extruder,
        fault: Option<LineFault>,
    ) -> Result<Self, CoreError> {
        Ok(Self::around(Core::new(cell, false, "virtual time")?, cell, controller, extruder, fault))
    }

    /// The same for a cell with a tracker, whose poses the caller gives: [`Self::on_tracker`].
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn tracked(cell: &Cell, controller: Controller, extruder: Extruder) -> Result<Self, CoreError> {
        Ok(Self::around(Core::tracked(cell, false, "virtual time")?, cell, controller, extruder, None))
    }

    fn around(
        mut core: Core,
        cell: &Cell,
        mut controller: Controller,
        extruder: Extruder,
        fault: Option<LineFault>,
    ) -> Self {
        let client = controller.connect();
        core.on_host_attached();
        let period_ns = 1_000_000_000 / u64::from(cell.link.rate_hz);
        Self {
            core,
            controller,
            client,
            clients: Vec::new(),
            extruder,
            line: BadLine::new(fault),
            cut: None,
            half: false,
            skip: 0,
            delays: false,
            delayed: Vec::new(),
            now: Nanos(0),
            cycle_ns: CYCLE_NS,
            grid: (cell.realtime.pacing == Pacing::Timer).then(|| Grid::new(period_ns, 0)),
            stall: None,
            waiting: Vec::new(),
            memory: None,
        }
    }

    /// A pose of the tracker reaches the process before the robot's next telegram; gives one that is left out for it.
    #[must_use = "a pose that is left out is to be told"]
    pub fn on_tracker(&mut self, pose: TrackerPose) -> Option<TrackerPose> {
        self.core.on_tracker(pose)
    }

    /// Virtual time.
    pub const fn now(&self) -> Nanos {
        self.now
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

    /// The robot's clock runs fast by so many millionths, or slow.
    pub fn set_robot_clock(&mut self, ppm: i32) {
        let cycle = CYCLE_NS as f64 / (1.0 + f64::from(ppm) * 1e-6);
        self.cycle_ns = cycle.round() as u64;
    }

    /// From now on counts what the process takes from memory in its own calls.
    pub fn count_memory(&mut self) {
        self.memory = Some(Memory::default());
    }

    /// What it has taken since, in a program that counts.
    pub const fn memory(&self) -> Option<&Memory> {
        self.memory.as_ref()
    }

    /// Takes something, once.
    pub fn take_memory(&mut self) {
        self.counted(|_| memory::take_some());
    }

    fn counted<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let Some(total) = self.memory else { return work(self) };
        let before = Memory::now();
        let result = work(self);
        self.memory = Some(total.plus(&Memory::now().since(&before)));
        result
    }

    /// One cycle of the robot, with everything that follows from it.
    ///
    /// # Errors
    /// [`VirtualError`].
    pub fn step(&mut self, session: &mut Session<'_>) -> Result<Step, VirtualError> {
        let link = self.step_machines();
        // What the process has to say of a broken link reaches the host first: it has the words for it.
        let heard = session.handle_bytes(self.core.to_host());
        let count = self.core.to_host().len();
        self.core.sent_to_host(count);
        heard?;
        link?;
        let step = session.step(self.seconds())?;
        let out = session.poll_transmit()?;
        let taken = self.from_host(out);
        out.drain(..taken);
        Ok(step)
    }

    /// One cycle of the robot with the process and the extruder, and no host.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn step_machines(&mut self) -> Result<(), LinkError> {
        self.now = self.now.plus(self.cycle_ns);
        self.controller.step();
        let link = self.exchange_robot();
        self.exchange_extruder();
        link
    }

    /// Bytes of a host; gives how many were taken. A process that stalls takes none.
    pub fn from_host(&mut self, bytes: &[u8]) -> usize {
        if self.stall.is_some_and(|stall| stall.begun) {
            return 0;
        }
        self.counted(|world| world.core.on_host(bytes))
    }

    /// What the process has for a host, which takes it with that.
    pub fn to_host(&mut self) -> Vec<u8> {
        let bytes = self.core.to_host().to_vec();
        self.core.sent_to_host(bytes.len());
        bytes
    }

    fn exchange_robot(&mut self) -> Result<(), LinkError> {
        let came = self.collect();
        if let Some(Cut::Reset | Cut::ControllerGone) = self.cut {
            self.counted(|world| world.core.on_robot_closed(world.now))?;
        }
        if let Some(stall) = &mut self.stall {
            match (stall.stalled, stall.begun) {
                (Stalled::BeforeReading, _) if !came || stall.left > 0 => {
                    stall.left -= u32::from(came);
                    return Ok(());
                }
                (Stalled::BeforeReading, _) => self.stall = None,
                (Stalled::BeforeAnswering, false) if came => {
                    stall.begun = true;
                    return self.hear();
                }
                (Stalled::BeforeAnswering, false) => {}
                (Stalled::BeforeAnswering, true) => {
                    stall.left -= u32::from(came);
                    if stall.left > 0 {
                        return Ok(());
                    }
                    self.stall = None;
                    self.reply();
                }
            }
        }
        self.hear()?;
        self.counted(|world| world.core.on_time(world.now))?;
        self.reply();
        Ok(())
    }

    /// What the robot has sent by now lies ready for the process; whether something came.
    fn collect(&mut self) -> bool {
        let before = self.waiting.len();
        let mut bytes = [0; 2048];
        loop {
            let count = self.controller.poll_transmit(self.client, &mut bytes);
            if count == 0 {
                return self.waiting.len() > before;
            }
            let passed = match self.cut {
                None if self.skip > 0 => {
                    self.skip -= 1;
                    0
                }
                None => count,
                Some(_) if std::mem::take(&mut self.half) => count / 2,
                Some(_) => 0,
            };
            self.waiting.extend_from_slice(self.line.pass(bytes.get(..passed).unwrap_or(&[])));
        }
    }

    /// The process reads and ticks.
    fn hear(&mut self) -> Result<(), LinkError> {
        self.counted(Self::read_and_tick)
    }

    fn read_and_tick(&mut self) -> Result<(), LinkError> {
        let heard = if self.waiting.is_empty() { Ok(()) } else { self.core.on_robot(self.now, &self.waiting) };
        let slot = match &mut self.grid {
            // As after a poll that found nothing to read.
            None => (!self.waiting.is_empty()).then_some((self.now, 0)),
            Some(grid) if grid.due() <= self.now.0 => {
                let slot = grid.wake(self.now.0);
                Some((Nanos(slot.due), u32::try_from(slot.missed).unwrap_or(u32::MAX)))
            }
            Some(_) => None,
        };
        self.waiting.clear();
        heard?;
        match slot {
            Some((began, missed)) => self.core.answer(self.now, Slot { began, missed, line_free: true }),
            None => Ok(()),
        }
    }

    /// The process' answer reaches the robot.
    fn reply(&mut self) {
        let mut bytes = [0; 2048];
        let mut delayed = std::mem::take(&mut self.delayed);
        loop {
            let count = self.core.to_robot(self.now, &mut bytes);
            if count == 0 {
                break;
            }
            let sent = bytes.get(..count).unwrap_or(&[]);
            if std::mem::take(&mut self.delays) {
                self.delayed.extend_from_slice(sent);
            } else if self.cut.is_none() {
                delayed.extend_from_slice(sent);
            }
        }
        if !delayed.is_empty() {
            self.controller.handle_bytes(self.client, &delayed);
        }
        self.counted(|world| world.core.finish_cycle(world.now, world.now));
    }

    fn exchange_extruder(&mut self) {
        let mut bytes = [0; 512];
        let runs = self.stall.is_none_or(|stall| !stall.begun);
        if runs {
            let count = self.core.to_extruder(self.now, &mut bytes);
            self.extruder.handle_bytes(bytes.get(..count).unwrap_or(&[]));
        }
        self.extruder.step(CYCLE_NS as f64 * 1e-9);
        if runs {
            let count = self.extruder.poll_transmit(&mut bytes);
            self.core.on_extruder(self.now, bytes.get(..count).unwrap_or(&[]));
        }
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
    let options = Options::of(cell, surroundings.program);
    let controller =
        Controller::new(&cell.robot.arm, options).map_err(|error| Failure::told(Exit::Input, error.to_string()))?;
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT)?;
    let mut world = World::new(cell, controller, extruder, surroundings.fault).map_err(VirtualError::from)?;
    let mut record = surroundings.record.as_deref().map(Record::create).transpose()?;
    let mut session = Session::new(cell, print.model, print.wishes.clone(), print::open_log(print)?);
    let result = play(&mut world, &mut session, record.as_mut(), surroundings.quiet);
    session.finish()?;
    record.as_mut().map_or(Ok(()), Record::finish)?;
    let mut summary = session.summary(print.source.0, result.as_ref().unwrap_or(&print::FAILED));
    (summary.scheduling, summary.scheduling_note) = ("virtual time", String::new());
    // Nothing takes any time there.
    (summary.figures.sensor_to_wire, summary.figures.memory) = (None, None);
    summary.log = print.log.as_ref().map(|path| path.display().to_string());
    if result.is_err() {
        print::tell_account(print, &summary);
    }
    result.map(|_| summary)
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
