//! The processes that the host starts: `screed-rt`, and for the demo the simulated robot and extruder.

use std::ffi::OsStr;
use std::io::{self, BufRead, BufReader, Read};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Version and build, as `--version` prints them: two programs with the same belong together.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (build ", env!("SCREED_BUILD"), ")");

/// Why a process cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum ChildError {
    /// The system refused.
    #[error("{name} cannot be started: {source}")]
    Spawn {
        /// Which.
        name: &'static str,
        /// Why.
        source: io::Error,
    },
    /// It ended at once.
    #[error("{}", .message)]
    Ended {
        /// Its exit code, if it had one.
        code: Option<i32>,
        /// What it said.
        message: String,
    },
}

/// A process that is ended when it is dropped.
pub struct Process {
    name: &'static str,
    child: Child,
}

impl Process {
    /// Starts `program`. It gets its own process group: Ctrl-C is for the host alone, which then ends the others in order.
    ///
    /// # Errors
    /// [`ChildError::Spawn`].
    pub fn spawn(name: &'static str, mut program: Command) -> Result<Self, ChildError> {
        program.process_group(0).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let child = program.spawn().map_err(|source| ChildError::Spawn { name, source })?;
        Ok(Self { name, child })
    }

    /// The first line it prints.
    ///
    /// # Errors
    /// [`ChildError::Ended`] with what it said when it ended without one.
    pub fn first_line(&mut self) -> Result<String, ChildError> {
        let mut line = String::new();
        if let Some(stdout) = self.child.stdout.take() {
            // What it prints later is not read: its pipe stays open as long as this end lives, and it prints nothing more.
            let mut reader = BufReader::new(stdout);
            let _ = reader.read_line(&mut line);
            self.child.stdout = Some(reader.into_inner());
        }
        if line.is_empty() { Err(self.ended()) } else { Ok(line) }
    }

    /// Whether it still runs; what it said if not.
    ///
    /// # Errors
    /// [`ChildError::Ended`].
    pub fn check(&mut self) -> Result<(), ChildError> {
        match self.child.try_wait() {
            Ok(None) => Ok(()),
            _ => Err(self.ended()),
        }
    }

    /// Waits for its end, for so long at most; true when it has ended.
    pub fn wait(&mut self, at_most: Duration) -> bool {
        let until = Instant::now() + at_most;
        while matches!(self.child.try_wait(), Ok(None)) {
            if Instant::now() > until {
                return false;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        true
    }

    /// Lets it go on after the host has ended.
    pub fn leave(self) {
        std::mem::forget(self);
    }

    fn ended(&mut self) -> ChildError {
        let code = self.child.wait().ok().and_then(|status| status.code());
        let mut said = String::new();
        if let Some(stderr) = &mut self.child.stderr {
            let _ = stderr.read_to_string(&mut said);
        }
        let said = said.trim().trim_start_matches("error: ");
        let message = if said.is_empty() { format!("{} ended without a word", self.name) } else { said.to_owned() };
        ChildError::Ended { code, message }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if !matches!(self.child.try_wait(), Ok(None)) {
            return;
        }
        // SIGTERM first: each of them comes to rest and cleans up.
        // SAFETY: the child has not been waited for, so its number is still its own.
        unsafe { libc::kill(self.child.id() as libc::pid_t, libc::SIGTERM) };
        if !self.wait(Duration::from_secs(2)) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// This program, with a subcommand.
///
/// # Errors
/// [`ChildError::Spawn`] when the system does not say where this program lies.
pub fn screed<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Result<Command, ChildError> {
    let mut command = Command::new(own_path()?);
    command.args(arguments);
    Ok(command)
}

/// `screed-rt`: the program of that name beside this one if it is of the same build, else this program under that name
/// (`cargo run` builds only one of the two).
///
/// # Errors
/// As [`screed`].
pub fn screed_rt() -> Result<Command, ChildError> {
    let beside = own_path()?.with_file_name("screed-rt");
    if version_of(&beside).is_some_and(|version| version == format!("screed-rt {VERSION}")) {
        return Ok(Command::new(beside));
    }
    let mut command = screed(["rt"])?;
    command.arg0("screed-rt");
    Ok(command)
}

/// What a program says of its version; none when it cannot be started or has not ended within a second.
fn version_of(program: &Path) -> Option<String> {
    let mut command = Command::new(program);
    command.arg("--version").stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().ok()?;
    let until = Instant::now() + Duration::from_secs(1);
    while matches!(child.try_wait(), Ok(None)) {
        if Instant::now() > until {
            let _ = child.kill();
            let _ = child.wait();
            return None;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let mut said = String::new();
    child.stdout.take()?.read_to_string(&mut said).ok()?;
    Some(said.trim().to_owned())
}

fn own_path() -> Result<PathBuf, ChildError> {
    std::env::current_exe().map_err(|source| ChildError::Spawn { name: "screed", source })
}
