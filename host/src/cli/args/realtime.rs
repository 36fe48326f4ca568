//! Of the commands that look at the machine.

use super::seconds;
use std::path::PathBuf;
use std::time::Duration;

/// `screed doctor`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct DoctorArgs {
    /// The cell file whose priority and processor are meant; without it, the demo's
    #[arg(long, value_name = "FILE.toml")]
    pub cell: Option<PathBuf>,
    /// The findings as JSON
    #[arg(long)]
    pub json: bool,
}

/// What a latency is measured against.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Yardstick {
    /// cyclictest, of rt-tests
    Cyclictest,
}

/// `screed latency`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct LatencyArgs {
    /// The cell file whose priority and processor are meant; without it, the demo's
    #[arg(long, value_name = "FILE.toml")]
    pub cell: Option<PathBuf>,
    /// The processor, instead of the cell file's
    #[arg(long, value_name = "N")]
    pub cpu: Option<usize>,
    /// Time between wake-ups
    #[arg(long, value_name = "MILLISECONDS", default_value = "1", value_parser = milliseconds)]
    pub period: Duration,
    /// How long to measure, each: wake-ups, and sensor in to wire out
    #[arg(long = "for", value_name = "SECONDS", default_value = "10", value_parser = seconds, conflicts_with_all = ["vs", "certificate"])]
    pub length: Duration,
    /// Alternate slices of 5 s with this program on the same processor and compare pair by pair
    #[arg(long, value_name = "PROGRAM")]
    pub vs: Option<Yardstick>,
    /// At least so many pairs of slices that count
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=200))]
    pub pairs: u32,
    /// At most so many pairs, where the interval stays wide
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=200))]
    pub pairs_max: u32,
    /// Measure for hours and write what it came to to this file, and its signature beside it, to FILE.sig
    #[arg(long, value_name = "FILE", conflicts_with = "vs")]
    pub certificate: Option<PathBuf>,
    /// How long that takes in all
    #[arg(long, value_name = "HOURS", default_value = "8", value_parser = hours, requires = "certificate")]
    pub hours: Duration,
    /// The key to sign with, made where there is none; without it, screed/certificate.key among the user's configurations
    #[arg(long, value_name = "FILE", requires = "certificate")]
    pub key: Option<PathBuf>,
    /// Say whether such a file is what was signed, and by which key
    #[arg(long, value_name = "FILE", conflicts_with_all = ["certificate", "vs", "length", "cell", "cpu", "period"])]
    pub verify: Option<PathBuf>,
    /// Only this key's signature counts
    #[arg(long, value_name = "KEY", requires = "verify")]
    pub trust: Option<String>,
    /// Go on, stamped NON-RT, where the system refuses real-time scheduling
    #[arg(long)]
    pub allow_non_rt: bool,
    /// The figures as JSON, histogram and pairs included
    #[arg(long)]
    pub json: bool,
}

fn hours(text: &str) -> Result<Duration, String> {
    let hours: f64 = text.parse().map_err(|_| "expected a number of hours".to_owned())?;
    if (0.001..=1000.0).contains(&hours) {
        Ok(Duration::from_secs_f64(hours * 3600.0))
    } else {
        Err("expected 0.001 to 1000 hours".to_owned())
    }
}

fn milliseconds(text: &str) -> Result<Duration, String> {
    let milliseconds: f64 = text.parse().map_err(|_| "expected a number of milliseconds".to_owned())?;
    if (0.1..=1000.0).contains(&milliseconds) {
        Ok(Duration::from_secs_f64(milliseconds * 1e-3))
    } else {
        Err("expected 0.1 to 1000 milliseconds".to_owned())
    }
}
