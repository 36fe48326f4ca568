//! Files with poses of the flange: touches of a point, and what a tracker saw.

use super::{Entries, FileError, Source, counted, sigma_um};
use crate::calibrate::arm::ArmMeasurement;
use crate::calibrate::pose_fit::TrackerNoise;
use crate::calibrate::target::PosePair;
use nalgebra::{Quaternion, UnitQuaternion};
use screed_kernel::arm::{Arm, JointKind};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use serde::Deserialize;
use toml::Spanned;

/// The largest angle (deg): more turns than any joint makes.
const ANGLE_MAX: f64 = 1e4;
/// The largest position of a slide (mm): a kilometre.
const SLIDE_MAX: f64 = 1e6;
/// By how much a quaternion's length may differ from 1: files have four digits and more.
const QUATERNION_ERROR: f64 = 1e-3;

/// `screed calibrate tcp`: where the flange was while the tool's tip touched one point.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TcpFile {
    /// The robot, where joints are given.
    pub robot: Option<Spanned<String>>,
    sigma_um: Option<Spanned<f64>>,
    touch: Entries<Spanned<TouchEntry>>,
}

/// `screed calibrate target` and `arm`: where the flange was, and where a tracker saw the target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerFile {
    /// The robot, where joints are given.
    pub robot: Option<Spanned<String>>,
    noise: NoiseEntry,
    pose: Entries<Spanned<SightEntry>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct NoiseEntry {
    position_um: Spanned<f64>,
    position_um_per_m: Spanned<f64>,
    rotation_deg: Spanned<f64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TouchEntry {
    joints_deg: Option<Spanned<Vec<f64>>>,
    joints_deg_mm: Option<Spanned<Vec<f64>>>,
    flange: Option<PoseEntry>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SightEntry {
    joints_deg: Option<Spanned<Vec<f64>>>,
    joints_deg_mm: Option<Spanned<Vec<f64>>>,
    flange: Option<PoseEntry>,
    target: PoseEntry,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseEntry {
    xyz_mm: Spanned<[f64; 3]>,
    rpy_deg: Option<Spanned<[f64; 3]>>,
    quaternion_wxyz: Option<Spanned<[f64; 4]>>,
}

impl TcpFile {
    /// base_from_flange of each touch, and the standard deviation of a coordinate where it is given (m). `arm` is the
    /// file's robot.
    ///
    /// # Errors
    /// [`FileError::Value`].
    pub fn checked<const N: usize>(
        &self,
        source: &Source,
        arm: Option<&Arm<N>>,
    ) -> Result<(Vec<Pose>, Option<f64>), FileError> {
        let pose = |entry: &Spanned<TouchEntry>| {
            let TouchEntry { joints_deg, joints_deg_mm, flange } = entry.get_ref();
            Where { entry, joints_deg, joints_deg_mm, flange }.flange(source, arm)
        };
        let poses = counted(source, &self.touch)?.iter().map(pose).collect::<Result<_, _>>()?;
        Ok((poses, sigma_um(source, self.sigma_um.as_ref())?))
    }
}

impl TrackerFile {
    /// Both poses of each measurement. `arm` is the file's robot.
    ///
    /// # Errors
    /// [`FileError::Value`].
    pub fn pairs<const N: usize>(&self, source: &Source, arm: Option<&Arm<N>>) -> Result<Vec<PosePair>, FileError> {
        let pair = |entry: &Spanned<SightEntry>| {
            let base_from_flange = at(entry).flange(source, arm)?;
            Ok(PosePair { base_from_flange, tracker_from_target: entry.get_ref().target.checked(source)? })
        };
        counted(source, &self.pose)?.iter().map(pair).collect()
    }

    /// Joints and target of each measurement.
    ///
    /// # Errors
    /// [`FileError::Value`].
    pub fn measurements<const N: usize>(
        &self,
        source: &Source,
        arm: &Arm<N>,
    ) -> Result<Vec<ArmMeasurement<N>>, FileError> {
        let measurement = |entry: &Spanned<SightEntry>| {
            let joints = at(entry).joints(source, arm)?;
            Ok(ArmMeasurement { joints, tracker_from_target: entry.get_ref().target.checked(source)? })
        };
        counted(source, &self.pose)?.iter().map(measurement).collect()
    }

    /// The tracker's noise.
    ///
    /// # Errors
    /// [`FileError::Value`].
    pub fn noise(&self, source: &Source) -> Result<TrackerNoise, FileError> {
        let NoiseEntry { position_um, position_um_per_m, rotation_deg } = &self.noise;
        let growth = *position_um_per_m.get_ref();
        if !(0.0..=1e5).contains(&growth) {
            let (expected, found) = ("a number from 0 to 100000", growth.to_string());
            return Err(source.refuse(position_um_per_m, "position_um_per_m", expected, found, "give 0 for none"));
        }
        Ok(TrackerNoise {
            position: source.sigma("position_um", position_um, 1e-6, 1e5)?,
            position_per_metre: growth * 1e-6,
            rotation: source.sigma("rotation_deg", rotation_deg, 1.0_f64.to_radians(), 90.0)?,
        })
    }
}

fn at(entry: &Spanned<SightEntry>) -> Where<'_, SightEntry> {
    let SightEntry { joints_deg, joints_deg_mm, flange, target: _ } = entry.get_ref();
    Where { entry, joints_deg, joints_deg_mm, flange }
}

/// How a measurement says where the flange was.
struct Where<'a, T> {
    entry: &'a Spanned<T>,
    joints_deg: &'a Option<Spanned<Vec<f64>>>,
    joints_deg_mm: &'a Option<Spanned<Vec<f64>>>,
    flange: &'a Option<PoseEntry>,
}

impl<T> Where<'_, T> {
    fn flange<const N: usize>(&self, source: &Source, arm: Option<&Arm<N>>) -> Result<Pose, FileError> {
        let has_joints = self.joints_deg.is_some() || self.joints_deg_mm.is_some();
        match (self.flange, arm) {
            (Some(flange), _) if !has_joints => flange.checked(source),
            (None, Some(arm)) if has_joints => Ok(arm.forward(&self.joints(source, arm)?)),
            (None, None) if has_joints => {
                let expected = "robot = \"…\" at the top of the file";
                Err(source.refuse(self.entry, "joints", expected, "none", "name the robot whose joints they are"))
            }
            (flange, _) => {
                let found = if flange.is_some() { "both" } else { "neither" };
                let remedy = "say once where the flange was";
                Err(source.refuse(self.entry, "this measurement", "joints or flange", found, remedy))
            }
        }
    }

    fn joints<const N: usize>(&self, source: &Source, arm: &Arm<N>) -> Result<JointPos<N>, FileError> {
        let slides = arm.joints.iter().any(|joint| joint.kind == JointKind::Prismatic);
        let (value, key, wrong) = match slides {
            true => (self.joints_deg_mm, "joints_deg_mm", self.joints_deg),
            false => (self.joints_deg, "joints_deg", self.joints_deg_mm),
        };
        let Some(value) = value.as_ref().filter(|_| wrong.is_none()) else {
            let expected = format!("{key} of the robot");
            let found = if wrong.is_some() { "the other key" } else { "none" };
            let remedy =
                "joints_deg_mm is for robots with slides: degrees where a joint turns, millimetres where it slides";
            return Err(source.refuse(self.entry, "this measurement", expected, found, remedy));
        };
        let Ok(numbers) = <[f64; N]>::try_from(value.get_ref().as_slice()) else {
            let (expected, found) = (format!("{N} numbers for the robot"), value.get_ref().len().to_string());
            return Err(source.refuse(value, key, expected, found, "give a number for each joint, the base's first"));
        };
        let mut joints = JointPos(numbers);
        for (position, joint) in joints.0.iter_mut().zip(&arm.joints) {
            let most = if joint.kind == JointKind::Prismatic { SLIDE_MAX } else { ANGLE_MAX };
            if !(-most..=most).contains(position) {
                let (expected, found) = (format!("numbers from -{most} to {most}"), position.to_string());
                return Err(source.refuse(value, key, expected, found, "leave the measurement out"));
            }
            *position = if joint.kind == JointKind::Prismatic { *position / 1e3 } else { position.to_radians() };
        }
        Ok(joints)
    }
}

impl PoseEntry {
    fn checked(&self, source: &Source) -> Result<Pose, FileError> {
        let translation = source.point("xyz_mm", &self.xyz_mm)?;
        match (&self.rpy_deg, &self.quaternion_wxyz) {
            (Some(rpy), None) => {
                let [roll, pitch, yaw] = source.numbers("rpy_deg", rpy, ANGLE_MAX)?.map(f64::to_radians);
                Ok(Pose::from_roll_pitch_yaw(translation, roll, pitch, yaw))
            }
            (None, Some(wxyz)) => {
                let [w, x, y, z] = source.numbers("quaternion_wxyz", wxyz, 2.0)?;
                let quaternion = Quaternion::new(w, x, y, z);
                if (quaternion.norm() - 1.0).abs() > QUATERNION_ERROR {
                    let (expected, found) = ("a length of 1", quaternion.norm().to_string());
                    return Err(source.refuse(
                        wxyz,
                        "quaternion_wxyz",
                        expected,
                        found,
                        "give w, x, y, z of a rotation",
                    ));
                }
                let rotation = UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix().into_inner();
                Ok(Pose { rotation, translation })
            }
            (both, _) => {
                let found = if both.is_some() { "both" } else { "neither" };
                let expected = "rpy_deg or quaternion_wxyz";
                Err(source.refuse(&self.xyz_mm, "the rotation of this pose", expected, found, "give one of them"))
            }
        }
    }
}
