//! Runs a script, cycle by cycle.
//!
//! Scheduling follows the URScript manual ("Thread scheduling"): a thread runs until it uses up its time slice by an
//! instruction that takes robot time (`servoj`, `sync`) or by computing, and then not before the next cycle. So a loop that
//! does nothing neither ends the program nor moves the robot. The manual leaves the order of threads open; here those
//! started later come first, so that a setpoint read by a thread is used in the same cycle.

use super::fields::InputValues;
use super::script::{Code, Comparison, Expression, Function, Instruction, Scope, Script, ScriptError};
use super::servo::ServoCommand;
use crate::link::rtde::program::{GAIN_RANGE, LOOKAHEAD_RANGE, WatchdogAction};
use std::collections::BTreeMap;

/// Instructions that a thread can compute in one cycle.
const SLICE: usize = 1000;
/// Threads that can run at once.
const RUNNING_MAX: usize = 32;
/// Length of a list that a script can build.
const LIST_MAX: usize = 64;

/// What a script can reach.
pub(super) struct Surroundings<'a> {
    /// Number of this cycle.
    pub cycle: u64,
    /// Cycles per second.
    pub cycles_per_second: f64,
    /// The input registers.
    pub inputs: &'a InputValues,
    /// The output integer registers.
    pub output_int: &'a mut [i32; 48],
    /// Where the joints are (rad).
    pub actual_q: [f64; 6],
    /// What the robot shall do in this cycle.
    pub motion: &'a mut Option<ServoCommand>,
    /// Watchdogs that the script sets.
    pub watchdogs: &'a mut Vec<WatchdogRequest>,
}

/// A call of `rtde_set_watchdog`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct WatchdogRequest {
    /// The input, as its place in the table of inputs.
    pub input: usize,
    /// Longest time between two updates (s).
    pub period: f64,
    /// What happens then.
    pub action: WatchdogAction,
}

#[derive(Clone, Debug, PartialEq)]
enum Value {
    Nothing,
    Number(f64),
    Boolean(bool),
    Text(String),
    List(Vec<f64>),
    Thread,
}

/// A program in progress.
#[derive(Clone, Debug)]
pub(super) struct Machine {
    script: Script,
    globals: BTreeMap<String, Value>,
    /// The first is the main thread.
    threads: Vec<Thread>,
    /// The thread whose `servoj` is going on, its end (cycle) and the command.
    moving: Option<(usize, u64, ServoCommand)>,
    threads_started: usize,
}

#[derive(Clone, Debug)]
struct Thread {
    id: usize,
    /// None: the main code.
    code: Option<usize>,
    next: usize,
    locals: BTreeMap<String, Value>,
    /// First cycle in which it may run.
    runnable_from: u64,
}

impl Machine {
    pub(super) fn new(script: Script) -> Self {
        let main = Thread { id: 0, code: None, next: 0, locals: BTreeMap::new(), runnable_from: 0 };
        Self { script, globals: BTreeMap::new(), threads: vec![main], moving: None, threads_started: 1 }
    }

    /// Runs every thread for one cycle; false when the program has ended.
    pub(super) fn step(&mut self, around: &mut Surroundings<'_>) -> Result<bool, ScriptError> {
        if self.moving.as_ref().is_some_and(|(_, end, _)| *end <= around.cycle) {
            self.moving = None;
        }
        let mut started = Vec::new();
        for index in (0..self.threads.len()).rev() {
            let Some(mut thread) = self.threads.get_mut(index).map(std::mem::take) else { continue };
            let ended = self.run_slice(&mut thread, around, &mut started)?;
            if ended && thread.code.is_none() {
                return Ok(false);
            }
            if ended {
                self.threads.remove(index);
            } else if let Some(place) = self.threads.get_mut(index) {
                *place = thread;
            }
        }
        self.threads.append(&mut started);
        *around.motion = self.moving.as_ref().map(|(_, _, command)| command.clone());
        Ok(true)
    }

    fn run_slice(
        &mut self,
        thread: &mut Thread,
        around: &mut Surroundings<'_>,
        started: &mut Vec<Thread>,
    ) -> Result<bool, ScriptError> {
        for _ in 0..SLICE {
            if thread.runnable_from > around.cycle {
                return Ok(false);
            }
            let code: &Code = match thread.code {
                None => &self.script.main,
                Some(index) => match self.script.threads.get(index) {
                    Some(code) => code,
                    None => return Ok(true),
                },
            };
            let Some((line, instruction)) = code.get(thread.next) else { return Ok(true) };
            let mut evaluation = Evaluation {
                line: *line,
                globals: &self.globals,
                thread: &mut *thread,
                around: &mut *around,
                moving: &mut self.moving,
                started: &mut *started,
                running: self.threads.len(),
                threads_started: &mut self.threads_started,
            };
            let mut next = evaluation.thread.next + 1;
            match instruction {
                Instruction::Jump(target) => next = *target,
                Instruction::JumpUnless(condition, target) => {
                    if !evaluation.boolean(condition)? {
                        next = *target;
                    }
                }
                Instruction::Evaluate(expression) => _ = evaluation.value(expression)?,
                Instruction::Assign(scope, name, expression) => {
                    let value = evaluation.value(expression)?;
                    let local = match scope {
                        Scope::Global => false,
                        Scope::Local => true,
                        Scope::Nearest => thread.locals.contains_key(name) || !self.globals.contains_key(name),
                    };
                    let variables = if local { &mut thread.locals } else { &mut self.globals };
                    match variables.get_mut(name) {
                        Some(place) => *place = value,
                        None => _ = variables.insert(name.clone(), value),
                    }
                }
            }
            thread.next = next;
        }
        Ok(false)
    }
}

impl Default for Thread {
    /// A thread that has ended; stands in while the real one runs.
    fn default() -> Self {
        Self { id: usize::MAX, code: Some(usize::MAX), next: 0, locals: BTreeMap::new(), runnable_from: 0 }
    }
}

/// One instruction being computed.
struct Evaluation<'a, 'b> {
    line: usize,
    globals: &'a BTreeMap<String, Value>,
    thread: &'a mut Thread,
    around: &'a mut Surroundings<'b>,
    moving: &'a mut Option<(usize, u64, ServoCommand)>,
    started: &'a mut Vec<Thread>,
    running: usize,
    threads_started: &'a mut usize,
}

impl Evaluation<'_, '_> {
    fn wrong(&self, expected: &'static str, found: &Value) -> ScriptError {
        let found = match found {
            Value::Nothing => "nothing".to_owned(),
            Value::Number(value) => value.to_string(),
            Value::Boolean(value) => value.to_string(),
            Value::Text(text) => format!("\"{text}\""),
            Value::List(values) => format!("{values:?}"),
            Value::Thread => "a thread".to_owned(),
        };
        ScriptError::Value { line: self.line, expected, found }
    }

    fn value(&mut self, expression: &Expression) -> Result<Value, ScriptError> {
        Ok(match expression {
            Expression::Number(value) => Value::Number(*value),
            Expression::Boolean(value) => Value::Boolean(*value),
            Expression::Text(text) => Value::Text(text.clone()),
            Expression::Variable(name) => {
                let found = self.thread.locals.get(name).or_else(|| self.globals.get(name));
                found.cloned().ok_or_else(|| ScriptError::Undefined { line: self.line, name: name.clone() })?
            }
            Expression::List(items) if items.len() > LIST_MAX => {
                return Err(ScriptError::TooMuch { line: self.line, what: "elements of a list", limit: LIST_MAX });
            }
            Expression::List(items) => {
                Value::List(items.iter().map(|item| self.number(item)).collect::<Result<_, _>>()?)
            }
            Expression::Not(inner) => Value::Boolean(!self.boolean(inner)?),
            Expression::Negate(inner) => Value::Number(-self.number(inner)?),
            Expression::Compare(how, left, right) => Value::Boolean(self.compare(*how, left, right)?),
            Expression::Run(index) => self.start(*index)?,
            Expression::Call(function, arguments) => self.call(*function, arguments)?,
        })
    }

    fn boolean(&mut self, expression: &Expression) -> Result<bool, ScriptError> {
        match self.value(expression)? {
            Value::Boolean(value) => Ok(value),
            other => Err(self.wrong("True or False", &other)),
        }
    }

    fn number(&mut self, expression: &Expression) -> Result<f64, ScriptError> {
        match self.value(expression)? {
            Value::Number(value) => Ok(value),
            other => Err(self.wrong("number", &other)),
        }
    }

    fn text(&mut self, expression: &Expression) -> Result<String, ScriptError> {
        match self.value(expression)? {
            Value::Text(text) => Ok(text),
            other => Err(self.wrong("string", &other)),
        }
    }

    fn number_in(&mut self, expression: &Expression, [min, max]: [f64; 2]) -> Result<f64, ScriptError> {
        let value = self.number(expression)?;
        if (min..=max).contains(&value) {
            return Ok(value);
        }
        Err(self.wrong("number within the range of the URScript manual", &Value::Number(value)))
    }

    fn compare(&mut self, how: Comparison, left: &Expression, right: &Expression) -> Result<bool, ScriptError> {
        let left = self.value(left)?;
        let right = self.value(right)?;
        match (how, &left, &right) {
            (_, Value::Number(a), Value::Number(b)) => Ok(match how {
                Comparison::Equal => a == b,
                Comparison::NotEqual => a != b,
                Comparison::Less => a < b,
                Comparison::LessOrEqual => a <= b,
                Comparison::Greater => a > b,
                Comparison::GreaterOrEqual => a >= b,
            }),
            (Comparison::Equal, ..) if std::mem::discriminant(&left) == std::mem::discriminant(&right) => {
                Ok(left == right)
            }
            (Comparison::NotEqual, ..) if std::mem::discriminant(&left) == std::mem::discriminant(&right) => {
                Ok(left != right)
            }
            _ => Err(self.wrong("two values that can be compared", &right)),
        }
    }

    fn start(&mut self, index: usize) -> Result<Value, ScriptError> {
        if self.running + self.started.len() >= RUNNING_MAX {
            return Err(ScriptError::TooMuch { line: self.line, what: "running threads", limit: RUNNING_MAX });
        }
        let id = *self.threads_started;
        *self.threads_started += 1;
        let runnable_from = self.around.cycle + 1;
        self.started.push(Thread { id, code: Some(index), next: 0, locals: BTreeMap::new(), runnable_from });
        Ok(Value::Thread)
    }

    fn register(&mut self, expression: &Expression) -> Result<usize, ScriptError> {
        let number = self.number(expression)?;
        let found = (0..48_u32).find(|index| f64::from(*index) == number);
        let found = found.ok_or_else(|| self.wrong("register 0 to 47", &Value::Number(number)))?;
        Ok(found as usize)
    }

    fn call(&mut self, function: Function, arguments: &[Expression]) -> Result<Value, ScriptError> {
        Ok(match (function, arguments) {
            (Function::ReadInputFloat, [register]) => {
                let register = self.register(register)?;
                Value::Number(self.around.inputs.double(register))
            }
            (Function::ReadInputInteger, [register]) => {
                let register = self.register(register)?;
                Value::Number(f64::from(self.around.inputs.int(register)))
            }
            (Function::WriteOutputInteger, [register, value]) => {
                let register = self.register(register)?;
                let value = self.number_in(value, [f64::from(i32::MIN), f64::from(i32::MAX)])?;
                if let Some(place) = self.around.output_int.get_mut(register) {
                    *place = value as i32;
                }
                Value::Nothing
            }
            (Function::ActualJointPositions, []) => Value::List(self.around.actual_q.to_vec()),
            (Function::Norm, [list]) => match self.value(list)? {
                Value::List(values) => Value::Number(values.iter().map(|value| value * value).sum::<f64>().sqrt()),
                other => return Err(self.wrong("list", &other)),
            },
            (Function::Sync, []) => {
                self.thread.runnable_from = self.around.cycle + 1;
                Value::Nothing
            }
            (Function::SetWatchdog, [input, frequency, action]) => self.set_watchdog(input, frequency, action)?,
            (Function::Servoj, [joints, _, _, time, lookahead, gain]) => {
                self.servoj(joints, [time, lookahead, gain])?
            }
            // The parser has counted the arguments.
            _ => return Err(self.wrong("another number of arguments", &Value::Nothing)),
        })
    }

    fn set_watchdog(
        &mut self,
        input: &Expression,
        frequency: &Expression,
        action: &Expression,
    ) -> Result<Value, ScriptError> {
        let name = self.text(input)?;
        let frequency = self.number_in(frequency, [f64::MIN_POSITIVE, self.around.cycles_per_second])?;
        let action = self.text(action)?;
        let action = match action.as_str() {
            "ignore" => WatchdogAction::Ignore,
            "pause" => WatchdogAction::Pause,
            "stop" => WatchdogAction::Stop,
            _ => return Err(self.wrong("\"ignore\", \"pause\" or \"stop\"", &Value::Text(action))),
        };
        let Some((input, _)) = self.around.inputs.find(name.as_bytes()) else {
            return Err(self.wrong("name of an RTDE input", &Value::Text(name)));
        };
        self.around.watchdogs.push(WatchdogRequest { input, period: 1.0 / frequency, action });
        Ok(Value::Nothing)
    }

    fn servoj(&mut self, joints: &Expression, [time, lookahead, gain]: [&Expression; 3]) -> Result<Value, ScriptError> {
        let joints = self.value(joints)?;
        let target: [f64; 6] = match &joints {
            Value::List(values) => values.as_slice().try_into().ok(),
            _ => None,
        }
        .ok_or_else(|| self.wrong("list of six joint positions", &joints))?;
        let period = 1.0 / self.around.cycles_per_second;
        let time = self.number_in(time, [period, 1.0])?;
        let lookahead = self.number_in(lookahead, LOOKAHEAD_RANGE)?;
        let gain = self.number_in(gain, GAIN_RANGE)?;
        if self.moving.as_ref().is_some_and(|(id, ..)| *id != self.thread.id) {
            return Err(ScriptError::SecondMover { line: self.line });
        }
        // `time` is at most a second: a few hundred cycles.
        let end = self.around.cycle + (time * self.around.cycles_per_second).round() as u64;
        self.thread.runnable_from = end;
        *self.moving = Some((self.thread.id, end, ServoCommand { target, time, lookahead, gain }));
        Ok(Value::Nothing)
    }
}
