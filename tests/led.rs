//! The servo's lag compensated with the real processes, over sockets and in real time; a file of its own, so that no other test takes its
//! processor.

mod common;

use common::scene::{Scene, announced, finished, signal};
use common::{planned_path, read_record};
use screed::log::{CycleRecord as LogCycle, Flags, LogReader};
use screed_fixtures::{QuarterCircle, quarter_circle};
use std::collections::HashMap;
use std::fs;
use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

/// Prints the demo's layer with an example cell and the real processes, the robot and the extruder at free places of their own, until
/// it ends or has gone on for so long.
fn printed_with(scene: &Scene, cell: &str, change: (&str, &str)) -> (Option<i32>, String, String) {
    let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../fixtures/cells").join(cell);
    let (model, place) = (scene.path("wall.ifc"), scene.path("cell.toml"));
    fs::write(&model, quarter_circle(&QuarterCircle::default())).unwrap();
    // What the machine does to the pace is no matter here.
    let text = fs::read_to_string(file).unwrap().replace(change.0, change.1) + "\n[realtime]\noverruns_max = 10000\n";
    let text = text.replace("timeout_ms = 500", "timeout_ms = 3000").replace("watchdog_ms = 500", "watchdog_ms = 3000");
    fs::write(&place, &text).unwrap();
    let mut robot = scene.screed(&["sim", "ur", "--port", "0", "--json", "--record"]);
    let mut robot = robot.arg(scene.path("robot.csv")).arg("--cell").arg(&place).spawn().unwrap();
    let mut extruder = scene.screed(&["sim", "extruder", "--json", "--record"]);
    let mut extruder = extruder.arg(scene.path("extruder.csv")).spawn().unwrap();
    let (address, device) = (announced(&mut robot, "listening"), announced(&mut extruder, "device"));
    let port = format!("\n[link]\nport = {}\n", address.rsplit(':').next().unwrap());
    fs::write(&place, text.replace("/dev/ttyACM0", &device).replace("\n[link]\n", &port)).unwrap();
    let mut print = scene.screed(&["print", "--yes", "--allow-non-rt", "--layers", "1", "--log"]);
    let mut print = print.arg(scene.path("cycles.screedlog")).arg(&model).arg("--cell").arg(&place).spawn().unwrap();
    let until = Instant::now() + Duration::from_secs(28);
    while print.try_wait().unwrap().is_none() && Instant::now() < until {
        thread::sleep(Duration::from_millis(50));
    }
    signal(print.id() as i32, "INT");
    let ended = finished(print);
    for machine in [robot, extruder] {
        signal(machine.id() as i32, "TERM");
        finished(machine);
    }
    ended
}

/// The same; where this machine stood still for so long that the lines gave up (K5, K1, a link), as they must, once more.
fn printed_at_last(cell: &str, change: (&str, &str)) -> (Scene, (Option<i32>, String, String)) {
    let mut left = 4;
    loop {
        let scene = Scene::new();
        let ended = printed_with(&scene, cell, change);
        let given_up = ended.0 == Some(4) || ["K1:", "K3:", "K5:"].iter().any(|code| ended.2.contains(code));
        left -= 1;
        if !given_up || left == 0 {
            return (scene, ended);
        }
        println!("once more: {}", ended.2);
    }
}

/// Of what the robot says it received and did, at each of its cycles on the deposit's path: how far the tool was from where the path,
/// a dead time of three cycles ago, wanted it, and how far from the path's line (m, sorted). The log tells which setpoint it was.
fn timed_and_contour(scene: &Scene) -> [Vec<f64>; 2] {
    let path = planned_path(125);
    let record = read_record(&scene.path("robot.csv"));
    let log: Vec<_> = LogReader::open(&scene.path("cycles.screedlog")).unwrap().map(Result::unwrap).collect();
    let laid = |cycle: &LogCycle| cycle.flags.contains(Flags::DEPOSIT) && cycle.rate == 1.0;
    let sent: HashMap<_, _> =
        log.iter().filter(|cycle| laid(cycle)).map(|cycle| (cycle.commanded.0.map(f64::to_bits), cycle.seq)).collect();
    let (mut timed, mut contour) = (Vec::new(), Vec::new());
    for pair in record.windows(4) {
        let (cycle, later) = (&pair[0], &pair[3]);
        // The first cycle in which the robot has it.
        let Some(&seq) = sent.get(&cycle.registers.map(f64::to_bits)) else { continue };
        let at = seq as usize - 1;
        let tool = common::tcp(&later.actual_q, 0.2);
        timed.push(common::to_chord(&tool, &path[at], &path[at + 1]));
        let near = at.saturating_sub(30)..(at + 30).min(path.len() - 1);
        contour.push(near.map(|k| common::to_chord(&tool, &path[k], &path[k + 1])).fold(f64::INFINITY, f64::min));
    }
    [timed, contour].map(|mut errors| {
        errors.sort_by(f64::total_cmp);
        errors
    })
}

/// Medians, and a high share: a machine that stalls holds the robot's target, and the arm then runs on to where it was led.
#[test]
fn a_lead_puts_the_robot_of_another_process_on_its_path() {
    let least = ("size_max_deg = 8", "size_max_deg = 0.1");
    let [(without, plain), (with, led), (_, faulted)] = thread::scope(|scope| {
        let runs = [("demo.toml", ("", "")), ("lead.toml", ("", "")), ("lead.toml", least)];
        runs.map(|(cell, change)| scope.spawn(move || printed_at_last(cell, change))).map(|run| run.join().unwrap())
    });
    assert_eq!((plain.0, led.0), (Some(130), Some(130)), "{}{}", plain.2, led.2);
    assert!(led.1.contains("drives as learnt") && led.1.contains("actual against path, led"), "{}", led.1);
    let figures = [&without, &with].map(|scene| {
        let errors = timed_and_contour(scene);
        assert!(errors[0].len() > 300, "{}", errors[0].len());
        errors.map(|errors| [errors[errors.len() / 2], errors[errors.len() * 9 / 10]])
    });
    println!("timed and contour error, median and 90 % (m): without a lead {:?}, with {:?}", figures[0], figures[1]);
    let [[lag, line], [lag_led, line_led]] = figures;
    assert!(lag[0] > 5e-3 && lag_led[0] < 0.3e-3, "{figures:?}");
    assert!(line_led[0] < 0.1e-3 && line_led[1] < line[1] + 0.1e-3, "{figures:?}");
    // A lead that has no room: the fault, told at once and at the end, with its table and its exit code.
    let (code, _, error) = faulted;
    assert_eq!(code, Some(5), "{error}");
    let told: Vec<_> = error.lines().filter(|line| line.contains("K12: what is sent cannot lead the path")).collect();
    assert!(told.len() == 2 && told[0].starts_with("alarm: ") && !error.contains("re-arm"), "{error}");
    assert!(
        error.contains("outcome") && error.contains("failed") && error.contains("remedy: widen the limits"),
        "{error}"
    );
}
