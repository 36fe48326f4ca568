//! The whole loop end to end in virtual time: a print with a tracker, over every byte between host, kernel and robot, on a base that
//! moves. What goes wrong with the loop ends it with a fault that is told with code, cause and action, and is in the log.

mod common;

use common::Random;
use screed::config::{self, Cell};
use screed::failure::{Exit, Failure};
use screed::log::{Flags, LogReader};
use screed::model::fim::{self, FimModel};
use screed::plan::contour::Contour;
use screed::run::demo::program;
use screed::run::job::Outcome;
use screed::run::print::{Print, open_log};
use screed::run::session::{Session, Step, Wishes};
use screed::run::summary::Summary;
use screed::run::virtual_time::World;
use screed::sim::extruder::{Extruder, TIME_CONSTANT};
use screed::sim::ur::{Controller, Options};
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::estimator::{POSES_MAX, TrackerPose};
use screed_kernel::frame::ModeCode;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};
use std::path::PathBuf;
use tempfile::TempDir;

/// Of a tracker (m, rad), as the estimator is told.
const PLACE: f64 = 25e-6;
const TURN: f64 = 1.7e-4;

/// An example cell, some of its text put in place of other.
fn cell(name: &str, changes: &[(&str, &str)]) -> Cell {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../fixtures/cells").join(name);
    let mut text = std::fs::read_to_string(path).unwrap();
    for (old, new) in changes {
        let changed = text.replacen(old, new, 1);
        assert_ne!(changed, text, "{old}");
        text = changed;
    }
    config::parse(name, &text).unwrap()
}

/// What a print came to.
struct Printed {
    result: Result<Summary, Failure>,
    /// What a person was told meanwhile.
    told: Vec<String>,
    /// Mode, flow and whether on a deposit, of each cycle in the log.
    log: Vec<(u8, f64, bool)>,
    /// How far the tool was from the wall, where material was laid (m).
    contour: Vec<f64>,
}

/// Prints the demo's first layer for at most so many seconds. `base` says where the base is in the frame of where it should be, so long
/// after the deposit has begun, and whether the tracker sees it.
fn print(cell: &Cell, seconds: f64, base: impl Fn(f64) -> (Pose, bool)) -> Printed {
    let text = quarter_circle(&QuarterCircle { layers: 1, ..QuarterCircle::default() });
    let model = fim::parse("wall.ifc", text.as_bytes()).unwrap();
    let folder = TempDir::new().unwrap();
    let print = Print {
        cell,
        model: &model,
        wishes: Wishes::default(),
        log: Some(folder.path().join("cycles.screedlog")),
        source: ("wall.ifc", text.as_bytes()),
        yes: true,
        quiet: true,
        again: None,
    };
    let controller = Controller::new(&cell.robot.arm, Options::of(cell, program(cell).unwrap())).unwrap();
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).unwrap();
    let mut world = match cell.tracked {
        Some(_) => World::tracked(cell, controller, extruder).unwrap(),
        None => World::new(cell, controller, extruder, None).unwrap(),
    };
    let wishes = Wishes { stop_after: Some(seconds), ..Wishes::default() };
    let mut session = Session::new(cell, &model, wishes, open_log(&print).unwrap());
    let (mut told, mut contour) = (Vec::new(), Vec::new());
    let result = play(&mut world, &mut session, cell, &model, &base, &mut contour);
    told.append(&mut session.job().take_alarms());
    session.finish().unwrap();
    let log = LogReader::open(print.log.as_deref().unwrap()).unwrap();
    let log = log.map(|record| {
        let record = record.unwrap();
        (record.mode, record.flow, record.flags.contains(Flags::DEPOSIT))
    });
    let log = log.collect();
    Printed { result: result.map(|outcome| session.summary("wall.ifc", outcome)), told, log, contour }
}

fn play(
    world: &mut World,
    session: &mut Session<'_>,
    cell: &Cell,
    model: &FimModel,
    base: &impl Fn(f64) -> (Pose, bool),
    contour: &mut Vec<f64>,
) -> Result<&'static str, Failure> {
    let mut wall = Contour::new(&model.layers[0].segments);
    let mut random = Random::new(5);
    let mut noise = |deviation: f64| [0; 3].map(|_| random.between(-1.0, 1.0) * deviation * 3.0_f64.sqrt());
    let mut deposits = None;
    loop {
        match world.step(session)? {
            Step::Running => {}
            Step::Confirm => session.confirm(),
            Step::Rearm(report) => panic!("{report:?}"),
            Step::Ended(Outcome::Complete) => return Ok("complete"),
            Step::Ended(Outcome::Stopped) => return Ok("stopped"),
        }
        let deposit = world.core().last_command().is_some_and(|(command, _)| command.deposit && command.flow > 0.0);
        if deposit && deposits.is_none() {
            deposits = Some(world.now());
        }
        let since = deposits.map_or(0.0, |began: Nanos| world.now().since(began) as f64 * 1e-9);
        let (nominal_from_base, seen) = base(since);
        let base_from_flange = cell.robot.arm.forward(&JointPos(world.controller().last_cycle().actual_q.0));
        if deposit {
            let tool = nominal_from_base * base_from_flange * cell.tool.flange_from_tcp;
            let tool = cell.part.base_from_part.inverse() * tool;
            contour.push(wall.distance(&tool.translation.into()));
        }
        if let (Some(tracked), true) = (&cell.tracked, seen) {
            let base = &tracked.estimator.base;
            let target = base.tracker_from_nominal * nominal_from_base * base_from_flange * base.flange_from_target;
            let spoilt = Pose::from_rotation_vector(noise(PLACE).into(), noise(TURN).into());
            let tracker_from_target = Pose {
                rotation: spoilt.rotation * target.rotation,
                translation: target.translation + spoilt.translation,
            };
            let left_out = world.on_tracker(TrackerPose {
                at: world.now(),
                tracker_from_target,
                position_deviation: PLACE,
                rotation_deviation: TURN,
            });
            assert_eq!(left_out, None);
        }
    }
}

/// The base, shifted along x at this speed (m/s) up to that far (m), seen by the tracker.
fn shifted(speed: f64, most: f64) -> impl Fn(f64) -> (Pose, bool) {
    move |since| (Pose::from_translation((speed * since).min(most), 0.0, 0.0), true)
}

/// Of a print that a fault has ended: exit code, message with cause and action, the same told at once, and the log's last cycles.
fn assert_fault(printed: &Printed, code: &str, cause: &str, action: &str) {
    let failure = printed.result.as_ref().unwrap_err();
    let text = failure.to_string();
    assert_eq!(failure.exit, Exit::SafetyStop, "{text}");
    assert!(text.contains(&format!("{code}: ")) && text.contains(cause) && text.contains(action), "{text}");
    let alarms: Vec<_> = printed.told.iter().filter(|alarm| alarm.starts_with(&format!("{code}: "))).collect();
    assert!(alarms.len() == 1 && alarms[0].contains(cause) && alarms[0].contains(action), "{:?}", printed.told);
    let modes: Vec<u8> = printed.log.iter().map(|(mode, ..)| *mode).collect();
    let [moving, stopping, faulted] = [ModeCode::Moving, ModeCode::Stopping, ModeCode::Faulted].map(|mode| mode as u8);
    // It was laying, came to rest on its path unless it stood there already, and laid nothing more.
    assert!(printed.log.iter().any(|(mode, flow, deposit)| *mode == moving && *flow > 0.0 && *deposit));
    let stops = modes.iter().filter(|mode| **mode == stopping).count();
    let stood = printed.log.iter().rev().find(|(mode, ..)| *mode == moving).is_some_and(|(_, flow, _)| *flow == 0.0);
    assert!(modes.last() == Some(&faulted) && (stood || stops > 20), "{stops} {:?}", modes.last());
    assert_eq!(printed.log.last().unwrap().1, 0.0);
    println!("{code}: {text}");
}

#[test]
fn a_print_on_a_base_that_drifts_is_where_the_wall_is() {
    let farthest = |printed: &Printed| printed.contour.iter().fold(0.0, |far: f64, one| far.max(*one));
    let drift = || shifted(0.003, 0.02);
    let with = print(&cell("tracker.toml", &[("\nrate_hz = 125\n", "\nrate_hz = 500\n")]), 14.0, drift());
    let without = print(&cell("lead.toml", &[]), 14.0, drift());
    let [far, off] = [&with, &without].map(farthest);
    println!(
        "contour at most {far} m, without the tracker {off} m\n{:?}\n{}",
        with.told,
        with.result.as_ref().unwrap()
    );
    assert!(far < 0.3e-3 && off > 3e-3, "{far} {off}");
    assert_eq!((with.result.unwrap().outcome, without.result.unwrap().outcome), ("stopped", "stopped"));
}

#[test]
fn a_base_that_asks_for_more_than_the_tool_may_be_moved_is_k8() {
    let narrow = cell("tracker.toml", &[("shift_max_mm = 50", "shift_max_mm = 3")]);
    let printed = print(&narrow, 40.0, shifted(0.003, 0.02));
    assert_fault(&printed, "K8", "3.00 mm allowed", "look at what moves the base");
}

#[test]
fn a_path_that_is_out_of_reach_from_where_the_base_is_now_is_k9() {
    let far = cell(
        "tracker.toml",
        &[
            ("\nxyz_mm = [150, 0, 0]", "\nxyz_mm = [500, 0, 0]"),
            ("translation_max_mm = 50", "translation_max_mm = 500"),
            ("shift_max_mm = 50", "shift_max_mm = 500"),
            // Near the end of its reach joints turn far.
            ("size_max_deg = 8", "size_max_deg = 30"),
        ],
    );
    let printed = print(&far, 60.0, |since| (Pose::from_translation(-0.01 * since, 0.0, 0.0), true));
    assert_fault(&printed, "K9", "mm out of reach", "bring the base back");
}

#[test]
fn a_base_beyond_its_bound_is_k10() {
    let bounded = cell("tracker.toml", &[("translation_max_mm = 50", "translation_max_mm = 5")]);
    let printed = print(&bounded, 40.0, shifted(0.003, 0.02));
    assert_fault(&printed, "K10", "along x", "register it anew");
}

#[test]
fn a_servo_that_lags_more_than_it_can_is_k11() {
    let wrong =
        cell("lead.toml", &[("dead_time_ms = 6", "dead_time_ms = 6\nlag_ms = 50\nlag_max_ms = 60\nmemory_s = 20")]);
    let printed = print(&wrong, 40.0, shifted(0.0, 0.0));
    assert_fault(&printed, "K11", "bound 60.0 ms", "compare look-ahead, gain and dead time");
}

#[test]
fn a_lead_without_room_is_k12() {
    let narrow = cell("lead.toml", &[("size_max_deg = 8", "size_max_deg = 0.1")]);
    let printed = print(&narrow, 40.0, shifted(0.0, 0.0));
    assert_fault(&printed, "K12", "rad behind", "widen the limits of [lead]");
}

#[test]
fn a_tracker_that_is_lost_for_too_long_is_k13() {
    let impatient = cell("tracker.toml", &[("patience_s = 10", "patience_s = 3")]);
    let printed = print(&impatient, 40.0, |since| (Pose::from_translation(0.002, 0.0, 0.0), since < 5.0));
    assert!(printed.told.iter().any(|alarm| alarm.contains("the path waits for the tracker")), "{:?}", printed.told);
    assert_fault(&printed, "K13", "3.00 s allowed", "clear the beam");
}

#[test]
fn a_pose_for_which_there_is_no_room_pushes_out_the_oldest_and_that_is_given_back() {
    let cell = cell("tracker.toml", &[]);
    let controller = Controller::new(&cell.robot.arm, Options::of(&cell, program(&cell).unwrap())).unwrap();
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).unwrap();
    let mut world = World::tracked(&cell, controller, extruder).unwrap();
    let pose = |number: usize| TrackerPose {
        at: Nanos(number as u64),
        tracker_from_target: Pose::from_rotation_vector([0.0; 3].into(), [0.0; 3].into()),
        position_deviation: PLACE,
        rotation_deviation: TURN,
    };
    let left_out: Vec<_> = (0..POSES_MAX + 2).filter_map(|number| world.on_tracker(pose(number))).collect();
    assert_eq!(left_out, [pose(0), pose(1)]);
}
