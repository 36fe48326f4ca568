//! On what a report was made: the program, how it was built, the machine.

use super::WcetError;
use crate::config::Realtime;
use crate::doctor::{Diagnosis, Verdict};
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::fs;
use std::path::Path;

/// Program, build and machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Machine {
    /// The program's file.
    pub program: String,
    /// Its SHA-256.
    pub program_sha256: String,
    /// Screed's version and build.
    pub version: &'static str,
    /// The compiler.
    pub rustc: &'static str,
    /// What it was built for.
    pub target: &'static str,
    /// Profile, optimisation, debug assertions.
    pub profile: String,
    /// Flags beyond the profile's; empty if none.
    pub rustflags: String,
    /// The processor's name.
    pub processor: String,
    /// How many there are.
    pub processors: usize,
    /// `uname`'s release and version.
    pub kernel: String,
    /// The kernel's command line.
    pub kernel_command_line: String,
    /// What the doctor finds that keeps this machine from holding a loop.
    pub not_real_time: Vec<String>,
    /// Whether it found nothing.
    pub real_time: bool,
}

impl Machine {
    /// This one.
    ///
    /// # Errors
    /// [`WcetError::File`] where the program cannot be read.
    pub fn here(wanted: &Realtime) -> Result<Self, WcetError> {
        let path = std::env::current_exe().map_err(|error| WcetError::file(Path::new("/proc/self/exe"), &error))?;
        let bytes = fs::read(&path).map_err(|error| WcetError::file(&path, &error))?;
        let diagnosis = Diagnosis::of(Path::new("/"), wanted);
        let bad = diagnosis.findings.iter().filter(|finding| finding.verdict == Verdict::Bad);
        let read = |path: &str| fs::read_to_string(path).map_or("unknown".to_owned(), |text| text.trim().to_owned());
        let processors = read("/proc/cpuinfo");
        let named = processors.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
        Ok(Self {
            program: path.display().to_string(),
            program_sha256: Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect(),
            version: crate::run::children::VERSION,
            rustc: env!("SCREED_RUSTC"),
            target: env!("SCREED_TARGET"),
            profile: format!(
                "{}, optimisation {}, debug assertions {}",
                env!("SCREED_PROFILE"),
                env!("SCREED_OPT_LEVEL"),
                if cfg!(debug_assertions) { "on" } else { "off" }
            ),
            rustflags: env!("SCREED_RUSTFLAGS").replace('\u{1f}', " "),
            processor: named.map_or("unknown", |(_, name)| name).to_owned(),
            processors: std::thread::available_parallelism().map_or(1, usize::from),
            kernel: read("/proc/version"),
            kernel_command_line: read("/proc/cmdline"),
            not_real_time: bad.map(|finding| format!("{}: {}", finding.what, finding.found)).collect(),
            real_time: diagnosis.can_hold,
        })
    }
}
