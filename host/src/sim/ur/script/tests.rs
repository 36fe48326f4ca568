//! The language: what is understood, what is refused, what it does.

use super::code::Script;
use super::*;
use crate::link::rtde::program::{Program, WatchdogAction};
use crate::sim::ur::body::Body;
use crate::sim::ur::cell::CellInputs;
use crate::sim::ur::inputs::InputValues;
use crate::sim::ur::machine::{Machine, Notice, Surroundings, WatchdogRequest};
use crate::sim::ur::outputs::Outputs;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);

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
    outputs: Outputs,
    body: Body,
    watchdogs: Vec<WatchdogRequest>,
    notices: Vec<Notice>,
    cycle: u64,
}

impl Stage {
    fn new(script: Script) -> Self {
        let (machine, inputs) = (Machine::new(script), InputValues::new());
        let speeds = UR10E.velocity_max.known().expect("known");
        let body = Body::new(UR10E, speeds, START, Pose::from_translation(0.0, 0.0, 0.2), 0.002);
        let (watchdogs, notices) = (Vec::new(), Vec::new());
        Self { machine, inputs, outputs: Outputs::new(), body, watchdogs, notices, cycle: 0 }
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
        self.body.expire(self.cycle);
        let ran = self.machine.step(&mut Surroundings {
            cycle: self.cycle,
            cycles_per_second: 500.0,
            inputs: &self.inputs,
            outputs: &mut self.outputs,
            cell: &CellInputs { digital: 1 << 3 | 1 << 9 | 1 << 17, analog: [1.5, 0.0, 0.0, 2.5] },
            body: &mut self.body,
            may_move: true,
            watchdogs: &mut self.watchdogs,
            notices: &mut self.notices,
        });
        self.body.step().expect("possible");
        ran
    }

    /// Cycles until the program ends, at most so many.
    fn run(&mut self, most: usize) -> usize {
        let cycles = (1..=most).find(|_| !self.step().expect("no error"));
        cycles.expect("the program ends")
    }
}

#[test]
fn the_own_program_holds_until_the_first_setpoint_and_then_follows() {
    let mut stage = Stage::new(parse(&own_program()).expect("loads"));
    for _ in 0..10 {
        assert_eq!(stage.step(), Ok(true));
    }
    assert_eq!((stage.outputs.int(0), stage.body.servo_target(), stage.watchdogs.len()), (1, None, 0));
    // A number alone, with the registers still zero, is no setpoint.
    stage.set_int(0, 1);
    assert_eq!(stage.step(), Ok(true));
    assert_eq!(stage.body.servo_target(), None);
    stage.set_int(0, 2);
    for (register, joint) in START.0.iter().enumerate() {
        stage.set_double(register, joint + 0.001);
    }
    assert_eq!(stage.step(), Ok(true));
    let command = stage.body.servo_target().expect("a command");
    assert_eq!(command, START.0.map(|joint| joint + 0.001));
    assert_eq!(stage.outputs.int(0), 2);
    let (place, _) = stage.inputs.find(b"input_int_register_0").expect("a register");
    assert_eq!(stage.watchdogs, [WatchdogRequest { input: place, period: 0.2, action: WatchdogAction::Pause }]);
    // The same number again is no new setpoint; servoj holds for four cycles of 2 ms.
    stage.set_double(3, START.0[3] + 0.002);
    for _ in 0..8 {
        assert_eq!(stage.step(), Ok(true));
        assert_eq!(stage.body.servo_target(), Some(command));
    }
    stage.set_int(0, 3);
    let held = (0..8).take_while(|_| stage.step() == Ok(true) && stage.body.servo_target() == Some(command)).count();
    assert!(held < 4, "{held} cycles held");
    assert_eq!(stage.body.servo_target().map(|target| target[3]), Some(START.0[3] + 0.002));
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
    let found: Vec<i32> = (0..7).map(|register| stage.outputs.int(register)).collect();
    assert_eq!(found, [0, 11, 2, 5, -1, 5, -25]);
}

#[test]
fn a_loop_that_takes_no_time_gives_the_cycle_back_and_moves_nothing() {
    let mut stage = Stage::of("while (True):\n end");
    for _ in 0..3 {
        assert_eq!(stage.step(), Ok(true));
        assert_eq!(stage.body.servo.qd.0, [0.0; 6]);
    }
}

#[test]
fn what_is_not_known_is_refused_with_its_line() {
    let nested = format!("a = {}1{}", "(".repeat(100), ")".repeat(100));
    let cases = [
        ("greet(\"hello\")", "line 2: function greet is not known"),
        ("a = run nothing()", "line 2: thread nothing is not defined"),
        ("sync(1)", "line 2: sync takes 0 arguments, found 1"),
        ("servoj(t=1)", "line 2: servoj takes 6 arguments, found 1"),
        ("servoj([0], q=[0])", "line 2: servoj takes 6 arguments, found 2"),
        ("servoj([0], speed=1)", "line 2: name of a parameter expected, found speed"),
        ("a = 1 ~ 2", "line 2: name, number, string or operator expected, found ~"),
        ("a = 1 2", "line 2: statement expected, found 2"),
        ("a = \"open", "line 2: closing quote expected"),
        ("a = 1.2.3", "line 2: number expected, found 1.2.3"),
        ("else:", "line 2: 'end' expected, found else"),
        ("break", "line 2: statement expected, found break"),
        ("a = p[1, 2]", "line 2: six numbers of a pose expected"),
        ("def test():\nend", "line 2: a name not yet taken expected, found test"),
        ("end\nx = 1", "line 3: nothing behind the program expected"),
        ("while (True):", "line 3: 'end' expected, found the end of the script"),
        (nested.as_str(), "line 2: more than 32 levels of nested blocks and expressions"),
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
        ("a = -True", "line 2: number expected, found True"),
        ("a = 1 / 0", "line 2: divisor other than zero expected, found 0"),
        ("a = [1]\na[1] = 2", "line 3: index of an element expected, found 1"),
        ("a = [1] + 1 + \"x\"", "line 2: two values that can be computed expected"),
        ("force_mode(1, 2)", "line 2: force_mode is not simulated"),
        ("def f(x):\nreturn f(x)\nend\nf(1)", "line 3: more than 64 calls inside each other"),
        ("def f(x):\nreturn x\nend\nf()", "line 5: f takes 1 arguments, found 0"),
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
                Ok(false)
                | Err(ScriptError::Undefined { .. } | ScriptError::Value { .. } | ScriptError::ArgumentCount { .. }) => {
                    break;
                }
                Err(other) => assert!(matches!(other, ScriptError::TooMuch { .. } | ScriptError::SecondMover { .. })),
            }
        }
    }
    assert!(loaded > 100, "only {loaded} mutants could be loaded");
}

#[test]
fn routines_arguments_and_lists_compute_what_they_say() {
    let mut stage = Stage::of(
        "global total = 0
  def add(p, q):
    if q == 0:
      return p[0]
    elif q == 1:
      p[0] = p[0] + 10 return p[0]
    else:
      total = total + q
    end
  end
  list = [1, 2, 3]
  write_output_integer_register(0, add(list, 0) + add(list, 1) + list[0])
  add(list, 5)
  while True:
    total = total + 1
    if total < 8: continue end
    if total >= 10 or False:
      break
    end
  end
  write_output_integer_register(1, total * 2 - 7 % 4)
  write_output_float_register(2, -2 * (1 + 3) / 16)
  write_output_integer_register(3,
    4)
  place = p[1, 2, 3, 0, 0, 0]
  place[2] = 7
  write_output_float_register(3, place[2])
  write_output_boolean_register(70, (True xor False) and not False)",
    );
    assert_eq!(stage.run(3), 1);
    assert_eq!([0, 1, 3].map(|register| stage.outputs.int(register)), [1 + 11 + 1, 17, 4]);
    assert_eq!([2, 3].map(|register| stage.outputs.double(register)), [-0.5, 7.0]);
    assert!(stage.outputs.bit(70) && !stage.outputs.bit(71));
}

#[test]
fn threads_are_killed_joined_and_kept_out_of_critical_sections() {
    let mut stage = Stage::of(
        "global count = 0
  thread counter():
    while True:
      count = count + 1
      sync()
    end
  end
  thread short():
    sleep(0.02)
    write_output_integer_register(1, count)
  end
  handle = run counter()
  sleep(0.01)
  enter_critical
  kept = count
  sleep(0.01)
  write_output_integer_register(0, count - kept)
  exit_critical
  join run short()
  kill handle
  kill 0
  last = count
  sleep(0.01)
  write_output_integer_register(2, count - last)",
    );
    stage.run(100);
    assert_eq!([0, 2].map(|register| stage.outputs.int(register)), [0, 0]);
    // Five cycles before the critical section, ten while the short thread slept; one thread may run before the other.
    assert!((14..=17).contains(&stage.outputs.int(1)), "{}", stage.outputs.int(1));
}

#[test]
fn lines_for_the_teach_pendant_are_passed_over_and_keep_their_numbers() {
    let saved = |call| format!("def saved():\n  $ 1 \"Robot Program\"\n  $ 2 \"if (x ≟ 1\"\n  {call}\nend\n");
    assert!(parse(&saved("x = 1")).is_ok());
    assert_eq!(parse(&saved("nothing()")).expect_err("unknown").line(), 4);
    assert!(parse("def a():\n  x = $ 1\nend\n").is_err());
}
