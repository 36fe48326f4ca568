//! What can be wrong with a robot.

use super::calibration::CalibrationFault;
use super::urdf::UrdfFault;
use crate::config::Finding;
use crate::failure::{Excerpt, Exit, Failure, Problem};
use std::path::PathBuf;

/// The page about robots.
const MANUAL: &str = "docs/robots.md";

/// Why there is no arm.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// No robot of that name.
    #[error("there is no robot {name:?}: expected one of {}", known.join(", "))]
    Unknown {
        /// As asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// The file cannot be read.
    #[error("cannot read {}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The calibration is none, or not of this arm.
    #[error("{}:{}:{}: {fault}", place.file, place.line, place.column)]
    Calibration {
        /// Where.
        place: Box<Excerpt>,
        /// What.
        fault: CalibrationFault,
    },
    /// The arm file is wrong.
    #[error("{}", findings.iter().map(|finding| finding.to_string()).collect::<Vec<_>>().join("\n"))]
    File {
        /// All that was found, in the order of the file; at least one.
        findings: Vec<Finding>,
    },
    /// The URDF has no chain that the kernel can have.
    #[error("{}:{}:{}: {fault}", place.file, place.line, place.column)]
    Urdf {
        /// Where.
        place: Box<Excerpt>,
        /// What.
        fault: UrdfFault,
    },
}

impl RobotError {
    fn remedy(&self) -> &'static str {
        match self {
            Self::Unknown { .. } => "screed robot list names them",
            Self::Read { .. } => "check the path and that the file may be read",
            Self::Calibration { fault, .. } => match fault {
                CalibrationFault::Deviation { .. } => {
                    "take calibration.conf from this unit's controller, and check the model"
                }
                CalibrationFault::Status { .. } => "have the unit calibrated, or leave the calibration out",
                _ => "docs/robots.md shows both kinds of file",
            },
            Self::Urdf { fault, .. } => fault.remedy(),
            Self::File { .. } => MANUAL,
        }
    }
}

impl From<RobotError> for Failure {
    fn from(error: RobotError) -> Self {
        if let RobotError::File { findings } = error {
            let problem = |finding: Finding| Problem {
                message: finding.fault.to_string(),
                remedy: Some(finding.fault.remedy(MANUAL)),
                excerpt: Some(finding.place),
            };
            return Self { exit: Exit::Input, problems: findings.into_iter().map(problem).collect() };
        }
        let remedy = Some(error.remedy().to_owned());
        let (message, excerpt) = match error {
            RobotError::Calibration { place, fault } => (fault.to_string(), Some(*place)),
            RobotError::Urdf { place, fault } => (fault.to_string(), Some(*place)),
            other => (other.to_string(), None),
        };
        Self { exit: Exit::Input, problems: vec![Problem { message, excerpt, remedy }] }
    }
}
