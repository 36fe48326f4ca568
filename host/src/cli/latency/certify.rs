//! The certificate of `screed latency`: its files and its key.

use super::Report;
use crate::cli::say;
use crate::config::Realtime;
use crate::doctor::Diagnosis;
use crate::failure::{Exit, Failure};
use crate::latency::certificate::{self, Certificate, Machine, Program, hex, unhex};
use crate::run::children;
use ed25519_dalek::SigningKey;
use sha2::{Digest, Sha256};
use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// What a certificate needs before it is measured.
pub(super) struct Prepared {
    file: PathBuf,
    key: SigningKey,
    programs: Vec<Program>,
}

/// Finds the key, or makes one, and sees that the files can be written; leaves none where there was none.
///
/// # Errors
/// [`Failure`] where not.
pub(super) fn prepare(file: &Path, key: Option<&Path>) -> Result<Prepared, Failure> {
    let key = match key {
        Some(path) => key_of(path)?,
        None => key_of(&usual_key()?)?,
    };
    for path in [file.to_owned(), beside(file)] {
        can_write(&path).map_err(|error| cannot(&path, &error))?;
    }
    let own = std::env::current_exe().map_err(|error| cannot(Path::new("screed"), &error))?;
    let loop_program = PathBuf::from(children::screed_rt()?.get_program());
    let programs = [("screed", own), ("screed-rt", loop_program)];
    let programs = programs.into_iter().map(|(name, path)| {
        let bytes = fs::read(&path).map_err(|error| cannot(&path, &error))?;
        Ok(Program { name: name.to_owned(), sha256: hex(&Sha256::digest(&bytes)) })
    });
    Ok(Prepared { file: file.to_owned(), key, programs: programs.collect::<Result<_, Failure>>()? })
}

/// Opens the file to write, and changes nothing.
fn can_write(path: &Path) -> std::io::Result<()> {
    match OpenOptions::new().write(true).open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            OpenOptions::new().write(true).create_new(true).open(path)?;
            fs::remove_file(path)
        }
        opened => opened.map(drop),
    }
}

/// Writes summary and signature.
///
/// # Errors
/// [`Failure`] where they cannot be written.
pub(super) fn write(
    prepared: &Prepared,
    report: &Report,
    wanted: &Realtime,
    began_unix_s: u64,
    each: Duration,
) -> Result<(), Failure> {
    let read = |path: &str| fs::read_to_string(path).map(|text| text.trim().to_owned()).unwrap_or_default();
    let certificate = Certificate {
        screed: children::VERSION,
        machine: Machine {
            name: read("/proc/sys/kernel/hostname"),
            kernel: read("/proc/version"),
            command_line: read("/proc/cmdline"),
        },
        began_unix_s,
        seconds_each: each.as_secs_f64(),
        programs: prepared.programs.clone(),
        period_us: report.period_us,
        priority: report.priority,
        cpu: report.cpu,
        scheduling: report.scheduling,
        scheduling_note: report.scheduling_note.clone(),
        doctor: Diagnosis::of(Path::new("/"), wanted),
        wake: report.ours.clone(),
        sensor_to_wire: report.sensor_to_wire.clone(),
    };
    let text = serde_json::to_string_pretty(&certificate)
        .map_err(|error| Failure::new(Exit::Failed, error.to_string(), "report this"))?
        + "\n";
    let seal = certificate::sign(text.as_bytes(), &prepared.key);
    for (path, text) in [(prepared.file.clone(), text), (beside(&prepared.file), seal)] {
        fs::write(&path, text).map_err(|error| cannot(&path, &error))?;
    }
    let key = hex(prepared.key.verifying_key().as_bytes());
    let file = prepared.file.display();
    let _ = writeln!(std::io::stderr(), "{file}, signed by key {key}; screed latency --verify {file} --trust {key}");
    Ok(())
}

/// Says whether a certificate is what was signed.
///
/// # Errors
/// [`Failure`] where it is not, or cannot be read.
pub(super) fn verify(file: &Path, trusted: Option<&str>) -> Result<(), Failure> {
    let seal = beside(file);
    let summary = fs::read(file).map_err(|error| cannot(file, &error))?;
    let text = fs::read(&seal).map_err(|error| cannot(&seal, &error))?;
    let text = String::from_utf8_lossy(&text);
    let key = certificate::verify(&summary, &text, trusted).map_err(|error| {
        let message = format!("{}: {error}", file.display());
        Failure::new(Exit::Failed, message, "take both files again from whoever measured")
    })?;
    let whose = if trusted.is_some() { "the key that is trusted" } else { "whose key that is, you have to know" };
    say(&format!("{} is as it was signed by key {key} ({whose})\n", file.display()))
}

/// Seconds since 1970 by the clock of the day; 0 where it stands before.
pub(super) fn unix_seconds() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs())
}

/// Where the signature of a file is.
fn beside(file: &Path) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(".sig");
    PathBuf::from(name)
}

fn usual_key() -> Result<PathBuf, Failure> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let folder = set("XDG_CONFIG_HOME").or_else(|| set("HOME").map(|home| home.join(".config")));
    let folder = folder.ok_or_else(|| {
        Failure::new(Exit::Usage, "HOME is not set: expected a place for the key, found none", "give --key FILE")
    })?;
    Ok(folder.join("screed/certificate.key"))
}

/// The key of a file; made on first use, for nobody else to read.
fn key_of(path: &Path) -> Result<SigningKey, Failure> {
    match fs::File::open(path) {
        Ok(mut file) => {
            let mode = file.metadata().map_err(|error| cannot(path, &error))?.permissions().mode();
            if mode & 0o077 != 0 {
                let message = format!("the key {} can be read by others (mode {:o})", path.display(), mode & 0o777);
                return Err(Failure::new(Exit::Failed, message, "make another one: who has read it can sign with it"));
            }
            let mut text = String::new();
            file.read_to_string(&mut text).map_err(|error| cannot(path, &error))?;
            let bytes = unhex::<32>(text.trim()).ok_or_else(|| {
                let message =
                    format!("{}: expected a key, 64 hexadecimal digits, found something else", path.display());
                Failure::new(Exit::Failed, message, "give another file with --key; one that is not there is made")
            })?;
            Ok(SigningKey::from_bytes(&bytes))
        }
        Err(error) if error.kind() == ErrorKind::NotFound => new_key(path),
        Err(error) => Err(cannot(path, &error)),
    }
}

fn new_key(path: &Path) -> Result<SigningKey, Failure> {
    let random = Path::new("/dev/urandom");
    let mut bytes = [0; 32];
    let read = fs::File::open(random).and_then(|mut file| file.read_exact(&mut bytes));
    read.map_err(|error| cannot(random, &error))?;
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(folder);
        made.map_err(|error| cannot(folder, &error))?;
    }
    let file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path);
    let written = file.and_then(|mut file| writeln!(file, "{}", hex(&bytes)));
    written.map_err(|error| cannot(path, &error))?;
    Ok(SigningKey::from_bytes(&bytes))
}

fn cannot(path: &Path, error: &std::io::Error) -> Failure {
    let message = format!("{} cannot be used: {error}", path.display());
    Failure::new(Exit::Failed, message, "check the path, the rights and the free space")
}
