//! What Screed and the robot tell each other in every cycle: two recipes, and the checks on what comes back.

use super::error::LinkError;
use super::wire::{FieldType, PackageKind, PackageWriter, PayloadReader};
use screed_kernel::arm::Arm;
use screed_kernel::units::{JointPos, JointVel};
use std::f64::consts::TAU;

/// A field's name and its type by the RTDE guide.
pub type Field = (&'static str, FieldType);

const OUTPUT_COUNT: usize = 10;
const INPUT_COUNT: usize = 7;

/// The outputs, in the order in which they are asked for.
pub const fn outputs(register_offset: u8) -> [Field; OUTPUT_COUNT] {
    [
        ("timestamp", FieldType::Double),
        ("actual_q", FieldType::Vector6d),
        ("actual_qd", FieldType::Vector6d),
        ("target_q", FieldType::Vector6d),
        ("actual_TCP_pose", FieldType::Vector6d),
        ("runtime_state", FieldType::Uint32),
        ("robot_mode", FieldType::Int32),
        (if register_offset == 0 { "output_int_register_0" } else { "output_int_register_24" }, FieldType::Int32),
        (if register_offset == 0 { "input_int_register_0" } else { "input_int_register_24" }, FieldType::Int32),
        // Last: what a package that lost its end shows here, the next one's header, is no joint and mostly no set of bits.
        ("safety_status_bits", FieldType::Uint32),
    ]
}

/// The inputs, in the order in which they are written: the joint setpoint (rad) and its sequence number.
pub const fn inputs(register_offset: u8) -> [Field; INPUT_COUNT] {
    const LOWER: [&str; INPUT_COUNT] = [
        "input_double_register_0",
        "input_double_register_1",
        "input_double_register_2",
        "input_double_register_3",
        "input_double_register_4",
        "input_double_register_5",
        "input_int_register_0",
    ];
    const UPPER: [&str; INPUT_COUNT] = [
        "input_double_register_24",
        "input_double_register_25",
        "input_double_register_26",
        "input_double_register_27",
        "input_double_register_28",
        "input_double_register_29",
        "input_int_register_24",
    ];
    let [a, b, c, d, e, f, sequence] = if register_offset == 0 { LOWER } else { UPPER };
    let double = FieldType::Double;
    [(a, double), (b, double), (c, double), (d, double), (e, double), (f, double), (sequence, FieldType::Int32)]
}

/// Bytes of a package of outputs: header, recipe id, values.
pub const OUTPUT_PACKAGE_SIZE: u16 = 3 + 1 + 8 + 4 * 48 + 5 * 4;
/// Bytes of a package of inputs: header, recipe id, values.
pub const INPUT_PACKAGE_SIZE: usize = 3 + 1 + 6 * 8 + 4;

/// What the robot says of itself in one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobotState {
    /// Time since the controller was started (s).
    pub timestamp: f64,
    /// Where the joints are, by their encoders (rad).
    pub actual_q: JointPos<6>,
    /// How fast they turn (rad/s).
    pub actual_qd: JointVel<6>,
    /// Where the controller wants them in this cycle (rad).
    pub target_q: JointPos<6>,
    /// base_from_tcp as the controller computes it: x, y, z (m) and rotation vector (rad).
    pub actual_tcp_pose: [f64; 6],
    /// 0 stopping, 1 stopped, 2 playing, 3 pausing, 4 paused, 5 resuming.
    pub runtime_state: u32,
    /// −1 no controller, 0 disconnected, 1 confirm safety, 2 booting, 3 power off, 4 power on, 5 idle, 6 backdrive, 7 running,
    /// 8 updating firmware.
    pub robot_mode: i32,
    /// Bits: 0 normal, 1 reduced, 2 protective stop, 3 recovery, 4 safeguard stop, 5 system emergency stop, 6 robot emergency
    /// stop, 7 emergency stop, 8 violation, 9 fault, 10 stopped due to safety, 11 three-position enabling stop.
    pub safety_status_bits: u32,
    /// What the robot program says in its output register, see [`super::program::ProgramState`].
    pub program_state: i32,
    /// Sequence number of the setpoint that had arrived when this state was made.
    pub arrived: i32,
}

impl RobotState {
    /// Decodes the values behind the recipe id; None when their length is wrong.
    pub(super) fn decode(values: &[u8]) -> Option<Self> {
        let mut reader = PayloadReader::new(values);
        let state = Self {
            timestamp: reader.f64()?,
            actual_q: JointPos(reader.f64s()?),
            actual_qd: JointVel(reader.f64s()?),
            target_q: JointPos(reader.f64s()?),
            actual_tcp_pose: reader.f64s()?,
            runtime_state: reader.u32()?,
            robot_mode: reader.i32()?,
            program_state: reader.i32()?,
            arrived: reader.i32()?,
            safety_status_bits: reader.u32()?,
        };
        reader.rest().is_empty().then_some(state)
    }
}

/// Encodes one setpoint; None when `out` is too small.
pub(super) fn encode_setpoint(out: &mut [u8], recipe: u8, seq: u32, joints: &JointPos<6>) -> Option<usize> {
    let mut writer = PackageWriter::new(out, PackageKind::Data);
    writer.u8(recipe).f64s(&joints.0).bytes(&seq.to_be_bytes());
    writer.finish()
}

/// A rotation vector is at most half a turn long; some clients write it longer.
const TURN_MAX: f64 = TAU * 1.01;
/// Encoders may read a little beyond the arm's range.
const RANGE_MARGIN: f64 = 1.01;
/// Of a joint that turns without end: what setpoints can hold (rad).
const ENDLESS_MAX: f64 = 1024.0;
/// A joint may measure faster than its limit for a moment, by noise and overshoot.
const SPEED_MARGIN: f64 = 1.5;
/// What encoder noise may add to a step (rad).
const STEP_NOISE: f64 = 1e-3;
/// No UR arm and tool reach farther from the base (m).
const REACH_MAX: f64 = 5.0;
/// A controller closes a connection that lags about ten seconds behind; so no honest gap is longer (s).
const GAP_MAX: f64 = 10.0;
/// A controller is restarted before it runs this long: 30 years (s).
const UPTIME_MAX: f64 = 1e9;
/// Of an arm whose data sheet gives no speeds no speed is impossible.
const UNRATED: JointVel<6> = JointVel([f64::MAX; 6]);

/// Whether states are possible, alone and after the one before.
///
/// RTDE has no checksum: a wrong value that is possible cannot be recognised, here or anywhere.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plausibility {
    position_max: [f64; 6],
    velocity_max: JointVel<6>,
    last: Option<(f64, JointPos<6>)>,
}

impl Plausibility {
    pub(super) fn new(arm: &Arm<6>) -> Self {
        let mut position_max = [0.0; 6];
        let range = arm.position_min.0.iter().zip(&arm.position_max.0);
        for (limit, (low, high)) in position_max.iter_mut().zip(range) {
            *limit = low.abs().max(high.abs()).min(ENDLESS_MAX) * RANGE_MARGIN;
        }
        Self { position_max, velocity_max: arm.velocity_max.known().unwrap_or(UNRATED), last: None }
    }

    /// Time stamp (s) and joints of the last state.
    pub(super) const fn last(&self) -> Option<(f64, JointPos<6>)> {
        self.last
    }

    /// Checks a state and keeps it for the next check.
    pub(super) fn check(&mut self, state: &RobotState) -> Result<(), LinkError> {
        scalar("timestamp", state.timestamp, 0.0, UPTIME_MAX)?;
        elements("actual_q", &state.actual_q.0, &self.position_max)?;
        elements(
            "actual_qd",
            &state.actual_qd.0,
            &self.velocity_max.0.map(|limit| (limit * SPEED_MARGIN).min(f64::MAX)),
        )?;
        elements("target_q", &state.target_q.0, &self.position_max)?;
        let (reach, turn) = (REACH_MAX, TURN_MAX);
        elements("actual_TCP_pose", &state.actual_tcp_pose, &[reach, reach, reach, turn, turn, turn])?;
        scalar("runtime_state", f64::from(state.runtime_state), 0.0, 5.0)?;
        scalar("robot_mode", f64::from(state.robot_mode), -1.0, 8.0)?;
        scalar("safety_status_bits", f64::from(state.safety_status_bits), 0.0, 4095.0)?;
        if let Some((timestamp, actual_q)) = self.last {
            let dt = state.timestamp - timestamp;
            if dt <= 0.0 || dt > GAP_MAX {
                return Err(impossible("timestamp step", 0, dt, GAP_MAX));
            }
            let mut step = state.actual_q.0;
            let mut step_max = self.velocity_max.0;
            for (now, before) in step.iter_mut().zip(&actual_q.0) {
                *now -= before;
            }
            for limit in &mut step_max {
                *limit = (*limit * dt * SPEED_MARGIN + STEP_NOISE).min(f64::MAX);
            }
            elements("actual_q step", &step, &step_max)?;
        }
        self.last = Some((state.timestamp, state.actual_q));
        Ok(())
    }
}

fn scalar(field: &'static str, value: f64, min: f64, max: f64) -> Result<(), LinkError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(impossible(field, 0, value, if value < min { min } else { max }))
}

/// NaN is inside no range, so it fails here too.
fn elements(field: &'static str, values: &[f64; 6], limits: &[f64; 6]) -> Result<(), LinkError> {
    for ((element, value), limit) in (0..).zip(values).zip(limits) {
        if !(-limit..=*limit).contains(value) {
            return Err(impossible(field, element, *value, *limit));
        }
    }
    Ok(())
}

const fn impossible(field: &'static str, element: u8, value: f64, limit: f64) -> LinkError {
    LinkError::ImpossibleValue { field, element, value, limit }
}
