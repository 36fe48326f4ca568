//! Client and controller on one wire, in virtual time; and the controller alone against bytes of other clients.

mod faults;
mod foreign;
mod kinematics;
mod lag;
mod limits;
mod table;
mod wire;

use super::robot::Refusal;
use super::*;
use crate::link::rtde::program::{Program, ProgramState, WatchdogAction};
use crate::link::rtde::{Event, LinkError, Phase, RobotState, RtdeClient};
use screed_kernel::arm::Rating;
use screed_kernel::arms::ur::{UR10E, UR18};
use screed_kernel::units::Nanos;

const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);
const CYCLE_NS: u64 = 2_000_000;
const TIMEOUT_NS: u64 = 100_000_000;

fn program(rate_hz: u32, register_offset: u8, lookahead: f64) -> Program {
    let watchdog_action = WatchdogAction::Stop;
    Program { rate_hz, register_offset, lookahead, gain: 2000.0, watchdog: 0.1, watchdog_action }
}

fn options(program: &Program) -> Options {
    Options {
        start_q: START,
        flange_from_tcp: Pose::from_translation(0.0, 0.0, 0.2),
        register_offset: program.register_offset,
        program: program.text().expect("a legal program"),
        autoplay: true,
        generation: Generation::ESeries,
        powered: true,
    }
}

/// Both ends and the wire between them.
struct Bench {
    client: RtdeClient,
    controller: Controller,
    connection: ClientId,
    now: Nanos,
    /// The wire hands over at most this many bytes at once.
    chunk: usize,
    texts: Vec<String>,
}

impl Bench {
    fn new(program: &Program, options: Options) -> Self {
        let mut controller = Controller::new(&UR10E, options).expect("a legal controller");
        let connection = controller.connect();
        let client = RtdeClient::new(&UR10E, program.rate_hz, program.register_offset, TIMEOUT_NS).expect("legal");
        Self { client, controller, connection, now: Nanos(0), chunk: 4096, texts: Vec::new() }
    }

    fn send(&mut self) {
        let mut bytes = vec![0; self.chunk];
        loop {
            let count = self.client.poll_transmit(self.now, &mut bytes);
            if count == 0 {
                break;
            }
            self.controller.handle_bytes(self.connection, &bytes[..count]);
        }
    }

    fn receive(&mut self) -> Result<(), LinkError> {
        let mut bytes = vec![0; self.chunk];
        loop {
            let count = self.controller.poll_transmit(self.connection, &mut bytes);
            if count == 0 {
                return self.client.handle_timeout(self.now);
            }
            self.client.handle_bytes(self.now, &bytes[..count])?;
        }
    }

    /// One control cycle; the state that came, if any.
    fn cycle(&mut self) -> Result<Option<RobotState>, LinkError> {
        self.send();
        self.receive()?;
        self.now = self.now.plus(CYCLE_NS);
        self.controller.step();
        self.receive()?;
        let mut newest = None;
        while let Some(event) = self.client.poll_event() {
            match event {
                Event::State { state, skipped } => {
                    assert_eq!(skipped, 0);
                    newest = Some(state);
                }
                Event::Text { text, lost } => {
                    assert_eq!(lost, 0);
                    self.texts.push(text.message.to_string());
                }
                Event::Running { controller } => assert_eq!(controller.major, 5),
            }
        }
        Ok(newest)
    }

    fn start(&mut self) -> RobotState {
        for _ in 0..50 {
            if let Some(state) = self.cycle().expect("negotiation") {
                return state;
            }
        }
        panic!("no state within 50 cycles, still {}", self.client.phase());
    }

    /// Streams `joints(t)` once a period for `seconds`; what was sent and what the robot said in the same period.
    fn stream(&mut self, seconds: f64, joints: impl Fn(f64) -> JointPos<6>) -> Vec<(f64, JointPos<6>, RobotState)> {
        let mut state = self.start();
        let mut seen = Vec::new();
        let origin = state.timestamp;
        let mut seq = 0;
        while state.timestamp - origin < seconds {
            let t = state.timestamp - origin;
            seq += 1;
            let setpoint = joints(t);
            self.client.send_setpoint(seq, &setpoint).expect("running");
            seen.push((t, setpoint, state));
            state = loop {
                if let Some(state) = self.cycle().expect("streaming") {
                    break state;
                }
            };
        }
        seen
    }
}

fn shifted(by: f64) -> JointPos<6> {
    JointPos(START.0.map(|joint| joint + by))
}

/// The model of `servoj` against its own statement, not against a robot.
#[test]
fn a_ramp_is_followed_with_the_lag_that_the_model_states() {
    let speed = 0.2;
    for (rate_hz, offset, lookahead) in
        [(500, 0, 0.03), (500, 24, 0.1), (500, 0, 0.2), (125, 0, 0.03), (125, 24, 0.1), (125, 24, 0.2)]
    {
        let program = program(rate_hz, offset, lookahead);
        let mut bench = Bench::new(&program, options(&program));
        let seen = bench.stream(4.0, |t| shifted(speed * t));
        let (t, sent, state) = seen.last().expect("states");
        let lag = (sent.0[0] - state.actual_q.0[0]) / speed;
        // Two cycles until it acts, and half a period because servoj holds it.
        let expected = lookahead + 2.0 * 0.002 + 0.5 / f64::from(rate_hz);
        assert!((lag - expected).abs() < 5e-4, "{rate_hz} Hz, look-ahead {lookahead}: lag {lag} s at {t}");
        assert_eq!(state.program_state, ProgramState::Following.code());
        // The targets are steps: at 125 Hz the speed swings around the ramp's by a tenth of it.
        assert!((state.actual_qd.0[3] - speed).abs() < 0.1 * speed);
    }
}

#[test]
fn a_slow_sine_comes_back_as_sent_but_later() {
    let program = program(500, 24, 0.03);
    let mut bench = Bench::new(&program, options(&program));
    let seen = bench.stream(6.0, |t| shifted(0.2 * (1.0 - (0.5 * t).cos())));
    let lag = seen
        .iter()
        .filter(|(t, ..)| *t > 1.0)
        .map(|(t, _, state)| {
            let delayed = 0.2 * (1.0 - (0.5 * (t - 0.037)).cos());
            (state.actual_q.0[2] - START.0[2] - delayed).abs()
        })
        .fold(0.0, f64::max);
    assert!(lag < 5e-4, "{lag}");
    // The pose the robot reports is the one its joints give.
    for (_, _, state) in seen.iter().step_by(100) {
        let expected = UR10E.forward(&state.actual_q) * Pose::from_translation(0.0, 0.0, 0.2);
        let difference = expected.translation - nalgebra::Vector3::from_column_slice(&state.actual_tcp_pose[..3]);
        assert!(difference.norm() < 1e-12);
    }
}

#[test]
fn every_split_of_the_bytes_gives_the_same_motion() {
    let program = program(500, 0, 0.03);
    let mut reference = None;
    for chunk in [1, 2, 3, 5, 64, 4096] {
        let mut bench = Bench::new(&program, options(&program));
        bench.chunk = chunk;
        let seen = bench.stream(0.2, |t| shifted(0.1 * t));
        assert_eq!(reference.get_or_insert(seen.clone()), &seen, "{chunk} bytes at once");
    }
}

#[test]
fn without_its_servoj_line_the_program_runs_and_the_robot_stands_still() {
    let program = program(500, 0, 0.03);
    let mut cut = options(&program);
    let lines: Vec<&str> = cut.program.lines().filter(|line| !line.contains("servoj")).collect();
    assert_eq!(lines.len() + 1, cut.program.lines().count());
    cut.program = lines.join("\n");
    let mut bench = Bench::new(&program, cut);
    let seen = bench.stream(1.0, |t| shifted(0.1 * t));
    let (_, _, last) = seen.last().expect("states");
    assert_eq!(last.actual_q, START);
    assert_eq!(last.runtime_state, RuntimeState::Playing.code());
    assert_eq!(last.program_state, ProgramState::Following.code());
    assert_eq!(bench.controller.program_fault(), None);
}

#[test]
fn a_script_that_is_not_understood_stops_the_program_and_says_so() {
    let program = program(500, 0, 0.03);
    for (from, to) in [
        ("sync()", "snooze(0.5)"),
        ("while (not following):", "while not following"),
        ("servoj(setpoint, 0, 0", "servoj(setpoint, 0, 0, 0"),
        ("def screed():", "def screed(:"),
    ] {
        let mut broken = options(&program);
        let line = 1 + broken.program.lines().position(|line| line.contains(from)).expect("the text to break");
        broken.program = broken.program.replacen(from, to, 1);
        let mut bench = Bench::new(&program, broken);
        let state = bench.start();
        bench.cycle().expect("still linked");
        assert_eq!(state.runtime_state, RuntimeState::Stopped.code());
        let told = bench.texts.first().expect("a text message");
        assert!(told.contains(&format!("line {line}:")), "{told}");
    }
}

#[test]
fn a_script_error_while_running_stops_the_program_and_the_robot() {
    let program = program(500, 0, 0.03);
    let mut broken = options(&program);
    broken.program = broken.program.replace("setpoint = joints", "setpoint = 3");
    let mut bench = Bench::new(&program, broken);
    let seen = bench.stream(0.1, |t| shifted(0.1 * t));
    let (_, _, last) = seen.last().expect("states");
    assert_eq!(last.runtime_state, RuntimeState::Stopped.code());
    assert_eq!(last.actual_q, START);
    assert!(bench.texts.iter().any(|text| text.contains("list of six joint positions")), "{:?}", bench.texts);
}

#[test]
fn the_watchdog_bites_only_after_the_first_setpoint_and_brings_the_robot_to_rest() {
    let program = program(500, 24, 0.03);
    let mut bench = Bench::new(&program, options(&program));
    bench.start();
    for _ in 0..500 {
        bench.cycle().expect("linked");
    }
    assert_eq!(bench.controller.last_cycle().runtime_state, RuntimeState::Playing);
    bench.stream(0.5, |t| shifted(0.3 * t));
    let silent_from = bench.controller.last_cycle().cycle;
    let mut stopped_at = None;
    for _ in 0..200 {
        let state = bench.cycle().expect("linked").expect("a state each cycle");
        if stopped_at.is_none() && state.runtime_state == RuntimeState::Stopped.code() {
            stopped_at = Some(bench.controller.last_cycle().cycle);
        }
    }
    // 0.1 s are 50 cycles; the last setpoint may still have been under way.
    let cycles = stopped_at.expect("stopped") - silent_from;
    assert!((50..=52).contains(&cycles), "{cycles}");
    assert_eq!(bench.controller.body.servo.qd.0, [0.0; 6]);
    assert!(bench.texts.iter().any(|text| text.contains("watchdog")), "{:?}", bench.texts);
}

#[test]
fn of_several_silent_watchdogs_the_gravest_acts() {
    let after = |actions: [&str; 3]| {
        let set = |(n, action)| format!("  rtde_set_watchdog(\"input_int_register_{n}\", 10, \"{action}\")\n");
        let watchdogs: String = (0..3).zip(actions).map(set).collect();
        let text = format!("def f():\n{watchdogs}  while (True):\n    sync()\n  end\nend\n");
        let options = Options { program: text, ..options(&program(500, 0, 0.03)) };
        let mut controller = Controller::new(&UR10E, options).expect("legal");
        (0..100).for_each(|_| controller.step());
        controller.last_cycle().runtime_state
    };
    for actions in [["stop", "pause", "ignore"], ["ignore", "stop", "pause"], ["pause", "ignore", "stop"]] {
        assert_eq!(after(actions), RuntimeState::Stopped, "{actions:?}");
    }
    assert_eq!(after(["ignore", "pause", "ignore"]), RuntimeState::Paused);
    assert_eq!(after(["ignore"; 3]), RuntimeState::Playing);
}

#[test]
fn a_step_no_arm_can_follow_is_a_protective_stop() {
    let program = program(500, 0, 0.03);
    let mut bench = Bench::new(&program, options(&program));
    // A client that judges no steps: Screed's own would not send it.
    let unrated = Arm { velocity_max: Rating::Unknown, ..UR10E };
    bench.client = RtdeClient::new(&unrated, program.rate_hz, program.register_offset, TIMEOUT_NS).expect("legal");
    let seen = bench.stream(1.0, |t| shifted(if t < 0.5 { 0.2 * t } else { 0.2 * t + 0.9 }));
    let (_, _, last) = seen.last().expect("states");
    assert_eq!(last.safety_status_bits, 1 << 2 | 1 << 10);
    assert_eq!(last.runtime_state, RuntimeState::Paused.code());
    assert!(last.actual_q.0[0] < START.0[0] + 0.11, "moved on to {}", last.actual_q.0[0]);
    assert_eq!(last.actual_qd.0, [0.0; 6]);
    assert!(bench.texts.iter().any(|text| text.contains("protective stop")), "{:?}", bench.texts);
    assert_eq!(bench.controller.play(), Err(Refusal::State));
    assert_eq!(bench.controller.last_cycle().runtime_state, RuntimeState::Paused);
}

#[test]
fn the_record_holds_what_was_received() {
    let program = program(125, 24, 0.03);
    let mut bench = Bench::new(&program, options(&program));
    let state = bench.start();
    assert_eq!(state.timestamp, timestamp(41, bench.controller.last_cycle().cycle, 500));
    bench.client.send_setpoint(7, &shifted(0.001)).expect("running");
    bench.client.send_setpoint(8, &shifted(0.002)).expect("running");
    bench.cycle().expect("linked");
    let record = bench.controller.last_cycle();
    assert_eq!((record.received, record.packages, record.seq), (true, 2, 8));
    assert_eq!(record.registers, shifted(0.002).0);
    bench.cycle().expect("linked");
    assert!(!bench.controller.last_cycle().received);
}

#[test]
fn an_input_belongs_to_one_client_until_it_goes() {
    let program = program(500, 0, 0.03);
    let mut bench = Bench::new(&program, options(&program));
    bench.start();
    let second = bench.controller.connect();
    let first = std::mem::replace(&mut bench.connection, second);
    bench.client = RtdeClient::new(&UR10E, 500, 0, TIMEOUT_NS).expect("legal");
    let refused = (0..50).find_map(|_| bench.cycle().err());
    assert!(matches!(refused, Some(LinkError::InUse { used: 7, of: 7, .. })), "{refused:?}");
    bench.controller.disconnect(first);
    bench.controller.disconnect(second);
    bench.connection = bench.controller.connect();
    bench.client = RtdeClient::new(&UR10E, 500, 0, TIMEOUT_NS).expect("legal");
    bench.start();
    assert_eq!(bench.client.phase(), Phase::Running);
}

#[test]
fn a_client_that_does_not_read_is_cut_and_others_are_not() {
    let program = program(500, 0, 0.03);
    let mut bench = Bench::new(&program, options(&program));
    bench.start();
    let deaf = bench.controller.connect();
    bench.controller.handle_bytes(deaf, &hex("0005560002"));
    bench.controller.handle_bytes(deaf, &hex("000e4f407f400000000000717561"));
    let names = b"actual_q,target_q,actual_qd";
    let mut setup = vec![0, 11 + names.len() as u8, b'O'];
    setup.extend(500_f64.to_be_bytes());
    setup.extend(names);
    bench.controller.handle_bytes(deaf, &setup);
    bench.controller.handle_bytes(deaf, &hex("000353"));
    let mut cycles = 0;
    while bench.controller.is_connected(deaf) {
        bench.cycle().expect("linked");
        cycles += 1;
        assert!(cycles < 6000, "the deaf client is never cut");
    }
    // Ten seconds after its answers began to wait.
    assert!((4995..5020).contains(&cycles), "{cycles}");
    assert!(bench.cycle().expect("linked").is_some());
}

fn hex(text: &str) -> Vec<u8> {
    (0..text.len() / 2).map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).expect("hex")).collect()
}

fn answer(controller: &mut Controller, client: ClientId, bytes: &[u8]) -> Vec<u8> {
    controller.handle_bytes(client, bytes);
    let mut out = vec![0; 70_000];
    let count = controller.poll_transmit(client, &mut out);
    out.truncate(count);
    out
}

/// Bytes that ur_rtde 1.6.5 sends, and what a controller answers.
#[test]
fn bytes_of_a_foreign_client_get_the_bytes_it_expects() {
    let program = program(500, 0, 0.03);
    let mut controller = Controller::new(&UR10E, options(&program)).expect("legal");
    let client = controller.connect();
    assert_eq!(answer(&mut controller, client, &hex("0005560002")), hex("00045601"));
    assert_eq!(
        answer(&mut controller, client, &hex("000376")),
        hex("00137600000005 0000000b0000000600000001".replace(' ', "").as_str())
    );
    let mut setup = hex("00344f405f400000000000");
    setup.extend(b"timestamp,target_q,output_int_register_0,");
    let mut expected = hex("00194f01");
    expected.extend(b"DOUBLE,VECTOR6D,INT32");
    assert_eq!(answer(&mut controller, client, &setup), expected);
    // Input recipes of the same variable, data without a start.
    let mut watchdog = vec![0, 24, b'I'];
    watchdog.extend(b"input_int_register_0,");
    let mut expected = hex("00094901");
    expected.extend(b"INT32");
    assert_eq!(answer(&mut controller, client, &watchdog), expected);
    assert_eq!(answer(&mut controller, client, &hex("0008550100000001")), b"");
    controller.step();
    assert_eq!(controller.last_cycle().seq, 1);
    assert_eq!(answer(&mut controller, client, &hex("000353")), hex("00045301"));
    for _ in 0..8 {
        controller.step();
    }
    let data = answer(&mut controller, client, b"");
    // 125 of 500 Hz: one package of header, id, 8 + 48 + 4 bytes.
    assert_eq!(data.len(), 64);
    assert_eq!(data[..4], [0, 64, b'U', 1]);
    assert_eq!(answer(&mut controller, client, &hex("000350")), hex("00045001"));
    controller.step();
    assert_eq!(answer(&mut controller, client, b""), b"");
    // Unknown names and a broken header.
    let mut unknown = hex("00164f405f400000000000");
    unknown.extend(b"actual_q,xy");
    let mut expected = hex("00184f00");
    expected.extend(b"VECTOR6D,NOT_FOUND");
    let found = answer(&mut controller, client, &unknown);
    assert_eq!(found[4..], expected[4..]);
    assert_eq!(found[3], 0);
    assert!(controller.is_connected(client));
    answer(&mut controller, client, &hex("000200"));
    assert!(!controller.is_connected(client));
}

#[test]
fn protocol_1_has_no_rate_and_no_recipe_ids() {
    let program = program(500, 0, 0.03);
    let mut controller = Controller::new(&UR10E, options(&program)).expect("legal");
    let client = controller.connect();
    let mut setup = vec![0, 12, b'O'];
    setup.extend(b"timestamp");
    let mut expected = vec![0, 9, b'O'];
    expected.extend(b"DOUBLE");
    assert_eq!(answer(&mut controller, client, &setup), expected);
    answer(&mut controller, client, &hex("000353"));
    for _ in 0..8 {
        controller.step();
    }
    let data = answer(&mut controller, client, b"");
    assert_eq!(data[..3], [0, 11, b'U']);
    assert_eq!(data[3..], timestamp(41, 8, 500).to_be_bytes());
}

#[test]
fn random_and_mutated_bytes_never_panic_the_controller() {
    let program = program(500, 0, 0.03);
    let mut random = 0x5eed_0001_u64;
    let mut next = move || {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random
    };
    let mut controller = Controller::new(&UR10E, options(&program)).expect("legal");
    let mut seeds: Vec<Vec<u8>> =
        ["0005560002", "0005560001", "000376", "000353", "000350", "0008550200000001", "00074d0161"].map(hex).to_vec();
    let mut setup = hex("00344f405f400000000000");
    setup.extend(b"timestamp,target_q,output_int_register_0,");
    seeds.push(setup);
    let mut inputs = vec![0, 47, b'I'];
    inputs.extend(b"input_int_register_0,input_double_register_0");
    seeds.push(inputs);
    let mut client = controller.connect();
    let mut out = vec![0; 4096];
    for round in 0..200_000 {
        let mut bytes = seeds[(next() % seeds.len() as u64) as usize].clone();
        for _ in 0..next() % 3 {
            let place = (next() % bytes.len() as u64) as usize;
            bytes[place] = next() as u8;
        }
        if next() % 16 == 0 {
            bytes.truncate((next() % bytes.len() as u64) as usize);
        }
        controller.handle_bytes(client, &bytes);
        while controller.poll_transmit(client, &mut out) > 0 {}
        if !controller.is_connected(client) || round % 50 == 0 {
            controller.disconnect(client);
            client = controller.connect();
        }
        if round % 100 == 0 {
            controller.step();
        }
    }
}

#[test]
fn unknown_speeds_and_impossible_starts_are_refused() {
    let program = program(500, 0, 0.03);
    assert!(matches!(Controller::new(&UR18, options(&program)), Err(ControllerError::NoSpeeds { model: "ur18" })));
    let mut far = options(&program);
    far.start_q.0[4] = 7.0;
    assert!(matches!(Controller::new(&UR10E, far), Err(ControllerError::StartOutOfRange { joint: 4, .. })));
}
