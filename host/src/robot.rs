//! Robots: the catalogue, and arms that a person describes.

use crate::failure::{Exit, Failure};
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur;

/// No robot of that name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no robot {name:?}; use one of {}", known.join(", "))]
pub struct UnknownRobot {
    /// As asked for.
    pub name: String,
    /// What there is.
    pub known: Vec<&'static str>,
}

impl From<UnknownRobot> for Failure {
    fn from(error: UnknownRobot) -> Self {
        Self::told(Exit::Input, error.to_string())
    }
}

/// The UR arm of that name.
///
/// # Errors
/// [`UnknownRobot`].
pub fn ur(name: &str) -> Result<Arm<6>, UnknownRobot> {
    let found = ur::ALL.into_iter().find(|arm| arm.name == name);
    found.ok_or_else(|| UnknownRobot { name: name.to_owned(), known: ur::ALL.iter().map(|arm| arm.name).collect() })
}
