//! Robots: the catalogue, the calibration of a unit, and arms that a person describes.

pub mod calibration;
pub mod chain;
pub mod description;
mod error;
pub mod file;
pub mod sample;
pub mod urdf;

pub use description::Description;
pub use error::RobotError;

use chain::Chain;
use sample::Random;
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

/// Most by which a table may differ from the chain that it was made from (m).
pub const TABLE_ERROR_MAX: f64 = 1e-7;

/// How far a description's flange is from that of the chain it was made from, at most, over seeded joint vectors (m).
fn table_error(description: &Description, chain: &Chain) -> f64 {
    let mut random = Random::new(2);
    chain.table_error(|joints| description.forward(joints), (0..100).map(|_| random.positions(&description.links)))
}

fn read(path: &Path) -> Result<String, RobotError> {
    std::fs::read_to_string(path).map_err(|source| RobotError::Read { file: path.to_owned(), source })
}
