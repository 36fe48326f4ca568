use super::*;
use crate::wcet::counts::Counted;
use crate::wcet::evt::Evt;
use crate::wcet::figures::Figures;
use crate::wcet::machine::Machine;
use crate::wcet::report::{self, CycleInstructions, EvtOf, Painted};
use crate::wcet::response::{Parts, Response};
use crate::wcet::search::{Found, Search};
use crate::wcet::times::{Condition, STALL_NS, Summary};
use screed_tape::random::Random;
use screed_tape::vectors::{ARMS, Class, Course, Edge};

/// A report whose numbers are drawn, but for its calls, figures and loops, which are real.
fn drawn() -> Report {
    let mut random = Random(5);
    let courses: Vec<Course> = (0..40).map(Course::of).collect();
    let mut counted = Vec::new();
    for course in &courses {
        course.run(&mut |_: Edge| 0, &mut |call| counted.push(Counted { course: *course, call: *call }));
    }
    counted.iter_mut().for_each(|counted| counted.call.count = 500 + u64::from(random.below(60_000)));
    let mut times = Vec::new();
    for (k, condition) in (1..).zip(Condition::ALL) {
        for what in Class::ALL.iter().map(|class| class.name()).chain(["whole cycle"]) {
            let ns = (0..800).map(|_| k * 2000 + u64::from(random.below(9000)) * u64::from(random.below(20)) / 4);
            times.extend(Summary::of(what, condition, ns.chain([2 * STALL_NS])));
        }
    }
    let exponential: Vec<f64> = (0..3000).map(|_| 1e4 - 900.0 * (1.0 - random.between(0.0, 1.0)).ln()).collect();
    let carried: Vec<f64> = exponential.windows(2).map(|pair| pair[0] + pair[1]).collect();
    let evt = [("independent", &exponential), ("hanging together", &carried)]
        .map(|(what, samples)| EvtOf { what: what.to_owned(), evt: Evt::of(samples) });
    let parts: Vec<Parts> = (0..500)
        .map(|_| {
            let [a, b, c] = [random.below(90_000), random.below(9000), random.below(30_000)].map(u64::from);
            Parts { wake_up: a, cycle: 2000 + b, input_output: 5000 + c, response: 7000 + a + b + c }
        })
        .collect();
    let found = Class::ALL[..6].iter().map(|class| Found {
        arm: ARMS[0],
        class: class.name(),
        before: 1000,
        random: 1010,
        climbed: 1100,
        rounds: vec![1020, 1100],
        random_rounds: vec![900, 1010],
        worst: "none".to_owned(),
    });
    let responses = report::BUDGETS_NS.iter().filter_map(|period| Response::of(*period, &parts)).collect();
    let realtime = crate::config::Realtime { priority: 80, cpu: None, ..Default::default() };
    Report {
        quick: true,
        machine: Machine::here(&realtime).unwrap(),
        scheduling: "NON-RT: <locked memory> was refused".to_owned(),
        courses: courses.len(),
        ticks: counted.len(),
        loops: report::loops(),
        instructions: report::instructions(&counted, &courses),
        cycle_instructions: CycleInstructions::of(&[10_000, 12_000, 11_000]).unwrap(),
        committed: Figures::committed().unwrap(),
        times,
        stall_ns: STALL_NS,
        search: Search { courses: 24, found: found.collect() },
        painted: Class::ALL.iter().map(|class| Painted { class: class.name(), bytes: 20_000 }).collect(),
        evt: evt.into(),
        responses,
        margins: vec![report::margin("tick, warm", 20_000, 30_000), report::margin("response", 500_000, 90_000_000)],
    }
}

#[test]
fn the_page_has_every_point_and_is_well_formed() {
    let report = drawn();
    let page = html(&report);
    if let Some(path) = std::env::var_os("SCREED_PAGE") {
        std::fs::write(path, &page).unwrap();
    }
    for point in 1..=11 {
        assert!(page.contains(&format!("<h2 id=\"s{point}\">")), "point {point}");
    }
    assert!(page.contains("REFUSED") && page.contains("Fitted") && page.contains("&lt;locked memory&gt;"));
    assert!(page.contains(&report.machine.program_sha256) && !page.contains("NaN"));
    // Nothing is loaded from elsewhere.
    assert!(!page.contains("src=") && !page.contains("<script") && !page.contains("href=\"http"));
    for tag in ["table", "svg", "tr", "td", "p", "h2", "h3", "ul", "li", "details", "text", "span", "div"] {
        let count = |text: String| page.matches(text.as_str()).count();
        let opened = count(format!("<{tag}>")) + count(format!("<{tag} "));
        assert_eq!(opened, count(format!("</{tag}>")), "{tag}");
    }
    serde_json::to_string(&report).unwrap();
}
