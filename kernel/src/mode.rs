//! The kernel's states and the one function that changes them.
//!
//! ```text
//!          robot ready           resume              hold, stop, fault
//!  Unready ────────────> Holding ────────> Moving ─────────────────────> Stopping ──┐
//!   ^   ^                 ^   ^ │            │ played out                ^ │       │ at rest
//!   │   │ robot or link   │   │ └────────────│───────────────────────────┘ │       │ after a
//!   │   │ lost            │   └──────────────┘        fault                │       │ fault
//!   │   └──               └───────────── at rest after hold or stop ───────┘       │
//!   │        re-arm                                                                │
//!   └──────────────────────── Faulted <────────────────────────────────────────────┘
//! ```
//!
//! Every fault passes through Stopping, if only for one tick: there a correction is ramped out as well.
//!
//! Not drawn: a resume leads from Stopping back to Moving while it is for a hold; a stop, and above it a fault, take the place
//! of a lesser cause; a lost link is a fault, and leads at once to Faulted; from Unready it leads nowhere.

use crate::fault::Fault;
use crate::frame::ModeCode;

/// What the kernel is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// Not configured, or the robot's position is not known: puts nothing out.
    Unready,
    /// At rest, with or without a ring to play.
    Holding,
    /// Playing the ring.
    Moving,
    /// The path clock is coming to rest, and after a fault the correction too.
    Stopping {
        /// Why.
        cause: StopCause,
    },
    /// At rest; only re-arming leads on.
    Faulted {
        /// Why.
        fault: Fault,
    },
}

/// Why the path clock comes to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StopCause {
    /// The host asked to hold: the ring stays.
    Hold,
    /// The host asked to stop: the ring is dropped at rest.
    Stop,
    /// A fault: the ring is dropped at rest.
    Fault(Fault),
}

/// What changes the mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// Configured, and the robot reports where it is and takes setpoints.
    Ready,
    /// The robot at rest no longer takes setpoints, or its link is gone (after the fault for it): positions must be learnt anew.
    Lost,
    /// A person's command to play.
    Resume,
    /// A command to hold.
    Hold,
    /// A command to stop.
    Stop,
    /// A fault was found.
    Fault(Fault),
    /// The ring has been played to its end.
    PlayedOut,
    /// The path clock stands.
    AtRest,
    /// A person's command to leave the fault.
    Rearm,
}

impl Mode {
    /// The mode that follows, or `None` when the event does not fit this mode (and nothing changes).
    pub fn next(self, event: Event) -> Option<Self> {
        use StopCause as Cause;
        Some(match (self, event) {
            // Only a person leads out of a fault.
            (Self::Stopping { cause: Cause::Fault(fault) } | Self::Faulted { fault }, Event::Lost) => {
                Self::Faulted { fault }
            }
            (_, Event::Lost) => Self::Unready,
            (Self::Unready, Event::Ready) => Self::Holding,
            (Self::Holding, Event::Resume) => Self::Moving,
            (Self::Holding, Event::Hold | Event::Stop) => self,
            (Self::Holding, Event::Fault(fault)) => Self::Stopping { cause: Cause::Fault(fault) },
            (Self::Moving, Event::Hold) => Self::Stopping { cause: Cause::Hold },
            (Self::Moving, Event::Stop) => Self::Stopping { cause: Cause::Stop },
            (Self::Moving, Event::Fault(fault)) => Self::Stopping { cause: Cause::Fault(fault) },
            (Self::Moving, Event::PlayedOut) => Self::Holding,
            (Self::Stopping { cause: Cause::Hold }, Event::Resume) => Self::Moving,
            (Self::Stopping { cause: Cause::Hold }, Event::Hold) => self,
            (Self::Stopping { cause: Cause::Hold }, Event::Stop) => Self::Stopping { cause: Cause::Stop },
            (Self::Stopping { cause: Cause::Stop }, Event::Hold | Event::Stop) => self,
            (Self::Stopping { cause: Cause::Hold | Cause::Stop }, Event::Fault(fault)) => {
                Self::Stopping { cause: Cause::Fault(fault) }
            }
            (Self::Stopping { cause: Cause::Fault(_) }, Event::Hold | Event::Stop) => self,
            (Self::Stopping { cause: Cause::Hold | Cause::Stop }, Event::AtRest | Event::PlayedOut) => Self::Holding,
            (Self::Stopping { cause: Cause::Fault(fault) }, Event::AtRest | Event::PlayedOut) => {
                Self::Faulted { fault }
            }
            (Self::Faulted { .. }, Event::Hold | Event::Stop) => self,
            // Where the robot is must be learnt anew: someone may have moved it.
            (Self::Faulted { .. }, Event::Rearm) => Self::Unready,
            _ => return None,
        })
    }

    /// The mode without its data.
    pub const fn code(&self) -> ModeCode {
        match self {
            Self::Unready => ModeCode::Unready,
            Self::Holding => ModeCode::Holding,
            Self::Moving => ModeCode::Moving,
            Self::Stopping { .. } => ModeCode::Stopping,
            Self::Faulted { .. } => ModeCode::Faulted,
        }
    }

    /// The fault this mode stands in or is stopping for.
    pub const fn fault(&self) -> Option<Fault> {
        match self {
            Self::Faulted { fault } | Self::Stopping { cause: StopCause::Fault(fault) } => Some(*fault),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_person_sets_in_motion_and_leads_out_of_a_fault_and_a_fault_always_stops() {
        let fault = Fault::Extruder;
        let other = Fault::RobotNotReady;
        let causes = [StopCause::Hold, StopCause::Stop, StopCause::Fault(fault)];
        let stopping = causes.map(|cause| Mode::Stopping { cause });
        let modes = [Mode::Unready, Mode::Holding, Mode::Moving, Mode::Faulted { fault }].into_iter().chain(stopping);
        let events = [
            Event::Ready,
            Event::Lost,
            Event::Resume,
            Event::Hold,
            Event::Stop,
            Event::Fault(other),
            Event::PlayedOut,
            Event::AtRest,
            Event::Rearm,
        ];
        for mode in modes {
            for event in events {
                let next = mode.next(event);
                if next == Some(Mode::Moving) {
                    assert_eq!(event, Event::Resume, "{mode:?}");
                }
                // The first fault is kept until a person answers it.
                if mode.fault().is_some() {
                    assert!(
                        next.is_none_or(|next| next.fault() == Some(fault) || event == Event::Rearm),
                        "{mode:?} {event:?}"
                    );
                } else if mode != Mode::Unready && event == Event::Fault(other) {
                    assert_eq!(next, Some(Mode::Stopping { cause: StopCause::Fault(other) }));
                }
                if event == Event::Lost {
                    assert!(matches!(next, Some(Mode::Unready | Mode::Faulted { .. })));
                }
                if event == Event::AtRest && next.is_some() {
                    assert!(matches!(mode, Mode::Stopping { .. }));
                }
            }
        }
        assert_eq!(Mode::Faulted { fault }.next(Event::Rearm), Some(Mode::Unready));
        assert_eq!(stopping[2].next(Event::Rearm), None, "not before it is at rest");
    }
}
