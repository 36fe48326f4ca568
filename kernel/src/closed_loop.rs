//! The whole loop around a kernel: robot and tracker are made an estimate, what the path asks for is corrected and led, and the
//! drives are learnt from what comes of it.
//!
//! One call stands for one cycle: [`ClosedLoop::tick`] takes the place of [`Kernel::tick`].

mod telemetry;

use crate::arm::Arm;
use crate::base::{Excess, Part};
use crate::control::{Control, ControlError, Report, Seen, Settings};
use crate::drive::{Astray, Drive, DriveError, Identification, Learning};
use crate::estimator::{Estimated, Estimator, Robot, TrackerPose};
use crate::fault::Fault;
use crate::guard::Quantity;
use crate::ik::Family;
use crate::mode::Mode;
use crate::pid::DT_MAX;
use crate::pose::Pose;
use crate::tick::{Command, Corrected, Kernel, Sensors};
use crate::units::{JointAcc, Nanos};
use crate::wait::{Sight, Wait};
use telemetry::Telemetry;

/// Why there is no loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoopError {
    /// Of the controller.
    Control(ControlError),
    /// Of the drives.
    Drive(DriveError),
}

/// What a tick came to, for telemetry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopReport<const N: usize> {
    /// The controller's; all zero where it was not asked.
    pub control: Report,
    /// The estimator's, where there is one.
    pub estimated: Option<Result<Estimated<N>, Excess>>,
    /// Whether the path waits for its correction ([`crate::wait`]).
    pub waits: bool,
}

/// Estimator, controller and drives of an N-joint arm. The estimator remembers `DEPTH` ticks; without a tracker there is none.
#[derive(Clone, Debug)]
pub struct ClosedLoop<const N: usize, const DEPTH: usize> {
    arm: Arm<N>,
    estimator: Option<Estimator<N, DEPTH>>,
    identification: Identification<N>,
    control: Control<N>,
    wait: Wait,
    telemetry: Telemetry,
    period: f64,
    ticked: Option<Nanos>,
    /// Whether the kernel stood in a fault, or was stopping for one, at the last tick.
    faulted: bool,
}

impl<const N: usize, const DEPTH: usize> ClosedLoop<N, DEPTH> {
    /// A loop for ticks of `period` s that assumes these drives.
    ///
    /// # Errors
    /// [`LoopError`]
    pub fn new(
        arm: &Arm<N>,
        estimator: Option<Estimator<N, DEPTH>>,
        settings: &Settings<N>,
        drives: &[Drive; N],
        learning: &Learning,
        period: f64,
    ) -> Result<Self, LoopError> {
        Ok(Self {
            arm: *arm,
            estimator,
            identification: Identification::new(drives, learning, period).map_err(LoopError::Drive)?,
            control: Control::new(settings, Family::of(arm), period).map_err(LoopError::Control)?,
            wait: Wait::default(),
            telemetry: Telemetry::default(),
            period,
            ticked: None,
            faulted: false,
        })
    }

    /// The drives, assumed and learnt.
    pub const fn identification(&self) -> &Identification<N> {
        &self.identification
    }

    /// The estimator, where there is one.
    pub const fn estimator(&self) -> Option<&Estimator<N, DEPTH>> {
        self.estimator.as_ref()
    }

    /// One cycle of the kernel with its loop, begun at `now`.
    pub fn tick<const CAP: usize>(
        &mut self,
        kernel: &mut Kernel<N, CAP>,
        now: Nanos,
        robot: &Robot<N>,
        poses: &[TrackerPose],
    ) -> (Command<N>, LoopReport<N>) {
        let dt = self.elapsed(now);
        self.leave_fault(kernel.mode());
        let Self { arm, estimator, identification, control, wait, .. } = self;
        let estimated = estimator.as_mut().map(|estimator| estimator.tick(arm, now, robot, poses));
        let hold = estimator.as_ref().map_or(0.0, Estimator::hold);
        let (nominal_from_base, base_from_flange, estimate) = match &estimated {
            Some(Ok(Estimated { base, base_from_flange, joints, .. })) => {
                (base.nominal_from_base, *base_from_flange, base_from_flange.map(|_| *joints))
            }
            _ => (Pose::identity(), None, None),
        };
        let mut report = LoopReport { control: Report::default(), estimated, waits: false };
        let mut commanded = JointAcc::ZERO;
        let sensors = Sensors { actual: robot.actual, estimate, correction: None, ready: robot.ready };
        let command = kernel.tick_corrected(now, &sensors, |reference| {
            found(&estimated, identification)?;
            commanded = reference.acceleration;
            let (joints, drives) = (estimate.unwrap_or(robot.actual), identification.drives());
            let seen = Seen { nominal_from_base, base_from_flange, joints, drives, dt };
            let (correction, done) = control.step(arm, reference, &seen)?;
            report.control = done;
            report.waits = match &estimated {
                Some(Ok(estimated)) if reference.deposit && reference.plays => {
                    wait.step(&sight(estimated, hold, &done), control.patience(), reference.period)?
                }
                _ => {
                    *wait = Wait::default();
                    false
                }
            };
            Ok(Corrected { joints: Some(correction), waits: report.waits })
        });
        if let Some(estimator) = estimator {
            estimator.command(&commanded);
        }
        match (command.joints, command.mode) {
            (Some(sent), Mode::Holding | Mode::Moving | Mode::Stopping { .. }) if robot.ready => {
                // What is not finite has been found by the kernel.
                let _ = identification.observe(&sent, &robot.actual, dt);
            }
            _ => identification.pause(),
        }
        if let Some(record) = self.telemetry.of(kernel.ticks(), &report, self.identification.drives()) {
            kernel.say_loop(record);
        }
        (command, report)
    }

    /// [`Kernel::robot_lost`] of a kernel with this loop around it: what is learnt of the drives begins anew with the next tick.
    pub fn robot_lost<const CAP: usize>(&mut self, kernel: &mut Kernel<N, CAP>, fault: Fault) {
        kernel.robot_lost(fault);
        self.leave_fault(kernel.mode());
        self.identification.pause();
    }

    /// A fault that the kernel no longer stands in has been left by a person: the base may be looked at again.
    fn leave_fault(&mut self, mode: &Mode) {
        let faulted = mode.fault().is_some();
        if let (true, Some(estimator)) = (self.faulted && !faulted, &mut self.estimator) {
            estimator.clear();
        }
        self.faulted = faulted;
    }

    /// Since the last tick (s). The robot's telegram is the clock, and its stamp here has a process' jitter: what is not late by
    /// half a period is on time, as [`crate::frame::Status::ticks_late`] has it. A stall counts as it was, up to [`DT_MAX`].
    fn elapsed(&mut self, now: Nanos) -> f64 {
        let elapsed = self.ticked.map_or(self.period, |before| now.since(before) as f64 * 1e-9);
        self.ticked = Some(now);
        if libm::fabs(elapsed - self.period) <= 0.5 * self.period {
            self.period
        } else if elapsed > DT_MAX {
            DT_MAX
        } else {
            elapsed
        }
    }
}

/// What was found before anything is corrected: a base beyond its bounds, a drive beyond its own.
fn found<const N: usize>(
    estimated: &Option<Result<Estimated<N>, Excess>>,
    identification: &Identification<N>,
) -> Result<(), Fault> {
    if let Some(Err(Excess { part, axis, value, limit })) = *estimated {
        let axis = if part == Part::Rotation { axis.saturating_add(3) } else { axis };
        return Err(Fault::Base { axis, value, limit });
    }
    identification
        .astray()
        .map_or(Ok(()), |Astray { joint, lag, limit }| Err(Fault::Drive { joint, value: lag, limit }))
}

/// What decides whether the path waits: the base's correction is behind its estimate, and the tool behind that.
fn sight<const N: usize>(estimated: &Estimated<N>, hold: f64, control: &Report) -> Sight {
    let ([shift, turn], [shift_held, turn_held]) = (estimated.base.behind, control.held);
    Sight { age: estimated.age(), hold, behind: [shift + shift_held, turn + turn_held] }
}

impl From<ControlError> for Fault {
    fn from(error: ControlError) -> Self {
        match error {
            ControlError::Saturated { bound, value, limit } => Self::Saturated { bound, value, limit },
            ControlError::Unreachable(error) => error.into(),
            ControlError::Behind { joint, value, limit } => Self::Lead { joint, value, limit },
            // Of a controller that has been made, only numbers that are none.
            ControlError::Pid(_) | ControlError::Configuration => {
                Self::Correction { quantity: Quantity::Finite, joint: 0, value: 0.0, limit: 0.0 }
            }
        }
    }
}
