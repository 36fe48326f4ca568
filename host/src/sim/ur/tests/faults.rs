//! Faults on demand, judged by the bytes that a client gets.

use super::wire::{Wire, double, int};
use crate::sim::ur::act::{Act, SafetyInput};
use crate::sim::ur::dashboard;
use crate::sim::ur::inputs::Fieldbus;
use crate::sim::ur::robot::Generation;

const STATES: &str =
    "timestamp,robot_mode,safety_mode,safety_status,safety_status_bits,runtime_state,robot_status_bits";

/// Robot mode, safety mode and status, safety bits, runtime state, status bits.
fn states(wire: &mut Wire) -> [i32; 6] {
    let package = wire.next();
    std::array::from_fn(|place| int(&package, 8 + 4 * place))
}

fn act(wire: &mut Wire, text: &str) {
    wire.controller.act(&text.parse().expect("an act")).expect("possible");
}

fn ask(wire: &mut Wire, command: &str) -> String {
    dashboard::answer(command, &mut wire.controller)
}

const NORMAL: [i32; 6] = [7, 1, 1, 1, 2, 3];

#[test]
fn every_stop_shows_its_modes_and_bits_and_goes_the_way_it_must() {
    for generation in [Generation::ESeries, Generation::Cb3] {
        let second = generation.cycle_rate() as usize;
        let mut wire = Wire::streaming(generation, STATES);
        assert_eq!(states(&mut wire), NORMAL);

        act(&mut wire, "protective-stop");
        assert_eq!(states(&mut wire), [7, 3, 3, 1 << 2 | 1 << 10, 4, 1]);
        assert_eq!(ask(&mut wire, "play"), "Failed to execute: play");
        wire.run(5 * second);
        assert_eq!(ask(&mut wire, "unlock protective stop"), "Protective stop releasing");
        assert_eq!(states(&mut wire), [7, 1, 1, 1, 4, 1]);
        act(&mut wire, "play");
        assert_eq!(states(&mut wire), NORMAL);

        // Safeguards hold the program; released, nothing goes on by itself.
        for (name, bits) in
            [("safeguard-stop", [5, 5, 1 << 4 | 1 << 10]), ("enabling-stop", [5, 13, 1 << 10 | 1 << 11])]
        {
            act(&mut wire, name);
            let [mode, status, bits] = bits;
            assert_eq!(states(&mut wire), [7, mode, status, bits, 4, 1], "{name}");
            assert_eq!(ask(&mut wire, "play"), "Failed to execute: play");
            act(&mut wire, &format!("{name} off"));
            assert_eq!(states(&mut wire), [7, 1, 1, 1, 4, 1], "{name}");
            act(&mut wire, "play");
        }

        act(&mut wire, "reduced");
        assert_eq!(states(&mut wire), [7, 2, 2, 1 << 1, 2, 3], "the program goes on");
        act(&mut wire, "reduced off");

        for (name, mode, bit) in [("emergency-stop", 7, 6), ("system-emergency-stop", 6, 5)] {
            act(&mut wire, name);
            assert_eq!(states(&mut wire), [3, mode, mode, 1 << bit | 1 << 7 | 1 << 10, 1, 0], "{name}");
            assert_eq!(ask(&mut wire, "brake release"), "Failed to execute: brake release");
            // Restarted, the button is still down.
            assert_eq!(ask(&mut wire, "restart safety"), "Restarting safety");
            assert_eq!(states(&mut wire)[..2], [2, mode]);
            wire.run(second);
            assert_eq!(states(&mut wire)[..2], [3, mode]);
            act(&mut wire, &format!("{name} off"));
            assert_eq!(states(&mut wire), [3, 1, 1, 1, 1, 0], "{name}: no power, no program");
            assert_eq!(ask(&mut wire, "play"), "Failed to execute: play");
            assert_eq!(ask(&mut wire, "power on"), "Powering on");
            wire.run(second);
            assert_eq!(states(&mut wire), [5, 1, 1, 1, 1, 1]);
            assert_eq!(ask(&mut wire, "brake release"), "Brake releasing");
            wire.run(second);
            assert_eq!(states(&mut wire), [7, 1, 1, 1, 1, 1]);
            act(&mut wire, "play");
            assert_eq!(states(&mut wire), NORMAL);
        }

        act(&mut wire, "safety-fault");
        assert_eq!(states(&mut wire), [3, 9, 9, 1 << 9 | 1 << 10, 1, 0]);
        assert_eq!(ask(&mut wire, "power on"), "Failed to execute: power on");
        ask(&mut wire, "restart safety");
        wire.run(second);
        assert_eq!(states(&mut wire), [3, 1, 1, 1, 1, 0]);
    }
}

#[test]
fn a_graver_stop_hides_a_lighter_one_which_stays() {
    let mut wire = Wire::streaming(Generation::ESeries, STATES);
    act(&mut wire, "safeguard-stop");
    act(&mut wire, "emergency-stop");
    assert_eq!(states(&mut wire)[1], 7);
    act(&mut wire, "emergency-stop off");
    assert_eq!(states(&mut wire)[1], 5);
}

#[test]
fn the_program_is_paused_stopped_and_played_and_a_popup_holds_nothing() {
    let mut wire = Wire::streaming(Generation::ESeries, STATES);
    act(&mut wire, "pause");
    assert_eq!(states(&mut wire), [7, 1, 1, 1, 4, 1]);
    act(&mut wire, "play");
    act(&mut wire, "popup look at the nozzle");
    assert_eq!(wire.controller.popup(), Some("look at the nozzle"));
    assert_eq!(states(&mut wire), NORMAL);
    act(&mut wire, "close-popup");
    assert_eq!(wire.controller.popup(), None);
    act(&mut wire, "stop");
    assert_eq!(states(&mut wire), [7, 1, 1, 1, 1, 1]);
    assert!(wire.controller.act(&Act::Pause).is_err(), "nothing to pause");
    act(&mut wire, "power-off");
    assert_eq!(states(&mut wire), [3, 1, 1, 1, 1, 0]);
    assert!(wire.controller.act(&Act::Play).is_err(), "no power");
}

#[test]
fn a_silence_is_as_long_as_asked_for_and_time_goes_on_in_it() {
    let mut wire = Wire::streaming(Generation::ESeries, "timestamp");
    let before = double(&wire.next(), 0);
    act(&mut wire, "silence 0.5");
    let mut cycles = 0;
    let after = loop {
        wire.controller.step();
        cycles += 1;
        let bytes = wire.bytes();
        if !bytes.is_empty() {
            break double(&bytes, 4);
        }
        // Nothing is answered, either.
        wire.send(b'v', &[]);
    };
    assert_eq!(cycles, 251);
    assert!((after - before - 0.502).abs() < 1e-9, "{before} and {after}");
}

#[test]
fn half_a_package_is_followed_by_nothing() {
    let mut wire = Wire::streaming(Generation::ESeries, "timestamp,actual_q");
    wire.next();
    act(&mut wire, "half 0.1");
    wire.controller.step();
    // Of header, recipe, stamp and joints.
    let bytes = wire.bytes();
    assert_eq!((bytes.len(), &bytes[..4]), ((4 + 8 + 48) / 2, &[0, 60, b'U', 1][..]));
    for _ in 0..50 {
        wire.controller.step();
        assert!(wire.bytes().is_empty());
    }
    assert_eq!(wire.run(1).len(), 1);
}

#[test]
fn spoilt_packages_are_spoilt_once_in_the_way_asked_for() {
    for (kind, bad) in [
        ("size", vec![0, 61, b'U', 1]),
        ("type", vec![0, 60, b'U' ^ 1, 1]),
        ("short", vec![0, 60, b'U', 1]),
        ("nan", vec![0, 60, b'U', 1]),
        ("impossible", vec![0, 60, b'U', 1]),
    ] {
        let mut wire = Wire::streaming(Generation::ESeries, "timestamp,actual_q");
        act(&mut wire, &format!("corrupt {kind}"));
        wire.controller.step();
        let bytes = wire.bytes();
        assert_eq!(bytes[..4], bad, "{kind}");
        assert_eq!(bytes.len(), if kind == "short" { 59 } else { 60 });
        let joint = double(&bytes, 12);
        match kind {
            "nan" => assert!(joint.is_nan()),
            "impossible" => assert_eq!(joint, 100.0),
            _ => assert_eq!(joint, 0.3),
        }
        let good = wire.next();
        assert_eq!((good.len(), double(&good, 8)), (56, 0.3));
    }
}

#[test]
fn a_busy_controller_skips_packages_and_sends_the_newest() {
    let mut wire = Wire::streaming(Generation::ESeries, "timestamp");
    let before = double(&wire.next(), 0);
    act(&mut wire, "skip 4");
    let found = wire.run(5);
    assert_eq!(found.len(), 2, "three of five are missing");
    assert!((double(&found[0], 0) - before - 4.0 * 0.002).abs() < 1e-9);
    assert_eq!(ask(&mut wire, "running"), "Program running: true");
}

#[test]
fn a_restart_ends_connections_counts_time_from_zero_and_needs_power() {
    let mut wire = Wire::streaming(Generation::ESeries, STATES);
    wire.controller.install(Fieldbus::Lower);
    let joints = wire.controller.last_cycle().actual_q;
    act(&mut wire, "restart 2");
    assert!(!wire.controller.is_connected(wire.client));
    wire.client = wire.controller.connect();
    wire.protocol(2);
    wire.outputs(STATES, 500.0);
    wire.start();
    let package = wire.run(20).remove(0);
    let stamp = double(&package, 0);
    assert!(stamp > 0.0 && stamp < 0.1, "{stamp}");
    assert_eq!((int(&package, 8), int(&package, 24)), (2, 1), "booting, no program");
    wire.run(500);
    assert_eq!(states(&mut wire), [3, 1, 1, 1, 1, 0]);
    assert_eq!(wire.controller.last_cycle().actual_q, joints);
    assert_eq!(wire.inputs("input_int_register_0").1, "IN_USE", "the installation stays");
    assert_eq!(ask(&mut wire, "brake release"), "Brake releasing");
    wire.run(500);
    assert_eq!(states(&mut wire)[0], 7);
}

#[test]
fn a_reset_gives_every_connection_up() {
    let mut wire = Wire::new(Generation::ESeries);
    wire.controller.act(&Act::Reset).expect("possible");
    assert!(!wire.controller.is_connected(wire.client));
}

#[test]
fn a_fieldbus_has_its_registers_in_use() {
    let names = "input_int_register_23,input_int_register_24,input_double_register_0,input_double_register_24,\
        input_bit_registers0_to_31,input_bit_registers32_to_63,input_bit_register_64,speed_slider_mask";
    let found = |what: Fieldbus| {
        let mut wire = Wire::new(Generation::ESeries);
        wire.protocol(2);
        wire.controller.install(what);
        wire.inputs(names)
    };
    assert_eq!(found(Fieldbus::Off), (1, "INT32,INT32,DOUBLE,DOUBLE,UINT32,UINT32,BOOL,UINT32".to_owned()));
    assert_eq!(found(Fieldbus::Lower), (0, "IN_USE,INT32,IN_USE,DOUBLE,IN_USE,IN_USE,BOOL,UINT32".to_owned()));
    assert_eq!(found(Fieldbus::All), (0, ["IN_USE"; 8].join(",")));
}

#[test]
fn a_fieldbus_that_comes_takes_registers_from_the_client_that_has_them() {
    let mut wire = Wire::new(Generation::ESeries);
    wire.protocol(2);
    assert_eq!(wire.inputs("input_int_register_0").0, 1);
    wire.send(b'U', &[1, 0, 0, 0, 7]);
    wire.controller.step();
    assert_eq!((wire.controller.last_cycle().seq, wire.packages().len()), (7, 0));
    act(&mut wire, "fieldbus lower");
    let told = wire.ask_text(&[1, 0, 0, 0, 8]);
    assert!(told.contains("fieldbus"), "{told}");
    wire.controller.step();
    assert_eq!((wire.controller.last_cycle().seq, wire.controller.last_cycle().packages), (7, 0));
    act(&mut wire, "fieldbus off");
    assert_eq!(wire.inputs("input_int_register_0").0, 2);
    wire.send(b'U', &[2, 0, 0, 0, 9]);
    wire.controller.step();
    assert_eq!(wire.controller.last_cycle().seq, 9);
}

impl Wire {
    /// The text that data gets for an answer.
    fn ask_text(&mut self, data: &[u8]) -> String {
        self.send(b'U', data);
        let found = self.packages();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].0, b'M');
        String::from_utf8_lossy(&found[0].1).into_owned()
    }
}

#[test]
fn safety_inputs_have_names_of_their_own() {
    assert_eq!("reduced off".parse(), Ok(Act::Safety(SafetyInput::Reduced, false)));
}
