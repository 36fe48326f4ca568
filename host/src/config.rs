//! The cell file: robot, tool, part, limits, link and extruder of one cell, in TOML. `docs/cell.md` is its manual.
//!
//! Units stand in the keys (`lift_mm`) and end here: every field below is SI. A file with anything unknown, missing or
//! impossible in it gives no [`Cell`], but all that is wrong with it, each with its place and a remedy.

mod control;
mod error;
pub mod kernel;
pub(crate) mod keys;
pub(crate) mod read;
mod sections;
#[cfg(test)]
mod tests;

pub use error::{ConfigError, Fault, Finding};

use crate::link::rtde::file::RecipeFile;
use crate::robot::calibration::{self, Calibrated};
use read::Document;
use screed_kernel::arm::Arm;
use screed_kernel::control::Settings;
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::drive::{Drive, Learning};
use screed_kernel::estimator::EstimatorConfig;
use screed_kernel::guard::Plane;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};
use std::path::{Path, PathBuf};

/// One cell: what stands where, and what it may do.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// The cell's name, for reports and logs.
    pub name: String,
    /// The robot.
    pub robot: Robot,
    /// What is mounted on its flange.
    pub tool: Tool,
    /// Where the part is built.
    pub part: Part,
    /// What flange and nozzle must not pass, at most one bound each way along each axis.
    pub workspace: Vec<Bound>,
    /// The limits of the tool while it deposits.
    pub limits: Limits,
    /// The limits of the tool between layers, and of the approach.
    pub travel: Travel,
    /// How the robot is reached.
    pub link: Link,
    /// How the lag of its servo is compensated; not at all without it.
    pub lead: Option<Lead>,
    /// What a tracker is for, where there is one; there is a lead then too.
    pub tracked: Option<Tracked>,
    /// The extruder.
    pub extruder: Extruder,
    /// How the real-time process is scheduled.
    pub realtime: Realtime,
}

/// The robot and the limits of its joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// The name in the catalogue: "ur10e".
    pub model: String,
    /// Its geometry and data sheet; of the unit, where there is a calibration. Speeds that no data sheet gives are the cell's.
    pub arm: Arm<6>,
    /// The unit's calibration.
    pub calibration: Option<Calibrated>,
    /// Whether the calibration is to be read from the controller; until [`Cell::calibrate`] the geometry is nominal.
    pub calibration_of_controller: bool,
    /// The serial number of the unit, as its controller tells it.
    pub serial: Option<String>,
    /// Whether a simulated controller answers at the link's address. A robot that is not simulated moves only when a
    /// person says so on the command line.
    pub simulated: bool,
    /// Joints from which a plan without a robot approaches, and where a simulated robot starts (rad).
    pub start: JointPos<6>,
    /// Highest joint speeds (rad/s), none above the data sheet.
    pub joint_velocity_max: JointVel<6>,
    /// Highest joint accelerations (rad/s²); no data sheet gives them.
    pub joint_acceleration_max: JointAcc<6>,
    /// Highest joint jerks (rad/s³); no data sheet gives them.
    pub joint_jerk_max: JointJerk<6>,
    /// Largest difference between commanded and actual joints at equal stamps (rad) before the job stops.
    pub following_error_max: f64,
    /// Largest difference between commanded and estimated joints (rad) before the job stops, where there is an estimator.
    pub deviation_max: f64,
    /// Rate of the path clock (0 to 1) at which a robot that is not simulated prints its first layer.
    pub first_layer_rate: f64,
}

/// What is mounted on the flange.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tool {
    /// The nozzle's tip, z out of the nozzle, in the flange frame.
    pub flange_from_tcp: Pose,
    /// Its mass with what hangs on it (kg), to be the controller's payload.
    pub payload: Option<f64>,
    /// The centre of that mass in the flange frame (m).
    pub payload_cog: Option<[f64; 3]>,
}

/// Where the part is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// The part frame (the FIM wall's placement) in the robot's base frame: the cell file gives both in the site frame.
    pub base_from_part: Pose,
}

/// One bound of the workspace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Its key in the cell file.
    pub key: &'static str,
    /// The plane, in the robot's base frame.
    pub plane: Plane,
}

/// Limits of the tool centre point while it deposits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Highest speed (m/s).
    pub path_velocity_max: f64,
    /// Highest acceleration, tangential and centripetal together (m/s²).
    pub path_acceleration_max: f64,
    /// Highest jerk along the path (m/s³).
    pub path_jerk_max: f64,
}

/// Limits of the tool centre point between layers, and of the approach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Travel {
    /// Height by which the tool is lifted off a layer before it travels (m).
    pub lift: f64,
    /// Time that the tool stands still at a layer's start before it deposits, so that the servo's lag has gone (s).
    pub settle: f64,
    /// Highest speed (m/s).
    pub velocity_max: f64,
    /// Highest acceleration (m/s²).
    pub acceleration_max: f64,
    /// Highest jerk (m/s³).
    pub jerk_max: f64,
    /// Share (0 to 1) of the joint limits that the approach in joint space uses.
    pub approach_joint_share: f64,
}

/// The wire between Screed and the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkKind {
    /// Universal Robots' Real-Time Data Exchange.
    Rtde,
}

/// How the robot is reached, and how its program follows.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// The protocol.
    pub kind: LinkKind,
    /// Host name or IP address, without port.
    pub address: String,
    /// TCP port of RTDE.
    pub port: u16,
    /// Port of the controller's dashboard, where it is not as far from RTDE's as on a robot.
    pub dashboard_port: Option<u16>,
    /// Likewise of its primary interface.
    pub primary_port: Option<u16>,
    /// Setpoints a second: 125 or 500.
    pub rate_hz: u32,
    /// First input register that Screed uses: 0 or 24.
    pub register_offset: u8,
    /// Recipes of a file: its outputs are asked for beside Screed's own.
    pub recipes: Option<RecipeFile>,
    /// Silence of the robot after which the job stops (s).
    pub timeout: f64,
    /// Silence of Screed after which the robot's program stops (s).
    pub watchdog: f64,
    /// servoj's lookahead_time (s), 0.03 to 0.2.
    pub servoj_lookahead: f64,
    /// servoj's gain, 100 to 2000.
    pub servoj_gain: f64,
}

/// How the lag of the robot's servo is compensated: what is sent leads the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lead {
    /// How far and how fast it may lead; with a tracker, all that is added to the path.
    pub limits: CorrectionLimits,
    /// How long it may stay behind while material is laid (s).
    pub patience: f64,
    /// What the servo is taken for at first.
    pub drive: Drive,
    /// How it is identified. Its dead time is left as it is.
    pub learning: Learning,
}

impl Lead {
    /// Least and greatest lag (s) and gain (1/s²) that a servo may be found to have where the cell does not say: as far as `servoj`
    /// goes, a dead time that has not been named, and some more.
    pub const LAG: [f64; 2] = [0.01, 0.4];
    /// See [`Self::LAG`].
    pub const GAIN: [f64; 2] = [40.0, 4000.0];
    /// The usual patience (s).
    pub const PATIENCE: f64 = 1.0;

    /// What is usual, for a servo of this look-ahead (s) and gain (1/s²) with this dead time (s).
    pub fn of(limits: CorrectionLimits, dead_time: f64, [lookahead, gain]: [f64; 2]) -> Self {
        let learning = Learning {
            lag: Self::LAG,
            inverse_gain: [1.0 / Self::GAIN[1], 1.0 / Self::GAIN[0]],
            dead_time,
            filter_time: 0.05,
            velocity_min: 0.002,
            memory: 30.0,
            noise: 2e-5,
            adoption: 0.5,
        };
        Self { limits, patience: Self::PATIENCE, drive: Drive { lag: lookahead, inverse_gain: 1.0 / gain }, learning }
    }
}

/// What the kernel needs to correct by a tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracked {
    /// How tracker, base and joints are estimated.
    pub estimator: EstimatorConfig<6>,
    /// How the path is corrected.
    pub settings: Settings<6>,
}

/// The extruder on its serial line.
#[derive(Clone, Debug, PartialEq)]
pub struct Extruder {
    /// The serial device.
    pub device: PathBuf,
    /// Bits a second.
    pub baud: u32,
    /// Highest volume flow (m³/s).
    pub flow_max: f64,
}

/// How the real-time process is scheduled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Realtime {
    /// SCHED_FIFO priority, 1 to 99.
    pub priority: u8,
    /// The processor it is bound to; `None` leaves the choice to the system.
    pub cpu: Option<usize>,
    /// Whose clock its cycles follow.
    pub pacing: Pacing,
    /// Where the leaky counter of overruns stops the motion.
    pub overruns_max: u32,
}

impl Default for Realtime {
    /// Where the cell file says nothing.
    fn default() -> Self {
        Self { priority: 80, cpu: None, pacing: Pacing::Robot, overruns_max: 10 }
    }
}

/// Whose clock the cycles follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pacing {
    /// The robot's: each of its telegrams is a cycle, and wants an answer.
    Robot,
    /// This machine's, on a grid: for robots without a clock of their own.
    Timer,
}

/// Reads a cell file.
///
/// # Errors
/// [`ConfigError`] when the file cannot be read or anything in it is wrong.
pub fn load(path: &Path) -> Result<Cell, ConfigError> {
    let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read { file: path.to_owned(), source })?;
    parse(&path.to_string_lossy(), &text)
}

/// Reads a cell file for a process that moves the robot: with the unit's calibration from `calibration`, where the cell takes the
/// controller's.
///
/// # Errors
/// As [`load`]; and when one of the two is given without the other, or the calibration is none.
pub fn load_to_move(path: &Path, unit: Option<&Path>) -> Result<Cell, ConfigError> {
    let mut cell = load(path)?;
    match (cell.robot.calibration_of_controller, unit) {
        (true, Some(unit)) => cell.calibrate(calibration::load(unit, &cell.robot.arm)?),
        (false, None) => {}
        (is_wanted, _) => return Err(ConfigError::ControllersCalibration { is_wanted }),
    }
    Ok(cell)
}

/// Reads a cell from the text of a cell file; `name` is the file's name for messages.
///
/// # Errors
/// [`ConfigError::Invalid`] with everything that is wrong.
pub fn parse(name: &str, text: &str) -> Result<Cell, ConfigError> {
    let mut document = Document::new(name, text);
    // Of a text that is no TOML, the rest would be guesses.
    let cell = if document.is_broken() { None } else { sections::cell(&mut document) };
    match cell {
        Some(cell) if !document.is_broken() => Ok(cell),
        _ => Err(ConfigError::Invalid { findings: document.into_findings() }),
    }
}

impl Cell {
    /// Takes the arm of a unit instead of the nominal one.
    pub const fn calibrate(&mut self, unit: Calibrated) {
        let speeds = self.robot.arm.velocity_max;
        self.robot.arm = unit.arm;
        // Where no data sheet gives speeds, the cell does.
        self.robot.arm.velocity_max = speeds;
        self.robot.calibration = Some(unit);
    }

    /// The cell of `screed demo`, `fixtures/cells/demo.toml`, at the given rate (Hz).
    ///
    /// # Errors
    /// As [`Self::demo_text`].
    pub fn demo(rate_hz: u32) -> Result<Self, ConfigError> {
        parse("demo.toml", &Self::demo_text(rate_hz)?)
    }

    /// The text of that cell file.
    ///
    /// # Errors
    /// [`ConfigError::DemoRate`] for a rate other than 125 or 500.
    pub fn demo_text(rate_hz: u32) -> Result<String, ConfigError> {
        if !sections::RATES_HZ.contains(&i64::from(rate_hz)) {
            return Err(ConfigError::DemoRate { found: rate_hz });
        }
        let text = include_str!("../../fixtures/cells/demo.toml");
        Ok(text.replace("\nrate_hz = 125\n", &format!("\nrate_hz = {rate_hz}\n")))
    }
}
