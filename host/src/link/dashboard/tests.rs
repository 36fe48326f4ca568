use super::*;
use crate::robot::sample::Random;

const HELLO: &[u8] = b"Connected: Universal Robots Dashboard Server\n";

/// What a client that asked makes of these bytes, split into pieces of `chunk`.
fn answered<T>(request: &Request<T>, bytes: &[u8], chunk: usize) -> Result<Option<T>, DashboardError> {
    let mut client = Dashboard::default();
    client.ask(request).unwrap();
    for bytes in HELLO.chunks(chunk).chain(bytes.chunks(chunk)) {
        client.handle_bytes(bytes);
    }
    client.take_answer(request)
}

fn is_read<T: PartialEq + std::fmt::Debug>(request: &Request<T>, line: &str, answer: T) {
    let answer = Ok(Some(answer));
    for chunk in [1, 2, 7, 1000] {
        assert_eq!(answered(request, format!("{line}\r\n").as_bytes(), chunk), answer, "{line} in pieces of {chunk}");
    }
}

/// Lines as the maker's pages and real controllers have them.
#[test]
fn answers_are_read_as_controllers_give_them() {
    is_read(&ROBOT_MODE, "Robotmode: POWER_OFF", RobotMode::PowerOff);
    is_read(&ROBOT_MODE, "Robotmode: RUNNING", RobotMode::Running);
    is_read(&SAFETY_STATUS, "Safetystatus: PROTECTIVE_STOP", Safety::ProtectiveStop);
    is_read(&SAFETY_MODE, "Safetymode: NORMAL", Safety::Normal);
    is_read(&PROGRAM_STATE, "PLAYING screed.urp", (ProgramState::Playing, "screed.urp".to_owned()));
    is_read(&PROGRAM_STATE, "STOPPED my wall.urp", (ProgramState::Stopped, "my wall.urp".to_owned()));
    is_read(&MODEL, "UR10", "UR10".to_owned());
    is_read(&SERIAL, "20195500123", "20195500123".to_owned());
    is_read(&VERSION, "URSoftware 5.11.6.1010 (Mar 01 2022)", [5, 11, 6, 1010]);
    is_read(&VERSION, "3.14.3.0 (Dec 01 2020)", [3, 14, 3, 0]);
    is_read(&VERSION, "URSoftware 5.9.4 (x)", [5, 9, 4, 0]);
    is_read(&REMOTE_CONTROL, "true", true);
    is_read(&REMOTE_CONTROL, "False", false);
    for (request, line) in [
        (POWER_ON, "Powering on"),
        (POWER_OFF, "Powering off"),
        (BRAKE_RELEASE, "Brake releasing"),
        (UNLOCK, "Protective stop releasing"),
        (PLAY, "Starting program"),
        (STOP, "Stopped"),
        (CLOSE_POPUP, "closing popup"),
        (CLOSE_SAFETY_POPUP, "closing safety popup"),
    ] {
        is_read(&request, line, ());
    }
}

fn refused<T: PartialEq + std::fmt::Debug>(request: &Request<T>, line: &str) -> DashboardError {
    answered(request, format!("{line}\n").as_bytes(), 3).expect_err(line)
}

#[test]
fn refusals_and_nonsense_are_told_apart() {
    let early = "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop";
    for (request, line) in [(PLAY, "Failed to execute: play"), (UNLOCK, early), (STOP, "Starting program")] {
        let answer = line.to_owned();
        assert_eq!(refused(&request, line), DashboardError::Refused { request: request.line, answer });
    }
    let unknown = refused(&MODEL, "could not understand: 'get robot model'");
    assert_eq!(unknown, DashboardError::NotKnown { request: "get robot model" });
    let unexpected = |error: DashboardError| assert!(matches!(error, DashboardError::Unexpected { .. }), "{error}");
    unexpected(refused(&ROBOT_MODE, "Robotmode: DANCING"));
    unexpected(refused(&ROBOT_MODE, "Safetymode: NORMAL"));
    unexpected(refused(&SERIAL, "no serial"));
    unexpected(refused(&VERSION, "URSoftware 5.x.1"));
    unexpected(refused(&REMOTE_CONTROL, "maybe"));
}

#[test]
fn a_stranger_an_endless_line_a_word_too_many_and_an_end_fail_for_good() {
    let mut stranger = Dashboard::default();
    stranger.ask(&PLAY).unwrap();
    stranger.handle_bytes(b"220 mail server\n");
    assert_eq!(stranger.poll_transmit(&mut [0; 100]), 0, "nothing is said to a stranger");
    let found = "220 mail server".to_owned();
    assert_eq!(stranger.take_answer(&PLAY), Err(DashboardError::Stranger { found: found.clone() }));
    assert_eq!(stranger.ask(&STOP), Err(DashboardError::Stranger { found }));

    let mut endless = Dashboard::default();
    for _ in 0..10_000 {
        endless.handle_bytes(&[b'x'; 1000]);
        assert!(endless.inbox.len() <= LINE_MAX);
    }
    assert_eq!(endless.take_answer(&PLAY), Err(DashboardError::TooLong));

    let mut talkative = Dashboard::default();
    talkative.handle_bytes(HELLO);
    talkative.handle_bytes(b"\nhello\n");
    assert_eq!(talkative.take_answer(&PLAY), Err(DashboardError::Unasked { found: "hello".to_owned() }));

    let mut ended = Dashboard::default();
    ended.handle_bytes(HELLO);
    ended.ask(&PLAY).unwrap();
    assert_eq!(ended.ask(&STOP), Err(DashboardError::Busy { request: "play" }));
    let mut out = [0; 100];
    let count = ended.poll_transmit(&mut out);
    assert_eq!(&out[..count], b"play\n");
    ended.handle_closed();
    assert_eq!(ended.take_answer(&PLAY), Err(DashboardError::Closed));
}

#[test]
fn no_bytes_make_it_panic_or_grow() {
    let mut random = Random::new(71);
    let texts: Vec<&[u8]> =
        vec![b"Robotmode: RUNNING\n", b"PLAYING x\n", b"URSoftware 5.11.6.1 (a)\n", b"\xff\xfe\n", b"true\n"];
    for round in 0..20_000 {
        let mut client = Dashboard::default();
        client.handle_bytes(HELLO);
        for _ in 0..4 {
            let _ = client.ask(&PROGRAM_STATE);
            let mut bytes = texts[random.between(0.0, texts.len() as f64) as usize].to_vec();
            let place = random.between(0.0, bytes.len() as f64) as usize;
            match round % 3 {
                0 => bytes[place] = random.between(0.0, 256.0) as u8,
                1 => _ = bytes.remove(place),
                _ => bytes.insert(place, random.between(0.0, 256.0) as u8),
            }
            client.handle_bytes(&bytes);
            match round % 4 {
                0 => _ = client.take_answer(&ROBOT_MODE),
                1 => _ = client.take_answer(&PROGRAM_STATE),
                2 => _ = client.take_answer(&VERSION),
                _ => _ = client.take_answer(&REMOTE_CONTROL),
            }
            assert!(client.inbox.len() <= LINE_MAX);
        }
    }
}
