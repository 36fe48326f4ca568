//! The page's sections, one for each point.

use super::plots::{self, Series, grouped, time};
use super::{escaped, table};
use crate::wcet::evt::{LEVEL, Verdict};
use crate::wcet::figures::ByArm;
use crate::wcet::report::{BUDGETS_NS, CYCLES_PER_INSTRUCTION, Instructions, MARGIN_FACTOR, Report};
use crate::wcet::times::{Condition, Summary};
use screed_tape::vectors::{ARMS, Class, DEPTH, GENES, RANDOM_COURSES, RING, SEED, USUAL_POSES, WORST};

/// Aim for the largest closed-loop tick without replay on a Cortex-M7 (instructions).
const M7_AIM: u64 = 150_000;

fn ns(value: u64) -> String {
    time(value as f64)
}

/// The most of an arm's ticks with the loop, without replay and without a burst.
fn without_replay(by_arm: &ByArm, arm: &str) -> u64 {
    let classes = [Class::Motion, Class::Pose, Class::Rates, Class::Fault];
    let most = classes.iter().filter_map(|class| by_arm.get(arm)?.get(class.name())).map(|figure| figure.max);
    most.max().unwrap_or(0)
}

fn m7_of(report: &Report, class: Class) -> u64 {
    let classes = report.committed.cortex_m7.get(ARMS[0]);
    classes.and_then(|classes| classes.get(class.name())).map_or(0, |figure| figure.max)
}

pub(super) fn head(report: &Report) -> String {
    let first = |class: Class| {
        let row = report.instructions.iter().find(|row| row.arm == ARMS[0] && row.class == class.name());
        row.map_or(0, |row| row.max)
    };
    let rt = if report.scheduling == "real time" { "yes" } else { "no" };
    let largest = |condition: Condition| {
        let mine = report.times.iter().filter(|row| row.condition == condition && row.what != "whole cycle");
        mine.map(|row| row.max_ns).max().unwrap_or(0)
    };
    let m7 = without_replay(&report.committed.cortex_m7, ARMS[0]);
    let refused = report.evt.iter().all(|row| matches!(row.evt.verdict, Verdict::Refused(_)));
    let figures = [
        (
            grouped(first(Class::Rates).max(first(Class::Pose))),
            "instructions, worst tick without replay or burst, UR10e, x86-64",
        ),
        (grouped(first(Class::Replay)), "instructions, worst tick with replay"),
        (grouped(m7), "instructions, worst tick without replay or burst, Cortex-M7"),
        (ns(largest(Condition::ColdBranches)), "largest tick seen, caches cold, branches thrashed"),
        (if refused { "REFUSED".to_owned() } else { "fitted".to_owned() }, "extreme value law"),
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
    out + "</div>\n"
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
        plots::ranges(&first)
    );
    let [low, middle, high] = CYCLES_PER_INSTRUCTION.map(|cycles| format!("cycles at {cycles}/instr."));
    let rows: Vec<_> = first
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
    let head = ["class", "vectors", "min", "mean", "max", &low, &middle, &high, "committed", "Cortex-M7"];
    out += &table(&head, &rows, 1);
    let m7 = without_replay(&report.committed.cortex_m7, ARMS[0]);
    let verdict = if m7 <= M7_AIM { "<span class=\"yes\">within</span>" } else { "<span class=\"no\">beyond</span>" };
    out += &format!(
        "<p>The largest tick without replay on the Cortex-M7, {}, at most {USUAL_POSES} poses: {} instructions, {verdict} the aim of {}; with 3 to \
         16 poses {}, with replay {}. \"frames in\" comes on top of a tick: as many bytes as are taken between two ticks.</p>\n",
        escaped(ARMS[0]),
        grouped(m7),
        grouped(M7_AIM),
        grouped(m7_of(report, Class::Burst)),
        grouped(m7_of(report, Class::Replay))
    );
    let cycle = &report.cycle_instructions;
    out += &format!(
        "<p>The whole cycle of <code>screed-rt</code> (RTDE, tick of the demo's cell, frames, extruder, telemetry), {} cycles of a print: {} to \
         {} instructions, mean {}; the most in cycle {}.</p>\n<h3>Every arm: most instructions, x86-64 / Cortex-M7</h3>\n",
        grouped(cycle.cycles as u64),
        grouped(cycle.min),
        grouped(cycle.max),
        grouped(cycle.mean as u64),
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
         left out of median, percentiles and max.</p>\n",
        escaped(ARMS[0]),
        ns(report.stall_ns)
    );
    for what in [Class::Motion.name(), Class::Rates.name(), Class::Replay.name(), "whole cycle"] {
        let series: Vec<_> = report
            .times
            .iter()
            .filter(|row| row.what == what)
            .map(|row| Series { name: row.condition.name().to_owned(), bins: &row.histogram })
            .collect();
        out += &format!("<h3>{}</h3>{}", escaped(what), plots::histograms(&series, &[]));
    }
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
    let mut out = format!(
        "<p>Hill climbs over the bytes of courses, one for each arm and class, from the worst of the committed ones: one to four bytes are \
         changed, what takes more instructions is kept. {} courses were tried, and beside them as many random ones; those say what a search is \
         worth.</p>\n{}",
        grouped(search.courses as u64),
        plots::climbs(&first)
    );
    let rows: Vec<_> = search
        .found
        .iter()
        .map(|found| {
            let gain = 100.0 * (found.climbed as f64 / found.before.max(found.random).max(1) as f64 - 1.0);
            let mut cells = vec![escaped(found.arm), escaped(found.class)];
            cells.extend([found.before, found.random, found.climbed].map(grouped));
            cells.push(format!("{gain:+.1} %"));
            cells
        })
        .collect();
    out += &table(&["arm", "class", "committed", "random", "climbed", "beyond both"], &rows, 2);
    out
}

pub(super) fn stack(report: &Report) -> String {
    let mut out = "<p>Bounds by the call graph of the linked kernel: frames as the compiler says them, calls as they stand in the code, the \
                   deepest way from each root; no way leads back to itself and no call goes through a pointer (<code>.ci/stack_bound</code>).</p>\n"
        .to_owned();
    let rows: Vec<_> = report
        .committed
        .stack
        .iter()
        .flat_map(|(target, roots)| roots.iter().map(move |(root, figure)| (target, root, figure)))
        .map(|(target, root, figure)| {
            vec![
                escaped(target),
                escaped(root),
                grouped(figure.bound),
                figure.functions.to_string(),
                escaped(&figure.path.join(" → ")),
            ]
        })
        .collect();
    out += &table(&["target", "root", "bound (bytes)", "functions", "deepest way"], &rows, 2);
    out += "<p>Painted: what all courses have used of it, all arms.</p>\n";
    let rows: Vec<_> = report
        .painted
        .iter()
        .map(|row| {
            let m7 = report.committed.cortex_m7_painted.get(row.class).copied();
            vec![escaped(row.class), grouped(row.bytes as u64), m7.map_or("–".to_owned(), grouped)]
        })
        .collect();
    out + &table(&["class", "high water, here (bytes)", "on the Cortex-M7 (committed)"], &rows, 1)
}

pub(super) fn proofs(_: &Report) -> String {
    let rows = [
        (
            "a panic",
            "the linker: the whole kernel links without a panic handler's target",
            ".ci/panic_free, with a control that fails",
        ),
        ("memory from a heap", "the linker: no allocator is in it", ".ci/panic_free, with a control that fails"),
        ("recursion", "the call graph of the linked kernel has no cycle", ".ci/stack_bound, with a control that fails"),
        (
            "a call through a pointer",
            "no call of the linked kernel takes its address from a register or memory",
            ".ci/stack_bound, with a control that fails",
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
}

pub(super) fn evt(report: &Report) -> String {
    let mut out = format!(
        "<p>A generalised Pareto law for what exceeds a threshold, printed only where every precondition was tested and held at the level of \
         {LEVEL}. A fit that does not ask always gives a number; on a shared machine it would be worth nothing.</p>\n"
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
                let p = test.probability.map_or("by rule".to_owned(), |p| format!("{p:.2e}"));
                vec![escaped(test.name), format!("{:.4}", test.statistic), p, held.to_owned()]
            })
            .collect();
        out += &table(&["test", "statistic", "p", ""], &rows, 1);
        if !row.evt.stability.is_empty() {
            out += &plots::stability(&row.evt.stability);
        }
    }
    out
}

pub(super) fn responses(report: &Report) -> String {
    let mut out = "<p>Response = wake-up + reading the telegram + cycle + writing the answer, from the instant the timer was set for, over a real \
                   loopback connection. A miss is an answer later than the next cycle is due; no rule leaves one out. The bound of the \
                   probability is Clopper and Pearson's, one-sided, 95 %: for none in N about 3/N. It supposes independent cycles.</p>\n"
        .to_owned();
    for response in &report.responses {
        let parts = [&response.wake_up, &response.cycle, &response.input_output, &response.response];
        let series: Vec<_> =
            parts.iter().map(|part| Series { name: part.what.clone(), bins: &part.histogram }).collect();
        let ms = response.period_ns / 1_000_000;
        out += &format!(
            "<h3>Every {ms} ms</h3><p><b>{} misses in {} cycles</b>: with 95 % confidence fewer than {:.2e} of them.</p>\n{}",
            response.misses,
            grouped(response.cycles as u64),
            response.miss_probability_at_most,
            plots::histograms(&series, &[(response.period_ns as f64, "due")])
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
    let [a, b, c] = BUDGETS_NS.map(|budget| format!("of {} ms", budget / 1_000_000));
    let rows: Vec<_> = report
        .margins
        .iter()
        .map(|row| {
            let mut cells = vec![escaped(&row.what), ns(row.largest_ns)];
            cells.extend(row.margins.map(|margin| match margin < 1.0 {
                true => format!("<span class=\"no\">{margin:.2}</span>"),
                false => format!("{margin:.1}"),
            }));
            cells
        })
        .collect();
    format!(
        "<p>Margin = budget / (largest seen × {MARGIN_FACTOR}). Below 1 the budget is not held with that factor.</p>\n"
    ) + &table(&["what", "largest seen", &a, &b, &c], &rows, 1)
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
