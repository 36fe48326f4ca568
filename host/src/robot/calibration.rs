//! The calibration of one real UR unit: what its controller stores, or what `ur_calibration` made of it.
//!
//! * **DH deltas**: the controller's `calibration.conf`, section `[mounting]`: `delta_theta`, `delta_a`, `delta_d`, `delta_alpha`,
//!   added to the nominal table. Prefer these.
//! * **Kinematics**: the YAML file that `ur_calibration` (Universal_Robots_ROS2_Driver) writes: a transform before each joint. It
//!   writes Euler angles of Rx·Ry·Rz; a URDF reads the same numbers as Rz·Ry·Rx, up to 0.044 mm away. Here they are read as
//!   they were written, which gives back the controller's own chain.
//!
//! A calibration that moves the flange by more than [`DEVIATION_MAX`] is none: real units move it by 0.7 to 4 mm on average
//! and by 8 mm at most, and there are published files that are wrong by 784 mm.

use super::chain::{Chain, Step};
use super::description::Link;
use super::sample::Random;
use super::{Description, RobotError};
use crate::failure::Excerpt;
use nalgebra::{Matrix3, Vector3};
use screed_kernel::arm::{Arm, Dh};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use std::ops::Range;
use std::path::Path;

/// Farthest that a unit's flange may be from the nominal one (m): two and a half times the most that was found on real units.
pub const DEVIATION_MAX: f64 = 0.020;
/// Poses at which the two are compared.
const POSES: usize = 2_000;
/// α of the nominal table as controllers report it, to which their deltas are to be added: not the f64 nearest to π/2.
#[expect(clippy::approx_constant, reason = "the controller's figure, not the constant")]
const RIGHT_ANGLE: f64 = 1.570_796_327;
/// Most by which the table of a kinematics file may differ from its chain (m).
const TABLE_ERROR_MAX: f64 = 1e-9;
/// The joints of a kinematics file.
const JOINTS: [&str; 6] = ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"];
/// The values of each.
const VALUES: [&str; 6] = ["x", "y", "z", "roll", "pitch", "yaw"];

/// The arm of one unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibrated {
    /// The nominal arm with the unit's own table.
    pub arm: Arm<6>,
    /// How far its flange is from the nominal one, over seeded joint vectors: mean (m).
    pub deviation_mean: f64,
    /// Likewise: largest (m).
    pub deviation_max: f64,
}

/// What is wrong with a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationFault {
    /// Neither kind of file, by its ending.
    #[error("{file}: expected a controller's calibration.conf (.conf) or a kinematics file (.yaml)")]
    Kind {
        /// The file.
        file: String,
    },
    /// Not in the form that it should have.
    #[error("{expected} expected, {found} found")]
    Form {
        /// What should stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// A value is missing.
    #[error("{entity} is missing")]
    Missing {
        /// Which.
        entity: String,
    },
    /// The controller says that its calibration is not finished.
    #[error("calibration_status is {found}: expected 2, a linearised calibration")]
    Status {
        /// The status.
        found: i64,
    },
    /// Too far from the nominal arm.
    #[error(
        "this is no calibration of a {model}: it moves the flange by {:.1} mm on average and {:.1} mm at most, and no unit is more \
         than {:.0} mm off its nominal geometry{}",
        mean * 1e3,
        max * 1e3,
        DEVIATION_MAX * 1e3,
        if *backwards { " (its forearm points backwards, as in files that ur_calibration wrote before June 2024)" } else { "" }
    )]
    Deviation {
        /// The nominal arm.
        model: &'static str,
        /// Mean distance of the flanges (m).
        mean: f64,
        /// Largest (m).
        max: f64,
        /// Whether its forearm points the other way.
        backwards: bool,
    },
    /// The chain cannot be written as a table without loss.
    #[error("the DH table would be {error:e} m off the chain, more than {TABLE_ERROR_MAX:e} m")]
    Table {
        /// How far (m).
        error: f64,
    },
}

/// Reads the calibration of a unit of the nominal arm.
///
/// # Errors
/// [`RobotError::Read`], and [`RobotError::Calibration`] when the file is none or moves the flange too far.
pub fn load(path: &Path, nominal: &Arm<6>) -> Result<Calibrated, RobotError> {
    let text = super::read(path)?;
    let name = path.to_string_lossy();
    let at = |span: Range<usize>, fault| RobotError::Calibration {
        place: Excerpt::new(&name, text.as_bytes(), span).into(),
        fault,
    };
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let read = match ending.as_deref() {
        Some("conf") => deltas(&text, nominal),
        Some("yaml" | "yml") => kinematics(&text, nominal),
        _ => Err((0..0, CalibrationFault::Kind { file: name.clone().into_owned() })),
    };
    read.and_then(|arm| compared(arm, nominal).map_err(|fault| (0..0, fault))).map_err(|(span, fault)| at(span, fault))
}

/// The unit whose whole table a controller tells, row by row: θ (rad), a, d (m), α (rad).
///
/// # Errors
/// [`CalibrationFault::Deviation`].
pub fn of_table(table: &ControllerTable, nominal: &Arm<6>) -> Result<Calibrated, CalibrationFault> {
    let mut arm = *nominal;
    for (dh, &[theta, a, d, alpha]) in arm.dh.iter_mut().zip(table) {
        let (sin_alpha, cos_alpha) = alpha.sin_cos();
        *dh = Dh { theta, d, a, sin_alpha, cos_alpha };
    }
    compared(arm, nominal)
}

/// A row a joint, as controllers tell it: θ (rad), a, d (m), α (rad).
pub type ControllerTable = [[f64; 4]; 6];

/// A file as a controller stores it, of the whole table that it tells: what [`load`] reads. A status is written where the
/// calibration is linearised, as one that is not is read as the controller tells it all the same.
pub fn conf(table: &ControllerTable, checksum: &[u32; 6], status: u32, nominal: &Arm<6>) -> String {
    let rows = || table.iter().zip(&nominal.dh);
    let list = |name: &str, deltas: Vec<f64>| {
        let deltas: Vec<_> = deltas.iter().map(|delta| format!("{delta:?}")).collect();
        format!("{name} = [{}]\n", deltas.join(", "))
    };
    let checksum: Vec<_> = checksum.iter().map(|sum| format!("{sum:#010x}")).collect();
    [
        "[mounting]\n".to_owned(),
        list("delta_theta", rows().map(|(row, dh)| row[0] - dh.theta).collect()),
        list("delta_a", rows().map(|(row, dh)| row[1] - dh.a).collect()),
        list("delta_d", rows().map(|(row, dh)| row[2] - dh.d).collect()),
        list("delta_alpha", rows().map(|(row, dh)| row[3] - RIGHT_ANGLE * dh.sin_alpha).collect()),
        format!("joint_checksum = [{}]\n", checksum.join(", ")),
        if status == 2 { "calibration_status = 2\n".to_owned() } else { format!("# calibration_status {status}\n") },
    ]
    .concat()
}

/// The same of a unit that was read already.
pub fn conf_of(unit: &Calibrated, nominal: &Arm<6>) -> String {
    conf(&unit.arm.dh.map(|dh| [dh.theta, dh.a, dh.d, dh.sin_alpha.atan2(dh.cos_alpha)]), &[0; 6], 2, nominal)
}

/// How far the flanges of two arms are apart at most, over seeded joint vectors of the first (m).
pub fn distance(arm: &Arm<6>, other: &Arm<6>) -> f64 {
    let mut random = Random::new(1);
    let apart = |joints| (arm.forward(&joints).translation - other.forward(&joints).translation).norm();
    let apart = (0..POSES).map(|_| apart(JointPos(random.joints(arm))));
    // Not a number counts as far.
    apart.fold(0.0, |max, apart| if apart <= max { max } else { apart })
}

type Located = (Range<usize>, CalibrationFault);

/// Refuses an arm that is too far from the nominal one.
fn compared(arm: Arm<6>, nominal: &Arm<6>) -> Result<Calibrated, CalibrationFault> {
    let mut random = Random::new(1);
    let (mut sum, mut max) = (0.0, 0.0_f64);
    for _ in 0..POSES {
        let joints = JointPos(random.joints(nominal));
        let apart = (arm.forward(&joints).translation - nominal.forward(&joints).translation).norm();
        sum += apart;
        // Not a number counts as far.
        max = if apart <= max { max } else { apart };
    }
    let deviation_mean = sum / POSES as f64;
    if max <= DEVIATION_MAX {
        return Ok(Calibrated { arm, deviation_mean, deviation_max: max });
    }
    // With all joints at zero the arm lies along x; a forearm that points the other way ends two of its lengths away.
    let stretched = |arm: &Arm<6>| arm.forward(&JointPos::ZERO).translation.x;
    let forearm = nominal.dh[2].a;
    let backwards = (stretched(&arm) - stretched(nominal) + 2.0 * forearm).abs() < 0.05 * forearm.abs();
    Err(CalibrationFault::Deviation { model: nominal.name, mean: deviation_mean, max, backwards })
}

/// The nominal arm with a controller's deltas.
fn deltas(text: &str, nominal: &Arm<6>) -> Result<Arm<6>, Located> {
    let form =
        |span, expected: &str, found: String| (span, CalibrationFault::Form { expected: expected.to_owned(), found });
    let root: toml::Table = text.parse().map_err(|error: toml::de::Error| {
        form(error.span().unwrap_or(0..0), "a section [mounting] with lists of six numbers", error.message().to_owned())
    })?;
    let missing = |entity: &str| (0..0, CalibrationFault::Missing { entity: entity.to_owned() });
    let mounting = root.get("mounting").and_then(toml::Value::as_table).ok_or_else(|| missing("section [mounting]"))?;
    let place = |key: &str| text.find(key).map_or(0..0, |start| start..start + key.len());
    let list = |key: &str| -> Result<[f64; 6], Located> {
        let value = mounting.get(key).ok_or_else(|| missing(key))?;
        let number = |value: &toml::Value| value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
        let numbers = value.as_array().and_then(|list| list.iter().map(number).collect::<Option<Vec<_>>>());
        numbers
            .and_then(|numbers| <[f64; 6]>::try_from(numbers).ok())
            .filter(|numbers| numbers.iter().all(|number| number.is_finite()))
            .ok_or_else(|| form(place(key), "six finite numbers", value.to_string()))
    };
    let [theta, a, d, alpha] = ["delta_theta", "delta_a", "delta_d", "delta_alpha"].map(list);
    let (theta, a, d, alpha) = (theta?, a?, d?, alpha?);
    match mounting.get("calibration_status") {
        None => {}
        Some(status) => match status.as_integer() {
            Some(2) => {}
            Some(found) => return Err((place("calibration_status"), CalibrationFault::Status { found })),
            None => return Err(form(place("calibration_status"), "a whole number", status.to_string())),
        },
    }
    let mut arm = *nominal;
    for (joint, dh) in arm.dh.iter_mut().enumerate() {
        let (sin_alpha, cos_alpha) = (RIGHT_ANGLE * dh.sin_alpha + alpha[joint]).sin_cos();
        *dh = Dh { theta: dh.theta + theta[joint], d: dh.d + d[joint], a: dh.a + a[joint], sin_alpha, cos_alpha };
    }
    Ok(arm)
}

/// The chain of a kinematics file as a table.
fn kinematics(text: &str, nominal: &Arm<6>) -> Result<Arm<6>, Located> {
    let values = yaml(text)?;
    let nominal_links = Description::of(nominal, "").links;
    let steps = values.iter().zip(nominal_links);
    let steps = steps.map(|(&[x, y, z, roll, pitch, yaw], link): (_, Link)| Step {
        previous_from_joint: Pose { rotation: as_written(roll, pitch, yaw), translation: Vector3::new(x, y, z) },
        axis: Vector3::z_axis(),
        link,
    });
    let chain = Chain { steps: steps.collect(), last_from_flange: Pose::identity() };
    let table = chain.table(nominal.name, "");
    let arm = table.arm::<6>(nominal.name).ok_or((0..0, CalibrationFault::Table { error: f64::NAN }))?;
    match super::table_error(&table, &chain) {
        error if error <= TABLE_ERROR_MAX => Ok(arm),
        error => Err((0..0, CalibrationFault::Table { error })),
    }
}

/// Rx(roll)·Ry(pitch)·Rz(yaw): `ur_calibration` writes Eigen's `eulerAngles(0, 1, 2)`.
fn as_written(roll: f64, pitch: f64, yaw: f64) -> Matrix3<f64> {
    let turned = |roll, pitch, yaw| Pose::from_roll_pitch_yaw(Vector3::zeros(), roll, pitch, yaw).rotation;
    turned(roll, 0.0, 0.0) * turned(0.0, pitch, 0.0) * turned(0.0, 0.0, yaw)
}

/// The six values of each joint below `kinematics:`. This reads what `ur_calibration` writes, block mappings of numbers, and
/// refuses the rest of YAML.
fn yaml(text: &str) -> Result<[[f64; 6]; 6], Located> {
    let form = |span, expected: &str, found: &str| {
        (span, CalibrationFault::Form { expected: expected.to_owned(), found: format!("{found:?}") })
    };
    let mut values = [[None; 6]; 6];
    let (mut inside, mut joint, mut start) = (false, None, 0);
    for line in text.split_inclusive('\n') {
        let span = start..start + line.trim_end().len();
        start += line.len();
        let code = line.split('#').next().unwrap_or_default().trim_end();
        if code.trim().is_empty() || code == "---" {
            continue;
        }
        let Some((key, value)) = code.split_once(':') else {
            return Err(form(span, "a line `name: value`", code.trim()));
        };
        let (indent, key, value) = (key.len() - key.trim_start().len(), key.trim(), value.trim());
        match (indent, value) {
            (0, "") => inside = key == "kinematics",
            (0, _) => inside = false,
            _ if !inside => {}
            (_, "") => {
                joint = JOINTS.iter().position(|name| *name == key);
                if joint.is_none() {
                    return Err(form(span, &format!("one of {}", JOINTS.join(", ")), key));
                }
            }
            (_, _) if key == "hash" => joint = None,
            (_, number) => {
                let slot = joint.and_then(|joint| {
                    let value = VALUES.iter().position(|name| *name == key)?;
                    values.get_mut(joint)?.get_mut(value)
                });
                let Some(slot) = slot else { return Err(form(span, &format!("one of {}", VALUES.join(", ")), key)) };
                let number = number.parse().ok().filter(|number: &f64| number.is_finite());
                let Some(number) = number else { return Err(form(span, "a finite number", value)) };
                if slot.replace(number).is_some() {
                    return Err(form(span, "each value once", key));
                }
            }
        }
    }
    let mut complete = [[0.0; 6]; 6];
    for ((row, found), joint) in complete.iter_mut().zip(&values).zip(JOINTS) {
        for ((value, found), name) in row.iter_mut().zip(found).zip(VALUES) {
            let missing = || (0..0, CalibrationFault::Missing { entity: format!("kinematics: {joint}: {name}") });
            *value = found.ok_or_else(missing)?;
        }
    }
    Ok(complete)
}

#[cfg(test)]
mod tests;
