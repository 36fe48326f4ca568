//! The language: what is understood, what is refused, what it does.

use super::*;
use crate::link::rtde::program::{Program, WatchdogAction};
use crate::sim::ur::fields::{InputValues, REGISTERS};
use crate::sim::ur::machine::{Machine, Surroundings, WatchdogRequest};
use crate::sim::ur::servo::ServoCommand;

const START: [f64; 6] = [0.3, -1.2, 1.9, -2.2, -1.5, 0.1];

fn own_program() -> String {
    let watchdog_action = WatchdogAction::Pause;
    let (lookahead, gain, watchdog) = (0.1, 300.0, 0.2);
    let program = Program { rate_hz: 125, register_offset: 0, lookahead, gain, watchdog, watchdog_action };
    program.text().expect("legal")
}

/// A machine and what it reaches.
struct Stage {
    machine: Machine,
    inputs: InputValues,
    output_int: [i32; REGISTERS],
    motion: Option<ServoCommand>,
    watchdogs: Vec<WatchdogRequest>,
    cycle: u64,
}

impl Stage {
    fn new(script: Script) -> Self {
        let (machine, inputs) = (Machine::new(script), InputValues::new());
        Self { machine, inputs, output_int: [0; REGISTERS], motion: None, watchdogs: Vec::new(), cycle: 0 }
    }

    fn of(body: &str) -> Self {
        Self::new(parse(&format!("def test():\n{body}\nend\n")).expect("a script that loads"))
    }

    fn set_double(&mut self, register: usize, value: f64) {
        let (place, _) = self.inputs.find(format!("input_double_register_{register}").as_bytes()).expect("a register");
        self.inputs.set(place, &value.to_be_bytes());
    }

    fn set_int(&mut self, register: usize, value: i32) {
        let (place, _) = self.inputs.find(format!("input_int_register_{register}").as_bytes()).expect("a register");
        self.inputs.set(place, &value.to_be_bytes());
    }

    fn step(&mut self) -> Result<bool, ScriptError> {
        self.cycle += 1;
        self.machine.step(&mut Surroundings {
            cycle: self.cycle,
            cycles_per_second: 500.0,
            inputs: &self.inputs,
            output_int: &mut self.output_int,
            actual_q: START,
            motion: &mut self.motion,
            watchdogs: &mut self.watchdogs,
        })
    }
}

#[test]
fn the_own_program_holds_until_the_first_setpoint_and_then_follows() {
    let mut stage = Stage::new(parse(&own_program()).expect("loads"));
    for _ in 0..10 {
        assert_eq!(stage.step(), Ok(true));
    }
    assert_eq!((stage.output_int[0], &stage.motion, stage.watchdogs.len()), (1, &None, 0));
    // A number alone, with the registers still zero, is no setpoint.
    stage.set_int(0, 1);
    assert_eq!(stage.step(), Ok(true));
    assert_eq!(stage.motion, None);
    stage.set_int(0, 2);
    for register in 0..6 {
        stage.set_double(register, 0.5);
    }
    assert_eq!(stage.step(), Ok(true));
    let command = stage.motion.clone().expect("a command");
    assert_eq!(command, ServoCommand { target: [0.5; 6], time: 0.008, lookahead: 0.1, gain: 300.0 });
    assert_eq!(stage.output_int[0], 2);
    let (place, _) = stage.inputs.find(b"input_int_register_0").expect("a register");
    assert_eq!(stage.watchdogs, [WatchdogRequest { input: place, period: 0.2, action: WatchdogAction::Pause }]);
    // The same number again is no new setpoint; servoj holds for four cycles of 2 ms.
    stage.set_double(3, 0.6);
    for _ in 0..8 {
        assert_eq!(stage.step(), Ok(true));
        assert_eq!(stage.motion.as_ref(), Some(&command));
    }
    stage.set_int(0, 3);
    let held = (0..8).take_while(|_| stage.step() == Ok(true) && stage.motion.as_ref() == Some(&command)).count();
    assert!(held < 4, "{held} cycles held");
    assert_eq!(stage.motion.as_ref().map(|command| command.target[3]), Some(0.6));
}

#[test]
fn conditions_loops_and_scopes_compute_what_they_say() {
    let mut stage = Stage::of(
        "global count = 0
  local sign = -1
  thread other():
    local sign = 5
    count = sign
  end
  local handle = run other()
  if (sign < 0):
    write_output_integer_register(1, 11)
  else:
    write_output_integer_register(1, 12)
  end
  if (1 >= 2):
    write_output_integer_register(2, 1)
  else:
    write_output_integer_register(2, 2)
  end
  while (count == 0):
    sync()
  end
  write_output_integer_register(3, count)
  write_output_integer_register(4, sign)
  write_output_integer_register(5, norm([3, 4]))  # a comment
  if (not (\"a\" == \"b\")):
    write_output_integer_register(6, -2.5e1)
  end",
    );
    let cycles = (1..10).find(|_| stage.step() == Ok(false));
    assert_eq!(cycles, Some(2), "the main thread ends, and the program with it");
    assert_eq!(stage.output_int[..7], [0, 11, 2, 5, -1, 5, -25]);
}

#[test]
fn a_loop_that_takes_no_time_gives_the_cycle_back_and_moves_nothing() {
    let mut stage = Stage::of("while (True):\n end");
    for _ in 0..3 {
        assert_eq!(stage.step(), Ok(true));
        assert_eq!(stage.motion, None);
    }
}

#[test]
fn what_is_not_known_is_refused_with_its_line() {
    let nested = format!("a = {}1{}", "(".repeat(100), ")".repeat(100));
    let cases = [
        ("popup(\"hello\")", "line 2: function popup is not known"),
        ("a = run nothing()", "line 2: thread nothing is not defined"),
        ("sync(1)", "line 2: sync takes 0 arguments, found 1"),
        ("a = 1 + 2", "line 2: name, number, string or operator expected, found +"),
        ("a = 1 2", "line 2: the end of the line expected, found 2"),
        ("a = \"open", "line 2: closing quote expected"),
        ("a = 1.2.3", "line 2: number expected, found 1.2.3"),
        ("else:", "line 2: statement expected, found else"),
        ("def inner():", "line 2: statement expected, found def"),
        ("end\nx = 1", "line 3: nothing behind the program expected"),
        ("while (True):", "line 3: 'end' expected, found the end of the script"),
        (nested.as_str(), "line 2: more than 32 nested expressions"),
    ];
    for (body, told) in cases {
        let error = parse(&format!("def test():\n{body}\nend\n")).err().map(|error| error.to_string());
        assert!(error.as_ref().is_some_and(|error| error.starts_with(told)), "{body}: {error:?}");
    }
    assert!(parse("").is_err());
    assert!(parse("x = 1").is_err());
}

#[test]
fn what_cannot_be_computed_ends_the_program_with_its_line() {
    let cases = [
        ("a = b", "line 2: variable b is not set"),
        ("a = -True", "line 2: number expected, found true"),
        ("if (3):\nend", "line 2: True or False expected, found 3"),
        ("a = read_input_float_register(48)", "line 2: register 0 to 47 expected, found 48"),
        ("a = read_input_integer_register(0.5)", "line 2: register 0 to 47 expected"),
        ("rtde_set_watchdog(\"timestamp\", 1, \"stop\")", "line 2: name of an RTDE input expected"),
        ("rtde_set_watchdog(\"input_int_register_0\", 0, \"stop\")", "line 2: number within the range"),
        (
            "rtde_set_watchdog(\"input_int_register_0\", 1, \"bark\")",
            "line 2: \"ignore\", \"pause\" or \"stop\" expected",
        ),
        ("servoj([1, 2], 0, 0, 0.002, 0.1, 300)", "line 2: list of six joint positions"),
        ("servoj(get_actual_joint_positions(), 0, 0, 0.002, 0.02, 300)", "line 2: number within the range"),
        ("servoj(get_actual_joint_positions(), 0, 0, 0.002, 0.1, 3000)", "line 2: number within the range"),
        ("a = [1, 2] < [3, 4]", "line 2: two values that can be compared"),
        ("thread t():\nsync()\nend\nwhile (True):\na = run t()\nend", "line 6: more than 32 running threads"),
    ];
    for (body, told) in cases {
        let mut stage = Stage::of(body);
        let error = (0..3).find_map(|_| stage.step().err()).map(|error| error.to_string());
        assert!(error.as_ref().is_some_and(|error| error.starts_with(told)), "{body}: {error:?}");
    }
    let mut stage = Stage::of(
        "thread t():\nservoj(get_actual_joint_positions(), 0, 0, 0.1, 0.1, 300)\nend\na = run t()\nsync()\nsync()\n\
         servoj(get_actual_joint_positions(), 0, 0, 0.1, 0.1, 300)",
    );
    assert_eq!((0..5).find_map(|_| stage.step().err()), Some(ScriptError::SecondMover { line: 8 }));
}

#[test]
fn random_and_mutated_scripts_never_panic_the_interpreter() {
    let mut random = 0x5eed_0002_u64;
    let mut next = move || {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random
    };
    let text = own_program();
    let lines: Vec<&str> = text.lines().collect();
    let mut loaded = 0;
    for _ in 0..2_000 {
        let mut mutated: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
        for _ in 0..=next() % 2 {
            let place = (next() % mutated.len() as u64) as usize;
            match next() % 4 {
                0 => _ = mutated.remove(place),
                1 => mutated[place] = lines[(next() % lines.len() as u64) as usize].to_owned(),
                2 => mutated.insert(place, lines[(next() % lines.len() as u64) as usize].to_owned()),
                _ => {
                    let column = (next() % (mutated[place].len() as u64 + 1)) as usize;
                    mutated[place].insert(column, char::from((next() % 128) as u8));
                }
            }
        }
        let Ok(script) = parse(&mutated.join("\n")) else { continue };
        loaded += 1;
        let mut stage = Stage::new(script);
        for _ in 1..20 {
            match stage.step() {
                Ok(true) => {}
                Ok(false) | Err(ScriptError::Undefined { .. } | ScriptError::Value { .. }) => break,
                Err(other) => assert!(matches!(other, ScriptError::TooMuch { .. } | ScriptError::SecondMover { .. })),
            }
        }
    }
    assert!(loaded > 100, "only {loaded} mutants could be loaded");
}
