//! Measurement files, in TOML: one layout for each calibration, in `docs/calibration.md` with examples. Units stand in
//! the keys and end here; everything unknown, missing, twice said or impossible is an error with its place.

mod poses;

pub use poses::{TcpFile, TrackerFile};

use crate::failure::{Excerpt, Exit, Failure};
use nalgebra::Vector3;
use screed_kernel::registration::PointPair;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;

/// The most measurements in a file.
pub const MEASUREMENTS_MAX: usize = 10_000;
/// The largest coordinate (mm): a kilometre.
const COORDINATE_MAX: f64 = 1e6;

/// Why a measurement file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file cannot be read.
    #[error("cannot read the measurements {file}: {source}; check the path and that the file may be read")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is no TOML, or not laid out as it must be.
    #[error("{message}; docs/calibration.md has an example of such a file")]
    Layout {
        /// What the reader said.
        message: String,
        /// Where.
        place: Box<Excerpt>,
    },
    /// A value that cannot be.
    #[error("{what}: expected {expected}, found {found}; {remedy}")]
    Value {
        /// Which value.
        what: &'static str,
        /// What it may be.
        expected: String,
        /// What stands there.
        found: String,
        /// What to do.
        remedy: &'static str,
        /// Where.
        place: Box<Excerpt>,
    },
}

impl From<FileError> for Failure {
    fn from(error: FileError) -> Self {
        let failure = Self::told(Exit::Input, error.to_string());
        match error {
            FileError::Read { .. } => failure,
            FileError::Layout { place, .. } | FileError::Value { place, .. } => failure.at(*place),
        }
    }
}

/// A measurement file's text, for errors that point into it.
#[derive(Clone, Debug)]
pub struct Source {
    name: String,
    text: String,
}

impl Source {
    /// Reads a file.
    ///
    /// # Errors
    /// [`FileError::Read`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let name = path.to_string_lossy().into_owned();
        match std::fs::read_to_string(path) {
            Ok(text) => Ok(Self { name, text }),
            Err(source) => Err(FileError::Read { file: name, source }),
        }
    }

    /// The text of a file of that name.
    pub fn new(name: &str, text: &str) -> Self {
        Self { name: name.to_owned(), text: text.to_owned() }
    }

    /// One of the layouts below.
    ///
    /// # Errors
    /// [`FileError::Layout`].
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, FileError> {
        toml::from_str(&self.text).map_err(|error| FileError::Layout {
            message: error.message().to_owned(),
            place: self.place(error.span().unwrap_or(0..0)),
        })
    }

    fn place(&self, span: Range<usize>) -> Box<Excerpt> {
        Box::new(Excerpt::new(&self.name, self.text.as_bytes(), span))
    }

    /// What stands at this place will not do.
    pub fn refuse<T>(
        &self,
        value: &Spanned<T>,
        what: &'static str,
        expected: impl Into<String>,
        found: impl Into<String>,
        remedy: &'static str,
    ) -> FileError {
        FileError::Value {
            what,
            expected: expected.into(),
            found: found.into(),
            remedy,
            place: self.place(value.span()),
        }
    }

    /// Numbers of at most this size.
    fn numbers<const N: usize>(
        &self,
        what: &'static str,
        value: &Spanned<[f64; N]>,
        most: f64,
    ) -> Result<[f64; N], FileError> {
        let numbers = *value.get_ref();
        match numbers.iter().find(|number| !(-most..=most).contains(*number)) {
            None => Ok(numbers),
            Some(found) => {
                let expected = format!("numbers from -{most} to {most}");
                Err(self.refuse(
                    value,
                    what,
                    expected,
                    found.to_string(),
                    "measure it again, or leave the measurement out",
                ))
            }
        }
    }

    fn point(&self, what: &'static str, value: &Spanned<[f64; 3]>) -> Result<Vector3<f64>, FileError> {
        Ok(Vector3::from(self.numbers(what, value, COORDINATE_MAX)?.map(|mm| mm / 1e3)))
    }

    /// A standard deviation above zero, in SI.
    fn sigma(&self, what: &'static str, value: &Spanned<f64>, unit: f64, most: f64) -> Result<f64, FileError> {
        let found = *value.get_ref();
        if found > 0.0 && found <= most {
            return Ok(found * unit);
        }
        let expected = format!("more than 0, at most {most}");
        Err(self.refuse(value, what, expected, found.to_string(), "give one standard deviation"))
    }
}

/// The measurements of a file, with where each stands.
type Entries<T> = Spanned<Vec<T>>;

fn counted<'a, T>(source: &Source, entries: &'a Entries<T>) -> Result<&'a [T], FileError> {
    let found = entries.get_ref().len();
    if found > MEASUREMENTS_MAX {
        let expected = format!("at most {MEASUREMENTS_MAX}");
        return Err(source.refuse(entries, "measurements", expected, found.to_string(), "leave some out"));
    }
    Ok(entries.get_ref())
}

/// `screed calibrate frame`: points seen in two frames.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameFile {
    /// The name of the frame in which the other's pose is sought.
    pub outer: String,
    /// The name of the other.
    pub inner: String,
    sigma_um: Option<Spanned<f64>>,
    pair: Entries<PairEntry>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PairEntry {
    outer_mm: Spanned<[f64; 3]>,
    inner_mm: Spanned<[f64; 3]>,
}

impl FrameFile {
    /// The pairs, and the standard deviation of a coordinate where it is given; SI.
    ///
    /// # Errors
    /// [`FileError::Value`].
    pub fn checked(&self, source: &Source) -> Result<(Vec<PointPair>, Option<f64>), FileError> {
        let pair = |entry: &PairEntry| {
            let (in_outer, in_inner) =
                (source.point("outer_mm", &entry.outer_mm)?, source.point("inner_mm", &entry.inner_mm)?);
            Ok(PointPair { in_outer, in_inner })
        };
        let pairs = counted(source, &self.pair)?.iter().map(pair).collect::<Result<_, FileError>>()?;
        Ok((pairs, sigma_um(source, self.sigma_um.as_ref())?))
    }
}

fn sigma_um(source: &Source, value: Option<&Spanned<f64>>) -> Result<Option<f64>, FileError> {
    value.map(|value| source.sigma("sigma_um", value, 1e-6, 1e5)).transpose()
}
