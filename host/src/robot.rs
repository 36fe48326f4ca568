//! Robots: the catalogue, the calibration of a unit, and arms that a person describes.

pub mod calibration;
pub mod chain;
pub mod description;
mod error;
pub mod sample;

pub use description::Description;
pub use error::RobotError;

use screed_kernel::arm::Arm;
use screed_kernel::arms::ur;
use std::path::Path;

/// The UR arm of that name.
///
/// # Errors
/// [`RobotError::Unknown`].
pub fn ur(name: &str) -> Result<Arm<6>, RobotError> {
    let found = ur::ALL.into_iter().find(|arm| arm.name == name);
    found.ok_or_else(|| RobotError::Unknown {
        name: name.to_owned(),
        known: ur::ALL.iter().map(|arm| arm.name).collect(),
    })
}

fn read(path: &Path) -> Result<String, RobotError> {
    std::fs::read_to_string(path).map_err(|source| RobotError::Read { file: path.to_owned(), source })
}
