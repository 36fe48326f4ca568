//! The RTDE clients against servers that are not as the guide has them, and against controllers that refuse.

use screed::link::rtde::file::{self, RecipeFile};
use screed::link::rtde::reader::RtdeReader;
use screed::link::rtde::recipe::{Value, values};
use screed::link::rtde::wire::{FieldType, Protocol};
use screed::link::rtde::{Event, LinkError, Phase, RtdeClient, fields};
use screed::sim::ur::robot::Generation;
use screed::sim::ur::{ClientId, Controller, Options};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};
use std::collections::BTreeMap;

const TIMEOUT_NS: u64 = 100_000_000;
const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);

/// How a server is odd.
#[derive(Clone, Copy, Debug)]
struct Oddness {
    /// Answers a setup with the names that it was asked for, not with types.
    names: bool,
    /// Says recipe 1 to each setup.
    always_recipe_1: bool,
    /// Knows no recipe of inputs but the last.
    last_inputs_only: bool,
    /// Reads at most one package at a time: what comes with it is lost.
    one_a_read: bool,
    /// The newest protocol it accepts.
    protocol: u16,
    /// States a second.
    rate_hz: u32,
}

const ODD: Oddness =
    Oddness { names: true, always_recipe_1: true, last_inputs_only: true, one_a_read: true, protocol: 2, rate_hz: 500 };

/// A server after the few lines that many tools have: it looks at what one read gave it.
struct Server {
    odd: Oddness,
    protocol: u16,
    outputs: Vec<String>,
    inputs: BTreeMap<u8, Vec<String>>,
    started: bool,
    cycle: u32,
    /// Registers by name.
    written: BTreeMap<String, f64>,
    /// Packages that could not be understood.
    lost: usize,
}

impl Server {
    fn new(odd: Oddness) -> Self {
        let (outputs, inputs) = (Vec::new(), BTreeMap::new());
        Self { odd, protocol: 1, outputs, inputs, started: false, cycle: 0, written: BTreeMap::new(), lost: 0 }
    }

    fn read(&mut self, mut bytes: &[u8]) -> Vec<u8> {
        let mut answers = Vec::new();
        while let [high, low, kind, ..] = *bytes {
            let (package, rest) = bytes.split_at(usize::from(u16::from_be_bytes([high, low])));
            answers.extend(self.answer(kind, &package[3..]));
            bytes = if self.odd.one_a_read { &[] } else { rest };
            self.lost += usize::from(self.odd.one_a_read && !rest.is_empty());
        }
        answers
    }

    fn answer(&mut self, kind: u8, payload: &[u8]) -> Vec<u8> {
        match kind {
            b'V' => {
                let wanted = u16::from_be_bytes([payload[0], payload[1]]);
                let accepted = wanted <= self.odd.protocol;
                self.protocol = if accepted { wanted } else { self.protocol };
                package(b'V', &[u8::from(accepted)])
            }
            b'v' => package(b'v', &[5_u32, 9, 4, 1].map(u32::to_be_bytes).concat()),
            b'O' => {
                let names = if self.protocol == 2 { &payload[8..] } else { payload };
                self.outputs = list(names);
                let types = self.types(&self.outputs, fields::output);
                package(b'O', &if self.protocol == 2 { [vec![1], types].concat() } else { types })
            }
            b'I' => {
                let names = list(payload);
                let types = self.types(&names, fields::input);
                let id = if self.odd.always_recipe_1 { 1 } else { self.inputs.len() as u8 + 1 };
                if self.odd.last_inputs_only {
                    self.inputs.clear();
                }
                self.inputs.insert(id, names);
                package(b'I', &[vec![id], types].concat())
            }
            b'S' => {
                self.started = true;
                package(b'S', &[1])
            }
            b'U' => {
                self.take(payload);
                Vec::new()
            }
            _ => panic!("a package of type {kind}"),
        }
    }

    fn types(&self, names: &[String], kind: fn(&str) -> Option<FieldType>) -> Vec<u8> {
        let types = names.iter().map(|name| if self.odd.names { name } else { kind(name).expect("known").name() });
        types.collect::<Vec<_>>().join(",").into_bytes()
    }

    fn take(&mut self, payload: &[u8]) {
        let Some(names) = self.inputs.get(&payload[0]) else {
            self.lost += 1;
            return;
        };
        let mut rest = &payload[1..];
        for name in names {
            let (value, behind) = rest.split_at(fields::input(name).expect("known").size());
            let value = match value.len() {
                8 => f64::from_be_bytes(value.try_into().unwrap()),
                _ => i32::from_be_bytes(value.try_into().unwrap()).into(),
            };
            self.written.insert(name.clone(), value);
            rest = behind;
        }
        assert!(rest.is_empty());
    }

    fn state(&mut self) -> Vec<u8> {
        if !self.started {
            return Vec::new();
        }
        self.cycle += 1;
        let mut payload = if self.protocol == 2 { vec![1] } else { Vec::new() };
        for name in &self.outputs {
            match name.as_str() {
                "timestamp" => {
                    payload.extend((7.0 + f64::from(self.cycle) / f64::from(self.odd.rate_hz)).to_be_bytes())
                }
                "actual_q" | "target_q" => payload.extend(START.0.iter().flat_map(|joint| joint.to_be_bytes())),
                "runtime_state" => payload.extend(2_u32.to_be_bytes()),
                "robot_mode" => payload.extend(7_u32.to_be_bytes()),
                "safety_status_bits" => payload.extend(1_u32.to_be_bytes()),
                "payload" => payload.extend(2.5_f64.to_be_bytes()),
                "joint_mode" => payload.extend([255_u32; 6].map(u32::to_be_bytes).concat()),
                // As a newer controller has it, and the guide's table has not.
                "of_tomorrow" => payload.extend(0.75_f64.to_be_bytes()),
                name => payload.extend(vec![0; fields::output(name).expect("known").size()]),
            }
        }
        package(b'U', &payload)
    }
}

fn package(kind: u8, payload: &[u8]) -> Vec<u8> {
    [&((payload.len() + 3) as u16).to_be_bytes()[..], &[kind], payload].concat()
}

fn list(names: &[u8]) -> Vec<String> {
    std::str::from_utf8(names).expect("text").split(',').map(str::to_owned).collect()
}

fn transmitted(mut poll: impl FnMut(&mut [u8]) -> usize) -> Vec<u8> {
    let (mut all, mut part) = (Vec::new(), [0; 64]);
    loop {
        match poll(&mut part) {
            0 => return all,
            count => all.extend(&part[..count]),
        }
    }
}

/// Cycles with setpoints until so many states were answered; the server, or why the link failed.
fn run(odd: Oddness, mut client: RtdeClient, states: u32) -> Result<(Server, RtdeClient), LinkError> {
    let mut server = Server::new(odd);
    let (mut seq, mut now) = (0, Nanos(0));
    for _ in 0..10 * states {
        now = now.plus(2_000_000);
        let sent = transmitted(|out| client.poll_transmit(now, out));
        let answers = server.read(&sent);
        client.handle_bytes(now, &answers)?;
        client.handle_bytes(now, &server.state())?;
        client.handle_timeout(now)?;
        while let Some(event) = client.poll_event() {
            if let Event::State { .. } = event {
                seq += 1;
                let setpoint = JointPos(START.0.map(|joint| joint + 1e-5 * f64::from(seq)));
                client.send_setpoint(seq, &setpoint).expect("running");
            }
        }
        if seq == states {
            let sent = transmitted(|out| client.poll_transmit(now, out));
            server.read(&sent);
            return Ok((server, client));
        }
    }
    panic!("still {}", client.phase());
}

#[test]
fn a_server_that_is_odd_in_every_way_is_driven() {
    for bits in 0..16 {
        for (protocol, rate_hz, register_offset) in [(2, 500, 0), (2, 125, 24), (1, 125, 0), (1, 500, 24)] {
            let bit = |n: u32| bits >> n & 1 == 1;
            let (names, always_recipe_1, last_inputs_only, one_a_read) = (bit(0), bit(1), bit(2), bit(3));
            let odd = Oddness { names, always_recipe_1, last_inputs_only, one_a_read, protocol, rate_hz };
            let client = RtdeClient::new(&UR10E, rate_hz, register_offset, TIMEOUT_NS).expect("legal");
            let (server, _) = run(odd, client, 50).unwrap_or_else(|error| panic!("{odd:?}: {error}"));
            let read = |name: &str, n: u8| server.written[&format!("input_{name}_register_{n}")];
            assert_eq!((server.lost, read("int", register_offset)), (0, 50.0), "{odd:?}");
            for (joint, start) in (0..).zip(START.0) {
                assert_eq!(read("double", register_offset + joint), start + 1e-5 * 50.0, "{odd:?}");
            }
        }
    }
}

#[test]
fn a_rate_that_protocol_1_cannot_ask_for_is_found_by_the_time_stamps() {
    for (rate_hz, found) in [(500, 125), (125, 500), (125, 250)] {
        let odd = Oddness { protocol: 1, rate_hz: found, ..ODD };
        let client = RtdeClient::new(&UR10E, rate_hz, 0, TIMEOUT_NS).expect("legal");
        match run(odd, client, 50).err() {
            Some(error @ LinkError::OtherRate { rate_hz: wanted, found_hz }) => {
                assert!(wanted == rate_hz && (found_hz / f64::from(found) - 1.0).abs() < 1e-6, "{error}");
                let text = error.to_string();
                assert!(text.contains(&format!("sends {found}.0 states a second, {rate_hz} are configured")), "{text}");
            }
            other => panic!("{other:?}"),
        }
    }
}

const RECIPES: &str = r#"<?xml version="1.0"?>
<rtde_config>
  <recipe key="state">
    <field name="actual_q" type="VECTOR6D"/>
    <field name="payload" type="DOUBLE"/>
    <field name="joint_mode" type="VECTOR6INT32"/>
    <field name="of_tomorrow" type="DOUBLE"/>
  </recipe>
</rtde_config>
"#;

fn recipes() -> RecipeFile {
    file::parse("robot.xml", RECIPES).unwrap_or_else(|error| panic!("{error}"))
}

/// What a recipe file asks for comes beside what Screed needs, with the types of the file where the server tells none.
#[test]
fn outputs_of_a_recipe_file_come_beside_screeds_own() {
    for (names, protocol) in [(true, 2), (true, 1)] {
        let odd = Oddness { names, protocol, ..ODD };
        let client = RtdeClient::beside(Some(&recipes()), &UR10E, 500, 0, TIMEOUT_NS).expect("legal");
        let (server, client) = run(odd, client, 20).unwrap_or_else(|error| panic!("{error}"));
        let beside = server.outputs[9..].join(",");
        assert_eq!(beside, "payload,joint_mode,of_tomorrow,safety_status_bits", "actual_q is asked for once");
        let extra: Vec<_> =
            client.extra().map(|(field, numbers)| (field.name.to_string(), numbers.collect())).collect();
        let expected = [
            ("payload".to_owned(), vec![Value::Double(2.5)]),
            ("joint_mode".to_owned(), vec![Value::Signed(255); 6]),
            ("of_tomorrow".to_owned(), vec![Value::Double(0.75)]),
        ];
        assert_eq!(extra, expected);
    }
}

#[test]
fn a_reader_takes_every_package_and_asks_for_the_time_behind_its_recipe() {
    for odd in [ODD, Oddness { protocol: 1, ..ODD }, Oddness { names: true, one_a_read: false, ..ODD }] {
        let (file, mut server) = (recipes(), Server::new(odd));
        let mut reader = RtdeReader::new(&file, &file.recipes[0], 500, TIMEOUT_NS).expect("legal");
        let mut rows: Vec<Vec<u8>> = Vec::new();
        for _ in 0..30 {
            let sent = transmitted(|out| reader.poll_transmit(Nanos(0), out));
            let bytes = [server.read(&sent), server.state()].concat();
            reader.handle_bytes(Nanos(0), &bytes, |row| rows.push(row.to_vec())).expect("sound bytes");
        }
        assert_eq!(rows.len() as u32, server.cycle);
        assert_eq!((reader.wanted(), server.outputs.last().map(String::as_str)), (4, Some("timestamp")));
        for (cycle, row) in (1..).zip(&rows) {
            let (time, numbers) = values(reader.fields(), row).last().expect("a time stamp");
            assert!(time.is_timestamp());
            assert_eq!(numbers.collect::<Vec<_>>(), [Value::Double(7.0 + f64::from(cycle) / 500.0)]);
        }
        assert!(server.inputs.is_empty(), "a reader writes nothing");
    }
}

fn controller(generation: Generation) -> Controller {
    let options = Options {
        start_q: START,
        flange_from_tcp: Pose::identity(),
        register_offset: 0,
        program: "def idle():\nend\n".to_owned(),
        autoplay: false,
        generation,
        powered: true,
    };
    Controller::new(&UR10E, options).expect("legal")
}

/// Negotiates with the simulated controller; the client, or why it failed and what is told.
fn negotiate(controller: &mut Controller, mut client: RtdeClient) -> Result<ClientId, (LinkError, String)> {
    let connection = controller.connect();
    let mut bytes = [0; 4096];
    for _ in 0..200 {
        let sent = transmitted(|out| client.poll_transmit(Nanos(0), out));
        controller.handle_bytes(connection, &sent);
        controller.step();
        let count = controller.poll_transmit(connection, &mut bytes);
        if let Err(error) = client.handle_bytes(Nanos(0), &bytes[..count]) {
            return Err((error, client.explain(&error).to_string()));
        }
        if client.phase() == Phase::Running {
            return Ok(connection);
        }
    }
    panic!("still {}", client.phase());
}

#[test]
fn a_controller_that_refuses_protocol_2_is_driven_by_1_at_its_own_rate_only() {
    let client = |rate_hz| RtdeClient::new(&UR10E, rate_hz, 0, TIMEOUT_NS).expect("legal");
    let mut controller = controller(Generation::ESeries);
    controller.limit_protocol(Protocol::One);
    let first = negotiate(&mut controller, client(125)).unwrap_or_else(|(error, _)| panic!("{error}"));
    controller.disconnect(first);
    let (error, text) = negotiate(&mut controller, client(500)).expect_err("another rate");
    assert!(matches!(error, LinkError::OtherRate { rate_hz: 500, .. }), "{text}");
    let mut refused = client(125);
    refused.handle_bytes(Nanos(0), &package(b'V', &[0])).expect("protocol 1 is left");
    let error = refused.handle_bytes(Nanos(0), &package(b'V', &[0])).expect_err("none is left");
    assert_eq!(error, LinkError::ProtocolRefused);
    assert!(error.to_string().contains("refuses RTDE protocols 2 and 1"), "{error}");
}

#[test]
fn refusals_name_cause_and_action() {
    let client = |rate_hz, offset| RtdeClient::new(&UR10E, rate_hz, offset, TIMEOUT_NS).expect("legal");
    let mut e_series = controller(Generation::ESeries);
    // All seven inputs, as a fieldbus takes them; then two of them.
    negotiate(&mut e_series, client(500, 0)).unwrap_or_else(|(error, _)| panic!("{error}"));
    let (_, text) = negotiate(&mut e_series, client(500, 0)).expect_err("in use");
    assert!(text.contains("all 7 inputs from input_double_register_0 on are in use: a fieldbus"), "{text}");
    assert!(text.contains("EtherNet/IP") && text.contains("set register_offset to the other of 0 and 24"), "{text}");
    let other = e_series.connect();
    e_series.handle_bytes(other, &package(b'I', b"input_double_register_26,input_int_register_24"));
    let (_, text) = negotiate(&mut e_series, client(500, 24)).expect_err("in use");
    assert!(text.contains("2 of 7 inputs are in use, input_double_register_26 first: another RTDE client"), "{text}");

    let (error, text) = negotiate(&mut controller(Generation::Cb3), client(500, 0)).expect_err("too fast");
    assert!(matches!(error, LinkError::RateTooHigh { rate_hz: 500, .. }));
    assert!(text.contains("(software 3.15.8.1) serves at most 125 Hz, 500 Hz wanted; set rate_hz = 125"), "{text}");

    // A controller before 3.9 has no upper registers.
    let mut old = client(125, 24);
    old.handle_bytes(Nanos(0), &package(b'V', &[1])).expect("sound");
    old.handle_bytes(Nanos(0), &package(b'v', &[3_u32, 5, 0, 9].map(u32::to_be_bytes).concat())).expect("sound");
    let types = b"\x00DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,UINT32,INT32,NOT_FOUND,NOT_FOUND,UINT32";
    let error = old.handle_bytes(Nanos(0), &package(b'O', types)).expect_err("not found");
    let text = error.to_string();
    assert!(
        text.contains("(software 3.5.0.9) has no field output_int_register_24: registers from 24 on came"),
        "{text}"
    );
    assert!(text.contains("3.9 and 5.3; update it, or set register_offset = 0"), "{text}");

    // What a recipe file asks for is told with its place in it.
    let beside = RtdeClient::beside(Some(&recipes()), &UR10E, 500, 0, TIMEOUT_NS).expect("legal");
    let (_, text) = negotiate(&mut controller(Generation::ESeries), beside).expect_err("not found");
    assert!(
        text.starts_with("robot.xml:7: recipe state: the controller (software 5.11.6.1) has no field of_tomorrow: "),
        "{text}"
    );
    let mut beside = RtdeClient::beside(Some(&recipes()), &UR10E, 500, 0, TIMEOUT_NS).expect("legal");
    beside.handle_bytes(Nanos(0), &package(b'V', &[1])).expect("sound");
    beside.handle_bytes(Nanos(0), &package(b'v', &[5_u32, 9, 0, 9].map(u32::to_be_bytes).concat())).expect("sound");
    let types =
        b"\x01DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,UINT32,INT32,INT32,INT32,VECTOR3D,VECTOR6INT32,DOUBLE,UINT32";
    let error = beside.handle_bytes(Nanos(0), &package(b'O', types)).expect_err("another type");
    let text = beside.explain(&error).to_string();
    let expected = "robot.xml:5: recipe state: field payload: type DOUBLE expected, the controller answers VECTOR3D; ";
    assert!(text.starts_with(expected), "{text}");
}
