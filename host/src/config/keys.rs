//! Every number a cell file can hold: its key with the unit as suffix, and the range that makes sense. The ranges are
//! wide: they catch slips (a metre for a millimetre), not bad engineering.

use std::f64::consts::PI;

/// A unit of the cell file, and what it is in SI.
#[derive(Debug)]
pub(crate) struct Unit {
    /// The end of every key with this unit.
    pub suffix: &'static str,
    /// In words, for messages.
    pub words: &'static str,
    to_si: fn(f64) -> f64,
}

impl Unit {
    /// The value in SI.
    pub fn si(&self, value: f64) -> f64 {
        (self.to_si)(value)
    }
}

/// Divides rather than multiplies by 0.001, so that 15 mm is the f64 nearest to 0.015 m.
fn milli(value: f64) -> f64 {
    value / 1e3
}

fn cubic_milli(value: f64) -> f64 {
    value / 1e9
}

/// The same product as in the catalogue of arms, so that a data sheet's speed compares equal.
fn degrees(value: f64) -> f64 {
    value * (PI / 180.0)
}

fn turns(value: f64) -> f64 {
    value * (2.0 * PI)
}

fn square_degrees(value: f64) -> f64 {
    degrees(degrees(value))
}

fn plain(value: f64) -> f64 {
    value
}

pub(crate) const MM: Unit = Unit { suffix: "_mm", words: "millimetres", to_si: milli };
pub(crate) const MM_S: Unit = Unit { suffix: "_mm_s", words: "millimetres per second", to_si: milli };
pub(crate) const MM_S2: Unit = Unit { suffix: "_mm_s2", words: "millimetres per second squared", to_si: milli };
const MM_S3: Unit = Unit { suffix: "_mm_s3", words: "millimetres per second cubed", to_si: milli };
const MM3_S: Unit = Unit { suffix: "_mm3_s", words: "cubic millimetres per second", to_si: cubic_milli };
pub(crate) const DEG: Unit = Unit { suffix: "_deg", words: "degrees", to_si: degrees };
pub(crate) const DEG_S: Unit = Unit { suffix: "_deg_s", words: "degrees per second", to_si: degrees };
pub(crate) const DEG_S2: Unit = Unit { suffix: "_deg_s2", words: "degrees per second squared", to_si: degrees };
const DEG_S3: Unit = Unit { suffix: "_deg_s3", words: "degrees per second cubed", to_si: degrees };
const DEG2_S5: Unit =
    Unit { suffix: "_deg2_s5", words: "square degrees per second to the fifth", to_si: square_degrees };
const PER_S: Unit = Unit { suffix: "_per_s", words: "per second", to_si: plain };
const S: Unit = Unit { suffix: "_s", words: "seconds", to_si: plain };
const MS: Unit = Unit { suffix: "_ms", words: "milliseconds", to_si: milli };
const KG: Unit = Unit { suffix: "_kg", words: "kilograms", to_si: plain };
const HZ: Unit = Unit { suffix: "_hz", words: "hertz", to_si: turns };
pub(crate) const NONE: Unit = Unit { suffix: "", words: "no unit", to_si: plain };

/// Ends of keys that name a unit, ours or one that a person might write instead; longer ones first.
pub(crate) const UNIT_SUFFIXES: &[&str] = &[
    "_deg2_s5", "_rad2_s5", "_per_s", "_mm3_s", "_cm3_s", "_m3_s", "_ml_s", "_l_s", "_deg_s3", "_deg_s2", "_deg_s",
    "_rad_s3", "_rad_s2", "_rad_s", "_mm_s3", "_mm_s2", "_mm_s", "_cm_s", "_m_s3", "_m_s2", "_m_s", "_degrees", "_deg",
    "_rad", "_mm", "_cm", "_um", "_ms", "_us", "_ns", "_min", "_hz", "_kg", "_g", "_m", "_s",
];

/// A key that takes numbers, each within `low..=high` in the key's own unit.
#[derive(Debug)]
pub(crate) struct Number {
    pub name: &'static str,
    pub unit: Unit,
    pub low: f64,
    pub high: f64,
}

/// A key of that name.
pub(crate) const fn number(name: &'static str, unit: Unit, low: f64, high: f64) -> Number {
    Number { name, unit, low, high }
}

pub(crate) const START: Number = number("start_deg", DEG, -360.0, 360.0);
pub(crate) const JOINT_VELOCITY: Number = number("joint_velocity_max_deg_s", DEG_S, 0.1, 1000.0);
pub(crate) const JOINT_ACCELERATION: Number = number("joint_acceleration_max_deg_s2", DEG_S2, 1.0, 10_000.0);
pub(crate) const JOINT_JERK: Number = number("joint_jerk_max_deg_s3", DEG_S3, 1.0, 1_000_000.0);
pub(crate) const FOLLOWING_ERROR: Number = number("following_error_max_deg", DEG, 0.01, 30.0);
pub(crate) const DEVIATION: Number = number("deviation_max_deg", DEG, 0.01, 30.0);
pub(crate) const FIRST_LAYER_RATE: Number = number("first_layer_rate", NONE, 0.05, 1.0);
pub(crate) const PAYLOAD: Number = number("payload_kg", KG, 0.0, 100.0);
pub(crate) const PAYLOAD_COG: Number = number("payload_cog_mm", MM, -2000.0, 2000.0);
pub(crate) const XYZ: Number = number("xyz_mm", MM, -100_000.0, 100_000.0);
pub(crate) const BOUNDS: [Number; 6] = [
    number("x_min_mm", MM, -100_000.0, 100_000.0),
    number("x_max_mm", MM, -100_000.0, 100_000.0),
    number("y_min_mm", MM, -100_000.0, 100_000.0),
    number("y_max_mm", MM, -100_000.0, 100_000.0),
    number("z_min_mm", MM, -100_000.0, 100_000.0),
    number("z_max_mm", MM, -100_000.0, 100_000.0),
];
pub(crate) const RPY: Number = number("rpy_deg", DEG, -360.0, 360.0);
pub(crate) const VELOCITY: Number = number("velocity_max_mm_s", MM_S, 0.1, 10_000.0);
pub(crate) const ACCELERATION: Number = number("acceleration_max_mm_s2", MM_S2, 1.0, 100_000.0);
pub(crate) const JERK: Number = number("jerk_max_mm_s3", MM_S3, 1.0, 10_000_000.0);
pub(crate) const LIFT: Number = number("lift_mm", MM, 1.0, 1000.0);
pub(crate) const SETTLE: Number = number("settle_ms", MS, 0.0, 60_000.0);
pub(crate) const JOINT_SHARE: Number = number("approach_joint_share", NONE, 0.01, 1.0);
pub(crate) const TIMEOUT: Number = number("timeout_ms", MS, 4.0, 10_000.0);
pub(crate) const WATCHDOG: Number = number("watchdog_ms", MS, 4.0, 10_000.0);
pub(crate) const LOOKAHEAD: Number = number("servoj_lookahead_s", S, 0.03, 0.2);
pub(crate) const GAIN: Number = number("servoj_gain", NONE, 100.0, 2000.0);
pub(crate) const FLOW: Number = number("flow_max_mm3_s", MM3_S, 1.0, 4_000_000.0);
pub(crate) const LEAD_SIZE: Number = number("size_max_deg", DEG, 0.1, 30.0);
pub(crate) const LEAD_VELOCITY: Number = number("velocity_max_deg_s", DEG_S, 0.1, 1000.0);
pub(crate) const LEAD_ACCELERATION: Number = number("acceleration_max_deg_s2", DEG_S2, 1.0, 10_000.0);
pub(crate) const DEAD_TIME: Number = number("dead_time_ms", MS, 0.0, 100.0);
pub(crate) const PATIENCE: Number = number("patience_s", S, 0.01, 600.0);
pub(crate) const LAG: Number = number("lag_ms", MS, 0.0, 500.0);
pub(crate) const LAG_MIN: Number = number("lag_min_ms", MS, 0.0, 500.0);
pub(crate) const LAG_MAX: Number = number("lag_max_ms", MS, 0.0, 500.0);
pub(crate) const DRIVE_GAIN: Number = number("gain", NONE, 1.0, 100_000.0);
pub(crate) const DRIVE_GAIN_MIN: Number = number("gain_low", NONE, 1.0, 100_000.0);
pub(crate) const DRIVE_GAIN_MAX: Number = number("gain_high", NONE, 1.0, 100_000.0);
pub(crate) const FILTER_TIME: Number = number("filter_time_ms", MS, 0.1, 10_000.0);
pub(crate) const LEARN_ABOVE: Number = number("learn_above_deg_s", DEG_S, 0.001, 100.0);
pub(crate) const LEARN_MEMORY: Number = number("memory_s", S, 0.1, 3600.0);
pub(crate) const LEARN_NOISE: Number = number("noise_deg", DEG, 0.000001, 1.0);
pub(crate) const LEARN_ADOPTION: Number = number("adoption_s", S, 0.001, 60.0);
pub(crate) const TARGET_XYZ: Number = number("target_xyz_mm", MM, -100_000.0, 100_000.0);
pub(crate) const TARGET_RPY: Number = number("target_rpy_deg", DEG, -360.0, 360.0);
pub(crate) const HOLD: Number = number("hold_ms", MS, 10.0, 60_000.0);
pub(crate) const PIVOT: Number = number("pivot_xyz_mm", MM, -100_000.0, 100_000.0);
pub(crate) const DRIFT_SPEED: Number = number("drift_mm_s", MM_S, 0.0001, 1000.0);
pub(crate) const DRIFT_TURN: Number = number("drift_deg_s", DEG_S, 0.00001, 10.0);
pub(crate) const DRIFT_TIME: Number = number("drift_time_s", S, 0.01, 3600.0);
pub(crate) const CENTRE: Number = number("centre_xyz_mm", MM, -100_000.0, 100_000.0);
pub(crate) const FREQUENCY: Number = number("frequency_hz", HZ, 0.05, 20.0);
pub(crate) const DAMPING: Number = number("damping", NONE, 0.001, 0.9);
pub(crate) const SWING_SHIFT: Number = number("shift_deviation_mm", MM, 0.0, 100.0);
pub(crate) const SWING_TURN: Number = number("turn_deviation_deg", DEG, 0.0, 5.0);
pub(crate) const TRANSLATION: Number = number("translation_max_mm", MM, 0.01, 1000.0);
pub(crate) const ROTATION: Number = number("rotation_max_deg", DEG, 0.001, 11.4);
pub(crate) const TURN_RATE: Number = number("turn_rate_max_deg_s", DEG_S, 0.001, 100.0);
pub(crate) const TURN_ACCELERATION: Number = number("turn_acceleration_max_deg_s2", DEG_S2, 0.001, 10_000.0);
pub(crate) const JERK_DENSITY: Number = number("jerk_density_deg2_s5", DEG2_S5, 0.000001, 1_000_000_000.0);
pub(crate) const ENCODER_DEVIATION: Number = number("encoder_deviation_deg", DEG, 0.000001, 10.0);
pub(crate) const JOINT_DEVIATION: Number = number("joint_deviation_deg", DEG, 0.000001, 10.0);
pub(crate) const RATE_DEVIATION: Number = number("rate_deviation_deg_s", DEG_S, 0.000001, 100.0);
pub(crate) const START_POSITION: Number = number("start_position_deviation_deg", DEG, 0.000001, 180.0);
pub(crate) const START_VELOCITY: Number = number("start_velocity_deviation_deg_s", DEG_S, 0.000001, 1000.0);
pub(crate) const START_ACCELERATION: Number =
    number("start_acceleration_deviation_deg_s2", DEG_S2, 0.000001, 100_000.0);
pub(crate) const PROPORTIONAL: Number = number("proportional", NONE, 0.0, 100.0);
pub(crate) const INTEGRAL: Number = number("integral_per_s", PER_S, 0.0, 1000.0);
pub(crate) const DERIVATIVE: Number = number("derivative_s", S, -10.0, 10.0);
pub(crate) const TRACKING_TIME: Number = number("tracking_time_ms", MS, 0.1, 100_000.0);
pub(crate) const SHIFT: Number = number("shift_max_mm", MM, 0.01, 1000.0);
pub(crate) const SHIFT_SPEED: Number = number("shift_speed_max_mm_s", MM_S, 0.01, 10_000.0);
pub(crate) const SHIFT_ACCELERATION: Number = number("shift_acceleration_max_mm_s2", MM_S2, 0.01, 100_000.0);
pub(crate) const TURN: Number = number("turn_max_deg", DEG, 0.001, 45.0);
pub(crate) const TURN_SPEED: Number = number("turn_speed_max_deg_s", DEG_S, 0.001, 1000.0);

/// All of them, for the test that holds docs/cell.md to this list.
#[cfg(test)]
pub(crate) const ALL: &[&Number] = &[
    &START,
    &JOINT_VELOCITY,
    &JOINT_ACCELERATION,
    &JOINT_JERK,
    &FOLLOWING_ERROR,
    &DEVIATION,
    &FIRST_LAYER_RATE,
    &PAYLOAD,
    &PAYLOAD_COG,
    &XYZ,
    &BOUNDS[0],
    &BOUNDS[1],
    &BOUNDS[2],
    &BOUNDS[3],
    &BOUNDS[4],
    &BOUNDS[5],
    &RPY,
    &VELOCITY,
    &ACCELERATION,
    &JERK,
    &LIFT,
    &SETTLE,
    &JOINT_SHARE,
    &TIMEOUT,
    &WATCHDOG,
    &LOOKAHEAD,
    &GAIN,
    &FLOW,
    &LEAD_SIZE,
    &LEAD_VELOCITY,
    &LEAD_ACCELERATION,
    &DEAD_TIME,
    &PATIENCE,
    &LAG,
    &LAG_MIN,
    &LAG_MAX,
    &DRIVE_GAIN,
    &DRIVE_GAIN_MIN,
    &DRIVE_GAIN_MAX,
    &FILTER_TIME,
    &LEARN_ABOVE,
    &LEARN_MEMORY,
    &LEARN_NOISE,
    &LEARN_ADOPTION,
    &TARGET_XYZ,
    &TARGET_RPY,
    &HOLD,
    &PIVOT,
    &DRIFT_SPEED,
    &DRIFT_TURN,
    &DRIFT_TIME,
    &CENTRE,
    &FREQUENCY,
    &DAMPING,
    &SWING_SHIFT,
    &SWING_TURN,
    &TRANSLATION,
    &ROTATION,
    &TURN_RATE,
    &TURN_ACCELERATION,
    &JERK_DENSITY,
    &ENCODER_DEVIATION,
    &JOINT_DEVIATION,
    &RATE_DEVIATION,
    &START_POSITION,
    &START_VELOCITY,
    &START_ACCELERATION,
    &PROPORTIONAL,
    &INTEGRAL,
    &DERIVATIVE,
    &TRACKING_TIME,
    &SHIFT,
    &SHIFT_SPEED,
    &SHIFT_ACCELERATION,
    &TURN,
    &TURN_SPEED,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_ends_with_its_unit() {
        for key in ALL {
            assert!(key.name.ends_with(key.unit.suffix), "{}", key.name);
            let longest = UNIT_SUFFIXES.iter().find(|suffix| key.name.ends_with(**suffix));
            assert_eq!(longest.copied().unwrap_or_default(), key.unit.suffix, "{}", key.name);
        }
    }

    #[test]
    fn units_convert_to_the_nearest_f64() {
        assert_eq!(MM.si(15.0), 0.015);
        assert_eq!(MM_S3.si(10_000.0), 10.0);
        assert_eq!(MM3_S.si(21_600.0), 2.16e-5);
        assert_eq!(MS.si(500.0), 0.5);
        assert_eq!(Some(DEG_S.si(120.0)), screed_kernel::arms::ur::UR10E.velocity_max.known().map(|rated| rated.0[0]));
    }
}
