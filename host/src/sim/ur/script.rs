//! URScript as far as Screed's robot program needs it: text to instructions. What is not known is an error with its line,
//! never skipped.
//!
//! Known: one `def name():` with statements and `thread name():` blocks inside, `while`, `if`, `else`, `end`, assignments with
//! `global` and `local`, `run thread()`, numbers, booleans, strings, lists, `not`, unary minus, comparisons, and the calls of
//! [`Function`].

mod lexer;
mod parser;
#[cfg(test)]
mod tests;

pub use parser::parse;

/// Why a script cannot be loaded or run on. Lines count from 1.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ScriptError {
    /// Text that is not understood.
    #[error("line {line}: {expected} expected, found {found}")]
    Syntax {
        /// Where.
        line: usize,
        /// What could stand there.
        expected: &'static str,
        /// What stands there.
        found: String,
    },
    /// A call that this interpreter does not have.
    #[error("line {line}: function {name} is not known to the simulated controller")]
    UnknownFunction {
        /// Where.
        line: usize,
        /// The function.
        name: String,
    },
    /// A thread that is run but not defined.
    #[error("line {line}: thread {name} is not defined")]
    UnknownThread {
        /// Where.
        line: usize,
        /// The thread.
        name: String,
    },
    /// A call with too few or too many arguments.
    #[error("line {line}: {name} takes {expected} arguments, found {found}")]
    ArgumentCount {
        /// Where.
        line: usize,
        /// The function.
        name: &'static str,
        /// How many it takes.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A script beyond a limit.
    #[error("line {line}: more than {limit} {what}")]
    TooMuch {
        /// Where.
        line: usize,
        /// Of what.
        what: &'static str,
        /// How many are allowed.
        limit: usize,
    },
    /// A variable read before it is set.
    #[error("line {line}: variable {name} is not set")]
    Undefined {
        /// Where.
        line: usize,
        /// The variable.
        name: String,
    },
    /// A value of the wrong type, or outside its range.
    #[error("line {line}: {expected} expected, found {found}")]
    Value {
        /// Where.
        line: usize,
        /// What could stand there.
        expected: &'static str,
        /// The value.
        found: String,
    },
    /// Two threads move the robot.
    #[error("line {line}: another thread is already controlling the robot")]
    SecondMover {
        /// Where.
        line: usize,
    },
}

/// The calls that are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// `read_input_float_register(n)`.
    ReadInputFloat,
    /// `read_input_integer_register(n)`.
    ReadInputInteger,
    /// `write_output_integer_register(n, value)`.
    WriteOutputInteger,
    /// `rtde_set_watchdog(name, min_frequency, action)`.
    SetWatchdog,
    /// `servoj(q, a, v, t, lookahead_time, gain)`.
    Servoj,
    /// `get_actual_joint_positions()`.
    ActualJointPositions,
    /// `norm(list)`.
    Norm,
    /// `sync()`.
    Sync,
}

impl Function {
    const ALL: [(Self, &'static str, usize); 8] = [
        (Self::ReadInputFloat, "read_input_float_register", 1),
        (Self::ReadInputInteger, "read_input_integer_register", 1),
        (Self::WriteOutputInteger, "write_output_integer_register", 2),
        (Self::SetWatchdog, "rtde_set_watchdog", 3),
        (Self::Servoj, "servoj", 6),
        (Self::ActualJointPositions, "get_actual_joint_positions", 0),
        (Self::Norm, "norm", 1),
        (Self::Sync, "sync", 0),
    ];

    /// The function of this name, its name and how many arguments it takes.
    fn find(name: &str) -> Option<(Self, &'static str, usize)> {
        Self::ALL.into_iter().find(|(_, known, _)| *known == name)
    }
}

/// How two values are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Comparison {
    /// `==`
    Equal,
    /// `!=`
    NotEqual,
    /// `<`
    Less,
    /// `<=`
    LessOrEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterOrEqual,
}

/// Something with a value.
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    /// A number.
    Number(f64),
    /// `True` or `False`.
    Boolean(bool),
    /// A string.
    Text(String),
    /// A variable.
    Variable(String),
    /// `[a, b, …]`, numbers only.
    List(Vec<Expression>),
    /// A call.
    Call(Function, Vec<Expression>),
    /// `run thread()`, by the thread's place in [`Script::threads`].
    Run(usize),
    /// `not a`.
    Not(Box<Expression>),
    /// `-a`.
    Negate(Box<Expression>),
    /// `a == b` and its like.
    Compare(Comparison, Box<Expression>, Box<Expression>),
}

/// Where a variable lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// `global`: seen by all threads.
    Global,
    /// `local`: seen by this thread.
    Local,
    /// Not said: the local one, else the global one, else a new local one.
    Nearest,
}

/// One step of a thread.
#[derive(Clone, Debug, PartialEq)]
pub enum Instruction {
    /// Sets a variable.
    Assign(Scope, String, Expression),
    /// Computes and drops the value.
    Evaluate(Expression),
    /// Goes on at the index unless the condition holds.
    JumpUnless(Expression, usize),
    /// Goes on at the index.
    Jump(usize),
}

/// Instructions, each with its line.
pub type Code = Vec<(usize, Instruction)>;

/// A loaded program.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    /// The name behind `def`.
    pub name: String,
    /// What runs first; when it ends, the program ends.
    pub main: Code,
    /// What `run` starts.
    pub threads: Vec<Code>,
}
