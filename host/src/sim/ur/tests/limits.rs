//! What the controller does at its limits: the speed slider's ends, recipes and texts that are too many or too long, and what it
//! says when it stops a program.

use super::foreign::upload;
use super::wire::{START, Wire, double};
use crate::sim::ur::act::Act;
use crate::sim::ur::inputs::Fieldbus;
use crate::sim::ur::robot::Generation;
use crate::sim::ur::streams::{Port, Stream};
use crate::sim::ur::{LINE_MAX, RuntimeState};
use screed_kernel::arms::ur::UR10E;

/// The message and level of each text package.
fn texts(wire: &mut Wire) -> Vec<String> {
    let texts = wire.packages().into_iter().filter(|(kind, _)| *kind == b'M');
    texts.map(|(_, content)| String::from_utf8(content[1..=usize::from(content[0])].to_vec()).expect("text")).collect()
}

fn slide(wire: &mut Wire, fraction: f64) {
    let mut package = vec![1, 0, 0, 0, 1];
    package.extend(fraction.to_be_bytes());
    wire.send(b'U', &package);
}

/// Cycles until the program has ended.
fn duration(wire: &mut Wire, program: &str) -> usize {
    upload(wire, program);
    let mut cycles = 0;
    while wire.controller.runtime_state() == RuntimeState::Playing {
        wire.run(1);
        cycles += 1;
        assert!(cycles < 20_000);
    }
    cycles
}

#[test]
fn the_speed_slider_stretches_movements_and_shows_in_its_own_field_alone() {
    let mut wire = Wire::new(Generation::ESeries);
    wire.protocol(2);
    wire.outputs("target_speed_fraction,speed_scaling,actual_q", 500.0);
    assert_eq!(wire.inputs("speed_slider_mask,speed_slider_fraction").0, 1);
    wire.start();
    let programs = [
        "def a():\n  movej([0.8, -1.2, 1.9, -2.2, -1.5, 0.1])\n  movej([0.3, -1.2, 1.9, -2.2, -1.5, 0.1])\nend\n",
        "def b():\n  p = get_actual_tcp_pose()\n  movel(pose_trans(p, p[0,0,-0.1,0,0,0]))\n  movel(p)\nend\n",
        "def c():\n  i = 0\n  while i < 100:\n    servoj(get_actual_joint_positions(), t=0.008)\n    i = i + 1\n  end\nend\n",
    ];
    let full = programs.map(|program| duration(&mut wire, program));
    for (fraction, times) in [(0.5, 2), (0.25, 4), (1.0, 1)] {
        slide(&mut wire, fraction);
        // The arm's pace follows in a quarter of a second at most.
        wire.run(130);
        let found = wire.next();
        assert_eq!((double(&found, 0), double(&found, 8)), (fraction, 1.0));
        for (program, full) in programs.iter().zip(full) {
            let found = duration(&mut wire, program);
            assert!(found.abs_diff(times * full) <= 4 * times, "{full} at full speed, {found} at {fraction}");
        }
    }
    // At its end the arm stands still, and goes on from there.
    upload(&mut wire, programs[0]);
    wire.run(100);
    slide(&mut wire, 0.0);
    wire.run(130);
    let stood = wire.next();
    assert_eq!(double(&stood, 0), 0.0);
    assert!(wire.run(500).iter().all(|package| package[16..] == stood[16..]));
    assert_eq!(wire.controller.runtime_state(), RuntimeState::Playing);
    slide(&mut wire, 1.0);
    wire.run(1500);
    assert_eq!(wire.controller.runtime_state(), RuntimeState::Stopped);
    assert_eq!(wire.controller.last_cycle().actual_q, START);
}

#[test]
fn a_connection_has_255_input_recipes_and_is_told_so() {
    let mut wire = Wire::new(Generation::ESeries);
    wire.protocol(2);
    for recipe in 1..=255_u8 {
        assert_eq!(wire.inputs("input_int_register_0"), (recipe, "INT32".into()));
    }
    wire.send(b'I', b"input_int_register_0");
    let found = wire.packages();
    assert_eq!(found.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [b'M', b'I']);
    assert!(found[0].1[1..].starts_with(b"Input recipe refused: a connection has at most 255"));
    assert_eq!(found[1].1, b"\x00INT32");
}

#[test]
fn an_answer_that_no_package_holds_is_told_and_the_connection_goes_on() {
    let mut wire = Wire::new(Generation::ESeries);
    wire.protocol(2);
    for kind in [b'I', b'R'] {
        wire.send(kind, "a,".repeat(10_000).as_bytes());
        let told = texts(&mut wire);
        assert_eq!(told.len(), 1, "{}", char::from(kind));
        assert!(told[0].starts_with(&format!("No answer to a package of type {}: its ", char::from(kind))), "{told:?}");
        assert_eq!(wire.controller.log_lines().last(), Some(told[0].as_str()));
    }
    // Outputs that are known, and more than a data package holds.
    let many = [&500.0_f64.to_be_bytes()[..], "actual_q,".repeat(1500).as_bytes()].concat();
    wire.send(b'O', &many);
    let found = wire.packages();
    assert_eq!(found.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [b'M', b'O']);
    assert!(found[0].1[1..].starts_with(b"Outputs of 72000 bytes; a data package holds 65531"));
    assert!(wire.controller.is_connected(wire.client));
    assert_eq!(wire.outputs("timestamp", 500.0).0, 1);
}

#[test]
fn who_has_taken_an_input_is_told_and_after_a_fieldbus_it_is_set_up_again() {
    let mut wire = Wire::new(Generation::ESeries);
    wire.protocol(2);
    assert_eq!(wire.inputs("input_int_register_0").0, 1);
    let data = [1, 0, 0, 0, 7];
    wire.controller.act(&Act::Fieldbus(Fieldbus::All)).expect("an act");
    wire.send(b'U', &data);
    assert!(texts(&mut wire)[0].contains("that a fieldbus has taken"));
    wire.controller.act(&Act::Fieldbus(Fieldbus::Off)).expect("an act");
    wire.send(b'U', &data);
    assert!(texts(&mut wire)[0].contains("until the recipe is set up again"));
    assert_eq!(wire.inputs("input_int_register_0").0, 2);
    wire.send(b'U', &data);
    assert_eq!(texts(&mut wire), [""; 0]);
    wire.controller.step();
    assert_eq!(wire.controller.last_cycle().seq, 7);
}

#[test]
fn a_fault_is_told_once() {
    let mut wire = Wire::of(&UR10E, START, Generation::ESeries, "def test():\n  nothing()\nend\n");
    let told = |wire: &mut Wire| {
        wire.client = wire.controller.connect();
        wire.protocol = 1;
        wire.protocol(2);
        wire.outputs("timestamp", 500.0);
        wire.start();
        let mut told = Vec::new();
        for _ in 0..20 {
            wire.controller.step();
            told.extend(texts(wire));
        }
        told
    };
    let first = told(&mut wire);
    assert!(first.len() == 1 && first[0].contains("nothing is not known"), "{first:?}");
    assert_eq!(told(&mut wire), [""; 0]);
    // A new one is told to all who are there, and to nobody later.
    wire.controller.act(&Act::ProtectiveStop).expect("an act");
    assert_eq!(texts(&mut wire), ["protective stop: on demand"]);
    assert_eq!(told(&mut wire), [""; 0]);
}

#[test]
fn texts_of_any_length_are_cut_between_characters() {
    let mut wire = Wire::new(Generation::ESeries);
    let mut stream = Stream::new(Port::Primary);
    wire.controller.feed(&mut stream);
    let mut bytes = vec![0; 10_000];
    stream.poll_transmit(&mut bytes);
    let long = "\u{e9}".repeat(100_000);
    upload(&mut wire, &format!("def long():\n  textmsg(\"{long}\")\n  popup(\"{long}\")\n  sleep(1)\nend\n"));
    wire.controller.step();
    wire.controller.log(&long);
    let lines: Vec<usize> = wire.controller.log_lines().map(str::len).collect();
    assert!(lines.iter().all(|length| *length <= LINE_MAX) && lines.contains(&1022), "{lines:?}");
    assert_eq!(wire.controller.popup().map(str::len), Some(1022));
    wire.controller.feed(&mut stream);
    // End and start of programs of four letters, then the texts behind their heads of 15 bytes and of 12 and a title.
    let count = stream.poll_transmit(&mut bytes);
    let messages = 2 * (15 + 9 + 19 + 4) + 15 + 1022 + 15 + 12 + 5 + 1022;
    // A robot state comes behind them.
    assert_eq!(
        (bytes[messages + 4], u32::from_be_bytes(bytes[messages..messages + 4].try_into().expect("four"))),
        (16, (count - messages) as u32)
    );
}

#[test]
fn a_watchdog_says_which_program_it_stopped_and_for_which_input() {
    let program = "def printing():\n  rtde_set_watchdog(\"input_int_register_3\", 1, \"ignore\")\n  \
                   rtde_set_watchdog(\"input_int_register_7\", 10, \"stop\")\n  while True:\n    sync()\n  end\nend\n";
    let mut wire = Wire::of(&UR10E, START, Generation::ESeries, program);
    wire.run(100);
    let told = "program printing stopped: RTDE watchdog: no update of input_int_register_7 within 0.1 s";
    assert_eq!(wire.controller.take_announced(), [told]);
    assert_eq!(wire.controller.take_announced(), [""; 0]);
    assert_eq!((wire.controller.program_fault(), wire.controller.runtime_state()), (Some(told), RuntimeState::Stopped));
    // Nobody asks: the oldest go.
    for _ in 0..1000 {
        upload(&mut wire, "nothing()\n");
    }
    assert_eq!(wire.controller.take_announced().len(), super::super::ANNOUNCED_MAX);
}
