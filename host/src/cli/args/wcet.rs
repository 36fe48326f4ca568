//! Of the report on the worst case.

use std::path::PathBuf;

/// `screed wcet`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct WcetArgs {
    /// The folder for wcet.html, wcet.json and samples.csv
    #[arg(long, value_name = "FOLDER", default_value = "screed-wcet")]
    pub out: PathBuf,
    /// The cell file whose priority and processor are meant; without it, the demo's
    #[arg(long, value_name = "FILE.toml")]
    pub cell: Option<PathBuf>,
    /// The processor to measure on, instead of the cell file's
    #[arg(long, value_name = "N")]
    pub cpu: Option<usize>,
    /// Fewer samples and a short search: about two minutes on an idle machine
    #[arg(long)]
    pub quick: bool,
    /// Rounds of the search for the worst input
    #[arg(long, value_name = "N")]
    pub rounds: Option<usize>,
    /// Print the report as JSON, too
    #[arg(long)]
    pub json: bool,
    /// Count the instructions of the committed courses, print a line for each arm and class, and nothing else
    #[arg(long)]
    pub figures: bool,
    /// Run these courses and nothing else: what the profiler looks at
    #[arg(long, value_name = "FILE", hide = true)]
    pub play: Option<PathBuf>,
    /// Run so many cycles of a print and nothing else: what the profiler looks at
    #[arg(long, value_name = "N", hide = true)]
    pub play_cycles: Option<usize>,
}
