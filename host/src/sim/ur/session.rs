//! One client's connection to the simulated controller: requests, recipes, data.
//!
//! Choices where the protocol's documentation is silent: an unknown package type, or data of a wrong length or recipe, is
//! answered by a text message and otherwise ignored; a size below three bytes ends the connection, for no border can be
//! found behind it; a refused setup has recipe id 0. A client that speaks protocol 1, which carries no rate, gets 125 Hz.

use super::fields::{InputValues, Snapshot, Source, output};
use crate::link::rtde::TextLevel;
use crate::link::rtde::wire::{
    Deframer, FieldType, HEADER_LEN, PACKAGE_MAX, PackageKind, PackageWriter, PayloadReader, Protocol, TEXT_MAX,
    list_entries,
};

/// Unsent bytes at which a client that does not read is cut off; real controllers keep about ten seconds.
const BACKLOG_MAX: usize = 256 * 1024;
/// The rate of protocol 1 (Hz).
const PROTOCOL_1_RATE: f64 = 125.0;

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
    /// Input packages since the last cycle.
    pub packages: u32,
    /// Cycles per second.
    pub rate: u32,
    /// The controller's software: major, minor, bugfix, build.
    pub software: [u32; 4],
    /// The newest protocol that is accepted.
    pub protocol: Protocol,
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
            PackageKind::ControllerVersion => self.send(kind, &exchange.software.map(u32::to_be_bytes).concat()),
            PackageKind::SetupOutputs => self.set_up_outputs(payload, exchange),
            PackageKind::SetupInputs => self.set_up_inputs(payload, exchange),
            PackageKind::Start => {
                let possible = self.outputs.is_some() || !self.inputs.is_empty();
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
        for (place, field_type) in &recipe.fields {
            if let Some(value) = reader.bytes(field_type.size()) {
                exchange.inputs.set(*place, value);
                if let Some(updated) = exchange.updated.get_mut(*place) {
                    *updated = true;
                }
            }
        }
        exchange.packages = exchange.packages.saturating_add(1);
    }

    /// Sends the recipe's outputs when this cycle is due.
    pub(super) fn send_state(&mut self, snapshot: &Snapshot<'_>, inputs: &InputValues) {
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
        self.send(PackageKind::Data, &payload);
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
        let (message, source) = (shorten(message), "Screed simulated controller");
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
        let start = self.outbox.len();
        self.outbox.resize(start + HEADER_LEN + payload.len(), 0);
        let mut writer = PackageWriter::new(self.outbox.get_mut(start..).unwrap_or(&mut []), kind);
        writer.bytes(payload);
        let sent = writer.finish().is_some();
        // A package that its size field cannot hold, or a client that does not read.
        if !sent || self.outbox.len() > BACKLOG_MAX {
            self.open = false;
        }
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

/// The start of a text, cut between characters to what a text package can hold.
fn shorten(text: &str) -> &str {
    let mut end = text.len().min(TEXT_MAX);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.get(..end).unwrap_or("")
}
