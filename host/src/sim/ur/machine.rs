//! Runs a script, cycle by cycle.
//!
//! Scheduling follows the URScript manual ("Thread scheduling"): a thread runs until it uses up its time slice by an
//! instruction that takes robot time (`servoj`, `sync`) or by computing, and then not before the next cycle. So a loop that
//! does nothing neither ends the program nor moves the robot. The manual leaves the order of threads open; here those
//! started later come first, so that a setpoint read by a thread is used in the same cycle. A thread in a critical section
//! keeps the others waiting, also while it moves the robot.

mod calls;
mod compute;

use super::body::Body;
use super::cell::CellInputs;
use super::inputs::InputValues;
use super::messages::Popup;
use super::outputs::Outputs;
use super::script::ScriptError;
use super::script::code::{Name, Op, Scope, Script, Value};
use crate::link::rtde::program::WatchdogAction;
use std::sync::Arc;

/// The handle of the program's own thread; 0 is none, as scripts have it.
const MAIN: u32 = 1;
/// Instructions that a thread can compute in one cycle.
const SLICE: usize = 5000;
/// Threads that can run at once.
const RUNNING_MAX: usize = 32;
/// Calls inside each other.
const FRAMES_MAX: usize = 64;
/// Values on a thread's stack.
const STACK_MAX: usize = 1024;

/// What a script can reach.
pub(super) struct Surroundings<'a> {
    /// Number of this cycle.
    pub cycle: u64,
    /// Cycles per second.
    pub cycles_per_second: f64,
    /// The input registers.
    pub inputs: &'a InputValues,
    /// The output registers and the digital outputs.
    pub outputs: &'a mut Outputs,
    /// What the cell applies to the robot's inputs.
    pub cell: &'a CellInputs,
    /// The arm.
    pub body: &'a mut Body,
    /// Whether the program may move it: a secondary one may not.
    pub may_move: bool,
    /// Watchdogs that the script sets.
    pub watchdogs: &'a mut Vec<WatchdogRequest>,
    /// What it has to say.
    pub notices: &'a mut Vec<Notice>,
}

/// What a script tells the controller.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Notice {
    /// `textmsg`.
    Text(String),
    /// `popup`.
    Popup(Popup),
    /// `protective_stop()`.
    ProtectiveStop,
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

/// A program in progress.
#[derive(Clone, Debug)]
pub(super) struct Machine {
    script: Arc<Script>,
    globals: Vec<Option<Value>>,
    /// In the order of their start; the first is the program itself.
    threads: Vec<Thread>,
    threads_started: u32,
    /// The thread that is in a critical section.
    critical: Option<u32>,
}

/// What a thread waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Waiting {
    /// The cycle in which it runs again.
    Until(u64),
    /// The end of its own movement.
    Motion,
    /// The end of another thread.
    Thread(u32),
}

#[derive(Clone, Debug)]
struct Thread {
    id: u32,
    frames: Vec<Frame>,
    stack: Vec<Value>,
    waiting: Waiting,
}

/// A routine in progress.
#[derive(Clone, Debug)]
struct Frame {
    routine: usize,
    next: usize,
    locals: Vec<(Name, Value)>,
    /// Height of the stack when it began.
    base: usize,
}

/// How a slice ended.
enum Ended {
    Slice,
    Thread,
    Program,
}

impl Thread {
    fn new(id: u32, routine: usize, from_cycle: u64) -> Self {
        let frame = Frame { routine, next: 0, locals: Vec::new(), base: 0 };
        Self { id, frames: vec![frame], stack: Vec::new(), waiting: Waiting::Until(from_cycle) }
    }

    fn pop(&mut self) -> Value {
        // What the parser emits never takes more than it put.
        self.stack.pop().unwrap_or(Value::Nothing)
    }
}

impl Machine {
    /// A program at its start.
    pub(super) fn new(script: Script) -> Self {
        let globals = vec![None; script.names.len()];
        Self {
            script: Arc::new(script),
            globals,
            threads: vec![Thread::new(MAIN, 0, 0)],
            threads_started: MAIN,
            critical: None,
        }
    }

    /// The program's name.
    pub(super) fn name(&self) -> &str {
        self.script.routines.first().map_or("", |routine| &routine.name)
    }

    /// The line that the program itself is in, 0 before its first.
    pub(super) fn line(&self) -> u32 {
        let frame = self.threads.first().and_then(|thread| thread.frames.last());
        let line = frame.and_then(|frame| {
            let code = &self.script.routines.get(frame.routine)?.code;
            code.get(frame.next.checked_sub(1)?).map(|(line, _)| *line)
        });
        line.and_then(|line| u32::try_from(line).ok()).unwrap_or(0)
    }

    /// Runs every thread for one cycle; false when the program has ended.
    pub(super) fn step(&mut self, around: &mut Surroundings<'_>) -> Result<bool, ScriptError> {
        let ids: Vec<u32> = self.threads.iter().rev().map(|thread| thread.id).collect();
        for id in ids {
            // A thread may end others: it is looked for again.
            let Some(place) = self.threads.iter().position(|thread| thread.id == id) else { continue };
            if self.critical.is_some_and(|owner| owner != id) || !self.can_run(place, around) {
                continue;
            }
            let Some(mut thread) = self.threads.get_mut(place).map(Thread::take) else { continue };
            let ended = self.run_slice(&mut thread, around)?;
            match ended {
                Ended::Program => return Ok(false),
                Ended::Thread if id == MAIN => return Ok(false),
                Ended::Thread => self.end_thread(id, around),
                Ended::Slice => {
                    if let Some(place) = self.threads.iter_mut().find(|thread| thread.id == id) {
                        *place = thread;
                    }
                }
            }
        }
        Ok(true)
    }

    fn can_run(&self, place: usize, around: &Surroundings<'_>) -> bool {
        let Some(thread) = self.threads.get(place) else { return false };
        match thread.waiting {
            Waiting::Until(cycle) => cycle <= around.cycle,
            Waiting::Motion => !around.body.is_moving_for(thread.id),
            Waiting::Thread(other) => !self.threads.iter().any(|thread| thread.id == other),
        }
    }

    fn end_thread(&mut self, id: u32, around: &mut Surroundings<'_>) {
        self.threads.retain(|thread| thread.id != id);
        around.body.abandon(id);
        self.critical.take_if(|owner| *owner == id);
    }

    fn run_slice(&mut self, thread: &mut Thread, around: &mut Surroundings<'_>) -> Result<Ended, ScriptError> {
        let script = Arc::clone(&self.script);
        thread.waiting = Waiting::Until(around.cycle);
        for _ in 0..SLICE {
            let Some(frame) = thread.frames.last_mut() else { return Ok(Ended::Thread) };
            let code = script.routines.get(frame.routine).map(|routine| &routine.code);
            let Some((line, op)) = code.and_then(|code| code.get(frame.next)) else { return Ok(Ended::Thread) };
            frame.next += 1;
            match self.execute(thread, *line, op, around)? {
                Flow::On => {}
                Flow::Ended => return Ok(Ended::Program),
                Flow::Yield => return Ok(if thread.frames.is_empty() { Ended::Thread } else { Ended::Slice }),
            }
            if thread.stack.len() > STACK_MAX {
                return Err(ScriptError::TooMuch { line: *line, what: "values on the stack", limit: STACK_MAX });
            }
        }
        thread.waiting = Waiting::Until(around.cycle + 1);
        Ok(Ended::Slice)
    }

    fn execute(
        &mut self,
        thread: &mut Thread,
        line: usize,
        op: &Op,
        around: &mut Surroundings<'_>,
    ) -> Result<Flow, ScriptError> {
        match op {
            Op::Push(value) => thread.stack.push(value.clone()),
            Op::Load(name) => {
                let value = self.load(thread, line, *name)?.clone();
                thread.stack.push(value);
            }
            Op::Store(scope, name) => {
                let value = thread.pop();
                self.store(thread, *scope, *name, value);
            }
            Op::StoreElement(name) => {
                let (value, index) = (thread.pop(), thread.pop());
                compute::set_element(line, self.variable(thread, line, *name)?, &index, &value)?;
            }
            Op::Jump(target) => jump(thread, *target),
            Op::JumpUnless(target) => {
                if !compute::boolean(line, &thread.pop())? {
                    jump(thread, *target);
                }
            }
            Op::Drop => _ = thread.pop(),
            Op::Call(routine, count) => self.call_routine(thread, line, *routine, *count)?,
            Op::Return => {
                let value = thread.pop();
                let base = thread.frames.pop().map_or(0, |frame| frame.base);
                thread.stack.truncate(base);
                thread.stack.push(value);
                if thread.frames.is_empty() {
                    return Ok(Flow::Yield);
                }
            }
            Op::Run(_) | Op::Kill | Op::Join | Op::EnterCritical | Op::ExitCritical => {
                return self.schedule(thread, line, op, around);
            }
            Op::Halt => return Ok(Flow::Ended),
            Op::Missing(name) => return Err(ScriptError::NotSimulated { line, name }),
            Op::Builtin(builtin, places) => {
                let count = places.iter().flatten().count();
                let arguments = thread.stack.split_off(thread.stack.len().saturating_sub(count));
                let mut call = calls::Call { line, thread: thread.id, arguments: &arguments, places, around };
                let (value, waiting) = call.run(*builtin)?;
                thread.stack.push(value);
                if let Some(waiting) = waiting {
                    thread.waiting = waiting;
                    return Ok(Flow::Yield);
                }
            }
            _ => compute::compute(line, op, &mut thread.stack)?,
        }
        Ok(Flow::On)
    }

    /// The instructions between threads.
    fn schedule(
        &mut self,
        thread: &mut Thread,
        line: usize,
        op: &Op,
        around: &mut Surroundings<'_>,
    ) -> Result<Flow, ScriptError> {
        match op {
            Op::Run(routine) => {
                let handle = self.start_thread(line, *routine, around.cycle + 1)?;
                thread.stack.push(handle);
            }
            Op::Kill => {
                let id = compute::handle(line, &thread.pop())?;
                if id == thread.id {
                    thread.frames.clear();
                    return Ok(Flow::Yield);
                }
                // The program itself has no handle, and a thread that has ended is no error.
                if id != MAIN {
                    self.end_thread(id, around);
                }
            }
            Op::Join => {
                thread.waiting = Waiting::Thread(compute::handle(line, &thread.pop())?);
                return Ok(Flow::Yield);
            }
            Op::EnterCritical => self.critical = Some(thread.id),
            _ => self.critical = None,
        }
        Ok(Flow::On)
    }

    fn load<'a>(&'a self, thread: &'a Thread, line: usize, name: Name) -> Result<&'a Value, ScriptError> {
        let locals = thread.frames.last().map_or(&[][..], |frame| &frame.locals);
        let local = locals.iter().find(|(known, _)| *known == name).map(|(_, value)| value);
        local.or_else(|| self.globals.get(name)?.as_ref()).ok_or_else(|| self.undefined(line, name))
    }

    fn variable<'a>(
        &'a mut self,
        thread: &'a mut Thread,
        line: usize,
        name: Name,
    ) -> Result<&'a mut Value, ScriptError> {
        let undefined = self.undefined(line, name);
        let locals = thread.frames.last_mut().map(|frame| &mut frame.locals);
        let local = locals.and_then(|locals| locals.iter_mut().find(|(known, _)| *known == name));
        let global = self.globals.get_mut(name).and_then(Option::as_mut);
        local.map(|(_, value)| value).or(global).ok_or(undefined)
    }

    fn undefined(&self, line: usize, name: Name) -> ScriptError {
        ScriptError::Undefined { line, name: self.script.names.get(name).cloned().unwrap_or_default() }
    }

    fn store(&mut self, thread: &mut Thread, scope: Scope, name: Name, value: Value) {
        let (Some(frame), Some(global)) = (thread.frames.last_mut(), self.globals.get_mut(name)) else { return };
        let local = frame.locals.iter_mut().find(|(known, _)| *known == name);
        match (scope, local) {
            (Scope::Local | Scope::Nearest, Some((_, place))) => *place = value,
            (Scope::Local, None) => frame.locals.push((name, value)),
            (Scope::Nearest, None) if global.is_none() => frame.locals.push((name, value)),
            (Scope::Global, _) | (Scope::Nearest, None) => *global = Some(value),
        }
    }

    fn call_routine(&self, thread: &mut Thread, line: usize, routine: usize, count: usize) -> Result<(), ScriptError> {
        let Some(called) = self.script.routines.get(routine) else { return Ok(()) };
        if called.parameters.len() != count {
            let (name, expected) = (called.name.clone(), called.parameters.len());
            return Err(ScriptError::ArgumentCount { line, name, expected, found: count });
        }
        if thread.frames.len() >= FRAMES_MAX {
            return Err(ScriptError::TooMuch { line, what: "calls inside each other", limit: FRAMES_MAX });
        }
        let base = thread.stack.len().saturating_sub(count);
        let locals = called.parameters.iter().copied().zip(thread.stack.drain(base..)).collect();
        thread.frames.push(Frame { routine, next: 0, locals, base });
        Ok(())
    }

    fn start_thread(&mut self, line: usize, routine: usize, from_cycle: u64) -> Result<Value, ScriptError> {
        if self.threads.len() >= RUNNING_MAX {
            return Err(ScriptError::TooMuch { line, what: "running threads", limit: RUNNING_MAX });
        }
        self.threads_started += 1;
        let id = self.threads_started;
        self.threads.push(Thread::new(id, routine, from_cycle));
        Ok(Value::Number(f64::from(id)))
    }
}

/// What follows an instruction.
enum Flow {
    On,
    Yield,
    Ended,
}

impl Thread {
    /// The thread's state, while an empty one of the same handle keeps its place.
    fn take(&mut self) -> Self {
        let empty = Self { id: self.id, frames: Vec::new(), stack: Vec::new(), waiting: self.waiting };
        std::mem::replace(self, empty)
    }
}

fn jump(thread: &mut Thread, target: usize) {
    if let Some(frame) = thread.frames.last_mut() {
        frame.next = target;
    }
}
