//! What can be done to a world: stalls of the process, a line that is cut, telegrams and answers that are lost or late.

use super::World;
use crate::sim::ur::Controller;

/// Where a stall of the real-time process begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stalled {
    /// Before it reads what the robot sent.
    BeforeReading,
    /// Between its tick and the answer.
    BeforeAnswering,
}

/// A stall under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stall {
    pub(super) stalled: Stalled,
    /// Telegrams of the robot that still go by.
    pub(super) left: u32,
    /// Whether the process does nothing already.
    pub(super) begun: bool,
}

/// How the line to the robot is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// Both ends hear at once that the connection is gone.
    Reset,
    /// Nothing passes any more, either way; the robot does not notice, and keeps the connection.
    Silence,
    /// The first half of the robot's next package passes, then nothing, as with [`Self::Silence`].
    HalfPackage,
    /// The controller goes: its power, its program, its connections. It is back when [`World::restart_controller`] is called.
    ControllerGone,
}

impl World {
    /// The real-time process does nothing while so many telegrams of the robot go by, 1 at least.
    pub const fn stall(&mut self, stalled: Stalled, telegrams: u32) {
        let begun = matches!(stalled, Stalled::BeforeReading);
        self.stall = Some(Stall { stalled, left: telegrams, begun });
    }

    /// Cuts the line to the robot.
    pub fn cut(&mut self, cut: Cut) {
        (self.cut, self.half) = (Some(cut), cut == Cut::HalfPackage);
        match cut {
            Cut::Reset => self.controller.disconnect(self.client),
            Cut::ControllerGone => {
                self.controller.disconnect(self.client);
                self.controller.stop();
                self.controller.power_off();
            }
            Cut::Silence | Cut::HalfPackage => {}
        }
    }

    /// So many of the robot's cycles go by without a telegram.
    pub const fn skip(&mut self, telegrams: u32) {
        self.skip = telegrams;
    }

    /// The next answer leaves in time and arrives a cycle late.
    pub const fn delay_answer(&mut self) {
        self.delays = true;
    }

    /// A fresh connection to the robot, as the process makes it after a failure; the old one may still stand at the robot's end.
    pub fn reconnect(&mut self) {
        self.cut = None;
        self.clients.push(self.client);
        self.client = self.controller.connect();
        self.waiting.clear();
        self.counted(|world| world.core.reconnect());
    }

    /// The robot notices at last that the connections before this one are gone.
    pub fn drop_old_connections(&mut self) {
        for client in self.clients.drain(..) {
            self.controller.disconnect(client);
        }
    }

    /// The controller that went is back: another one, whose arm stands where it was left.
    pub fn restart_controller(&mut self, controller: Controller) {
        self.controller = controller;
    }

    /// The robot, for what a person does at its teach pendant.
    pub const fn pendant(&mut self) -> &mut Controller {
        &mut self.controller
    }

    /// Whether a stall is under way, or about to begin.
    pub const fn is_stalled(&self) -> bool {
        self.stall.is_some()
    }
}
