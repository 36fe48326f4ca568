//! The robot's side of the link: a URScript program that moves the arm to what the input registers say.
//!
//! After the first published system's robot program (its Fig. 3): the main loop calls `servoj` with the newest setpoint, a
//! thread beside it copies the six registers. Four things are added: the thread looks at the sequence number, the watchdog
//! is armed only when the first setpoint came (before, nobody is obliged to send), an output register says how far the
//! program is, and the one behind it is counted on by the thread: a register keeps its value when the program has ended, so
//! that the state alone would also stand there while another program plays.

use std::fmt;

/// Look-ahead times that `servoj` accepts (s), by the URScript manual.
pub const LOOKAHEAD_RANGE: [f64; 2] = [0.03, 0.2];
/// Gains that `servoj` accepts, by the URScript manual.
pub const GAIN_RANGE: [f64; 2] = [100.0, 2000.0];

/// The thread counts its cycles up to this and begins again.
const COUNT_END: u32 = 1_000_000;

/// What the program writes to its output register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgramState {
    /// Not started, or no program of ours.
    NotStarted,
    /// Started, holding the joints where they were, until the first setpoint comes.
    Waiting,
    /// Following setpoints, the watchdog armed.
    Following,
}

impl ProgramState {
    /// The register's value.
    pub const fn code(self) -> i32 {
        match self {
            Self::NotStarted => 0,
            Self::Waiting => 1,
            Self::Following => 2,
        }
    }

    /// The state with this value.
    pub const fn from_code(code: i32) -> Option<Self> {
        Some(match code {
            0 => Self::NotStarted,
            1 => Self::Waiting,
            2 => Self::Following,
            _ => return None,
        })
    }
}

/// What the controller does when setpoints stay away for longer than the watchdog's period, the gravest last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum WatchdogAction {
    /// Nothing.
    Ignore,
    /// The program pauses.
    Pause,
    /// The program stops.
    Stop,
}

impl fmt::Display for WatchdogAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ignore => "ignore",
            Self::Pause => "pause",
            Self::Stop => "stop",
        })
    }
}

/// The program's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Program {
    /// Setpoints per second (Hz), 125 or 500; `servoj` blocks for one period.
    pub rate_hz: u32,
    /// First register, 0 or 24.
    pub register_offset: u8,
    /// The `lookahead_time` of `servoj` (s).
    pub lookahead: f64,
    /// The `gain` of `servoj`.
    pub gain: f64,
    /// Longest time without a setpoint (s).
    pub watchdog: f64,
    /// What happens then.
    pub watchdog_action: WatchdogAction,
}

/// A parameter that the controller would refuse, or worse, accept.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ProgramError {
    /// A number outside its range.
    #[error("robot program: {name} = {value} is outside {min} to {max}: set it within the range")]
    OutOfRange {
        /// The parameter.
        name: &'static str,
        /// As given.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
    /// Not one of two.
    #[error("robot program: {name} = {value}: set it to {one} or {other}")]
    NeitherOf {
        /// The parameter.
        name: &'static str,
        /// As given.
        value: u32,
        /// A choice.
        one: u32,
        /// The other choice.
        other: u32,
    },
}

impl Program {
    /// The URScript text.
    ///
    /// # Errors
    /// [`ProgramError`] names the parameter.
    pub fn text(&self) -> Result<String, ProgramError> {
        neither("register_offset", u32::from(self.register_offset), 0, 24)?;
        neither("rate_hz", self.rate_hz, 125, 500)?;
        in_range("lookahead", self.lookahead, LOOKAHEAD_RANGE[0], LOOKAHEAD_RANGE[1])?;
        in_range("gain", self.gain, GAIN_RANGE[0], GAIN_RANGE[1])?;
        // Below two periods a single late setpoint would stop the robot.
        in_range("watchdog", self.watchdog, 2.0 / f64::from(self.rate_hz), 10.0)?;
        let first = self.register_offset;
        let registers: Vec<String> = (first..first + 6).map(|n| format!("read_input_float_register({n})")).collect();
        Ok(format!(
            "def screed():
  # Output register {first}: {not_started} not started, {waiting} waiting for the first setpoint, {following} following.
  # Output register {second}: counts on as long as this program plays.
  write_output_integer_register({first}, {not_started})
  global setpoint = get_actual_joint_positions()
  global sequence = read_input_integer_register({first})
  global following = False
  thread receive():
    local newest = sequence
    local joints = setpoint
    local cycles = 0
    while (True):
      cycles = cycles + 1
      if (cycles >= {COUNT_END}):
        cycles = 0
      end
      write_output_integer_register({second}, cycles)
      newest = read_input_integer_register({first})
      if (newest != sequence):
        joints = [{registers}]
        if (norm(joints) > 0):
          setpoint = joints
          following = True
        end
        sequence = newest
      end
      sync()
    end
  end
  local receiver = run receive()
  write_output_integer_register({first}, {waiting})
  while (not following):
    sync()
  end
  rtde_set_watchdog(\"input_int_register_{first}\", {watchdog_hz}, \"{action}\")
  write_output_integer_register({first}, {following})
  while (True):
    servoj(setpoint, 0, 0, {period}, {lookahead}, {gain})
  end
end
",
            not_started = ProgramState::NotStarted.code(),
            waiting = ProgramState::Waiting.code(),
            following = ProgramState::Following.code(),
            second = first + 1,
            registers = registers.join(", "),
            watchdog_hz = 1.0 / self.watchdog,
            action = self.watchdog_action,
            period = 1.0 / f64::from(self.rate_hz),
            lookahead = self.lookahead,
            gain = self.gain,
        ))
    }
}

fn in_range(name: &'static str, value: f64, min: f64, max: f64) -> Result<(), ProgramError> {
    if (min..=max).contains(&value) { Ok(()) } else { Err(ProgramError::OutOfRange { name, value, min, max }) }
}

fn neither(name: &'static str, value: u32, one: u32, other: u32) -> Result<(), ProgramError> {
    if value == one || value == other { Ok(()) } else { Err(ProgramError::NeitherOf { name, value, one, other }) }
}
