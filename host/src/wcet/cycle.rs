//! The whole cycle of `screed-rt`, unpaced: a telegram decoded, the tick, frames of the host taken, the answer, the extruder's line and
//! the host's telemetry encoded; no socket and no clock. The demo's print, its robot, extruder and host simulated around it.

use super::WcetError;
use crate::config::Cell;
use crate::model::fim::{self, FimModel};
use crate::plan::Options as PlanOptions;
use crate::run::core::{Core, Slot};
use crate::run::demo::program;
use crate::run::session::{Session, Step, Wishes};
use crate::sim::extruder::{Extruder, TIME_CONSTANT};
use crate::sim::ur::{ClientId, Controller, Options};
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::units::Nanos;

/// The robot's own cycle (ns).
const CYCLE_NS: u64 = 2_000_000;

/// Most bytes one way in a cycle.
const BYTES_MAX: usize = 4096;

/// Bytes that come and go.
#[derive(Clone, Debug)]
pub struct Bytes {
    bytes: [u8; BYTES_MAX],
    len: usize,
}

impl Bytes {
    const fn none() -> Self {
        Self { bytes: [0; BYTES_MAX], len: 0 }
    }

    /// What is there.
    pub fn get(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&[])
    }

    fn set(&mut self, bytes: &[u8]) {
        self.len = bytes.len().min(BYTES_MAX);
        self.bytes[..self.len].copy_from_slice(&bytes[..self.len]);
    }
}

/// What a cycle takes in and puts out.
#[derive(Clone, Debug)]
pub struct Exchange {
    /// From the robot.
    pub robot_in: Bytes,
    /// From the host.
    pub host_in: Bytes,
    /// From the extruder.
    pub extruder_in: Bytes,
    /// To the robot.
    pub robot_out: Bytes,
    /// To the extruder.
    pub extruder_out: Bytes,
}

/// In a frame of its own, that a profiler finds by name.
pub mod measured {
    use super::{Core, Exchange, Nanos, Slot};
    use crate::link::LinkError;

    /// One cycle, between the bytes that came and those that go. Returns how many of the host's were taken.
    ///
    /// # Errors
    /// The link's.
    #[inline(never)]
    pub fn cycle(core: &mut Core, now: Nanos, exchange: &mut Exchange) -> Result<usize, LinkError> {
        let Exchange { robot_in, host_in, extruder_in, robot_out, extruder_out } = exchange;
        core.on_robot(now, robot_in.get())?;
        core.answer(now, Slot { began: now, missed: 0, line_free: true })?;
        core.on_time(now)?;
        robot_out.len = core.to_robot(now, &mut robot_out.bytes);
        core.finish_cycle(now, now);
        extruder_out.len = core.to_extruder(now, &mut extruder_out.bytes);
        core.on_extruder(now, extruder_in.get());
        Ok(core.on_host(host_in.get()))
    }
}

/// A print of the demo's wall, cycle by cycle.
pub struct Print<'a> {
    /// The process' machine.
    pub core: Core,
    /// What goes in and out.
    pub exchange: Exchange,
    session: Session<'a>,
    controller: Controller,
    client: ClientId,
    extruder: Extruder,
    /// Virtual time.
    pub now: Nanos,
}

/// The demo's model, of so many layers.
///
/// # Errors
/// [`WcetError::Print`].
pub fn model(layers: usize) -> Result<FimModel, WcetError> {
    let text = quarter_circle(&QuarterCircle { layers, ..QuarterCircle::default() });
    fim::parse("quarter-circle.ifc", text.as_bytes()).map_err(|error| WcetError::Print(error.to_string()))
}

impl<'a> Print<'a> {
    /// Before the first cycle.
    ///
    /// # Errors
    /// [`WcetError::Print`] where the cell does not carry it.
    pub fn new(cell: &'a Cell, model: &'a FimModel) -> Result<Self, WcetError> {
        let failed = |error: &dyn std::fmt::Display| WcetError::Print(error.to_string());
        let options = Options::of(cell, program(cell).map_err(|failure| failed(&failure))?);
        let mut controller = Controller::new(&cell.robot.arm, options).map_err(|error| failed(&error))?;
        let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).map_err(|error| failed(&error))?;
        let client = controller.connect();
        let mut core = Core::new(cell, false, "virtual time").map_err(|error| failed(&error))?;
        core.on_host_attached();
        let wishes = Wishes {
            plan: PlanOptions { from_layer: 0, layers: None, dry: false },
            stop_after: None,
            first_layer_rate: None,
        };
        let none = Bytes::none;
        Ok(Self {
            core,
            exchange: Exchange {
                robot_in: none(),
                host_in: none(),
                extruder_in: none(),
                robot_out: none(),
                extruder_out: none(),
            },
            session: Session::new(cell, model, wishes, None),
            controller,
            client,
            extruder,
            now: Nanos(0),
        })
    }

    /// The surroundings move on by a cycle: what they say waits in the exchange.
    ///
    /// # Errors
    /// [`WcetError::Print`].
    pub fn before(&mut self) -> Result<(), WcetError> {
        let Self { exchange, controller, extruder, session, .. } = self;
        self.now = self.now.plus(CYCLE_NS);
        controller.step();
        let robot_in = &mut exchange.robot_in;
        robot_in.len = controller.poll_transmit(self.client, &mut robot_in.bytes);
        extruder.step(CYCLE_NS as f64 * 1e-9);
        exchange.extruder_in.len = extruder.poll_transmit(&mut exchange.extruder_in.bytes);
        let out = session.poll_transmit().map_err(|error| WcetError::Print(error.to_string()))?;
        exchange.host_in.set(out);
        Ok(())
    }

    /// The cycle, measured.
    ///
    /// # Errors
    /// [`WcetError::Print`].
    pub fn cycle(&mut self) -> Result<(), WcetError> {
        let taken = measured::cycle(&mut self.core, self.now, &mut self.exchange);
        let taken = taken.map_err(|error| WcetError::Print(error.to_string()))?;
        let out = self.session.poll_transmit().map_err(|error| WcetError::Print(error.to_string()))?;
        out.drain(..taken.min(out.len()));
        Ok(())
    }

    /// The surroundings hear what was said; false at the print's end.
    ///
    /// # Errors
    /// [`WcetError::Print`].
    pub fn after(&mut self) -> Result<bool, WcetError> {
        let failed = |error: &dyn std::fmt::Display| WcetError::Print(error.to_string());
        self.controller.handle_bytes(self.client, self.exchange.robot_out.get());
        self.extruder.handle_bytes(self.exchange.extruder_out.get());
        self.session.handle_bytes(self.core.to_host()).map_err(|error| failed(&error))?;
        let count = self.core.to_host().len();
        self.core.sent_to_host(count);
        match self.session.step(self.now.0 as f64 * 1e-9).map_err(|error| failed(&error))? {
            Step::Confirm => self.session.confirm(),
            Step::Rearm(report) => {
                return Err(WcetError::Print(format!("the demo's print stopped: {:?}", report.fault)));
            }
            Step::Running => {}
            Step::Ended(_) => return Ok(false),
        }
        Ok(true)
    }
}

/// Plays so many cycles of the demo's print and nothing else: what the profiler looks at.
///
/// # Errors
/// [`WcetError::Print`].
pub fn play(cycles: usize) -> Result<(), WcetError> {
    let cell = Cell::demo(500).map_err(|error| WcetError::Print(error.to_string()))?;
    let model = model(3)?;
    let mut print = Print::new(&cell, &model)?;
    for _ in 0..cycles {
        print.before()?;
        print.cycle()?;
        print.after()?;
    }
    Ok(())
}

/// Times (ns) of so many cycles, in order, by a clock.
///
/// # Errors
/// [`WcetError::Print`].
pub fn measure(cycles: usize, mut before: impl FnMut(), clock: impl Fn() -> u64) -> Result<Vec<u64>, WcetError> {
    let cell = Cell::demo(500).map_err(|error| WcetError::Print(error.to_string()))?;
    let model = model(3)?;
    let mut print = Print::new(&cell, &model)?;
    let mut times = Vec::with_capacity(cycles);
    for _ in 0..cycles {
        print.before()?;
        before();
        let began = clock();
        print.cycle()?;
        times.push(clock() - began);
        print.after()?;
    }
    Ok(times)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_print_moves_the_robot() {
        let cell = Cell::demo(500).unwrap();
        let model = model(1).unwrap();
        let mut print = Print::new(&cell, &model).unwrap();
        for _ in 0..4000 {
            print.before().unwrap();
            print.cycle().unwrap();
            assert!(print.after().unwrap(), "the print has not ended after 8 s");
        }
        let (command, _) = print.core.last_command().unwrap();
        assert!(command.seq > 1000, "{command:?}");
    }
}
