//! The whole loop around a kernel: what the robot does is learnt from, what the path asks for is led and corrected.
//!
//! One call stands for one cycle: [`ClosedLoop::tick`] takes the place of [`Kernel::tick`].

use crate::arm::Arm;
use crate::control::{Control, ControlError, Report, Seen, Settings};
use crate::drive::{Drive, DriveError, Identification, Learning};
use crate::fault::Fault;
use crate::guard::Quantity;
use crate::ik::Family;
use crate::mode::Mode;
use crate::pose::Pose;
use crate::tick::{Command, Kernel, Sensors};
use crate::units::Nanos;

/// What a tracker and the filter behind it say of the arm at a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracked {
    /// Where the base is, in the frame of where it should be.
    pub nominal_from_base: Pose,
    /// Where the flange is in the base as it is; `None` while that is not to be trusted.
    pub base_from_flange: Option<Pose>,
}

impl Tracked {
    /// No tracker.
    pub fn none() -> Self {
        Self { nominal_from_base: Pose::identity(), base_from_flange: None }
    }
}

/// Why there is no loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoopError {
    /// Of the controller.
    Control(ControlError),
    /// Of the drives.
    Drive(DriveError),
}

/// Controller and drives of an N-joint arm.
#[derive(Clone, Debug)]
pub struct ClosedLoop<const N: usize> {
    arm: Arm<N>,
    identification: Identification<N>,
    control: Control<N>,
    ticked: Option<Nanos>,
    period: f64,
}

impl<const N: usize> ClosedLoop<N> {
    /// A loop for ticks of `period` s that assumes these drives.
    ///
    /// # Errors
    /// [`LoopError`]
    pub fn new(
        arm: &Arm<N>,
        settings: &Settings<N>,
        drives: &[Drive; N],
        learning: &Learning,
        period: f64,
    ) -> Result<Self, LoopError> {
        Ok(Self {
            arm: *arm,
            identification: Identification::new(drives, learning, period).map_err(LoopError::Drive)?,
            control: Control::new(settings, Family::of(arm), period).map_err(LoopError::Control)?,
            ticked: None,
            period,
        })
    }

    /// The drives, assumed and learnt.
    pub const fn identification(&self) -> &Identification<N> {
        &self.identification
    }

    /// One cycle of the kernel with its loop. [`Sensors::correction`] says nothing here.
    pub fn tick<const CAP: usize>(
        &mut self,
        kernel: &mut Kernel<N, CAP>,
        now: Nanos,
        sensors: &Sensors<N>,
        tracked: &Tracked,
    ) -> (Command<N>, Report) {
        let dt = self.ticked.map_or(self.period, |before| now.since(before) as f64 * 1e-9);
        self.ticked = Some(now);
        let Self { arm, identification, control, .. } = self;
        let Tracked { nominal_from_base, base_from_flange } = *tracked;
        let mut report = Report::default();
        let command = kernel.tick_corrected(now, sensors, |reference| {
            let seen = Seen { nominal_from_base, base_from_flange, drives: identification.drives(), dt };
            let (correction, done) = control.step(arm, reference, &seen).map_err(fault)?;
            report = done;
            Ok(Some(correction))
        });
        match (command.joints, command.mode) {
            (Some(sent), Mode::Holding | Mode::Moving | Mode::Stopping { .. }) if sensors.ready => {
                // What is not finite has been found by the kernel.
                let _ = identification.observe(&sent, &sensors.actual, dt);
            }
            _ => identification.pause(),
        }
        (command, report)
    }
}

fn fault(error: ControlError) -> Fault {
    let (value, limit) = match error {
        ControlError::Saturated { value, limit, .. } => (value, limit),
        _ => (0.0, 0.0),
    };
    Fault::Correction { quantity: Quantity::Workspace, joint: 0, value, limit }
}
