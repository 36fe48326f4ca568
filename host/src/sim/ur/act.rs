//! What a person, the cell or bad luck does to the simulated robot, as one line of text: on the command line with a time
//! (`--fault`), or while it runs on the standard input (`--control`).

use super::inputs::Fieldbus;
use crate::sim::line::Spoil;

/// Longest silence, half package or restart (s).
const SECONDS_MAX: f64 = 86_400.0;

/// One of them.
#[derive(Clone, Debug, PartialEq)]
pub enum Act {
    /// A protective stop.
    ProtectiveStop,
    /// The safety system fails.
    SafetyFault,
    /// A safety input changes.
    Safety(SafetyInput, bool),
    /// A message on the teach pendant.
    Popup(String),
    /// It is closed.
    ClosePopup,
    /// Somebody presses play, or resume.
    Play,
    /// Somebody pauses the program.
    Pause,
    /// Somebody stops it.
    Stop,
    /// Somebody switches the motors off.
    PowerOff,
    /// Remote control is chosen on the teach pendant, or local.
    RemoteControl(bool),
    /// All connections are reset.
    Reset,
    /// RTDE sends nothing for so long (s).
    Silence(f64),
    /// Half a data package of RTDE, and then nothing for so long (s).
    Half(f64),
    /// The next data package of each RTDE client is spoilt.
    Corrupt(Spoil),
    /// The controller is too busy for so many cycles to send data packages.
    Skip(u64),
    /// The controller ends all connections, comes back after so long (s) and counts its time from zero.
    Restart(f64),
    /// A fieldbus takes inputs.
    Fieldbus(Fieldbus),
    /// The level of a digital input: standard 0 to 7, configurable 8 to 15, tool 16 and 17.
    DigitalInput(usize, bool),
    /// The voltage of an analog input (V): standard 0 and 1, tool 2 and 3.
    AnalogInput(usize, f64),
}

/// What is wired to the safety system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SafetyInput {
    /// The robot's emergency stop.
    RobotEmergency,
    /// The system's.
    SystemEmergency,
    /// The safeguard.
    Safeguard,
    /// The three-position switch: on is released.
    Enabling,
    /// Reduced mode.
    Reduced,
}

impl std::str::FromStr for Act {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let (word, rest) = text.split_once([' ', '=']).unwrap_or((text, ""));
        let rest = rest.trim();
        let input = |input| Ok(Self::Safety(input, if rest.is_empty() { true } else { level(rest)? }));
        let act = match word {
            "emergency-stop" => return input(SafetyInput::RobotEmergency),
            "system-emergency-stop" => return input(SafetyInput::SystemEmergency),
            "safeguard-stop" => return input(SafetyInput::Safeguard),
            "enabling-stop" => return input(SafetyInput::Enabling),
            "reduced" => return input(SafetyInput::Reduced),
            "popup" => return Ok(Self::Popup(rest.to_owned())),
            "remote-control" => return Ok(Self::RemoteControl(level(rest)?)),
            "silence" => return Ok(Self::Silence(seconds(rest)?)),
            "half" => return Ok(Self::Half(seconds(rest)?)),
            "corrupt" => return Ok(Self::Corrupt(rest.parse()?)),
            "skip" => {
                let count = rest.parse().map_err(|_| format!("expected a count of packages, found {rest:?}"))?;
                return Ok(Self::Skip(count));
            }
            "restart" => return Ok(Self::Restart(seconds(rest)?)),
            "fieldbus" => return Ok(Self::Fieldbus(rest.parse()?)),
            "digital-input" => {
                let (place, value) = place(rest, 18)?;
                return Ok(Self::DigitalInput(place, level(value)?));
            }
            "analog-input" => {
                let (place, value) = place(rest, 4)?;
                let volts = value.parse().ok().filter(|volts: &f64| (0.0..=10.0).contains(volts));
                let volts = volts.ok_or_else(|| format!("expected 0 to 10 V, found {value:?}"))?;
                return Ok(Self::AnalogInput(place, volts));
            }
            "protective-stop" => Self::ProtectiveStop,
            "safety-fault" => Self::SafetyFault,
            "close-popup" => Self::ClosePopup,
            "play" => Self::Play,
            "pause" => Self::Pause,
            "stop" => Self::Stop,
            "power-off" => Self::PowerOff,
            "reset" => Self::Reset,
            _ => return Err(format!("expected {WORDS}, found {word:?}")),
        };
        if rest.is_empty() { Ok(act) } else { Err(format!("expected nothing behind {word}, found {rest:?}")) }
    }
}

/// The first words.
const WORDS: &str = "protective-stop, emergency-stop, system-emergency-stop, safeguard-stop, enabling-stop, reduced, \
    safety-fault, popup, close-popup, play, pause, stop, power-off, remote-control, reset, silence, half, corrupt, skip, \
    restart, fieldbus, digital-input or analog-input";

fn level(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err(format!("expected on or off, found {text:?}")),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    let found = text.parse().ok().filter(|seconds: &f64| (0.0..=SECONDS_MAX).contains(seconds));
    found.ok_or_else(|| format!("expected seconds from 0 to {SECONDS_MAX}, found {text:?}"))
}

/// A number below `count`, and what stands behind it.
fn place(text: &str, count: usize) -> Result<(usize, &str), String> {
    let (number, rest) = text.split_once([' ', '=']).unwrap_or((text, ""));
    let found = number.parse().ok().filter(|number| *number < count);
    let found =
        found.ok_or_else(|| format!("expected the number of an input from 0 to {}, found {number:?}", count - 1))?;
    Ok((found, rest.trim()))
}

/// An act at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// Which.
    pub act: Act,
    /// As it was written.
    pub text: String,
    /// When, counted from the server's start (s).
    pub at: f64,
}

impl std::str::FromStr for Fault {
    type Err = String;

    /// `KIND@SECONDS`, for example `silence=0.5@10`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (act, at) = text.rsplit_once('@').ok_or_else(|| format!("expected KIND@SECONDS, found {text:?}"))?;
        Ok(Self { act: act.parse()?, text: act.to_owned(), at: seconds(at)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_acts_and_what_is_none_is_told() {
        for (text, act) in [
            ("protective-stop", Act::ProtectiveStop),
            ("emergency-stop", Act::Safety(SafetyInput::RobotEmergency, true)),
            ("safeguard-stop off", Act::Safety(SafetyInput::Safeguard, false)),
            ("enabling-stop=on", Act::Safety(SafetyInput::Enabling, true)),
            (" popup look here ", Act::Popup("look here".to_owned())),
            ("silence=0.5", Act::Silence(0.5)),
            ("half 1", Act::Half(1.0)),
            ("corrupt nan", Act::Corrupt(Spoil::NotANumber)),
            ("skip 3", Act::Skip(3)),
            ("restart 2", Act::Restart(2.0)),
            ("fieldbus lower", Act::Fieldbus(Fieldbus::Lower)),
            ("digital-input 17 on", Act::DigitalInput(17, true)),
            ("analog-input=2=4.5", Act::AnalogInput(2, 4.5)),
        ] {
            assert_eq!(text.parse(), Ok(act), "{text}");
        }
        for (text, told) in [
            ("", "expected protective-stop"),
            ("play now", "nothing behind play"),
            ("silence -1", "seconds from 0"),
            ("silence nan", "seconds from 0"),
            ("skip 1.5", "count of packages"),
            ("digital-input 18 on", "0 to 17"),
            ("digital-input 1", "on or off"),
            ("analog-input 0 11", "0 to 10 V"),
            ("fieldbus upper", "off, lower or all"),
            ("corrupt", "size, type"),
        ] {
            let found = text.parse::<Act>().expect_err(text);
            assert!(found.contains(told), "{text}: {found}");
        }
        let text = "silence=0.5".to_owned();
        assert_eq!("silence=0.5@10".parse(), Ok(Fault { act: Act::Silence(0.5), text, at: 10.0 }));
        assert!("reset".parse::<Fault>().is_err_and(|told| told.contains("KIND@SECONDS")));
    }
}
