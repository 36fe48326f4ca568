//! A look at the robot: a short RTDE client that reads and writes nothing, for the host before a print. It takes no input, so
//! that it disturbs nobody who does, and asks for a few states a second.
//!
//! Negotiation is one request at a time: protocol 2, or 1 where that is refused; the controller's version; outputs; start.
//! Fields that old software does not have are left out of a second request and told as not known.

use super::ControllerVersion;
use super::wire::{
    Deframer, FieldType, PackageKind, PackageWriter, PayloadReader, Protocol, TextMessage, list_entries,
};
use std::collections::VecDeque;

/// Longest package: a state has 300 bytes, a text 516.
const PACKAGE_MAX: usize = 2048;
/// States a second (Hz); with protocol 1 the controller sends as many as it does.
const RATE: f64 = 25.0;
/// Texts kept until they are polled; older ones go.
const TEXTS_MAX: usize = 32;
/// How many fields every controller has, and how many there are; those behind are newer.
const REQUIRED: usize = 8;
const COUNT: usize = REQUIRED + 3;

const fn fields(register_offset: u8) -> [(&'static str, FieldType); COUNT] {
    [
        ("timestamp", FieldType::Double),
        ("actual_q", FieldType::Vector6d),
        ("actual_TCP_pose", FieldType::Vector6d),
        ("runtime_state", FieldType::Uint32),
        ("robot_mode", FieldType::Int32),
        ("safety_status_bits", FieldType::Uint32),
        (if register_offset == 0 { "output_int_register_0" } else { "output_int_register_24" }, FieldType::Int32),
        (if register_offset == 0 { "output_int_register_1" } else { "output_int_register_25" }, FieldType::Int32),
        ("tcp_offset", FieldType::Vector6d),
        ("payload", FieldType::Double),
        ("payload_cog", FieldType::Vector3d),
    ]
}

/// What was seen (SI).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Since the controller's start (s).
    pub timestamp: f64,
    /// The joints (rad).
    pub actual_q: [f64; 6],
    /// base_from_tcp as the controller computes it: position (m), rotation vector (rad).
    pub actual_tcp_pose: [f64; 6],
    /// 1 stopped, 2 playing, 4 paused.
    pub runtime_state: u32,
    /// As in [`super::RobotState`].
    pub robot_mode: i32,
    /// As in [`super::RobotState`].
    pub safety_status_bits: u32,
    /// What the program says in its output register.
    pub program_state: i32,
    /// What the program counts on in the register behind it.
    pub program_count: i32,
    /// flange_from_tcp of the controller's installation, likewise.
    pub tcp_offset: Option<[f64; 6]>,
    /// Mass that the controller reckons with (kg).
    pub payload: Option<f64>,
    /// Its centre in the flange frame (m).
    pub payload_cog: Option<[f64; 3]>,
}

/// Why nothing can be seen; the client stays failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LookError {
    /// A package that cannot be, or not now.
    #[error(
        "what answers is no RTDE server: a package of type {code:#04x} and {size} bytes; check the address and the port in [link]"
    )]
    Stranger {
        /// The type byte.
        code: u8,
        /// Size by its header.
        size: u16,
    },
    /// Neither protocol.
    #[error("the controller refuses RTDE protocols 2 and 1; update its software")]
    ProtocolRefused,
    /// A field that every controller has is not there, or of another type.
    #[error("the controller gives {name} as {found}; update its software, or is it no UR controller?")]
    Field {
        /// The field.
        name: &'static str,
        /// What it said.
        found: String,
    },
    /// It does not send.
    #[error("the controller refuses to send states; restart it")]
    StartRefused,
    /// The connection has ended.
    #[error("the controller closed the RTDE connection; see whether it runs, then connect again")]
    Closed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Version(u16),
    Controller,
    Outputs,
    Starting,
    Seeing,
}

/// The client.
#[derive(Clone, Debug)]
pub struct Look {
    register_offset: u8,
    inbox: Deframer,
    outbox: Vec<u8>,
    phase: Phase,
    protocol: u16,
    controller: Option<ControllerVersion>,
    /// Which fields are asked for.
    wanted: [bool; COUNT],
    recipe: u8,
    state: Option<State>,
    texts: VecDeque<TextMessage>,
    failed: Option<LookError>,
}

impl Look {
    /// A client for a fresh connection; `register_offset` is 0 or 24.
    pub fn new(register_offset: u8) -> Self {
        let mut look = Self {
            register_offset,
            inbox: Deframer::new(PACKAGE_MAX),
            outbox: Vec::new(),
            phase: Phase::Version(2),
            protocol: 2,
            controller: None,
            wanted: [true; COUNT],
            recipe: 0,
            state: None,
            texts: VecDeque::new(),
            failed: None,
        };
        look.enter(Phase::Version(2));
        look
    }

    /// Takes bytes of the controller, split anywhere.
    ///
    /// # Errors
    /// [`LookError`], the same again from then on.
    pub fn handle_bytes(&mut self, mut bytes: &[u8]) -> Result<(), LookError> {
        self.failed.clone().map_or(Ok(()), Err)?;
        while !bytes.is_empty() {
            let taken = self.inbox.push(bytes);
            bytes = bytes.get(taken..).unwrap_or(&[]);
            let result = self.take();
            self.failed = result.clone().err();
            result?;
        }
        Ok(())
    }

    /// The controller has closed the connection.
    pub fn handle_closed(&mut self) -> LookError {
        self.failed.get_or_insert(LookError::Closed).clone()
    }

    /// Moves bytes for the controller into `out`; how many.
    pub fn poll_transmit(&mut self, out: &mut [u8]) -> usize {
        let count = self.outbox.len().min(out.len());
        for (to, from) in out.iter_mut().zip(self.outbox.drain(..count)) {
            *to = from;
        }
        count
    }

    /// The newest state since the last call.
    pub fn poll_state(&mut self) -> Option<State> {
        self.state.take()
    }

    /// The next text of the controller, oldest first.
    pub fn poll_text(&mut self) -> Option<TextMessage> {
        self.texts.pop_front()
    }

    /// The controller's software, once it was told.
    pub const fn controller(&self) -> Option<ControllerVersion> {
        self.controller
    }

    fn take(&mut self) -> Result<(), LookError> {
        while let Some(header) = self.inbox.header() {
            let stranger = LookError::Stranger { code: header.code, size: header.size };
            let Some(kind) = PackageKind::from_code(header.code) else { return Err(stranger) };
            if !(3..=PACKAGE_MAX).contains(&usize::from(header.size)) {
                return Err(stranger);
            }
            let Some(payload) = self.inbox.payload(header.size) else { return Ok(()) };
            let payload = payload.to_vec();
            self.inbox.consume(header.size);
            self.handle(kind, &payload, stranger)?;
        }
        Ok(())
    }

    fn handle(&mut self, kind: PackageKind, payload: &[u8], stranger: LookError) -> Result<(), LookError> {
        let mut reader = PayloadReader::new(payload);
        match (kind, self.phase) {
            (PackageKind::Text, _) => {
                let protocol = if self.protocol == 1 { Protocol::One } else { Protocol::Two };
                self.texts.extend(TextMessage::decode(protocol, payload));
                if self.texts.len() > TEXTS_MAX {
                    self.texts.pop_front();
                }
            }
            (PackageKind::ProtocolVersion, Phase::Version(asked)) => match (reader.u8(), asked) {
                (Some(1), _) => {
                    self.protocol = asked;
                    self.enter(Phase::Controller);
                }
                (Some(_), 2) => self.enter(Phase::Version(1)),
                (Some(_), _) => return Err(LookError::ProtocolRefused),
                (None, _) => return Err(stranger),
            },
            (PackageKind::ControllerVersion, Phase::Controller) => {
                let mut next = || reader.u32().ok_or_else(|| stranger.clone());
                let version = ControllerVersion { major: next()?, minor: next()?, bugfix: next()?, build: next()? };
                self.controller = Some(version);
                self.enter(Phase::Outputs);
            }
            (PackageKind::SetupOutputs, Phase::Outputs) => self.on_outputs(reader, stranger)?,
            (PackageKind::Start, Phase::Starting) => match reader.u8() {
                Some(1) => self.phase = Phase::Seeing,
                _ => return Err(LookError::StartRefused),
            },
            // The first data may overtake the answer to the start.
            (PackageKind::Data, Phase::Starting | Phase::Seeing) => {
                self.state = Some(self.decode(reader).ok_or(stranger)?);
            }
            _ => return Err(stranger),
        }
        Ok(())
    }

    fn on_outputs(&mut self, mut reader: PayloadReader<'_>, stranger: LookError) -> Result<(), LookError> {
        if self.protocol == 2 {
            self.recipe = reader.u8().ok_or_else(|| stranger.clone())?;
        }
        let mut found = list_entries(reader.rest());
        let mut again = false;
        for (place, (name, expected)) in fields(self.register_offset).into_iter().enumerate() {
            let Some(wanted) = self.wanted.get_mut(place).filter(|wanted| **wanted) else { continue };
            let kind = found.next().ok_or_else(|| stranger.clone())?;
            // Servers exist that answer with the names.
            if FieldType::from_name(kind) == Some(expected) || kind == name.as_bytes() {
                continue;
            }
            if place < REQUIRED || kind != b"NOT_FOUND" {
                return Err(LookError::Field { name, found: String::from_utf8_lossy(kind).into_owned() });
            }
            (*wanted, again) = (false, true);
        }
        self.enter(if again { Phase::Outputs } else { Phase::Starting });
        Ok(())
    }

    fn decode(&self, mut reader: PayloadReader<'_>) -> Option<State> {
        if self.protocol == 2 && reader.u8()? != self.recipe {
            return None;
        }
        let [.., offset, payload, cog] = self.wanted;
        let state = State {
            timestamp: reader.f64()?,
            actual_q: reader.f64s()?,
            actual_tcp_pose: reader.f64s()?,
            runtime_state: reader.u32()?,
            robot_mode: reader.i32()?,
            safety_status_bits: reader.u32()?,
            program_state: reader.i32()?,
            program_count: reader.i32()?,
            tcp_offset: if offset { Some(reader.f64s()?) } else { None },
            payload: if payload { Some(reader.f64()?) } else { None },
            payload_cog: if cog { Some(reader.f64s()?) } else { None },
        };
        let vectors = [Some(state.actual_q), Some(state.actual_tcp_pose), state.tcp_offset];
        let finite = vectors.iter().flatten().flatten().chain(&state.payload).all(|value| value.is_finite());
        (finite && state.payload_cog.iter().flatten().all(|v| v.is_finite()) && reader.rest().is_empty())
            .then_some(state)
    }

    /// Enters a phase and queues the request that it begins with.
    fn enter(&mut self, phase: Phase) {
        self.phase = phase;
        let mut out = [0; 512];
        let mut package = |kind, content: &[&[u8]]| {
            let mut writer = PackageWriter::new(&mut out, kind);
            for bytes in content {
                writer.bytes(bytes);
            }
            let count = writer.finish().unwrap_or(0);
            self.outbox.extend_from_slice(out.get(..count).unwrap_or(&[]));
        };
        match phase {
            Phase::Version(version) => package(PackageKind::ProtocolVersion, &[&version.to_be_bytes()]),
            Phase::Controller => package(PackageKind::ControllerVersion, &[]),
            Phase::Outputs => {
                let rate = RATE.to_be_bytes();
                let names = fields(self.register_offset).into_iter().zip(self.wanted);
                let names: Vec<_> = names.filter(|(_, wanted)| *wanted).map(|((name, _), _)| name).collect();
                let rate = if self.protocol == 2 { &rate[..] } else { &[] };
                package(PackageKind::SetupOutputs, &[rate, names.join(",").as_bytes()]);
            }
            Phase::Starting => package(PackageKind::Start, &[]),
            Phase::Seeing => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Cell;
    use crate::robot::sample::Random;
    use crate::sim::ur::robot::Generation;
    use crate::sim::ur::{Controller, Options};
    use screed_kernel::arms::ur::UR10E;
    use screed_kernel::units::JointPos;

    const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);

    /// A server's answers by hand, the newest protocol it takes, and fields that it does not have.
    struct Old<'a> {
        protocol: u16,
        lacks: &'a [&'a str],
        names: bool,
    }

    impl Old<'_> {
        fn answer(&self, request: &[u8]) -> Vec<u8> {
            let payload = &request[3..];
            let content = match request[2] {
                b'V' => vec![u8::from(u16::from_be_bytes([payload[0], payload[1]]) <= self.protocol)],
                b'v' => [3_u32, 4, 5, 6].map(u32::to_be_bytes).concat(),
                b'O' => {
                    let names = std::str::from_utf8(&payload[if self.protocol == 2 { 8 } else { 0 }..]).unwrap();
                    let kind = |name: &str| match fields(24).into_iter().find(|(known, _)| *known == name) {
                        Some((name, _)) if self.lacks.contains(&name) => "NOT_FOUND".to_owned(),
                        Some((name, _)) if self.names => name.to_owned(),
                        Some((_, kind)) => kind.name().to_owned(),
                        None => "NOT_FOUND".to_owned(),
                    };
                    let types = names.split(',').map(kind).collect::<Vec<_>>().join(",");
                    [if self.protocol == 2 { &[1][..] } else { &[] }, types.as_bytes()].concat()
                }
                _ => vec![1],
            };
            [&((content.len() + 3) as u16).to_be_bytes()[..], &[request[2]], &content].concat()
        }

        /// The client once nothing more is asked.
        fn negotiated(&self) -> Result<Look, LookError> {
            let mut look = Look::new(24);
            loop {
                let mut out = [0; 1024];
                let count = look.poll_transmit(&mut out);
                if count == 0 {
                    return Ok(look);
                }
                look.handle_bytes(&self.answer(&out[..count]))?;
            }
        }
    }

    #[test]
    fn a_simulated_robot_is_seen_and_nothing_is_written() {
        for (generation, major) in [(Generation::ESeries, 5), (Generation::Cb3, 3)] {
            let program = "def test():\n  write_output_integer_register(24, 7)\n  set_payload(1.5, [0.1, 0.0, 0.2])\n  \
                           while True:\n    sync()\n  end\nend\n";
            let cell = Cell::demo(125).unwrap();
            let options =
                Options { start_q: START, register_offset: 24, generation, ..Options::of(&cell, program.to_owned()) };
            let mut robot = Controller::new(&UR10E, options).unwrap();
            let (client, mut look, mut seen) = (robot.connect(), Look::new(24), None);
            for _ in 0..200 {
                let mut bytes = [0; 2048];
                let count = look.poll_transmit(&mut bytes);
                // One byte at a time.
                bytes[..count].iter().for_each(|byte| robot.handle_bytes(client, &[*byte]));
                robot.step();
                let count = robot.poll_transmit(client, &mut bytes);
                bytes[..count].iter().for_each(|byte| look.handle_bytes(&[*byte]).unwrap());
                seen = look.poll_state().or(seen);
            }
            let state = seen.unwrap();
            assert_eq!((state.actual_q, state.runtime_state, state.robot_mode), (START.0, 2, 7));
            assert_eq!((state.program_state, state.safety_status_bits & 1), (7, 1));
            assert_eq!(state.tcp_offset, Some([0.0, 0.0, 0.2, 0.0, 0.0, 0.0]));
            assert_eq!((state.payload, state.payload_cog), (Some(1.5), Some([0.1, 0.0, 0.2])));
            assert_eq!(look.controller().unwrap().major, major);
            assert_eq!(robot.last_cycle().packages, 0);
        }
    }

    #[test]
    fn old_and_odd_servers_are_seen_too() {
        for protocol in [1, 2] {
            for lacks in [&[][..], &["tcp_offset"], &["payload", "payload_cog", "tcp_offset"]] {
                for names in [false, true] {
                    let mut look = Old { protocol, lacks, names }.negotiated().unwrap();
                    let mut values = Vec::new();
                    for (name, kind) in fields(24) {
                        let count = if lacks.contains(&name) { 0 } else { kind.size() };
                        values.extend(vec![0; count]);
                    }
                    let content = [if protocol == 2 { &[1][..] } else { &[] }, &values].concat();
                    let bytes = [&((content.len() + 3) as u16).to_be_bytes()[..], b"U", &content].concat();
                    look.handle_bytes(&bytes).unwrap();
                    let state = look.poll_state().unwrap();
                    assert_eq!(state.tcp_offset.is_some(), !lacks.contains(&"tcp_offset"));
                    assert_eq!(state.payload.is_some(), !lacks.contains(&"payload"));
                    // A byte short, it is no state.
                    let mut short = bytes.clone();
                    short.pop();
                    short[1] -= 1;
                    assert!(matches!(look.handle_bytes(&short), Err(LookError::Stranger { .. })));
                }
            }
        }
        let error = Old { protocol: 2, lacks: &["actual_q"], names: false }.negotiated().unwrap_err();
        assert_eq!(error, LookError::Field { name: "actual_q", found: "NOT_FOUND".to_owned() });
        let error = Old { protocol: 0, lacks: &[], names: false }.negotiated().unwrap_err();
        assert_eq!(error, LookError::ProtocolRefused);
        let mut look = Look::new(0);
        assert!(matches!(look.handle_bytes(b"HTTP/1.1 400"), Err(LookError::Stranger { code: b'T', .. })));
        assert!(matches!(look.handle_closed(), LookError::Stranger { .. }), "the first error stays");
    }

    #[test]
    fn no_bytes_make_it_panic_or_grow() {
        let mut random = Random::new(73);
        for _ in 0..20_000 {
            let mut look = Old { protocol: 2, lacks: &[], names: false }.negotiated().unwrap();
            let count = random.between(1.0, 400.0) as usize;
            let mut bytes: Vec<u8> = (0..count).map(|_| random.between(0.0, 256.0) as u8).collect();
            // Mostly a header that may be one.
            if count > 3 && random.between(0.0, 1.0) < 0.8 {
                bytes[..2].copy_from_slice(&(random.between(0.0, 600.0) as u16).to_be_bytes());
                bytes[2] = b"VvMUOISP"[random.between(0.0, 8.0) as usize];
            }
            let _ = look.handle_bytes(&bytes);
            assert!(look.texts.len() <= TEXTS_MAX && look.outbox.len() < 2048);
        }
    }
}
