//! The processes together in real time: the host is killed, stopped, interrupted, replaced; the robot's received bytes are the
//! judge.

mod common;

use common::scene::{Lost, Scene, announced, finished, last_flow, lose_host_at, signal};
use common::{Random, assert_on_path, demo_limits, judge, planned_path, read_record, received};
use screed::config::Cell;
use screed_fixtures::{QuarterCircle, quarter_circle};
use std::fs;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Thirty instants are in `.ci/run`: `cargo run --release --example lost_hosts`.
#[test]
fn a_killed_and_a_stopped_host_leave_the_arm_at_rest_on_its_path() {
    let path = planned_path(500);
    let mut random = Random::new(20);
    let mut instant = || Duration::from_secs_f64(random.between(2.5, 12.0));
    let lost = [(Lost::Killed, instant()), (Lost::Stopped, instant()), (Lost::Killed, instant())];
    thread::scope(|scope| {
        for (how, after) in lost {
            let path = &path;
            scope.spawn(move || lose_host_at(how, after, path));
        }
    });
}

#[test]
fn ctrl_c_rests_within_a_second_and_leaves_nothing_behind() {
    let path = planned_path(500);
    for after in [3.0, 10.0] {
        let scene = Scene::new();
        let host = scene.demo(&[]);
        thread::sleep(Duration::from_secs_f64(after));
        assert!(scene.processes().len() >= 4, "robot, extruder, screed-rt and host run");
        let asked = Instant::now();
        signal(host.id() as i32, "INT");
        let (code, out, error) = finished(host);
        assert_eq!(code, Some(130), "{error}");
        assert!(out.contains("interrupted"), "{out}");
        assert!(asked.elapsed() < Duration::from_secs(4), "{:?}", asked.elapsed());
        assert_eq!(scene.processes(), Vec::<i32>::new());
        let left: Vec<_> =
            fs::read_dir(scene.folder.path()).unwrap().flatten().map(|entry| entry.file_name()).collect();
        assert!(left.iter().all(|name| name.to_string_lossy().ends_with(".csv")), "{left:?}");
        let setpoints = received(&read_record(&scene.path("robot.csv")));
        judge(&setpoints, 0.002, &demo_limits());
        assert_on_path(&setpoints, &path, 0, 1e-6);
        assert_eq!(last_flow(&scene.path("extruder.csv")).0, 0.0);
    }
}

#[test]
fn a_print_against_machines_started_by_hand_is_told_what_is_wrong_with_them() {
    let scene = Scene::new();
    let model = scene.path("wall.ifc");
    fs::write(&model, quarter_circle(&QuarterCircle::default())).unwrap();
    let cell = scene.path("cell.toml");
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = free.local_addr().unwrap().port();
    let demo_cell = Cell::demo_text(125).unwrap();
    let mut extruder = scene.screed(&["sim", "extruder", "--json", "--record"]);
    let mut extruder = extruder.arg(scene.path("extruder.csv")).spawn().unwrap();
    let device = announced(&mut extruder, "device");
    let text = demo_cell.replace("\n[link]\n", &format!("\n[link]\nport = {port}\n")).replace("/dev/ttyACM0", &device);
    fs::write(&cell, text).unwrap();
    let print = |more: &[&str]| {
        let mut command = scene.screed(&["print", "--yes", "--allow-non-rt"]);
        finished(command.args(more).arg(&model).arg("--cell").arg(&cell).spawn().unwrap())
    };

    // Somebody listens there who says nothing.
    let (code, _, error) = print(&[]);
    assert_eq!(code, Some(4), "{error}");
    assert!(error.contains("remedy"), "{error}");
    drop(free);
    // Nobody listens.
    let (code, _, error) = print(&[]);
    assert_eq!(code, Some(4), "{error}");
    assert!(error.contains("does not answer") && error.contains("remedy"), "{error}");
    // No such extruder.
    let gone = fs::read_to_string(&cell).unwrap().replace(&device, "/dev/none");
    fs::write(&cell, gone).unwrap();
    let robot = scene.screed(&["sim", "ur", "--json", "--port", &port.to_string(), "--exit-when-idle", "20"]).spawn();
    let mut robot = robot.unwrap();
    announced(&mut robot, "listening");
    let (code, _, error) = print(&[]);
    assert_eq!(code, Some(4), "{error}");
    assert!(error.contains("/dev/none"), "{error}");
    robot.kill().unwrap();
    robot.wait().unwrap();
    extruder.kill().unwrap();
    extruder.wait().unwrap();
}

#[test]
fn without_what_a_hard_timed_loop_needs_nothing_starts_unless_a_person_allows_it() {
    let scene = Scene::new();
    let cell = scene.path("cell.toml");
    // A processor that no machine has: refused to root too.
    fs::write(&cell, Cell::demo_text(125).unwrap() + "\n[realtime]\npriority = 80\ncpu = 1023\n").unwrap();
    let start = |more: &[&str]| {
        let mut process = Command::new(env!("CARGO_BIN_EXE_screed-rt"));
        process.arg("--cell").arg(&cell).arg("--socket").arg(scene.path("rt.sock")).args(more);
        process.args(["--robot", "127.0.0.1:1", "--extruder", "/dev/none"]);
        let output = process.output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, error) = start(&[]);
    assert_eq!(code, Some(6), "{error}");
    assert!(
        error.contains("processor 1023") && error.contains("remedy") && error.contains("--allow-non-rt"),
        "{error}"
    );
    // Allowed, it goes on to what is missing next.
    let (code, error) = start(&["--allow-non-rt"]);
    assert_eq!(code, Some(4), "{error}");
}

#[test]
fn a_certificate_without_real_time_is_refused_before_it_measures_and_leaves_no_file() {
    let scene = Scene::new();
    let (file, key) = (scene.path("core.json"), scene.path("keys/own.key"));
    let mut command = scene.screed(&["latency", "--cpu", "1023", "--hours", "0.1", "--certificate"]);
    let (code, _, error) = finished(command.arg(&file).arg("--key").arg(&key).spawn().unwrap());
    assert!(code == Some(6) && error.contains("processor 1023") && error.contains("remedy"), "{error}");
    // The key is made before anything is measured: it was refused before that.
    for path in [file, scene.path("core.json.sig"), key] {
        assert!(!path.exists(), "{} was left behind", path.display());
    }
}

#[test]
fn a_fault_stays_until_a_person_leaves_it() {
    let scene = Scene::new();
    let (model, cell, program) = (scene.path("wall.ifc"), scene.path("cell.toml"), scene.path("robot.script"));
    fs::write(&model, quarter_circle(&QuarterCircle::default())).unwrap();
    fs::write(&cell, Cell::demo_text(125).unwrap()).unwrap();
    let text = screed::run::demo::program(&Cell::demo(125).unwrap()).unwrap();
    let without: Vec<&str> = text.lines().filter(|line| !line.contains("servoj(")).collect();
    fs::write(&program, without.join("\n") + "\n").unwrap();
    let mut robot = scene.screed(&["sim", "ur", "--port", "0", "--json", "--program"]);
    let mut robot = robot.arg(&program).arg("--cell").arg(&cell).spawn().unwrap();
    let mut extruder = scene.screed(&["sim", "extruder", "--json", "--record"]);
    let mut extruder = extruder.arg(scene.path("extruder.csv")).spawn().unwrap();
    let (address, device) = (announced(&mut robot, "listening"), announced(&mut extruder, "device"));
    let socket = scene.path("rt.sock");
    let mut process = Command::new(env!("CARGO_BIN_EXE_screed-rt"));
    process.arg("--cell").arg(&cell).arg("--socket").arg(&socket);
    let mut process = process.args(["--robot", &address, "--extruder", &device, "--allow-non-rt"]).spawn().unwrap();
    while !socket.exists() {
        thread::sleep(Duration::from_millis(10));
    }
    let print = |more: &[&str]| {
        let mut command = scene.screed(&["print"]);
        let command = command.args(more).arg("--attach").arg(&socket).arg(&model).arg("--cell").arg(&cell);
        finished(command.spawn().unwrap())
    };
    let (code, _, error) = print(&["--yes"]);
    assert!(code == Some(5) && error.contains("K1") && error.contains("does not follow"), "{error}");
    let told: Vec<_> = error.lines().filter(|line| line.contains("alarm: K1")).collect();
    assert!(told.len() == 1 && told[0].contains("then re-arm"), "{error}");
    // Nobody answers the question: the fault stays.
    let (code, _, error) = print(&[]);
    assert!(code == Some(1) && error.contains("stands in fault 1") && error.contains("not confirmed"), "{error}");
    // Left and tried again, it is the second fault.
    let (code, _, error) = print(&["--yes"]);
    assert!(code == Some(5) && error.contains("stands in fault 1") && error.contains("K1"), "{error}");
    let (_, _, error) = print(&[]);
    assert!(error.contains("stands in fault 2"), "{error}");
    signal(process.id() as i32, "TERM");
    process.wait().unwrap();
    for machine in [&mut robot, &mut extruder] {
        signal(machine.id() as i32, "TERM");
        machine.wait().unwrap();
    }
}

#[test]
fn a_certificate_is_verified_and_any_change_of_it_is_noticed() {
    let scene = Scene::new();
    let (file, key) = (scene.path("core.json"), scene.path("keys/own.key"));
    let latency = |more: &[&str]| {
        let mut command = scene.screed(&["latency"]);
        finished(command.args(more).spawn().unwrap())
    };
    let (name, key_name) = (file.to_str().unwrap(), key.to_str().unwrap());
    let measure = ["--certificate", name, "--hours", "0.001", "--key", key_name, "--allow-non-rt"];
    let (code, out, error) = latency(&measure);
    assert_eq!(code, Some(0), "{error}");
    assert!(out.contains("wake-ups") && out.contains("sensor in to wire out"), "{out}");
    let own = error.split("signed by key ").nth(1).unwrap().split(';').next().unwrap().to_owned();
    let told: serde_json::Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    for histogram in [&told["wake"], &told["sensor_to_wire"]] {
        let bins = histogram["histogram"].as_array().unwrap();
        let sum: u64 = bins.iter().map(|bin| bin[1].as_u64().unwrap()).sum();
        assert!(sum > 50 && sum <= histogram["count"].as_u64().unwrap(), "{histogram}");
    }
    assert_eq!(told["seconds_each"], 1.8);
    let machine = fs::read_to_string("/proc/cmdline").unwrap();
    assert_eq!(told["machine"]["command_line"], machine.trim());
    assert!(told["doctor"]["findings"].as_array().unwrap().len() > 10);
    let programs = told["programs"].as_array().unwrap();
    assert!(programs.iter().all(|program| program["sha256"].as_str().unwrap().len() == 64), "{programs:?}");
    let digest = Command::new("sha256sum").arg(common::scene::program("screed")).output().unwrap();
    assert!(String::from_utf8(digest.stdout).unwrap().starts_with(programs[0]["sha256"].as_str().unwrap()));

    let (code, out, error) = latency(&["--verify", name]);
    assert!(code == Some(0) && out.contains(&own), "{out}{error}");
    assert_eq!(latency(&["--verify", name, "--trust", &own]).0, Some(0));
    let (code, _, error) = latency(&["--verify", name, "--trust", &own.replace(&own[..1], "x")]);
    assert!(code == Some(1) && error.contains("is trusted"), "{error}");
    // The same key signs the next one; one that others can read signs none.
    let (_, _, error) = latency(&measure);
    assert!(error.contains(&own), "{error}");
    Command::new("chmod").args(["644", key_name]).status().unwrap();
    let (code, _, error) = latency(&measure);
    assert!(code == Some(1) && error.contains("can be read by others"), "{error}");

    let text = fs::read_to_string(&file).unwrap();
    let better = text.replacen("\"max_us\": ", "\"max_us\": 0", 1);
    assert_ne!(better, text);
    fs::write(&file, better).unwrap();
    let (code, _, error) = latency(&["--verify", name]);
    assert!(code == Some(1) && error.contains("not what was signed") && error.contains("remedy"), "{error}");
    fs::write(&file, text).unwrap();
    let seal = scene.path("core.json.sig");
    let signature = fs::read_to_string(&seal).unwrap();
    let last = signature.trim_end().chars().next_back().unwrap();
    let other =
        format!("{}{}\n", &signature.trim_end()[..signature.trim_end().len() - 1], if last == '0' { '1' } else { '0' });
    fs::write(&seal, other).unwrap();
    assert_eq!(latency(&["--verify", name]).0, Some(1));
    fs::remove_file(&seal).unwrap();
    assert_eq!(latency(&["--verify", name]).0, Some(1));
}

#[test]
fn a_loop_without_real_time_is_stamped_in_table_progress_log_and_its_last_line() {
    let scene = Scene::new();
    let (model, cell, log) = (scene.path("wall.ifc"), scene.path("cell.toml"), scene.path("cycles.screedlog"));
    fs::write(&model, quarter_circle(&QuarterCircle::default())).unwrap();
    let mut robot = scene.screed(&["sim", "ur", "--port", "0", "--json", "--exit-when-idle", "30"]).spawn().unwrap();
    let mut extruder = scene.screed(&["sim", "extruder", "--json", "--exit-when-idle", "30"]).spawn().unwrap();
    let (address, device) = (announced(&mut robot, "listening"), announced(&mut extruder, "device"));
    // A processor that no machine has: refused to root too.
    fs::write(&cell, Cell::demo_text(125).unwrap() + "\n[realtime]\ncpu = 1023\n").unwrap();
    let socket = scene.path("rt.sock");
    let mut process = Command::new(env!("CARGO_BIN_EXE_screed-rt"));
    process.arg("--cell").arg(&cell).arg("--socket").arg(&socket).arg("--allow-non-rt");
    process.args(["--robot", &address, "--extruder", &device]).stdout(Stdio::piped()).stderr(Stdio::piped());
    let process = process.spawn().unwrap();
    while !socket.exists() {
        thread::sleep(Duration::from_millis(10));
    }
    let mut print = scene.screed(&["print", "--yes", "--layers", "1", "--attach"]);
    let print = print.arg(&socket).arg(&model).arg("--cell").arg(&cell).arg("--log").arg(&log).spawn().unwrap();
    thread::sleep(Duration::from_secs(4));
    signal(print.id() as i32, "INT");
    let (code, table, progress) = finished(print);
    assert_eq!(code, Some(130), "{progress}");
    let row = table.lines().find(|line| line.contains("scheduling")).unwrap();
    assert!(row.ends_with("NON-RT") && table.contains("processor 1023"), "{table}");
    assert!(progress.lines().any(|line| line.starts_with("layer") && line.ends_with("NON-RT")), "{progress}");
    let (code, told, error) = finished(scene.screed(&["log", log.to_str().unwrap()]).spawn().unwrap());
    assert!(code == Some(0) && told.contains(" cycles stamped NON-RT, 0 real time"), "{told}{error}");
    signal(process.id() as i32, "TERM");
    let (_, last, _) = finished(process);
    assert!(last.contains("screed-rt, NON-RT: "), "{last}");
    for machine in [robot, extruder] {
        signal(machine.id() as i32, "TERM");
        finished(machine);
    }
}
