//! One connection: packages out of bytes, and the negotiation up to the data. What is agreed belongs to the connection; what is
//! asked for does not, so that a new one begins with [`Connection::restart`].

use super::error::{Explained, LinkError};
use super::recipe::{Field, Recipes};
use super::wire::{
    Deframer, FieldType, HEADER_LEN, Header, PackageKind, PackageWriter, PayloadReader, Protocol, ShortText,
    TextMessage, list_entries,
};
use super::{ControllerVersion, Phase};
use screed_kernel::units::Nanos;

/// Room for one package at least: a text message of protocol 2 has up to 516 bytes.
const INBOX_MIN: u16 = 1024;
/// Room beside the longest request: the other ones, or setpoints that the driver has not sent yet.
const OUTBOX_MIN: usize = 512;
/// Text messages kept until they are polled.
const TEXTS_MAX: usize = 4;
/// The first controller generation with a 500 Hz cycle, e-Series.
const MAJOR_500_HZ: u32 = 5;

/// How long an answer may take while a connection is agreed on (ns), where a state may not take longer. Then nothing moves by it, and
/// a controller looks up hundreds of names beside its own cycle: one of 100 ms would be refused for no reason, one of seconds would
/// keep a person waiting who has the address wrong.
const ANSWER_NS: u64 = 1_000_000_000;

/// The bytes of a connection, and what they have agreed on.
#[derive(Clone, Debug)]
pub(super) struct Connection {
    inbox: Deframer,
    session: Session,
}

/// Everything but the bytes of the package being read.
#[derive(Clone, Debug)]
pub(super) struct Session {
    pub recipes: Recipes,
    pub rate_hz: u32,
    timeout_ns: u64,
    pub agreed: Agreed,
    outbox: Box<[u8]>,
    outbox_len: usize,
    texts: [Option<TextMessage>; TEXTS_MAX],
    texts_lost: u32,
}

/// How far one connection is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Agreed {
    pub phase: Phase,
    /// The one being asked for, and then the one in force.
    pub protocol: Protocol,
    pub failed: Option<LinkError>,
    /// When the wait for an answer or a state began: none before the first request left.
    waiting_since: Option<Nanos>,
    pub controller: Option<ControllerVersion>,
    output_recipe: u8,
    pub input_recipe: u8,
}

impl Agreed {
    const NOTHING: Self = Self {
        phase: Phase::Version,
        protocol: Protocol::Two,
        failed: None,
        waiting_since: None,
        controller: None,
        output_recipe: 0,
        input_recipe: 0,
    };
}

impl Connection {
    /// For a fresh connection; its first request waits.
    pub fn new(recipes: Recipes, rate_hz: u32, timeout_ns: u64) -> Self {
        let (longest, request) = (recipes.longest.max(INBOX_MIN), recipes.longest);
        let session = Session {
            recipes,
            rate_hz,
            timeout_ns,
            agreed: Agreed::NOTHING,
            outbox: vec![0; OUTBOX_MIN + usize::from(request)].into_boxed_slice(),
            outbox_len: 0,
            texts: [None; TEXTS_MAX],
            texts_lost: 0,
        };
        let mut connection = Self { inbox: Deframer::new(usize::from(longest)), session };
        connection.restart();
        connection
    }

    /// Forgets all that was agreed and all bytes, and begins again.
    pub fn restart(&mut self) {
        self.inbox.clear();
        let session = &mut self.session;
        (session.agreed, session.outbox_len) = (Agreed::NOTHING, 0);
        (session.texts, session.texts_lost) = ([None; TEXTS_MAX], 0);
        // There is room for every request.
        session.agreed.failed = session.request(Phase::Version).err();
    }

    /// Takes bytes, split anywhere. The values of each data package are handed on, whatever the phase is.
    pub fn handle_bytes(
        &mut self,
        now: Nanos,
        bytes: &[u8],
        mut on_values: impl FnMut(&mut Session, &[u8]) -> Result<(), LinkError>,
    ) -> Result<(), LinkError> {
        self.session.alive()?;
        let result = self.take(now, bytes, &mut on_values);
        self.session.agreed.failed = result.err();
        result
    }

    fn take(
        &mut self,
        now: Nanos,
        bytes: &[u8],
        on_values: &mut impl FnMut(&mut Session, &[u8]) -> Result<(), LinkError>,
    ) -> Result<(), LinkError> {
        let mut rest = bytes;
        loop {
            let taken = self.inbox.push(rest);
            rest = rest.get(taken..).unwrap_or(&[]);
            while let Some(header) = self.inbox.header() {
                // Judged before the rest is there: a broken size is an error now, not a wait.
                let kind = self.session.judge(header)?;
                let Some(payload) = self.inbox.payload(header.size) else { break };
                match kind {
                    PackageKind::Data => {
                        let values = self.session.values(now, payload)?;
                        on_values(&mut self.session, values)?;
                    }
                    _ => self.session.handle_package(now, kind, payload)?,
                }
                self.inbox.consume(header.size);
            }
            if rest.is_empty() {
                return Ok(());
            }
        }
    }

    /// The connection was closed by the controller; gives the error to report.
    pub fn handle_closed(&mut self) -> LinkError {
        let agreed = &mut self.session.agreed;
        *agreed.failed.get_or_insert(LinkError::Closed { phase: agreed.phase })
    }

    /// Moves bytes for the controller into `out`; how many.
    pub fn poll_transmit(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        self.session.poll_transmit(now, out)
    }

    /// When [`Self::handle_timeout`] wants to be called.
    pub fn poll_timeout(&self) -> Option<Nanos> {
        self.session.agreed.waiting_since.map(|since| since.plus(self.session.patience_ns()))
    }

    /// Checks whether the controller has been silent for too long.
    pub fn handle_timeout(&mut self, now: Nanos) -> Result<(), LinkError> {
        self.session.alive()?;
        let Some(since) = self.session.agreed.waiting_since else { return Ok(()) };
        let waited_ns = now.since(since);
        if waited_ns < self.session.patience_ns() {
            return Ok(());
        }
        let announced = self.inbox.header().map(|header| header.size);
        let error = LinkError::timed_out(self.inbox.waiting(), announced, waited_ns, self.session.agreed.phase);
        self.session.agreed.failed = Some(error);
        Err(error)
    }

    /// Asks the controller to send no more.
    pub fn pause(&mut self) -> Result<(), LinkError> {
        self.session.alive()?;
        match self.session.agreed.phase {
            Phase::Running => self.session.request(Phase::Pausing),
            phase => Err(LinkError::NotRunning { phase }),
        }
    }

    /// The oldest text that was not polled yet, and how many were lost before it.
    pub fn poll_text(&mut self) -> Option<(TextMessage, u32)> {
        let Session { texts, texts_lost, .. } = &mut self.session;
        let text = texts[0].take()?;
        texts.rotate_left(1);
        Some((text, std::mem::take(texts_lost)))
    }

    /// What has been agreed.
    pub const fn agreed(&self) -> &Agreed {
        &self.session.agreed
    }

    /// States a second that are asked for.
    pub const fn rate_hz(&self) -> u32 {
        self.session.rate_hz
    }

    /// What is asked for.
    pub const fn recipes(&self) -> &Recipes {
        &self.session.recipes
    }

    /// An error with the place in the recipe file that it is about, where it is about one.
    pub const fn explain<'a>(&'a self, error: &'a LinkError) -> Explained<'a> {
        Explained { error, file: self.session.recipes.file.as_ref() }
    }

    /// The other half, without the bytes that come.
    pub const fn session_mut(&mut self) -> &mut Session {
        &mut self.session
    }
}

impl Session {
    /// The error of a failed connection.
    pub fn alive(&self) -> Result<(), LinkError> {
        self.agreed.failed.map_or(Ok(()), Err)
    }

    /// How long what is awaited may take: a state, or an answer.
    fn patience_ns(&self) -> u64 {
        match self.agreed.phase {
            Phase::Measuring | Phase::Running => self.timeout_ns,
            _ => self.timeout_ns.max(ANSWER_NS),
        }
    }

    /// Enters a phase and queues the request that it begins with.
    fn request(&mut self, phase: Phase) -> Result<(), LinkError> {
        self.agreed.phase = phase;
        let kind = match phase {
            Phase::Version => PackageKind::ProtocolVersion,
            Phase::ControllerVersion => PackageKind::ControllerVersion,
            Phase::Outputs => PackageKind::SetupOutputs,
            Phase::Inputs => PackageKind::SetupInputs,
            Phase::Starting => PackageKind::Start,
            Phase::Pausing => PackageKind::Pause,
            Phase::Measuring | Phase::Running | Phase::Paused => return Ok(()),
        };
        let free = self.outbox.get_mut(self.outbox_len..).unwrap_or(&mut []);
        let mut writer = PackageWriter::new(free, kind);
        match phase {
            Phase::Version => _ = writer.bytes(&self.agreed.protocol.number().to_be_bytes()),
            Phase::Outputs => {
                if self.agreed.protocol == Protocol::Two {
                    writer.f64(f64::from(self.rate_hz));
                }
                write_names(&mut writer, &self.recipes.outputs);
            }
            Phase::Inputs => write_names(&mut writer, &self.recipes.inputs),
            _ => {}
        }
        self.outbox_len += writer.finish().ok_or(LinkError::TransmitFull)?;
        Ok(())
    }

    /// Whether this header can be true now.
    fn judge(&self, header: Header) -> Result<PackageKind, LinkError> {
        let Agreed { phase, .. } = self.agreed;
        let kind = PackageKind::from_code(header.code).ok_or(LinkError::UnknownPackage { code: header.code })?;
        let longest = self.recipes.longest.max(INBOX_MIN);
        let with_id = u16::from(self.form() == Protocol::Two);
        let data = HEADER_LEN as u16 + with_id + self.recipes.size;
        let (min, max) = match kind {
            PackageKind::ProtocolVersion | PackageKind::Start | PackageKind::Pause => (4, 4),
            PackageKind::ControllerVersion => (19, 19),
            PackageKind::Data => (data, data),
            PackageKind::Text if self.form() == Protocol::One => (4, longest),
            PackageKind::Text => (6, 516),
            PackageKind::SetupOutputs => (4 + with_id, longest),
            PackageKind::SetupInputs => (5, longest),
        };
        let expected = match kind {
            PackageKind::Text => true,
            PackageKind::ProtocolVersion => phase == Phase::Version,
            PackageKind::ControllerVersion => phase == Phase::ControllerVersion,
            PackageKind::SetupOutputs => phase == Phase::Outputs,
            PackageKind::SetupInputs => phase == Phase::Inputs,
            PackageKind::Start => phase == Phase::Starting,
            // The first data may overtake the answer to the start, the last one that to the pause.
            PackageKind::Data => {
                matches!(phase, Phase::Starting | Phase::Measuring | Phase::Running | Phase::Pausing)
            }
            PackageKind::Pause => phase == Phase::Pausing,
        };
        if !expected {
            return Err(LinkError::UnexpectedPackage { kind, phase });
        }
        if !(min..=max).contains(&header.size) {
            return Err(LinkError::BadSize { kind, size: header.size, min, max });
        }
        Ok(kind)
    }

    /// The protocol whose form packages have: the first until one is agreed.
    fn form(&self) -> Protocol {
        if self.agreed.phase == Phase::Version { Protocol::One } else { self.agreed.protocol }
    }

    fn handle_package(&mut self, now: Nanos, kind: PackageKind, payload: &[u8]) -> Result<(), LinkError> {
        let malformed = LinkError::Malformed { kind };
        let mut reader = PayloadReader::new(payload);
        match kind {
            PackageKind::Text => return self.keep(TextMessage::decode(self.form(), payload).ok_or(malformed)?),
            PackageKind::Data => return Err(LinkError::UnexpectedPackage { kind, phase: self.agreed.phase }),
            PackageKind::ProtocolVersion => match (reader.u8(), self.agreed.protocol) {
                (Some(1), _) => self.request(Phase::ControllerVersion)?,
                (_, Protocol::Two) => {
                    self.agreed.protocol = Protocol::One;
                    self.request(Phase::Version)?;
                }
                (_, Protocol::One) => return Err(LinkError::ProtocolRefused),
            },
            PackageKind::ControllerVersion => {
                let mut next = || reader.u32().ok_or(malformed);
                let version = ControllerVersion { major: next()?, minor: next()?, bugfix: next()?, build: next()? };
                if version.major < MAJOR_500_HZ && self.rate_hz > 125 {
                    return Err(LinkError::RateTooHigh { controller: version, rate_hz: self.rate_hz });
                }
                self.agreed.controller = Some(version);
                self.request(Phase::Outputs)?;
            }
            PackageKind::SetupOutputs => {
                let with_id = self.form() == Protocol::Two;
                self.agreed.output_recipe = if with_id { reader.u8().ok_or(malformed)? } else { 0 };
                self.check_setup(kind, reader.rest(), &self.recipes.outputs)?;
                self.request(if self.recipes.inputs.is_empty() { Phase::Starting } else { Phase::Inputs })?;
            }
            PackageKind::SetupInputs => {
                self.agreed.input_recipe = reader.u8().ok_or(malformed)?;
                self.check_setup(kind, reader.rest(), &self.recipes.inputs)?;
                self.request(Phase::Starting)?;
            }
            PackageKind::Start => match reader.u8() {
                // Who only reads takes what comes; setpoints have to come at the controller's rate, which protocol 1 does not ask for.
                Some(1) if self.form() == Protocol::One && !self.recipes.inputs.is_empty() => {
                    self.agreed.phase = Phase::Measuring;
                }
                Some(1) => self.agreed.phase = Phase::Running,
                _ => return Err(LinkError::StartRefused),
            },
            PackageKind::Pause => self.agreed.phase = Phase::Paused,
        }
        self.agreed.waiting_since = if self.agreed.phase == Phase::Paused { None } else { Some(now) };
        Ok(())
    }

    /// Checks the types in the answer to a setup. There are servers that repeat the names: then a type is the one we know.
    fn check_setup(&self, kind: PackageKind, answer: &[u8], fields: &[Field]) -> Result<(), LinkError> {
        let malformed = LinkError::Malformed { kind };
        let mut types = list_entries(answer);
        for field in fields {
            match types.next() {
                None => return Err(malformed),
                Some(b"NOT_FOUND") => {
                    return Err(LinkError::FieldNotFound { field: *field, controller: self.agreed.controller });
                }
                Some(b"IN_USE") => {
                    let used = list_entries(answer).filter(|found| *found == b"IN_USE").count();
                    let count = |count: usize| u16::try_from(count).unwrap_or(u16::MAX);
                    return Err(LinkError::InUse { field: *field, used: count(used), of: count(fields.len()) });
                }
                Some(found) if FieldType::from_name(found) == Some(field.kind) => {}
                Some(found) if found == field.name.as_bytes() => {}
                Some(found) => return Err(LinkError::WrongType { field: *field, found: ShortText::cut(found) }),
            }
        }
        if types.next().is_some() { Err(malformed) } else { Ok(()) }
    }

    /// The values of a data package, once its recipe is the one agreed on.
    fn values<'a>(&mut self, now: Nanos, payload: &'a [u8]) -> Result<&'a [u8], LinkError> {
        let values = match (self.form(), payload.split_first()) {
            (Protocol::One, _) => payload,
            (Protocol::Two, Some((id, values))) if *id == self.agreed.output_recipe => values,
            (Protocol::Two, Some((id, _))) => {
                return Err(LinkError::UnknownRecipe { id: *id, expected: self.agreed.output_recipe });
            }
            (Protocol::Two, None) => return Err(LinkError::Malformed { kind: PackageKind::Data }),
        };
        if matches!(self.agreed.phase, Phase::Measuring | Phase::Running) {
            self.agreed.waiting_since = Some(now);
        }
        Ok(values)
    }

    fn keep(&mut self, text: TextMessage) -> Result<(), LinkError> {
        match self.texts.iter_mut().find(|slot| slot.is_none()) {
            Some(slot) => *slot = Some(text),
            None => self.texts_lost = self.texts_lost.saturating_add(1),
        }
        Ok(())
    }

    /// Queues what `write` puts into the room that is left.
    pub fn queue(&mut self, write: impl FnOnce(&mut [u8]) -> Option<usize>) -> Result<(), LinkError> {
        let free = self.outbox.get_mut(self.outbox_len..).unwrap_or(&mut []);
        self.outbox_len += write(free).ok_or(LinkError::TransmitFull)?;
        Ok(())
    }

    fn poll_transmit(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        let count = self.outbox_len.min(out.len());
        if let (Some(from), Some(to)) = (self.outbox.get(..count), out.get_mut(..count)) {
            to.copy_from_slice(from);
        }
        self.outbox.copy_within(count..self.outbox_len, 0);
        self.outbox_len -= count;
        if count > 0 && self.agreed.phase != Phase::Running {
            self.agreed.waiting_since = Some(now);
        }
        count
    }
}

fn write_names(writer: &mut PackageWriter<'_>, fields: &[Field]) {
    for (index, field) in fields.iter().enumerate() {
        if index > 0 {
            writer.u8(b',');
        }
        writer.bytes(field.name.as_bytes());
    }
}
