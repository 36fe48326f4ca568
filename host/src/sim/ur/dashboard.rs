//! The dashboard server, port 29999: a line is a command, a line is the answer. Bytes are arguments.
//!
//! Commands and answers as the maker lists them ("Dashboard Server e-Series, port 29999" and "Dashboard Server CB-Series, port
//! 29999"). A command that a generation does not have is answered as an unknown one.

use super::robot::{Generation, Refusal};
use super::{Controller, RuntimeState};

/// What is chosen on the teach pendant or here, and kept.
#[derive(Clone, Debug)]
pub(super) struct Desk {
    /// As chosen on the e-Series: without it, everybody may command, and the robot says that it is not in remote control.
    pub remote_control: bool,
    user_role: String,
    operational_mode: &'static str,
}

impl Default for Desk {
    fn default() -> Self {
        Self { remote_control: false, user_role: "NONE".to_owned(), operational_mode: "NONE" }
    }
}

/// What it says to whom connects.
pub const GREETING: &str = "Connected: Universal Robots Dashboard Server";
/// Longest command; real ones are short, but for popups.
const LINE_MAX: usize = 4096;
/// Unsent bytes at which a client that does not read is cut off.
const BACKLOG_MAX: usize = 64 * 1024;

/// One client's connection.
#[derive(Clone, Debug)]
pub struct Session {
    inbox: Vec<u8>,
    outbox: Vec<u8>,
    open: bool,
}

impl Default for Session {
    fn default() -> Self {
        let mut session = Self { inbox: Vec::new(), outbox: Vec::new(), open: true };
        session.say(GREETING);
        session
    }
}

impl Session {
    /// Takes bytes, split anywhere.
    pub fn handle_bytes(&mut self, bytes: &[u8], controller: &mut Controller) {
        for byte in bytes {
            if !self.open {
                return;
            }
            if *byte != b'\n' {
                self.inbox.push(*byte);
                self.open = self.inbox.len() <= LINE_MAX;
                continue;
            }
            let line = String::from_utf8_lossy(&std::mem::take(&mut self.inbox)).trim().to_owned();
            let answer = answer(&line, controller);
            self.say(&answer);
            if matches!(line.as_str(), "quit" | "shutdown") {
                self.open = false;
            }
        }
    }

    fn say(&mut self, line: &str) {
        self.outbox.extend(line.bytes());
        self.outbox.push(b'\n');
        self.open &= self.outbox.len() <= BACKLOG_MAX;
    }

    /// Moves bytes for the client into `out`; how many.
    pub fn poll_transmit(&mut self, out: &mut [u8]) -> usize {
        let count = self.outbox.len().min(out.len());
        for (to, from) in out.iter_mut().zip(self.outbox.drain(..count)) {
            *to = from;
        }
        count
    }

    /// False once the connection is to be closed.
    pub const fn is_open(&self) -> bool {
        self.open
    }
}

/// The answer to one command.
pub fn answer(line: &str, controller: &mut Controller) -> String {
    let (command, argument) = split(line);
    of_state(command, controller)
        .or_else(|| of_program(command, argument, controller))
        .or_else(|| of_robot(command, controller))
        .or_else(|| of_desk(command, argument, controller))
        .or_else(|| of_generation(command, argument, controller))
        .unwrap_or_else(|| unknown(line))
}

/// Questions.
fn of_state(command: &str, controller: &Controller) -> Option<String> {
    Some(match command {
        "running" => format!("Program running: {}", controller.runtime_state() != RuntimeState::Stopped),
        "robotmode" => format!("Robotmode: {}", controller.robot().mode_name()),
        "get loaded program" => format!("Loaded program: {}", controller.program_name()),
        "isProgramSaved" => format!("true {}", controller.program_name()),
        "programState" => format!("{} {}", state_name(controller.runtime_state()), controller.program_name()),
        "PolyscopeVersion" => version(controller.generation()),
        "safetymode" => format!("Safetymode: {}", controller.robot().safety_mode_name()),
        "safetystatus" => format!("Safetystatus: {}", controller.robot().safety_status_name()),
        "get serial number" => controller.serial_number().to_owned(),
        "get robot model" => controller.model_name(),
        _ => return None,
    })
}

/// Programs and installations.
fn of_program(command: &str, argument: &str, controller: &mut Controller) -> Option<String> {
    Some(match command {
        "play" => outcome(controller.play(), "Starting program", "Failed to execute: play"),
        "stop" => {
            controller.stop();
            "Stopped".to_owned()
        }
        "pause" => outcome(controller.pause(), "Pausing program", "Failed to execute: pause"),
        "load" if controller.load(argument) => format!("Loading program: {argument}"),
        "load" => format!("File not found: {argument}"),
        "load installation" if argument.rsplit('/').next() == Some(INSTALLATION) => {
            format!("Loading installation: {argument}")
        }
        "load installation" => format!("File not found: {argument}"),
        _ => return None,
    })
}

/// Power, brakes and safety.
fn of_robot(command: &str, controller: &mut Controller) -> Option<String> {
    Some(match command {
        "power on" => outcome(controller.power_on(), "Powering on", "Failed to execute: power on"),
        "power off" => {
            controller.power_off();
            "Powering off".to_owned()
        }
        "brake release" => outcome(controller.release_brakes(), "Brake releasing", "Failed to execute: brake release"),
        "unlock protective stop" => match controller.unlock_protective_stop() {
            Ok(()) => "Protective stop releasing".to_owned(),
            Err(Refusal::TooEarly) => TOO_EARLY.to_owned(),
            Err(Refusal::State) => "Failed to execute: unlock protective stop".to_owned(),
        },
        "restart safety" => {
            controller.restart_safety();
            "Restarting safety".to_owned()
        }
        "shutdown" => {
            controller.power_off();
            "Shutting down".to_owned()
        }
        _ => return None,
    })
}

/// Messages, logs, reports, and the end of the conversation.
fn of_desk(command: &str, argument: &str, controller: &mut Controller) -> Option<String> {
    let told = match command {
        "popup" => {
            controller.show_popup(argument);
            "showing popup"
        }
        "close popup" => {
            controller.close_popup();
            "closing popup"
        }
        "close safety popup" => {
            controller.close_popup();
            "closing safety popup"
        }
        "addToLog" => {
            controller.log(argument);
            "Added log message"
        }
        "saveLog" => "Log saved to disk",
        // Nothing is written: the simulation has no disk. Names as on a robot.
        "generate flight report" => "Flight Report generated with id:1",
        "generate support file" => "Completed successfully: ursupport_1.zip",
        "quit" => "Disconnected",
        _ => return None,
    };
    Some(told.to_owned())
}

/// What only one of the generations has.
fn of_generation(command: &str, argument: &str, controller: &mut Controller) -> Option<String> {
    let generation = controller.generation();
    let desk = &mut controller.desk;
    let upper = argument.to_uppercase();
    Some(match (generation, command) {
        (Generation::Cb3, "setUserRole") if USER_ROLES.contains(&upper.as_str()) => {
            desk.user_role = upper;
            format!("Setting user role: {argument}")
        }
        (Generation::Cb3, "setUserRole") => format!("Failed setting user role: {argument}"),
        (Generation::Cb3, "getUserRole") => desk.user_role.clone(),
        (Generation::ESeries, "is in remote control") => desk.remote_control.to_string(),
        (Generation::ESeries, "get operational mode") => desk.operational_mode.to_owned(),
        (Generation::ESeries, "set operational mode") => {
            let Some(mode) = ["MANUAL", "AUTOMATIC"].into_iter().find(|mode| *mode == upper) else {
                return Some(format!("Failed setting operational mode: {argument}"));
            };
            desk.operational_mode = mode;
            format!("Operational mode {argument} is set")
        }
        (Generation::ESeries, "clear operational mode") => {
            desk.operational_mode = "NONE";
            "No longer controlling the operational mode. Current operational mode: 'NONE'.".to_owned()
        }
        (Generation::ESeries, "version") => generation.software().map(|part| part.to_string()).join("."),
        _ => return None,
    })
}

const TOO_EARLY: &str =
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking";
/// The installation on the controller's disk.
const INSTALLATION: &str = "default.installation";
const USER_ROLES: [&str; 5] = ["PROGRAMMER", "OPERATOR", "NONE", "LOCKED", "RESTRICTED"];

/// Longer ones first: `popup` is not `close popup`, but `load installation` begins as `load`.
const WITH_ARGUMENT: [&str; 8] = [
    "generate flight report",
    "generate support file",
    "load installation",
    "set operational mode",
    "setUserRole",
    "addToLog",
    "popup",
    "load",
];

fn split(line: &str) -> (&str, &str) {
    let found = WITH_ARGUMENT.into_iter().find_map(|command| {
        let rest = line.strip_prefix(command)?;
        (rest.is_empty() || rest.starts_with(' ')).then(|| (command, rest.trim()))
    });
    found.unwrap_or((line, ""))
}

fn unknown(line: &str) -> String {
    format!("could not understand: '{line}'")
}

fn outcome(done: Result<(), Refusal>, told: &str, refused: &str) -> String {
    if done.is_ok() { told } else { refused }.to_owned()
}

const fn state_name(state: RuntimeState) -> &'static str {
    match state {
        RuntimeState::Stopped => "STOPPED",
        RuntimeState::Playing => "PLAYING",
        RuntimeState::Paused => "PAUSED",
    }
}

fn version(generation: Generation) -> String {
    let [major, minor, bugfix, build] = generation.software();
    format!("URSoftware {major}.{minor}.{bugfix}.{build} (Mar 01 2022)")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::ur::Options;
    use crate::sim::ur::act::{Act, SafetyInput};
    use screed_kernel::arms::ur::UR10E;
    use screed_kernel::pose::Pose;
    use screed_kernel::units::JointPos;

    const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);

    fn controller(program: &str, generation: Generation) -> Controller {
        let options = Options {
            start_q: START,
            flange_from_tcp: Pose::identity(),
            register_offset: 0,
            program: format!("def test():\n{program}\nend\n"),
            autoplay: true,
            generation,
            powered: false,
        };
        Controller::new(&UR10E, options).expect("legal")
    }

    fn wait(controller: &mut Controller, seconds: f64) {
        for _ in 0..(seconds * f64::from(controller.generation().cycle_rate())) as u32 {
            controller.step();
        }
    }

    /// Each command and the answer it has to get, in this order.
    fn converse(controller: &mut Controller, lines: &[(&str, &str)]) {
        for (line, wanted) in lines {
            assert_eq!(answer(line, controller), *wanted, "{line}");
        }
    }

    #[test]
    fn power_brakes_and_programs_change_as_the_answers_say() {
        let robot = &mut controller("while True:\n  sync()\nend", Generation::Cb3);
        let refused = [
            ("robotmode", "Robotmode: POWER_OFF"),
            ("play", "Failed to execute: play"),
            ("pause", "Failed to execute: pause"),
            ("power on", "Powering on"),
        ];
        converse(robot, &refused);
        wait(robot, 0.1);
        converse(robot, &[("robotmode", "Robotmode: POWER_ON"), ("play", "Failed to execute: play")]);
        wait(robot, 1.0);
        converse(robot, &[("robotmode", "Robotmode: IDLE"), ("brake release", "Brake releasing")]);
        wait(robot, 1.0);
        let played = [
            ("robotmode", "Robotmode: RUNNING"),
            ("programState", "STOPPED screed.urp"),
            ("play", "Starting program"),
            ("running", "Program running: true"),
            ("programState", "PLAYING screed.urp"),
            ("pause", "Pausing program"),
            ("programState", "PAUSED screed.urp"),
            ("play", "Starting program"),
            ("load other.urp", "File not found: other.urp"),
            ("load screed.urp", "Loading program: screed.urp"),
            ("running", "Program running: false"),
            ("play", "Starting program"),
            ("power off", "Powering off"),
            ("programState", "STOPPED screed.urp"),
            ("brake release", "Brake releasing"),
            ("is in remote control", "could not understand: 'is in remote control'"),
            ("popupx", "could not understand: 'popupx'"),
        ];
        converse(robot, &played);
        // From no power at all the brakes take both times.
        wait(robot, 0.3);
        converse(robot, &[("robotmode", "Robotmode: IDLE")]);
        wait(robot, 0.5);
        converse(
            robot,
            &[("robotmode", "Robotmode: RUNNING"), ("PolyscopeVersion", "URSoftware 3.15.8.1 (Mar 01 2022)")],
        );
    }

    #[test]
    fn a_protective_stop_is_unlocked_after_five_seconds_and_nothing_goes_on_by_itself() {
        let far =
            "movej([0.4, -1.2, 1.9, -2.2, -1.5, 0.1])\nprotective_stop()\nmovej([0.5, -1.2, 1.9, -2.2, -1.5, 0.1])";
        let robot = &mut controller(far, Generation::ESeries);
        converse(robot, &[("brake release", "Brake releasing")]);
        wait(robot, 2.0);
        converse(robot, &[("play", "Starting program"), ("is in remote control", "false")]);
        wait(robot, 2.0);
        let early = "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking";
        let stopped = [
            ("safetystatus", "Safetystatus: PROTECTIVE_STOP"),
            ("play", "Failed to execute: play"),
            ("unlock protective stop", early),
        ];
        converse(robot, &stopped);
        wait(robot, 5.0);
        converse(
            robot,
            &[("unlock protective stop", "Protective stop releasing"), ("safetymode", "Safetymode: NORMAL")],
        );
        wait(robot, 1.0);
        assert!((robot.last_cycle().actual_q.0[0] - 0.4).abs() < 1e-12);
        converse(robot, &[("programState", "PAUSED screed.urp"), ("play", "Starting program")]);
        wait(robot, 2.0);
        assert!((robot.last_cycle().actual_q.0[0] - 0.5).abs() < 1e-12);
        converse(robot, &[("programState", "STOPPED screed.urp")]);
        robot.press_emergency_stop();
        let emergency = [
            ("safetystatus", "Safetystatus: ROBOT_EMERGENCY_STOP"),
            ("power on", "Failed to execute: power on"),
            ("unlock protective stop", "Failed to execute: unlock protective stop"),
            ("restart safety", "Restarting safety"),
            ("robotmode", "Robotmode: BOOTING"),
        ];
        converse(robot, &emergency);
        wait(robot, 0.6);
        let still_down = [
            ("robotmode", "Robotmode: POWER_OFF"),
            ("safetymode", "Safetymode: ROBOT_EMERGENCY_STOP"),
            ("power on", "Failed to execute: power on"),
        ];
        converse(robot, &still_down);
        robot.act(&Act::Safety(SafetyInput::RobotEmergency, false)).expect("a button");
        converse(robot, &[("safetymode", "Safetymode: NORMAL"), ("power on", "Powering on")]);
    }

    #[test]
    fn a_blocking_popup_holds_the_program_until_it_is_closed() {
        let robot = &mut controller(
            "popup(\"look\", blocking=True)\nwrite_output_integer_register(0, 7)\nhalt",
            Generation::ESeries,
        );
        converse(robot, &[("brake release", "Brake releasing")]);
        wait(robot, 2.0);
        converse(robot, &[("play", "Starting program")]);
        wait(robot, 1.0);
        assert_eq!((robot.popup(), robot.outputs.int(0)), (Some("look"), 0));
        converse(robot, &[("programState", "PAUSED screed.urp"), ("close popup", "closing popup")]);
        wait(robot, 0.1);
        assert_eq!((robot.popup(), robot.outputs.int(0)), (None, 7));
        converse(robot, &[("popup a b", "showing popup")]);
        assert_eq!(robot.popup(), Some("a b"));
    }

    #[test]
    fn lines_are_found_however_the_bytes_are_split() {
        let robot = &mut controller("sync()", Generation::ESeries);
        for chunk in [1, 3, 100] {
            let mut session = Session::default();
            for bytes in b"robotmode\r\nget robot model\nquit\nplay\n".chunks(chunk) {
                session.handle_bytes(bytes, robot);
            }
            let mut out = [0; 1024];
            let count = session.poll_transmit(&mut out);
            let text = String::from_utf8_lossy(&out[..count]);
            assert_eq!(text, format!("{GREETING}\nRobotmode: POWER_OFF\nUR10\nDisconnected\n"));
            assert!(!session.is_open());
        }
        let mut endless = Session::default();
        endless.handle_bytes(&[b'x'; LINE_MAX + 1], robot);
        assert!(!endless.is_open());
    }
}
