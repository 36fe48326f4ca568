//! `screed wcet`

use super::args::WcetArgs;
use super::say;
use crate::config::{self, Cell, Realtime};
use crate::failure::{Exit, Failure};
use crate::wcet::report::{self, Report};
use crate::wcet::run::{self, Wishes};
use crate::wcet::{WcetError, counts, cycle, page};
use screed_tape::vectors::{COURSES, Course};
use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::time::Instant;

/// Reports how long a cycle can take.
///
/// # Errors
/// A profiler that is missing, a cell file, files that cannot be written.
pub fn run(args: &WcetArgs) -> Result<(), Failure> {
    if let Some(list) = &args.play {
        counts::play(&counts::read_list(list)?);
        return Ok(());
    }
    if let Some(cycles) = args.play_cycles {
        return Ok(cycle::play(cycles)?);
    }
    if args.figures {
        return say(&figures()?);
    }
    let cell = match &args.cell {
        Some(path) => config::load(path)?,
        None => Cell::demo(500)?,
    };
    let realtime = Realtime { cpu: args.cpu.or(cell.realtime.cpu), ..cell.realtime };
    let wishes = Wishes { quick: args.quick, realtime, rounds: args.rounds };
    // Before anything is measured: a folder that cannot be written is told at once.
    fs::create_dir_all(&args.out).map_err(|error| unwritable(&args.out, &error))?;
    let mut raw = String::new();
    let began = Instant::now();
    let report = run::run(&wishes, &mut raw, &mut |what| {
        let _ = writeln!(io::stderr(), "{:>5} s  {what}", began.elapsed().as_secs());
    })?;
    let json = serde_json::to_string_pretty(&report)
        .map_err(|error| Failure::new(Exit::Failed, error.to_string(), "report this"))?;
    let html = page::html(&report);
    for (name, text) in [("wcet.html", &html), ("wcet.json", &json), ("samples.csv", &raw)] {
        let path = args.out.join(name);
        fs::write(&path, text).map_err(|error| unwritable(&path, &error))?;
    }
    if args.json { say(&(json + "\n")) } else { say(&summary(&report, &args.out)) }
}

/// A line for each arm and class: `figure|arm|class|vectors|min|max|course and tick`, as the firmware prints it.
fn figures() -> Result<String, WcetError> {
    let courses: Vec<Course> = (0..COURSES).map(Course::of).collect();
    let counted = counts::count(&courses)?;
    let mut out = format!("rustc|{}\n", env!("SCREED_RUSTC"));
    for row in report::instructions(&counted, &courses) {
        let course = row.course.map_or("?".to_owned(), |course| course.to_string());
        let tick = row.worst.rsplit(' ').next().unwrap_or("?");
        let report::Instructions { arm, class, vectors, min, max, .. } = row;
        out += &format!("figure|{arm}|{class}|{vectors}|{min}|{max}|course {course} tick {tick}\n");
    }
    Ok(out)
}

fn summary(report: &Report, out: &Path) -> String {
    let mut text = format!("{:<30} {:<13} {:>7} {:>11} {:>11}\n", "instructions", "class", "vectors", "mean", "max");
    for row in &report.instructions {
        text += &format!("{:<30} {:<13} {:>7} {:>11.0} {:>11}\n", row.arm, row.class, row.vectors, row.mean, row.max);
    }
    for response in &report.responses {
        text += &format!(
            "every {} ms: {} misses in {} cycles, p99.9 {} µs, max {} µs ({})\n",
            response.period_ns / 1_000_000,
            response.misses,
            response.cycles,
            response.response.p999_ns / 1000,
            response.response.max_with_stalls_ns / 1000,
            report.scheduling
        );
    }
    text + &format!("the report: {}\n", out.join("wcet.html").display())
}

fn unwritable(path: &Path, error: &io::Error) -> Failure {
    Failure::new(Exit::Failed, format!("{} cannot be written: {error}", path.display()), "give another --out")
}

impl From<WcetError> for Failure {
    fn from(error: WcetError) -> Self {
        Self::told(Exit::Failed, error.to_string())
    }
}
