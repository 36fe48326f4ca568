use super::super::{Cell, ConfigError, Finding, parse};
use super::*;
use crate::run::core::{Core, CoreError};
use screed_kernel::closed_loop::LoopError;

const DEMO: &str = include_str!("../../../../fixtures/cells/demo.toml");
const LEAD: &str = include_str!("../../../../fixtures/cells/lead.toml");
const TRACKER: &str = include_str!("../../../../fixtures/cells/tracker.toml");

fn read(text: &str) -> Cell {
    parse("cell.toml", text).unwrap_or_else(|error| panic!("{error:?}"))
}

/// What is wrong once `from` is replaced by `to`: line and message.
fn wrong(text: &str, from: &str, to: &str) -> Vec<(usize, String)> {
    assert!(text.contains(from), "{from:?}");
    match parse("cell.toml", &text.replacen(from, to, 1)) {
        Err(ConfigError::Invalid { findings }) => {
            findings.iter().map(|Finding { place, fault }| (place.line, fault.to_string())).collect()
        }
        other => panic!("{from:?} -> {to:?} gave {other:?}"),
    }
}

fn line(text: &str, of: &str) -> usize {
    text.lines().position(|line| line.starts_with(of)).map_or(0, |line| line + 1)
}

#[test]
fn the_examples_differ_from_the_demos_cell_in_nothing_else() {
    let (demo, lead, tracker) = (read(DEMO), read(LEAD), read(TRACKER));
    assert_eq!((demo.lead, demo.tracked, lead.tracked), (None, None, None));
    let plain = |cell: &Cell| Cell { name: String::new(), lead: None, tracked: None, ..cell.clone() };
    assert_eq!((plain(&lead), plain(&tracker)), (plain(&demo), plain(&demo)));
    assert_eq!(lead.lead, tracker.lead);
}

#[test]
fn a_lead_is_read_in_si_and_by_default_begins_with_what_servoj_is_told() {
    let lead = read(LEAD).lead.unwrap();
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12 * b, "{a} {b}");
    near(lead.limits.size_max, 8_f64.to_radians());
    near(lead.limits.velocity_max, 30_f64.to_radians());
    near(lead.limits.acceleration_max, 1150_f64.to_radians());
    assert_eq!((lead.drive.lag, lead.drive.inverse_gain, lead.patience), (0.1, 1.0 / 300.0, 1.0));
    assert_eq!(lead.learning, Lead::of(lead.limits, 0.006, [0.1, 300.0]).learning);
    let other = LEAD.replace("servoj_lookahead_s = 0.1", "servoj_lookahead_s = 0.05");
    assert_eq!(read(&other).lead.unwrap().drive.lag, 0.05);
    let given = "dead_time_ms = 4\npatience_s = 2.5\nlag_ms = 80\nlag_min_ms = 20\nlag_max_ms = 200\ngain = 250\n\
                 gain_low = 100\ngain_high = 500\nfilter_time_ms = 40\nlearn_above_deg_s = 0.5\nmemory_s = 12\n\
                 noise_deg = 0.002\nadoption_s = 0.25";
    let lead = read(&LEAD.replace("dead_time_ms = 6", given)).lead.unwrap();
    assert_eq!((lead.patience, lead.drive), (2.5, Drive { lag: 0.08, inverse_gain: 1.0 / 250.0 }));
    let Learning { lag, inverse_gain, dead_time, filter_time, velocity_min, memory, noise, adoption } = lead.learning;
    assert_eq!((lag, inverse_gain, dead_time), ([0.02, 0.2], [1.0 / 500.0, 1.0 / 100.0], 0.004));
    assert_eq!((filter_time, memory, adoption), (0.04, 12.0, 0.25));
    near(velocity_min, 0.5_f64.to_radians());
    near(noise, 0.002_f64.to_radians());
}

#[test]
fn what_is_wrong_with_a_lead_is_named_with_its_line() {
    let one = |from: &str, to: &str, message: &str| {
        assert_eq!(wrong(LEAD, from, to), [(line(LEAD, from), message.to_owned())]);
    };
    one(
        "dead_time_ms = 6",
        "dead_time_ms = 600",
        "dead_time_ms: expected a number from 0 to 100 (milliseconds), found 600",
    );
    one(
        "dead_time_ms = 6",
        "dead_time_s = 6",
        "dead_time_s has the wrong unit: expected dead_time_ms, in milliseconds",
    );
    one(
        "dead_time_ms = 6",
        "lag_ms = 5\ndead_time_ms = 6",
        "lag_ms: expected a number between its bounds, here 10 and 400, found 5",
    );
    // Not given, it is that of the link; then the section is to blame.
    let [(place, message)] = wrong(LEAD, "dead_time_ms = 6", "gain_high = 100\ndead_time_ms = 6").try_into().unwrap();
    assert_eq!(place, line(LEAD, "[lead]"));
    assert_eq!(message, "gain: expected a number between its bounds, here 40 and 100, found 300");
    let [(place, message)] = wrong(LEAD, "size_max_deg = 8", "size_max_deg = 8\nsize = 3").try_into().unwrap();
    assert_eq!((place, message.as_str()), (line(LEAD, "size_max_deg") + 1, "size is not a key of [lead]"));
    let [(place, message)] = wrong(LEAD, "velocity_max_deg_s = 30", "").try_into().unwrap();
    assert_eq!(place, line(LEAD, "[lead]"));
    assert_eq!(message, "[lead] lacks velocity_max_deg_s: expected a number from 0.1 to 1000 (degrees per second)");
}

#[test]
fn everything_that_a_tracker_needs_is_read_in_si() {
    let cell = read(TRACKER);
    let Tracked { estimator, settings } = cell.tracked.unwrap();
    let EstimatorConfig { base, .. } = estimator;
    // The base's x axis lies along the tracker's y.
    let in_tracker = base.tracker_from_nominal.rotation * Vector3::x();
    assert!((in_tracker - Vector3::y()).norm() < 1e-15);
    assert_eq!(base.tracker_from_nominal.translation, Vector3::new(3.0, -1.0, 0.5));
    assert_eq!(base.flange_from_target.translation, Vector3::new(0.0, 0.08, 0.06));
    assert_eq!((base.hold, base.agreeing, base.period), (2.0, 20, 0.008));
    assert_eq!((base.pivot, base.drift.speed, base.drift.time), (Vector3::new(0.6, 0.0, 0.1), 0.003, 1.0));
    assert_eq!(base.swing.centre, Vector3::new(0.0, 0.0, -0.1));
    let mode = base.swing.modes[3];
    assert!((mode.frequency - 24.0 * std::f64::consts::PI).abs() < 1e-12, "{mode:?}");
    assert_eq!((mode.damping, mode.deviation, base.swing.modes[0].deviation), (0.05, 0.001_f64.to_radians(), 1e-5));
    let stiff = TRACKER.find("# The pedestal's own").zip(TRACKER.find("[estimator]"));
    let stiff = stiff.map(|(from, to)| [&TRACKER[..from], &TRACKER[to..]].concat()).unwrap();
    assert_eq!(read(&stiff).tracked.unwrap().estimator.base.swing, screed_kernel::base::swing::Swing::NONE);
    assert_eq!((base.limits.translation_max, base.limits.velocity_max, base.limits.acceleration_max), (0.05, 0.1, 1.0));
    assert!((base.limits.rotation_max - 1_f64.to_radians()).abs() < 1e-15);
    assert!((estimator.jerk_density[3] - 3000.0 * 1_f64.to_radians().powi(2)).abs() < 1e-12);
    assert!((estimator.start_deviation.acceleration.0[5] - 50_f64.to_radians()).abs() < 1e-12);
    assert_eq!((estimator.dead_time, settings.dead_time, settings.works), (0.006, 0.006, Process::Deposit));
    assert_eq!(settings.flange_from_tcp, cell.tool.flange_from_tcp);
    let gains = settings.gains.travel[2];
    assert_eq!((gains.proportional, gains.integral, gains.derivative), (0.04, 0.5, 0.0009));
    assert_eq!((gains.filter_time, gains.tracking_time), (0.02, 0.1));
    let bounds = settings.bounds.deposit;
    assert_eq!((bounds.shift_max, bounds.shift_speed_max, bounds.shift_acceleration_max), (0.05, 0.02, 0.1));
    assert_eq!(bounds.patience, 10.0);
}

#[test]
fn the_sections_of_a_tracker_come_together_or_not_at_all() {
    let (_, rest) = TRACKER.split_once("\n[tracker]").unwrap();
    let alone = rest.find("\n[shift]").unwrap();
    let text = format!("{DEMO}\n[tracker]{}", &rest[..alone]);
    let Err(ConfigError::Invalid { findings }) = parse("cell.toml", &text) else { panic!() };
    let missing: Vec<_> = findings.iter().map(|finding| finding.fault.to_string()).collect();
    for name in ["lead", "shift", "estimator", "control", "control_deposit", "control_travel", "control_mill"] {
        assert!(
            missing.iter().any(|text| text.starts_with(&format!("the section [{name}] is missing"))),
            "{missing:?}"
        );
    }
    assert_eq!(missing.len(), 7, "{missing:?}");
    assert!(missing.iter().any(|text| text.contains("size_max_deg, velocity_max_deg_s")), "{missing:?}");
    let unknown = "\n[control_paint]\nx = 1\n";
    let Err(ConfigError::Invalid { findings }) = parse("cell.toml", &format!("{TRACKER}{unknown}")) else { panic!() };
    let message = findings[0].fault.to_string();
    assert!(findings.len() == 1 && message.starts_with("control_paint is not a section"), "{message}");
    let [(place, message)] = wrong(TRACKER, "works = \"deposit\"", "works = \"paint\"").try_into().unwrap();
    assert_eq!(
        (place, message.as_str()),
        (line(TRACKER, "works"), "works: expected \"deposit\" or \"mill\", found \"paint\"")
    );
    let [(_, message)] = wrong(TRACKER, "rotation_max_deg = 1", "rotation_max_deg = 20").try_into().unwrap();
    assert_eq!(message, "rotation_max_deg: expected a number from 0.001 to 11.4 (degrees), found 20");
}

/// What the ranges let through, the kernel takes: the extremes of every key, all at once and each alone.
#[test]
fn whatever_is_read_the_kernel_makes_a_loop_of() {
    assert!(read(DEMO).closed_loop().is_ok_and(|made| made.is_none()));
    assert!(read(LEAD).closed_loop().is_ok_and(|made| made.is_some_and(|made| made.estimator().is_none())));
    assert!(read(TRACKER).closed_loop().is_ok_and(|made| made.is_some_and(|made| made.estimator().is_some())));
    let (_, sections) = TRACKER.split_once("\n[lead]").unwrap();
    let mut tried = 0;
    for row in sections.lines().filter(|row| row.contains(" = ") && !row.starts_with('#')) {
        let (name, value) = row.split_once(" = ").unwrap();
        let Some(key) = keys::ALL.iter().find(|key| key.name == name) else { continue };
        for extreme in [key.low, key.high] {
            let count = value.matches(',').count() + 1;
            let list = vec![extreme.to_string(); count].join(", ");
            let value = if count > 1 { format!("[{list}]") } else { list };
            for rate in [125, 500] {
                let text = TRACKER.replace("rate_hz = 125", &format!("rate_hz = {rate}"));
                let text = text.replacen(&format!("\n{row}\n"), &format!("\n{name} = {value}\n"), 1);
                let made = read(&text).closed_loop();
                assert!(made.is_ok(), "{name} = {value}: {:?}", made.err());
                tried += 1;
            }
        }
    }
    assert!(tried > 150, "{tried}");
}

/// No link carries a tracker's poses yet, and what would not be corrected is not printed as if it were.
#[test]
fn a_cell_with_a_tracker_is_refused_where_it_would_be_printed() {
    let error = Core::new(&read(TRACKER), false, "").err();
    assert_eq!(error, Some(CoreError::Tracker));
    let text = error.map(|error| error.to_string()).unwrap_or_default();
    assert!(text.contains("no link to one yet") && text.contains("take [tracker]"), "{text}");
    assert!(Core::new(&read(LEAD), false, "").is_ok());
    let beyond = Lead { drive: Drive { lag: 1.0, inverse_gain: 0.01 }, ..read(LEAD).lead.unwrap() };
    let made = Cell { lead: Some(beyond), ..read(LEAD) }.closed_loop();
    assert!(matches!(made, Err(super::super::kernel::CellLoopError::Loop(LoopError::Drive(_)))));
}
