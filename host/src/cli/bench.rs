//! `screed bench`

use super::args::{BenchCommand, Fig6Args};
use super::say;
use crate::bench::base;
use crate::bench::fig6::{self, Case, Fig6Error, JERK_TIMES, Score, SetUp, plot, report};
use crate::bench::servoj::{self, ServojError};
use crate::failure::{Exit, Failure};

/// Runs one of the published experiments.
pub fn run(command: &BenchCommand) -> Result<(), Failure> {
    match command {
        BenchCommand::Fig6(args) => fig6(args),
        BenchCommand::Servoj(args) => servoj(args.json),
        BenchCommand::Base(args) => {
            let scores = base::run(args.plants)?;
            say(&if args.json { format!("{}\n", base::report::json(&scores)) } else { base::report::table(&scores) })
        }
    }
}

fn fig6(args: &Fig6Args) -> Result<(), Failure> {
    let set_up = SetUp::parse(screed_fixtures::FIG6)?;
    if args.tune {
        for case in &set_up.cases {
            let try_one = |time| {
                let case = Case { jerk_time_s: time, ..case.clone() };
                Ok((time, Score::of(&set_up, &case, set_up.seeds.tune)?))
            };
            let tried = JERK_TIMES.into_iter().map(try_one).collect::<Result<Vec<_>, Fig6Error>>()?;
            say(&report::tuning(case, &tried))?;
        }
        return Ok(());
    }
    let score = |case| Ok((case, Score::of(&set_up, case, set_up.seeds.score)?));
    let scores = set_up.cases.iter().map(score).collect::<Result<Vec<_>, Fig6Error>>()?;
    if let (Some(path), Some(case)) = (&args.plot, set_up.cases.first()) {
        let seed = set_up.seeds.score[0];
        let drawing = plot::svg(case, seed, &fig6::run(&set_up, case, seed)?);
        std::fs::write(path, drawing).map_err(|error| {
            let message = format!("cannot write {}: {error}", path.display());
            Failure::new(Exit::Failed, message, "choose a folder that exists and can be written")
        })?;
    }
    say(&if args.json { format!("{}\n", report::json(&scores)) } else { report::table(&scores) })
}

fn servoj(json: bool) -> Result<(), Failure> {
    let score = |case| Ok((case, servoj::run(&case)?));
    let scores = servoj::cases().into_iter().map(score).collect::<Result<Vec<_>, ServojError>>()?;
    say(&if json { format!("{}\n", servoj::report::json(&scores)) } else { servoj::report::table(&scores) })
}

impl From<Fig6Error> for Failure {
    fn from(error: Fig6Error) -> Self {
        Self::told(Exit::Failed, error.to_string())
    }
}
