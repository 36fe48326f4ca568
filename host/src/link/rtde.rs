//! RTDE, Universal Robots' real-time data exchange: the client's side as a state machine. Time and bytes are arguments; its
//! memory is allocated when it is made and never after, so it can live in the real-time process.
//!
//! The robot paces: it sends one data package per period, the answer is a setpoint in its input registers, where a small
//! program on the controller ([`program`]) reads it. Negotiation goes one request at a time, because servers exist that
//! parse one package per read: protocol version (2, or 1 where that is refused), controller version, outputs, inputs, start.
//!
//! RTDE has no checksum. Sizes, types, recipes and values are checked as far as a wrong one can be recognised; a wrong value
//! that is possible passes. After any error the client stays failed: a stream that lost its package borders is never read on.

mod connection;
pub mod error;
pub mod fields;
pub mod file;
mod limits;
pub mod look;
mod plausible;
pub mod program;
pub mod reader;
pub mod ready;
pub mod recipe;
#[cfg(test)]
mod tests;
pub mod wire;

pub use error::LinkError;
pub use recipe::RobotState;
pub use wire::{TextLevel, TextMessage};

use crate::config::Cell;
use crate::link::cycles::CycleCount;
use connection::{Connection, Session};
use error::Explained;
use file::RecipeFile;
use limits::StepLimit;
use plausible::Plausibility;
use ready::Fed;
use recipe::{Field, INPUT_PACKAGE_SIZE, Recipes, Value};
use screed_kernel::arm::Arm;
use screed_kernel::units::{JointPos, Nanos};
use std::fmt;

/// What the client is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Asking for protocol 2, then for 1.
    Version,
    /// Asking for the controller's software version.
    ControllerVersion,
    /// Agreeing on outputs.
    Outputs,
    /// Agreeing on inputs.
    Inputs,
    /// Asking for data.
    Starting,
    /// Finding the rate of a controller that cannot be asked for one.
    Measuring,
    /// Exchanging data.
    Running,
    /// Asking for no more data.
    Pausing,
    /// Done.
    Paused,
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Version => "agreeing on the protocol",
            Self::ControllerVersion => "asking for the controller's version",
            Self::Outputs => "agreeing on outputs",
            Self::Inputs => "agreeing on inputs",
            Self::Starting => "starting",
            Self::Measuring => "measuring the controller's rate",
            Self::Running => "running",
            Self::Pausing => "pausing",
            Self::Paused => "paused",
        })
    }
}

/// The controller's software version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ControllerVersion {
    /// 5 is e-Series, 3 is CB3.
    pub major: u32,
    /// Minor version.
    pub minor: u32,
    /// Bugfix version.
    pub bugfix: u32,
    /// Build number.
    pub build: u32,
}

impl fmt::Display for ControllerVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { major, minor, bugfix, build } = self;
        write!(f, "{major}.{minor}.{bugfix}.{build}")
    }
}

/// What the client has to tell.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "moved once per event, and the real-time process must not allocate")]
pub enum Event {
    /// Negotiation is over: states follow, setpoints may be sent.
    Running {
        /// Whom we talk to.
        controller: ControllerVersion,
    },
    /// The robot's newest state.
    State {
        /// As received and checked.
        state: RobotState,
        /// Older states that came since the last poll and were overtaken by this one.
        skipped: u32,
    },
    /// The controller has something to say.
    Text {
        /// What it says.
        text: TextMessage,
        /// Messages lost before this one, because nobody polled.
        lost: u32,
    },
}

/// The client.
#[derive(Clone, Debug)]
pub struct RtdeClient {
    connection: Connection,
    arm: Arm<6>,
    robot: Robot,
}

/// What the robot has said on this connection.
#[derive(Clone, Debug)]
struct Robot {
    plausibility: Plausibility,
    step_limit: StepLimit,
    cycles: CycleCount,
    fed: Fed,
    pace: Pace,
    announced: bool,
    state: Option<RobotState>,
    skipped: u32,
    /// The newest values of the outputs that a recipe file names.
    extra: Box<[u8]>,
}

impl RtdeClient {
    /// As a cell has it.
    ///
    /// # Errors
    /// As [`Self::beside`].
    pub fn of(cell: &Cell) -> Result<Self, LinkError> {
        let (link, arm) = (&cell.link, &cell.robot.arm);
        let timeout_ns = (link.timeout * 1e9) as u64;
        let mut client = Self::beside(link.recipes.as_ref(), arm, link.rate_hz, link.register_offset, timeout_ns)?;
        if arm.velocity_max.known().is_none() {
            client.robot.step_limit.set_speeds(cell.robot.joint_velocity_max);
        }
        Ok(client)
    }

    /// A client for a fresh connection: its first request waits in [`Self::poll_transmit`]. `arm` gives the limits of what a
    /// received value can be; `rate_hz` is 125 or 500; `register_offset` is 0 or 24; a state has to come within `timeout_ns`, an
    /// answer of the negotiation within that or a second.
    ///
    /// # Errors
    /// [`LinkError::BadRate`], [`LinkError::BadOffset`].
    pub fn new(arm: &Arm<6>, rate_hz: u32, register_offset: u8, timeout_ns: u64) -> Result<Self, LinkError> {
        Self::beside(None, arm, rate_hz, register_offset, timeout_ns)
    }

    /// The same, and the outputs that a recipe file names are asked for beside Screed's own: [`Self::extra`].
    ///
    /// # Errors
    /// [`LinkError::BadRate`], [`LinkError::BadOffset`], [`LinkError::RecipeTooLong`].
    pub fn beside(
        file: Option<&RecipeFile>,
        arm: &Arm<6>,
        rate_hz: u32,
        register_offset: u8,
        timeout_ns: u64,
    ) -> Result<Self, LinkError> {
        if !matches!(rate_hz, 125 | 500) {
            return Err(LinkError::BadRate { rate_hz });
        }
        if !matches!(register_offset, 0 | 24) {
            return Err(LinkError::BadOffset { offset: register_offset });
        }
        let recipes = Recipes::screed(register_offset, file)?;
        let extra: usize = recipes.extra().iter().map(|field| field.kind.size()).sum();
        let connection = Connection::new(recipes, rate_hz, timeout_ns);
        let robot = Robot {
            plausibility: Plausibility::new(arm),
            step_limit: StepLimit::new(arm.velocity_max.known(), rate_hz),
            cycles: CycleCount::new(rate_hz),
            fed: Fed::new(rate_hz),
            pace: Pace::default(),
            announced: false,
            state: None,
            skipped: 0,
            extra: vec![0; extra].into_boxed_slice(),
        };
        Ok(Self { connection, arm: *arm, robot })
    }

    /// For a fresh connection: everything is agreed anew, and nothing is known of the robot. Only the account of its cycles goes on.
    pub fn restart(&mut self) {
        self.connection.restart();
        let robot = &mut self.robot;
        robot.plausibility = Plausibility::new(&self.arm);
        robot.step_limit.restart();
        robot.cycles.restart();
        robot.fed = Fed::new(self.connection.rate_hz());
        (robot.pace, robot.announced) = (Pace::default(), false);
        (robot.state, robot.skipped) = (None, 0);
        robot.extra.fill(0);
    }

    /// Takes bytes from the robot, split anywhere.
    ///
    /// # Errors
    /// Every [`LinkError`] of a received package; the same one again from then on.
    pub fn handle_bytes(&mut self, now: Nanos, bytes: &[u8]) -> Result<(), LinkError> {
        let Self { connection, robot, .. } = self;
        connection.handle_bytes(now, bytes, |session, values| robot.take(session, values))
    }

    /// The connection was closed by the robot; gives the error to report.
    pub fn handle_closed(&mut self) -> LinkError {
        self.connection.handle_closed()
    }

    /// The next thing to tell: that it runs, then texts, then the newest state.
    pub fn poll_event(&mut self) -> Option<Event> {
        let agreed = *self.connection.agreed();
        if let (Phase::Running, false, Some(controller)) = (agreed.phase, self.robot.announced, agreed.controller) {
            self.robot.announced = true;
            return Some(Event::Running { controller });
        }
        if let Some((text, lost)) = self.connection.poll_text() {
            return Some(Event::Text { text, lost });
        }
        // A state that came just before the stream broke may itself be the broken one.
        let state = self.robot.state.take().filter(|_| agreed.failed.is_none())?;
        Some(Event::State { state, skipped: std::mem::take(&mut self.robot.skipped) })
    }

    /// Queues one setpoint (rad) and its sequence number. The robot's program takes it when the number differs from the one
    /// before, so a stream starts at 1: 0 is what a fresh controller's register holds.
    ///
    /// # Errors
    /// [`LinkError::NotRunning`], [`LinkError::NoState`], [`LinkError::ImpossibleSetpoint`], [`LinkError::StepTooLarge`],
    /// [`LinkError::TransmitFull`]; nothing is queued then, and the link stays usable. The error of a failed link, again.
    pub fn send_setpoint(&mut self, seq: u32, joints: &JointPos<6>) -> Result<(), LinkError> {
        let session = self.connection.session_mut();
        session.alive()?;
        if session.agreed.phase != Phase::Running {
            return Err(LinkError::NotRunning { phase: session.agreed.phase });
        }
        let limits = self.arm.position_min.0.iter().zip(&self.arm.position_max.0);
        for ((joint, value), (min, max)) in (0..).zip(&joints.0).zip(limits) {
            if !(*min..=*max).contains(value) {
                return Err(LinkError::ImpossibleSetpoint { joint, value: *value });
            }
        }
        // The robot's program takes all zeros for "nothing written yet".
        if joints.0 == [0.0; 6] {
            return Err(LinkError::ImpossibleSetpoint { joint: 0, value: 0.0 });
        }
        let robot = &mut self.robot;
        let (now, actual) = robot.plausibility.last().ok_or(LinkError::NoState)?;
        robot.step_limit.check((now, &actual), joints)?;
        let recipe = session.agreed.input_recipe;
        session.queue(|free| {
            let len = recipe::encode_setpoint(free, recipe, seq, joints)?;
            debug_assert_eq!(len, INPUT_PACKAGE_SIZE);
            Some(len)
        })?;
        robot.step_limit.sent(now, joints);
        robot.cycles.leaves(seq);
        Ok(())
    }

    /// Moves bytes for the robot into `out`; how many. Call it until it gives 0.
    pub fn poll_transmit(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        self.connection.poll_transmit(now, out)
    }

    /// When [`Self::handle_timeout`] wants to be called.
    pub fn poll_timeout(&self) -> Option<Nanos> {
        self.connection.poll_timeout()
    }

    /// Checks whether the robot has been silent for too long.
    ///
    /// # Errors
    /// [`LinkError::Silent`], or [`LinkError::Incomplete`] where a package began; the error of a failed link, again.
    pub fn handle_timeout(&mut self, now: Nanos) -> Result<(), LinkError> {
        self.connection.handle_timeout(now)
    }

    /// What became of the robot's cycles.
    pub const fn cycles(&mut self) -> &mut CycleCount {
        &mut self.robot.cycles
    }

    /// What the client is doing.
    pub fn phase(&self) -> Phase {
        self.connection.agreed().phase
    }

    /// The outputs that the recipe file names, with the values that came with the newest state; all zero before the first.
    pub fn extra(&self) -> impl Iterator<Item = (&Field, impl Iterator<Item = Value>)> {
        recipe::values(self.connection.recipes().extra(), &self.robot.extra)
    }

    /// An error with its place in the recipe file, where it is about a field of one.
    pub fn explain<'a>(&'a self, error: &'a LinkError) -> Explained<'a> {
        self.connection.explain(error)
    }
}

impl Robot {
    fn take(&mut self, session: &mut Session, values: &[u8]) -> Result<(), LinkError> {
        let malformed = LinkError::Malformed { kind: wire::PackageKind::Data };
        let (state, extra) = RobotState::decode(values).ok_or(malformed)?;
        self.plausibility.check(&state)?;
        self.cycles.state(state.timestamp, state.arrived as u32);
        self.fed.state(&state);
        match session.agreed.phase {
            Phase::Measuring if self.pace.is_found(session.rate_hz, state.timestamp)? => {
                session.agreed.phase = Phase::Running;
            }
            Phase::Running => {
                for (to, from) in self.extra.iter_mut().zip(extra) {
                    *to = *from;
                }
                if self.state.replace(state).is_some() {
                    self.skipped = self.skipped.saturating_add(1);
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// The controller's rate by its time stamps: by the least step, for packages that it skips make longer ones.
#[derive(Clone, Copy, Debug, Default)]
struct Pace {
    last: Option<f64>,
    least: Option<f64>,
    steps: u32,
}

impl Pace {
    /// Steps that are looked at.
    const STEPS: u32 = 10;
    /// Share by which the rate may differ: the next possible one is twice or half of it.
    const TOLERANCE: f64 = 0.1;

    /// Whether the rate is known, and the wanted one.
    fn is_found(&mut self, rate_hz: u32, timestamp: f64) -> Result<bool, LinkError> {
        if let Some(last) = self.last.replace(timestamp) {
            let step = timestamp - last;
            self.least = Some(self.least.map_or(step, |least| least.min(step)));
            self.steps += 1;
        }
        let Some(least) = self.least.filter(|_| self.steps >= Self::STEPS) else { return Ok(false) };
        if (least * f64::from(rate_hz) - 1.0).abs() > Self::TOLERANCE {
            return Err(LinkError::OtherRate { rate_hz, found_hz: 1.0 / least });
        }
        Ok(true)
    }
}
