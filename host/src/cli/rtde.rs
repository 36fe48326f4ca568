//! `screed rtde`

use super::args::RtdeRecordArgs;
use super::say;
use crate::failure::{Exit, Failure};
use crate::link::rtde::file::{self, Recipe, RecipeFile};
use crate::run::rtde_record::{self, RecordOptions, Recorded};
use crate::run::signal;
use std::fs::File;
use std::io::{self, BufWriter, Write};

/// The outputs of a recipe as CSV, until the time is up or Ctrl-C.
pub fn record(args: &RtdeRecordArgs) -> Result<(), Failure> {
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
    };
    match &args.out {
        None => {
            let recorded = rtde_record::record(&options, &mut BufWriter::new(io::stdout().lock()))?;
            // The table is whole, also where nobody hears this.
            let _ = write!(io::stderr(), "{}", summary(&recorded, args.rate));
            Ok(())
        }
        Some(path) => {
            let out = File::create(path).map_err(|error| {
                let message = format!("cannot create {}: {error}", path.display());
                Failure::new(Exit::Failed, message, "check the path, the rights and the free space")
            })?;
            say(&summary(&rtde_record::record(&options, &mut BufWriter::new(out))?, args.rate))
        }
    }
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
