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
const POWERING_ON: f64 = 0.25;
/// How long brakes take to be released (s). A choice of the simulation.
const RELEASING: f64 = 0.15;
/// How long the safety system, or all of the controller, is "booting" (s). A choice of the simulation.
const BOOTING: f64 = 0.5;
/// A protective stop cannot be unlocked earlier than this (s), so that its cause is looked at.
pub const UNLOCK_AFTER: f64 = 5.0;

/// Motors and brakes. Times are what is left (s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Power {
    /// The controller or its safety system starts.
    Booting {
        /// Until there is no power, as it should be then.
        left: f64,
    },
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

/// What the safety system says, the gravest first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Safety {
    /// The safety system has failed; only a restart of it helps.
    Fault,
    /// The robot's emergency stop button is down.
    RobotEmergencyStop,
    /// An emergency stop of the system around the robot.
    SystemEmergencyStop,
    /// Stopped because of something that a person has to look at.
    ProtectiveStop {
        /// For how long already (s).
        since: f64,
    },
    /// A safeguard, a light curtain for example, holds the robot.
    SafeguardStop,
    /// The three-position switch is not held in its middle.
    EnablingStop,
    /// All is well, within reduced limits. The simulation's limits stay the same.
    Reduced,
    /// All is well.
    Normal,
}

/// `safety_status` of RTDE, the dashboard's word, and the bits of `safety_status_bits`: 0 normal, 1 reduced,
/// 2 protective stop, 4 safeguard stop, 5 system emergency stop, 6 robot emergency stop, 7 emergency stop, 9 fault, 10 stopped
/// due to safety, 11 three-position switch.
const fn told(safety: Safety) -> (i32, &'static str, u32) {
    match safety {
        Safety::Normal => (1, "NORMAL", 1),
        Safety::Reduced => (2, "REDUCED", 1 << 1),
        Safety::ProtectiveStop { .. } => (3, "PROTECTIVE_STOP", 1 << 2 | 1 << 10),
        Safety::SafeguardStop => (5, "SAFEGUARD_STOP", 1 << 4 | 1 << 10),
        Safety::SystemEmergencyStop => (6, "SYSTEM_EMERGENCY_STOP", 1 << 5 | 1 << 7 | 1 << 10),
        Safety::RobotEmergencyStop => (7, "ROBOT_EMERGENCY_STOP", 1 << 6 | 1 << 7 | 1 << 10),
        Safety::Fault => (9, "FAULT", 1 << 9 | 1 << 10),
        Safety::EnablingStop => (13, "SYSTEM_THREE_POSITION_ENABLING_STOP", 1 << 10 | 1 << 11),
    }
}

/// What is wired to the robot's safety inputs, as a person sets it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SafetyInputs {
    /// The button on the robot is down.
    pub robot_emergency: bool,
    /// The emergency stop of the system around it.
    pub system_emergency: bool,
    /// The safeguard is open.
    pub safeguard: bool,
    /// The three-position switch is released, or pressed through.
    pub enabling: bool,
    /// Reduced limits are asked for.
    pub reduced: bool,
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
    /// The safety inputs.
    pub inputs: SafetyInputs,
    /// A protective stop, and for how long already (s).
    protective: Option<f64>,
    fault: bool,
}

impl Robot {
    /// A healthy robot.
    pub const fn new(power: Power) -> Self {
        let inputs = SafetyInputs {
            robot_emergency: false,
            system_emergency: false,
            safeguard: false,
            enabling: false,
            reduced: false,
        };
        Self { power, inputs, protective: None, fault: false }
    }

    /// One cycle later.
    pub(super) fn step(&mut self, dt: f64) {
        if let Some(since) = &mut self.protective {
            *since += dt;
        }
        self.power = match self.power {
            Power::Booting { left } if left > dt => Power::Booting { left: left - dt },
            Power::Booting { .. } => Power::Off,
            Power::PoweringOn { left, release } if left > dt => Power::PoweringOn { left: left - dt, release },
            Power::PoweringOn { release: true, .. } => Power::Releasing { left: RELEASING },
            Power::PoweringOn { release: false, .. } => Power::Idle,
            Power::Releasing { left } if left > dt => Power::Releasing { left: left - dt },
            Power::Releasing { .. } => Power::Running,
            other => other,
        };
    }

    /// The gravest of what holds.
    pub const fn safety(&self) -> Safety {
        match (self.fault, self.inputs, self.protective) {
            (true, ..) => Safety::Fault,
            (_, SafetyInputs { robot_emergency: true, .. }, _) => Safety::RobotEmergencyStop,
            (_, SafetyInputs { system_emergency: true, .. }, _) => Safety::SystemEmergencyStop,
            (.., Some(since)) => Safety::ProtectiveStop { since },
            (_, SafetyInputs { safeguard: true, .. }, _) => Safety::SafeguardStop,
            (_, SafetyInputs { enabling: true, .. }, _) => Safety::EnablingStop,
            (_, SafetyInputs { reduced: true, .. }, _) => Safety::Reduced,
            _ => Safety::Normal,
        }
    }

    /// Whether the safety system lets the arm move.
    pub const fn may_move(&self) -> bool {
        matches!(self.safety(), Safety::Normal | Safety::Reduced)
    }

    /// Whether it lets the motors have power.
    pub const fn may_have_power(&self) -> bool {
        !self.is_emergency() && !matches!(self.safety(), Safety::Fault)
    }

    /// Whether an emergency stop holds.
    pub const fn is_emergency(&self) -> bool {
        matches!(self.safety(), Safety::RobotEmergencyStop | Safety::SystemEmergencyStop)
    }

    /// Whether a program can move the arm.
    pub fn is_ready(&self) -> bool {
        self.power == Power::Running && self.may_move()
    }

    /// Takes new safety inputs: an emergency stop takes the power away.
    pub(super) fn set_inputs(&mut self, inputs: SafetyInputs) {
        self.inputs = inputs;
        if self.is_emergency() {
            self.power = Power::Off;
        }
    }

    /// A protective stop begins.
    pub(super) const fn stop(&mut self) {
        self.protective = Some(0.0);
    }

    /// The safety system fails: no power.
    pub(super) const fn fail(&mut self) {
        (self.fault, self.power) = (true, Power::Off);
    }

    /// The safety system starts again, or all of the controller: no power after that. A button that is down stays down.
    pub(super) const fn restart(&mut self) {
        *self = Self { inputs: self.inputs, ..Self::new(Power::Booting { left: BOOTING }) };
    }

    /// Gives power to the motors; no change where they have it.
    pub(super) fn power_on(&mut self) -> Result<(), Refusal> {
        if !self.may_have_power() || matches!(self.power, Power::Booting { .. }) {
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

    /// Ends a protective stop that is old enough, as the teach pendant and the dashboard do. Without one, nothing happens.
    pub(super) fn unlock(&mut self) -> Result<(), Refusal> {
        match self.safety() {
            Safety::ProtectiveStop { since } if since < UNLOCK_AFTER => Err(Refusal::TooEarly),
            _ => self.unlock_at_once(),
        }
    }

    /// Ends a protective stop of any age.
    pub(super) fn unlock_at_once(&mut self) -> Result<(), Refusal> {
        if !self.may_have_power() {
            return Err(Refusal::State);
        }
        self.protective = None;
        Ok(())
    }

    /// `robot_mode` of RTDE.
    pub const fn mode(&self) -> i32 {
        match self.power {
            Power::Booting { .. } => 2,
            Power::Off => 3,
            Power::PoweringOn { .. } => 4,
            Power::Idle | Power::Releasing { .. } => 5,
            Power::Running => 7,
        }
    }

    /// `robot_mode` in the dashboard's words.
    pub const fn mode_name(&self) -> &'static str {
        match self.power {
            Power::Booting { .. } => "BOOTING",
            Power::Off => "POWER_OFF",
            Power::PoweringOn { .. } => "POWER_ON",
            Power::Idle | Power::Releasing { .. } => "IDLE",
            Power::Running => "RUNNING",
        }
    }

    /// `joint_mode` of RTDE, of every joint: 239 power off, 255 idle, 253 running.
    pub const fn joint_mode(&self) -> i32 {
        match self.power {
            Power::Off | Power::Booting { .. } => 239,
            Power::PoweringOn { .. } | Power::Idle | Power::Releasing { .. } => 255,
            Power::Running => 253,
        }
    }

    /// `safety_status` of RTDE.
    pub const fn safety_status(&self) -> i32 {
        told(self.safety()).0
    }

    /// `safety_status` in the dashboard's words.
    pub const fn safety_status_name(&self) -> &'static str {
        told(self.safety()).1
    }

    /// `safety_mode` of RTDE: it knows one stop for all safeguards.
    pub const fn safety_mode(&self) -> i32 {
        told(self.safety_as_mode()).0
    }

    /// `safety_mode` in the dashboard's words.
    pub const fn safety_mode_name(&self) -> &'static str {
        told(self.safety_as_mode()).1
    }

    const fn safety_as_mode(&self) -> Safety {
        match self.safety() {
            Safety::EnablingStop => Safety::SafeguardStop,
            other => other,
        }
    }

    /// `safety_status_bits` of RTDE.
    pub const fn safety_bits(&self) -> u32 {
        told(self.safety()).2
    }
}
