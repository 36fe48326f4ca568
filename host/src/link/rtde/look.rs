//! A look at the robot, for the host before a print: what [`RtdeReader`](super::reader::RtdeReader) reads, as a state. It takes no
//! input, so that it disturbs nobody who does.

use super::error::LinkError;
use super::wire::PayloadReader;

/// How many fields every controller has; those behind are newer, and a controller without them is asked again without.
const REQUIRED: usize = 8;
const NEWER: [&str; 4] = ["target_speed_fraction", "tcp_offset", "payload", "payload_cog"];

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
    /// Where the speed slider stands, 0 to 1.
    pub target_speed_fraction: Option<f64>,
    /// flange_from_tcp of the controller's installation, likewise.
    pub tcp_offset: Option<[f64; 6]>,
    /// Mass that the controller reckons with (kg).
    pub payload: Option<f64>,
    /// Its centre in the flange frame (m).
    pub payload_cog: Option<[f64; 3]>,
}

/// The outputs that are looked at, in the order of [`State`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outputs {
    names: Vec<&'static str>,
}

impl Outputs {
    /// All of them; the program's registers are the first two from `register_offset`, 0 or 24, on.
    pub fn all(register_offset: u8) -> Self {
        let [state, count] = if register_offset == 0 {
            ["output_int_register_0", "output_int_register_1"]
        } else {
            ["output_int_register_24", "output_int_register_25"]
        };
        let required: [_; REQUIRED] = [
            "timestamp",
            "actual_q",
            "actual_TCP_pose",
            "runtime_state",
            "robot_mode",
            "safety_status_bits",
            state,
            count,
        ];
        Self { names: required.into_iter().chain(NEWER).collect() }
    }

    /// Their names.
    pub fn names(&self) -> &[&'static str] {
        &self.names
    }

    /// Leaves out the field that the controller does not have, by this error. False where it is another error, or none can see
    /// without the field.
    pub fn leave_out(&mut self, error: &LinkError) -> bool {
        let LinkError::FieldNotFound { field, .. } = error else { return false };
        let before = self.names.len();
        self.names.retain(|name| !NEWER.contains(name) || name.as_bytes() != field.name.as_bytes());
        self.names.len() < before
    }

    /// A package's values; none where they are too many, too few or not finite.
    pub fn decode(&self, values: &[u8]) -> Option<State> {
        let mut reader = PayloadReader::new(values);
        let has = |name| self.names.contains(&name);
        let state = State {
            timestamp: reader.f64()?,
            actual_q: reader.f64s()?,
            actual_tcp_pose: reader.f64s()?,
            runtime_state: reader.u32()?,
            robot_mode: reader.i32()?,
            safety_status_bits: reader.u32()?,
            program_state: reader.i32()?,
            program_count: reader.i32()?,
            target_speed_fraction: if has(NEWER[0]) { Some(reader.f64()?) } else { None },
            tcp_offset: if has(NEWER[1]) { Some(reader.f64s()?) } else { None },
            payload: if has(NEWER[2]) { Some(reader.f64()?) } else { None },
            payload_cog: if has(NEWER[3]) { Some(reader.f64s()?) } else { None },
        };
        let vectors = [Some(state.actual_q), Some(state.actual_tcp_pose), state.tcp_offset];
        let singles = [Some(state.timestamp), state.target_speed_fraction, state.payload];
        let mut numbers = vectors
            .iter()
            .flatten()
            .flatten()
            .chain(singles.iter().flatten())
            .chain(state.payload_cog.iter().flatten());
        (numbers.all(|value| value.is_finite()) && reader.rest().is_empty()).then_some(state)
    }
}

#[cfg(test)]
mod tests {
    use super::super::fields;
    use super::super::reader::RtdeReader;
    use super::super::wire::FieldType;
    use super::*;
    use crate::config::Cell;
    use crate::sim::ur::robot::Generation;
    use crate::sim::ur::{Controller, Options};
    use screed_kernel::arms::ur::UR10E;
    use screed_kernel::units::{JointPos, Nanos};

    #[test]
    fn a_simulated_robot_is_seen_and_nothing_is_written() {
        const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);
        for (generation, major) in [(Generation::ESeries, 5), (Generation::Cb3, 3)] {
            let program = "def test():\n  write_output_integer_register(24, 7)\n  set_payload(1.5, [0.1, 0.0, 0.2])\n  \
                           while True:\n    sync()\n  end\nend\n";
            let cell = Cell::demo(125).unwrap();
            let options =
                Options { start_q: START, register_offset: 24, generation, ..Options::of(&cell, program.to_owned()) };
            let mut robot = Controller::new(&UR10E, options).unwrap();
            let outputs = Outputs::all(24);
            let mut reader = RtdeReader::of(outputs.names(), 25, 1_000_000_000).unwrap();
            let (client, mut seen) = (robot.connect(), None);
            for _ in 0..200 {
                let mut bytes = [0; 2048];
                let count = reader.poll_transmit(Nanos(0), &mut bytes);
                robot.handle_bytes(client, &bytes[..count]);
                robot.step();
                let count = robot.poll_transmit(client, &mut bytes);
                reader.handle_bytes(Nanos(0), &bytes[..count], |values| seen = outputs.decode(values)).unwrap();
            }
            let state = seen.unwrap();
            assert_eq!((state.actual_q, state.runtime_state, state.robot_mode), (START.0, 2, 7));
            assert_eq!((state.program_state, state.safety_status_bits & 1), (7, 1));
            assert_eq!(state.target_speed_fraction, Some(1.0));
            assert_eq!(state.tcp_offset, Some([0.0, 0.0, 0.2, 0.0, 0.0, 0.0]));
            assert_eq!((state.payload, state.payload_cog), (Some(1.5), Some([0.1, 0.0, 0.2])));
            assert_eq!(reader.controller().unwrap().major, major);
            assert_eq!(robot.last_cycle().packages, 0);
        }
    }

    /// A server's answers by hand, the newest protocol it takes, and fields that it does not have.
    struct Old<'a> {
        protocol: u16,
        lacks: &'a [&'a str],
    }

    impl Old<'_> {
        fn answer(&self, request: &[u8]) -> Vec<u8> {
            let payload = &request[3..];
            let content = match request[2] {
                b'V' => vec![u8::from(u16::from_be_bytes([payload[0], payload[1]]) <= self.protocol)],
                b'v' => [3_u32, 4, 5, 6].map(u32::to_be_bytes).concat(),
                b'O' => {
                    let names = std::str::from_utf8(&payload[if self.protocol == 2 { 8 } else { 0 }..]).unwrap();
                    let kind = |name: &str| match fields::output(name).filter(|_| !self.lacks.contains(&name)) {
                        Some(kind) => FieldType::name(kind),
                        None => "NOT_FOUND",
                    };
                    let types = names.split(',').map(kind).collect::<Vec<_>>().join(",");
                    [if self.protocol == 2 { &[1][..] } else { &[] }, types.as_bytes()].concat()
                }
                _ => vec![1],
            };
            [&((content.len() + 3) as u16).to_be_bytes()[..], &[request[2]], &content].concat()
        }

        /// Negotiates, each time on a fresh connection without what was not found.
        fn look(&self, outputs: &mut Outputs) -> Result<RtdeReader, LinkError> {
            'connection: loop {
                let mut reader = RtdeReader::of(outputs.names(), 25, 1_000_000_000)?;
                loop {
                    let mut out = [0; 1024];
                    let count = reader.poll_transmit(Nanos(1), &mut out);
                    if count == 0 {
                        return Ok(reader);
                    }
                    let result = reader.handle_bytes(Nanos(1), &self.answer(&out[..count]), |_| unreachable!());
                    match result {
                        Err(error) if outputs.leave_out(&error) => continue 'connection,
                        _ => result?,
                    }
                }
            }
        }
    }

    #[test]
    fn old_servers_are_seen_too() {
        for protocol in [1, 2] {
            for lacks in [&[][..], &["tcp_offset"], &["payload", "payload_cog", "tcp_offset"]] {
                let mut outputs = Outputs::all(24);
                let mut reader = Old { protocol, lacks }.look(&mut outputs).unwrap();
                let size: usize = outputs.names().iter().map(|name| fields::output(name).unwrap().size()).sum();
                let content = [if protocol == 2 { &[1][..] } else { &[] }, &vec![0; size]].concat();
                let bytes = [&((content.len() + 3) as u16).to_be_bytes()[..], b"U", &content].concat();
                let mut seen = None;
                reader.handle_bytes(Nanos(2), &bytes, |values| seen = outputs.decode(values)).unwrap();
                let state = seen.unwrap();
                assert_eq!(state.tcp_offset.is_some(), !lacks.contains(&"tcp_offset"));
                assert_eq!(state.payload.is_some(), !lacks.contains(&"payload"));
                assert_eq!(state.payload_cog.is_some(), !lacks.contains(&"payload_cog"));
                // A byte more or less, or a number that is none, it is no state.
                assert_eq!(outputs.decode(&vec![0; size - 1]), None);
                assert_eq!(outputs.decode(&vec![0; size + 1]), None);
                assert_eq!(outputs.decode(&vec![0xff; size]), None);
            }
        }
        // None can see without these.
        let error = Old { protocol: 2, lacks: &["actual_q"] }.look(&mut Outputs::all(24)).unwrap_err();
        assert!(matches!(error, LinkError::FieldNotFound { field, .. } if field.name.as_bytes() == b"actual_q"));
        assert_eq!(Old { protocol: 0, lacks: &[] }.look(&mut Outputs::all(0)).unwrap_err(), LinkError::ProtocolRefused);
    }
}
