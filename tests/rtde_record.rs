//! `screed rtde record` and a cell with recipes, as a person meets them: files in the form of UR's own clients, a simulated
//! controller of the program, tables and exit codes.

mod common;

use common::scene::announced;
use serialport::{SerialPort, TTYPort};
use std::fs::File;
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const RECORD: &str = r#"<?xml version="1.0"?>
<rtde_config>
	<recipe key="out">
		<field name="timestamp" type="DOUBLE"/>
		<field name="actual_q" type="VECTOR6D"/>
		<field name="payload_cog" type="VECTOR3D"/>
		<field name="joint_mode" type="VECTOR6INT32"/>
		<field name="actual_digital_input_bits" type="UINT64"/>
		<field name="output_bit_register_64" type="BOOL"/>
<!--	<field name="script_control_line" type="UINT32"/> -->
		<field name="robot_mode" type="INT32"/>
	</recipe>
	<recipe key="modes">
		<field name="runtime_state" type="UINT32"/>
	</recipe>
	<recipe key="tomorrow">
		<field name="of_tomorrow" type="DOUBLE"/>
	</recipe>
	<recipe key="slider">
		<field name="speed_slider_mask" type="UINT32"/>
	</recipe>
</rtde_config>
"#;

struct Controller(Child, String);

impl Controller {
    fn start(options: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_screed"));
        command.args(["sim", "ur", "--port", "0", "--json", "--exit-when-idle", "60"]).args(options);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the program can be started");
        let address = announced(&mut child, "listening");
        Self(child, address)
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn screed(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_screed")).args(arguments).output().expect("the program can be started");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("a writable folder");
    path
}

/// A table's heads and its rows of numbers.
fn table(text: &str) -> (Vec<&str>, Vec<Vec<f64>>) {
    let mut lines = text.lines();
    let heads = lines.next().expect("a head").split(',').collect();
    let numbers = |line: &str| line.split(',').map(|number| number.parse().expect("a number")).collect();
    (heads, lines.map(numbers).collect())
}

#[test]
fn a_recipe_is_recorded_in_both_protocols_and_its_gaps_are_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "record.xml", RECORD);
    let config = config.to_string_lossy();
    for (options, rate, found, protocol) in [
        (&["--start-deg", "10,-90,-90,-90,90,-30"][..], "125", 125.0, 2),
        (&["--rtde-protocol", "1"], "500", 125.0, 1),
        (&["--controller", "cb3"], "25", 25.0, 2),
    ] {
        let controller = Controller::start(options);
        let common =
            ["rtde", "record", "--address", &controller.1, "--config", &config, "--seconds", "1", "--rate", rate];
        let (code, out, error) = screed(&common);
        assert_eq!(code, Some(0), "{error}");
        let (heads, rows) = table(&out);
        assert_eq!((heads.len(), heads[0], heads[6], heads[7]), (19, "timestamp", "actual_q_5", "payload_cog_0"));
        // A stalled machine stops simulated time with it, so no package is missing.
        assert_eq!(rows.len() as f64, found, "{error}");
        for (before, row) in rows.iter().zip(&rows[1..]) {
            assert!((row[0] - before[0] - 1.0 / found).abs() < 1e-9, "{} after {}", row[0], before[0]);
        }
        if protocol == 2 && found == 125.0 {
            assert_eq!(rows[0][1], 10_f64.to_radians());
        }
        // joint_mode running, robot_mode running.
        assert_eq!((&rows[0][10..16], rows[0][18]), (&[253.0; 6][..], 7.0));
        let told = format!(
            "RTDE protocol {protocol}\n{} packages at {found:.1} Hz, 0 skipped by their time stamps",
            rows.len()
        );
        assert!(error.contains(&told), "{error}");
        assert_eq!(error.contains("500 Hz were asked for"), protocol == 1, "{error}");

        // A recipe without a time stamp keeps its columns; into a file, what is told goes to the standard output.
        let path = folder.path().join("modes.csv");
        let path = path.to_string_lossy();
        let (code, out, error) = screed(&[&common[..], &["--recipe", "modes", "--force", "-o", &path]].concat());
        assert_eq!((code, error.as_str()), (Some(0), ""));
        assert!(out.contains(&format!("{found:.0} packages at {found:.1} Hz, 0 skipped")), "{out}");
        let text = std::fs::read_to_string(&*path).expect("the table");
        let (heads, rows) = table(&text);
        assert_eq!((heads, rows.len() as f64), (vec!["runtime_state"], found));
        // It is not overwritten by mistake.
        let (code, _, error) = screed(&[&common[..], &["-o", &path]].concat());
        assert!(code == Some(2) && error.contains("is there already") && error.contains("--force"), "{error}");
        assert_eq!(std::fs::read_to_string(&*path).expect("the table"), text);
    }
}

#[test]
fn what_cannot_be_recorded_is_told_with_its_place_and_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "record.xml", RECORD);
    let config = config.to_string_lossy();
    let controller = Controller::start(&[]);
    let record = |address: &str, more: &[&str]| {
        screed(&[&["rtde", "record", "--seconds", "1", "--address", address, "--config"], more].concat())
    };

    let (code, _, error) = record(&controller.1, &[&config, "--recipe", "tomorrow"]);
    let place = format!("{config}:17: recipe tomorrow: the controller (software 5.11.6.1) has no field of_tomorrow");
    assert!(code == Some(4) && error.contains(&place) && error.contains("\nremedy: "), "{code:?} {error}");
    let (code, _, error) = record(&controller.1, &[&config, "--recipe", "slider"]);
    assert!(code == Some(4) && error.contains("cannot send speed_slider_mask, which is an input"), "{error}");
    let (code, _, error) = record(&controller.1, &[&config, "--recipe", "in"]);
    assert!(
        code == Some(2) && error.contains("has no recipe in: expected one of out, modes, tomorrow, slider"),
        "{error}"
    );
    let (code, _, error) = record("127.0.0.1:1", &[&config]);
    assert!(code == Some(4) && error.contains("127.0.0.1:1 does not answer"), "{error}");
    // What ends before a row comes leaves no file.
    let path = folder.path().join("never.csv");
    let (code, _, _) = record(&controller.1, &[&config, "--recipe", "tomorrow", "-o", &path.to_string_lossy()]);
    assert!(code == Some(4) && !path.exists());
    // Whoever closes the connection.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    std::thread::spawn(move || listener.incoming().for_each(drop));
    let (code, _, error) = record(&address, &[&config]);
    assert!(code == Some(4) && error.contains("closed the connection"), "{error}");
    assert!(error.contains("\nremedy: see the log on its teach pendant"), "{error}");
    let slow = Controller::start(&["--controller", "cb3"]);
    let (code, _, error) = record(&slow.1, &[&config, "--rate", "500"]);
    assert!(code == Some(4) && error.contains("serves at most 125 Hz, 500 Hz wanted"), "{error}");

    let wrong = write(folder.path(), "wrong.xml", &RECORD.replace("VECTOR3D", "VECTOR6D"));
    let (code, _, error) = record(&controller.1, &[&wrong.to_string_lossy()]);
    assert_eq!(code, Some(3), "{error}");
    assert!(error.contains("recipe out, field payload_cog: expected type VECTOR3D, found VECTOR6D"), "{error}");
    assert!(error.contains("wrong.xml:6:3") && error.contains("\nremedy: write the expected type"), "{error}");
}

/// O_NOCTTY: the test's own process shall not get the terminal as its controlling one.
const NOCTTY: i32 = 0o400;

#[test]
fn a_terminal_shows_how_far_a_record_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "record.xml", RECORD);
    let controller = Controller::start(&[]);
    let (mut person, terminal) = TTYPort::pair().expect("a terminal");
    let mut options = File::options();
    let stderr = options.read(true).write(true).custom_flags(NOCTTY).open(terminal.name().expect("its name"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_screed"));
    command.args(["rtde", "record", "--seconds", "2.5", "--address", &controller.1, "--config"]).arg(&config);
    let output = command.stderr(Stdio::from(stderr.expect("it opens"))).output().expect("the program can be started");
    assert_eq!(output.status.code(), Some(0));
    let mut shown = [0; 4096];
    person.set_timeout(Duration::from_secs(2)).expect("a timeout");
    let count = person.read(&mut shown).expect("what was shown");
    let shown = String::from_utf8_lossy(&shown[..count]);
    assert!(shown.contains(" packages, 1 s; Ctrl-C ends it"), "{shown:?}");
    drop(terminal);
}

const CONTROL: &str = r#"<?xml version="1.0"?>
<rtde_config>
	<recipe key="state">
		<field name="target_q" type="VECTOR6D"/>
		<field name="joint_mode" type="VECTOR6INT32"/>
	</recipe>
	<recipe key="joints">
		<field name="input_double_register_24" type="DOUBLE"/>
		<field name="input_double_register_25" type="DOUBLE"/>
		<field name="input_double_register_26" type="DOUBLE"/>
		<field name="input_double_register_27" type="DOUBLE"/>
		<field name="input_double_register_28" type="DOUBLE"/>
		<field name="input_double_register_29" type="DOUBLE"/>
	</recipe>
	<recipe key="watchdog">
		<field name="input_int_register_24" type="INT32"/>
	</recipe>
</rtde_config>
"#;

/// The program is printed over the registers that the recipes name; a cell that says otherwise is refused.
#[test]
fn a_cell_takes_its_registers_from_its_recipes() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "control.xml", CONTROL);
    write(folder.path(), "other.xml", &CONTROL.replace("input_int_register_24", "input_int_register_30"));
    let demo = include_str!("../fixtures/cells/demo.toml");
    let cell = |name: &str, keys: &str| {
        let text = demo.replace("\nkind = \"rtde\"\n", &format!("\nkind = \"rtde\"\n{keys}\n"));
        assert_ne!(text, demo);
        write(folder.path(), name, &text).to_string_lossy().into_owned()
    };
    let model = folder.path().join("wall.ifc");
    std::fs::write(&model, screed_fixtures::quarter_circle(&screed_fixtures::QuarterCircle::default()))
        .expect("a writable folder");
    let record = folder.path().join("record.csv");
    let (model, record) = (model.to_string_lossy(), record.to_string_lossy());

    let good = cell("good.toml", "recipes = \"control.xml\"");
    let print = ["print", &model, "--cell", &good, "--fast", "--yes", "--layers", "1", "--record", &record];
    let (code, _, error) = screed(&print);
    assert_eq!(code, Some(0), "{error}");
    let cycles = common::read_record(Path::new(&*record));
    assert!(cycles.len() > 1000 && cycles.iter().any(|cycle| cycle.registers != [0.0; 6]));

    for (name, keys, line) in [
        (
            "clash.toml",
            "recipes = \"control.xml\"\nregister_offset = 0",
            "register_offset: expected 24, as the recipes of",
        ),
        (
            "other.toml",
            "recipes = \"other.xml\"",
            "recipes: expected input_double_register_N to _N+5 and input_int_register_N",
        ),
        ("none.toml", "recipes = \"none.xml\"", "recipes: expected a file that can be read, found"),
    ] {
        let (code, _, error) = screed(&["check", &cell(name, keys)]);
        assert!(code == Some(3) && error.contains(line), "{name}: {code:?} {error}");
    }
}
