//! An arm whose number of joints is known at run time only.

use nalgebra::{Matrix3, Vector3};
use screed_kernel::arm::{Arm, Dh, Joint, JointKind, Rating};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointPos, JointVel};

/// Fewest and most joints that the kernel takes.
pub const JOINTS: std::ops::RangeInclusive<usize> = 3..=9;

/// An arm by its DH table, with names.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// The arm's name.
    pub name: String,
    /// Where its figures come from.
    pub origin: String,
    /// Frame 0 of the table in the base frame; `None` where they are one.
    pub base_from_zero: Option<Pose>,
    /// From the base outwards.
    pub links: Vec<Link>,
    /// The flange in the table's last frame; `None` where they are one.
    pub last_from_flange: Option<Pose>,
    /// What a reader should know: what was left out, joined or not found.
    pub notes: Vec<String>,
}

/// A link and the joint that moves it.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// The joint's name.
    pub name: String,
    /// The table's row.
    pub dh: Dh,
    /// What moves it.
    pub joint: Joint,
    /// Lowest position (rad, m); minus infinity without end.
    pub position_min: f64,
    /// Highest position (rad, m); infinity without end.
    pub position_max: f64,
    /// Highest speed (rad/s, m/s); `None` where no source gives it.
    pub velocity_max: Option<f64>,
    /// Highest acceleration (rad/s², m/s²); `None` where no source gives it.
    pub acceleration_max: Option<f64>,
}

impl Link {
    /// Whether its joint turns.
    pub fn is_revolute(&self) -> bool {
        self.joint.kind == JointKind::Revolute
    }
}

impl Description {
    /// An arm of the catalogue; joints are called J1, J2 and so on.
    pub fn of<const N: usize>(arm: &Arm<N>, origin: &str) -> Self {
        let at = |values: Option<[f64; N]>, joint: usize| values.and_then(|values| values.get(joint).copied());
        let (speeds, accelerations) = (arm.velocity_max.known(), arm.acceleration_max.known());
        let link = |(index, (dh, joint)): (usize, (&Dh, &Joint))| Link {
            name: format!("J{}", index + 1),
            dh: *dh,
            joint: *joint,
            position_min: arm.position_min.0[index],
            position_max: arm.position_max.0[index],
            velocity_max: at(speeds.map(|values| values.0), index),
            acceleration_max: at(accelerations.map(|values| values.0), index),
        };
        Self {
            name: arm.name.to_owned(),
            origin: origin.to_owned(),
            base_from_zero: arm.base_from_zero,
            links: arm.dh.iter().zip(&arm.joints).enumerate().map(link).collect(),
            last_from_flange: arm.last_from_flange,
            notes: Vec::new(),
        }
    }

    /// The flange in the base frame; not a number when there are not as many positions (rad, m) as joints, or not 3 to 9.
    pub fn forward(&self, joints: &[f64]) -> Pose {
        fn of<const N: usize>(description: &Description, joints: &[f64]) -> Option<Pose> {
            Some(description.arm::<N>("")?.forward(&JointPos(joints.try_into().ok()?)))
        }
        let pose = match self.links.len() {
            3 => of::<3>(self, joints),
            4 => of::<4>(self, joints),
            5 => of::<5>(self, joints),
            6 => of::<6>(self, joints),
            7 => of::<7>(self, joints),
            8 => of::<8>(self, joints),
            9 => of::<9>(self, joints),
            _ => None,
        };
        pose.unwrap_or(Pose { rotation: Matrix3::from_element(f64::NAN), translation: Vector3::from_element(f64::NAN) })
    }

    /// The arm with N joints, when it has as many; `name` is what the kernel calls it. A rating is known when it is of every
    /// joint.
    pub fn arm<const N: usize>(&self, name: &'static str) -> Option<Arm<N>> {
        fn list<const N: usize, T>(links: &[Link], value: impl Fn(&Link) -> Option<T>) -> Option<[T; N]> {
            links.iter().map(value).collect::<Option<Vec<_>>>()?.try_into().ok()
        }
        let links = &self.links;
        let velocity_max =
            list(links, |link| link.velocity_max).map_or(Rating::Unknown, |v| Rating::Known(JointVel(v)));
        let acceleration_max =
            list(links, |link| link.acceleration_max).map_or(Rating::Unknown, |a| Rating::Known(JointAcc(a)));
        Some(Arm {
            name,
            base_from_zero: self.base_from_zero,
            dh: list(links, |link| Some(link.dh))?,
            joints: list(links, |link| Some(link.joint))?,
            last_from_flange: self.last_from_flange,
            position_min: JointPos(list(links, |link| Some(link.position_min))?),
            position_max: JointPos(list(links, |link| Some(link.position_max))?),
            velocity_max,
            acceleration_max,
        })
    }
}
