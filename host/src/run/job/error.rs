//! Why a print cannot go on.

use crate::plan::PlanError;
use crate::run::resend::LineFigures;
use crate::run::words;
use screed_kernel::frame::{FaultReport, FrameError, Refusal};
use screed_kernel::setpoint::CodeError;

/// Why a print cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// The plan broke off.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The kernel refused a message.
    #[error("the kernel refused {what}: {}", words::refusal(reason))]
    Refused {
        /// What was sent.
        what: String,
        /// Why it was not taken.
        reason: Refusal,
    },
    /// A frame from the real-time process was broken.
    #[error("the real-time process sent a broken frame ({0:?}); is it from the same build of Screed?")]
    Frame(FrameError),
    /// A setpoint cannot be put into a frame.
    #[error("setpoint {seq} cannot be put into a frame ({error:?})")]
    Code {
        /// Sequence number.
        seq: u32,
        /// Why.
        error: CodeError,
    },
    /// The kernel stopped on its own.
    #[error("{}", words::fault(&.0.fault))]
    Fault(FaultReport),
    /// The link to the robot failed.
    #[error("{0}")]
    Link(String),
    /// The line to the kernel spoils too much, or nobody obeys at its other end.
    #[error("the kernel did not answer what was said {tries} times over the serial line ({} frames came spoilt to it, {} from it)",
        figures.spoilt_to_kernel, figures.spoilt_from_kernel)]
    Unanswered {
        /// How often it was said.
        tries: u32,
        /// What else happened on the line.
        figures: LineFigures,
    },
    /// The kernel at the end of a line has lost what it was told.
    #[error("the kernel began anew: its board was reset")]
    Reset,
    /// The host did not keep up: the ring was played to its end, where the arm rests on its path.
    #[error("the ring ran dry at setpoint {consumed}: the planner or this machine was too slow")]
    Underrun {
        /// Setpoint at which the arm rests.
        consumed: u32,
    },
}
