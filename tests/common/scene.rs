//! The demo's processes in real time, and hosts of it that are lost.

use super::{assert_on_path, demo_limits, judge, read_record, received};
use screed::config::Cell;
use screed_fixtures::{QuarterCircle, quarter_circle};
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A program of this build: tests and examples lie in a folder beside it.
pub fn program(name: &str) -> PathBuf {
    let own = std::env::current_exe().unwrap();
    own.parent().unwrap().parent().unwrap().join(name)
}

/// A folder for one run, and an end to every process that was started with it on its command line.
pub struct Scene {
    pub folder: TempDir,
}

impl Scene {
    pub fn new() -> Self {
        Self { folder: TempDir::new().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn screed(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(program("screed"));
        command.args(arguments).env("TMPDIR", self.folder.path());
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub fn demo(&self, arguments: &[&str]) -> Child {
        let mut command = self.screed(&["demo", "--layers", "1", "--rate", "500"]);
        command.args(arguments).arg("--record").arg(self.path("robot.csv"));
        command.arg("--record-extruder").arg(self.path("extruder.csv")).spawn().unwrap()
    }

    /// Numbers of the processes whose command line names this folder.
    pub fn processes(&self) -> Vec<i32> {
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

    pub fn end_all(&self) {
        let until = Instant::now() + Duration::from_secs(5);
        while !self.processes().is_empty() && Instant::now() < until {
            for number in self.processes() {
                signal(number, "TERM");
            }
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// The socket of the demo's real-time process.
    pub fn socket(&self) -> PathBuf {
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

pub fn signal(process: i32, name: &str) {
    // A process that has just ended is as good.
    let _ = Command::new("kill").args([format!("-{name}"), process.to_string()]).stderr(Stdio::null()).status();
}

pub fn finished(mut child: Child) -> (Option<i32>, String, String) {
    let (mut out, mut error) = (String::new(), String::new());
    child.stdout.take().unwrap().read_to_string(&mut out).unwrap();
    // Whoever answers questions has taken it.
    if let Some(mut stderr) = child.stderr.take() {
        stderr.read_to_string(&mut error).unwrap();
    }
    (child.wait().unwrap().code(), out, error)
}

/// Commanded and actual flow in the extruder's last row.
pub fn last_flow(path: &Path) -> (f64, f64) {
    let text = fs::read_to_string(path).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let last = rows.iter().rev().find(|row| row.len() == names.len()).unwrap();
    let value = |part: &str| last[names.iter().position(|name| name.contains(part)).unwrap()].parse().unwrap();
    (value("commanded"), value("actual"))
}

/// How a host is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lost {
    /// It ends at once (SIGKILL).
    Killed,
    /// It is frozen for eight seconds and goes on then (SIGSTOP, SIGCONT).
    Stopped,
}

/// Starts the demo, loses its host after so long, and judges what the robot received.
pub fn lose_host_at(how: Lost, after: Duration, path: &[[f64; 3]]) {
    let scene = Scene::new();
    let mut host = scene.demo(&[]);
    thread::sleep(after);
    match how {
        Lost::Killed => {
            host.kill().unwrap();
            host.wait().unwrap();
            // The ring is never filled further ahead than four seconds and a batch.
            thread::sleep(Duration::from_secs(8));
            attach_another(&scene);
        }
        Lost::Stopped => {
            signal(host.id() as i32, "STOP");
            thread::sleep(Duration::from_secs(8));
            signal(host.id() as i32, "CONT");
            // What it says now is late: refused, and nothing moves.
            let (code, _, error) = finished(host);
            assert!(code == Some(1) && error.contains("the ring ran dry"), "{code:?}: {error}");
        }
    }
    scene.end_all();

    let record = read_record(&scene.path("robot.csv"));
    let setpoints = received(&record);
    judge(&setpoints, 0.002, &demo_limits());
    // What the host had sent was played to a rest on the path: the setpoints before a second host's motion.
    let rest = setpoints.windows(500).position(|w| w.iter().all(|q| *q == w[0]) && w[0] != setpoints[0]);
    let rest = rest.expect("a second of rest after the ring was played out");
    assert_on_path(&setpoints[..rest + 500], path, 0, 1e-6);
    if how == Lost::Stopped {
        assert!(setpoints[rest..].iter().all(|q| *q == setpoints[rest]), "it moved after its host went on");
    }
    let (commanded, actual) = last_flow(&scene.path("extruder.csv"));
    assert_eq!(commanded, 0.0);
    assert!(actual.abs() < 1e-9, "{actual} m³/s still flow");
    let last = record.last().unwrap();
    assert!(last.actual_q.iter().zip(&last.registers).all(|(a, b)| (a - b).abs() < 1e-3), "the arm came to rest there");
}

/// A new host attaches, is told of the one before, and begins anew until it is interrupted.
fn attach_another(scene: &Scene) {
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
}

/// What a simulated machine says in its first line.
pub fn announced(child: &mut Child, key: &str) -> String {
    let mut line = Vec::new();
    let out = child.stdout.as_mut().unwrap();
    let mut byte = [0];
    while out.read(&mut byte).unwrap() == 1 && byte[0] != b'\n' {
        line.push(byte[0]);
    }
    let value: serde_json::Value = serde_json::from_slice(&line).unwrap();
    value[key].as_str().unwrap().to_owned()
}
