use super::*;
use crate::config::Cell;
use crate::robot::sample::Random;
use crate::sim::ur::robot::Generation;
use crate::sim::ur::streams::{Port, Stream};
use crate::sim::ur::{Controller, Options};
use screed_kernel::arms::ur::UR10E;

/// What a simulated controller sends in its first second.
fn greeting(generation: Generation) -> Vec<u8> {
    let program = "def test():\n  while True:\n    sync()\n  end\nend\n".to_owned();
    let options = Options { generation, ..Options::of(&Cell::demo(125).unwrap(), program) };
    let mut robot = Controller::new(&UR10E, options).unwrap();
    let (mut stream, mut bytes) = (Stream::new(Port::Primary), Vec::new());
    for _ in 0..generation.cycle_rate() {
        robot.step();
        robot.feed(&mut stream);
        let mut out = [0; 4096];
        let count = stream.poll_transmit(&mut out);
        bytes.extend_from_slice(&out[..count]);
    }
    bytes
}

fn package(kind: u8, content: &[u8]) -> Vec<u8> {
    let size = (content.len() + HEADER_LEN) as u32;
    [&size.to_be_bytes()[..], &[kind], content].concat()
}

/// A message by hand, byte by byte as the maker's page lists it.
fn message(kind: u8, content: &[u8]) -> Vec<u8> {
    package(ROBOT_MESSAGE, &[&[0, 0, 0, 0, 0, 0, 0, 1, 254, kind], content].concat())
}

fn judged(reader: &Primary) {
    let kinematics = reader.kinematics().unwrap();
    assert_eq!(kinematics.a, UR10E.dh.map(|row| row.a));
    assert_eq!(kinematics.d, UR10E.dh.map(|row| row.d));
    assert_eq!(kinematics.theta, [0.0; 6]);
    assert!((kinematics.alpha[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
}

#[test]
fn a_controllers_first_second_is_read_however_it_is_split() {
    for generation in [Generation::ESeries, Generation::Cb3] {
        let bytes = greeting(generation);
        // The first packages split at every byte, and everything in pieces.
        for split in 0..=900 {
            let mut reader = Primary::default();
            let (head, rest) = bytes.split_at(split);
            reader.handle_bytes(head).unwrap();
            reader.handle_bytes(rest).unwrap();
            judged(&reader);
        }
        for chunk in [1, 3, 64] {
            let mut reader = Primary::default();
            bytes.chunks(chunk).for_each(|bytes| reader.handle_bytes(bytes).unwrap());
            judged(&reader);
        }
    }
}

#[test]
fn messages_for_a_person_come_in_order_and_old_ones_go() {
    let mut reader = Primary::default();
    let exception = [&[0, 0, 0, 7, 0, 0, 0, 3][..], b"compile_error_name_not_found:servoi:"].concat();
    let key = [&[0, 0, 0, 153, 0, 0, 0, 2, 8][..], b"Stopped\0Position deviates\x07"].concat();
    let code = [0, 0, 0, 50, 0, 0, 0, 80, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0];
    for bytes in [message(RUNTIME_EXCEPTION, &exception), message(KEY, &key), message(ERROR_CODE, &code)] {
        reader.handle_bytes(&bytes).unwrap();
    }
    // Types that are not read, in packages and messages.
    reader.handle_bytes(&message(9, b"popup")).unwrap();
    reader.handle_bytes(&package(25, &[0; 300])).unwrap();
    let told: Vec<_> = std::iter::from_fn(|| reader.poll_message()).map(|m| (m.is_exception, m.text)).collect();
    assert_eq!(told[0], (true, "line 7, column 3: compile_error_name_not_found:servoi:".to_owned()));
    assert_eq!(told[1], (false, "C153A2 Stopped: Position deviates".to_owned()));
    assert_eq!(told[2], (true, "C50A80".to_owned()));
    assert_eq!(told.len(), 3);
    for number in 0..1000 {
        reader.handle_bytes(&message(TEXT, format!("line {number}").as_bytes())).unwrap();
    }
    assert_eq!(reader.messages.len(), MESSAGES_MAX);
    assert_eq!(reader.poll_message().unwrap().text, "line 968");
}

#[test]
fn what_is_no_package_is_refused_and_stays_refused() {
    let bad_size = |size: u32| Err(PrimaryError::BadSize { size });
    for size in [0, 4, PACKAGE_MAX + 1, u32::MAX] {
        let mut reader = Primary::default();
        let bytes = [&size.to_be_bytes()[..], &[99]].concat();
        assert_eq!(reader.handle_bytes(&bytes), bad_size(size));
        assert_eq!(reader.handle_bytes(&[]), bad_size(size));
    }
    // One whose content would be kept may be smaller only.
    let large = (KEPT_MAX + HEADER_LEN + 1) as u32;
    let bytes = [&large.to_be_bytes()[..], &[ROBOT_STATE]].concat();
    assert_eq!(Primary::default().handle_bytes(&bytes), bad_size(large));

    let malformed = |kind, what| Err(PrimaryError::Malformed { kind, what });
    let state = |kind, content: &[u8]| package(ROBOT_STATE, &package(kind, content));
    let mut kinematics = [0; 220];
    kinematics[24..32].copy_from_slice(&f64::NAN.to_be_bytes());
    for (bytes, error) in [
        (state(KINEMATICS, &[0; 219]), malformed(ROBOT_STATE, "kinematics")),
        (state(KINEMATICS, &kinematics), malformed(ROBOT_STATE, "kinematics")),
        (package(ROBOT_STATE, &[0, 0, 0, 9, 1]), malformed(ROBOT_STATE, "parts")),
        (package(ROBOT_STATE, &[0, 0, 0, 4, 1]), malformed(ROBOT_STATE, "parts")),
        (message(KEY, &[0; 8]), malformed(ROBOT_MESSAGE, "message")),
        (package(ROBOT_MESSAGE, &[0; 9]), malformed(ROBOT_MESSAGE, "type")),
    ] {
        assert_eq!(Primary::default().handle_bytes(&bytes), error, "{bytes:?}");
    }
}

#[test]
fn a_large_package_that_is_not_read_takes_no_memory() {
    let mut reader = Primary::default();
    let bytes = package(25, &vec![1; PACKAGE_MAX as usize - HEADER_LEN]);
    for bytes in bytes.chunks(1000) {
        reader.handle_bytes(bytes).unwrap();
        assert_eq!(reader.content.capacity(), 0);
    }
    reader.handle_bytes(&greeting(Generation::ESeries)).unwrap();
    judged(&reader);
}

#[test]
fn no_bytes_make_it_panic_or_grow() {
    let (sound, mut random) = (greeting(Generation::ESeries), Random::new(72));
    let (mut read, mut refused) = (0_u32, 0_u32);
    for _ in 0..20_000 {
        let mut bytes = sound[..1100].to_vec();
        for _ in 0..random.between(1.0, 4.0) as u32 {
            let place = random.between(0.0, bytes.len() as f64) as usize;
            match random.between(0.0, 4.0) as u32 {
                0 => bytes[place] = random.between(0.0, 256.0) as u8,
                1 => bytes[place] ^= 1 << random.between(0.0, 8.0) as u32,
                2 => bytes.truncate(place.max(1)),
                _ => bytes.insert(place, random.between(0.0, 256.0) as u8),
            }
        }
        let mut reader = Primary::default();
        let split = random.between(0.0, bytes.len() as f64) as usize;
        let (head, rest) = bytes.split_at(split);
        match reader.handle_bytes(head).and_then(|()| reader.handle_bytes(rest)) {
            Ok(()) => read += 1,
            Err(_) => refused += 1,
        }
        assert!(reader.content.capacity() <= 2 * KEPT_MAX && reader.messages.len() <= MESSAGES_MAX);
        if let Some(kinematics) = reader.kinematics() {
            assert!(kinematics.d.iter().all(|value| value.is_finite()));
        }
    }
    assert!(read > 500 && refused > 500, "{read} read, {refused} refused");
}
