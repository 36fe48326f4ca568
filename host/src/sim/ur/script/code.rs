//! A loaded script: routines of instructions for a machine with a stack of values.

use super::builtins::Builtin;
use std::fmt;

/// A value of the language.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// What a routine without `return` gives.
    Nothing,
    /// A number; thread handles are numbers too, from 1.
    Number(f64),
    /// `True` or `False`.
    Boolean(bool),
    /// A string.
    Text(String),
    /// `[a, b, …]`, numbers only.
    List(Vec<f64>),
    /// `p[x, y, z, rx, ry, rz]` (m and rotation vector).
    Pose([f64; 6]),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("nothing"),
            Self::Number(value) => write!(f, "{value}"),
            Self::Boolean(true) => f.write_str("True"),
            Self::Boolean(false) => f.write_str("False"),
            Self::Text(text) => f.write_str(text),
            Self::List(values) => write!(f, "{values:?}"),
            Self::Pose(values) => write!(f, "p{values:?}"),
        }
    }
}

/// What stands between two values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operator {
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
    /// `%`
    Remainder,
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
    /// `and`
    And,
    /// `or`
    Or,
    /// `xor`
    Xor,
}

/// Where a variable lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// `global`: seen by all.
    Global,
    /// `local`: seen by this call of this routine.
    Local,
    /// Not said: the local one, else the global one, else a new local one.
    Nearest,
}

/// A variable's name, as its place in [`Script::names`].
pub type Name = usize;

/// One instruction. Operands lie on the stack, the last one on top; so do results.
#[derive(Clone, Debug, PartialEq)]
pub enum Op {
    /// Puts a value on the stack.
    Push(Value),
    /// Puts a variable's value on the stack.
    Load(Name),
    /// Takes a value into a variable.
    Store(Scope, Name),
    /// Takes an index and then a value into an element of a variable.
    StoreElement(Name),
    /// An element: takes the index, then list or pose.
    Element,
    /// Makes a list of so many numbers.
    List(usize),
    /// Makes a pose of six numbers.
    Pose,
    /// `-a`
    Negate,
    /// `not a`
    Not,
    /// Takes the right value, then the left one.
    Binary(Operator),
    /// Goes on at the index.
    Jump(usize),
    /// Takes a truth value and goes on at the index unless it holds.
    JumpUnless(usize),
    /// A function of the controller: for each of its parameters which argument it has, None where it is left out.
    Builtin(Builtin, Vec<Option<usize>>),
    /// A function that URScript has and the simulation has not.
    Missing(&'static str),
    /// A routine of the script, with so many arguments.
    Call(usize, usize),
    /// Starts a thread and gives its handle.
    Run(usize),
    /// Ends the thread of the handle.
    Kill,
    /// Waits for the thread of the handle.
    Join,
    /// Ends the call with the value.
    Return,
    /// Drops the value.
    Drop,
    /// From here on no other thread runs.
    EnterCritical,
    /// The others run again.
    ExitCritical,
    /// Ends the program.
    Halt,
}

/// Instructions, each with its line.
pub type Code = Vec<(usize, Op)>;

/// A function or a thread.
#[derive(Clone, Debug, PartialEq)]
pub struct Routine {
    /// What it is called.
    pub name: String,
    /// Its parameters.
    pub parameters: Vec<Name>,
    /// Whether `run` starts it.
    pub is_thread: bool,
    /// What it does.
    pub code: Code,
}

/// A loaded program.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    /// Names of variables.
    pub names: Vec<String>,
    /// The first is the program itself; when it ends, the program ends.
    pub routines: Vec<Routine>,
    /// Begun with `sec`: runs beside the program and cannot move the robot.
    pub secondary: bool,
}
