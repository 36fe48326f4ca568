//! How long a cycle can take: instructions, times, stack, and what can be said of their worst. docs/wcet.md has the method.

pub mod counts;
pub mod cycle;
pub mod disturb;
pub mod evt;
pub mod figures;
pub mod machine;
pub mod page;
pub mod report;
pub mod response;
pub mod run;
pub mod search;
pub mod stack;
pub mod times;

use std::io;
use std::path::{Path, PathBuf};

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum WcetError {
    /// A file or folder.
    #[error("{path}: {error}; check the path, its rights and the room on the disk")]
    File {
        /// Which.
        path: PathBuf,
        /// The system's words.
        error: io::Error,
    },
    /// The processor to measure on.
    #[error(
        "processor {cpu}: {error}; name one that is on and that this process may use, with --cpu or `cpu` of [realtime]"
    )]
    Processor {
        /// Its number.
        cpu: usize,
        /// The system's words.
        error: io::Error,
    },
    /// The connection that stands for the robot's.
    #[error("a loopback connection: {0}; check that the loopback interface is up")]
    Loopback(io::Error),
    /// A course that is none.
    #[error("not the name of a course: {0}; give {digits} hexadecimal digits", digits = 2 * screed_tape::vectors::GENES)]
    Course(String),
    /// The profiler.
    #[error("valgrind {0}; install it (apt-get install valgrind), it counts the instructions")]
    Valgrind(String),
    /// The print whose cycles are measured.
    #[error("the demo's print: {0}")]
    Print(String),
    /// The committed figures.
    #[error("figures.toml: {0}; `.ci/wcet update REASON` writes it anew")]
    Figures(String),
    /// The profiler's calls are not those of the courses.
    #[error(
        "{expected} calls were made, but valgrind saw {found}; build with symbols (debug = 1) and without link-time optimisation"
    )]
    Calls {
        /// Calls made.
        expected: usize,
        /// Calls seen.
        found: usize,
    },
}

impl WcetError {
    fn file(path: &Path, error: &io::Error) -> Self {
        Self::File { path: path.to_owned(), error: io::Error::new(error.kind(), error.to_string()) }
    }
}
