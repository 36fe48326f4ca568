//! What other people's clients expect of a controller, as their sources and tests state it: UR's Python client
//! (RTDE_Python_Client_Library, `rtde/rtde.py`) and UR's C++ client library (`src/rtde`, `tests/test_rtde_client.cpp`,
//! `tests/test_dashboard_client_g5.cpp`, `tests/test_primary_client.cpp`).

use super::wire::{IDLE, START, Wire, double, int};
use crate::sim::ur::dashboard;
use crate::sim::ur::robot::Generation;
use crate::sim::ur::script::upload::Upload;
use crate::sim::ur::streams::{Port, Stream};
use screed_kernel::arms::ur::{UR5E, UR10E};
use screed_kernel::units::JointPos;

/// A client that looks at the newest package only takes a start for refused if data has overtaken its answer; it then waits
/// for a time stamp of 40 s, pauses, sets its inputs up, and starts again.
#[test]
fn a_start_is_answered_well_before_the_first_data_and_a_pause_is_the_last_word() {
    for generation in [Generation::ESeries, Generation::Cb3] {
        let rate = f64::from(generation.cycle_rate());
        let mut wire = Wire::new(generation);
        wire.protocol(2);
        assert_eq!(wire.ask(b'v', &[]).len(), 16);
        wire.outputs("timestamp,actual_q", rate);
        for _ in 0..2 {
            wire.start();
            let quiet = (0..100).take_while(|_| wire.run(1).is_empty()).count();
            assert!((0.009..0.03).contains(&(quiet as f64 / rate)), "{quiet} cycles");
            assert!(double(&wire.next(), 0) > 40.0);
            assert_eq!(wire.ask(b'P', &[]), [1]);
            assert!(wire.run(100).is_empty());
            assert_ne!(wire.inputs("standard_digital_output_mask,standard_digital_output").0, 0);
        }
    }
}

/// Data first, then why the program does not run: a client that expects data gets it.
#[test]
fn the_cause_of_a_stopped_program_is_told_behind_the_first_data() {
    let mut wire = Wire::of(&UR10E, START, Generation::ESeries, "def test():\n  nothing()\nend\n");
    wire.protocol(2);
    wire.outputs("timestamp", 500.0);
    wire.start();
    let kinds: Vec<u8> = (0..10)
        .flat_map(|_| {
            wire.controller.step();
            wire.packages()
        })
        .map(|(kind, _)| kind)
        .collect();
    assert_eq!(kinds[..3], [b'U', b'M', b'U']);
}

#[test]
fn stamps_at_a_lower_rate_are_exactly_its_period_apart() {
    for generation in [Generation::ESeries, Generation::Cb3] {
        let mut wire = Wire::new(generation);
        wire.protocol(2);
        wire.outputs("actual_q,timestamp", 25.0);
        wire.start();
        let stamps: Vec<f64> = wire.run(500).iter().map(|package| double(package, 48)).collect();
        assert!(stamps.len() >= 20);
        assert!(stamps.windows(2).all(|pair| (pair[1] - pair[0] - 0.04).abs() < 1e-6), "{stamps:?}");
    }
}

/// The library's writer sends its whole recipe each time, with the masks of all but one group zero.
#[test]
fn a_mask_holds_for_its_package_only_and_every_package_counts() {
    let mut wire = Wire::new(Generation::ESeries);
    wire.protocol(2);
    let inputs = "speed_slider_mask,speed_slider_fraction,standard_digital_output_mask,standard_digital_output,\
        configurable_digital_output_mask,configurable_digital_output,tool_digital_output_mask,tool_digital_output,\
        standard_analog_output_mask,standard_analog_output_type,standard_analog_output_0,standard_analog_output_1";
    assert_eq!(wire.inputs(inputs).0, 1);
    wire.outputs(
        "target_speed_fraction,actual_digital_output_bits,standard_analog_output0,standard_analog_output1",
        500.0,
    );
    wire.start();
    let package = |slider: Option<f64>, digital: [(u8, u8); 3], analog: (u8, u8, f64, f64)| {
        let mut bytes = vec![1];
        bytes.extend(u32::from(slider.is_some()).to_be_bytes());
        bytes.extend(slider.unwrap_or(0.0).to_be_bytes());
        bytes.extend(digital.iter().flat_map(|(mask, levels)| [*mask, *levels]));
        bytes.extend([analog.0, analog.1]);
        bytes.extend([analog.2, analog.3].iter().flat_map(|value| value.to_be_bytes()));
        bytes
    };
    let none = (0, 0, 0.0, 0.0);
    // All in one cycle.
    for bytes in [
        package(Some(0.5), [(0, 0); 3], none),
        package(None, [(1 << 2, 0xff), (0, 0), (0, 0)], none),
        package(None, [(1 << 3, 0xff), (1 << 1, 1 << 1), (0, 0)], none),
        package(None, [(1 << 3, 0), (0, 0), (1, 1)], none),
        package(None, [(0, 0); 3], (1, 1, 0.25, 1.0)),
        package(None, [(0, 0); 3], (2, 0, 1.0, 0.5)),
        package(None, [(0, 0); 3], none),
    ] {
        wire.send(b'U', &bytes);
    }
    wire.run(10);
    let found = wire.next();
    assert_eq!(double(&found, 0), 0.5);
    assert_eq!(found[8..16], (1_u64 << 2 | 1 << 9 | 1 << 16).to_be_bytes());
    assert_eq!(double(&found, 16), 2.5);
    assert!((double(&found, 24) - 0.012).abs() < 1e-15);
}

/// Two input recipes, their data after a start: the Python client's control loop.
#[test]
fn setpoint_and_watchdog_recipes_of_one_client_are_both_taken() {
    let mut wire = Wire::new(Generation::Cb3);
    wire.protocol(2);
    assert_eq!(wire.outputs("target_q,target_qd,output_int_register_0", 125.0), (1, "VECTOR6D,VECTOR6D,INT32".into()));
    let registers: Vec<String> = (0..6).map(|register| format!("input_double_register_{register}")).collect();
    assert_eq!(wire.inputs(&registers.join(",")), (1, ["DOUBLE"; 6].join(",")));
    assert_eq!(wire.inputs("input_int_register_0"), (2, "INT32".into()));
    wire.start();
    let mut setpoint = vec![1];
    setpoint.extend([-0.12, -0.43, 0.14, 0.0, 3.11, 0.04].iter().flat_map(|value: &f64| value.to_be_bytes()));
    wire.send(b'U', &setpoint);
    wire.send(b'U', &[2, 0, 0, 0, 1]);
    wire.controller.step();
    let cycle = wire.controller.last_cycle();
    assert_eq!((cycle.registers, cycle.seq), ([-0.12, -0.43, 0.14, 0.0, 3.11, 0.04], 1));
}

#[test]
fn properties_are_known_to_the_e_series_only() {
    let names = b"v1.software.version,v1.control_box.type,v1.robot_arm.tool_flange.type";
    let mut wire = Wire::new(Generation::ESeries);
    wire.protocol(2);
    let answer = wire.ask(b'R', names);
    assert_eq!(answer[..2], 20_u16.to_be_bytes());
    assert_eq!((&answer[2..22], answer.len()), (&b"UINT64,UINT32,UINT32"[..], 22 + 16));
    let mut old = Wire::new(Generation::Cb3);
    old.protocol(2);
    old.send(b'R', names);
    assert_eq!(old.packages()[0].0, b'M');
}

fn say(wire: &mut Wire, conversation: &[(&str, &str)]) {
    for (command, wanted) in conversation {
        assert_eq!(dashboard::answer(command, &mut wire.controller), *wanted, "{command}");
    }
}

/// Runs cycles until the answer is as wanted, for at most so many seconds: the library asks every 100 ms.
fn until(wire: &mut Wire, command: &str, wanted: &[&str], seconds: usize) {
    for _ in 0..10 * seconds {
        if wanted.contains(&dashboard::answer(command, &mut wire.controller).as_str()) {
            return;
        }
        wire.run(wire.controller.generation().cycle_rate() as usize / 10);
    }
    panic!("{command}: not {wanted:?} within {seconds} s");
}

#[test]
fn the_librarys_dashboard_conversations_go_as_its_tests_want_them() {
    for generation in [Generation::ESeries, Generation::Cb3] {
        let wire = &mut Wire::new(generation);
        let wait = "wait_program.urp";
        say(
            wire,
            &[
                ("close safety popup", "closing safety popup"),
                (&format!("load {wait}"), "Loading program: wait_program.urp"),
            ],
        );
        until(wire, "programState", &["STOPPED wait_program.urp"], 1);
        say(wire, &[("power off", "Powering off")]);
        until(wire, "robotmode", &["Robotmode: POWER_OFF"], 1);
        say(wire, &[("power on", "Powering on")]);
        until(wire, "robotmode", &["Robotmode: IDLE", "Robotmode: RUNNING"], 5);
        say(wire, &[("brake release", "Brake releasing")]);
        until(wire, "robotmode", &["Robotmode: RUNNING"], 5);
        say(
            wire,
            &[
                ("play", "Starting program"),
                ("programState", "PLAYING wait_program.urp"),
                ("pause", "Pausing program"),
                ("programState", "PAUSED wait_program.urp"),
                ("play", "Starting program"),
                ("running", "Program running: true"),
                ("stop", "Stopped"),
                ("programState", "STOPPED wait_program.urp"),
                ("running", "Program running: false"),
                ("isProgramSaved", "true wait_program.urp"),
                ("load /ursim/programs/wait_program.urp", "Loading program: /ursim/programs/wait_program.urp"),
                ("get loaded program", "Loaded program: wait_program.urp"),
                ("load installation default.installation", "Loading installation: default.installation"),
                ("load installation other.installation", "File not found: other.installation"),
                ("generate flight report ", "Flight Report generated with id:1"),
                ("generate support file .", "Completed successfully: ursupport_1.zip"),
                ("saveLog", "Log saved to disk"),
                ("brake_release", "could not understand: 'brake_release'"),
            ],
        );
        // From any state, also a running one.
        say(wire, &[("restart safety", "Restarting safety")]);
        until(wire, "robotmode", &["Robotmode: POWER_OFF"], 5);
        say(wire, &[("power on", "Powering on")]);
    }
    let modes = [
        ("set operational mode AUTOMATIC", "Operational mode AUTOMATIC is set"),
        ("get operational mode", "AUTOMATIC"),
        ("set operational mode manual", "Operational mode manual is set"),
        ("get operational mode", "MANUAL"),
        ("set operational mode NONE", "Failed setting operational mode: NONE"),
        ("clear operational mode", "No longer controlling the operational mode. Current operational mode: 'NONE'."),
        ("get operational mode", "NONE"),
        ("is in remote control", "false"),
        ("getUserRole", "could not understand: 'getUserRole'"),
        ("version", "5.11.6.1"),
    ];
    say(&mut Wire::new(Generation::ESeries), &modes);
    let roles = [
        ("setUserRole PROGRAMMER", "Setting user role: PROGRAMMER"),
        ("getUserRole", "PROGRAMMER"),
        ("setUserRole LOCKED", "Setting user role: LOCKED"),
        ("getUserRole", "LOCKED"),
        ("setUserRole KING", "Failed setting user role: KING"),
        ("get operational mode", "could not understand: 'get operational mode'"),
    ];
    say(&mut Wire::new(Generation::Cb3), &roles);
}

/// Hands the controller what a client sends to port 30001.
pub fn upload(wire: &mut Wire, text: &str) {
    let mut upload = Upload::default();
    upload.handle_bytes(text.as_bytes());
    for program in upload.take_programs() {
        wire.controller.upload(&program);
    }
}

#[test]
fn a_script_that_asks_for_a_protective_stop_gets_it_and_it_is_unlocked_after_five_seconds() {
    let wire = &mut Wire::new(Generation::ESeries);
    upload(wire, "protective_stop()\n");
    until(wire, "safetystatus", &["Safetystatus: PROTECTIVE_STOP"], 1);
    until(wire, "safetymode", &["Safetymode: PROTECTIVE_STOP"], 1);
    wire.run(2500);
    say(
        wire,
        &[
            ("unlock protective stop", "Protective stop releasing"),
            ("robotmode", "Robotmode: RUNNING"),
            ("safetystatus", "Safetystatus: NORMAL"),
        ],
    );
}

/// A robot message of port 30001: type and content behind it.
type Told = (u8, Vec<u8>);

/// The messages of so many cycles.
fn messages(wire: &mut Wire, stream: &mut Stream, cycles: usize) -> Vec<Told> {
    (0..cycles).flat_map(|_| state_of(wire, stream).0).collect()
}

#[test]
fn port_30001_obeys_commands_and_tells_of_programs() {
    let wire = &mut Wire::new(Generation::ESeries);
    let mut stream = Stream::new(Port::Primary);
    let version = messages(wire, &mut stream, 1);
    assert_eq!(version.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [3]);
    let mode = |wire: &mut Wire| dashboard::answer("robotmode", &mut wire.controller);
    for (command, wanted) in [
        ("power off\n", "Robotmode: POWER_OFF"),
        ("power on\n", "Robotmode: IDLE"),
        ("set robotmode run\n", "Robotmode: RUNNING"),
    ] {
        upload(wire, command);
        wire.run(500);
        assert_eq!(mode(wire), wanted);
    }
    messages(wire, &mut stream, 1);
    upload(wire, "def test_fun():\n  textmsg(\"still running\")\n  sleep(0.1)\n  sync()\nend\n");
    let told = messages(wire, &mut stream, 100);
    let title = |text: &[u8]| [&[0; 8], &[19][..], text, b"test_fun"].concat();
    let wanted =
        [(7, title(b"PROGRAM_XXX_STARTED")), (0, b"still running".to_vec()), (7, title(b"PROGRAM_XXX_STOPPED"))];
    assert_eq!(told, wanted);

    upload(wire, "def endless():\n  while True:\n    sync()\n  end\nend\n");
    messages(wire, &mut stream, 2);
    upload(wire, "stop program\n");
    let told = messages(wire, &mut stream, 2);
    assert!(told.len() == 1 && told[0].1.ends_with(b"PROGRAM_XXX_STOPPEDendless"));

    upload(wire, "def illegal_fun():\n  calldoesntexist()\nend\n");
    let told = messages(wire, &mut stream, 2);
    assert_eq!((told.len(), told[0].0, int(&told[0].1, 0), int(&told[0].1, 4)), (1, 10, 2, 3));
    assert_eq!(told[0].1[8..], *b"compile_error_name_not_found:calldoesntexist:");

    // A goal that no joints reach ends the program; a line that leads there stops the robot.
    upload(wire, "movej(p[0,0,0,0,0,0])\n");
    let told = messages(wire, &mut stream, 10);
    assert_eq!(told.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [7, 10, 7]);
    upload(wire, "movel(p[0,0,0,0,0,0])\n");
    let told = messages(wire, &mut stream, 3000);
    let stop = told.iter().find(|(kind, _)| *kind == 6).expect("an error code");
    // The safety mode, told when it changes: protective stop.
    let (_, mode) = told.iter().find(|(kind, _)| *kind == 5).expect("a safety mode");
    assert_eq!((mode.len(), mode[8]), (17, 3));
    // Level: a violation.
    assert_eq!(int(&stop.1, 8), 3);
    // Here at once, on the dashboard after five seconds.
    let early = dashboard::answer("unlock protective stop", &mut wire.controller);
    assert!(early.starts_with("Cannot unlock protective stop until 5s"), "{early}");
    upload(wire, "set unlock protective stop\n");
    assert_eq!(dashboard::answer("safetymode", &mut wire.controller), "Safetymode: NORMAL");
}

/// One cycle: the messages of port 30001, and of a robot state protective stop, program running, program paused.
fn state_of(wire: &mut Wire, stream: &mut Stream) -> (Vec<Told>, Option<[bool; 3]>) {
    wire.controller.step();
    wire.controller.feed(stream);
    let mut bytes = vec![0; 100_000];
    let count = stream.poll_transmit(&mut bytes);
    let (mut rest, mut told, mut bits) = (&bytes[..count], Vec::new(), None);
    while let [a, b, c, d, kind, ..] = *rest {
        let size = u32::from_be_bytes([a, b, c, d]) as usize;
        match kind {
            // Behind type: time stamp, source, type of message.
            20 => told.push((rest[14], rest[15..size].to_vec())),
            // The first part of a state: its size and type, the time stamp, four other bits.
            _ => bits = Some([rest[22], rest[23], rest[24]].map(|bit| bit == 1)),
        }
        rest = &rest[size..];
    }
    (told, bits)
}

/// As the newest robot state has them.
fn program_bits(wire: &mut Wire, stream: &mut Stream) -> [bool; 3] {
    let cycles = wire.controller.generation().cycle_rate() / 5;
    let newest = (0..cycles).filter_map(|_| state_of(wire, stream).1).last();
    newest.expect("ten states a second")
}

/// `sendScriptBlocking` of the library: it waits for the program's end, and after an error stops the program, unlocks at
/// once and sends the next one.
#[test]
fn a_script_that_fails_is_stopped_and_unlocked_and_the_next_one_runs() {
    for generation in [Generation::ESeries, Generation::Cb3] {
        let wire = &mut Wire::new(generation);
        let mut stream = Stream::new(Port::Primary);
        messages(wire, &mut stream, 1);
        let part = "def script_1764180000000():\n  textmsg(\"still running\")\n  sleep(0.1)\n  sync()\nend\n\n";
        let ends = |told: &[Told]| told.iter().any(|(_, text)| text.ends_with(b"STOPPEDscript_1764180000000"));
        upload(wire, part);
        assert!(ends(&messages(wire, &mut stream, 200)));
        upload(wire, "sec test_sec():\n  textmsg(\"Still running\")\nend\n\n");
        assert_eq!(messages(wire, &mut stream, 5), [(0, b"Still running".to_vec())]);
        for bad in ["def script_1():\n  protective_stop()\nend\n", "def script_2():\n  movel(p[0,0,0,0,0,0])\nend\n"] {
            upload(wire, bad);
            // The state comes with the error, not up to 100 ms later: the client asks for it at once.
            let stopped = (0..3000).find_map(|_| {
                let (told, bits) = state_of(wire, &mut stream);
                told.iter().any(|(kind, _)| *kind == 6).then_some(bits)
            });
            assert_eq!(stopped, Some(Some([true, false, true])), "{bad}");
            messages(wire, &mut stream, 10);
            upload(wire, "stop program\n\n");
            assert_eq!(program_bits(wire, &mut stream), [true, false, false]);
            upload(wire, part);
            assert!(!ends(&messages(wire, &mut stream, 200)), "not while it is stopped");
            upload(wire, "set unlock protective stop\n");
            assert_eq!(program_bits(wire, &mut stream), [false; 3]);
            upload(wire, part);
            assert!(ends(&messages(wire, &mut stream, 200)));
        }
    }
}

/// The library's `rtde_roundtrip` example: a program that turns inputs into outputs, and a client that checks each.
#[test]
fn a_program_answers_registers_in_the_cycle_in_which_they_come() {
    let wire = &mut Wire::new(Generation::ESeries);
    let mirror = "def rtde_register_mirror():\n  while (True):\n    write_output_boolean_register(64, not \
                  read_input_boolean_register(64))\n    write_output_integer_register(24, \
                  read_input_integer_register(24) + 1)\n    write_output_float_register(24, -1.0 * \
                  read_input_float_register(24))\n    sync()\n  end\nend\n";
    upload(wire, mirror);
    wire.protocol(2);
    let outputs = "timestamp,runtime_state,output_bit_register_64,output_int_register_24,output_double_register_24";
    assert_eq!(wire.outputs(outputs, 500.0).1, "DOUBLE,UINT32,BOOL,INT32,DOUBLE");
    let inputs = wire.inputs("input_bit_register_64,input_int_register_24,input_double_register_24");
    assert_eq!(inputs, (1, "BOOL,INT32,DOUBLE".to_owned()));
    wire.start();
    wire.run(10);
    for counter in 1..200_i32 {
        let sine = (f64::from(counter) * 0.01).sin();
        let mut package = vec![1, u8::from(counter % 2 == 0)];
        package.extend(counter.to_be_bytes());
        package.extend(sine.to_be_bytes());
        wire.send(b'U', &package);
        let found = wire.next();
        assert_eq!((int(&found, 8), found[12], int(&found, 13)), (2, u8::from(counter % 2 != 0), counter + 1));
        assert_eq!(double(&found, 17), -sine);
    }
}

/// A name that is none is told in its place; the library then asks again without it, or gives up and connects anew.
#[test]
fn a_wrong_name_is_told_by_its_place_and_the_connection_goes_on() {
    let mut wire = Wire::new(Generation::ESeries);
    // Before any protocol is agreed: protocol 1.
    assert_eq!(wire.ask(b'v', &[]).len(), 16);
    assert_eq!(wire.outputs("timestamp,i_do_not_exist,actual_q", 500.0).1, "DOUBLE,NOT_FOUND,VECTOR6D");
    assert_eq!(wire.ask(b'V', &3_u16.to_be_bytes()), [0]);
    wire.protocol(2);
    assert_eq!(wire.outputs("timestamp,unknown,actual_q", 500.0), (0, "DOUBLE,NOT_FOUND,VECTOR6D".into()));
    assert_eq!(wire.ask(b'S', &[]), [0], "nothing to send");
    assert_ne!(wire.outputs("timestamp,actual_q", 500.0).0, 0);
    assert_eq!(wire.inputs("speed_slider_mask,i_do_not_exist"), (0, "UINT32,NOT_FOUND".into()));
    // What was refused is nobody's.
    let other = wire.controller.connect();
    let first = std::mem::replace(&mut wire.client, other);
    assert_ne!(wire.inputs("speed_slider_mask,speed_slider_fraction").0, 0);
    wire.client = first;
    assert_eq!(wire.inputs("speed_slider_mask,speed_slider_fraction"), (0, "IN_USE,IN_USE".into()));
    wire.controller.disconnect(other);
    assert_ne!(wire.inputs("speed_slider_mask,speed_slider_fraction").0, 0);
    wire.start();
    wire.run(20);
    assert!(double(&wire.next(), 0) > 41.0);
    // Asked for once more while data flows: the newest list holds.
    wire.send(b'O', &[&500.0_f64.to_be_bytes()[..], b"actual_q,timestamp"].concat());
    assert_eq!(wire.packages()[0].0, b'O');
    assert!(double(&wire.next(), 48) > 41.0);
}

#[test]
fn port_30001_tells_of_a_programs_popup() {
    let wire = &mut Wire::new(Generation::ESeries);
    let mut stream = Stream::new(Port::Primary);
    messages(wire, &mut stream, 1);
    upload(wire, "def a():\n  popup(\"look\", title=\"Door\", error=True, blocking=True)\n  sleep(1)\nend\n");
    let told = messages(wire, &mut stream, 3);
    assert_eq!(told.last(), Some(&(2, b"\0\0\0\0\0\0\0\0\0\x01\x01\x04Doorlook".to_vec())));
    assert_eq!(wire.controller.popup(), Some("look"));
}

/// UR's `example_control_loop.py` and the program that it comes with, here from the controller's disk.
#[test]
fn the_python_clients_control_loop_moves_the_robot_to_and_fro() {
    for generation in [Generation::ESeries, Generation::Cb3] {
        let start = JointPos([0.0, -1.57, -1.57, -1.57, 1.57, 0.0]);
        let wire = &mut Wire::of(&UR5E, start, generation, IDLE);
        wire.protocol(2);
        wire.outputs("target_q,target_qd,output_int_register_0", 125.0);
        let registers: Vec<String> = (0..6).map(|register| format!("input_double_register_{register}")).collect();
        assert_eq!((wire.inputs(&registers.join(",")).0, wire.inputs("input_int_register_0").0), (1, 2));
        wire.start();
        say(
            wire,
            &[
                ("load rtde_control_loop.urp", "Loading program: rtde_control_loop.urp"),
                ("play", "Starting program"),
                ("programState", "PLAYING rtde_control_loop.urp"),
            ],
        );
        let poses = [[-0.12, -0.43, 0.14, 0.0, 3.11, 0.04], [-0.12, -0.51, 0.21, 0.0, 3.11, 0.04_f64]];
        let (mut moving, mut done, mut kick) = (false, 0, 0);
        for _ in 0..60 * 125 {
            for state in wire.run(generation.cycle_rate() as usize / 125) {
                let asked = int(&state, 96) == 1;
                if !moving && asked {
                    let pose = poses[done % 2].iter().flat_map(|value| value.to_be_bytes());
                    wire.send(b'U', &[vec![1], pose.collect()].concat());
                    (moving, kick) = (true, 1);
                } else if moving && !asked {
                    let place = wire.controller.body.base_from_tcp().translation;
                    assert!((0..3).all(|axis| (place[axis] - poses[done % 2][axis]).abs() < 1e-9), "{place}");
                    (moving, kick, done) = (false, 0, done + 1);
                }
                wire.send(b'U', &[2, 0, 0, 0, kick]);
            }
            if done == 4 {
                break;
            }
        }
        assert_eq!(done, 4, "{:?}", wire.controller.program_fault());
        // Nobody kicks its watchdog of 1 Hz: it is held.
        wire.run(3 * generation.cycle_rate() as usize / 2);
        say(wire, &[("programState", "PAUSED rtde_control_loop.urp")]);
    }
}
