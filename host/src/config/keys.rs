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
const S: Unit = Unit { suffix: "_s", words: "seconds", to_si: plain };
const MS: Unit = Unit { suffix: "_ms", words: "milliseconds", to_si: milli };
pub(crate) const NONE: Unit = Unit { suffix: "", words: "no unit", to_si: plain };

/// Ends of keys that name a unit, ours or one that a person might write instead; longer ones first.
pub(crate) const UNIT_SUFFIXES: &[&str] = &[
    "_mm3_s", "_cm3_s", "_m3_s", "_ml_s", "_l_s", "_deg_s3", "_deg_s2", "_deg_s", "_rad_s3", "_rad_s2", "_rad_s",
    "_mm_s3", "_mm_s2", "_mm_s", "_cm_s", "_m_s3", "_m_s2", "_m_s", "_degrees", "_deg", "_rad", "_mm", "_cm", "_um",
    "_ms", "_us", "_ns", "_min", "_m", "_s",
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

/// All of them, for the test that holds docs/cell.md to this list.
#[cfg(test)]
pub(crate) const ALL: &[&Number] = &[
    &START,
    &JOINT_VELOCITY,
    &JOINT_ACCELERATION,
    &JOINT_JERK,
    &FOLLOWING_ERROR,
    &DEVIATION,
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
