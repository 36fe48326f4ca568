//! The link to the robot fails and comes back. Whoever owns the socket makes a fresh connection; here it is said what happened, the
//! kernel is kept from moving anything, and everything is agreed anew.

use super::{Core, Depth, ToHost, shorten};
use crate::link::{LinkError, Trouble};
use screed_kernel::fault::Fault;
use screed_kernel::frame::NOTE_MAX;
use screed_kernel::mode::Mode;
use screed_kernel::units::Nanos;
use std::fmt::Display;

/// How often the host is heard and told while there is no robot whose telegrams pace it (ns).
const BEAT_NS: u64 = 20_000_000;

/// How often a host that waits for the robot is told why there is none (ns).
const REMINDER_NS: u64 = 3_000_000_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    /// Agreeing with the robot what is exchanged.
    #[default]
    Negotiating,
    /// The robot's states come.
    Up,
    /// Failed: what comes on the connection is not heard.
    Down,
}

/// How the link stands.
#[derive(Clone, Debug, Default)]
pub(super) struct Link {
    state: State,
    /// Whether states have ever come: before, a failure ends the process.
    has_run: bool,
    /// Since when they do not.
    since: Nanos,
    beat: Nanos,
    /// Since when nobody who waits for the robot has been told.
    reminded: Nanos,
    /// Why not, as the host was told last.
    why: heapless::String<NOTE_MAX>,
}

impl Link {
    pub(super) fn is_down(&self) -> bool {
        self.state == State::Down
    }

    /// Whether the process goes on without a robot.
    fn is_out(&self) -> bool {
        self.has_run && self.state != State::Up
    }

    /// When the host is to be heard next, without a robot.
    pub(super) fn next_beat(&self) -> Option<Nanos> {
        self.is_out().then_some(self.beat)
    }

    /// Tells the host of a try that failed, if it is for another reason than the one before.
    fn tell(&mut self, host: &mut ToHost, text: &dyn Display) {
        let why = shorten(text);
        if why != self.why {
            host.alarm(false, &why);
            self.why = why;
        }
    }
}

impl Core {
    /// Whether a link that failed is to be made anew: a fresh connection, then [`Self::reconnect`]. Else it never ran, and the
    /// process cannot begin.
    pub fn may_reconnect(&self) -> bool {
        self.link.has_run
    }

    /// Whether the link has failed, and no fresh connection stands.
    pub fn is_disconnected(&self) -> bool {
        self.link.is_down()
    }

    /// A fresh connection to the robot stands: everything is agreed anew on it. Whatever comes of it, nothing moves until a person
    /// has re-armed and resumed.
    pub fn reconnect(&mut self) {
        self.robot.restart();
        self.link.state = State::Negotiating;
    }

    /// A fresh connection could not be made: the host is told, if that is news.
    pub fn reconnect_failed(&mut self, why: &dyn Display) {
        self.link
            .tell(&mut self.host, &format_args!("the robot cannot be reached, it is tried again every second: {why}"));
    }

    /// A fresh connection stood, and no link came of it: the host is told what that means, if that is news. Whatever it is, it is
    /// tried again, as a person may be at it; and nothing moves.
    fn reconnect_refused(&mut self, trouble: Trouble, why: &dyn Display) {
        let (before, after) = match trouble {
            Trouble::Gone => return self.reconnect_failed(why),
            Trouble::Held => {
                ("", "; or the robot still holds the connection that failed: it is tried again every second")
            }
            Trouble::Changed => (
                "not the robot that was there, or not as it was: another controller, other software or another installation; nothing \
                 moves, and it is tried again every second: ",
                "",
            ),
            Trouble::Senseless => (
                "what answers where the robot was refuses, or makes no sense; nothing moves, and it is tried again every second: ",
                "",
            ),
        };
        self.link.tell(&mut self.host, &format_args!("{before}{why}{after}"));
    }

    /// The robot can be told nothing more.
    pub(super) fn lose_robot(&mut self, fault: Fault) {
        match &mut self.lead {
            Some(lead) => lead.robot_lost(&mut self.kernel, fault),
            None => self.kernel.robot_lost(fault),
        }
    }

    /// The link failed, if it did.
    pub(super) fn check(&mut self, now: Nanos, result: Result<(), LinkError>) -> Result<(), LinkError> {
        let Err(error) = result else { return result };
        let text = shorten(self.robot.explain(&error));
        let was_up = self.link.state == State::Up;
        self.link.state = State::Down;
        // What was known of the robot is not any more.
        (self.heard, self.fresh, self.missed, self.command, self.record) = (None, false, 0, None, None);
        (self.depth, self.link.beat) = (Depth::default(), now);
        self.readiness.begin();
        self.stop_extruder();
        if was_up {
            (self.link.since, self.link.reminded) = (now, now);
            self.link.why = text.clone();
            self.host.alarm(false, &text);
        } else if !self.link.has_run {
            self.host.alarm(true, &text);
        } else {
            self.reconnect_refused(error.trouble(), &text);
        }
        self.lose_robot(Fault::Link);
        self.hear_kernel();
        result
    }

    /// The robot's states begin to come.
    pub(super) fn link_is_up(&mut self, now: Nanos) {
        let back = self.link.is_out();
        (self.link.state, self.link.has_run) = (State::Up, true);
        self.link.why.clear();
        // To a host that waits for the robot its return shows by itself.
        if back && matches!(self.kernel.mode(), Mode::Faulted { .. }) {
            let seconds = now.since(self.link.since) as f64 * 1e-9;
            let text = "nothing moves until a person has re-armed and resumed";
            self.host.alarm(false, &format_args!("the link to the robot is back after {seconds:.1} s: {text}"));
        }
    }

    /// Takes the place of the cycles while there is no robot: the host is heard and told, and nothing is put out.
    pub(super) fn stand_in(&mut self, now: Nanos) {
        if self.link.is_out() && now >= self.link.beat {
            self.link.beat = now.plus(BEAT_NS);
            self.lose_robot(Fault::Link);
            self.hear_kernel();
            // In a fault it is a person who is waited for.
            if !matches!(self.kernel.mode(), Mode::Unready) {
                self.link.reminded = now;
            } else if now.since(self.link.reminded) >= REMINDER_NS {
                self.link.reminded = now;
                self.tell_outage();
            }
        }
    }

    /// Tells a host that has just come, or waits, that there is no robot, and why.
    pub(super) fn tell_outage(&mut self) {
        if self.link.is_out() {
            self.host.alarm(false, &format_args!("the link to the robot is down: {}", self.link.why));
        }
    }
}
