//! Acts of a person on the robot's dashboard: power, brakes, unlock, play, stop. Each does one thing, waits until it is done, and
//! tells why it is not.

use super::view::{Standing, standing};
use super::{ControllerError, DashboardLine};
use crate::failure::{Exit, Failure};
use crate::link::dashboard::{self, DashboardError, ProgramState, Request, RobotMode};
use std::time::{Duration, Instant};

/// How long an act may take to be done: motors and brakes of a real robot need some seconds.
const PATIENCE: Duration = Duration::from_secs(30);
/// By then a program that is played has begun, if it ever does.
const LOADED: Duration = Duration::from_secs(3);
/// How often it is looked whether it is done.
const EVERY: Duration = Duration::from_millis(100);

/// What a person can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Act {
    /// Power to the motors.
    PowerOn,
    /// No power.
    PowerOff,
    /// Brakes open.
    BrakeRelease,
    /// End a protective stop.
    Unlock,
    /// Start, or go on with, the program on the controller.
    Play,
    /// End the program.
    Stop,
    /// Close popups.
    ClosePopup,
}

impl Act {
    /// The word that a person types, which is also the command's.
    pub const fn word(self) -> &'static str {
        match self {
            Self::PowerOn => "power-on",
            Self::PowerOff => "power-off",
            Self::BrakeRelease => "brake-release",
            Self::Unlock => "unlock",
            Self::Play => "play",
            Self::Stop => "stop",
            Self::ClosePopup => "close-popup",
        }
    }

    /// What a person has to know before it; none for what neither moves nor powers the robot.
    pub const fn warning(self, standing: &Standing) -> Option<&'static str> {
        Some(match self {
            Self::PowerOn => "the motors get power; the brakes stay on",
            Self::BrakeRelease
                if !matches!(standing.mode, RobotMode::PowerOn | RobotMode::Idle | RobotMode::Running) =>
            {
                "the motors get power, then the brakes open and the arm may sink a little; its payload has to be right"
            }
            Self::BrakeRelease => "the brakes open and the arm may sink a little; its payload has to be right",
            Self::Unlock => "the protective stop ends; look at its cause first",
            Self::Play => "the program of the controller runs and may move the arm at once",
            // A program that waits for its popup goes on when it is closed.
            Self::ClosePopup if matches!(standing.program, ProgramState::Paused) => {
                "a program is held, and may go on and move the arm when the popup closes"
            }
            Self::PowerOff | Self::Stop | Self::ClosePopup => return None,
        })
    }

    /// Whether there is something to do.
    ///
    /// # Errors
    /// [`Failure`] where unlocking would wait for what only another act can end.
    pub fn is_wanted(self, now: &Standing) -> Result<bool, Failure> {
        match (self, now.safety) {
            (Self::Unlock, dashboard::Safety::ProtectiveStop) => Ok(true),
            (Self::Unlock, safety) if safety.is_well() => Ok(false),
            (Self::Unlock, _) => {
                Err(told("unlock ends protective stops, and another one holds the robot".to_owned(), self, now))
            }
            _ => Ok(true),
        }
    }

    const fn requests(self) -> &'static [Request<()>] {
        match self {
            Self::PowerOn => &[dashboard::POWER_ON],
            Self::PowerOff => &[dashboard::POWER_OFF],
            Self::BrakeRelease => &[dashboard::BRAKE_RELEASE],
            Self::Unlock => &[dashboard::UNLOCK],
            Self::Play => &[dashboard::PLAY],
            Self::Stop => &[dashboard::STOP],
            Self::ClosePopup => &[dashboard::CLOSE_POPUP, dashboard::CLOSE_SAFETY_POPUP],
        }
    }

    /// Whether the robot stands as it shall after the act.
    fn is_done(self, now: &Standing) -> bool {
        match self {
            Self::PowerOn => matches!(now.mode, RobotMode::Idle | RobotMode::Running),
            Self::PowerOff => matches!(now.mode, RobotMode::PowerOff),
            Self::BrakeRelease => matches!(now.mode, RobotMode::Running),
            // What else stops the robot then is told.
            Self::Unlock => now.safety != dashboard::Safety::ProtectiveStop,
            Self::Play => matches!(now.program, ProgramState::Playing),
            Self::Stop => matches!(now.program, ProgramState::Stopped),
            Self::ClosePopup => true,
        }
    }
}

/// Does it, and waits until it is done: a person has said so. How the robot stands then.
///
/// # Errors
/// [`Failure`] with what the controller said, and why it may have.
pub fn act(line: &mut DashboardLine, act: Act) -> Result<Standing, Failure> {
    for request in act.requests() {
        match line.ask(request) {
            Ok(()) => {}
            // Old software has no safety popups.
            Err(ControllerError::Dashboard(DashboardError::NotKnown { .. })) if act == Act::ClosePopup => {}
            Err(ControllerError::Dashboard(DashboardError::Refused { answer, .. })) => {
                return Err(refused(act, &answer, &standing(line)?));
            }
            Err(error) => return Err(error.into()),
        }
    }
    let began = Instant::now();
    loop {
        let now = standing(line).map_err(|error| unknown(act, error))?;
        if act.is_done(&now) {
            return Ok(now);
        }
        let waited = began.elapsed();
        if act == Act::Play && !now.safety.is_well() {
            return Err(told("play was taken, and the robot has stopped".to_owned(), act, &now));
        }
        if act == Act::Play && matches!(now.program, ProgramState::Stopped) && waited > LOADED {
            let message = format!("play was taken, and the program {} has ended, or never began", now.program_name);
            let remedy = "see the log on the teach pendant; Screed's program is sent with screed robot play --upload";
            return Err(Failure::new(Exit::Link, message, remedy));
        }
        if waited > PATIENCE {
            let message = format!("{} was taken, but is not done after {} s", act.word(), PATIENCE.as_secs());
            return Err(told(message, act, &now));
        }
        std::thread::sleep(EVERY);
    }
}

/// It was taken, and then the controller says what is not understood.
fn unknown(act: Act, error: ControllerError) -> Failure {
    let mut failure = Failure::from(error);
    if let Some(problem) = failure.problems.first_mut() {
        problem.message =
            format!("{} was taken, but how the robot stands is not known: {}", act.word(), problem.message);
    }
    failure
}

fn refused(act: Act, answer: &str, now: &Standing) -> Failure {
    told(format!("the controller refuses {}: {answer:?}", act.word()), act, now)
}

/// With how the robot stands, and what to do about that.
fn told(message: String, act: Act, now: &Standing) -> Failure {
    let exit = if now.safety.is_well() { Exit::Link } else { Exit::SafetyStop };
    let Standing { mode, safety, program, program_name, .. } = now;
    let message = format!(
        "{message} (robot {}, safety {}, program {} {program_name})",
        mode.name(),
        safety.name(),
        program.name()
    );
    Failure::new(exit, message, remedy(act, now))
}

fn remedy(act: Act, now: &Standing) -> String {
    if act == Act::Unlock && now.safety == dashboard::Safety::ProtectiveStop {
        return "look at the cause, wait five seconds after the stop, then unlock again".to_owned();
    }
    if let Some(remedy) = now.safety.remedy() {
        return remedy.action.to_owned();
    }
    // What cannot play without power says so, whoever has control.
    if let (Act::Play, Some(remedy)) = (act, now.mode.remedy()) {
        return remedy.action.to_owned();
    }
    // A controller without the feature of remote control says the same, and obeys: so it is no reason before it refuses.
    if now.remote == Some(false) {
        return "switch the robot to remote control at the top right of the teach pendant; if it has no such switch, something may \
                wait on the pendant for an answer"
            .to_owned();
    }
    match act {
        Act::Play => {
            "close what pops up on the teach pendant (screed robot close-popup), and load a program there, or upload Screed's with \
             screed robot play --upload"
        }
        _ => "see the teach pendant: something may wait there for an answer",
    }
    .to_owned()
}
