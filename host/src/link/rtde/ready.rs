//! Whether a UR takes setpoints; and if not, why. What a person does about it is the dashboard's table
//! ([`remedy`]).

use super::{Event, RobotState, TextLevel};
use crate::link::dashboard::{RobotMode, Safety, remedy};
use crate::link::{self, Code, NotReady, Telegram};
use std::fmt::Write;

/// Of `runtime_state`: one is ending.
const STOPPING: u32 = 0;
/// Of `runtime_state`: no program runs.
pub const STOPPED: u32 = 1;
/// Of `runtime_state`: one does.
pub const PLAYING: u32 = 2;
const PAUSING: u32 = 3;
/// Of `runtime_state`: one is held.
pub const PAUSED: u32 = 4;
const RESUMING: u32 = 5;

/// Of `robot_mode`.
const RUNNING: i32 = 7;

/// Safety bits with which setpoints are taken: normal (0) or reduced (1).
pub const MOVING: u32 = 0b11;

/// All that are known: 0 to 11.
const KNOWN: u32 = 0xfff;

/// Those that name what stops the robot, the gravest first; "stopped due to safety" (10) comes beside each. Bit 7 alone does not say
/// whose button it is.
const STOPS: [(u32, Option<Safety>); 9] = [
    (1 << 9, Some(Safety::Fault)),
    (1 << 8, Some(Safety::Violation)),
    (1 << 6, Some(Safety::RobotEmergencyStop)),
    (1 << 5, Some(Safety::SystemEmergencyStop)),
    (1 << 7, None),
    (1 << 11, Some(Safety::EnablingStop)),
    (1 << 4, Some(Safety::SafeguardStop)),
    (1 << 2, Some(Safety::ProtectiveStop)),
    (1 << 3, Some(Safety::Recovery)),
];

impl RobotState {
    /// What every robot says. `fed` is whether setpoints arrived until the program stopped playing, if it has.
    pub fn telegram(&self, fed: bool) -> Telegram {
        Telegram {
            time: self.timestamp,
            joints: self.actual_q,
            arrived: Some(self.arrived as u32),
            not_ready: self.not_ready(fed),
        }
    }

    /// What keeps the robot from taking setpoints, the gravest first: none where nothing does. What newer software may say, and
    /// nobody knows here, keeps it from that as well: it may be a stop, also beside the bit that all is normal.
    fn not_ready(&self, fed: bool) -> Option<NotReady> {
        let Self { robot_mode, safety_status_bits: bits, runtime_state, .. } = *self;
        let because = |remedy, code| Some(NotReady { remedy, code });
        let safety = Code::Bits("safety status bits", bits);
        let normal = bits & MOVING != 0;
        if let Some((_, stop)) = STOPS.iter().find(|(bit, _)| bits & bit != 0) {
            return because(stop.and_then(Safety::remedy).unwrap_or(remedy::EMERGENCY_STOP), safety);
        }
        if robot_mode != RUNNING {
            let mode = RobotMode::from_code(robot_mode).and_then(RobotMode::remedy);
            let code = Code::Number("robot mode", robot_mode.into(), RUNNING.into());
            return because(mode.unwrap_or(remedy::UNKNOWN_MODE), code);
        }
        if bits & !KNOWN != 0 {
            return because(remedy::UNKNOWN_SAFETY, safety);
        }
        if !normal {
            return because(remedy::HELD, safety);
        }
        let program = match runtime_state {
            PLAYING => return None,
            PAUSING | PAUSED if fed => remedy::POPUP,
            PAUSING | PAUSED => remedy::PAUSED,
            RESUMING => remedy::RESUMING,
            STOPPING | STOPPED => remedy::NO_PROGRAM,
            _ => remedy::UNKNOWN_PROGRAM,
        };
        because(program, Code::Number("runtime state", runtime_state.into(), PLAYING.into()))
    }
}

impl super::RtdeClient {
    /// The next thing to tell in the words of every link: texts are those of exceptions and errors.
    pub fn poll_told(&mut self) -> Option<link::Event> {
        loop {
            return Some(match self.poll_event()? {
                Event::Running { .. } => link::Event::Running,
                Event::State { state, skipped } => {
                    link::Event::Telegram { telegram: state.telegram(self.robot.fed.is_fed), skipped }
                }
                Event::Text { text, lost } if matches!(text.level, TextLevel::Exception | TextLevel::Error) => {
                    let mut told = heapless::String::new();
                    // There is room: the longest has 255 characters.
                    let _ = write!(told, "{}", text.message);
                    if lost > 0 {
                        let _ = write!(told, " ({lost} texts before it were lost)");
                    }
                    link::Event::Text(told)
                }
                Event::Text { .. } => continue,
            });
        }
    }
}

/// Whether setpoints arrived until the program stopped playing: then it was not its watchdog that stopped it, which waits for two
/// periods at least.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fed {
    /// A period and a half (s): the next state's time stamp is one on, that of the one after it two.
    age_max: f64,
    /// The newest echoed number, and the time stamp (s) with which it first came; none where it may have come long before.
    arrived: Option<(i32, Option<f64>)>,
    playing: bool,
    is_fed: bool,
}

impl Fed {
    pub(super) const fn new(rate_hz: u32) -> Self {
        Self { age_max: 1.5 / rate_hz as f64, arrived: None, playing: false, is_fed: false }
    }

    pub(super) fn state(&mut self, state: &RobotState) {
        let since = match self.arrived {
            Some((number, since)) if number == state.arrived => since,
            Some(_) => Some(state.timestamp),
            None => None,
        };
        self.arrived = Some((state.arrived, since));
        let was_playing = std::mem::replace(&mut self.playing, state.runtime_state == PLAYING);
        if was_playing && !self.playing {
            self.is_fed = since.is_some_and(|since| state.timestamp - since <= self.age_max);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use screed_kernel::units::{JointPos, JointVel};

    fn state(robot_mode: i32, safety_status_bits: u32, runtime_state: u32) -> RobotState {
        RobotState {
            timestamp: 41.0,
            actual_q: JointPos::ZERO,
            actual_qd: JointVel([0.0; 6]),
            target_q: JointPos::ZERO,
            actual_tcp_pose: [0.0; 6],
            runtime_state,
            robot_mode,
            safety_status_bits,
            program_state: 2,
            arrived: 1,
        }
    }

    #[test]
    fn every_state_that_takes_no_setpoints_has_its_own_cause_and_action() {
        let mut texts: Vec<String> = Vec::new();
        let bits = [9, 8, 6, 5, 7, 11, 4, 2, 3].map(|bit| state(7, 1 << bit | 1 << 10, 2));
        let modes = [-1, 0, 1, 2, 3, 4, 5, 6, 8, 9].map(|mode| state(mode, 1, 2));
        let programs = [1, 4, 5, 6].map(|program| state(7, 1, program));
        let others = [state(7, 1 << 10, 2), state(7, 1 | 1 << 12, 2)];
        for state in bits.into_iter().chain(modes).chain(programs).chain(others) {
            for fed in if state.runtime_state == 4 { &[false, true][..] } else { &[false] } {
                let why = state.not_ready(*fed).expect("it takes none");
                assert!(why.to_string().len() <= screed_kernel::frame::NOTE_MAX, "{why}");
                assert!(why.remedy.cause.len() > 20 && why.remedy.action.len() > 10, "{why}");
                assert!(!texts.contains(&why.remedy.cause.to_owned()), "{why} stands for two");
                texts.push(why.remedy.cause.to_owned());
            }
        }
        for well in [state(7, 1, 2), state(7, 2, 2)] {
            assert_eq!(well.not_ready(false), None);
        }
        // Also beside "normal" or "reduced" a stop is one.
        for moving in [1, 2] {
            let why = state(7, moving | 1 << 2 | 1 << 10, 4).not_ready(false).expect("a protective stop");
            assert_eq!(Some(why.remedy), Safety::ProtectiveStop.remedy());
        }
    }

    #[test]
    fn what_newer_software_may_say_is_no_readiness_and_the_gravest_that_is_known_is_told_first() {
        let told = |mode, bits, program| state(mode, bits, program).not_ready(false).map(|why| why.to_string());
        for bit in 12..32 {
            let text = told(7, 1 | 1 << bit, 2).expect("it may be a stop");
            assert!(text.contains("does not know") && text.contains(&format!("{:#x}", 1 | 1_u32 << bit)), "{text}");
            let text = told(7, 1 << bit | 1 << 6, 2).expect("an emergency stop");
            assert!(text.contains("the robot's emergency stop is pressed"), "{text}");
            let text = told(3, 1 << bit, 2).expect("no power");
            assert!(text.contains("no power"), "{text}");
        }
        for mode in [i32::MIN, -2, 9, i32::MAX] {
            let text = told(mode, 1, 2).expect("it is not running");
            assert!(text.contains("a mode that Screed does not know") && text.contains(&format!("{mode},")), "{text}");
        }
        for program in [6, 7, u32::MAX] {
            let text = told(7, 1, program).expect("it is not playing");
            assert!(
                text.contains("a state that Screed does not know") && text.contains(&program.to_string()),
                "{text}"
            );
        }
    }

    #[test]
    fn a_pause_while_setpoints_come_is_none_of_the_watchdog() {
        // Echoed numbers while it plays, then those of the first states that do not, and whether they came until then.
        let runs: [(&[i32], [i32; 2], bool); 6] = [
            (&[1, 2, 3, 4], [4, 4], true),
            (&[1, 2, 3, 4], [5, 6], true),
            // It may have been a watchdog of two periods.
            (&[1, 2, 3, 3], [3, 3], false),
            // What comes later says nothing of what was before.
            (&[1, 2, 3, 3, 3, 3], [3, 4], false),
            (&[7, 7, 7], [7, 7], false),
            (&[], [7, 8], false),
        ];
        for (rate_hz, period) in [(500, 0.002), (125, 0.008)] {
            for (playing, paused, expected) in runs {
                let mut fed = Fed::new(rate_hz);
                let mut time = 41.0;
                let playing = playing.iter().map(|arrived| (2, *arrived));
                for (program, arrived) in playing.chain([3, 4].into_iter().zip(paused)) {
                    time += period;
                    fed.state(&RobotState { timestamp: time, arrived, ..state(7, 1, program) });
                }
                assert_eq!(fed.is_fed, expected, "{paused:?} at {rate_hz} Hz");
            }
        }
    }
}
