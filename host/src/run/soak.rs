//! Many ticks of the real-time process' machine as fast as they go, and what its calls took from memory: nothing, after the
//! start. The demo's wall is printed in virtual time, so that everything that a print needs happens.

use crate::bench::servoj;
use crate::config::{Cell, Lead};
use crate::failure::{Exit, Failure};
use crate::model::fim;
use crate::plan::Options as PlanOptions;
use crate::run::demo;
use crate::run::job::Outcome;
use crate::run::memory::Memory;
use crate::run::session::{Session, Step, Wishes};
use crate::run::virtual_time::{VirtualError, World};
use crate::sim::extruder::{Extruder, TIME_CONSTANT};
use crate::sim::ur::{Controller, Options};
use screed_fixtures::{QuarterCircle, quarter_circle};

/// Setpoints a second.
const RATE_HZ: u32 = 500;
/// Fewer ticks than a layer takes (70 s).
const TICKS_PER_LAYER: u64 = 30_000;

/// Plays `ticks` ticks; gives what was taken in them. `takes` has the loop take something once, to show that it is counted.
///
/// # Errors
/// [`Failure`] when the print breaks off.
pub fn soak(ticks: u64, takes: bool) -> Result<Memory, Failure> {
    let layers = usize::try_from(ticks / TICKS_PER_LAYER + 1).unwrap_or(usize::MAX);
    let published = QuarterCircle::default();
    let text = quarter_circle(&QuarterCircle { layers: published.layers.max(layers), ..published });
    let model = fim::parse("soak", text.as_bytes()).map_err(|error| error.into_failure("soak", text.as_bytes()))?;
    // With a lead, so that the loop around the kernel runs as well.
    let mut cell = Cell::demo(RATE_HZ)?;
    let servo = [cell.link.servoj_lookahead, cell.link.servoj_gain];
    cell.lead = Some(Lead::of(servoj::LIMITS, servoj::DEAD_TIME, servo));
    let options = Options::of(&cell, demo::program(&cell)?);
    let controller =
        Controller::new(&cell.robot.arm, options).map_err(|error| Failure::told(Exit::Input, error.to_string()))?;
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT)?;
    let mut world = World::new(&cell, controller, extruder, None).map_err(VirtualError::from)?;
    let wishes = Wishes {
        plan: PlanOptions { from_layer: 0, layers: Some(layers), dry: false },
        stop_after: None,
        first_layer_rate: None,
    };
    let mut session = Session::new(&cell, &model, wishes, None);
    world.count_memory();
    if takes {
        world.take_memory();
    }
    loop {
        match world.step(&mut session)? {
            Step::Running => {}
            Step::Confirm => session.confirm(),
            Step::Rearm(_) => session.job().rearm(),
            Step::Ended(Outcome::Complete | Outcome::Stopped) if world.core().ticks() >= ticks => {
                return Ok(world.memory().copied().unwrap_or_default());
            }
            Step::Ended(_) => {
                let message = format!("the print ended after {} ticks", world.core().ticks());
                return Err(Failure::new(Exit::Failed, message, "report this"));
            }
        }
        if world.core().ticks() == ticks {
            session.stop();
        }
    }
}
