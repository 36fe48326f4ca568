//! Mimic joints as couplings.
//!
//! A joint of a chain moves as its driver does: itself, or the joint that it mimics. Neighbours on one axis are one link, whose
//! variable is the sum of their drivers' parts: one driver that no link before it has, which becomes the link's own joint, and
//! at most one that an earlier link has, which becomes its coupling. So a parallelogram is told whose forearm follows two
//! motors; anything else that mimics is an error.

use super::tree::{Tree, UrdfJoint};
use super::{Located, UrdfFault};
use crate::robot::chain::Step;
use crate::robot::description::Link;
use nalgebra::{Unit, Vector3};
use screed_kernel::arm::{Coupling, Dh, Joint, JointKind};
use screed_kernel::pose::Pose;

/// Distance (m) and sine of the angle within which two axes are one.
const COAXIAL: f64 = 1e-9;

/// Joints of one axis.
struct Group<'a> {
    previous_from_joint: Pose,
    axis: Unit<Vector3<f64>>,
    is_revolute: bool,
    /// Drivers with their factors: what each adds to the variable.
    terms: Vec<(&'a UrdfJoint, f64)>,
    /// What the mimic joints' offsets add.
    constant: f64,
    /// A joint of it to name, a mimic joint if there is one.
    member: &'a UrdfJoint,
}

/// The steps of a chain from the joints of a path, and the flange in the last joint's frame.
pub(super) fn fold<'a>(
    tree: &'a Tree,
    path: Vec<(Pose, &'a UrdfJoint)>,
    last_from_flange: Pose,
) -> Result<(Vec<Step>, Pose), Located> {
    let mut groups: Vec<Group<'a>> = Vec::new();
    // From the frame of the last group to that of the joint at hand.
    let mut pending = Pose::identity();
    for (shift, joint) in path {
        pending = pending * shift;
        if !(joint.is_revolute() || joint.kind == "prismatic") {
            let (joint_name, kind) = (joint.name.clone(), joint.kind.clone());
            return Err((joint.span.clone(), UrdfFault::Unsupported { joint: joint_name, kind }));
        }
        let (driver, factor, constant) = driver(tree, joint)?;
        let owned = |group: &Group<'_>| group.terms.iter().any(|(term, _)| term.name == driver.name);
        let is_new = !groups.iter().any(owned);
        let ownerless = |groups: &[Group<'a>]| {
            let (last, before) = groups.split_last()?;
            let all_owned =
                |term: &UrdfJoint| before.iter().any(|g| g.terms.iter().any(|(other, _)| other.name == term.name));
            Some(last.terms.iter().all(|(term, _)| all_owned(term)))
        };
        let joins = !is_new || ownerless(&groups) == Some(true);
        let sense = groups.last().and_then(|last| last.sense_of(&pending, joint));
        match (groups.last_mut(), sense) {
            (Some(last), Some(sense)) if joins => {
                last.add(driver, sense * factor);
                last.constant += sense * constant;
                if joint.mimic.is_some() {
                    last.member = joint;
                }
            }
            _ => groups.push(Group {
                previous_from_joint: std::mem::replace(&mut pending, Pose::identity()),
                axis: joint.axis,
                is_revolute: joint.is_revolute(),
                terms: vec![(driver, factor)],
                constant,
                member: joint,
            }),
        }
    }
    let mut owners: Vec<&str> = Vec::new();
    let mut steps = Vec::new();
    for group in &groups {
        let (step, owner) = group.step(&owners)?;
        owners.push(owner);
        steps.push(step);
    }
    Ok((steps, pending * last_from_flange))
}

/// What moves a joint: the driver, by how much, and what is added.
fn driver<'a>(tree: &'a Tree, joint: &'a UrdfJoint) -> Result<(&'a UrdfJoint, f64, f64), Located> {
    let Some(mimic) = &joint.mimic else { return Ok((joint, 1.0, 0.0)) };
    let fault = |problem: String| (joint.span.clone(), UrdfFault::Mimic { joint: joint.name.clone(), problem });
    let driver = tree.joints.iter().find(|other| other.name == mimic.joint);
    let driver = driver.ok_or_else(|| fault(format!("follows joint {}, which is not in the file", mimic.joint)))?;
    if driver.mimic.is_some() {
        return Err(fault(format!("follows joint {}, which is a mimic joint itself", driver.name)));
    }
    if driver.is_revolute() != joint.is_revolute() || !driver.moves() {
        return Err(fault(format!("turns where joint {} slides, or the other way round", driver.name)));
    }
    Ok((driver, mimic.multiplier, mimic.offset))
}

impl<'a> Group<'a> {
    /// +1 or −1 when the joint's axis is this one, in the same or the opposite sense.
    fn sense_of(&self, group_from_joint: &Pose, joint: &UrdfJoint) -> Option<f64> {
        let direction = group_from_joint.rotation * *joint.axis;
        let beside = self.axis.cross(&group_from_joint.translation).norm();
        let aligned = self.axis.cross(&direction).norm() < COAXIAL && (!self.is_revolute || beside < COAXIAL);
        (aligned && self.is_revolute == joint.is_revolute()).then(|| self.axis.dot(&direction).signum())
    }

    fn add(&mut self, driver: &'a UrdfJoint, factor: f64) {
        match self.terms.iter_mut().find(|(term, _)| term.name == driver.name) {
            Some((_, sum)) => *sum += factor,
            None => self.terms.push((driver, factor)),
        }
    }

    /// The step, and the name of the joint that owns it.
    fn step(&self, owners: &[&str]) -> Result<(Step, &'a str), Located> {
        let fault =
            |problem: String| (self.member.span.clone(), UrdfFault::Mimic { joint: self.member.name.clone(), problem });
        let (earlier, own): (Vec<_>, Vec<_>) =
            self.terms.iter().partition(|(driver, _)| owners.contains(&driver.name.as_str()));
        let [(driver, own_factor)] = own.as_slice() else {
            return Err(fault("has no neighbour on its axis that moves by itself".to_owned()));
        };
        if own_factor.abs() != 1.0 {
            return Err(fault(format!("makes its axis move {own_factor} times as far as joint {}", driver.name)));
        }
        let coupling = match earlier.as_slice() {
            [] => None,
            [(other, factor)] => owners
                .iter()
                .position(|owner| *owner == other.name)
                .map(|joint| Coupling { joint, factor: factor * own_factor }),
            more => return Err(fault(format!("is on an axis with {} other joints", more.len()))),
        };
        let Some([position_min, position_max]) = driver.range else {
            let (entity, expected) = (format!("joint {}", driver.name), "an element limit".to_owned());
            return Err((driver.span.clone(), UrdfFault::Form { entity, expected, found: "none".to_owned() }));
        };
        let offset = match self.is_revolute {
            true => Pose::from_rotation_vector(Vector3::zeros(), *self.axis * self.constant),
            false => Pose { translation: *self.axis * self.constant, ..Pose::identity() },
        };
        let kind = if self.is_revolute { JointKind::Revolute } else { JointKind::Prismatic };
        let link = Link {
            name: driver.name.clone(),
            dh: Dh { theta: 0.0, d: 0.0, a: 0.0, sin_alpha: 0.0, cos_alpha: 1.0 },
            joint: Joint { kind, coupling },
            position_min,
            position_max,
            velocity_max: driver.velocity_max,
            acceleration_max: None,
        };
        let axis = if *own_factor < 0.0 { -self.axis } else { self.axis };
        Ok((Step { previous_from_joint: self.previous_from_joint * offset, axis, link }, &driver.name))
    }
}
