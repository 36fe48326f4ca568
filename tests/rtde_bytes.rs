//! Golden bytes of every RTDE package in both protocols, for the client and for the simulated controller: whole, split at every
//! byte, byte by byte, and coalesced. Written by hand from the protocol: size (2 bytes, header included), type, payload; all
//! big-endian. What stands in quotes is text.

use screed::link::rtde::file::{self, RecipeFile};
use screed::link::rtde::reader::RtdeReader;
use screed::link::rtde::wire::Protocol;
use screed::link::rtde::{Event, Phase, RtdeClient, TextLevel};
use screed::sim::ur::robot::Generation;
use screed::sim::ur::{Controller, Options};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};

const TIMEOUT_NS: u64 = 100_000_000;

/// Hexadecimal digits with blanks between them, and texts in quotes.
fn golden(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (index, part) in text.split('"').enumerate() {
        if index % 2 == 1 {
            bytes.extend(part.as_bytes());
            continue;
        }
        let digits: Vec<u8> = part.bytes().filter(u8::is_ascii_hexdigit).collect();
        assert!(part.bytes().all(|byte| byte.is_ascii_hexdigit() || byte == b' '), "{part:?}");
        bytes.extend(digits.chunks(2).map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()));
    }
    bytes
}

/// A negotiation: what the client sends, and what it is answered.
type Exchange = [(&'static str, &'static str)];

const PROTOCOL_2: &Exchange = &[
    ("0005 56 0002", "0004 56 01"),
    ("0003 76", "0013 76 00000005 0000000b 00000006 00000001"),
    (
        r#"0097 4f 405f400000000000 "timestamp,actual_q,actual_qd,target_q,actual_TCP_pose,runtime_state,robot_mode,output_int_register_0,input_int_register_0,safety_status_bits""#,
        r#"004e 4f 01 "DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,UINT32,INT32,INT32,INT32,UINT32""#,
    ),
    (
        r#"00a7 49 "input_double_register_0,input_double_register_1,input_double_register_2,input_double_register_3,input_double_register_4,input_double_register_5,input_int_register_0""#,
        r#"0033 49 02 "DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,INT32""#,
    ),
    ("0003 53", "0004 53 01"),
];
const PROTOCOL_1: &Exchange = &[
    ("0005 56 0002", "0004 56 00"),
    ("0005 56 0001", "0004 56 01"),
    PROTOCOL_2[1],
    (
        r#"008f 4f "timestamp,actual_q,actual_qd,target_q,actual_TCP_pose,runtime_state,robot_mode,output_int_register_0,input_int_register_0,safety_status_bits""#,
        r#"004d 4f "DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,UINT32,INT32,INT32,INT32,UINT32""#,
    ),
    PROTOCOL_2[3],
    PROTOCOL_2[4],
];
const TEXT_2: &str = r#"000e 4d 05 "error" 03 "arm" 01"#;
const TEXT_1: &str = r#"0009 4d 01 "error""#;
/// Behind the time stamp: q, its speed 0, the target, the pose, then playing, running, waiting, package 3, normal.
const VALUES: &str = "3fe0000000000000 bff0000000000000 3ff8000000000000 c000000000000000 3fd0000000000000 0000000000000000 \
    0000000000000000 0000000000000000 0000000000000000 0000000000000000 0000000000000000 0000000000000000 \
    3fe0000000000000 bff0000000000000 3ff8000000000000 c000000000000000 3fd0000000000000 0000000000000000 \
    3fe0000000000000 bfd0000000000000 3fc0000000000000 3ff0000000000000 4000000000000000 0000000000000000 \
    00000002 00000007 00000001 00000003 00000001";
const SETPOINT: &str = "0038 55 02 3fe0000000000000 bff0000000000000 3ff8000000000000 c000000000000000 3fd0000000000000 \
    8000000000000000 01020304";

/// A data package of the controller at so many cycles of 125 Hz after 41 s.
fn data(protocol: Protocol, cycle: u32) -> Vec<u8> {
    let mut bytes = golden(if protocol == Protocol::Two { "00e0 55 01" } else { "00df 55" });
    bytes.extend((41.0 + f64::from(cycle) / 125.0).to_be_bytes());
    bytes.extend(golden(VALUES));
    bytes
}

/// Every way to hand bytes over: whole, in two parts at each byte, one by one.
fn ways(bytes: &[u8]) -> Vec<Vec<&[u8]>> {
    let mut ways: Vec<Vec<&[u8]>> = (0..bytes.len()).map(|at| vec![&bytes[..at], &bytes[at..]]).collect();
    ways.push(bytes.chunks(1).collect());
    ways
}

fn sent_by(mut poll: impl FnMut(&mut [u8]) -> usize) -> Vec<u8> {
    let (mut all, mut part) = (Vec::new(), [0; 64]);
    loop {
        match poll(&mut part) {
            0 => return all,
            count => all.extend(&part[..count]),
        }
    }
}

fn transmitted(client: &mut RtdeClient) -> Vec<u8> {
    sent_by(|out| client.poll_transmit(Nanos(0), out))
}

fn client() -> RtdeClient {
    RtdeClient::new(&UR10E, 125, 0, TIMEOUT_NS).expect("legal")
}

fn hand(client: &mut RtdeClient, parts: &[&[u8]]) {
    for part in parts {
        client.handle_bytes(Nanos(0), part).expect("sound bytes");
    }
}

/// The client runs; in protocol 1 once it has seen the controller's rate.
fn check_running(client: &mut RtdeClient, protocol: Protocol, text: &str) {
    let first = match protocol {
        Protocol::Two => 0,
        Protocol::One => {
            assert_eq!(client.phase(), Phase::Measuring);
            (0..11).for_each(|cycle| client.handle_bytes(Nanos(0), &data(protocol, cycle)).expect("sound bytes"));
            11
        }
    };
    assert_eq!(client.phase(), Phase::Running);
    assert!(matches!(client.poll_event(), Some(Event::Running { controller }) if controller.to_string() == "5.11.6.1"));
    hand(client, &[&golden(text), &data(protocol, first)]);
    match client.poll_event() {
        Some(Event::Text { text, lost: 0 }) => {
            let source = if protocol == Protocol::Two { "arm" } else { "" };
            assert_eq!((text.level, text.message.to_string().as_str()), (TextLevel::Error, "error"));
            assert_eq!(text.source.to_string(), source);
        }
        other => panic!("{other:?}"),
    }
    let Some(Event::State { state, skipped: 0 }) = client.poll_event() else { panic!("no state") };
    assert_eq!(state.timestamp, 41.0 + f64::from(first) / 125.0);
    assert_eq!(state.actual_q.0, [0.5, -1.0, 1.5, -2.0, 0.25, 0.0]);
    assert_eq!((state.target_q, state.actual_qd.0), (state.actual_q, [0.0; 6]));
    assert_eq!(state.actual_tcp_pose, [0.5, -0.25, 0.125, 1.0, 2.0, 0.0]);
    assert_eq!((state.runtime_state, state.robot_mode, state.program_state), (2, 7, 1));
    assert_eq!((state.arrived, state.safety_status_bits), (3, 1));
    client.send_setpoint(0x0102_0304, &JointPos([0.5, -1.0, 1.5, -2.0, 0.25, -0.0])).expect("running");
    assert_eq!(transmitted(client), golden(SETPOINT));
}

const BOTH: [(Protocol, &Exchange, &str); 2] =
    [(Protocol::Two, PROTOCOL_2, TEXT_2), (Protocol::One, PROTOCOL_1, TEXT_1)];

#[test]
fn the_client_asks_and_understands_each_answer_split_at_every_byte() {
    for (protocol, exchange, text) in BOTH {
        // Each answer in turn in every way, the others whole.
        for split in 0..exchange.len() {
            for way in ways(&golden(exchange[split].1)) {
                let mut client = client();
                for (index, (request, answer)) in exchange.iter().enumerate() {
                    assert_eq!(transmitted(&mut client), golden(request), "{protocol:?} {request}");
                    assert!(transmitted(&mut client).is_empty());
                    if index == split { hand(&mut client, &way) } else { hand(&mut client, &[&golden(answer)]) }
                }
                check_running(&mut client, protocol, text);
            }
        }
    }
}

#[test]
fn data_and_texts_split_at_every_byte_and_coalesced_give_the_same_states() {
    for (protocol, exchange, text) in BOTH {
        let all: Vec<u8> = exchange.iter().flat_map(|(_, answer)| golden(answer)).collect();
        let asked: Vec<u8> = exchange.iter().flat_map(|(request, _)| golden(request)).collect();
        // All answers at once: every request goes out, and the client runs as before.
        let mut whole = client();
        hand(&mut whole, &[&all]);
        assert_eq!(transmitted(&mut whole), asked);
        check_running(&mut whole.clone(), protocol, text);
        for way in ways(&all) {
            let mut client = client();
            hand(&mut client, &way);
            assert_eq!(transmitted(&mut client), asked);
            check_running(&mut client, protocol, text);
        }
        let mut stream: Vec<u8> = (0..12).flat_map(|cycle| data(protocol, cycle)).collect();
        stream.extend(golden(text));
        stream.extend(data(protocol, 12));
        for way in ways(&stream) {
            let mut client = whole.clone();
            hand(&mut client, &way);
            assert!(matches!(client.poll_event(), Some(Event::Running { .. })));
            assert!(matches!(client.poll_event(), Some(Event::Text { lost: 0, .. })));
            // Protocol 1 measures by the first eleven.
            let skipped = if protocol == Protocol::Two { 12 } else { 1 };
            let Some(Event::State { state, skipped: found }) = client.poll_event() else { panic!("no state") };
            assert_eq!((state.timestamp, found), (41.096, skipped));
        }
    }
}

fn recipes() -> RecipeFile {
    let text = "<rtde_config><recipe key='out'><field name='runtime_state' type='UINT32'/></recipe></rtde_config>";
    file::parse("recipes.xml", text).expect("sound")
}

/// Who only reads asks for no inputs, and pauses at the end; data may overtake that answer.
#[test]
fn the_reader_asks_for_its_recipe_and_pauses() {
    let setups = [
        (r#"0022 4f 405f400000000000 "runtime_state,timestamp""#, r#"0011 4f 07 "UINT32,DOUBLE""#, "0010 55 07"),
        (r#"001a 4f "runtime_state,timestamp""#, r#"0010 4f "UINT32,DOUBLE""#, "000f 55"),
    ];
    for ((protocol, exchange, _), (request, answer, head)) in BOTH.into_iter().zip(setups) {
        let versions = exchange.len() - 3;
        let last = [(request, answer), PROTOCOL_2[4]];
        let negotiation = exchange[..versions].iter().chain(&last).copied();
        let asked: Vec<u8> = negotiation.clone().flat_map(|(request, _)| golden(request)).collect();
        let mut stream: Vec<u8> = negotiation.flat_map(|(_, answer)| golden(answer)).collect();
        stream.extend(golden(&format!("{head} 00000002 4044800000000000")));
        for way in ways(&stream) {
            let file = recipes();
            let mut reader = RtdeReader::new(&file, &file.recipes[0], 125, TIMEOUT_NS).expect("legal");
            let mut got = Vec::new();
            for part in way {
                reader.handle_bytes(Nanos(0), part, |values| got.push(values.to_vec())).expect("sound bytes");
            }
            assert_eq!(sent_by(|out| reader.poll_transmit(Nanos(0), out)), asked, "{protocol:?}");
            assert_eq!((reader.phase(), reader.protocol()), (Phase::Running, protocol));
            assert_eq!(got, [golden("00000002 4044800000000000")]);
            reader.pause().expect("running");
            assert_eq!(sent_by(|out| reader.poll_transmit(Nanos(0), out)), golden("0003 50"));
            let last = golden(&format!("{head} 00000001 4044800000000001 0004 50 01"));
            reader.handle_bytes(Nanos(0), &last, |values| got.push(values.to_vec())).expect("sound bytes");
            assert_eq!((reader.phase(), got.len(), reader.poll_timeout()), (Phase::Paused, 2, None));
        }
    }
}

fn controller() -> Controller {
    let options = Options {
        start_q: JointPos([0.5, -1.0, 1.5, -2.0, 0.25, 0.0]),
        flange_from_tcp: Pose::identity(),
        register_offset: 0,
        program: "def idle():\nend\n".to_owned(),
        autoplay: false,
        generation: Generation::ESeries,
        powered: true,
    };
    Controller::new(&UR10E, options).expect("legal")
}

/// What the simulated controller is sent, and what it answers at once; an unknown type is answered by a text.
const SERVER_2: &Exchange = &[
    ("0005 56 0002", "0004 56 01"),
    ("0003 76", "0013 76 00000005 0000000b 00000006 00000001"),
    (
        r#"0042 4f 405f400000000000 "actual_q,runtime_state,robot_mode,output_int_register_0""#,
        r#"001f 4f 01 "VECTOR6D,UINT32,INT32,INT32""#,
    ),
    (
        r#"0092 49 "input_double_register_0,input_double_register_1,input_double_register_2,input_double_register_3,input_double_register_4,input_double_register_5""#,
        r#"002d 49 01 "DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE""#,
    ),
    (r#"0017 49 "input_int_register_0""#, r#"0009 49 02 "INT32""#),
    ("0003 53", "0004 53 01"),
    ("0003 5a", r#"0038 4d 17 "Unknown package type 90" 1b "Screed simulated controller" 01"#),
    (
        "0034 55 01 3fe0000000000000 bff0000000000000 3ff8000000000000 c000000000000000 3fd0000000000000 bfe0000000000000",
        "",
    ),
    ("0008 55 02 00000007", ""),
];
const SERVER_1: &Exchange = &[
    ("0005 56 0003", "0004 56 00"),
    ("0005 56 0001", "0004 56 01"),
    SERVER_2[1],
    (
        r#"003a 4f "actual_q,runtime_state,robot_mode,output_int_register_0""#,
        r#"001e 4f "VECTOR6D,UINT32,INT32,INT32""#,
    ),
    SERVER_2[3],
    SERVER_2[4],
    SERVER_2[5],
    ("0003 5a", r#"001b 4d 01 "Unknown package type 90""#),
    SERVER_2[7],
    SERVER_2[8],
];
const SERVER_VALUES: &str = "3fe0000000000000 bff0000000000000 3ff8000000000000 c000000000000000 3fd0000000000000 \
    0000000000000000 00000001 00000007 00000000";

#[test]
fn the_simulated_controller_gives_the_same_answers_to_every_split() {
    for (exchange, head) in [(SERVER_2, "0040 55 01"), (SERVER_1, "003f 55")] {
        let asked: Vec<u8> = exchange.iter().flat_map(|(request, _)| golden(request)).collect();
        let answers: Vec<u8> = exchange.iter().flat_map(|(_, answer)| golden(answer)).collect();
        for way in ways(&asked) {
            let mut controller = controller();
            let client = controller.connect();
            way.iter().for_each(|part| controller.handle_bytes(client, part));
            assert_eq!(sent_by(|out| controller.poll_transmit(client, out)), answers);
            let sent = (0..100).find_map(|cycle| {
                controller.step();
                if cycle == 0 {
                    let record = controller.last_cycle();
                    assert_eq!((record.packages, record.seq), (2, 7));
                    assert_eq!(record.registers, [0.5, -1.0, 1.5, -2.0, 0.25, -0.5]);
                }
                Some(sent_by(|out| controller.poll_transmit(client, out))).filter(|sent| !sent.is_empty())
            });
            assert_eq!(sent, Some(golden(&format!("{head} {SERVER_VALUES}"))));
            controller.handle_bytes(client, &golden("0003 50"));
            assert_eq!(sent_by(|out| controller.poll_transmit(client, out)), golden("0004 50 01"));
            (0..100).for_each(|_| controller.step());
            assert!(sent_by(|out| controller.poll_transmit(client, out)).is_empty(), "paused");
        }
    }
}

#[test]
fn a_controller_limited_to_protocol_1_refuses_2() {
    let mut controller = controller();
    controller.limit_protocol(Protocol::One);
    let client = controller.connect();
    controller.handle_bytes(client, &golden("0005 56 0002 0005 56 0001"));
    assert_eq!(sent_by(|out| controller.poll_transmit(client, out)), golden("0004 56 00 0004 56 01"));
}
