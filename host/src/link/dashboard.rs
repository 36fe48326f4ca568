//! UR's dashboard server, port 29999: one line asks, one line answers. The client's side as a state machine; bytes are arguments.
//!
//! Requests and answers after the maker's pages "Dashboard Server e-Series, port 29999" and "Dashboard Server CB-Series, port
//! 29999", and as other people's clients read them (Universal_Robots_Client_Library, `dashboard_client_implementation_g5.cpp`).
//! An answer that is not one of those is an error with its text, never a guess.

pub mod remedy;
#[cfg(test)]
mod tests;

/// The port on a robot.
pub const PORT: u16 = 29_999;
/// Longest answer that is taken: real ones are below 200 bytes.
const LINE_MAX: usize = 4096;
/// What the server says first.
const GREETING: &str = "Connected: Universal Robots Dashboard Server";

/// Something to ask for, and how its answer is read.
#[derive(Clone, Copy, Debug)]
pub struct Request<T> {
    /// The line without its end.
    pub line: &'static str,
    read: fn(&str) -> Option<T>,
    /// Whether it is an act, that a controller may refuse in any words.
    is_act: bool,
}

const fn question<T>(line: &'static str, read: fn(&str) -> Option<T>) -> Request<T> {
    Request { line, read, is_act: false }
}

const fn act(line: &'static str, read: fn(&str) -> Option<()>) -> Request<()> {
    Request { line, read, is_act: true }
}

/// Power and brakes.
pub const ROBOT_MODE: Request<RobotMode> =
    question("robotmode", |line| labelled("Robotmode:", &RobotMode::NAMES, line));
/// What the safety system says.
pub const SAFETY_STATUS: Request<Safety> =
    question("safetystatus", |line| labelled("Safetystatus:", &Safety::NAMES, line));
/// The same, of software that does not know [`SAFETY_STATUS`].
pub const SAFETY_MODE: Request<Safety> = question("safetymode", |line| labelled("Safetymode:", &Safety::NAMES, line));
/// Whether the program plays, and which it is.
pub const PROGRAM_STATE: Request<(ProgramState, String)> = question("programState", |line| {
    let (state, name) = line.split_once(' ').unwrap_or((line, ""));
    Some((named(&ProgramState::NAMES, state)?, name.trim().to_owned()))
});
/// The arm's model.
pub const MODEL: Request<String> = question("get robot model", name);
/// The arm's serial number.
pub const SERIAL: Request<String> = question("get serial number", name);
/// The software's version.
pub const VERSION: Request<Version> = question("PolyscopeVersion", version);
/// Whether the robot takes commands from the network (e-Series and later).
pub const REMOTE_CONTROL: Request<bool> =
    question("is in remote control", |line| line.to_ascii_lowercase().parse().ok());
/// Give power to the motors.
pub const POWER_ON: Request<()> = act("power on", |line| done("Powering on", line));
/// Take it away.
pub const POWER_OFF: Request<()> = act("power off", |line| done("Powering off", line));
/// Release the brakes.
pub const BRAKE_RELEASE: Request<()> = act("brake release", |line| done("Brake releasing", line));
/// End a protective stop.
pub const UNLOCK: Request<()> = act("unlock protective stop", |line| done("Protective stop releasing", line));
/// Start or go on with the program.
pub const PLAY: Request<()> = act("play", |line| done("Starting program", line));
/// End the program.
pub const STOP: Request<()> = act("stop", |line| done("Stopped", line));
/// Close a popup.
pub const CLOSE_POPUP: Request<()> = act("close popup", |line| done("closing popup", line));
/// Close a popup of the safety system.
pub const CLOSE_SAFETY_POPUP: Request<()> = act("close safety popup", |line| done("closing safety popup", line));

fn done(told: &str, line: &str) -> Option<()> {
    line.starts_with(told).then_some(())
}

fn labelled<T: Copy>(label: &str, names: &Names<T>, line: &str) -> Option<T> {
    named(names, line.strip_prefix(label)?.trim())
}

/// A model or a serial number: short, of one alphabet, not a sentence.
fn name(line: &str) -> Option<String> {
    let sound = |c: char| c.is_ascii_alphanumeric() || matches!(c, ' ' | '-' | '_' | '.');
    let is_name = line.len() <= 64 && line.chars().all(sound) && line.contains(|c: char| c.is_ascii_digit());
    is_name.then(|| line.to_owned())
}

/// "URSoftware 5.11.6.1010 (Mar 01 2022)".
fn version(line: &str) -> Option<Version> {
    let numbers = line.split_whitespace().find(|word| word.split('.').count() >= 3)?;
    let mut version = [0; 4];
    for (place, number) in version.iter_mut().zip(numbers.split('.')) {
        *place = number.parse().ok()?;
    }
    Some(version)
}

/// Power and brakes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RobotMode {
    /// The controller's program does not run.
    NoController,
    /// No arm.
    Disconnected,
    /// A person has to confirm the safety settings.
    ConfirmSafety,
    /// It starts.
    Booting,
    /// No power.
    PowerOff,
    /// Power comes.
    PowerOn,
    /// Powered, brakes on.
    Idle,
    /// A person moves the arm by hand.
    Backdrive,
    /// Brakes open: programs can move the arm.
    Running,
    /// New firmware is written.
    UpdatingFirmware,
}

impl RobotMode {
    const NAMES: [(&'static str, Self); 10] = [
        ("NO_CONTROLLER", Self::NoController),
        ("DISCONNECTED", Self::Disconnected),
        ("CONFIRM_SAFETY", Self::ConfirmSafety),
        ("BOOTING", Self::Booting),
        ("POWER_OFF", Self::PowerOff),
        ("POWER_ON", Self::PowerOn),
        ("IDLE", Self::Idle),
        ("BACKDRIVE", Self::Backdrive),
        ("RUNNING", Self::Running),
        ("UPDATING_FIRMWARE", Self::UpdatingFirmware),
    ];
}

/// What the safety system says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Safety {
    /// All is well.
    Normal,
    /// All is well, with the reduced limits.
    Reduced,
    /// Stopped; unlocked by a person who has looked at the cause.
    ProtectiveStop,
    /// A limit is broken and the arm has to be moved back.
    Recovery,
    /// A safeguard input is open.
    SafeguardStop,
    /// The cell's emergency stop.
    SystemEmergencyStop,
    /// The robot's emergency stop.
    RobotEmergencyStop,
    /// A safety limit was broken.
    Violation,
    /// The safety system has failed.
    Fault,
    /// The safeguard of the automatic mode is open.
    AutomaticModeSafeguardStop,
    /// The three-position switch is not held.
    EnablingStop,
}

impl Safety {
    const NAMES: [(&'static str, Self); 12] = [
        ("NORMAL", Self::Normal),
        ("REDUCED", Self::Reduced),
        ("PROTECTIVE_STOP", Self::ProtectiveStop),
        ("RECOVERY", Self::Recovery),
        ("SAFEGUARD_STOP", Self::SafeguardStop),
        ("SYSTEM_EMERGENCY_STOP", Self::SystemEmergencyStop),
        ("ROBOT_EMERGENCY_STOP", Self::RobotEmergencyStop),
        ("VIOLATION", Self::Violation),
        ("FAULT", Self::Fault),
        ("AUTOMATIC_MODE_SAFEGUARD_STOP", Self::AutomaticModeSafeguardStop),
        ("SYSTEM_THREE_POSITION_ENABLING_STOP", Self::EnablingStop),
        ("THREE_POSITION_ENABLING_STOP", Self::EnablingStop),
    ];

    /// Whether the arm may be moved.
    pub const fn is_well(self) -> bool {
        matches!(self, Self::Normal | Self::Reduced)
    }
}

/// The robot's program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgramState {
    /// None runs.
    Stopped,
    /// It runs.
    Playing,
    /// It is held.
    Paused,
}

impl ProgramState {
    const NAMES: [(&'static str, Self); 3] =
        [("STOPPED", Self::Stopped), ("PLAYING", Self::Playing), ("PAUSED", Self::Paused)];
}

type Names<T> = [(&'static str, T)];

fn word<T: PartialEq>(names: &Names<T>, value: T) -> &'static str {
    names.iter().find(|(_, named)| *named == value).map_or("", |(name, _)| name)
}

fn named<T: Copy>(names: &Names<T>, text: &str) -> Option<T> {
    names.iter().find(|(name, _)| *name == text).map(|(_, value)| *value)
}

impl RobotMode {
    /// The dashboard's word for it.
    pub fn name(self) -> &'static str {
        word(&Self::NAMES, self)
    }

    /// By its number in RTDE and on the primary interface.
    pub fn from_code(code: i32) -> Option<Self> {
        const CODES: [RobotMode; 10] = [
            RobotMode::NoController,
            RobotMode::Disconnected,
            RobotMode::ConfirmSafety,
            RobotMode::Booting,
            RobotMode::PowerOff,
            RobotMode::PowerOn,
            RobotMode::Idle,
            RobotMode::Backdrive,
            RobotMode::Running,
            RobotMode::UpdatingFirmware,
        ];
        CODES.get(usize::try_from(code.checked_add(1)?).ok()?).copied()
    }
}

impl Safety {
    /// The dashboard's word for it.
    pub fn name(self) -> &'static str {
        word(&Self::NAMES, self)
    }
}

impl ProgramState {
    /// The dashboard's word for it.
    pub fn name(self) -> &'static str {
        word(&Self::NAMES, self)
    }
}

/// A software version: major, minor, bugfix, build.
pub type Version = [u32; 4];

/// Why there is no answer. After the first error that is not [`Self::Refused`] or [`Self::NotKnown`] the client stays failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DashboardError {
    /// Another server listens there.
    #[error("what listens there is no dashboard: it says {found:?}; check the address, and the port in [link]")]
    Stranger {
        /// Its first line.
        found: String,
    },
    /// A line without an end.
    #[error("the dashboard's answer has more than {LINE_MAX} bytes; check the address, and the port in [link]")]
    TooLong,
    /// The controller does not do it.
    #[error("the controller refuses {request:?}: {answer:?}; see the teach pendant")]
    Refused {
        /// What was asked for.
        request: &'static str,
        /// What it said.
        answer: String,
    },
    /// The controller's software does not have this request.
    #[error("the controller does not know {request:?}; update its software")]
    NotKnown {
        /// What was asked for.
        request: &'static str,
    },
    /// An answer to something else.
    #[error(
        "the dashboard answers {request:?} with {answer:?}, which Screed does not know; look at the teach pendant, and where all is well there the software is newer than this \
             Screed"
    )]
    Unexpected {
        /// What was asked for.
        request: &'static str,
        /// What it said.
        answer: String,
    },
    /// A line that nobody asked for.
    #[error("the dashboard says {found:?} unasked; connect again")]
    Unasked {
        /// What it said.
        found: String,
    },
    /// Two requests at once.
    #[error("the answer to {request:?} has not come yet; wait for it")]
    Busy {
        /// The first of them.
        request: &'static str,
    },
    /// The connection has ended.
    #[error("the dashboard closed the connection; see whether the controller runs, then connect again")]
    Closed,
}

/// The client.
#[derive(Clone, Debug, Default)]
pub struct Dashboard {
    inbox: Vec<u8>,
    outbox: Vec<u8>,
    greeted: bool,
    asked: Option<&'static str>,
    answer: Option<String>,
    failed: Option<DashboardError>,
}

impl Dashboard {
    /// Asks; the answer comes by [`Self::take_answer`].
    ///
    /// # Errors
    /// [`DashboardError::Busy`], and that of a failed client.
    pub fn ask<T>(&mut self, request: &Request<T>) -> Result<(), DashboardError> {
        self.failed.clone().map_or(Ok(()), Err)?;
        if let Some(request) = self.asked {
            return Err(DashboardError::Busy { request });
        }
        (self.asked, self.answer) = (Some(request.line), None);
        self.outbox.extend(request.line.bytes().chain([b'\n']));
        Ok(())
    }

    /// The answer to what was asked last, once; none where it has not come.
    ///
    /// # Errors
    /// [`DashboardError`].
    pub fn take_answer<T>(&mut self, request: &Request<T>) -> Result<Option<T>, DashboardError> {
        let Some(answer) = self.answer.take() else {
            return self.failed.clone().map_or(Ok(None), Err);
        };
        let (is_act, read, request) = (request.is_act, request.read, request.line);
        if answer.to_ascii_lowercase().starts_with("could not understand") {
            return Err(DashboardError::NotKnown { request });
        }
        match read(&answer) {
            Some(read) => Ok(Some(read)),
            // All of its words are for the person.
            None if is_act => Err(DashboardError::Refused { request, answer }),
            None => {
                let error = DashboardError::Unexpected { request, answer };
                self.failed = Some(error.clone());
                Err(error)
            }
        }
    }

    /// Takes bytes of the server, split anywhere.
    pub fn handle_bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if self.failed.is_some() {
                return;
            }
            if *byte != b'\n' {
                self.inbox.push(*byte);
                if self.inbox.len() > LINE_MAX {
                    self.inbox = Vec::new();
                    self.failed = Some(DashboardError::TooLong);
                }
                continue;
            }
            let line = String::from_utf8_lossy(&std::mem::take(&mut self.inbox)).trim().to_owned();
            self.failed = self.handle_line(line).err();
        }
    }

    /// The server has closed the connection.
    pub fn handle_closed(&mut self) {
        self.failed.get_or_insert(DashboardError::Closed);
    }

    /// Moves bytes for the server into `out`; how many. Nothing leaves before it has said what it is.
    pub fn poll_transmit(&mut self, out: &mut [u8]) -> usize {
        let count = if self.greeted { self.outbox.len().min(out.len()) } else { 0 };
        for (to, from) in out.iter_mut().zip(self.outbox.drain(..count)) {
            *to = from;
        }
        count
    }

    fn handle_line(&mut self, line: String) -> Result<(), DashboardError> {
        if !self.greeted {
            self.greeted = line.starts_with(GREETING);
            return if self.greeted { Ok(()) } else { Err(DashboardError::Stranger { found: line }) };
        }
        if line.is_empty() {
            return Ok(());
        }
        if self.asked.take().is_none() {
            return Err(DashboardError::Unasked { found: line });
        }
        self.answer = Some(line);
        Ok(())
    }
}
