//! Instructions of every kind of call into the kernel, counted one by one: mean, worst, and which call was the worst.
//!
//! ```text
//! cargo bench -p screed-benches --bench tick
//! ```
//!
//! Runs itself once more under `valgrind --tool=callgrind`, which counts exactly and repeatably. A wall clock only says in
//! which class a cycle is on this machine.

use screed_benches::scenario::{self, Call};
use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

/// The argument with which this program plays its scenario and says nothing.
const PLAY: &str = "--play";

/// The module whose functions are measured, as the profiler names it.
const MEASURED: &str = "screed_benches::scenario::measured::";

/// Cycles under the wall clock.
const CYCLES: u32 = 2_000_000;

fn main() -> ExitCode {
    if std::env::args().nth(1).as_deref() == Some(PLAY) {
        std::hint::black_box(scenario::run());
        return ExitCode::SUCCESS;
    }
    match measure() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn measure() -> Result<(), Box<dyn Error>> {
    let calls = scenario::run();
    let counts = counts()?;
    if calls.len() != counts.len() {
        return Err(format!("{} calls, but the profiler saw {}", calls.len(), counts.len()).into());
    }
    println!("{:<27} {:>6} {:>9} {:>9} {:>8}  worst call", "instructions", "calls", "mean", "worst", "a byte");
    for (class, rows) in by_class(&calls, &counts) {
        let sum: u64 = rows.iter().map(|row| row.1).sum();
        let bytes: usize = rows.iter().map(|row| row.0.bytes).sum();
        let mean = sum as f64 / rows.len() as f64;
        let a_byte = if bytes == 0 { String::new() } else { format!("{:.1}", sum as f64 / bytes as f64) };
        if let Some((worst, count)) = rows.iter().max_by_key(|row| row.1) {
            println!("{class:<27} {:>6} {mean:>9.0} {count:>9} {a_byte:>8}  {}", rows.len(), worst.what);
        }
    }
    let start = Instant::now();
    scenario::stream(CYCLES);
    let cycle = start.elapsed().as_nanos() as f64 / f64::from(CYCLES);
    println!(
        "\na cycle of motion at 100 % (its share of receive, tick, transmit): {cycle:.0} ns by the wall clock, warm"
    );
    Ok(())
}

/// Runs this program under the profiler: the instructions of each measured call, in order.
fn counts() -> Result<Vec<u64>, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("counts");
    let status = Command::new("valgrind")
        .args(["--tool=callgrind", "--combine-dumps=yes", "--collect-atstart=no"])
        .arg("--dump-line=no")
        .arg(format!("--toggle-collect={MEASURED}*"))
        .args(["receive", "tick", "transmit"].map(|name| format!("--dump-after={MEASURED}{name}")))
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(std::env::current_exe()?)
        .arg(PLAY)
        .stderr(Stdio::null())
        .status()
        .map_err(|error| format!("valgrind does not start: {error}; install it (apt-get install valgrind)"))?;
    if !status.success() {
        return Err(format!("valgrind: {status}").into());
    }
    let text = fs::read_to_string(&file)?;
    let totals = text.lines().filter_map(|line| line.strip_prefix("summary: "));
    let mut counts = totals.map(|total| total.trim().parse()).collect::<Result<Vec<u64>, _>>()?;
    // What ran behind the last measured call: the end of the program.
    counts.pop();
    Ok(counts)
}

fn by_class<'a>(calls: &'a [Call], counts: &[u64]) -> BTreeMap<&'a str, Vec<(&'a Call, u64)>> {
    let mut classes = BTreeMap::<_, Vec<_>>::new();
    for (call, count) in calls.iter().zip(counts) {
        classes.entry(call.class).or_default().push((call, *count));
    }
    classes
}
