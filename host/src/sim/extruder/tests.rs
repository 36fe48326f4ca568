use super::*;

fn command(seq: u32, flow_nl_s: u32) -> Vec<u8> {
    Command { seq, flow_nl_s }.encode().bytes().to_vec()
}

fn answers(extruder: &mut Extruder) -> Vec<Answer> {
    let mut bytes = [0; OUTGOING_MAX];
    let count = extruder.poll_transmit(&mut bytes);
    let bytes = bytes.get(..count).unwrap_or_default();
    bytes.split(|&byte| byte == b'\n').filter_map(Answer::decode).collect()
}

#[test]
fn the_flow_rises_as_a_first_order_lag() {
    let mut extruder = Extruder::new(1e-4, 0.05).expect("sound figures");
    extruder.handle_bytes(&command(1, 40_000_000));
    // q(t) = q∞·(1 − e^(−t/τ)) and V(t) = q∞·(t − τ·(1 − e^(−t/τ))), whatever the steps.
    let (flow, tau) = (4e-5, 0.05f64);
    let mut time = 0.0;
    for step in [0.001, 0.05, 0.013, 0.2, 0.1] {
        extruder.step(step);
        time += step;
        let rise = 1.0 - (-time / tau).exp();
        assert!((extruder.actual() - flow * rise).abs() < 1e-15, "{time}");
        assert!((extruder.volume() - flow * (time - tau * rise)).abs() < 1e-15, "{time}");
    }
}

#[test]
fn without_a_valid_line_for_half_a_second_it_stops_by_itself() {
    let mut extruder = Extruder::new(1e-4, 0.0).expect("sound figures");
    extruder.step(10.0);
    assert_eq!(extruder.fault(), DeviceFault::None, "before the first line there is nothing to watch");
    extruder.handle_bytes(&command(1, 10_000_000));
    extruder.step(0.499);
    extruder.handle_bytes(b"F 2 10000000*0000\n");
    assert_eq!((extruder.target(), extruder.lines()), (1e-5, (1, 1)), "a damaged line does not count");
    extruder.step(0.002);
    assert_eq!((extruder.target(), extruder.fault()), (0.0, DeviceFault::Watchdog));
    assert!((extruder.volume() - 1e-5 * 0.5).abs() < 1e-15, "it stopped at 500 ms, within the step");
    let said = answers(&mut extruder);
    assert_eq!(said.last().map(|answer| (answer.seq, answer.fault)), Some((1, DeviceFault::Watchdog)));
    // It stays stopped until it is told to stand still.
    extruder.handle_bytes(&command(3, 10_000_000));
    assert_eq!((extruder.target(), extruder.fault()), (0.0, DeviceFault::Watchdog));
    extruder.handle_bytes(&command(4, 0));
    extruder.handle_bytes(&command(5, 10_000_000));
    assert_eq!((extruder.target(), extruder.fault()), (1e-5, DeviceFault::None));
}

#[test]
fn a_flow_above_its_maximum_stops_it() {
    let mut extruder = Extruder::new(1e-5, 0.0).expect("sound figures");
    extruder.handle_bytes(&command(1, 10_000_000));
    assert_eq!((extruder.target(), extruder.fault()), (1e-5, DeviceFault::None));
    extruder.handle_bytes(&command(2, 10_001_000));
    assert_eq!((extruder.target(), extruder.fault()), (0.0, DeviceFault::FlowRefused));
    let said = answers(&mut extruder);
    assert_eq!(said.last().map(|answer| (answer.seq, answer.fault)), Some((2, DeviceFault::FlowRefused)));
}

#[test]
fn figures_that_cannot_be_are_refused() {
    for (flow_max, time_constant) in [(0.0, 0.1), (f64::NAN, 0.1), (1.0, 0.1), (1e-4, -0.1), (1e-4, f64::NAN)] {
        assert!(matches!(Extruder::new(flow_max, time_constant), Err(SimError::Impossible { .. })));
    }
}

#[test]
fn answers_that_nobody_fetches_do_not_pile_up() {
    let mut extruder = Extruder::new(1e-4, 0.05).expect("sound figures");
    for seq in 1..10_000 {
        extruder.handle_bytes(&command(seq, 0));
    }
    assert!(extruder.outgoing.len() <= OUTGOING_MAX);
}
