//! RTDE, Universal Robots' real-time data exchange: the client's side as a state machine. Time and bytes are arguments; its
//! memory is allocated when it is made and never after, so it can live in the real-time process.
//!
//! The robot paces: it sends one data package per period, the answer is a setpoint in its input registers, where a small
//! program on the controller ([`program`]) reads it. Negotiation goes one request at a time, because servers exist that
//! parse one package per read: protocol version, controller version, outputs, inputs, start.
//!
//! RTDE has no checksum. Sizes, types, recipes and values are checked as far as a wrong one can be recognised; a wrong value
//! that is possible passes. After any error the client stays failed: a stream that lost its package borders is never read on.

pub mod cycles;
pub mod error;
mod limits;
pub mod program;
pub mod recipe;
#[cfg(test)]
mod tests;
pub mod wire;

pub use error::LinkError;
pub use recipe::RobotState;
pub use wire::{TextLevel, TextMessage};

use cycles::CycleCount;
use limits::StepLimit;
use recipe::{Field, INPUT_PACKAGE_SIZE, OUTPUT_PACKAGE_SIZE, Plausibility};
use screed_kernel::arm::Arm;
use screed_kernel::units::{JointPos, JointVel, Nanos};
use std::fmt;
use wire::{Deframer, HEADER_LEN, Header, PackageKind, PackageWriter, PayloadReader};

/// Longest package accepted: a text message of protocol 2 needs 516 bytes, the answer to a setup less.
const INBOX_SIZE: u16 = 1024;
/// Room for the longest request, or for setpoints that the driver has not sent yet.
const OUTBOX_SIZE: usize = 512;
/// Text messages kept until they are polled.
const TEXTS_MAX: usize = 4;
/// The first controller generation with a 500 Hz cycle, e-Series.
const MAJOR_500_HZ: u32 = 5;

/// What the client is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Asking for protocol 2.
    Version,
    /// Asking for the controller's software version.
    ControllerVersion,
    /// Agreeing on outputs.
    Outputs,
    /// Agreeing on inputs.
    Inputs,
    /// Asking for data.
    Starting,
    /// Exchanging data.
    Running,
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Version => "asking for protocol 2",
            Self::ControllerVersion => "asking for the controller's version",
            Self::Outputs => "agreeing on outputs",
            Self::Inputs => "agreeing on inputs",
            Self::Starting => "starting",
            Self::Running => "running",
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
    inbox: Deframer,
    session: Session,
    /// As it is for a fresh connection.
    fresh: Session,
}

/// Everything but the bytes of the package being read.
#[derive(Clone, Debug)]
struct Session {
    rate_hz: u32,
    register_offset: u8,
    timeout_ns: u64,
    arm: Arm<6>,
    phase: Phase,
    failed: Option<LinkError>,
    outbox: [u8; OUTBOX_SIZE],
    outbox_len: usize,
    /// When the wait for an answer or a state began: none before the first request left.
    waiting_since: Option<Nanos>,
    controller: Option<ControllerVersion>,
    output_recipe: u8,
    input_recipe: u8,
    plausibility: Plausibility,
    step_limit: StepLimit,
    cycles: CycleCount,
    announce_running: bool,
    state: Option<RobotState>,
    skipped: u32,
    texts: [Option<TextMessage>; TEXTS_MAX],
    texts_lost: u32,
}

impl RtdeClient {
    /// A client for a fresh connection: its first request waits in [`Self::poll_transmit`]. `arm` gives the limits of what a
    /// received value can be; `rate_hz` is 125 or 500; `register_offset` is 0 or 24; an answer, and in operation a state, has
    /// to come within `timeout_ns`.
    ///
    /// # Errors
    /// [`LinkError::BadRate`], [`LinkError::BadOffset`].
    pub fn new(arm: &Arm<6>, rate_hz: u32, register_offset: u8, timeout_ns: u64) -> Result<Self, LinkError> {
        if !matches!(rate_hz, 125 | 500) {
            return Err(LinkError::BadRate { rate_hz });
        }
        if !matches!(register_offset, 0 | 24) {
            return Err(LinkError::BadOffset { offset: register_offset });
        }
        let mut session = Session {
            rate_hz,
            register_offset,
            timeout_ns,
            arm: *arm,
            phase: Phase::Version,
            failed: None,
            outbox: [0; OUTBOX_SIZE],
            outbox_len: 0,
            waiting_since: None,
            controller: None,
            output_recipe: 0,
            input_recipe: 0,
            plausibility: Plausibility::new(arm),
            step_limit: StepLimit::new(arm.velocity_max.known(), rate_hz),
            cycles: CycleCount::new(rate_hz),
            announce_running: false,
            state: None,
            skipped: 0,
            texts: [None; TEXTS_MAX],
            texts_lost: 0,
        };
        session.request(Phase::Version)?;
        Ok(Self { inbox: Deframer::new(usize::from(INBOX_SIZE)), fresh: session.clone(), session })
    }

    /// Speeds of an arm whose data sheet gives none (rad/s): by them steps are judged before they are sent.
    pub const fn set_speeds(&mut self, velocity_max: JointVel<6>) {
        self.session.step_limit.set_speeds(velocity_max);
        self.fresh.step_limit.set_speeds(velocity_max);
    }

    /// For a fresh connection: everything is agreed anew, and nothing is known of the robot. Only the account of its cycles goes on.
    pub fn restart(&mut self) {
        self.inbox.clear();
        let cycles = self.session.cycles.restarted();
        self.session = Session { cycles, ..self.fresh.clone() };
    }

    /// Takes bytes from the robot, split anywhere.
    ///
    /// # Errors
    /// Every [`LinkError`] of a received package; the same one again from then on.
    pub fn handle_bytes(&mut self, now: Nanos, bytes: &[u8]) -> Result<(), LinkError> {
        self.session.alive()?;
        let result = self.take(now, bytes);
        self.session.failed = result.err();
        result
    }

    fn take(&mut self, now: Nanos, bytes: &[u8]) -> Result<(), LinkError> {
        let mut rest = bytes;
        loop {
            let taken = self.inbox.push(rest);
            rest = rest.get(taken..).unwrap_or(&[]);
            while let Some(header) = self.inbox.header() {
                // Judged before the rest is there: a broken size is an error now, not a wait.
                let kind = self.session.judge(header)?;
                let Some(payload) = self.inbox.payload(header.size) else { break };
                self.session.handle_package(now, kind, payload)?;
                self.inbox.consume(header.size);
            }
            if rest.is_empty() {
                return Ok(());
            }
        }
    }

    /// The connection was closed by the robot; gives the error to report.
    pub fn handle_closed(&mut self) -> LinkError {
        let error = self.session.failed.unwrap_or(LinkError::Closed { phase: self.session.phase });
        self.session.failed = Some(error);
        error
    }

    /// The next thing to tell: that it runs, then texts, then the newest state.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.session.poll_event()
    }

    /// Queues one setpoint (rad) and its sequence number. The robot's program takes it when the number differs from the one
    /// before, so a stream starts at 1: 0 is what a fresh controller's register holds.
    ///
    /// # Errors
    /// [`LinkError::NotRunning`], [`LinkError::NoState`], [`LinkError::ImpossibleSetpoint`], [`LinkError::StepTooLarge`],
    /// [`LinkError::TransmitFull`];
    /// nothing is queued then, and the link stays usable. The error of a failed link, again.
    pub fn send_setpoint(&mut self, seq: u32, joints: &JointPos<6>) -> Result<(), LinkError> {
        self.session.send_setpoint(seq, joints)
    }

    /// Moves bytes for the robot into `out`; how many. Call it until it gives 0.
    pub fn poll_transmit(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        self.session.poll_transmit(now, out)
    }

    /// When [`Self::handle_timeout`] wants to be called.
    pub fn poll_timeout(&self) -> Option<Nanos> {
        self.session.waiting_since.map(|since| since.plus(self.session.timeout_ns))
    }

    /// Checks whether the robot has been silent for too long.
    ///
    /// # Errors
    /// [`LinkError::Silent`], or [`LinkError::Incomplete`] where a package began; the error of a failed link, again.
    pub fn handle_timeout(&mut self, now: Nanos) -> Result<(), LinkError> {
        self.session.alive()?;
        let Some(since) = self.session.waiting_since else { return Ok(()) };
        let waited_ns = now.since(since);
        if waited_ns < self.session.timeout_ns {
            return Ok(());
        }
        let announced = self.inbox.header().map(|header| header.size);
        let error = LinkError::timed_out(self.inbox.waiting(), announced, waited_ns, self.session.phase);
        self.session.failed = Some(error);
        Err(error)
    }

    /// What became of the robot's cycles.
    pub fn cycles(&mut self) -> &mut CycleCount {
        &mut self.session.cycles
    }

    /// What the client is doing.
    pub fn phase(&self) -> Phase {
        self.session.phase
    }
}

impl Session {
    fn alive(&self) -> Result<(), LinkError> {
        self.failed.map_or(Ok(()), Err)
    }

    /// Enters a phase and queues the request that it begins with.
    fn request(&mut self, phase: Phase) -> Result<(), LinkError> {
        self.phase = phase;
        let kind = match phase {
            Phase::Version => PackageKind::ProtocolVersion,
            Phase::ControllerVersion => PackageKind::ControllerVersion,
            Phase::Outputs => PackageKind::SetupOutputs,
            Phase::Inputs => PackageKind::SetupInputs,
            Phase::Starting => PackageKind::Start,
            Phase::Running => return Ok(()),
        };
        let free = self.outbox.get_mut(self.outbox_len..).unwrap_or(&mut []);
        let mut writer = PackageWriter::new(free, kind);
        match phase {
            Phase::Version => _ = writer.bytes(&2_u16.to_be_bytes()),
            Phase::Outputs => {
                writer.f64(f64::from(self.rate_hz));
                write_names(&mut writer, &recipe::outputs(self.register_offset));
            }
            Phase::Inputs => write_names(&mut writer, &recipe::inputs(self.register_offset)),
            Phase::ControllerVersion | Phase::Starting | Phase::Running => {}
        }
        self.outbox_len += writer.finish().ok_or(LinkError::TransmitFull)?;
        Ok(())
    }

    /// Whether this header can be true now.
    fn judge(&self, header: Header) -> Result<PackageKind, LinkError> {
        let kind = PackageKind::from_code(header.code).ok_or(LinkError::UnknownPackage { code: header.code })?;
        let (min, max) = match kind {
            PackageKind::ProtocolVersion | PackageKind::Start | PackageKind::Pause => (4, 4),
            PackageKind::ControllerVersion => (19, 19),
            PackageKind::Data => (OUTPUT_PACKAGE_SIZE, OUTPUT_PACKAGE_SIZE),
            // Until protocol 2 is agreed a text is a level and a message without length.
            PackageKind::Text if self.phase == Phase::Version => (4, INBOX_SIZE),
            PackageKind::Text => (6, 516),
            PackageKind::SetupOutputs | PackageKind::SetupInputs => (5, INBOX_SIZE),
        };
        let expected = match kind {
            PackageKind::Text => true,
            PackageKind::ProtocolVersion => self.phase == Phase::Version,
            PackageKind::ControllerVersion => self.phase == Phase::ControllerVersion,
            PackageKind::SetupOutputs => self.phase == Phase::Outputs,
            PackageKind::SetupInputs => self.phase == Phase::Inputs,
            PackageKind::Start => self.phase == Phase::Starting,
            // The first data may overtake the answer to the start.
            PackageKind::Data => matches!(self.phase, Phase::Starting | Phase::Running),
            PackageKind::Pause => false,
        };
        if !expected {
            return Err(LinkError::UnexpectedPackage { kind, phase: self.phase });
        }
        if !(min..=max).contains(&header.size) {
            return Err(LinkError::BadSize { kind, size: header.size, min, max });
        }
        Ok(kind)
    }

    fn handle_package(&mut self, now: Nanos, kind: PackageKind, payload: &[u8]) -> Result<(), LinkError> {
        let malformed = LinkError::Malformed { kind };
        let mut reader = PayloadReader::new(payload);
        match kind {
            PackageKind::Text => return self.handle_text(payload).ok_or(malformed),
            PackageKind::Data => return self.handle_data(now, reader),
            PackageKind::ProtocolVersion => match reader.u8() {
                Some(1) => self.request(Phase::ControllerVersion)?,
                _ => return Err(LinkError::ProtocolRefused),
            },
            PackageKind::ControllerVersion => {
                let mut next = || reader.u32().ok_or(malformed);
                let version = ControllerVersion { major: next()?, minor: next()?, bugfix: next()?, build: next()? };
                if version.major < MAJOR_500_HZ && self.rate_hz > 125 {
                    return Err(LinkError::RateTooHigh { major: version.major, rate_hz: self.rate_hz });
                }
                self.controller = Some(version);
                self.request(Phase::Outputs)?;
            }
            PackageKind::SetupOutputs => {
                self.output_recipe = check_setup(kind, reader, &recipe::outputs(self.register_offset))?;
                self.request(Phase::Inputs)?;
            }
            PackageKind::SetupInputs => {
                self.input_recipe = check_setup(kind, reader, &recipe::inputs(self.register_offset))?;
                self.request(Phase::Starting)?;
            }
            PackageKind::Start => match reader.u8() {
                Some(1) => {
                    self.phase = Phase::Running;
                    self.announce_running = true;
                }
                _ => return Err(LinkError::StartRefused),
            },
            PackageKind::Pause => return Err(LinkError::UnexpectedPackage { kind, phase: self.phase }),
        }
        self.waiting_since = Some(now);
        Ok(())
    }

    fn handle_data(&mut self, now: Nanos, mut reader: PayloadReader<'_>) -> Result<(), LinkError> {
        let malformed = LinkError::Malformed { kind: PackageKind::Data };
        let id = reader.u8().ok_or(malformed)?;
        if id != self.output_recipe {
            return Err(LinkError::UnknownRecipe { id, expected: self.output_recipe });
        }
        let state = RobotState::decode(reader.rest()).ok_or(malformed)?;
        self.plausibility.check(&state)?;
        self.cycles.state(state.timestamp, state.arrived as u32);
        if self.phase == Phase::Running {
            self.waiting_since = Some(now);
            if self.state.replace(state).is_some() {
                self.skipped = self.skipped.saturating_add(1);
            }
        }
        Ok(())
    }

    fn handle_text(&mut self, payload: &[u8]) -> Option<()> {
        let text = if self.phase == Phase::Version {
            let (level, message) = payload.split_first()?;
            let message = message.get(..wire::TEXT_MAX.min(message.len()))?;
            let source = wire::ShortText::new(b"")?;
            TextMessage { level: TextLevel::from_code(*level)?, message: wire::ShortText::new(message)?, source }
        } else {
            TextMessage::decode(payload)?
        };
        match self.texts.iter_mut().find(|slot| slot.is_none()) {
            Some(slot) => *slot = Some(text),
            None => self.texts_lost = self.texts_lost.saturating_add(1),
        }
        Some(())
    }

    fn poll_event(&mut self) -> Option<Event> {
        if let (true, Some(controller)) = (self.announce_running, self.controller) {
            self.announce_running = false;
            return Some(Event::Running { controller });
        }
        if let Some(text) = self.texts[0].take() {
            self.texts.rotate_left(1);
            let lost = std::mem::take(&mut self.texts_lost);
            return Some(Event::Text { text, lost });
        }
        // A state that came just before the stream broke may itself be the broken one.
        let state = self.state.take().filter(|_| self.failed.is_none())?;
        Some(Event::State { state, skipped: std::mem::take(&mut self.skipped) })
    }

    fn send_setpoint(&mut self, seq: u32, joints: &JointPos<6>) -> Result<(), LinkError> {
        self.alive()?;
        if self.phase != Phase::Running {
            return Err(LinkError::NotRunning { phase: self.phase });
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
        let (now, actual) = self.plausibility.last().ok_or(LinkError::NoState)?;
        self.step_limit.check((now, &actual), joints)?;
        let free = self.outbox.get_mut(self.outbox_len..).unwrap_or(&mut []);
        let len = recipe::encode_setpoint(free, self.input_recipe, seq, joints).ok_or(LinkError::TransmitFull)?;
        debug_assert_eq!(len, INPUT_PACKAGE_SIZE);
        self.outbox_len += len;
        self.step_limit.sent(now, joints);
        self.cycles.leaves(seq);
        Ok(())
    }

    fn poll_transmit(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        let count = self.outbox_len.min(out.len());
        if let (Some(from), Some(to)) = (self.outbox.get(..count), out.get_mut(..count)) {
            to.copy_from_slice(from);
        }
        self.outbox.copy_within(count..self.outbox_len, 0);
        self.outbox_len -= count;
        if count > 0 && self.phase != Phase::Running {
            self.waiting_since = Some(now);
        }
        count
    }
}

fn write_names(writer: &mut PackageWriter<'_>, fields: &[Field]) {
    for (index, (name, _)) in fields.iter().enumerate() {
        if index > 0 {
            writer.u8(b',');
        }
        writer.bytes(name.as_bytes());
    }
}

/// Checks the answer to a setup, recipe id and types; gives the id.
fn check_setup(kind: PackageKind, mut reader: PayloadReader<'_>, fields: &[Field]) -> Result<u8, LinkError> {
    let malformed = LinkError::Malformed { kind };
    let id = reader.u8().ok_or(malformed)?;
    let mut types = wire::list_entries(reader.rest());
    for &(name, expected) in fields {
        match types.next() {
            None => return Err(malformed),
            Some(b"NOT_FOUND") => return Err(LinkError::FieldNotFound { name }),
            Some(b"IN_USE") => return Err(LinkError::InUse { name }),
            Some(found) if wire::FieldType::from_name(found) == Some(expected) => {}
            Some(_) => return Err(LinkError::WrongType { name, expected }),
        }
    }
    if types.next().is_some() { Err(malformed) } else { Ok(id) }
}

const _: () = assert!(HEADER_LEN + 2 < OUTBOX_SIZE && INPUT_PACKAGE_SIZE < OUTBOX_SIZE);
