//! What can be wrong with a cell file.

use crate::failure::{Excerpt, Exit, Failure, Problem};
use crate::robot::RobotError;
use std::path::PathBuf;

/// The page that lists a cell file's keys.
pub(super) const MANUAL: &str = "docs/cell.md";

/// Why there is no [`super::Cell`].
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the cell file {}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is no TOML, or says something that cannot be.
    #[error("{}", findings.iter().map(|finding| finding.to_string()).collect::<Vec<_>>().join("\n"))]
    Invalid {
        /// All that was found, in the order of the file; at least one.
        findings: Vec<Finding>,
    },
    /// The controller's calibration is given and not wanted, or the other way round.
    #[error("{}", if *is_wanted {
        "the cell takes the controller's calibration, and none was given"
    } else {
        "a controller's calibration was given, and the cell does not take one"
    })]
    ControllersCalibration {
        /// Whether the cell takes it.
        is_wanted: bool,
    },
    /// The controller's calibration is none.
    #[error(transparent)]
    Calibration(#[from] RobotError),
    /// The demo was asked for a rate that RTDE does not offer here.
    #[error("the demo cell has no rate of {found} Hz: expected 125 or 500")]
    DemoRate {
        /// What was asked for (Hz).
        found: u32,
    },
}

/// One thing that is wrong, and where.
#[derive(Debug, thiserror::Error)]
#[error("{}:{}:{}: {fault}", place.file, place.line, place.column)]
pub struct Finding {
    /// Where.
    pub place: Excerpt,
    /// What.
    pub fault: Fault,
}

/// What is wrong at one place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// No TOML.
    #[error("this is not TOML: {message}")]
    Syntax {
        /// What the TOML reader said.
        message: String,
    },
    /// A key or section that does not exist.
    #[error("{key} is not a {kind} of {section}")]
    Unknown {
        /// "key" or "section".
        kind: &'static str,
        /// As written.
        key: String,
        /// The section it stands in.
        section: String,
        /// The likeliest key or section meant.
        suggestion: Option<&'static str>,
    },
    /// A key that exists with another unit.
    #[error("{found} has the wrong unit: expected {expected}, in {unit}")]
    WrongUnit {
        /// As written.
        found: String,
        /// The key with the unit Screed reads.
        expected: &'static str,
        /// That unit in words.
        unit: &'static str,
    },
    /// A value of another type.
    #[error("{key}: expected {expected}, found {found}")]
    WrongType {
        /// The key.
        key: String,
        /// What it takes.
        expected: String,
        /// What stands there.
        found: String,
        /// The line to write instead, when it can be guessed.
        suggestion: Option<String>,
    },
    /// A key without which there is no cell.
    #[error("{section} lacks {key}: expected {expected}")]
    Missing {
        /// The section.
        section: String,
        /// The key.
        key: &'static str,
        /// What it takes.
        expected: String,
    },
    /// A section without which there is no cell.
    #[error("the section [{section}] is missing; it needs {}", keys.join(", "))]
    MissingSection {
        /// The section.
        section: &'static str,
        /// Its required keys.
        keys: Vec<&'static str>,
    },
    /// A value that cannot be.
    #[error("{key}: expected {expected}, found {found}")]
    Impossible {
        /// The key.
        key: String,
        /// What it may be.
        expected: String,
        /// What stands there.
        found: String,
    },
}

impl Fault {
    /// What to do about it; `manual` is the page that lists the keys.
    pub fn remedy(&self, manual: &str) -> String {
        match self {
            Self::Syntax { .. } => "write key = value, one a line, below its [section]".to_owned(),
            Self::Unknown { suggestion: Some(suggestion), .. } => format!("did you mean {suggestion}?"),
            Self::Unknown { kind, .. } => format!("remove it; {manual} lists every {kind}"),
            Self::WrongUnit { expected, unit, .. } => format!("write {expected} and give the value in {unit}"),
            Self::WrongType { suggestion: Some(suggestion), .. } => format!("write {suggestion}"),
            Self::WrongType { key, expected, .. } => format!("give {key} {expected}"),
            Self::Missing { section, key, .. } => format!("add a line `{key} = …` below {section}"),
            Self::MissingSection { section, .. } => format!("add the section [{section}]; {manual} has an example"),
            Self::Impossible { key, expected, .. } => format!("set {key} to {expected}"),
        }
    }
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        match error {
            ConfigError::Read { .. } => {
                Self::new(Exit::Input, error.to_string(), "check the path and that the file may be read")
            }
            ConfigError::ControllersCalibration { .. } => Self::new(
                Exit::Usage,
                error.to_string(),
                "write it with screed robot calibration --out and give it with --calibration, to a cell with calibration = \"controller\"",
            ),
            ConfigError::Calibration(error) => error.into(),
            ConfigError::DemoRate { .. } => Self::new(Exit::Usage, error.to_string(), "give --rate 125 or --rate 500"),
            ConfigError::Invalid { findings } => {
                let problem = |finding: Finding| Problem {
                    message: finding.fault.to_string(),
                    remedy: Some(finding.fault.remedy(MANUAL)),
                    excerpt: Some(finding.place),
                };
                Self { exit: Exit::Input, problems: findings.into_iter().map(problem).collect() }
            }
        }
    }
}
