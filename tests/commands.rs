//! The program as a person meets it: what it says, and with which code it ends.

use screed::link::extruder::ExtruderLine;
use screed::log::{CycleRecord, Flags, LogWriter, Metadata};
use screed::run::serial::SerialPortNow;
use screed_kernel::units::{JointPos, Nanos, Tick};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

fn screed(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_screed")).args(arguments).output().expect("the program can be started")
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures").join(name)
}

/// Exit code, standard output, standard error.
fn outcome(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = screed(arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_cell_with_a_tracker_is_sound_and_planned_with_and_not_printed_with() {
    let (cell, model) = (fixture("cells/tracker.toml"), fixture("data/FIM_fixture_IFC4.ifc"));
    let (cell, model) = (cell.to_string_lossy(), model.to_string_lossy());
    let (code, out, error) = outcome(&["check", &cell]);
    assert!(code == Some(0) && out.contains("no link to one yet"), "{out} {error}");
    let (code, _, error) = outcome(&["print", &model, "--cell", &cell, "--fast"]);
    assert_eq!(code, Some(3), "{error}");
    assert!(error.contains("the cell has a tracker") && error.contains("remedy: take [tracker]"), "{error}");
}

#[test]
fn exit_codes_are_as_documented() {
    let cell = fixture("cells/demo.toml");
    let model = fixture("data/FIM_fixture_IFC4.ifc");
    let (cell, model) = (cell.to_string_lossy(), model.to_string_lossy());
    for (arguments, code) in [
        (vec!["--help"], 0),
        (vec!["--version"], 0),
        (vec!["check", &cell], 0),
        (vec!["check", &model], 0),
        (vec![], 2),
        (vec!["dance"], 2),
        (vec!["check"], 2),
        (vec!["check", "Cargo.lock"], 2),
        (vec!["sim", "ur", "--host", "0.0.0.0", "--port", "0"], 2),
        (vec!["calibrate"], 2),
        (vec!["calibrate", "frame"], 2),
        (vec!["calibrate", "frame", "none.toml"], 3),
        (vec!["calibrate", "target", &cell], 3),
        (vec!["check", "none.toml"], 3),
        (vec!["sim", "ur", "--model", "ur9", "--port", "0"], 3),
        (vec!["sim", "ur", "--model", "ur18", "--port", "0"], 3),
        (vec!["robot", "list"], 0),
        (vec!["robot", "show", "nj130-2.6", "--json"], 0),
        (vec!["robot", "check", "ur3e", "--count", "100"], 0),
        (vec!["robot", "check", "none.urdf"], 3),
        (vec!["robot", "check", "ur11"], 3),
        (vec!["robot", "check", "ur10e", "--tip", "flange"], 2),
        (vec!["robot", "check", "ur10e", "--count", "0"], 2),
        (vec!["robot", "program", "--cell", &cell], 0),
        (vec!["robot", "program", "--cell", "none.toml"], 3),
        (vec!["robot", "status"], 2),
        (vec!["robot", "status", "--cell", &cell, "--address", "127.0.0.1"], 2),
        (vec!["robot", "status", "--address", "127.0.0.1:5"], 2),
        (vec!["robot", "status", "--address", "127.0.0.1:6"], 4),
        (vec!["robot", "power-on", "--yes", "--address", "127.0.0.1"], 2),
        (vec!["robot", "play", "--upload", "--address", "127.0.0.1"], 2),
        (vec!["robot", "calibration", "--address", "127.0.0.1:6", "--out", "unit.yaml"], 2),
        (vec!["log", "none.screedlog"], 1),
        (vec!["log", &cell], 1),
    ] {
        let (found, _, error) = outcome(&arguments);
        assert_eq!(found, Some(code), "{arguments:?}: {error}");
        assert_eq!(code == 0, error.is_empty(), "{arguments:?}: {error}");
    }
}

#[test]
fn a_typo_in_the_cell_file_is_shown_with_its_line_and_a_remedy() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("cell.toml");
    let text = std::fs::read_to_string(fixture("cells/demo.toml")).expect("the fixture");
    std::fs::write(&file, text.replacen("lift_mm = 50", "lift_m = 0.05", 1)).expect("a file");
    let (code, out, error) = outcome(&["check", &file.to_string_lossy()]);
    let line = text.lines().position(|line| line == "lift_mm = 50").unwrap_or_default() + 1;
    let expected = format!(
        "error: lift_m has the wrong unit: expected lift_mm, in millimetres\n  --> {}:{line}:1\n{line} | lift_m = 0.05\n   | \
         ^^^^^^\nremedy: write lift_mm and give the value in millimetres\n",
        file.display()
    );
    assert_eq!((code, out.as_str(), error.as_str()), (Some(3), "", expected.as_str()));
}

#[test]
fn a_robot_is_proved_and_drawn_and_an_ambiguous_one_is_asked_for() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let plot = folder.path().join("arm.svg");
    let (arm, urdf) = (fixture("data/robots/ur10e.toml"), fixture("data/robots/crooked.urdf"));
    let (arm, urdf) = (arm.to_string_lossy(), urdf.to_string_lossy());
    let (code, out, error) =
        outcome(&["robot", "check", &arm, "--count", "200", "--json", "--plot", &plot.to_string_lossy()]);
    assert_eq!((code, error.as_str()), (Some(0), ""));
    let report: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    let checked = &report["checked"];
    assert_eq!(
        (report["name"].as_str(), checked["count"].as_u64(), checked["misses"].as_u64()),
        (Some("my-ur10e"), Some(200), Some(0))
    );
    assert!(checked["position_error_m"].as_f64().is_some_and(|error| error < 1e-12), "{checked}");
    assert!(checked["jacobian_error"].as_f64().is_some_and(|error| error < 1e-7), "{checked}");
    assert!(checked["reach_m"][1].as_f64().is_some_and(|reach| (1.2..1.6).contains(&reach)), "{checked}");
    let drawing = std::fs::read_to_string(&plot).expect("the drawing");
    assert!(drawing.contains("my-ur10e") && drawing.ends_with("</svg>\n") && !drawing.contains("NaN"));
    let (code, _, error) = outcome(&["robot", "show", &urdf]);
    assert_eq!(code, Some(3));
    assert!(
        error.contains("can be flange or finger_left or finger_right")
            && error.contains("remedy: name the flange with --tip"),
        "{error}"
    );
    let (code, _, error) = outcome(&["robot", "show", "kr120-r2500-pro", "--calibration", "unit.conf"]);
    assert_eq!(code, Some(2));
    assert!(error.contains("--calibration goes with a UR of the catalogue: found kr120-r2500-pro"), "{error}");
    let (code, out, _) = outcome(&["robot", "show", &urdf, "--tip", "flange"]);
    assert!(code == Some(0) && out.contains("joint grip_left (prismatic) is not on the chain"), "{out}");
}

#[test]
fn a_port_in_use_is_a_link_failure() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = taken.local_addr().expect("it is bound").port().to_string();
    let (code, _, error) = outcome(&["sim", "ur", "--port", &port]);
    assert_eq!(code, Some(4), "{error}");
    assert!(error.contains("is in use"), "{error}");
}

#[test]
fn a_torn_log_gives_its_rows_and_then_fails() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("torn.screedlog");
    let mut log = LogWriter::create(&file, &Metadata { rate_hz: 125, ..Metadata::default() }).expect("a log");
    for tick in 0..200 {
        let now = Nanos(tick * 8_000_000);
        let record = CycleRecord {
            tick: Tick(tick),
            readable: now,
            received: now,
            ticked: now,
            sent: now,
            robot_timestamp: 40.0,
            seq: 1,
            mode: 0,
            flags: Flags::DOUBLED | Flags::NON_RT,
            layer: 0,
            rate: 1.0,
            flow: 0.0,
            commanded: JointPos::ZERO,
            actual: JointPos::ZERO,
            missed: u32::from(tick % 4 == 0) * 5,
            overrun_level: (tick % 4) as u32,
        };
        log.push(&record).expect("space");
    }
    drop(log);
    let name = file.to_string_lossy();
    let (code, out, error) = outcome(&["log", &name, "--csv"]);
    assert_eq!((code, out.lines().count()), (Some(1), 1 + 192), "{error}");
    assert!(error.contains("without its end mark, after 192 whole records") && error.contains("remedy: "), "{error}");
    let (code, out, _) = outcome(&["log", &name]);
    assert!(code == Some(1) && out.contains("192 cycles, 192 with a doubled setpoint"), "{out}");
    assert!(out.contains("48 overruns, 240 slots missed, overrun counter at most 3"), "{out}");
    assert!(out.contains("192 cycles stamped NON-RT, 0 real time"), "{out}");
    let table = folder.path().join("table.csv");
    let (code, out, _) = outcome(&["log", &name, "--csv", &table.to_string_lossy()]);
    assert_eq!((code, out.as_str()), (Some(1), ""));
    assert_eq!(std::fs::read_to_string(&table).expect("the table").lines().count(), 1 + 192);
}

#[test]
fn a_reader_that_has_gone_breaks_nothing_off() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let log = folder.path().join("demo.screedlog");
    // The progress of two minutes finds nobody.
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").expect("a device that takes nothing");
    let demo = Command::new(env!("CARGO_BIN_EXE_screed"))
        .args(["demo", "--layers", "2", "--fast", "--log"])
        .arg(&log)
        .stdout(Stdio::null())
        .stderr(full)
        .status();
    assert_eq!(demo.expect("the program runs").code(), Some(0));
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let read = Command::new(env!("CARGO_BIN_EXE_screed")).arg("log").arg(&log).stdout(writer).output();
    let read = read.expect("the program runs");
    assert_eq!((read.status.code(), String::from_utf8_lossy(&read.stderr).as_ref()), (Some(0), ""));
}

/// A child that does not outlive the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Running {
    fn start(arguments: &[&str]) -> Self {
        let child = Command::new(env!("CARGO_BIN_EXE_screed")).args(arguments).stdout(Stdio::piped()).spawn();
        Self(child.expect("the program can be started"))
    }

    /// Ends it as a service manager would, and gives the rest of what it said.
    fn end(mut self, mut said: impl Read) -> (Option<i32>, String) {
        let id = libc::pid_t::try_from(self.0.id()).expect("a process number");
        // SAFETY: a signal to the child, which has not been waited for, so its number is its own.
        assert_eq!(unsafe { libc::kill(id, libc::SIGTERM) }, 0);
        let mut rest = String::new();
        said.read_to_string(&mut rest).expect("text");
        (self.0.wait().expect("it ends").code(), rest)
    }
}

/// Keeps the line going for a while, as the real-time process does.
fn keep(line: &mut ExtruderLine, port: &mut SerialPortNow, start: Instant, flow: f64, time: Duration) {
    let until = Instant::now() + time;
    let mut buffer = [0; 256];
    while Instant::now() < until {
        let now = Nanos(u64::try_from(start.elapsed().as_nanos()).expect("a short test"));
        let count = port.read(&mut buffer).expect("the terminal is there");
        line.handle_bytes(now, buffer.get(..count).unwrap_or_default()).expect("a sound extruder");
        line.set_flow(flow).expect("a sound flow");
        let count = line.poll_transmit(now, &mut buffer);
        assert_eq!(port.write(buffer.get(..count).unwrap_or_default()).expect("the terminal is there"), count);
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn the_simulated_extruder_extrudes_what_its_line_says_also_for_a_second_client() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let record = folder.path().join("extruder.csv");
    let mut running = Running::start(&["sim", "extruder", "--json", "--record", &record.to_string_lossy()]);
    let mut said = BufReader::new(running.0.stdout.take().expect("a pipe"));
    let mut first = String::new();
    said.read_line(&mut first).expect("text");
    let first: serde_json::Value = serde_json::from_str(&first).expect("JSON");
    let device = first.get("device").and_then(|device| device.as_str()).expect("a device").to_owned();

    let start = Instant::now();
    for flow in [1e-5, 2e-5] {
        // A new client each time: the lock of the first must have gone with it.
        let mut port = SerialPortNow::open(Path::new(&device), 115_200).expect("the terminal can be opened");
        assert!(SerialPortNow::open(Path::new(&device), 115_200).is_err(), "a second client at once is refused");
        let mut line = ExtruderLine::new(1e-4, 5_000_000_000).expect("a sound maximum");
        keep(&mut line, &mut port, start, flow, Duration::from_millis(700));
        let status = *line.status();
        assert!(status.ready && (status.actual - flow).abs() < 0.01 * flow, "{status:?}");
        keep(&mut line, &mut port, start, 0.0, Duration::from_millis(300));
        assert!(line.status().actual < 0.1 * flow, "{:?}", line.status());
    }
    let mut port = SerialPortNow::open(Path::new(&device), 115_200).expect("the terminal can be opened");
    assert_eq!(port.read(&mut [0; 8]).expect("nothing to read is no error"), 0);
    let (code, rest) = running.end(said);
    assert!(port.read(&mut [0; 8]).is_err(), "a device that has gone is an error");
    let last: serde_json::Value = serde_json::from_str(&rest).expect("JSON");
    let number = |key: &str| last.get(key).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN);
    assert_eq!((code, number("damaged_lines")), (Some(0), 0.0));
    // 10,000 and 20,000 mm³/s for 0.7 s each, less what starting takes; more only if this machine stood still.
    let volume = number("volume_mm3");
    assert!(volume > 15_000.0 && (volume < 23_000.0 || number("stalls") > 0.0), "{last}");
    let table = std::fs::read_to_string(&record).expect("the record");
    let volumes: Vec<f64> = table.lines().skip(1).filter_map(|row| row.rsplit(',').next()?.parse().ok()).collect();
    assert!(volumes.windows(2).all(|pair| pair[0] <= pair[1]) && volumes.len() > 100, "{} rows", volumes.len());
    assert!((volumes.last().copied().unwrap_or_default() * 1e9 - volume).abs() < 1.0);
}

#[test]
fn an_idle_simulated_extruder_ends_by_itself() {
    let begin = Instant::now();
    let (code, out, error) = outcome(&["sim", "extruder", "--exit-when-idle", "0.3"]);
    assert_eq!(code, Some(0), "{error}");
    assert!(out.starts_with("simulated extruder at /dev/") && out.contains("extruded 0.0 mm³"), "{out}");
    assert!(begin.elapsed() >= Duration::from_millis(300));
}
