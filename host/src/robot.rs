//! Robots: the catalogue, the calibration of a unit, and arms that a person describes.

pub mod calibration;
pub mod chain;
pub mod description;
mod error;
pub mod examine;
pub mod file;
pub mod plot;
pub mod report;
pub mod sample;
pub mod urdf;

pub use description::Description;
pub use error::RobotError;

use chain::Chain;
use sample::Random;
use screed_kernel::arm::Arm;
use screed_kernel::arms::crane::CRANE_NJ130;
use screed_kernel::arms::gantry::CONTOUR_CRAFTER;
use screed_kernel::arms::{SPHERICAL_WRISTS, ur};
use std::path::Path;

/// Sources of the UR arms, in the order of [`ur::ALL`].
const UR_SOURCES: [&str; 14] = {
    const DESCRIPTION: &str = "Universal_Robots_ROS2_Description 2221ec0";
    [
        DESCRIPTION,
        DESCRIPTION,
        DESCRIPTION,
        DESCRIPTION,
        DESCRIPTION,
        "the UR5e by identity: not verified",
        DESCRIPTION,
        "ros-industrial/universal_robot 2f33925",
        DESCRIPTION,
        "ros-industrial/universal_robot 31e2294",
        "ros-industrial/universal_robot 499e728",
        "ros-industrial/universal_robot 34b1371",
        DESCRIPTION,
        DESCRIPTION,
    ]
};
/// Sources of the arms with a spherical wrist, in the order of [`SPHERICAL_WRISTS`].
const WRIST_SOURCES: [&str; 6] = [
    "ros-industrial/kuka_experimental e78bbd1",
    "kroshu/kuka_robot_descriptions 7766e92",
    "fbarbosac/ABB_IRB140_UNAL 459f6c8",
    "ros-industrial/abb_experimental 20b9cf8",
    "ukaea/CRCOpenROS2Driver 85262f9; flange not verified",
    "one source that nothing confirms: not verified",
];

/// Every robot of the catalogue.
pub fn catalogue() -> Vec<Description> {
    let urs = ur::ALL.iter().zip(UR_SOURCES);
    let six = urs.chain(SPHERICAL_WRISTS.iter().zip(WRIST_SOURCES)).map(|(arm, source)| Description::of(arm, source));
    let gantry = Description::of(&CONTOUR_CRAFTER, "Zhang and Khoshnevis 2013; strokes of no machine");
    let crane = Description::of(&CRANE_NJ130, "Crivelli et al., the workspace; its height not verified");
    six.chain([gantry, crane]).collect()
}

/// The robot of that name.
///
/// # Errors
/// [`RobotError::Unknown`].
pub fn named(name: &str) -> Result<Description, RobotError> {
    let mut catalogue = catalogue();
    match catalogue.iter().position(|description| description.name == name) {
        Some(index) => Ok(catalogue.swap_remove(index)),
        None => Err(unknown(name, catalogue.into_iter().map(|description| description.name).collect())),
    }
}

/// The UR arm of that name.
///
/// # Errors
/// [`RobotError::Unknown`].
pub fn ur(name: &str) -> Result<Arm<6>, RobotError> {
    let found = ur::ALL.into_iter().find(|arm| arm.name == name);
    found.ok_or_else(|| unknown(name, ur::ALL.iter().map(|arm| arm.name.to_owned()).collect()))
}

fn unknown(name: &str, known: Vec<String>) -> RobotError {
    RobotError::Unknown { name: name.to_owned(), known }
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
