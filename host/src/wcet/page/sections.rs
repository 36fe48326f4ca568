//! The page's sections, one for each point.

use super::plots::{self, Series, grouped, time};
use super::{escaped, table};
use crate::wcet::evt::{self, LEVEL, Verdict};
use crate::wcet::figures::{ByArm, StackFigure};
use crate::wcet::report::{BUDGETS_NS, CYCLES_PER_INSTRUCTION, Instructions, MARGIN_FACTOR, Report};
use crate::wcet::times::{Condition, Summary};
use screed_tape::vectors::{ARMS, Class, DEPTH, GENES, RANDOM_COURSES, RING, SEED, USUAL_POSES, WORST};
use std::collections::{BTreeMap, BTreeSet};

/// Aim for the largest closed-loop tick without replay on a Cortex-M7 (instructions).
const M7_AIM: u64 = 150_000;

/// Ticks with the loop, without replay and without a burst.
const WITHOUT_REPLAY: [Class; 4] = [Class::Motion, Class::Pose, Class::Rates, Class::Fault];

fn ns(value: u64) -> String {
    time(value as f64)
}

/// The most of an arm's ticks with the loop, without replay and without a burst.
fn without_replay(by_arm: &ByArm, arm: &str) -> u64 {
    let most = WITHOUT_REPLAY.iter().filter_map(|class| by_arm.get(arm)?.get(class.name())).map(|figure| figure.max);
    most.max().unwrap_or(0)
}

/// Which arms hold the aim on the Cortex-M7, by the committed figures.
fn aim(report: &Report) -> String {
    let m7 = &report.committed.cortex_m7;
    let most = m7.keys().map(|arm| (arm, without_replay(m7, arm)));
    let (held, missed): (Vec<_>, Vec<_>) = most.partition(|(_, most)| *most <= M7_AIM);
    let told = |arms: &[(&String, u64)]| {
        let arms = arms.iter().map(|(arm, most)| format!("{} {}", escaped(arm), grouped(*most)));
        arms.collect::<Vec<_>>().join(", ")
    };
    let verdict = if missed.is_empty() {
        "<span class=\"yes\">every arm</span>".to_owned()
    } else {
        format!("{}; <span class=\"no\">beyond it</span>: {}", told(&held), told(&missed))
    };
    format!(
        "<p>The aim of {} instructions for a tick without replay on the Cortex-M7, at most {USUAL_POSES} poses, is held by {verdict}. With 3 to \
         16 poses a tick of {} takes {}, with replay {}. \"frames in\" comes on top of a tick: as many bytes as are taken between two ticks.</p>\n",
        grouped(M7_AIM),
        escaped(ARMS[0]),
        grouped(m7_of(report, Class::Burst)),
        grouped(m7_of(report, Class::Replay))
    )
}

/// The most of this run's ticks of an arm in these classes.
fn most(report: &Report, arm: &str, classes: &[Class]) -> u64 {
    let names: Vec<_> = classes.iter().map(|class| class.name()).collect();
    let mine = report.instructions.iter().filter(|row| row.arm == arm && names.contains(&row.class));
    mine.map(|row| row.max).max().unwrap_or(0)
}

/// A drawing that scrolls where a screen is too narrow for it.
fn scrolled(drawing: &str) -> String {
    format!("<div class=\"wide\">{drawing}</div>\n")
}

fn m7_of(report: &Report, class: Class) -> u64 {
    let classes = report.committed.cortex_m7.get(ARMS[0]);
    classes.and_then(|classes| classes.get(class.name())).map_or(0, |figure| figure.max)
}

pub(super) fn head(report: &Report) -> String {
    let rt = if report.scheduling == "hard-timed" { "yes" } else { "no" };
    let largest = |condition: Condition| {
        let mine = report.times.iter().filter(|row| row.condition == condition && row.what != "whole cycle");
        mine.map(|row| row.max_ns).max().unwrap_or(0)
    };
    let m7 = without_replay(&report.committed.cortex_m7, ARMS[0]);
    let fitted = report.evt.iter().filter(|row| matches!(row.evt.verdict, Verdict::Fitted { .. })).count();
    let figures = [
        (grouped(most(report, ARMS[0], &WITHOUT_REPLAY)), "instructions, worst tick without replay or burst, x86-64"),
        (grouped(most(report, ARMS[0], &[Class::Replay, Class::Burst])), "instructions, worst tick with them, x86-64"),
        (grouped(m7), "instructions, worst tick without replay or burst, Cortex-M7"),
        (ns(largest(Condition::ColdBranches)), "largest tick seen, caches cold, branches thrashed"),
        (
            if fitted == 0 { "REFUSED".to_owned() } else { format!("{fitted} of {}", report.evt.len()) },
            "extreme value laws: rows of times that can carry one",
        ),
    ];
    let mut out = "<h1>How long a cycle of Screed can take</h1>\n".to_owned();
    out += &format!(
        "<p class=\"note\">{}. Screed {}, {}. Paced part: <span class=\"{rt}\">{}</span>.</p>\n<div class=\"big\">",
        if report.quick { "A quick report: fewer samples, a short search" } else { "A full report" },
        escaped(report.machine.version),
        escaped(report.machine.rustc),
        escaped(&report.scheduling)
    );
    for (figure, what) in figures {
        out += &format!("<div><b>{figure}</b><span>{what}</span></div>");
    }
    out += "</div>\n";
    if let Some(worst) = report.instructions.iter().max_by_key(|row| row.max) {
        out += &format!(
            "<p>These are of a {}. Of all arms and classes the most is {} instructions: {}, {}.</p>\n",
            escaped(ARMS[0]),
            grouped(worst.max),
            escaped(worst.arm),
            escaped(worst.class)
        );
    }
    out
}

pub(super) fn machine(report: &Report) -> String {
    let machine = &report.machine;
    let mono = |text: &str| format!("<span class=\"m\">{}</span>", escaped(text));
    let real_time = match machine.real_time {
        true => "<span class=\"yes\">nothing found that keeps this machine from holding a loop</span>".to_owned(),
        false => format!("<span class=\"no\">no: {}</span>", escaped(&machine.not_real_time.join("; "))),
    };
    let flags = if machine.rustflags.is_empty() { "none beyond the profile's" } else { &machine.rustflags };
    let rows = [
        ("program", mono(&machine.program)),
        ("SHA-256", mono(&machine.program_sha256)),
        ("compiler", mono(machine.rustc)),
        ("target", mono(machine.target)),
        ("profile", mono(&machine.profile)),
        ("flags", mono(flags)),
        ("processor", format!("{} × {}", machine.processors, escaped(&machine.processor))),
        ("kernel", mono(&machine.kernel)),
        ("its command line", mono(&machine.kernel_command_line)),
        ("real-time machine", real_time),
        ("paced part ran as", escaped(&report.scheduling)),
    ];
    let rows: Vec<_> = rows.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect();
    table(&["", ""], &rows, 2)
}

pub(super) fn inputs(report: &Report) -> String {
    let mut out = format!(
        "<p>{} courses with {} ticks: {RANDOM_COURSES} random ones of each of {} arms (seed {SEED}) and the {} worst that a search found. A \
         course is {GENES} bytes, of which everything follows: the arm; a posture in or beside (0, 1e-13 to 1e-3 rad) a singularity of \
         shoulder, elbow or wrist, two of them, or none, which the path leads through; speed, setpoints every 1, 2 or 4 ticks, rate 50 to 100 %; \
         deposit or travel; 0 to 16 poses a tick, 0 to 9 ticks late, in order and out of order, true or lying; rates or none; a \
         base that stands, drifts, jumps or goes too far; a ring of {RING} that runs empty or is filled until it refuses; frames whole, \
         broken, endless, refused, a whole budget of them; and one event: not a number, a robot that does not follow, is not ready, is lost, \
         a new host, an extruder's fault, quit, a late tick, a tick at the same time, dropout, hold, stop, another rate.</p>\n",
        report.courses,
        grouped(report.ticks as u64),
        ARMS.len(),
        WORST.len()
    );
    out += &format!("<p>An estimator remembers {DEPTH} ticks here. Arms: {}.</p>\n", escaped(&ARMS.join("; ")));
    let coverage = &report.committed.coverage;
    let share =
        |[taken, all]: [u64; 2]| format!("{taken} of {all} ({:.1} %)", 100.0 * taken as f64 / all.max(1) as f64);
    out += &format!(
        "<h3>Coverage of the kernel's code by the courses</h3><p>Branches {}, lines {}; printed by <code>{}</code>. Files with the most branch \
         sides that no course takes:</p>\n",
        share(coverage.branches),
        share(coverage.lines),
        escaped(&coverage.command)
    );
    let mut short: Vec<_> = coverage.short.iter().collect();
    short.sort_by_key(|(_, [taken, all])| std::cmp::Reverse(all - taken));
    let rows: Vec<_> = short.into_iter().take(12).map(|(file, counts)| vec![escaped(file), share(*counts)]).collect();
    out += &table(&["file", "branch sides taken"], &rows, 1);
    out += &format!(
        "<h3>Loop bounds</h3><p>Every loop of the kernel has a bound known when it is built; a test holds the list to the source.</p>\n\
         <details><summary>all {} rows</summary>",
        report.loops.len()
    );
    let rows: Vec<_> = report
        .loops
        .iter()
        .map(|row| [&row.file, &row.function, &row.turns, &row.asserted_by].map(|cell| escaped(cell)).to_vec())
        .collect();
    out + &table(&["file", "function", "turns at most", "asserted by"], &rows, 4) + "</details>\n"
}

pub(super) fn instructions(report: &Report) -> String {
    let first: Vec<&Instructions> = report.instructions.iter().filter(|row| row.arm == ARMS[0]).collect();
    let mut out = format!(
        "<p>Counted one by one under valgrind, not sampled and not timed. {}: fewest to most, the mean as a white line.</p>\n{}",
        escaped(ARMS[0]),
        scrolled(&plots::ranges(&first))
    );
    let [low, middle, high] = CYCLES_PER_INSTRUCTION.map(|cycles| format!("cycles at {cycles}/instr."));
    let mut rows: Vec<_> = first
        .iter()
        .map(|row| {
            let committed = |by_arm: &ByArm| {
                by_arm.get(row.arm).and_then(|classes| classes.get(row.class)).map_or(0, |figure| figure.max)
            };
            let [a, b, c] = row.cycles.map(grouped);
            let (x86, m7) = (committed(&report.committed.x86_64), committed(&report.committed.cortex_m7));
            let mut cells = vec![escaped(row.class)];
            cells.extend([row.vectors as u64, row.min, row.mean as u64, row.max].map(grouped));
            cells.extend([a, b, c, grouped(x86), grouped(m7)]);
            cells
        })
        .collect();
    let cycle = &report.cycle_instructions;
    let mut whole = vec!["whole cycle".to_owned()];
    whole.extend([cycle.cycles as u64, cycle.min, cycle.mean as u64, cycle.max].map(grouped));
    whole.extend(cycle.cycles_at.map(grouped));
    whole.extend(["–", "–"].map(str::to_owned));
    rows.push(whole);
    let head = ["class", "vectors", "min", "mean", "max", &low, &middle, &high, "committed", "Cortex-M7"];
    out += &table(&head, &rows, 1);
    out += &aim(report);
    out += &format!(
        "<p>The whole cycle of <code>screed-rt</code> is that of the demo's print: RTDE, tick of the demo's cell, frames, extruder, telemetry; \
         the most in cycle {}, counted from 0.</p>\n<h3>Every arm: most instructions, x86-64 above, Cortex-M7 below</h3>\n",
        cycle.worst
    );
    out += &every_arm(report);
    let rows: Vec<_> = report
        .instructions
        .iter()
        .map(|row| vec![escaped(row.arm), escaped(row.class), grouped(row.max), format!("<code>{}</code>", row.worst)])
        .collect();
    out + "<details><summary>which input took the most</summary>"
        + &table(&["arm", "class", "instructions", "course and tick"], &rows, 2)
        + "</details>\n"
}

fn every_arm(report: &Report) -> String {
    let mut head = vec!["arm"];
    head.extend(Class::ALL.iter().map(|class| class.name()));
    let rows: Vec<_> = ARMS
        .iter()
        .map(|arm| {
            let mut row = vec![escaped(arm)];
            row.extend(Class::ALL.iter().map(|class| {
                let mine = report.instructions.iter().find(|row| row.arm == *arm && row.class == class.name());
                let m7 = report.committed.cortex_m7.get(*arm).and_then(|classes| classes.get(class.name()));
                let [here, there] =
                    [mine.map(|row| row.max), m7.map(|figure| figure.max)].map(|max| max.map_or("–".into(), grouped));
                format!("{here}<br><span class=\"note\">{there}</span>")
            }));
            row
        })
        .collect();
    let head: Vec<String> = head.into_iter().map(escaped).collect();
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    table(&head, &rows, 1)
}

pub(super) fn times(report: &Report) -> String {
    let mut out = format!(
        "<p>{} and the whole cycle, each call timed by the system's clock. Cold: every line of the program and of what the call works on \
         flushed before it. Thrashed: after that, 16,384 foreign branches are run. Co-runner: a program on another processor writes 64 MiB over \
         and over. <b>Stall rule</b>, fixed beforehand: a sample beyond {} is not the program's own; it is counted, kept in the raw samples and \
         left out of median, percentiles and max. Of fewer than a thousand samples p99.9 is the longest.</p>\n",
        escaped(ARMS[0]),
        ns(report.stall_ns)
    );
    let shown = [Class::Motion.name(), Class::Rates.name(), Class::Replay.name(), "whole cycle"];
    let mut rest = Vec::new();
    for row in &report.times {
        if !shown.contains(&row.what.as_str()) && !rest.contains(&row.what.as_str()) {
            rest.push(row.what.as_str());
        }
    }
    let drawn = |what: &str| {
        let series: Vec<_> = report
            .times
            .iter()
            .filter(|row| row.what == what)
            .map(|row| Series { name: row.condition.name().to_owned(), bins: &row.histogram })
            .collect();
        format!("<h3>{}</h3>{}", escaped(what), scrolled(&plots::histograms(&series, &[])))
    };
    out.extend(shown.map(drawn));
    out += "<details><summary>the histograms of the other classes</summary>";
    out.extend(rest.into_iter().map(drawn));
    out += "</details>\n";
    let rows: Vec<_> = report
        .times
        .iter()
        .map(|row| {
            let mut cells = vec![escaped(&row.what), row.condition.name().to_owned()];
            cells.extend(summary_cells(row));
            cells
        })
        .collect();
    out + &table(
        &["what", "condition", "samples", "median", "p99", "p99.9", "max", "max with stalls", "stalls"],
        &rows,
        2,
    )
}

fn summary_cells(row: &Summary) -> Vec<String> {
    let times = [row.median_ns, row.p99_ns, row.p999_ns, row.max_ns, row.max_with_stalls_ns].map(ns);
    let mut cells = vec![grouped(row.count as u64)];
    cells.extend(times);
    cells.push(row.stalls.to_string());
    cells
}

pub(super) fn search(report: &Report) -> String {
    let search = &report.search;
    let first: Vec<_> = search.found.iter().filter(|found| found.arm == ARMS[0]).collect();
    let out = format!(
        "<p>Hill climbs over the bytes of courses, one for each arm and class, from the worst of the committed ones: one to four bytes are \
         changed, what takes more instructions is kept. {} courses were tried, and beside them as many random ones, each for every class of its \
         arm; they say what a search is worth. {}: the most after each round.</p>\n{}",
        grouped(search.courses as u64),
        escaped(ARMS[0]),
        scrolled(&plots::climbs(&first))
    );
    let rows: Vec<_> = search
        .found
        .iter()
        .map(|found| {
            let beyond = 100.0 * (found.climbed.max(found.random) as f64 / found.before.max(1) as f64 - 1.0);
            let mut cells = vec![escaped(found.arm), escaped(found.class)];
            cells.extend([found.before, found.random, found.climbed].map(grouped));
            cells.push(if beyond > 0.0 { format!("{beyond:+.1} %") } else { "–".to_owned() });
            cells
        })
        .collect();
    let worst: Vec<_> = search
        .found
        .iter()
        .map(|found| {
            let course = format!("<span class=\"m\">{}</span>", escaped(&found.worst));
            vec![escaped(found.arm), escaped(found.class), grouped(found.climbed.max(found.random)), course]
        })
        .collect();
    out + &table(&["arm", "class", "committed", "random", "climbed", "beyond committed"], &rows, 2)
        + "<details><summary>the worst courses</summary>"
        + &table(&["arm", "class", "instructions", "course and tick"], &worst, 2)
        + "</details>\n<p class=\"note\">What is beyond the committed can be frozen in tape/src/vectors/worst.rs; <code>.ci/wcet search</code> searches \
           longer, on the Cortex-M7.</p>\n"
}

/// What a root of the call graph is, in words.
fn root_in_words(root: &str) -> String {
    let (name, joints) = root.trim_start_matches("root_").rsplit_once('_').unwrap_or((root, "?"));
    let what = match name {
        "loop_tick" => "tick with the loop",
        "tick" => "tick of the kernel alone",
        "receive" => Class::Frames.name(),
        "poll_transmit" => Class::Answers.name(),
        other => other,
    };
    format!("{what}, {joints} joints")
}

pub(super) fn stack(report: &Report) -> String {
    let mut out = "<p>Bounds by the call graph of the linked kernel: frames as the compiler says them, calls as they stand in the code, the \
                   deepest way from each root; no way leads back to itself and no call goes through a pointer (<code>.ci/stack_bound</code>). \
                   Committed figures.</p>\n"
        .to_owned();
    let bounds = &report.committed.stack;
    let roots: BTreeSet<&String> = bounds.values().flat_map(|roots| roots.keys()).collect();
    let mut head = vec!["root".to_owned()];
    head.extend(bounds.keys().map(|target| format!("{} (bytes)", escaped(target))));
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let rows: Vec<_> = roots
        .iter()
        .map(|root| {
            let bound = |roots: &BTreeMap<String, StackFigure>| roots.get(*root).map_or(0, |figure| figure.bound);
            let mut cells = vec![root_in_words(root)];
            cells.extend(bounds.values().map(|roots| grouped(bound(roots))));
            cells
        })
        .collect();
    out += &table(&head, &rows, 1);
    let rows: Vec<_> = bounds
        .iter()
        .flat_map(|(target, roots)| roots.iter().map(move |(root, figure)| (target, root, figure)))
        .map(|(target, root, figure)| {
            let way = format!("<span class=\"m\">{}</span>", escaped(&figure.path.join(" → ")));
            vec![escaped(target), root_in_words(root), way, figure.functions.to_string()]
        })
        .collect();
    out += &format!(
        "<details><summary>the deepest ways</summary>{}</details>\n<p>Painted: the deepest that all courses of all arms have used, this \
         program here, the firmware on the Cortex-M7.</p>\n",
        table(&["target", "root", "deepest way", "functions"], &rows, 3)
    );
    let rows: Vec<_> = report
        .painted
        .iter()
        .map(|row| {
            let m7 = report.committed.cortex_m7_painted.get(row.class).copied();
            vec![escaped(row.class), grouped(row.bytes as u64), m7.map_or("–".to_owned(), grouped)]
        })
        .collect();
    out + &table(&["class", "here (bytes)", "Cortex-M7, committed (bytes)"], &rows, 1)
}

pub(super) fn proofs(_: &Report) -> String {
    let rows = [
        ("a panic", "the linker: the whole kernel links without a panic handler's target", ".ci/panic_free"),
        ("memory from a heap", "the linker: no allocator is in it", ".ci/panic_free"),
        ("recursion", "the call graph of the linked kernel has no cycle", ".ci/stack_bound"),
        (
            "a call through a pointer",
            "no call of the linked kernel takes its address from a register or memory, but on x86-64 those of five functions of the C library for \
             memory, which are followed",
            ".ci/stack_bound",
        ),
        (
            "a loop without a bound",
            "every loop of the source is listed with its bound",
            "cargo test -p screed-kernel --test loops",
        ),
        (
            "a lock or a wait",
            "the kernel has no clock and no input or output: time and bytes are arguments",
            "no_std, forbid(unsafe_code)",
        ),
    ];
    let rows: Vec<_> = rows
        .map(|(what, why, by)| vec![what.to_owned(), why.to_owned(), format!("<code>{}</code>", escaped(by))])
        .to_vec();
    table(&["what cannot happen in a tick", "why", "shown by"], &rows, 3)
        + "<p class=\"note\">.ci/panic_free and .ci/stack_bound each have controls: kernels that do it, which have to be noticed. CI runs all of \
           these; the report itself does not.</p>\n"
}

pub(super) fn evt(report: &Report) -> String {
    let mut out = format!(
        "<p>A generalised Pareto law for what exceeds a threshold, printed only where every precondition was tested and held at the level of \
         {LEVEL}. A fit that does not ask always gives a number; on a shared machine it would be worth nothing. Maxima of blocks (the generalised \
         extreme value law) are not fitted beside it: they use one sample of each block, have the same shape ξ (Pickands 1975), hide in the blocks \
         the dependence that has to be tested, and a second law would be a second chance that one fits by luck.</p>\n"
    );
    for row in &report.evt {
        out += &format!("<h3>{}</h3>\n", escaped(&row.what));
        match &row.evt.verdict {
            Verdict::Refused(why) => {
                let why: Vec<_> = why.iter().map(|why| format!("<li>{}</li>", escaped(why))).collect();
                out += &format!(
                    "<p><span class=\"no\">REFUSED</span>: no bound is given, for</p><ul>{}</ul>\n",
                    why.concat()
                );
            }
            Verdict::Fitted { law, threshold, quantiles } => {
                out += &format!(
                    "<p><span class=\"yes\">Fitted</span> above {}: shape {:.3}, scale {}.</p>\n",
                    time(*threshold),
                    law.shape,
                    time(law.scale)
                );
                let rows: Vec<_> = quantiles
                    .iter()
                    .map(|q| {
                        vec![
                            format!("{:.0e}", q.probability),
                            time(q.value),
                            format!("{} to {}", time(q.low), time(q.high)),
                        ]
                    })
                    .collect();
                out += &table(&["exceeded with probability", "time", "95 % interval"], &rows, 1);
            }
        }
        let rows: Vec<_> = row
            .evt
            .tests
            .iter()
            .map(|test| {
                let held =
                    if test.holds { "<span class=\"yes\">holds</span>" } else { "<span class=\"no\">broken</span>" };
                let p =
                    test.probability.map_or("by rule".to_owned(), |p| escaped(evt::words(p).trim_start_matches("= ")));
                vec![escaped(test.name), format!("{:.4}", test.statistic), p, held.to_owned()]
            })
            .collect();
        if !rows.is_empty() {
            out += &table(&["test", "statistic", "p", ""], &rows, 1);
        }
        if !row.evt.stability.is_empty() {
            out += "<p>Stability: the shape at five thresholds, with two standard errors to either side; the one at 90 % is used.</p>";
            out += &plots::stability(&row.evt.stability);
        }
    }
    out
}

pub(super) fn responses(report: &Report) -> String {
    let mut out = "<p>Response = wake-up + reading the telegram + cycle + writing the answer, from the instant the timer was set for, over a real \
                   loopback connection. A miss is an answer later than the next cycle is due; no rule leaves one out. The bound of the \
                   probability is Clopper and Pearson's, one-sided, 95 %: for none in N about 3/N. It supposes independent cycles. What \
                   falls due while a late cycle still runs is passed over, and counted beside the misses.</p>\n"
        .to_owned();
    for response in &report.responses {
        let parts = [&response.wake_up, &response.cycle, &response.input_output, &response.response];
        let series: Vec<_> =
            parts.iter().map(|part| Series { name: part.what.clone(), bins: &part.histogram }).collect();
        let ms = response.period_ns / 1_000_000;
        out += &format!(
            "<h3>Every {ms} ms</h3><p><b>{} misses in {} cycles</b>, {} passed over: with 95 % confidence a cycle misses with a probability \
             below {:.2} %.</p>\n{}",
            response.misses,
            grouped(response.cycles as u64),
            response.passed_over,
            100.0 * response.miss_probability_at_most,
            scrolled(&plots::histograms(&series, &[(response.period_ns as f64, "due")]))
        );
        let rows: Vec<_> = parts
            .iter()
            .map(|part| {
                let mut cells = vec![escaped(&part.what)];
                cells.extend(summary_cells(part));
                cells
            })
            .collect();
        out += &table(&["part", "cycles", "median", "p99", "p99.9", "max", "max with stalls", "stalls"], &rows, 1);
    }
    out
}

pub(super) fn margins(report: &Report) -> String {
    let mut head = vec!["what".to_owned()];
    for stalls in ["", " with stalls"] {
        head.push(format!("largest seen{stalls}"));
        head.extend(BUDGETS_NS.map(|budget| format!("of {} ms", budget / 1_000_000)));
    }
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let rows: Vec<_> = report
        .margins
        .iter()
        .map(|row| {
            let mut cells = vec![escaped(&row.what)];
            for (largest, margins) in
                [(row.largest_ns, row.margins), (row.largest_with_stalls_ns, row.margins_with_stalls)]
            {
                cells.push(ns(largest));
                cells.extend(margins.map(|margin| match margin < 1.0 {
                    true => format!("<span class=\"no\">{margin:.2}</span>"),
                    false => format!("{margin:.1}"),
                }));
            }
            cells
        })
        .collect();
    format!(
        "<p>Margin = budget / (largest seen × {MARGIN_FACTOR}), of the largest under the stall rule and of the largest of all. Below 1 the budget is \
         not held with that factor.</p>\n"
    ) + &table(&head, &rows, 1)
}

pub(super) fn limits(_: &Report) -> String {
    "<ul><li>The most that was counted is the most of what was tried: a search makes it large, nothing makes it a proof. Bounded loops say that \
     there is a most, not how much.</li>\
     <li>Instructions are not time: cycles for each depend on caches, memory and neighbours. The columns 2, 4 and 8 are assumptions to \
     calculate with, not measurements.</li>\
     <li>Times hold for this program on this machine on this day. On a virtual machine the host may stop everything for a tenth of a second; \
     the stall rule then says how often, and its figures are those of the undisturbed machine.</li>\
     <li>Flushing makes caches as cold as a program can make them; what lies behind (pages, memory refresh, a neighbour's traffic) it does \
     not reach. The predictor is filled, not cleared.</li>\
     <li>On the Cortex-M7 instructions are counted in an emulator, which knows no wait states of flash and no caches.</li>\
     <li>Bounds of the stack hold for the kernel's own functions; copies of memory that a C library provides are added with what they \
     have in this build, interrupts and the caller are not in them.</li>\
     <li>The whole cycle is the demo's, whose robot, host and extruder are simulated; a network's own delays are not in it.</li></ul>\n"
        .to_owned()
}
