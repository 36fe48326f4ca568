//! Messages of port 30001: what happens to programs, what they say, and why the robot stops. Each stream takes those that
//! came since it connected.
//!
//! Layouts as in `src/primary/robot_message` of the Universal_Robots_Client_Library. Numbers of messages are the maker's where
//! they are known: C153 is a stop because the joints' position is off, C0 stands for all others.

use super::script::ScriptError;
use super::streams::{ROBOT_MESSAGE, package};
use super::{LINE_MAX, shorten};
use std::collections::VecDeque;

/// Messages that wait for streams that are slow.
const WAITING_MAX: usize = 256;
/// Sources that robot messages name: the robot, its program's interpreter.
const ROBOT: i8 = -2;
const INTERPRETER: i8 = -3;
/// Levels of an error code: a violation of a safety limit.
const VIOLATION: i32 = 3;

/// One message.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Message {
    /// A program has started, or stopped.
    Program { name: String, started: bool },
    /// `textmsg`.
    Text(String),
    /// A popup of a program.
    Popup(Popup),
    /// A protective stop.
    Stop { code: i32, why: String },
    /// Another safety mode.
    Safety { mode: i32 },
    /// A program cannot be loaded, or not go on.
    Script { line: i32, column: i32, text: String },
}

/// What `popup` shows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Popup {
    pub text: String,
    pub title: String,
    pub warning: bool,
    pub error: bool,
    /// The program waits until it is closed.
    pub blocking: bool,
}

impl Message {
    /// Why a program cannot be run. The column is that of the name in question, or the line's first.
    pub(super) fn of_error(error: &ScriptError, text: &str) -> Self {
        let line = error.line();
        let in_line = |name: &str| {
            let place = text.lines().nth(line.checked_sub(1)?)?.find(name)?;
            i32::try_from(place + 1).ok()
        };
        let (column, told) = match error {
            ScriptError::UnknownFunction { name, .. } => {
                (in_line(name), format!("compile_error_name_not_found:{name}:"))
            }
            other => (None, other.to_string()),
        };
        Self::Script { line: i32::try_from(line).unwrap_or(0), column: column.unwrap_or(1), text: told }
    }

    fn encode(&self, microseconds: u64) -> Vec<u8> {
        let mut content = microseconds.to_be_bytes().to_vec();
        let head = |source: i8, kind: u8| [source as u8, kind];
        match self {
            Self::Text(text) => {
                content.extend(head(INTERPRETER, 0));
                content.extend(shorten(text, LINE_MAX).bytes());
            }
            Self::Popup(popup) => {
                content.extend(head(INTERPRETER, 2));
                // Number and type of a request: none.
                content.extend([0; 8]);
                content.extend([popup.warning, popup.error, popup.blocking].map(u8::from));
                let title = shorten(&popup.title, usize::from(u8::MAX));
                content.push(title.len() as u8);
                content.extend(title.bytes());
                content.extend(shorten(&popup.text, LINE_MAX).bytes());
            }
            Self::Stop { code, why } => {
                content.extend(head(ROBOT, 6));
                // Code, argument, level; the type of the data, none, and the data.
                for number in [*code, 0, VIOLATION, 0, 0] {
                    content.extend(number.to_be_bytes());
                }
                content.extend(shorten(why, LINE_MAX).bytes());
            }
            Self::Safety { mode } => {
                content.extend(head(ROBOT, 5));
                // Code and argument; the mode; the type of the data, none, and the data.
                content.extend([0; 8]);
                content.push(*mode as u8);
                content.extend([0; 8]);
            }
            Self::Program { name, started } => {
                content.extend(head(INTERPRETER, 7));
                let title = if *started { "PROGRAM_XXX_STARTED" } else { "PROGRAM_XXX_STOPPED" };
                content.extend([0; 8]);
                content.push(title.len() as u8);
                content.extend(title.bytes());
                content.extend(shorten(name, LINE_MAX).bytes());
            }
            Self::Script { line, column, text } => {
                content.extend(head(INTERPRETER, 10));
                content.extend(line.to_be_bytes());
                content.extend(column.to_be_bytes());
                content.extend(shorten(text, LINE_MAX).bytes());
            }
        }
        package(ROBOT_MESSAGE, &content)
    }
}

/// The newest messages, numbered through.
#[derive(Clone, Debug, Default)]
pub(super) struct Mailbox {
    /// With whether it tells of another state of the robot.
    waiting: VecDeque<(bool, Vec<u8>)>,
    /// Of all that ever came.
    count: u64,
}

impl Mailbox {
    pub(super) fn push(&mut self, message: &Message, microseconds: u64) {
        if self.waiting.len() >= WAITING_MAX {
            self.waiting.pop_front();
        }
        let of_state = !matches!(message, Message::Text(_) | Message::Popup(_));
        self.waiting.push_back((of_state, message.encode(microseconds)));
        self.count += 1;
    }

    /// The bytes of those from number `from` on that are still there, and whether one of them tells of another state of the robot.
    pub(super) fn since(&self, from: u64) -> (Vec<u8>, bool) {
        let first = self.count - self.waiting.len() as u64;
        let skip = usize::try_from(from.saturating_sub(first)).unwrap_or(usize::MAX);
        let found = || self.waiting.iter().skip(skip);
        (found().flat_map(|(_, bytes)| bytes).copied().collect(), found().any(|(of_state, _)| *of_state))
    }

    /// How many there ever were.
    pub(super) const fn count(&self) -> u64 {
        self.count
    }
}
