//! One client's connection to the simulated controller: requests, recipes, data.
//!
//! Choices where the protocol's documentation is silent: an unknown package type, or data of a wrong length or recipe, is
//! answered by a text message and otherwise ignored; a size below three bytes ends the connection, for no border can be
//! found behind it; a refused setup has recipe id 0. A client that speaks protocol 1, which carries no rate, gets 125 Hz.
//! Between the answer to a start and the first data lie 10 ms: clients are known that look at the newest package
//! only, and take a start for refused when data has overtaken its answer.

use super::fields::{Snapshot, Source, output};
use super::inputs::{Fieldbus, InputValues, Wishes};
use super::properties;
use super::robot::Generation;
use super::shorten;
use crate::link::rtde::TextLevel;
use crate::link::rtde::wire::{
    Deframer, FieldType, HEADER_LEN, PACKAGE_MAX, PackageKind, PayloadReader, Protocol, TEXT_MAX, list_entries,
};
use crate::sim::line::{self, Spoil};

/// How long a client may not read (s): real controllers keep about ten seconds.
const BACKLOG: f64 = 10.0;
/// Unsent bytes at which it is cut off sooner.
const BACKLOG_MAX: usize = 4 * 1024 * 1024;
/// The rate of protocol 1 (Hz).
const PROTOCOL_1_RATE: f64 = 125.0;
/// How long no data comes after the answer to a start (s).
const AFTER_START: f64 = 0.01;
/// Who owns an input that a fieldbus writes.
const FIELDBUS: ClientId = ClientId(0);

/// A connection, as [`super::Controller::connect`] gave it out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClientId(pub(super) u64);

/// What all connections share.
#[derive(Clone, Debug)]
pub(super) struct Exchange {
    pub inputs: InputValues,
    /// Who writes an input.
    pub owners: Vec<Option<ClientId>>,
    /// Which inputs were updated since the last cycle.
    pub updated: Vec<bool>,
    /// What was asked of outputs and speed slider since the last cycle.
    pub wishes: Wishes,
    /// Input packages since the last cycle.
    pub packages: u32,
    /// Cycles per second.
    pub rate: u32,
    /// Which controller.
    pub generation: Generation,
    /// The newest protocol that is accepted.
    pub protocol: Protocol,
}

impl Exchange {
    pub(super) fn new(generation: Generation) -> Self {
        let inputs = InputValues::new();
        let (owners, updated) = (vec![None; inputs.len()], vec![false; inputs.len()]);
        let rate = generation.cycle_rate();
        Self {
            inputs,
            owners,
            updated,
            wishes: Wishes::default(),
            packages: 0,
            rate,
            generation,
            protocol: Protocol::Two,
        }
    }

    /// A fieldbus takes inputs from whoever has them, and gives back those it no longer takes.
    pub(super) fn take_for(&mut self, fieldbus: Fieldbus) {
        for (place, owner) in self.owners.iter_mut().enumerate() {
            if self.inputs.is_of(fieldbus, place) {
                *owner = Some(FIELDBUS);
            } else if *owner == Some(FIELDBUS) {
                *owner = None;
            }
        }
    }

    fn is_owned_by(&self, place: usize, client: ClientId) -> bool {
        self.owners.get(place) == Some(&Some(client))
    }
}

/// What goes wrong with the next data package.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mishap {
    /// Its second half is missing, and nothing follows for so many cycles.
    Half {
        /// How many.
        cycles: u64,
    },
    /// It is spoilt.
    Spoilt(Spoil),
}

#[derive(Clone, Debug)]
struct OutputRecipe {
    id: u8,
    fields: Vec<(FieldType, Source)>,
    /// One package in this many cycles.
    divisor: u64,
}

#[derive(Clone, Debug)]
struct InputRecipe {
    id: u8,
    fields: Vec<(usize, FieldType)>,
}

/// The state of one connection.
#[derive(Clone, Debug)]
pub(super) struct Session {
    id: ClientId,
    protocol: u16,
    inbox: Deframer,
    outbox: Vec<u8>,
    outputs: Option<OutputRecipe>,
    inputs: Vec<InputRecipe>,
    output_setups: u8,
    started: bool,
    /// Cycles until data may be sent.
    quiet: u32,
    /// To be told once data flows.
    greeting: Option<String>,
    /// What the controller's log has to have of it.
    complaints: Vec<String>,
    /// The last cycle that has begun, and the last one that left nothing unsent.
    cycle: u64,
    drained: u64,
    /// Nothing is sent before this cycle.
    pub silent_until: u64,
    pub mishap: Option<Mishap>,
    open: bool,
}

impl Session {
    pub(super) fn new(id: ClientId) -> Self {
        Self {
            id,
            protocol: 1,
            inbox: Deframer::new(PACKAGE_MAX),
            outbox: Vec::new(),
            outputs: None,
            inputs: Vec::new(),
            output_setups: 0,
            started: false,
            quiet: 0,
            greeting: None,
            complaints: Vec::new(),
            cycle: 0,
            drained: 0,
            silent_until: 0,
            mishap: None,
            open: true,
        }
    }

    /// False once the controller has given the connection up.
    pub(super) const fn is_open(&self) -> bool {
        self.open
    }

    /// Whether the client asked for data, or for its inputs to be read.
    pub(super) const fn is_started(&self) -> bool {
        self.started
    }

    /// Whether data is sent, or will be.
    pub(super) const fn is_streaming(&self) -> bool {
        self.started && self.outputs.is_some()
    }

    /// What the controller's log has to have of it since this was last asked.
    pub(super) fn take_complaints(&mut self) -> Vec<String> {
        std::mem::take(&mut self.complaints)
    }

    /// The controller gives it up.
    pub(super) const fn close(&mut self) {
        self.open = false;
    }

    pub(super) fn handle_bytes(&mut self, bytes: &[u8], exchange: &mut Exchange) {
        let mut rest = bytes;
        while self.open {
            let taken = self.inbox.push(rest);
            rest = rest.get(taken..).unwrap_or(&[]);
            while let Some(header) = self.inbox.header() {
                if usize::from(header.size) < HEADER_LEN {
                    self.open = false;
                    return;
                }
                let Some(payload) = self.inbox.payload(header.size).map(<[u8]>::to_vec) else { break };
                self.inbox.consume(header.size);
                self.handle_package(header.code, &payload, exchange);
            }
            if rest.is_empty() {
                return;
            }
        }
    }

    fn handle_package(&mut self, code: u8, payload: &[u8], exchange: &mut Exchange) {
        if code == properties::CODE && exchange.generation == Generation::ESeries {
            return self.send_raw(code, &properties::answer(payload, exchange.generation));
        }
        let Some(kind) = PackageKind::from_code(code) else {
            return self.send_text(TextLevel::Error, &format!("Unknown package type {code}"));
        };
        match kind {
            PackageKind::ProtocolVersion => {
                let Ok([high, low]) = <[u8; 2]>::try_from(payload) else { return self.wrong_size(kind) };
                let wanted = u16::from_be_bytes([high, low]);
                let accepted = (1..=exchange.protocol.number()).contains(&wanted);
                if accepted {
                    self.protocol = wanted;
                }
                self.send(kind, &[u8::from(accepted)]);
            }
            PackageKind::ControllerVersion => {
                self.send(kind, &exchange.generation.software().map(u32::to_be_bytes).concat())
            }
            PackageKind::SetupOutputs => self.set_up_outputs(payload, exchange),
            PackageKind::SetupInputs => self.set_up_inputs(payload, exchange),
            PackageKind::Start => {
                let possible = self.outputs.is_some() || !self.inputs.is_empty();
                if !self.started {
                    self.quiet = (AFTER_START * f64::from(exchange.rate)).ceil() as u32;
                }
                self.started = possible;
                self.send(kind, &[u8::from(possible)]);
            }
            PackageKind::Pause => {
                self.started = false;
                self.send(kind, &[1]);
            }
            PackageKind::Data => self.take_data(payload, exchange),
            // A client's text goes to the teach pendant's log, which the simulation does not have.
            PackageKind::Text => {}
        }
    }

    fn set_up_outputs(&mut self, payload: &[u8], exchange: &Exchange) {
        let kind = PackageKind::SetupOutputs;
        let mut reader = PayloadReader::new(payload);
        let rate = if self.protocol == 1 { Some(PROTOCOL_1_RATE) } else { reader.f64() };
        let Some(rate) = rate else { return self.wrong_size(kind) };
        let full = f64::from(exchange.rate);
        let rate_possible = rate > 0.0 && rate <= full;
        let mut fields = Vec::new();
        let mut types = Vec::new();
        for name in list_entries(reader.rest()) {
            match output(name, &exchange.inputs) {
                Some((field_type, source)) => {
                    fields.push((field_type, source));
                    types.push(field_type.name());
                }
                None => types.push("NOT_FOUND"),
            }
        }
        let complete = !fields.is_empty() && fields.len() == types.len();
        let size: usize = fields.iter().map(|(field_type, _)| field_type.size()).sum();
        let fits = size + HEADER_LEN < PACKAGE_MAX;
        self.outputs = None;
        if complete && rate_possible && fits {
            self.output_setups = self.output_setups.checked_add(1).unwrap_or(1);
            let id = self.output_setups;
            // At least 1, for the rate is at most the full one; a rate that is no divisor is served by the next faster one.
            self.outputs = Some(OutputRecipe { id, fields, divisor: (full / rate) as u64 });
        }
        if complete && !fits {
            let most = PACKAGE_MAX - HEADER_LEN - 1;
            self.send_text(TextLevel::Error, &format!("Outputs of {size} bytes; a data package holds {most}"));
        }
        if !rate_possible {
            self.send_text(TextLevel::Error, &format!("Output frequency {rate} Hz is not within 0 to {full} Hz"));
        }
        let id = self.outputs.as_ref().map_or(0, |recipe| recipe.id);
        self.send_types(kind, (self.protocol != 1).then_some(id), &types);
    }

    fn set_up_inputs(&mut self, payload: &[u8], exchange: &mut Exchange) {
        let mut fields = Vec::new();
        let mut types = Vec::new();
        for name in list_entries(payload) {
            let found = exchange.inputs.find(name);
            let owner = found.and_then(|(place, _)| exchange.owners.get(place).copied().flatten());
            match (found, owner) {
                (None, _) => types.push("NOT_FOUND"),
                (Some(_), Some(owner)) if owner != self.id => types.push("IN_USE"),
                (Some(field), _) => {
                    types.push(field.1.name());
                    fields.push(field);
                }
            }
        }
        let complete = !fields.is_empty() && fields.len() == types.len();
        // Counted from 1 on each connection, apart from the outputs': some clients do not read the answer's id.
        let id = u8::try_from(self.inputs.len() + 1).ok().filter(|_| complete);
        if complete && id.is_none() {
            self.send_text(
                TextLevel::Error,
                &format!("Input recipe refused: a connection has at most {} of them", u8::MAX),
            );
        }
        if let Some(id) = id {
            for (place, _) in &fields {
                if let Some(owner) = exchange.owners.get_mut(*place) {
                    *owner = Some(self.id);
                }
            }
            self.inputs.push(InputRecipe { id, fields });
        }
        self.send_types(PackageKind::SetupInputs, Some(id.unwrap_or(0)), &types);
    }

    fn take_data(&mut self, payload: &[u8], exchange: &mut Exchange) {
        let mut reader = PayloadReader::new(payload);
        let recipe = reader.u8().and_then(|id| self.inputs.iter().find(|recipe| recipe.id == id));
        let Some(recipe) = recipe else {
            return self.send_text(TextLevel::Error, "Input data for a recipe that was not set up");
        };
        let size: usize = recipe.fields.iter().map(|(_, field_type)| field_type.size()).sum();
        if reader.rest().len() != size {
            return self.wrong_size(PackageKind::Data);
        }
        if let Some((place, _)) = recipe.fields.iter().find(|(place, _)| !exchange.is_owned_by(*place, self.id)) {
            let told = match exchange.owners.get(*place) {
                Some(Some(owner)) if *owner == FIELDBUS => {
                    "Input data for registers that a fieldbus has taken: ignored"
                }
                Some(Some(_)) => "Input data for registers that another client has taken: ignored",
                _ => "Input data for registers that a fieldbus had taken: ignored until the recipe is set up again",
            };
            return self.send_text(TextLevel::Error, told);
        }
        for (place, field_type) in &recipe.fields {
            if let Some(value) = reader.bytes(field_type.size()) {
                exchange.inputs.set(*place, value);
                if let Some(updated) = exchange.updated.get_mut(*place) {
                    *updated = true;
                }
            }
        }
        exchange.inputs.read_wishes(&recipe.fields, &mut exchange.wishes);
        exchange.packages = exchange.packages.saturating_add(1);
    }

    /// A control cycle begins; a client that has not read for too long is given up.
    pub(super) fn begin(&mut self, cycle: u64, rate: u32) {
        self.cycle = cycle;
        if self.outbox.is_empty() {
            self.drained = cycle;
        } else if (cycle - self.drained) as f64 > BACKLOG * f64::from(rate) {
            self.open = false;
        }
    }

    /// Sends the recipe's outputs when this cycle is due.
    pub(super) fn send_state(&mut self, snapshot: &Snapshot<'_>, inputs: &InputValues) {
        if self.quiet > 0 {
            self.quiet -= 1;
            return;
        }
        if self.cycle < self.silent_until {
            return;
        }
        let Some(recipe) =
            self.outputs.as_ref().filter(|recipe| self.started && snapshot.cycle.is_multiple_of(recipe.divisor))
        else {
            return;
        };
        let mut payload = Vec::new();
        if self.protocol != 1 {
            payload.push(recipe.id);
        }
        for (field_type, source) in &recipe.fields {
            snapshot.write(&mut payload, *field_type, *source, inputs);
        }
        let start = self.outbox.len();
        self.send(PackageKind::Data, &payload);
        match self.mishap.take() {
            Some(Mishap::Half { cycles }) => {
                self.outbox.truncate(start + (HEADER_LEN + payload.len()) / 2);
                self.silent_until = self.cycle + 1 + cycles;
            }
            Some(Mishap::Spoilt(spoil)) => line::spoil(&mut self.outbox, start, spoil),
            None => {}
        }
        // Behind data: a client that asks for the newest package gets data.
        if let Some(greeting) = self.greeting.take() {
            self.send_text(TextLevel::Error, &greeting);
        }
    }

    /// Says so once data flows.
    pub(super) fn greet(&mut self, message: &str) {
        self.greeting = Some(message.to_owned());
    }

    fn wrong_size(&mut self, kind: PackageKind) {
        self.send_text(TextLevel::Error, &format!("Wrong size of a package: {kind}"));
    }

    fn send_types(&mut self, kind: PackageKind, id: Option<u8>, types: &[&str]) {
        let mut payload: Vec<u8> = id.into_iter().collect();
        payload.extend(types.join(",").as_bytes());
        self.send(kind, &payload);
    }

    pub(super) fn send_text(&mut self, level: TextLevel, message: &str) {
        let (message, source) = (shorten(message, TEXT_MAX), "Screed simulated controller");
        let mut payload = Vec::new();
        if self.protocol == 1 {
            payload.push(level.code());
            payload.extend(message.as_bytes());
        } else {
            for text in [message, source] {
                payload.push(text.len() as u8);
                payload.extend(text.as_bytes());
            }
            payload.push(level.code());
        }
        self.send(PackageKind::Text, &payload);
    }

    fn send(&mut self, kind: PackageKind, payload: &[u8]) {
        self.send_raw(kind.code(), payload);
    }

    fn send_raw(&mut self, code: u8, payload: &[u8]) {
        if self.cycle < self.silent_until {
            return;
        }
        let Ok(size) = u16::try_from(HEADER_LEN + payload.len()) else {
            let told = format!(
                "No answer to a package of type {}: its {} bytes are more than a package's {PACKAGE_MAX}",
                char::from(code),
                HEADER_LEN + payload.len()
            );
            self.send_text(TextLevel::Error, &told);
            return self.complaints.push(told);
        };
        // A client that does not read.
        if self.outbox.len() + payload.len() > BACKLOG_MAX {
            self.open = false;
            return;
        }
        self.outbox.extend(size.to_be_bytes());
        self.outbox.push(code);
        self.outbox.extend(payload);
    }

    /// Moves bytes for the client into `out`; how many.
    pub(super) fn poll_transmit(&mut self, out: &mut [u8]) -> usize {
        let count = self.outbox.len().min(out.len());
        for (to, from) in out.iter_mut().zip(self.outbox.drain(..count)) {
            *to = from;
        }
        count
    }
}
