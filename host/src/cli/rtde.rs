//! `screed rtde`

use super::args::RtdeRecordArgs;
use super::say;
use crate::failure::{Exit, Failure};
use crate::link::rtde::file::{self, Recipe, RecipeFile};
use crate::run::rtde_record::{self, RecordOptions, Recorded};
use crate::run::signal;
use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::Path;

/// The outputs of a recipe as CSV, until the time is up or Ctrl-C.
pub fn record(args: &RtdeRecordArgs) -> Result<(), Failure> {
    if let Some(path) = args.out.as_ref().filter(|path| !args.force && path.is_file()) {
        let message = format!("{} is there already", path.display());
        return Err(Failure::new(Exit::Usage, message, "give another name, or --force to overwrite it"));
    }
    if let Some(folder) = args.out.as_ref().and_then(|path| path.parent()).filter(|folder| *folder != Path::new(""))
        && !folder.is_dir()
    {
        let message = format!("{} is no folder", folder.display());
        return Err(Failure::new(Exit::Failed, message, "make it, or choose a folder that exists"));
    }
    let file = file::load(&args.config)?;
    let recipe = recipe(&file, &args.recipe)?;
    signal::catch_stop()?;
    let (host, port) = &args.address;
    let options = RecordOptions {
        host,
        port: *port,
        file: &file,
        recipe,
        rate_hz: args.rate,
        seconds: args.seconds.map(|seconds| seconds.as_secs_f64()),
        stop: signal::stop_requested,
        progress: if io::stderr().is_terminal() { tell } else { |_, _| {} },
    };
    match &args.out {
        None => {
            let recorded = rtde_record::record(&options, &mut BufWriter::new(io::stdout().lock()))?;
            // The table is whole, also where nobody hears this.
            let _ = write!(io::stderr(), "{}", summary(&recorded, args.rate));
            Ok(())
        }
        Some(path) => {
            let mut out = BufWriter::new(Late { path, file: None });
            say(&summary(&rtde_record::record(&options, &mut out)?, args.rate))
        }
    }
}

/// A file that is made when something is written to it: a record that fails before leaves none.
struct Late<'a> {
    path: &'a Path,
    file: Option<File>,
}

impl Write for Late<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.file.is_none() {
            let named = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", self.path.display()));
            self.file = Some(File::create(self.path).map_err(named)?);
        }
        self.file.as_mut().map_or(Ok(0), |file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.as_mut().map_or(Ok(()), File::flush)
    }
}

/// How far it is, in place.
fn tell(packages: u64, seconds: f64) {
    let _ = write!(io::stderr(), "\r\x1b[K{packages} packages, {seconds:.0} s; Ctrl-C ends it\r");
}

fn recipe<'a>(file: &'a RecipeFile, key: &str) -> Result<&'a Recipe, Failure> {
    file.recipe(key).ok_or_else(|| {
        let keys: Vec<_> = file.recipes.iter().map(|recipe| recipe.key.as_str()).collect();
        let message = format!("{} has no recipe {key}: expected one of {}", file.name, keys.join(", "));
        Failure::new(Exit::Usage, message, "give its key with --recipe")
    })
}

fn summary(recorded: &Recorded, rate_hz: u32) -> String {
    let Recorded { packages, controller, protocol, steps } = recorded;
    let software = controller.map_or_else(|| "unknown".to_owned(), |version| version.to_string());
    let mut text = format!("controller software {software}, RTDE protocol {}\n{packages} packages", protocol.number());
    match steps.period() {
        None => text += ", too few to tell their rate\n",
        Some(period) => {
            let found = 1.0 / period;
            text += &format!(" at {found:.1} Hz, {} skipped by their time stamps", steps.skipped());
            text += &match steps.irregular() {
                0 => "\n".to_owned(),
                irregular => format!(", {irregular} steps of time that are no multiple of the least\n"),
            };
            if (found / f64::from(rate_hz) - 1.0).abs() > 0.01 {
                text += &format!("{rate_hz} Hz were asked for\n");
            }
        }
    }
    text
}
