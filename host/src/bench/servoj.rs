//! How far the servo's lag is compensated: the demo's wall in virtual time, over every byte of the real path, on a simulated
//! UR10e whose `servoj` has another look-ahead and gain than the cell file says.
//!
//! The first layer is printed while the drives are identified; the later ones are scored. Then the demo's own layer, the first, is
//! printed once more by a cell that begins with what that one layer has taught. Errors are those of the tool: actual against
//! reference at equal stamps, the dead time that the cell names taken out; and actual against the model's curves.

pub mod report;

use crate::config::{Cell, ConfigError, Lead};
use crate::failure::Failure;
use crate::model::fim::{self, FimModel};
use crate::plan::Options as PlanOptions;
use crate::plan::contour::Contour;
use crate::plan::moves::MoveKind;
use crate::run::demo::program;
use crate::run::job::Outcome;
use crate::run::session::{Session, Step, Wishes};
use crate::run::virtual_time::{VirtualError, World};
use crate::sim::extruder::{Extruder, TIME_CONSTANT};
use crate::sim::ur::{CYCLE_RATE, Controller, Options};
use nalgebra::Point3;
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::drive::Drive;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

/// Layers that are printed; the first is for learning.
pub const LAYERS: usize = 3;

/// What of the lag is a dead time (s): a cycle until the robot's program has a target, two until the servo answers.
pub const DEAD_TIME: f64 = 0.006;

/// Longest print that is waited for, in cycles of the robot.
const CYCLES_MAX: usize = 500 * 3600;

/// How a lead may move the targets: 8°, 30 °/s, 1,150 °/s². Where the demo's path bends, q̈/K steps by up to 2 mrad; a third
/// of this acceleration would take 30 ms for that, and show as 0.25 mm at 500 Hz.
pub const LIMITS: CorrectionLimits = CorrectionLimits { size_max: 0.14, velocity_max: 0.53, acceleration_max: 20.0 };

/// One print.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Setpoints a second.
    pub rate_hz: u32,
    /// What the cell says of look-ahead and gain, as multiples of what the robot has; `None` for no compensation.
    pub assumed: Option<[f64; 2]>,
}

/// The prints that are compared: without compensation, with a cell file that is right, and with ones that are off by 30 %.
pub fn cases() -> Vec<Case> {
    let assumed = [None, Some([1.0, 1.0]), Some([0.7, 0.7]), Some([0.7, 1.3]), Some([1.3, 0.7]), Some([1.3, 1.3])];
    let at = |rate_hz| assumed.map(|assumed| Case { rate_hz, assumed });
    [125, 500].into_iter().flat_map(at).collect()
}

/// Why a print could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ServojError {
    /// The demo's cell.
    #[error(transparent)]
    Cell(#[from] ConfigError),
    /// What is simulated.
    #[error("the simulated machines cannot be: {0}")]
    SetUp(String),
    /// The print itself.
    #[error(transparent)]
    Print(#[from] VirtualError),
    /// It did not end as it should.
    #[error("the print ended {0}, and not complete")]
    Ended(String),
}

/// Largest and root-mean-square error (m).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Error {
    /// The largest.
    pub max: f64,
    /// Root mean square.
    pub rms: f64,
}

/// What a print came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Actual against reference at equal stamps, dead time taken out: on the first layer, and on the others.
    pub lag: [Error; 2],
    /// Actual against the curves of the layer, likewise.
    pub contour: [Error; 2],
    /// Lag and contour on the demo's layer, printed anew with what one layer has taught; `None` without compensation.
    pub again: Option<[Error; 2]>,
    /// Speed of the reference on the scored layers (m/s): mean and largest.
    pub speed: [f64; 2],
    /// The joint whose share in the way was largest.
    pub most: usize,
    /// What was learnt of the joint whose share in the way was largest; `None` without compensation.
    pub learnt: Option<Drive>,
    /// By how much a lead stayed behind at most (rad).
    pub behind: f64,
}

/// A deposit's cycle.
struct Sample {
    cycle: usize,
    layer: usize,
    reference: JointPos<6>,
}

/// What was recorded of a print.
struct Recorded {
    samples: Vec<Sample>,
    /// Joints at every cycle of the robot.
    actual: Vec<JointPos<6>>,
    /// When the first layer was done, and in the end.
    learnt: [Option<[Drive; 6]>; 2],
    behind: f64,
}

/// Prints.
///
/// # Errors
/// [`ServojError`]
pub fn run(case: &Case) -> Result<Score, ServojError> {
    let set_up = |error: &dyn std::fmt::Display| ServojError::SetUp(error.to_string());
    let text = quarter_circle(&QuarterCircle::default());
    let model = fim::parse("quarter-circle.ifc", text.as_bytes()).map_err(|error| set_up(&error))?;
    // The robot runs the program that the demo's cell makes; the cell that Screed has says otherwise.
    let mut cell = Cell::demo(case.rate_hz)?;
    let program = program(&cell).map_err(|failure| set_up(&failure))?;
    if let Some([lag, gain]) = case.assumed {
        cell.link.servoj_lookahead *= lag;
        cell.link.servoj_gain *= gain;
        let servo = [cell.link.servoj_lookahead, cell.link.servoj_gain];
        cell.lead = Some(Lead::of(LIMITS, DEAD_TIME, servo));
    }
    let options = Options::of(&cell, program);
    let recorded = print(&cell, &model, &options, LAYERS)?;
    let contours = || model.layers.iter().map(|layer| Contour::new(&layer.segments)).collect::<Vec<_>>();
    let mut found = score(case, &cell, contours(), &recorded);
    let [taught, _] = recorded.learnt;
    if let (Some(lead), Some(drives)) = (&mut cell.lead, taught) {
        lead.drive = drives[found.most];
        let again = score(case, &cell, contours(), &print(&cell, &model, &options, 1)?);
        found.again = Some([again.lag[0], again.contour[0]]);
    }
    Ok(found)
}

/// Prints so many layers.
fn print(cell: &Cell, model: &FimModel, options: &Options, layers: usize) -> Result<Recorded, ServojError> {
    let set_up = |error: &dyn std::fmt::Display| ServojError::SetUp(error.to_string());
    let controller = Controller::new(&cell.robot.arm, options.clone()).map_err(|error| set_up(&error))?;
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).map_err(|error| set_up(&error))?;
    let mut world = World::new(cell, controller, extruder, None).map_err(VirtualError::from)?;
    let wishes = Wishes {
        plan: PlanOptions { from_layer: 0, layers: Some(layers), dry: false },
        stop_after: None,
        first_layer_rate: None,
    };
    record(&mut world, &mut Session::new(cell, model, wishes, None))
}

/// Steps the world until the print has ended.
fn record(world: &mut World, session: &mut Session<'_>) -> Result<Recorded, ServojError> {
    let mut recorded = Recorded { samples: Vec::new(), actual: Vec::new(), learnt: [None; 2], behind: 0.0 };
    let mut tick = 0;
    for cycle in 0..CYCLES_MAX {
        let step = world.step(session)?;
        recorded.actual.push(world.controller().last_cycle().actual_q);
        if let (Some((command, report)), Some(plan)) = (world.core().last_command(), session.plan())
            && world.core().ticks() != tick
            && let Some(sent) = &command.joints
        {
            tick = world.core().ticks();
            recorded.behind = recorded.behind.max(report.behind);
            let drives = || world.core().lead().map(|lead| *lead.identification().learnt());
            if let Some(path) = plan.move_of(command.seq).filter(|path| path.kind == MoveKind::Deposit) {
                let reference = JointPos(std::array::from_fn(|j| sent.0[j] - command.correction.0[j]));
                if path.layer > 0 && recorded.learnt[0].is_none() {
                    recorded.learnt[0] = drives();
                }
                recorded.samples.push(Sample { cycle, layer: path.layer, reference });
            }
        }
        match step {
            Step::Running => {}
            Step::Confirm => session.confirm(),
            Step::Ended(Outcome::Complete) => {
                recorded.learnt[1] = world.core().lead().map(|lead| *lead.identification().learnt());
                return Ok(recorded);
            }
            Step::Ended(Outcome::Stopped) => return Err(ServojError::Ended("stopped".to_owned())),
            Step::Rearm(report) => return Err(ServojError::Ended(format!("with {:?}", report.fault))),
        }
    }
    Err(ServojError::Ended("never".to_owned()))
}

fn score(case: &Case, cell: &Cell, mut contours: Vec<Contour>, recorded: &Recorded) -> Score {
    let part_from_base = cell.part.base_from_part.inverse();
    let tcp = |joints: &JointPos<6>| -> Point3<f64> {
        let part_from_tcp: Pose = part_from_base * cell.robot.arm.forward(joints) * cell.tool.flange_from_tcp;
        part_from_tcp.translation.into()
    };
    let dead_cycles = (DEAD_TIME * f64::from(CYCLE_RATE)).round() as usize;
    let (mut lag, mut contour): ([Sum; 2], [Sum; 2]) = Default::default();
    let (mut speed, mut turned, mut before) = (Sum::default(), [0.0_f64; 6], None::<(&Sample, Point3<f64>)>);
    for sample in &recorded.samples {
        // The last few cycles of a print have no later ones.
        let Some(actual) = recorded.actual.get(sample.cycle + dead_cycles) else { continue };
        let later = usize::from(sample.layer > 0);
        let (reference, actual) = (tcp(&sample.reference), tcp(actual));
        lag[later].add((actual - reference).norm());
        if let Some(layer) = contours.get_mut(sample.layer) {
            contour[later].add(layer.distance(&actual));
        }
        if let Some((last, place)) = before
            && last.layer == sample.layer
        {
            if later == 1 {
                speed.add((reference - place).norm() * f64::from(case.rate_hz));
            }
            for (turned, (now, then)) in turned.iter_mut().zip(sample.reference.0.iter().zip(&last.reference.0)) {
                *turned += (now - then).abs();
            }
        }
        before = Some((sample, reference));
    }
    let most = (0..6).max_by(|&a, &b| turned[a].total_cmp(&turned[b])).unwrap_or(0);
    Score {
        lag: lag.map(|sum| sum.error()),
        contour: contour.map(|sum| sum.error()),
        speed: [speed.sum / speed.count, speed.max],
        again: None,
        most,
        learnt: recorded.learnt[1].map(|drives| drives[most]),
        behind: recorded.behind,
    }
}

/// Count, sum, sum of squares and largest.
#[derive(Default)]
struct Sum {
    count: f64,
    sum: f64,
    squares: f64,
    max: f64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
        self.max = self.max.max(value);
    }

    fn error(&self) -> Error {
        Error { max: self.max, rms: (self.squares / self.count).sqrt() }
    }
}

impl From<ServojError> for Failure {
    fn from(error: ServojError) -> Self {
        Self::told(crate::failure::Exit::Failed, error.to_string())
    }
}

#[cfg(test)]
mod tests;
