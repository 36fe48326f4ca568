use super::*;
use crate::sim::extruder::Extruder;

const FLOW_MAX: f64 = 1e-4;
const TIMEOUT_NS: u64 = 300_000_000;
const MS: u64 = 1_000_000;

fn line() -> ExtruderLine {
    ExtruderLine::new(FLOW_MAX, TIMEOUT_NS).expect("a sound maximum")
}

/// Knuth's MMIX generator.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % bound
    }
}

/// Both ends in virtual time, 2 ms a cycle, on a wire that `damage` may change.
fn run(
    line: &mut ExtruderLine,
    extruder: &mut Extruder,
    cycles: std::ops::Range<u64>,
    mut each: impl FnMut(u64, &mut ExtruderLine),
    mut damage: impl FnMut(&mut Vec<u8>),
) -> Result<(), ExtruderError> {
    for cycle in cycles {
        let now = Nanos(cycle * 2 * MS);
        let mut buffer = [0; 64];
        let count = extruder.poll_transmit(&mut buffer);
        let mut bytes = buffer.get(..count).unwrap_or_default().to_vec();
        damage(&mut bytes);
        line.handle_bytes(now, &bytes)?;
        line.handle_timeout(now)?;
        each(cycle, line);
        let count = line.poll_transmit(now, &mut buffer);
        let mut bytes = buffer.get(..count).unwrap_or_default().to_vec();
        damage(&mut bytes);
        extruder.handle_bytes(&bytes);
        extruder.step(0.002);
    }
    Ok(())
}

fn nothing(_: &mut Vec<u8>) {}

#[test]
fn lines_are_as_the_manual_says() {
    // The check value of CRC-16/IBM-3740 in the catalogue of parametrised CRC algorithms is 29B1.
    assert_eq!(crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(b"123456789"), 0x29B1);
    // The two lines of docs/extruder.md; their checksums come from another implementation (Python's binascii.crc_hqx).
    let command = Command { seq: 17, flow_nl_s: 21_600_000 };
    assert_eq!(command.encode().bytes(), b"F 17 21600000*FE1B\n");
    let answer = Answer { seq: 17, flow_nl_s: 20_950_123, fault: DeviceFault::None };
    assert_eq!(answer.encode().bytes(), b"A 17 20950123 0*8E99\n");
    let longest = Answer { seq: u32::MAX, flow_nl_s: u32::MAX, fault: DeviceFault::Drive };
    assert_eq!(longest.encode().bytes().len(), 31);
    assert_eq!(Answer::decode(longest.encode().bytes().trim_ascii_end()), Some(longest));
    for bad in ["", "F", "F 17 21600000", "F 17 21600000*fe1b", "F 17 21600000*+E1B", "A 17 20950123*0000"] {
        assert_eq!((Command::decode(bad.as_bytes()), Answer::decode(bad.as_bytes())), (None, None), "{bad}");
    }
}

#[test]
fn up_to_two_flipped_bits_in_a_line_are_noticed() {
    let sound = Command { seq: 40_000, flow_nl_s: 21_600_000 }.encode();
    let sound = sound.bytes().trim_ascii_end();
    let bits = sound.len() * 8;
    for first in 0..bits {
        for second in first..bits {
            let mut line = sound.to_vec();
            for bit in [first, second] {
                line[bit / 8] ^= 1 << (bit % 8);
            }
            if first == second {
                line[first / 8] ^= 1 << (first % 8);
            }
            assert_eq!(Command::decode(&line), None, "bits {first} and {second}");
        }
    }
}

#[test]
fn the_flow_arrives_and_the_line_is_not_flooded() {
    let (mut line, mut extruder) = (line(), Extruder::new(FLOW_MAX, 0.05).expect("sound figures"));
    assert_eq!(line.poll_timeout(), None);
    // A flow that changes in every cycle for 10 s, then stands for 10 s.
    let change = |cycle: u64, line: &mut ExtruderLine| {
        let flow = 1e-5 + 1e-9 * cycle.min(5000) as f64;
        line.set_flow(flow).expect("below the maximum");
    };
    run(&mut line, &mut extruder, 0..5000, change, nothing).expect("a sound line");
    let changing = line.status().sent;
    assert!((480..=502).contains(&changing), "{changing} lines in 10 s");
    run(&mut line, &mut extruder, 5000..10_000, change, nothing).expect("a sound line");
    let standing = line.status().sent - changing;
    assert!((98..=105).contains(&standing), "{standing} lines in 10 s");
    let status = *line.status();
    assert!(status.ready && status.damaged_lines == 0 && status.foreign_lines == 0, "{status:?}");
    assert!((status.commanded - 1.5e-5).abs() < 1e-12 && (status.actual - 1.5e-5).abs() < 1e-12, "{status:?}");
    // Mean flow 1.25e-5 m³/s for 10 s and 1.5e-5 for 10 s, less the lag's 1.5e-5 m³/s · 0.05 s and the first answer's wait.
    assert!((extruder.volume() - 2.75e-4).abs() < 2e-6, "{:e}", extruder.volume());
}

#[test]
fn flows_that_cannot_be_are_refused_and_stop_the_extruder() {
    let mut line = line();
    line.set_flow(FLOW_MAX).expect("the maximum itself is legal");
    for flow in [-1e-12, FLOW_MAX * 1.001, f64::NAN, f64::INFINITY] {
        assert!(matches!(line.set_flow(flow), Err(ExtruderError::FlowRefused { .. })), "{flow}");
        assert_eq!(line.wanted_nl_s, 0);
    }
    for flow_max in [0.0, -1.0, f64::NAN, f64::INFINITY, 5e-3] {
        assert!(matches!(ExtruderLine::new(flow_max, 1), Err(ExtruderError::FlowMax { .. })));
    }
}

#[test]
fn a_silent_extruder_is_an_error_after_the_timeout_and_not_before() {
    let mut line = line();
    let mut buffer = [0; 64];
    assert_eq!(line.handle_timeout(Nanos(5_000 * MS)), Ok(()), "nothing has been asked yet");
    assert!(line.poll_transmit(Nanos(5_000 * MS), &mut buffer) > 0);
    for ms in 5_000..5_300 {
        assert_eq!(line.handle_timeout(Nanos(ms * MS)), Ok(()));
        line.poll_transmit(Nanos(ms * MS), &mut buffer);
        assert!(line.poll_timeout() > Some(Nanos(ms * MS)) && line.poll_timeout() <= Some(Nanos(5_300 * MS)));
    }
    assert_eq!(line.handle_timeout(Nanos(5_300 * MS)), Err(ExtruderError::Silent { waited_ns: TIMEOUT_NS }));
}

#[test]
fn a_machine_that_stood_still_does_not_blame_the_extruder() {
    let (mut line, mut extruder) = (line(), Extruder::new(FLOW_MAX, 0.05).expect("sound figures"));
    run(&mut line, &mut extruder, 0..100, |_, line| line.set_flow(1e-5).expect("sound"), nothing)
        .expect("a sound line");
    // 450 ms later, longer than the time-out: what was received meanwhile counts first.
    run(&mut line, &mut extruder, 325..400, |_, _| {}, nothing).expect("a sound line");
}

#[test]
fn a_watchdog_stop_is_reported_and_cleared_only_by_standing_still() {
    let (mut line, mut extruder) = (line(), Extruder::new(FLOW_MAX, 0.0).expect("sound figures"));
    let keep = |_: u64, line: &mut ExtruderLine| line.set_flow(1e-5).expect("sound");
    run(&mut line, &mut extruder, 0..100, keep, nothing).expect("a sound line");
    assert!((extruder.actual() - 1e-5).abs() < 1e-12);
    extruder.step(0.6);
    assert_eq!((extruder.actual(), extruder.fault()), (0.0, DeviceFault::Watchdog));
    let error = run(&mut line, &mut extruder, 400..450, keep, nothing);
    assert_eq!(error, Err(ExtruderError::Faulted { fault: DeviceFault::Watchdog }));
    assert!(!line.status().ready);
    // A new flow alone does not start it: the line tells it to stand still first, and gets through.
    run(&mut line, &mut extruder, 450..500, keep, nothing).expect("cleared");
    assert!((extruder.actual() - 1e-5).abs() < 1e-12);
}

#[test]
fn the_device_s_own_faults_are_typed_errors() {
    let mut extruder = Extruder::new(FLOW_MAX / 10.0, 0.05).expect("sound figures");
    let mut line = line();
    let error = run(&mut line, &mut extruder, 0..100, |_, line| line.set_flow(5e-5).expect("sound"), nothing);
    assert_eq!(error, Err(ExtruderError::Faulted { fault: DeviceFault::FlowRefused }));
    assert_eq!(extruder.target(), 0.0);

    let (mut line, mut extruder) = (self::line(), Extruder::new(FLOW_MAX, 0.05).expect("sound figures"));
    run(&mut line, &mut extruder, 0..100, |_, _| {}, nothing).expect("a sound line");
    extruder.fail_drive();
    let error = run(&mut line, &mut extruder, 100..200, |_, line| line.set_flow(5e-5).expect("sound"), nothing);
    assert_eq!(error, Err(ExtruderError::Faulted { fault: DeviceFault::Drive }));

    let mut line = self::line();
    line.poll_transmit(Nanos(0), &mut [0; 64]);
    let lie = Answer { seq: 1, flow_nl_s: 110_000_000, fault: DeviceFault::None }.encode();
    assert!(matches!(line.handle_bytes(Nanos(1), lie.bytes()), Err(ExtruderError::FlowImpossible { .. })));
}

#[test]
fn a_killed_predecessor_s_lines_are_not_taken_for_answers() {
    let mut extruder = Extruder::new(FLOW_MAX, 0.05).expect("sound figures");
    let mut first = line();
    run(&mut first, &mut extruder, 0..500, |_, line| line.set_flow(1e-5).expect("sound"), nothing)
        .expect("a sound line");
    extruder.step(1.0);
    // The watchdog's line of the first is still on the wire.
    let mut second = line();
    run(&mut second, &mut extruder, 0..500, |_, line| line.set_flow(2e-5).expect("sound"), nothing)
        .expect("a new start");
    assert!(second.status().foreign_lines > 0 && second.status().ready, "{:?}", second.status());
    assert!((extruder.target() - 2e-5).abs() < 1e-12);
}

#[test]
fn the_same_bytes_cut_at_every_place_say_the_same() {
    let answers: Vec<u8> = (1..=3u32)
        .flat_map(|seq| Answer { seq, flow_nl_s: seq * 1000, fault: DeviceFault::None }.encode().bytes().to_vec())
        .collect();
    for cut in 0..=answers.len() {
        let mut line = line();
        for ms in [0, 100, 200] {
            // Byte by byte: a port may take as little as that.
            for _ in 0..40 {
                assert!(line.poll_transmit(Nanos(ms * MS), &mut [0; 1]) <= 1);
            }
        }
        assert_eq!(line.status().sent, 3);
        let (left, right) = answers.split_at(cut);
        line.handle_bytes(Nanos(201 * MS), left).expect("sound answers");
        line.handle_bytes(Nanos(202 * MS), right).expect("sound answers");
        let status = line.status();
        assert_eq!((status.acknowledged, status.actual, status.damaged_lines), (3, 3e-9, 0), "cut at {cut}");
    }
}

#[test]
fn a_bad_wire_never_makes_a_wrong_flow() {
    // Seeded: one byte in 1000 is changed. What gets through must be what was meant.
    let mut random = Random(7);
    let (mut line, mut extruder) = (line(), Extruder::new(FLOW_MAX, 0.0).expect("sound figures"));
    let mut damage = |bytes: &mut Vec<u8>| {
        for byte in bytes.iter_mut() {
            if random.below(1000) == 0 {
                *byte = random.below(256) as u8;
            }
        }
    };
    let flows = [2e-5, 3e-5];
    for part in 0..2000u64 {
        let flow = flows[(part % 2) as usize];
        let keep = |_: u64, line: &mut ExtruderLine| line.set_flow(flow).expect("sound");
        let cycles = part * 25..(part + 1) * 25;
        run(&mut line, &mut extruder, cycles, keep, &mut damage).expect("damaged lines are no reason to stop");
        assert!(part == 0 || flows.contains(&extruder.target()), "{}", extruder.target());
    }
    let status = line.status();
    assert!(status.damaged_lines > 20 && extruder.lines().1 > 20, "{status:?} {:?}", extruder.lines());
    // 100 s at a mean of 2.5e-5 m³/s.
    assert!((extruder.volume() - 2.5e-3).abs() < 2e-5, "{:e}", extruder.volume());
}

#[test]
fn random_bytes_never_panic() {
    // Seeded: 200,000 bytes of which many are letters of the protocol.
    let mut random = Random(11);
    let alphabet = b"AF 0123456789*ABCDEF\n\n\r\x00\xff";
    let (mut line, mut extruder) = (line(), Extruder::new(FLOW_MAX, 0.05).expect("sound figures"));
    let mut buffer = [0; 64];
    for cycle in 0..20_000u64 {
        let bytes: Vec<u8> = (0..10).map(|_| alphabet[random.below(alphabet.len())]).collect();
        // Errors are legal here, panics are not.
        let _ = line.handle_bytes(Nanos(cycle), &bytes);
        extruder.handle_bytes(&bytes);
        extruder.poll_transmit(&mut buffer);
    }
    assert!(line.status().damaged_lines > 10_000);
}
