//! The processes together in real time: the host is killed, interrupted, replaced; the robot's received bytes are the judge.

mod common;

use common::{Random, assert_on_path, demo_limits, judge, planned_path, read_record, received};
use screed::config::Cell;
use screed_fixtures::{QuarterCircle, quarter_circle};
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A folder for one run, and an end to every process that was started with it on its command line.
struct Scene {
    folder: TempDir,
}

impl Scene {
    fn new() -> Self {
        Self { folder: TempDir::new().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn screed(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_screed"));
        command.args(arguments).env("TMPDIR", self.folder.path());
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn demo(&self, arguments: &[&str]) -> Child {
        let mut command = self.screed(&["demo", "--layers", "1", "--rate", "500"]);
        command.args(arguments).arg("--record").arg(self.path("robot.csv"));
        command.arg("--record-extruder").arg(self.path("extruder.csv")).spawn().unwrap()
    }

    /// Numbers of the processes whose command line names this folder.
    fn processes(&self) -> Vec<i32> {
        let name = self.folder.path().to_str().unwrap().as_bytes();
        let all = fs::read_dir("/proc").unwrap().flatten();
        let numbers = all.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        numbers
            .filter(|number: &i32| {
                let line = fs::read(format!("/proc/{number}/cmdline")).unwrap_or_default();
                line.windows(name.len()).any(|part| part == name) && *number != std::process::id() as i32
            })
            .collect()
    }

    fn end_all(&self) {
        let until = Instant::now() + Duration::from_secs(5);
        while !self.processes().is_empty() && Instant::now() < until {
            for number in self.processes() {
                signal(number, "TERM");
            }
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// The socket of the demo's real-time process.
    fn socket(&self) -> PathBuf {
        let folders = fs::read_dir(self.folder.path()).unwrap().flatten();
        folders
            .map(|entry| entry.path().join("rt.sock"))
            .find(|socket| socket.exists())
            .expect("screed-rt still answers")
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        self.end_all();
    }
}

fn signal(process: i32, name: &str) {
    // A process that has just ended is as good.
    let _ = Command::new("kill").args([format!("-{name}"), process.to_string()]).stderr(Stdio::null()).status();
}

fn finished(mut child: Child) -> (Option<i32>, String, String) {
    let (mut out, mut error) = (String::new(), String::new());
    child.stdout.take().unwrap().read_to_string(&mut out).unwrap();
    child.stderr.take().unwrap().read_to_string(&mut error).unwrap();
    (child.wait().unwrap().code(), out, error)
}

/// Commanded and actual flow in the extruder's last row.
fn last_flow(path: &Path) -> (f64, f64) {
    let text = fs::read_to_string(path).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let last = rows.iter().rev().find(|row| row.len() == names.len()).unwrap();
    let value = |part: &str| last[names.iter().position(|name| name.contains(part)).unwrap()].parse().unwrap();
    (value("commanded"), value("actual"))
}

fn kill_host_at(after: Duration, path: &[[f64; 3]]) {
    let scene = Scene::new();
    let mut host = scene.demo(&[]);
    thread::sleep(after);
    host.kill().unwrap();
    host.wait().unwrap();
    // The ring is never filled further ahead than four seconds and a batch.
    thread::sleep(Duration::from_secs(8));

    // A new host attaches and is told.
    let (model, cell) = (scene.path("wall.ifc"), scene.path("cell.toml"));
    fs::write(&model, quarter_circle(&QuarterCircle::default())).unwrap();
    fs::write(&cell, Cell::demo_text(500).unwrap()).unwrap();
    let socket = scene.socket();
    let mut next = scene.screed(&["print", "--yes", "--layers", "1", "--attach"]);
    let next = next.arg(&socket).arg(&model).arg("--cell").arg(&cell).spawn().unwrap();
    thread::sleep(Duration::from_millis(700));
    signal(next.id() as i32, "INT");
    let (code, _, error) = finished(next);
    assert_eq!(code, Some(130), "{error}");
    assert!(error.contains("an earlier host was lost"), "{error}");
    assert!(socket.exists(), "screed-rt holds on: the second host did not start it, so it does not end it");
    scene.end_all();

    let record = read_record(&scene.path("robot.csv"));
    let setpoints = received(&record);
    judge(&setpoints, 0.002, &demo_limits());
    // What the first host had sent was played to a rest on the path: the setpoints before the second host's motion.
    let rest = setpoints.windows(500).position(|w| w.iter().all(|q| *q == w[0]) && w[0] != setpoints[0]);
    let rest = rest.expect("a second of rest after the ring was played out");
    assert_on_path(&setpoints[..rest + 500], path, 0, 1e-6);
    let (commanded, actual) = last_flow(&scene.path("extruder.csv"));
    assert_eq!(commanded, 0.0);
    assert!(actual.abs() < 1e-9, "{actual} m³/s still flow");
    let last = record.last().unwrap();
    assert!(last.actual_q.iter().zip(&last.registers).all(|(a, b)| (a - b).abs() < 1e-3), "the arm came to rest there");
}

#[test]
fn a_killed_host_leaves_the_arm_at_rest_on_its_path_at_twenty_instants() {
    let path = planned_path(500);
    let mut random = Random::new(20);
    let instants: Vec<Duration> = (0..20).map(|_| Duration::from_secs_f64(random.between(2.5, 12.0))).collect();
    for part in instants.chunks(5) {
        thread::scope(|scope| {
            for after in part {
                scope.spawn(|| kill_host_at(*after, &path));
            }
        });
    }
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
    let (code, _, error) = print(&[]);
    assert_eq!(code, Some(4), "{error}");
    assert!(error.contains("/dev/none"), "{error}");
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

/// What a simulated machine says in its first line.
fn announced(child: &mut Child, key: &str) -> String {
    let mut line = Vec::new();
    let out = child.stdout.as_mut().unwrap();
    let mut byte = [0];
    while out.read(&mut byte).unwrap() == 1 && byte[0] != b'\n' {
        line.push(byte[0]);
    }
    let value: serde_json::Value = serde_json::from_slice(&line).unwrap();
    value[key].as_str().unwrap().to_owned()
}
