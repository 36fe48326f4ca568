//! The serial chain in a URDF file (<https://wiki.ros.org/urdf/XML>).
//!
//! The chain runs from a base link to a tip link; fixed joints are folded into the others. No axis is dropped in silence: what is
//! not on the chain is listed in the description's notes, and what cannot be told in joints of the kernel is an error.

mod fold;
mod tree;

use super::chain::Chain;
use super::{Description, RobotError};
use crate::failure::Excerpt;
use std::ops::Range;
use std::path::Path;

/// Which chain of the file; without a name, the only possible one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ends {
    /// The base link.
    pub base: Option<String>,
    /// The tip link: the flange.
    pub tip: Option<String>,
}

/// What is wrong with a URDF, or why there is no chain in it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UrdfFault {
    /// No XML.
    #[error("this is not XML: {message}")]
    Xml {
        /// What the reader said.
        message: String,
    },
    /// A file that has to be expanded first.
    #[error("this is a xacro file, found {found}: expected a URDF")]
    Xacro {
        /// The element.
        found: String,
    },
    /// An element or attribute of another form.
    #[error("{entity}: expected {expected}, found {found}")]
    Form {
        /// Which.
        entity: String,
        /// What may stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// The links are no tree.
    #[error("link {link} {problem}")]
    Tree {
        /// The link.
        link: String,
        /// What is wrong with its place.
        problem: &'static str,
    },
    /// No link of that name.
    #[error("there is no link {name}: expected one of {}", known.join(", "))]
    NoSuchLink {
        /// As asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// More than one chain is possible.
    #[error("the chain's {end} can be {}: expected one", candidates.join(" or "))]
    Ambiguous {
        /// "base link" or "tip link".
        end: &'static str,
        /// The links.
        candidates: Vec<String>,
    },
    /// A joint that moves lies between the base link and the rest of the chain.
    #[error("the base link {base} is moved by joint {joint} against the chain")]
    MovingBase {
        /// The base link.
        base: String,
        /// The joint.
        joint: String,
    },
    /// A joint of the chain that the kernel has no kind for.
    #[error("joint {joint} of the chain is {kind}: expected revolute, continuous, prismatic or fixed")]
    Unsupported {
        /// The joint.
        joint: String,
        /// Its type.
        kind: String,
    },
    /// A mimic joint that is not one more motion of a neighbour's axis.
    #[error("mimic joint {joint} {problem}")]
    Mimic {
        /// The joint.
        joint: String,
        /// Why it cannot be told as a coupling.
        problem: String,
    },
    /// Too few or too many joints.
    #[error("the chain from {base} to {tip} has {found} joints: expected 3 to 9")]
    Count {
        /// Base link.
        base: String,
        /// Tip link.
        tip: String,
        /// How many.
        found: usize,
    },
    /// The chain cannot be written as a table without loss.
    #[error(
        "the DH table would be {error:e} m off the chain, more than {:e} m; axes are neither parallel nor clearly apart",
        super::TABLE_ERROR_MAX
    )]
    Table {
        /// How far (m).
        error: f64,
    },
}

impl UrdfFault {
    /// What to do about it.
    pub const fn remedy(&self) -> &'static str {
        match self {
            Self::Xml { .. } | Self::Form { .. } | Self::Tree { .. } => {
                "correct the file; docs/robots.md says what is read"
            }
            Self::Xacro { .. } => "expand it first: xacro FILE > robot.urdf",
            Self::NoSuchLink { .. } => "give --base and --tip names of links of the file",
            Self::Ambiguous { end, .. } if matches!(end.as_bytes(), b"tip link") => "name the flange with --tip",
            Self::Ambiguous { .. } | Self::MovingBase { .. } => "name the base link with --base",
            Self::Unsupported { .. } => "replace it by single joints, or take a chain without it with --base and --tip",
            Self::Mimic { .. } => "describe the arm in an arm file (docs/robots.md), or take a chain without it",
            Self::Count { .. } => "take another chain with --base and --tip",
            Self::Table { .. } => "write the angles of the file with more digits",
        }
    }
}

/// What is wrong, and where in the text.
type Located = (Range<usize>, UrdfFault);

/// Reads a chain from a file.
///
/// # Errors
/// [`RobotError::Read`] and [`RobotError::Urdf`].
pub fn load(path: &Path, ends: &Ends) -> Result<Description, RobotError> {
    let text = super::read(path)?;
    let name = path.to_string_lossy();
    parse(&text, &name, ends)
        .map_err(|(span, fault)| RobotError::Urdf { place: Excerpt::new(&name, text.as_bytes(), span).into(), fault })
}

/// Reads a chain from the text of a file; `file` is its name.
fn parse(text: &str, file: &str, ends: &Ends) -> Result<Description, Located> {
    let tree = tree::read(text)?;
    let (base, tip) = tree.ends(ends)?;
    let (joints, last_from_flange) = tree.path(&base, &tip)?;
    let (steps, rest) = fold::fold(&tree, joints, last_from_flange)?;
    let count = steps.len();
    if !super::description::JOINTS.contains(&count) {
        return Err((tree.span.clone(), UrdfFault::Count { base, tip, found: count }));
    }
    let mut notes = tree.notes.clone();
    let chain = Chain { steps, last_from_flange: rest };
    for joint in tree.joints.iter().filter(|joint| joint.moves()) {
        let name = &joint.name;
        match chain.steps.iter().find(|step| step.link.name == *name) {
            Some(step) if step.link.velocity_max.is_none() => notes.push(format!("joint {name} has no highest speed")),
            Some(_) => {}
            None if joint.mimic.is_some() && tree.is_on(joint, &base, &tip) => {
                notes.push(format!("joint {name} mimics another one and is told as a coupling"));
                if let Some(driver) = tree.leads_beyond(joint) {
                    notes.push(format!(
                        "joint {driver} leads joint {name} beyond limits of its own, which are not read"
                    ));
                }
            }
            None => {
                notes.push(format!("joint {name} ({}) is not on the chain from {base} to {tip}: left out", joint.kind))
            }
        }
        if joint.has_soft_limits {
            notes.push(format!("joint {name} has a safety_controller, whose soft limits are not read"));
        }
    }
    let mut description = chain.table(&tree.name, &format!("{file}, from {base} to {tip}"));
    description.notes = notes;
    match super::table_error(&description, &chain) {
        error if error <= super::TABLE_ERROR_MAX => Ok(description),
        error => Err((tree.span, UrdfFault::Table { error })),
    }
}

#[cfg(test)]
mod tests;
