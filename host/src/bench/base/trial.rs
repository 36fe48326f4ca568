//! One run: a plant is led along a circle by a kernel and its loop.

use super::cell::{self, CellError, Loop};
use super::commission::Commissioned;
use crate::sim::plant::{Kind, Params, Plant};
use nalgebra::Vector3;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, BatchPart, FromKernel, ModeCode, Reader, Refusal, ToKernel};
use screed_kernel::ik::{Family, IkError};
use screed_kernel::pose::Pose;
use screed_kernel::setpoint::{Coder, Setpoint, joint_on_grid};
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::JointPos;

/// Radius of the circle (m).
pub const RADIUS: f64 = 0.15;

/// Ticks at rest before, in which base and filter are found.
const WARM_UP: usize = 1000;

/// Setpoints that the kernel's ring holds: a run of 8 s.
const RING: usize = 4096;

/// What the loop has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Correction {
    /// Nothing: the setpoints go to the drives as they are.
    Off,
    /// The lead, and nothing of the tracker.
    Lead,
    /// All of it, by what the plant's commissioning found.
    On(Commissioned),
}

/// Why there is no run.
#[derive(Clone, Debug, PartialEq)]
pub enum TrialError {
    /// The loop.
    Cell(CellError),
    /// The circle cannot be reached.
    Path(IkError),
    /// The kernel takes no setpoints.
    Kernel,
    /// It refused one.
    Refused(Refusal),
}

/// What is wrong with the tool at one tick (m).
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Since the path began (s).
    pub time: f64,
    /// From where it should be now, the dead time taken out.
    pub absolute: f64,
    /// From where it should be at the same instant.
    pub timed: f64,
    /// From the circle.
    pub contour: f64,
    /// Whether the tracker was believed.
    pub trusted: bool,
}

/// A run as it was.
#[derive(Debug)]
pub struct Run {
    /// Tick by tick, from the first setpoint to the last.
    pub samples: Vec<Sample>,
    /// What was sent.
    pub sent: Vec<JointPos<6>>,
    /// The fault that ended it.
    pub fault: Option<Fault>,
}

/// The circle through where the tool is at the start, in the plane square to the nominal base's z.
struct Circle {
    centre: Vector3<f64>,
    start: Vector3<f64>,
    base_from_tcp: Pose,
}

impl Circle {
    fn of(params: &Params) -> Self {
        let base_from_tcp = params.arm.forward(&params.start) * params.flange_from_tcp;
        let place = base_from_tcp.translation;
        let inwards = -Vector3::new(place.x, place.y, 0.0).normalize();
        let centre = place + RADIUS * inwards;
        Self { centre, start: place - centre, base_from_tcp }
    }

    fn at(&self, way: f64) -> Pose {
        let (sin, cos) = libm::sincos(way / RADIUS);
        let (x, y) = (self.start.x, self.start.y);
        let out = Vector3::new(cos * x - sin * y, sin * x + cos * y, 0.0);
        Pose { translation: self.centre + out, ..self.base_from_tcp }
    }

    fn distance(&self, point: &Vector3<f64>) -> f64 {
        let from = point - self.centre;
        libm::hypot(libm::hypot(from.x, from.y) - RADIUS, from.z)
    }
}

/// Way along the path (m) at t s, for `seconds` at `speed` between two ramps of a second.
fn way(speed: f64, seconds: f64, t: f64) -> f64 {
    // The ramp's speed is 10u³ − 15u⁴ + 6u⁵: jerk begins at zero.
    let ramp = |u: f64| {
        let u = u.clamp(0.0, 1.0);
        u * u * u * u * (2.5 - 3.0 * u + u * u)
    };
    let cruise = (t - 1.0).clamp(0.0, seconds);
    let brake = (t - 1.0 - seconds).clamp(0.0, 1.0);
    speed * (ramp(t) + cruise + brake - ramp(brake))
}

/// The path's setpoints. The kernel begins where the encoders say, noise and all; that is blended out in the first second.
fn setpoints(
    params: &Params,
    circle: &Circle,
    (speed, seconds): (f64, f64),
    from: &JointPos<6>,
) -> Result<Vec<Setpoint<6>>, TrialError> {
    let (arm, tcp_from_flange) = (params.arm, params.flange_from_tcp.inverse());
    let family = Family::of(arm);
    let period = params.period_ns as f64 * 1e-9;
    let count = ((seconds + 2.0) / period).ceil() as usize + 3;
    let mut joints = params.start;
    (1..=count)
        .map(|k| {
            let pose = circle.at(way(speed, seconds, k as f64 * period)) * tcp_from_flange;
            joints = family.nearest(arm, &pose, &joints).map_err(TrialError::Path)?.joints;
            let u = (k as f64 * period).min(1.0);
            let left = 1.0 - u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
            let at = |j: usize| joint_on_grid(joints.0[j] + left * (from.0[j] - params.start.0[j]));
            Ok(Setpoint { joints: JointPos(std::array::from_fn(at)), flow: 0.0, deposit: true })
        })
        .collect()
}

/// The batch as frames.
fn frames(setpoints: &[Setpoint<6>]) -> Result<Vec<Vec<u8>>, TrialError> {
    let mut coder = Coder::new();
    let parts = setpoints.chunks(20);
    let last = parts.len() - 1;
    let mut first_seq = 1;
    let frames = parts.enumerate().map(|(k, part)| {
        let (mut code, mut used) = ([0; frame::CODE_MAX], 0);
        for setpoint in part {
            used += coder.encode(setpoint, &mut code[used..]).map_err(|_| TrialError::Kernel)?;
        }
        let message =
            BatchPart { batch: 1, first_seq, opens: k == 0, commits: k == last, after: None, code: &code[..used] };
        first_seq += part.len() as u32;
        encoded(&ToKernel::Batch(message))
    });
    frames.collect()
}

fn encoded(message: &ToKernel<'_>) -> Result<Vec<u8>, TrialError> {
    let mut out = [0; frame::WIRE_MAX];
    let used = frame::encode(message, &mut out).map_err(|_| TrialError::Kernel)?;
    Ok(out[..used].to_vec())
}

/// A run, `timing` being its speed (m/s) and for how long that lasts (s); `disturb` may move the plant's base at any tick of the path.
///
/// # Errors
/// [`TrialError`]; a fault is none here, [`Run::fault`] has it.
pub fn run(
    kind: Kind,
    params: &Params,
    seed: u64,
    timing: (f64, f64),
    correction: Correction,
    mut disturb: impl FnMut(usize, &mut Plant),
) -> Result<Run, TrialError> {
    let circle = Circle::of(params);
    let mut kernel = Box::new(Kernel::<6, RING>::new(params.arm));
    kernel.receive(&encoded(&ToKernel::Configure(cell::configure(params)))?);
    let closed = match correction {
        Correction::Off => None,
        Correction::Lead => Some(cell::closed_loop(kind, params, None).map_err(TrialError::Cell)?),
        Correction::On(found) => Some(cell::closed_loop(kind, params, Some(&found)).map_err(TrialError::Cell)?),
    };
    let mut world = World { plant: Plant::new(params, seed), kernel, closed, measured: None, trusted: false };
    // At the first tick the kernel learns where the robot is.
    let from = world.tick()?.joints.ok_or(TrialError::Kernel)?;
    let setpoints = setpoints(params, &circle, timing, &from)?;
    for frame in frames(&setpoints)? {
        world.kernel.receive(&frame);
        world.tick()?;
    }
    for _ in 0..WARM_UP {
        world.tick()?;
    }
    let epoch = world.kernel.status().epoch;
    world.kernel.receive(&encoded(&ToKernel::Resume { epoch })?);
    let mut run = Run { samples: Vec::new(), sent: Vec::new(), fault: None };
    let mut references = Vec::new();
    let nominal_from_tracker = params.tracker_from_nominal.inverse();
    let dead_ticks = params.dead_time_ns as f64 / params.period_ns as f64;
    for tick in 0..setpoints.len() + 500 {
        disturb(tick, &mut world.plant);
        let command = world.tick()?;
        run.sent.extend(command.joints);
        run.fault = run.fault.or(command.mode.fault());
        let reference = command.joints.ok_or(TrialError::Kernel)?;
        let path = JointPos(std::array::from_fn(|j| reference.0[j] - command.correction.0[j]));
        references.push((params.arm.forward(&path) * params.flange_from_tcp).translation);
        let tool = (nominal_from_tracker * world.plant.truth().tracker_from_tcp).translation;
        // The truth is that of a tick later than the command.
        let from = |ticks: f64| {
            let at = (tick as f64 + 1.0 - ticks).clamp(0.0, tick as f64);
            let (whole, part) = (at as usize, at.fract());
            let next = references[(whole + 1).min(tick)];
            (tool - references[whole].lerp(&next, part)).norm()
        };
        run.samples.push(Sample {
            time: tick as f64 * params.period_ns as f64 * 1e-9,
            absolute: from(dead_ticks),
            timed: from(0.0),
            contour: circle.distance(&tool),
            trusted: world.trusted,
        });
        if matches!(world.kernel.status().mode, ModeCode::Holding | ModeCode::Faulted) && tick > 500 {
            return Ok(run);
        }
    }
    Ok(run)
}

struct World {
    plant: Plant,
    kernel: Box<Kernel<6, RING>>,
    closed: Option<Loop>,
    measured: Option<crate::sim::plant::Measured>,
    trusted: bool,
}

impl World {
    fn tick(&mut self) -> Result<Command<6>, TrialError> {
        let start = self.plant.params().start;
        let measured = match self.measured.take() {
            Some(measured) => measured,
            None => self.plant.step(&start),
        };
        let robot =
            screed_kernel::estimator::Robot { actual: measured.joints, rates: Some(measured.rates), ready: true };
        let poses: Vec<_> = measured.poses.iter().map(cell::pose).collect();
        let command = match &mut self.closed {
            Some(closed) => {
                let (command, report) = closed.tick(&mut self.kernel, measured.now, &robot, &poses);
                self.trusted = report
                    .estimated
                    .is_some_and(|estimated| estimated.is_ok_and(|estimated| estimated.base_from_flange.is_some()));
                command
            }
            None => self.kernel.tick(measured.now, &Sensors::robot(measured.joints, true)),
        };
        self.listen()?;
        self.measured = Some(self.plant.step(&command.joints.unwrap_or(start)));
        Ok(command)
    }

    /// A refusal is a defect of this experiment.
    fn listen(&mut self) -> Result<(), TrialError> {
        let mut out = [0; screed_kernel::tick::TRANSMIT_MAX];
        let used = self.kernel.poll_transmit(&mut out);
        let mut reader = Reader::new();
        for &byte in &out[..used] {
            if let Some(Ok(bytes)) = reader.push(byte)
                && let Ok(FromKernel::Refused { reason, .. }) = frame::decode(bytes)
            {
                return Err(TrialError::Refused(reason));
            }
        }
        Ok(())
    }
}
