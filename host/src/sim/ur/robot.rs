//! Power, brakes and safety of the simulated robot, as a person or the dashboard changes them, and which controller it is.

/// The controller generation: timing, versions and wording differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Generation {
    /// CB3, software 3.15: 125 cycles per second.
    Cb3,
    /// e-Series, software 5.11: 500 cycles per second.
    #[default]
    ESeries,
}

impl Generation {
    /// Control cycles per second (Hz).
    pub const fn cycle_rate(self) -> u32 {
        match self {
            Self::Cb3 => 125,
            Self::ESeries => 500,
        }
    }

    /// What the controller says its software is: major, minor, bugfix, build.
    pub const fn software(self) -> [u32; 4] {
        match self {
            Self::Cb3 => [3, 15, 8, 1],
            Self::ESeries => [5, 11, 6, 1],
        }
    }
}

impl std::str::FromStr for Generation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "cb3" => Ok(Self::Cb3),
            "e-series" => Ok(Self::ESeries),
            _ => Err(format!("expected cb3 or e-series, found {text:?}")),
        }
    }
}

/// How long motors take to be powered (s). A choice of the simulation: real ones take longer.
const POWERING_ON: f64 = 1.0;
/// How long brakes take to be released (s). A choice of the simulation.
const RELEASING: f64 = 0.5;
/// A protective stop cannot be unlocked earlier than this (s), so that its cause is looked at.
pub const UNLOCK_AFTER: f64 = 5.0;

/// Motors and brakes. Times are what is left (s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Power {
    /// No power.
    Off,
    /// Power comes; whether the brakes shall be released then.
    PoweringOn {
        /// Until it is there.
        left: f64,
        /// Go on to release the brakes.
        release: bool,
    },
    /// Powered, brakes on.
    Idle,
    /// Brakes open.
    Releasing {
        /// Until they are.
        left: f64,
    },
    /// The arm can move.
    Running,
}

/// What the safety system says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Safety {
    /// All is well.
    Normal,
    /// Stopped because of something that a person has to look at.
    ProtectiveStop {
        /// For how long already (s).
        since: f64,
    },
    /// The robot's emergency stop button is down.
    EmergencyStop,
    /// The safety system has failed; only a restart helps.
    Fault,
}

/// An act that the robot's state does not allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Not in this state.
    State,
    /// The protective stop is too young.
    TooEarly,
}

/// The state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Robot {
    /// Motors and brakes.
    pub power: Power,
    /// The safety system.
    pub safety: Safety,
}

impl Robot {
    /// One cycle later.
    pub(super) fn step(&mut self, dt: f64) {
        if let Safety::ProtectiveStop { since } = &mut self.safety {
            *since += dt;
        }
        self.power = match self.power {
            Power::PoweringOn { left, release } if left > dt => Power::PoweringOn { left: left - dt, release },
            Power::PoweringOn { release: true, .. } => Power::Releasing { left: RELEASING },
            Power::PoweringOn { release: false, .. } => Power::Idle,
            Power::Releasing { left } if left > dt => Power::Releasing { left: left - dt },
            Power::Releasing { .. } => Power::Running,
            other => other,
        };
    }

    /// Whether a program can move the arm.
    pub fn is_ready(&self) -> bool {
        self.power == Power::Running && self.safety == Safety::Normal
    }

    /// Gives power to the motors; no change where they have it.
    pub(super) fn power_on(&mut self) -> Result<(), Refusal> {
        if matches!(self.safety, Safety::EmergencyStop | Safety::Fault) {
            return Err(Refusal::State);
        }
        if self.power == Power::Off {
            self.power = Power::PoweringOn { left: POWERING_ON, release: false };
        }
        Ok(())
    }

    /// Releases the brakes, after giving power where there is none.
    pub(super) fn release_brakes(&mut self) -> Result<(), Refusal> {
        self.power_on()?;
        self.power = match self.power {
            Power::PoweringOn { left, .. } => Power::PoweringOn { left, release: true },
            Power::Idle => Power::Releasing { left: RELEASING },
            other => other,
        };
        Ok(())
    }

    /// Ends a protective stop that is old enough. Without one, nothing happens.
    pub(super) fn unlock(&mut self) -> Result<(), Refusal> {
        match self.safety {
            Safety::ProtectiveStop { since } if since < UNLOCK_AFTER => Err(Refusal::TooEarly),
            Safety::ProtectiveStop { .. } => {
                self.safety = Safety::Normal;
                Ok(())
            }
            Safety::Normal => Ok(()),
            Safety::EmergencyStop | Safety::Fault => Err(Refusal::State),
        }
    }

    /// `robot_mode` of RTDE.
    pub const fn mode(&self) -> i32 {
        match self.power {
            Power::Off => 3,
            Power::PoweringOn { .. } => 4,
            Power::Idle | Power::Releasing { .. } => 5,
            Power::Running => 7,
        }
    }

    /// `robot_mode` in the dashboard's words.
    pub const fn mode_name(&self) -> &'static str {
        match self.power {
            Power::Off => "POWER_OFF",
            Power::PoweringOn { .. } => "POWER_ON",
            Power::Idle | Power::Releasing { .. } => "IDLE",
            Power::Running => "RUNNING",
        }
    }

    /// `joint_mode` of RTDE, of every joint: 239 power off, 255 idle, 253 running.
    pub const fn joint_mode(&self) -> i32 {
        match self.power {
            Power::Off => 239,
            Power::PoweringOn { .. } | Power::Idle | Power::Releasing { .. } => 255,
            Power::Running => 253,
        }
    }

    /// `safety_mode` and `safety_status` of RTDE.
    pub const fn safety_mode(&self) -> i32 {
        match self.safety {
            Safety::Normal => 1,
            Safety::ProtectiveStop { .. } => 3,
            Safety::EmergencyStop => 7,
            Safety::Fault => 9,
        }
    }

    /// `safety_mode` in the dashboard's words.
    pub const fn safety_name(&self) -> &'static str {
        match self.safety {
            Safety::Normal => "NORMAL",
            Safety::ProtectiveStop { .. } => "PROTECTIVE_STOP",
            Safety::EmergencyStop => "ROBOT_EMERGENCY_STOP",
            Safety::Fault => "FAULT",
        }
    }

    /// `safety_status_bits` of RTDE. Bits: 0 normal, 2 protective stop, 6 robot emergency stop, 7 emergency stop, 9 fault,
    /// 10 stopped due to safety.
    pub const fn safety_bits(&self) -> u32 {
        match self.safety {
            Safety::Normal => 1,
            Safety::ProtectiveStop { .. } => 1 << 2 | 1 << 10,
            Safety::EmergencyStop => 1 << 6 | 1 << 7 | 1 << 10,
            Safety::Fault => 1 << 9 | 1 << 10,
        }
    }
}
