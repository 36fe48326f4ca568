//! Screed's program on the controller: sent over the primary interface, which starts it at once, and watched until it says that it
//! waits for setpoints.

use super::view::LookLine;
use super::{ControllerError, Line, Place};
use crate::failure::{Exit, Failure};
use crate::link::Remedy;
use crate::link::dashboard::{RobotMode, remedy};
use crate::link::primary::{self, Primary};
use crate::link::rtde::look::State;
use crate::link::rtde::program::ProgramState;
use crate::link::rtde::ready::{MOVING, PLAYING, STOPPED};
use std::time::{Duration, Instant};

/// How long a program may take to say that it waits; real controllers need less than a second.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long each line is listened to in turn.
const TURN: Duration = Duration::from_millis(20);

/// Sends a program and waits until it says that it waits for setpoints: a person has said so. A program that runs is not
/// replaced.
///
/// # Errors
/// [`Failure`] when another one runs, the robot is not ready, or the controller does not take it, with what it said.
pub fn upload(place: &Place, register_offset: u8, text: &str) -> Result<(), Failure> {
    let mut look = LookLine::connect(place, register_offset)?;
    ready(&look.next()?.0)?;
    let mut line = Line::connect("the primary interface", &place.host, place.primary)?;
    line.send(&primary::program(text))?;
    let (until, mut reader, mut said) = (Instant::now() + PATIENCE, Primary::default(), Vec::new());
    let mut seen: Option<State> = None;
    let mut bytes = [0; 4096];
    while Instant::now() < until {
        if let Some(count) = line.receive(&mut bytes, Instant::now() + TURN)? {
            if count == 0 {
                said.push("it closed the connection".to_owned());
                break;
            }
            reader.handle_bytes(bytes.get(..count).unwrap_or(&[])).map_err(ControllerError::from)?;
        }
        let mut is_error = false;
        while let Some(message) = reader.poll_message() {
            is_error |= message.is_exception;
            said.push(message.text);
        }
        if let Some((state, _)) = look.by(Instant::now() + TURN)? {
            let is_counting = seen.is_some_and(|before| before.program_count != state.program_count);
            if state.runtime_state == PLAYING && ours(state.program_state, is_counting).is_some() {
                return Ok(());
            }
            seen = Some(state);
        }
        if is_error {
            break;
        }
    }
    while let Some(text) = look.poll_text() {
        said.push(text.message.to_string());
    }
    Err(not_taken(&said, seen.as_ref()))
}

/// Whether a program of Screed that plays waits or follows; none where another one plays. Its register alone does not tell: it
/// keeps its value after the program has ended.
pub(super) fn ours(code: i32, is_counting: bool) -> Option<ProgramState> {
    ProgramState::from_code(code).filter(|state| is_counting && *state != ProgramState::NotStarted)
}

/// Whether a program can be started at all, and would not replace one that runs.
fn ready(state: &State) -> Result<(), Failure> {
    if state.runtime_state != STOPPED {
        let message = "a program runs on the controller: Screed does not replace it";
        return Err(Failure::new(Exit::Link, message, "screed robot stop, then upload again"));
    }
    if state.safety_status_bits & MOVING == 0 {
        let message = format!("the robot stands in a safety stop (bits {:#x})", state.safety_status_bits);
        return Err(Failure::new(Exit::SafetyStop, message, "screed robot status tells which, and what to do"));
    }
    let remedy = match RobotMode::from_code(state.robot_mode) {
        Some(mode) => mode.remedy(),
        None => Some(remedy::UNKNOWN_MODE),
    };
    remedy.map_or(Ok(()), |Remedy { cause, action }| {
        Err(Failure::new(Exit::Link, format!("the robot is not ready for a program: {cause}"), action))
    })
}

fn not_taken(said: &[String], seen: Option<&State>) -> Failure {
    let stand = match seen {
        Some(state) if state.runtime_state == PLAYING => "a program plays, but its output registers are not Screed's",
        Some(_) => "no program plays",
        None => "no state of the robot came",
    };
    let said = if said.is_empty() { String::new() } else { format!("; the controller says: {}", said.join(" | ")) };
    Failure::new(
        Exit::Link,
        format!("the controller did not take the program: {stand}{said}"),
        "switch the robot to remote control, close what pops up on the teach pendant, and upload again",
    )
}
