//! The whole flow in virtual time: model to robot, judged by what the robot received.

mod common;

use common::{demo_limits, judge, read_record, received};
use screed::config;
use screed::failure::{Exit, Failure};
use screed::log::{CycleRecord, Flags, LogReader};
use screed::model::fim;
use screed::run::demo::{Demo, program};
use screed::run::print::Print;
use screed::run::session::Wishes;
use screed::run::summary::Summary;
use screed::run::virtual_time::{self, Virtual};
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::units::JointPos;
use std::path::PathBuf;
use tempfile::TempDir;

fn demo(rate_hz: u32) -> Demo {
    Demo {
        layers: 1,
        rate_hz,
        stop_after: None,
        fast: true,
        line_fault: None,
        program: None,
        log: None,
        record: None,
        record_extruder: None,
        quiet: true,
    }
}

fn recorded(mut demo: Demo) -> (Result<Summary, Failure>, Vec<common::Cycle>) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("record.csv");
    demo.record = Some(path.clone());
    let summary = demo.run();
    (summary, read_record(&path))
}

#[test]
fn the_robot_receives_the_path_within_every_limit_at_both_rates() {
    let mut hashes = Vec::new();
    for rate in [125, 500] {
        let (summary, record) = recorded(demo(rate));
        let summary = summary.unwrap();
        let figures = &summary.figures;
        assert_eq!((summary.outcome, summary.layer_time_s), ("complete", 70.0));
        assert!((summary.path_length_m - 4.015).abs() < 1e-9);
        assert_eq!((figures.sent, figures.doubled, figures.skipped), (u64::from(summary.planned), 0, 0));
        assert!(figures.commanded_contour.max().unwrap() < 10e-6);
        // servoj's look-ahead of 0.1 s at 57 mm/s, and its transport.
        let lag = figures.following.rms().unwrap();
        assert!((5e-3..7e-3).contains(&lag), "{lag}");
        assert!(figures.actual_contour.rms().unwrap() < 0.2e-3);
        let volume = 0.024 * 0.015 * 4.015;
        assert!((figures.volume_m3 - volume).abs() < 1e-3 * volume, "{}", figures.volume_m3);
        let setpoints = received(&record);
        // The robot heard every waypoint once, and the resting positions before and behind them.
        assert!(setpoints.len() as u64 >= figures.sent);
        judge(&setpoints, 1.0 / f64::from(rate), &demo_limits());
        hashes.push(summary.hash.clone());
        assert_eq!(demo(rate).run().unwrap().hash, summary.hash, "the same again");
    }
    assert_ne!(hashes[0], hashes[1]);
}

/// One layer of the demo's wall with the example cell of that name, in virtual time.
fn printed(cell: &str, rate: u32) -> (config::Cell, Summary, Vec<common::Cycle>) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../fixtures/cells").join(cell);
    let text = std::fs::read_to_string(path).unwrap().replace("\nrate_hz = 125\n", &format!("\nrate_hz = {rate}\n"));
    let cell = config::parse(cell, &text).unwrap();
    let wall = quarter_circle(&QuarterCircle { layers: 1, ..QuarterCircle::default() });
    let model = fim::parse("wall.ifc", wall.as_bytes()).unwrap();
    let folder = TempDir::new().unwrap();
    let record = folder.path().join("record.csv");
    let print = Print {
        cell: &cell,
        model: &model,
        wishes: Wishes::default(),
        log: None,
        source: ("wall.ifc", wall.as_bytes()),
        yes: true,
        quiet: true,
        again: None,
    };
    let surroundings =
        Virtual { program: program(&cell).unwrap(), fault: None, record: Some(record.clone()), quiet: true };
    let summary = virtual_time::print(&print, surroundings).unwrap();
    let record = read_record(&record);
    (cell, summary, record)
}

#[test]
fn with_a_lead_the_arm_is_on_its_path_and_what_is_sent_keeps_the_guards_limits() {
    for rate in [125, 500] {
        let (_, without, _) = printed("demo.toml", rate);
        let (cell, with, record) = printed("lead.toml", rate);
        for summary in [&without, &with] {
            let figures = &summary.figures;
            assert_eq!((summary.outcome, figures.sent), ("complete", u64::from(summary.planned)));
            assert_eq!((figures.doubled, figures.skipped, figures.unrecorded), (0, 0, 0));
            // The path, and not what leads it.
            assert!(figures.commanded_contour.max().unwrap() < 10e-6, "{summary}");
        }
        // The same path, bit by bit.
        assert_eq!(without.hash, with.hash);
        // At equal stamps there is left what is not led: a dead time of 6 ms at 57 mm/s, and what is still learnt.
        let following = |summary: &Summary| summary.figures.following.rms().unwrap();
        assert!(following(&without) > 5e-3 && following(&with) < 0.5e-3, "{rate}: {without}\n{with}");
        let contour = |summary: &Summary| [summary.figures.actual_contour.max(), summary.figures.actual_contour.rms()];
        let ([far, rms], [far_led, rms_led]) = (contour(&without), contour(&with));
        assert!(far_led.unwrap() < 0.5 * far.unwrap() && rms_led.unwrap() < 0.5 * rms.unwrap(), "{without}\n{with}");
        assert_eq!(without.figures.lead, None);
        let led = with.figures.lead.unwrap();
        assert!(led.lag_s[0] > 0.09 && led.lag_s[1] < 0.12 && led.behind_max_rad < 2e-3, "{led:?}");
        // What the robot received, by its own record, against what the kernel was told to keep.
        let output = cell.configure().output;
        let limits = |j: usize| [output.velocity_max[j], output.acceleration_max[j], output.jerk_max[j]];
        let limits: Vec<_> = (0..6).map(limits).collect();
        let mut most = [0.0_f64; 3];
        for w in received(&record).windows(4) {
            for (joint, limits) in limits.iter().enumerate() {
                let [a, b, c, d] = [0, 1, 2, 3].map(|k: usize| w[k][joint]);
                let differences = [d - c, d - 2.0 * c + b, d - 3.0 * c + 3.0 * b - a];
                for (order, (difference, limit)) in (1..).zip(differences.iter().zip(limits)) {
                    let share = difference.abs() * f64::from(rate).powi(order) / limit;
                    most[order as usize - 1] = most[order as usize - 1].max(share);
                }
            }
        }
        assert!(most.iter().all(|share| *share <= 1.0 + 1e-9), "{rate}: {most:?}");
        println!("{rate} Hz\n{without}\n{with}\nshares of the guard's limits {most:?}");
    }
}

#[test]
fn the_tool_is_where_independent_kinematics_say_for_a_thousand_received_setpoints() {
    let (_, record) = recorded(demo(125));
    let setpoints = received(&record);
    for q in setpoints.iter().step_by(setpoints.len() / 1000).take(1000) {
        let flange = UR10E.forward(&JointPos(*q));
        let tool = flange.transform_point(&nalgebra::Vector3::new(0.0, 0.0, 0.2));
        let miss = (tool - nalgebra::Vector3::from(common::tcp(q, 0.2))).norm();
        assert!(miss < 1e-9, "{q:?}: {miss:e}");
    }
}

#[test]
fn a_spoilt_package_stops_the_job_with_the_right_error() {
    for (fault, expected) in [
        ("size@1500", "bytes"),
        ("type@1500", "type"),
        ("short@1500", ""),
        ("nan@1500", "actual_q"),
        ("impossible@1500", "actual_q"),
    ] {
        let mut demo = demo(125);
        demo.line_fault = Some(fault.parse().unwrap());
        let (summary, record) = recorded(demo);
        let failure = summary.unwrap_err();
        assert_eq!(failure.exit, Exit::Link, "{fault}: {failure}");
        let text = failure.to_string();
        assert!(text.contains(expected) && text.contains("remedy"), "{fault}: {text}");
        assert!(record.len() < 10_000, "{fault}: the job went on");
    }
}

#[test]
fn without_the_servoj_line_nothing_moves_and_the_error_says_why() {
    let folder = TempDir::new().unwrap();
    let text = program(&config::Cell::demo(125).unwrap()).unwrap();
    assert!(text.contains("servoj("));
    let path = folder.path().join("robot.script");
    let without: Vec<&str> = text.lines().filter(|line| !line.contains("servoj(")).collect();
    std::fs::write(&path, without.join("\n") + "\n").unwrap();
    let mut demo = demo(125);
    demo.program = Some(path);
    let (summary, record) = recorded(demo);
    let failure = summary.unwrap_err();
    assert_eq!(failure.exit, Exit::SafetyStop);
    assert!(failure.to_string().contains("does not follow") && failure.to_string().contains("servoj"), "{failure}");
    assert!(record.iter().all(|cycle| cycle.actual_q == record[0].actual_q));
}

#[test]
fn a_robot_whose_program_does_not_play_ends_the_job() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.script");
    std::fs::write(&path, "def screed():\n  sync()\nend\n").unwrap();
    let mut demo = demo(125);
    demo.program = Some(path);
    let (summary, record) = recorded(demo);
    let failure = summary.unwrap_err();
    assert_eq!(failure.exit, Exit::Link);
    assert!(failure.to_string().contains("no program is playing"), "{failure}");
    assert!(record.iter().all(|cycle| cycle.actual_q == record[0].actual_q));
}

#[test]
fn stops_that_take_longer_than_the_look_ahead_do_not_starve_the_ring() {
    let text = quarter_circle(&QuarterCircle {
        layers: 1,
        layer_time: 1500.0,
        acceleration_max: 0.001,
        ..QuarterCircle::default()
    });
    let model = fim::parse("slow.ifc", text.as_bytes()).unwrap();
    let cell = config::Cell::demo(125).unwrap();
    let print = Print {
        cell: &cell,
        model: &model,
        wishes: Wishes::default(),
        log: None,
        source: ("slow.ifc", text.as_bytes()),
        yes: true,
        quiet: true,
        again: None,
    };
    let surroundings = Virtual { program: program(&cell).unwrap(), fault: None, record: None, quiet: true };
    let summary = virtual_time::print(&print, surroundings).unwrap();
    assert_eq!((summary.outcome, summary.figures.sent), ("complete", u64::from(summary.planned)));
}

#[test]
fn after_the_time_asked_for_it_rests_on_the_path() {
    let mut demo = demo(500);
    demo.stop_after = Some(15.0);
    let (summary, record) = recorded(demo);
    let summary = summary.unwrap();
    assert_eq!(summary.outcome, "stopped");
    assert!(summary.figures.commanded_contour.max().unwrap() < 10e-6);
    let setpoints = received(&record);
    judge(&setpoints, 0.002, &demo_limits());
    let [.., before, last] = &setpoints[..] else { panic!() };
    let step = before.iter().zip(last).fold(0.0, |far: f64, (a, b)| far.max((a - b).abs()));
    // The path clock's last period: half its largest change of rate, 6/s² over 2 ms, at less than 0.2 rad/s.
    assert!(step < 0.5 * 6.0 * 0.002_f64.powi(3) * 0.2, "at rest: {step}");
}

#[test]
fn the_larger_model_is_printed_each_layer_in_its_seventy_seconds() {
    let cell_path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../fixtures/cells/fim_fixture.toml");
    let cell = config::load(&cell_path).unwrap();
    let model_path = screed_fixtures::data("FIM_fixture_IFC4.ifc");
    let bytes = std::fs::read(&model_path).unwrap();
    let model = fim::parse("FIM_fixture_IFC4.ifc", &bytes).unwrap();
    let folder = TempDir::new().unwrap();
    let record = folder.path().join("record.csv");
    let print = Print {
        cell: &cell,
        model: &model,
        wishes: Wishes::default(),
        log: None,
        source: ("FIM_fixture_IFC4.ifc", &bytes),
        yes: true,
        quiet: true,
        again: None,
    };
    let surroundings =
        Virtual { program: program(&cell).unwrap(), fault: None, record: Some(record.clone()), quiet: true };
    let summary = virtual_time::print(&print, surroundings).unwrap();
    assert_eq!((summary.outcome, summary.layers, summary.layer_time_s), ("complete", (0, 5), 350.0));
    assert!((summary.path_length_m - 5.0 * 8.983_187_172).abs() < 1e-8);
    assert!(summary.figures.commanded_contour.max().unwrap() < 10e-6);
    let tool = cell.tool.flange_from_tcp.translation.z;
    let period = 1.0 / f64::from(cell.link.rate_hz);
    judge(&received(&read_record(&record)), period, &common::Limits { tool, ..demo_limits() });
}

/// The first layer of a robot that counts as real is laid at half its planned speed, the second as planned, on the same path.
#[test]
fn a_first_layer_at_half_speed_is_the_same_layer_and_the_next_one_is_as_planned() {
    let cell = config::Cell::demo(125).unwrap();
    let wall = quarter_circle(&QuarterCircle { layers: 2, layer_time: 36.0, ..QuarterCircle::default() });
    let model = fim::parse("wall.ifc", wall.as_bytes()).unwrap();
    let folder = TempDir::new().unwrap();
    let run = |first_layer_rate: Option<f64>| {
        let log = folder.path().join("cycles.screedlog");
        let wishes = Wishes { first_layer_rate, ..Wishes::default() };
        let (source, log) = (("wall.ifc", wall.as_bytes()), Some(log.clone()));
        let print =
            Print { cell: &cell, model: &model, wishes, log: log.clone(), source, yes: true, quiet: true, again: None };
        let program = program(&cell).unwrap();
        let summary = virtual_time::print(&print, Virtual { program, fault: None, record: None, quiet: true }).unwrap();
        let records: Vec<_> = LogReader::open(&log.unwrap()).unwrap().map(Result::unwrap).collect();
        (summary, records)
    };
    let ((usual, as_planned), (summary, records)) = (run(None), run(Some(0.5)));
    assert_eq!((summary.outcome, summary.figures.skipped), ("complete", 0));
    assert_eq!(summary.figures.sent, usual.figures.sent);
    let deposit = |records: &[CycleRecord], layer| {
        records.iter().filter(|record| record.flags.contains(Flags::DEPOSIT) && record.layer == layer).count()
    };
    // In cycles: the first layer takes twice as long, the second as long.
    let [first, second] = [0, 1].map(|layer| deposit(&records, layer) as f64 / deposit(&as_planned, layer) as f64);
    assert!((1.98..2.02).contains(&first) && (0.999..1.001).contains(&second), "{first} {second}");
    let rates =
        |layer| records.iter().filter(move |r| r.flags.contains(Flags::DEPOSIT) && r.layer == layer).map(|r| r.rate);
    assert!(rates(0).all(|rate| rate == 0.5) && rates(1).all(|rate| rate == 1.0));
    assert!(
        records.iter().all(|record| record.rate <= 0.5 || record.layer > 0 || !record.flags.contains(Flags::DEPOSIT))
    );
    // Nowhere faster than planned, and as much is laid.
    let (most, planned) = (summary.figures.volume_m3, usual.figures.volume_m3);
    assert!((most / planned - 1.0).abs() < 1e-3, "{most} {planned}");
    assert!(summary.figures.commanded_contour.max().unwrap() < 1e-5);
}
