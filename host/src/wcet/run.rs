//! Makes a report: measures one thing after the other, and says what it is at.

use super::WcetError;
use super::counts::{self, Counted};
use super::cycle;
use super::disturb::{self, CoRunner, Disturber};
use super::evt::Evt;
use super::figures::Figures;
use super::machine::Machine;
use super::report::{self, BUDGETS_NS, CycleInstructions, EvtOf, Painted, Report};
use super::response::{self, Parts, Response};
use super::search::{self, Effort};
use super::stack;
use super::times::{self, Condition, STALL_NS, Sample, Summary};
use crate::config::Realtime;
use crate::run::realtime;
use screed_tape::vectors::{ARMS, COURSES, Class, Course};
use std::fmt::Write as _;
use std::time::Instant;

/// What to measure with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wishes {
    /// Fewer of everything that takes long.
    pub quick: bool,
    /// Priority and processor of the paced part; the processor of all of it.
    pub realtime: Realtime,
    /// Rounds of the search instead of the usual count.
    pub rounds: Option<usize>,
}

/// How much of everything.
struct Amount {
    timed_courses: usize,
    cold_courses: usize,
    cycles: usize,
    counted_cycles: usize,
    repeats: usize,
    paced: [usize; BUDGETS_NS.len()],
    effort: Effort,
}

const FULL: Amount = Amount {
    timed_courses: 400,
    cold_courses: 100,
    cycles: 50_000,
    counted_cycles: 4000,
    repeats: 10_000,
    paced: [2000, 10_000, 20_000],
    effort: Effort { arms: ARMS.len(), rounds: 8, tries: 2 },
};

const QUICK: Amount = Amount {
    timed_courses: 60,
    cold_courses: 24,
    cycles: 6000,
    counted_cycles: 1000,
    repeats: 2000,
    paced: [200, 1000, 2000],
    effort: Effort { arms: 1, rounds: 2, tries: 2 },
};

/// Columns of the raw samples.
pub const RAW_HEADER: &str = "what,condition,class,index,ns\n";

/// Measures everything; the raw samples are added to `raw`, a line each. Real-time scheduling is entered for the last part, and kept.
///
/// # Errors
/// [`WcetError`].
pub fn run(wishes: &Wishes, raw: &mut String, say: &mut impl FnMut(&str)) -> Result<Report, WcetError> {
    let amount = if wishes.quick { &QUICK } else { &FULL };
    raw.push_str(RAW_HEADER);
    // Counting and search take long, and use every processor: a thread of its own tries the one that is named.
    if let Some(cpu) = wishes.realtime.cpu {
        std::thread::scope(|scope| scope.spawn(|| bind(cpu)).join())
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
    }
    let committed = Figures::committed().map_err(WcetError::Figures)?;
    let machine = Machine::here(&wishes.realtime)?;
    let courses: Vec<Course> = (0..COURSES).map(Course::of).collect();
    say(&format!("instructions: {} courses under valgrind", courses.len()));
    let counted = counts::count(&courses)?;
    let instructions = report::instructions(&counted, &courses);
    say(&format!("instructions: {} cycles of a print under valgrind", amount.counted_cycles));
    let cycle_instructions = CycleInstructions::of(&counts::count_cycles(amount.counted_cycles)?);
    let cycle_instructions = cycle_instructions.ok_or_else(|| WcetError::Print("no cycle was counted".to_owned()))?;
    let effort = Effort { rounds: wishes.rounds.unwrap_or(amount.effort.rounds), ..amount.effort };
    let search = search::search(&counted, effort, &mut *say)?;
    say("stack: painted");
    let deepest = stack::high_water(&courses)?;
    let painted = Class::ALL.iter().zip(deepest).map(|(class, bytes)| Painted { class: class.name(), bytes }).collect();
    if let Some(cpu) = wishes.realtime.cpu {
        bind(cpu)?;
    }
    let times = timed(amount, wishes, raw, say)?;
    let mut evt = Vec::new();
    let worst = counted.iter().filter(|counted| counted.call.arm == 0 && counted.call.class == Class::Rates);
    if let Some(worst) = worst.max_by_key(|counted| counted.call.count) {
        say(&format!("extreme values: the worst tick {} times", amount.repeats));
        evt.push(repeated(worst, amount.repeats, raw));
    }
    say("the paced loop");
    let (scheduling, responses, of_responses) = paced(amount, wishes, raw, say)?;
    evt.extend(of_responses);
    let margins = margins(&times, &responses);
    let ticks = counted.iter().filter(|counted| counted.call.class.is_tick()).count();
    Ok(Report {
        quick: wishes.quick,
        machine,
        scheduling,
        courses: courses.len(),
        ticks,
        loops: report::loops(),
        instructions,
        cycle_instructions,
        committed,
        times,
        stall_ns: STALL_NS,
        search,
        painted,
        evt,
        responses,
        margins,
    })
}

fn bind(cpu: usize) -> Result<(), WcetError> {
    disturb::bind(cpu).map_err(|error| WcetError::Processor { cpu, error })
}

/// Tick and cycle under every condition.
fn timed(
    amount: &Amount,
    wishes: &Wishes,
    raw: &mut String,
    say: &mut impl FnMut(&str),
) -> Result<Vec<Summary>, WcetError> {
    let mut summaries = Vec::new();
    for condition in Condition::ALL {
        say(&format!("times: {}", condition.name()));
        let cold = matches!(condition, Condition::Cold | Condition::ColdBranches);
        let count = if cold { amount.cold_courses } else { amount.timed_courses };
        // The first arm alone: the others differ in what they count, and that is counted. The committed ones with the worst known, then
        // others.
        let committed = (0..COURSES).map(Course::of).filter(|course| course.arm() == 0);
        let others = (0..).map(|index| Course::of_arm(0, index));
        let courses: Vec<Course> = committed.chain(others).take(count).collect();
        let samples = times::measure(&courses, condition, wishes.realtime.cpu)?;
        for sample in &samples {
            line(raw, "tick", condition, sample);
        }
        for class in Class::ALL {
            let mine = samples.iter().filter(|sample| sample.class == Some(class)).map(|sample| sample.ns);
            summaries.extend(Summary::of(class.name(), condition, mine));
        }
        let cycles = if cold { amount.cycles / 20 } else { amount.cycles };
        let times = cycles_timed(condition, cycles, wishes.realtime.cpu)?;
        for (index, ns) in (0..).zip(&times) {
            line(raw, "cycle", condition, &Sample { class: None, index, ns: *ns });
        }
        summaries.extend(Summary::of("whole cycle", condition, times.into_iter()));
    }
    Ok(summaries)
}

fn cycles_timed(condition: Condition, cycles: usize, cpu: Option<usize>) -> Result<Vec<u64>, WcetError> {
    let mut disturber = Disturber::new(condition, true)?;
    let _beside = match condition {
        Condition::CoRunner => Some(CoRunner::start(cpu)?),
        _ => None,
    };
    let origin = Instant::now();
    times::with_room_above(|| cycle::measure(cycles, || disturber.disturb(), || times::nanos(origin.elapsed())))
}

fn repeated(worst: &Counted, count: usize, raw: &mut String) -> EvtOf {
    let times = times::repeat(worst, count);
    for (index, ns) in (0..).zip(&times) {
        let sample = Sample { class: Some(worst.call.class), index, ns: *ns };
        line(raw, "repeated tick", Condition::Warm, &sample);
    }
    let samples: Vec<f64> = times.iter().map(|ns| *ns as f64).collect();
    let what = format!("the tick with the most instructions of {}, warm, {count} times in a row", ARMS[0]);
    EvtOf { what, evt: Evt::of(&samples) }
}

type Paced = (String, Vec<Response>, Vec<EvtOf>);

fn paced(amount: &Amount, wishes: &Wishes, raw: &mut String, say: &mut impl FnMut(&str)) -> Result<Paced, WcetError> {
    let scheduling = realtime::enter(&wishes.realtime);
    let (mut responses, mut evt) = (Vec::new(), Vec::new());
    for (period, cycles) in BUDGETS_NS.into_iter().zip(amount.paced) {
        say(&format!("paced: {cycles} cycles of {} ms", period / 1_000_000));
        let parts = response::measure(period, cycles)?;
        for (index, Parts { wake_up, cycle, input_output, response }) in parts.iter().enumerate() {
            let ms = period / 1_000_000;
            for (what, ns) in
                [("wake-up", wake_up), ("cycle", cycle), ("input and output", input_output), ("response", response)]
            {
                let _ = writeln!(raw, "paced {what},{ms} ms,,{index},{ns}");
            }
        }
        responses.extend(Response::of(period, &parts));
        let samples: Vec<f64> = parts.iter().map(|parts| parts.response as f64).collect();
        let what = format!("response every {} ms", period / 1_000_000);
        evt.push(EvtOf { what, evt: Evt::of(&samples) });
    }
    let stamp = if scheduling.realtime { "hard-timed".to_owned() } else { format!("NON-RT: {}", scheduling.note) };
    Ok((stamp, responses, evt))
}

/// Of the largest tick, cycle and response, under the stall rule and with stalls.
fn margins(times: &[Summary], responses: &[Response]) -> Vec<report::Margin> {
    let mut margins = Vec::new();
    for condition in Condition::ALL {
        for (what, whole) in [("tick", false), ("whole cycle", true)] {
            let mine = || {
                let mine = times.iter().filter(|summary| summary.condition == condition);
                mine.filter(|summary| (summary.what == "whole cycle") == whole)
            };
            let largest = mine().map(|summary| summary.max_ns).max();
            let of_all = mine().map(|summary| summary.max_with_stalls_ns).max();
            let what = format!("{what}, {}", condition.name());
            margins.extend(largest.zip(of_all).map(|(largest, of_all)| report::margin(&what, largest, of_all)));
        }
    }
    for Response { period_ns, response, .. } in responses {
        let what = format!("response every {} ms", period_ns / 1_000_000);
        margins.push(report::margin(&what, response.max_ns, response.max_with_stalls_ns));
    }
    margins
}

fn line(raw: &mut String, what: &str, condition: Condition, sample: &Sample) {
    let class = sample.class.map_or("", Class::name);
    let _ = writeln!(raw, "{what},{},{class},{},{}", condition.name().replace(',', ""), sample.index, sample.ns);
}
