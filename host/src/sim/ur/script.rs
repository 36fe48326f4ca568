//! URScript: text to instructions. What is not known is an error with its line, never skipped.
//!
//! Known: one `def` or `sec` with statements, and inside it functions with parameters and threads; `if`, `elif`, `else`,
//! `while`, `break`, `continue`, `return`, `run`, `kill`, `join`, `halt`, critical sections; `global` and `local`; numbers,
//! booleans, strings, lists of numbers, poses; arithmetic, comparisons, `and`, `or`, `xor`, `not`; the controller's functions
//! in [`builtins`], with named arguments. Lines with `$`, which a saved program has for the teach pendant, are passed over. Not
//! known: structs, lists of lists, several `def` one after the other.

pub mod builtins;
pub mod code;
mod lexer;
mod parser;
#[cfg(test)]
mod tests;
pub mod upload;

pub use code::Script;
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
    /// A call with too few, too many or the wrong arguments.
    #[error("line {line}: {name} takes {expected} arguments, found {found}")]
    ArgumentCount {
        /// Where.
        line: usize,
        /// The function.
        name: String,
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
    /// A call of a function that URScript has and the simulation has not.
    #[error("line {line}: {name} is not simulated")]
    NotSimulated {
        /// Where.
        line: usize,
        /// The function.
        name: &'static str,
    },
    /// Two threads move the robot.
    #[error("line {line}: another thread is already controlling the robot")]
    SecondMover {
        /// Where.
        line: usize,
    },
}

impl ScriptError {
    /// The line in question.
    pub const fn line(&self) -> usize {
        match self {
            Self::Syntax { line, .. }
            | Self::UnknownFunction { line, .. }
            | Self::UnknownThread { line, .. }
            | Self::ArgumentCount { line, .. }
            | Self::TooMuch { line, .. }
            | Self::Undefined { line, .. }
            | Self::Value { line, .. }
            | Self::NotSimulated { line, .. }
            | Self::SecondMover { line } => *line,
        }
    }
}
