//! `screed latency`

mod certify;

use super::args::{LatencyArgs, Yardstick};
use super::say;
use crate::config::{self, Cell, Realtime};
use crate::doctor::Diagnosis;
use crate::failure::{Exit, Failure};
use crate::latency::{Comparison, Judged, Pair, Rule, Summary};
use crate::run::realtime;
use crate::run::sensor_wire::{self, Measured, Wire};
use crate::run::wake::{self, Pace};
use serde::Serialize;
use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

/// How long a slice of a comparison lasts.
const SLICE: Duration = Duration::from_secs(5);

/// What is printed.
#[derive(Serialize)]
struct Report {
    period_us: u128,
    priority: u8,
    cpu: Option<usize>,
    /// "real time", or "NON-RT" with what was refused.
    scheduling: &'static str,
    scheduling_note: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    ours: Option<Summary>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sensor_to_wire: Option<Wire>,
    #[serde(skip_serializing_if = "Option::is_none")]
    versus: Option<Judged>,
}

/// Measures how late the timer-paced loop wakes, and how long `screed-rt` takes from sensor in to wire out.
///
/// # Errors
/// A cell file, real time that is refused, a clock or a cyclictest that fails.
pub fn run(args: &LatencyArgs) -> Result<(), Failure> {
    if let Some(file) = &args.verify {
        return certify::verify(file, args.trust.as_deref());
    }
    let cell = match &args.cell {
        Some(path) => config::load(path)?,
        None => Cell::demo(125)?,
    };
    let wanted = Realtime { cpu: args.cpu.or(cell.realtime.cpu), ..cell.realtime };
    // What is refused, and what cannot be signed, is told before hours have gone by and before a file is made.
    if !args.allow_non_rt
        && let Some(note) = realtime::refused(&wanted)
    {
        return Err(no_real_time(&note));
    }
    let certificate =
        args.certificate.as_deref().map(|file| certify::prepare(file, args.key.as_deref())).transpose()?;
    let length = if certificate.is_some() { args.hours / 2 } else { args.length };
    let began = certify::unix_seconds();
    // First: the processes that this starts are bound to no processor, as long as this one is not.
    let sensor_to_wire = match args.vs {
        Some(_) => None,
        None => Some(sensor_wire::measure(&Measured {
            rate_hz: cell.link.rate_hz,
            realtime: wanted,
            length,
            allow_non_rt: args.allow_non_rt,
        })?),
    };
    let scheduling = realtime::enter(&wanted);
    if !scheduling.realtime && !args.allow_non_rt {
        return Err(no_real_time(&scheduling.note));
    }
    let mut report = Report {
        period_us: args.period.as_micros(),
        priority: wanted.priority,
        cpu: wanted.cpu,
        scheduling: if scheduling.realtime { "real time" } else { "NON-RT" },
        scheduling_note: scheduling.note,
        ours: None,
        sensor_to_wire,
        versus: None,
    };
    match args.vs {
        None => {
            let (histogram, missed) = wake::ours(&Pace { period: args.period, length }).map_err(failed)?;
            report.ours = Summary::of(&histogram, missed);
        }
        Some(Yardstick::Cyclictest) => report.versus = Some(compare(args, &wanted)?),
    }
    if let Some(prepared) = certificate {
        certify::write(&prepared, &report, &wanted, began, length)?;
    }
    if args.json {
        let text = serde_json::to_string_pretty(&report)
            .map_err(|error| Failure::new(Exit::Failed, error.to_string(), "report this"))?;
        return say(&(text + "\n"));
    }
    say(&text(&report))
}

/// Slices of both in turns, until the interval is narrow or there are enough.
fn compare(args: &LatencyArgs, wanted: &Realtime) -> Result<Judged, Failure> {
    let Some(cpu) = wanted.cpu else {
        return Err(Failure::new(
            Exit::Usage,
            "a comparison needs both on one processor: expected --cpu or [realtime] cpu, found neither",
            "name one, the last of the machine for instance",
        ));
    };
    let pace = Pace { period: args.period, length: SLICE };
    let rule = Rule::new(SLICE.as_secs_f64(), args.pairs, args.pairs_max);
    let judged = |found| Judged::of(found, rule, &Diagnosis::of(Path::new("/"), wanted));
    let (mut pairs, mut discarded) = (Vec::new(), 0);
    for round in 0..args.pairs_max {
        let ours = || wake::ours(&pace).map(|(histogram, _)| histogram);
        let theirs = || wake::cyclictest(&pace, wanted.priority, cpu);
        let (ours, theirs) = if round % 2 == 0 {
            let first = ours().map_err(failed)?;
            (first, theirs().map_err(failed)?)
        } else {
            let first = theirs().map_err(failed)?;
            (ours().map_err(failed)?, first)
        };
        match Pair::of(&ours, &theirs) {
            Some(pair) => pairs.push(pair),
            None => discarded += 1,
        }
        if let Some(found) = Comparison::of(pairs.clone(), discarded) {
            let difference = found.median_difference_us;
            let _ = writeln!(
                io::stderr(),
                "pair {} of {} to {}: medians differ by {:+.1} µs [{:+.1}, {:+.1}]",
                round + 1,
                args.pairs,
                args.pairs_max,
                difference.value,
                difference.low,
                difference.high
            );
            if rule.is_met(&found) {
                return Ok(judged(found));
            }
        }
    }
    Comparison::of(pairs, discarded).map(judged).ok_or_else(|| {
        Failure::new(Exit::Failed, "every pair of slices met a stall and was discarded", "measure on a quieter machine")
    })
}

fn text(report: &Report) -> String {
    let Report { period_us, priority, scheduling, scheduling_note, ours, sensor_to_wire, versus, .. } = report;
    let cpu = report.cpu.map_or("any processor".to_owned(), |cpu| format!("processor {cpu}"));
    let mut text = format!("{scheduling}, every {period_us} µs, SCHED_FIFO {priority}, {cpu}\n");
    if !scheduling_note.is_empty() {
        text += &format!("  {scheduling_note}\n");
    }
    if let Some(ours) = ours {
        text += &format!("  wake-ups {ours}\n");
    }
    if let Some(wire) = sensor_to_wire {
        let Wire { rate_hz, scheduling, latency, overruns, overrun_counter_max, memory } = wire;
        text += &format!("  sensor in to wire out, {rate_hz} Hz, {scheduling}: {latency}\n");
        text += &format!(
            "    {overruns} overruns, counter at most {overrun_counter_max}; {} allocations, {} page faults\n",
            memory.allocations,
            memory.faults_minor + memory.faults_major
        );
    }
    if let Some(versus) = versus {
        text += &versus.to_string();
    }
    text
}

fn no_real_time(note: &str) -> Failure {
    let remedy = "grant what was refused (screed doctor), or measure stamped NON-RT with --allow-non-rt";
    Failure::new(Exit::NotRealTime, format!("no real time: {note}"), remedy)
}

fn failed(error: io::Error) -> Failure {
    Failure::new(Exit::Failed, error.to_string(), "mend that, then measure again")
}
