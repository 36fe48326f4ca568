//! The client alone, against bytes written by hand.

use super::program::{Program, ProgramError, WatchdogAction};
use super::wire::PackageKind;
use super::*;
use crate::link;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::units::JointVel;

const TIMEOUT_NS: u64 = 100_000_000;

fn package(kind: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = ((payload.len() + 3) as u16).to_be_bytes().to_vec();
    bytes.push(kind);
    bytes.extend(payload);
    bytes
}

fn data(state: &RobotState) -> Vec<u8> {
    let mut payload = vec![1];
    let doubles = [state.actual_q.0, state.actual_qd.0, state.target_q.0, state.actual_tcp_pose].concat();
    payload.extend(state.timestamp.to_be_bytes());
    payload.extend(doubles.iter().flat_map(|value| value.to_be_bytes()));
    payload.extend(state.runtime_state.to_be_bytes());
    payload.extend(state.robot_mode.to_be_bytes());
    payload.extend(state.program_state.to_be_bytes());
    payload.extend(state.arrived.to_be_bytes());
    payload.extend(state.safety_status_bits.to_be_bytes());
    package(b'U', &payload)
}

fn state(cycle: u32) -> RobotState {
    let q = JointPos([0.1, -1.0, 1.5, -2.0, -1.5, 1e-4 * f64::from(cycle)]);
    RobotState {
        timestamp: 41.0 + f64::from(cycle) / 500.0,
        actual_q: q,
        actual_qd: JointVel([0.0, 0.0, 0.0, 0.0, 0.0, 0.05]),
        target_q: q,
        actual_tcp_pose: [0.6, -0.2, 0.4, 1.0, -2.0, 0.3],
        runtime_state: 2,
        robot_mode: 7,
        safety_status_bits: 1,
        program_state: 1,
        arrived: 1,
    }
}

fn answers() -> [Vec<u8>; 5] {
    let mut version = Vec::new();
    version.extend([5_u32, 11, 6, 1].map(u32::to_be_bytes).concat());
    let outputs = b"\x01DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,UINT32,INT32,INT32,INT32,UINT32";
    let inputs = b"\x02DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,INT32";
    [package(b'V', &[1]), package(b'v', &version), package(b'O', outputs), package(b'I', inputs), package(b'S', &[1])]
}

fn client() -> RtdeClient {
    RtdeClient::new(&UR10E, 500, 0, TIMEOUT_NS).expect("legal")
}

fn transmitted(client: &mut RtdeClient) -> Vec<u8> {
    let mut out = [0; 1024];
    let count = client.poll_transmit(Nanos(0), &mut out);
    out[..count].to_vec()
}

fn running() -> RtdeClient {
    let mut client = client();
    for answer in answers() {
        assert!(!transmitted(&mut client).is_empty());
        client.handle_bytes(Nanos(0), &answer).expect("a good answer");
    }
    assert!(matches!(client.poll_event(), Some(Event::Running { controller }) if controller.minor == 11));
    client
}

#[test]
fn requests_go_out_one_at_a_time_as_the_protocol_wants_them() {
    let mut client = client();
    let outputs = "timestamp,actual_q,actual_qd,target_q,actual_TCP_pose,runtime_state,robot_mode,output_int_register_0,\
         input_int_register_0,\
                   safety_status_bits";
    let inputs = "input_double_register_0,input_double_register_1,input_double_register_2,input_double_register_3,\
                  input_double_register_4,input_double_register_5,input_int_register_0";
    let expected = [
        b"\x00\x05V\x00\x02".to_vec(),
        b"\x00\x03v".to_vec(),
        package(b'O', &[&500_f64.to_be_bytes(), outputs.as_bytes()].concat()),
        package(b'I', inputs.as_bytes()),
        b"\x00\x03S".to_vec(),
    ];
    for (request, answer) in expected.into_iter().zip(answers()) {
        assert_eq!(transmitted(&mut client), request);
        assert_eq!(transmitted(&mut client), b"");
        client.handle_bytes(Nanos(0), &answer).expect("a good answer");
    }
    assert_eq!(client.phase(), Phase::Running);
    let joints = JointPos([1.0, 0.0, 0.0, 0.0, 0.0, -0.5]);
    assert_eq!(client.send_setpoint(258, &joints), Err(LinkError::NoState));
    client.handle_bytes(Nanos(0), &data(&RobotState { actual_q: joints, ..state(0) })).expect("sound");
    client.send_setpoint(258, &joints).expect("where it is");
    let mut setpoint = b"\x00\x38U\x02\x3f\xf0".to_vec();
    setpoint.extend([0; 38]);
    setpoint.extend(b"\xbf\xe0\0\0\0\0\0\0\0\0\x01\x02");
    assert_eq!(transmitted(&mut client), setpoint);
}

#[test]
fn states_survive_every_split_and_only_the_newest_is_told() {
    let stream: Vec<u8> = (0..3).flat_map(|cycle| data(&state(cycle))).collect();
    for split in 0..=stream.len() {
        let mut client = running();
        let (head, tail) = stream.split_at(split);
        client.handle_bytes(Nanos(0), head).expect("sound");
        client.handle_bytes(Nanos(0), tail).expect("sound");
        assert_eq!(client.poll_event(), Some(Event::State { state: state(2), skipped: 2 }));
        assert_eq!(client.poll_event(), None);
    }
}

#[test]
fn a_flipped_byte_of_size_or_type_is_an_error_and_the_client_stays_failed() {
    let sound = data(&state(1));
    for place in 0..3 {
        for flip in 1..=255_u8 {
            let mut client = running();
            client.handle_bytes(Nanos(0), &data(&state(0))).expect("sound");
            let mut broken = sound.clone();
            broken[place] ^= flip;
            let error = client.handle_bytes(Nanos(0), &broken).expect_err("a broken header");
            let text = place == 2 && broken[2] == b'M';
            let right = match error {
                LinkError::BadSize { kind: PackageKind::Data, .. } => place < 2,
                LinkError::UnknownPackage { code } => place == 2 && code == broken[2],
                LinkError::UnexpectedPackage { .. } => place == 2 && !text,
                LinkError::Malformed { kind: PackageKind::Text } => text,
                _ => false,
            };
            assert!(right, "byte {place} ^ {flip}: {error}");
            assert_eq!(client.handle_bytes(Nanos(0), &sound), Err(error));
            assert_eq!(client.send_setpoint(1, &state(0).actual_q), Err(error));
            assert!(!std::iter::from_fn(|| client.poll_event()).any(|event| matches!(event, Event::State { .. })));
        }
    }
}

#[test]
fn a_package_cut_short_is_an_error_and_never_a_state() {
    let sound = data(&state(1));
    for lost in 1..sound.len() {
        let mut client = running();
        let mut stream = sound[..sound.len() - lost].to_vec();
        for cycle in 2..5 {
            stream.extend(data(&state(cycle)));
        }
        client.handle_bytes(Nanos(0), &stream).expect_err("a lost border");
        assert_eq!(client.poll_event(), None, "{lost} bytes lost");
    }
}

#[test]
fn silence_and_half_a_package_are_told_apart() {
    let mut client = running();
    let now = Nanos(5_000);
    client.handle_bytes(now, &data(&state(0))).expect("sound");
    assert_eq!(client.poll_timeout(), Some(now.plus(TIMEOUT_NS)));
    assert_eq!(client.handle_timeout(now.plus(TIMEOUT_NS - 1)), Ok(()));
    let waited_ns = TIMEOUT_NS;
    let silent = LinkError::Silent { waited_ns, phase: Phase::Running };
    assert_eq!(client.handle_timeout(now.plus(TIMEOUT_NS)), Err(silent));

    let mut client = running();
    client.handle_bytes(now, &data(&state(0))).expect("sound");
    // Bytes that trickle do not count as life.
    for (after, byte) in (1_000_000..).step_by(1_000_000).zip(&data(&state(1))[..50]) {
        client.handle_bytes(now.plus(after), &[*byte]).expect("not yet wrong");
    }
    let incomplete = LinkError::Incomplete { received: 50, size: 224, waited_ns };
    assert_eq!(client.handle_timeout(now.plus(TIMEOUT_NS)), Err(incomplete));
    assert!(incomplete.to_string().contains("50 bytes of a package of 224"), "{incomplete}");
    assert_eq!(client.handle_closed(), incomplete);
}

#[test]
fn a_robot_that_does_not_answer_is_noticed_in_every_phase_after_a_second_and_in_operation_after_the_time_out() {
    const ANSWER_NS: u64 = 1_000_000_000;
    for answered in 0..5 {
        let mut client = client();
        assert_eq!(client.poll_timeout(), None);
        for answer in answers().iter().take(answered) {
            transmitted(&mut client);
            client.handle_bytes(Nanos(0), answer).expect("a good answer");
        }
        let mut out = [0; 1024];
        assert!(client.poll_transmit(Nanos(7), &mut out) > 0);
        assert_eq!(client.poll_timeout(), Some(Nanos(7 + ANSWER_NS)));
        assert_eq!(client.handle_timeout(Nanos(7 + ANSWER_NS - 1)), Ok(()));
        let phase = client.phase();
        let error = client.handle_timeout(Nanos(7 + ANSWER_NS));
        assert_eq!(error, Err(LinkError::Silent { waited_ns: ANSWER_NS, phase }));
    }
    // From the answer to the start on, states have to come.
    let mut client = running();
    assert_eq!(client.poll_timeout(), Some(Nanos(TIMEOUT_NS)));
    let silent = LinkError::Silent { waited_ns: TIMEOUT_NS, phase: Phase::Running };
    assert_eq!(client.handle_timeout(Nanos(TIMEOUT_NS)), Err(silent));
    // Whoever allows for longer silences does so for answers too.
    let mut patient = RtdeClient::new(&UR10E, 500, 0, 3 * ANSWER_NS).expect("legal");
    assert!(!transmitted(&mut patient).is_empty());
    assert_eq!(patient.poll_timeout(), Some(Nanos(3 * ANSWER_NS)));
}

#[test]
fn impossible_values_are_named() {
    let good = state(1);
    let mut cases: Vec<(&str, u8, RobotState)> = Vec::new();
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 6.5, -100.0] {
        let q = |joint: usize| {
            let mut q = good.actual_q;
            q.0[joint] = wrong;
            q
        };
        cases.push(("actual_q", 3, RobotState { actual_q: q(3), ..good }));
        cases.push(("target_q", 5, RobotState { target_q: q(5), ..good }));
        cases.push(("actual_qd", 0, RobotState { actual_qd: JointVel(q(0).0), ..good }));
        cases.push(("actual_TCP_pose", 1, RobotState { actual_tcp_pose: q(1).0, ..good }));
    }
    cases.push(("timestamp", 0, RobotState { timestamp: f64::NAN, ..good }));
    cases.push(("timestamp", 0, RobotState { timestamp: -1.0, ..good }));
    cases.push(("timestamp step", 0, RobotState { timestamp: state(0).timestamp, ..good }));
    cases.push(("timestamp step", 0, RobotState { timestamp: state(0).timestamp + 11.0, ..good }));
    let mut jumped = good;
    jumped.actual_q.0[1] += 0.01;
    cases.push(("actual_q step", 1, jumped));
    for (field, element, wrong) in cases {
        let mut client = running();
        client.handle_bytes(Nanos(0), &data(&state(0))).expect("sound");
        match client.handle_bytes(Nanos(0), &data(&wrong)) {
            Err(LinkError::ImpossibleValue { field: named, element: at, .. }) => {
                assert_eq!((named, at), (field, element))
            }
            other => panic!("{field} of {wrong:?}: {other:?}"),
        }
    }
    // The same jump over a longer time is possible.
    let mut client = running();
    client.handle_bytes(Nanos(0), &data(&state(0))).expect("sound");
    jumped.timestamp += 0.05;
    client.handle_bytes(Nanos(0), &data(&jumped)).expect("possible");
}

#[test]
fn states_of_newer_software_are_no_error_and_no_readiness() {
    let good = state(1);
    let newer = [
        RobotState { runtime_state: 6, ..good },
        RobotState { robot_mode: 9, ..good },
        RobotState { robot_mode: -2, ..good },
        RobotState { safety_status_bits: 1 | 1 << 12, ..good },
        RobotState { safety_status_bits: 1 << 31, ..good },
    ];
    for newer in newer {
        let mut client = running();
        client.handle_bytes(Nanos(0), &data(&state(0))).expect("sound");
        client.handle_bytes(Nanos(0), &data(&newer)).expect("possible");
        let told = client.poll_told();
        let Some(link::Event::Telegram { telegram, skipped: 1 }) = told else { panic!("{told:?}") };
        let why = telegram.not_ready.expect("nobody knows what it means");
        assert!(why.to_string().contains("does not know"), "{why}");
        client.handle_bytes(Nanos(0), &data(&state(2))).expect("sound");
        let told = client.poll_told();
        assert!(
            matches!(told, Some(link::Event::Telegram { telegram, .. }) if telegram.not_ready.is_none()),
            "{told:?}"
        );
    }
}

const OLD: ControllerVersion = ControllerVersion { major: 3, minor: 15, bugfix: 0, build: 1 };
const NEW: Option<ControllerVersion> = Some(ControllerVersion { major: 5, minor: 11, bugfix: 6, build: 1 });

fn field(name: &str, kind: Option<wire::FieldType>) -> Field {
    Field { name: wire::ShortText::cut(name.as_bytes()), kind: kind.expect("a field of the guide"), line: 0 }
}

fn output(name: &str) -> Field {
    field(name, fields::output(name))
}

fn input(name: &str) -> Field {
    field(name, fields::input(name))
}

#[test]
fn every_refusal_in_the_negotiation_has_its_error() {
    let outputs = |types: &str| package(b'O', &[b"\x01", types.as_bytes()].concat());
    let inputs = |types: &str| package(b'I', &[b"\x01", types.as_bytes()].concat());
    let good = "DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,UINT32,INT32,INT32,INT32,UINT32";
    let old = [3_u32, 15, 0, 1].map(u32::to_be_bytes).concat();
    let cases = [
        (1, package(b'v', &old), LinkError::RateTooHigh { controller: OLD, rate_hz: 500 }),
        (
            2,
            outputs(&good.replace("VECTOR6D,UINT32", "NOT_FOUND,UINT32")),
            LinkError::FieldNotFound { field: output("actual_TCP_pose"), controller: NEW },
        ),
        (
            2,
            outputs(&good.replacen("DOUBLE", "INT32", 1)),
            LinkError::WrongType { field: output("timestamp"), found: wire::ShortText::cut(b"INT32") },
        ),
        (2, outputs("DOUBLE"), LinkError::Malformed { kind: PackageKind::SetupOutputs }),
        (2, outputs(&format!("{good},DOUBLE")), LinkError::Malformed { kind: PackageKind::SetupOutputs }),
        (
            3,
            inputs("DOUBLE,IN_USE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,INT32"),
            LinkError::InUse { field: input("input_double_register_1"), used: 1, of: 7 },
        ),
        (
            3,
            inputs("DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,NOT_FOUND"),
            LinkError::FieldNotFound { field: input("input_int_register_0"), controller: NEW },
        ),
        (4, package(b'S', &[0]), LinkError::StartRefused),
        (0, package(b'S', &[1]), LinkError::UnexpectedPackage { kind: PackageKind::Start, phase: Phase::Version }),
    ];
    for (answered, wrong, expected) in cases {
        let mut client = client();
        for answer in answers().iter().take(answered) {
            client.handle_bytes(Nanos(0), answer).expect("a good answer");
        }
        assert_eq!(client.handle_bytes(Nanos(0), &wrong), Err(expected));
    }
    assert_eq!(RtdeClient::new(&UR10E, 250, 0, 1).err(), Some(LinkError::BadRate { rate_hz: 250 }));
    assert_eq!(RtdeClient::new(&UR10E, 125, 12, 1).err(), Some(LinkError::BadOffset { offset: 12 }));
}

#[test]
fn data_of_another_recipe_is_refused_and_data_before_the_start_is_not() {
    let mut wrong = data(&state(0));
    wrong[3] = 2;
    assert_eq!(running().handle_bytes(Nanos(0), &wrong), Err(LinkError::UnknownRecipe { id: 2, expected: 1 }));
    let mut client = client();
    for answer in &answers()[..4] {
        client.handle_bytes(Nanos(0), answer).expect("a good answer");
    }
    client.handle_bytes(Nanos(0), &data(&state(0))).expect("data may overtake the answer to the start");
    assert_eq!(client.poll_event(), None);
    client.handle_bytes(Nanos(0), &answers()[4]).expect("a good answer");
    assert!(matches!(client.poll_event(), Some(Event::Running { .. })));
}

#[test]
fn setpoints_are_refused_where_they_must_be() {
    let good = state(0).actual_q;
    assert_eq!(client().send_setpoint(1, &good), Err(LinkError::NotRunning { phase: Phase::Version }));
    let mut client = running();
    for wrong in [f64::NAN, f64::INFINITY, 6.3] {
        let mut setpoint = good;
        setpoint.0[4] = wrong;
        let error = client.send_setpoint(1, &setpoint).expect_err("a setpoint out of range");
        assert!(matches!(error, LinkError::ImpossibleSetpoint { joint: 4, .. }));
    }
    assert!(matches!(client.send_setpoint(1, &JointPos::ZERO), Err(LinkError::ImpossibleSetpoint { joint: 0, .. })));
    client.handle_bytes(Nanos(0), &data(&state(0))).expect("sound");
    let mut far = good;
    far.0[1] += 0.01;
    let refused = client.send_setpoint(1, &far).expect_err("5 rad/s");
    assert!(matches!(refused, LinkError::StepTooLarge { joint: 1, within: 0.002, .. }), "{refused}");
    assert_eq!(transmitted(&mut client), b"", "nothing is queued");
    let mut queued = 0;
    while client.send_setpoint(queued, &good).is_ok() {
        queued += 1;
    }
    assert_eq!(client.send_setpoint(queued, &good), Err(LinkError::TransmitFull));
    assert_eq!(transmitted(&mut client).len(), queued as usize * recipe::INPUT_PACKAGE_SIZE);
    client.send_setpoint(queued, &good).expect("room again");
}

#[test]
fn texts_are_told_in_order_and_counted_when_nobody_listens() {
    let mut client = running();
    let text = |n: u8| package(b'M', &[b"\x05error".as_slice(), b"\x01", &[b'0' + n], &[1]].concat());
    for n in 0..6 {
        client.handle_bytes(Nanos(0), &text(n)).expect("sound");
    }
    for n in 0..4_u8 {
        match client.poll_event() {
            Some(Event::Text { text, lost }) => {
                assert_eq!((text.level, lost), (TextLevel::Error, if n == 0 { 2 } else { 0 }));
                assert_eq!((text.message.to_string(), text.source.as_bytes()), ("error".to_owned(), &[b'0' + n][..]));
            }
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(client.poll_event(), None);
}

#[test]
fn random_and_mutated_bytes_never_panic_the_client() {
    let mut random = 0x5eed_0003_u64;
    let mut next = move || {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random
    };
    let mut seeds: Vec<Vec<u8>> = answers().to_vec();
    seeds.push(package(b'M', b"\x05error\x01x\x01"));
    seeds.push(data(&state(0)));
    let mut out = [0; 256];
    let mut errors = 0;
    for _ in 0..200_000 {
        let mut client = client();
        let answered = (next() % 6) as usize;
        for answer in seeds.iter().take(answered) {
            client.handle_bytes(Nanos(0), answer).expect("a good answer");
        }
        let mut bytes = seeds[(next() % seeds.len() as u64) as usize].clone();
        for _ in 0..next() % 3 {
            let place = (next() % bytes.len() as u64) as usize;
            bytes[place] = next() as u8;
        }
        if next() % 8 == 0 {
            bytes = (0..next() % 64).map(|_| next() as u8).collect();
        }
        let split = (next() % (bytes.len() as u64 + 1)) as usize;
        for part in [&bytes[..split], &bytes[split..]] {
            errors += u32::from(client.handle_bytes(Nanos(next() >> 20), part).is_err());
        }
        while client.poll_event().is_some() {}
        while client.poll_transmit(Nanos(next() >> 20), &mut out) > 0 {}
        let _ = client.handle_timeout(Nanos(next()));
    }
    assert!(errors > 10_000, "{errors}");
}

#[test]
fn program_parameters_outside_their_range_are_named() {
    let watchdog_action = WatchdogAction::Stop;
    let good =
        Program { rate_hz: 125, register_offset: 24, lookahead: 0.1, gain: 300.0, watchdog: 0.5, watchdog_action };
    let text = good.text().expect("legal");
    assert!(text.contains("servoj(setpoint, 0, 0, 0.008, 0.1, 300)"), "{text}");
    assert!(text.contains("rtde_set_watchdog(\"input_int_register_24\", 2, \"stop\")"), "{text}");
    assert!(text.contains("read_input_float_register(29)"), "{text}");
    assert!(text.contains("write_output_integer_register(24, 1)"), "{text}");
    assert!(text.contains("write_output_integer_register(25, cycles)"), "{text}");
    let cases = [
        ("lookahead", Program { lookahead: 0.02, ..good }),
        ("lookahead", Program { lookahead: f64::NAN, ..good }),
        ("gain", Program { gain: 2001.0, ..good }),
        ("watchdog", Program { watchdog: 0.0, ..good }),
        ("register_offset", Program { register_offset: 1, ..good }),
        ("rate_hz", Program { rate_hz: 100, ..good }),
    ];
    for (wrong, program) in cases {
        match program.text() {
            Err(ProgramError::OutOfRange { name, .. } | ProgramError::NeitherOf { name, .. }) => {
                assert_eq!(name, wrong)
            }
            Ok(_) => panic!("{wrong} accepted"),
        }
    }
}

#[test]
fn after_a_restart_everything_is_agreed_anew_also_by_another_protocol() {
    let mut client = running();
    client.handle_bytes(Nanos(0), &data(&state(5))).expect("sound");
    client.handle_bytes(Nanos(0), b"\x00\x03Z\x00").expect_err("an unknown package");
    client.restart();
    assert_eq!((client.phase(), client.poll_event(), client.poll_timeout()), (Phase::Version, None, None));
    assert_eq!(transmitted(&mut client), b"\x00\x05V\x00\x02");
    client.handle_bytes(Nanos(0), &package(b'V', &[0])).expect("refused");
    assert_eq!(transmitted(&mut client), b"\x00\x05V\x00\x01");
    client.restart();
    for answer in answers() {
        assert!(!transmitted(&mut client).is_empty());
        client.handle_bytes(Nanos(0), &answer).expect("a good answer");
    }
    assert!(matches!(client.poll_event(), Some(Event::Running { .. })));
    // The controller's time began anew, too, and the robot is somewhere else.
    let mut moved = state(0);
    moved.actual_q.0[0] += 1.0;
    client.handle_bytes(Nanos(0), &data(&moved)).expect("nothing is compared with what was before");
    assert_eq!(client.poll_event(), Some(Event::State { state: moved, skipped: 0 }));
}

#[test]
fn a_fresh_connection_is_agreed_on_anew_and_knows_nothing_of_the_one_before() {
    let mut client = running();
    client.handle_bytes(Nanos(0), &data(&state(900))).expect("sound");
    client.send_setpoint(1, &state(900).actual_q).expect("where it is");
    client.handle_bytes(Nanos(0), &data(&state(901))[..100]).expect("half a package");
    let error = client.handle_closed();
    assert_eq!(client.handle_bytes(Nanos(0), &data(&state(902))), Err(error));
    for _ in 0..2 {
        client.restart();
        assert_eq!((client.phase(), client.poll_event(), client.poll_timeout()), (Phase::Version, None, None));
        assert_eq!(client.send_setpoint(2, &state(0).actual_q), Err(LinkError::NotRunning { phase: Phase::Version }));
        for answer in answers() {
            assert!(!transmitted(&mut client).is_empty());
            client.handle_bytes(Nanos(0), &answer).expect("a good answer");
        }
        assert!(matches!(client.poll_event(), Some(Event::Running { .. })));
        assert_eq!(transmitted(&mut client), b"", "the setpoint of before is gone");
        // The controller's time has begun anew, and the arm is somewhere else: both are as good as any.
        let mut other = state(0);
        other.actual_q.0[1] = 0.5;
        client.handle_bytes(Nanos(0), &data(&other)).expect("nothing to compare with");
        assert_eq!(client.poll_event(), Some(Event::State { state: other, skipped: 0 }));
        assert!(matches!(client.send_setpoint(2, &state(0).actual_q), Err(LinkError::StepTooLarge { joint: 1, .. })));
        client.send_setpoint(2, &other.actual_q).expect("where it is");
    }
}
