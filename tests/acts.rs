//! What a person does to a robot by commands, at a terminal or without one; and a print on a robot that counts as real.

mod common;

use common::robot::{Machine, NOCTTY, Sender, answered, serve};
use common::scene::{Scene, announced, finished, signal};
use screed::config::Cell;
use screed::run::controller::inputs;
use screed_fixtures::{QuarterCircle, quarter_circle};
use serialport::{SerialPort, TTYPort};
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::OpenOptionsExt;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

/// A fieldbus owns the lower registers: found before a print, and its own client given them back.
#[test]
fn registers_that_somebody_else_owns_are_found_before_a_print() {
    let machine = Machine::new("", &["--fieldbus", "lower"]);
    let model = machine.scene.path("wall.ifc");
    fs::write(&model, quarter_circle(&QuarterCircle { layers: 1, ..QuarterCircle::default() })).unwrap();
    for words in ["robot status --cell SIMULATED", "print @wall.ifc --yes --allow-non-rt --cell SIMULATED"] {
        let (code, _, error) = machine.screed(words);
        assert!(code == Some(4) && error.contains("registers: all 7 inputs"), "{words}: {error}");
        assert!(error.contains("remedy: switch the fieldbus off"), "{words}: {error}");
    }
    let mut cell = Cell::demo(125).unwrap();
    let place = machine.place();
    assert!(inputs::inputs(&place, &cell).unwrap().unwrap_err().contains("EtherNet/IP"));
    // The upper ones are free, each time anew; not while another client has them.
    cell.link.register_offset = 24;
    for _ in 0..3 {
        assert_eq!(inputs::inputs(&place, &cell).unwrap(), Ok(()));
    }
    let free = serve(&Cell::demo(125).unwrap(), |options| (options.powered, options.autoplay) = (true, true));
    let sender = Sender::new(&free, cell.robot.start.0);
    cell.link.register_offset = 0;
    assert!(inputs::inputs(&free, &cell).unwrap().is_err());
    drop(sender);
    thread::sleep(Duration::from_millis(100));
    assert_eq!(inputs::inputs(&free, &cell).unwrap(), Ok(()));
}

/// The cell of a real robot, with one key changed.
fn changed(machine: &Machine, name: &str, from: &str, to: &str) {
    let real = fs::read_to_string(machine.scene.path("real.toml")).unwrap();
    assert!(real.contains(from), "{from}");
    fs::write(machine.scene.path(name), real.replace(from, to)).unwrap();
}

#[test]
fn nothing_is_done_without_a_person_or_on_another_robot_than_the_cells() {
    let machine = Machine::new("", &["--power-off", "--no-autoplay"]);
    let address = format!("127.0.0.1:{}", machine.place().rtde);
    // Nobody is there.
    let (code, out, error) = machine.screed("robot unlock --cell SIMULATED");
    assert!(code == Some(0) && out.contains("there is nothing to unlock"), "{out}{error}");
    for act in ["power-on", "brake-release", "play", "play --upload"] {
        let (code, _, error) = machine.screed(&format!("robot {act} --cell SIMULATED"));
        let expected = if act == "play --upload" { 4 } else { 1 };
        assert_eq!(code, Some(expected), "{act}: {error}");
        assert!(error.contains("no terminal") || error.contains("POWER_OFF"), "{act}: {error}");
    }
    // Nobody may answer for a person where the robot may be real.
    let (code, _, error) = machine.screed(&format!("robot power-on --yes --address {address}"));
    assert_eq!(code, Some(2), "{error}");
    // The cell has to be this robot's: its number, its model.
    changed(&machine, "named.toml", "simulated = false", "simulated = false\nserial = \"20220000000\"");
    changed(&machine, "other.toml", "simulated = false", "simulated = false\nserial = \"1\"");
    changed(&machine, "model.toml", "model = \"ur10e\"", "model = \"ur5e\"");
    changed(&machine, "unit.toml", "simulated = false", "simulated = true\nserial = \"1\"");
    for (cell, text) in [
        ("REAL", "add serial = \"20220000000\""),
        ("@other.toml", "expected 1, found 20220000000"),
        ("@model.toml", "expected ur5e, found UR10"),
        ("@unit.toml --yes", "expected 1, found 20220000000"),
    ] {
        for act in ["power-on", "brake-release", "play"] {
            let (code, _, error) = machine.at_terminal(&format!("robot {act} --cell {cell}"), &[act]);
            assert!(code == Some(3) && error.contains(text) && !error.contains("Type "), "{act} {cell}: {error}");
        }
    }
    // Another answer is none.
    let (code, _, error) = machine.at_terminal("robot power-on --cell @named.toml", &["yes"]);
    assert!(
        code == Some(1) && error.contains("not confirmed") && error.contains("UR10, serial number 2022"),
        "{error}"
    );
    assert!(error.contains(&format!("robot at 127.0.0.1, port {}:", machine.place().rtde)), "{error}");
    let (code, out, _) = machine.screed(&format!("robot status --json --address {address}"));
    let status: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, status["robot_mode"].as_str()), (Some(0), Some("POWER_OFF")), "nothing was done");
}

#[test]
fn a_person_powers_a_robot_and_plays_and_yes_is_for_simulated_ones() {
    let machine = Machine::new("", &["--power-off", "--no-autoplay"]);
    changed(&machine, "named.toml", "simulated = false", "simulated = false\nserial = \"20220000000\"");
    let (code, out, error) = machine.at_terminal("robot power-on --cell @named.toml", &["power-on"]);
    assert!(code == Some(0) && out.contains("robot IDLE"), "{error}");
    let (code, _, error) = machine.screed("robot brake-release --yes --cell @named.toml");
    assert_eq!(code, Some(2), "{error}");
    let (code, out, error) = machine.screed("robot brake-release --yes --cell SIMULATED");
    assert!(code == Some(0) && out.contains("robot RUNNING"), "{error}");
    // A real robot's cell has to name its serial number before anything is uploaded.
    let (code, _, error) = machine.at_terminal("robot play --upload --cell REAL", &["upload"]);
    assert!(code == Some(3) && error.contains("add serial = \"20220000000\""), "{error}");
    let (code, out, error) = machine.at_terminal("robot play --upload --cell SIMULATED", &["upload"]);
    assert!(code == Some(0) && out.contains("waits for setpoints") && !out.contains("already"), "{error}");
    let (code, out, error) = machine.screed("robot play --upload --cell SIMULATED");
    assert!(code == Some(0) && out.contains("plays already and waits for setpoints: nothing was uploaded"), "{error}");
    {
        let _sender = Sender::new(&machine.place(), Cell::demo(125).unwrap().robot.start.0);
        thread::sleep(Duration::from_millis(200));
        let (code, out, error) = machine.screed("robot play --upload --cell SIMULATED");
        assert!(code == Some(0) && out.contains("follows setpoints that somebody sends"), "{out}{error}");
    }
    // Its watchdog has stopped it.
    thread::sleep(Duration::from_millis(1000));
    let (code, out, error) = machine.at_terminal("robot play --upload --cell SIMULATED", &["upload"]);
    assert!(code == Some(0) && !out.contains("already"), "{out}{error}");
    let (code, out, error) = machine.screed("robot status --cell SIMULATED");
    assert!(code == Some(0) && out.contains("Screed's plays") && !out.contains("BAD"), "{out}{error}");
    // Stopping and taking power away ask nobody.
    let (code, out, error) = machine.screed("robot stop --cell REAL");
    assert!(code == Some(0) && out.contains("STOPPED"), "{error}");
    let (code, out, error) = machine.screed(&format!("robot power-off --address 127.0.0.1:{}", machine.place().rtde));
    assert!(code == Some(0) && out.contains("POWER_OFF"), "{error}");
}

#[test]
fn the_program_is_shown_or_written() {
    let machine = Machine::new("", &["--power-off", "--no-autoplay"]);
    let (code, text, error) = machine.screed("robot program --cell SIMULATED");
    assert!(code == Some(0) && text.contains("servoj(") && text.contains("rtde_set_watchdog"), "{error}");
    let (code, out, error) = machine.screed("robot program --cell SIMULATED --out @screed.script");
    assert_eq!((code, out.as_str()), (Some(0), ""), "{error}");
    assert_eq!(fs::read_to_string(machine.scene.path("screed.script")).unwrap(), text);
}

/// The whole flow on a robot that counts as real and is calibrated: program uploaded, serial number and motion confirmed, the
/// controller's own geometry used, the first layer at reduced speed.
#[test]
fn a_real_robot_prints_with_its_option_its_number_and_a_person() {
    let scene = Scene::new();
    let mut extruder = scene.screed(&["sim", "extruder", "--json", "--exit-when-idle", "60"]).spawn().unwrap();
    let device = announced(&mut extruder, "device");
    // The controller of a calibrated unit; the cells of the print know nothing of it, or take it from there.
    let unit = scene.path("unit.conf");
    let zero = "[0, 0, 0, 0, 0, 0]";
    let deltas = format!("[mounting]\ndelta_theta = {zero}\ndelta_alpha = {zero}\ndelta_a = [0, 0.002, 0, 0, 0, 0]\n");
    fs::write(&unit, deltas + "delta_d = [0, 0, 0, 0, 0, 0.001]\n").unwrap();
    let mut machine = Machine::new(&format!("calibration = {:?}", unit.to_str().unwrap()), &["--no-autoplay"]);
    let model = machine.scene.path("wall.ifc");
    fs::write(&model, quarter_circle(&QuarterCircle { layers: 2, ..QuarterCircle::default() })).unwrap();
    let text = fs::read_to_string(machine.scene.path("real.toml")).unwrap().replace("/dev/ttyACM0", &device);
    let line = text.lines().find(|line| line.starts_with("calibration")).unwrap().to_owned();
    let write = |name: &str, keys: &str| fs::write(machine.scene.path(name), text.replace(&line, keys)).unwrap();
    write("nominal.toml", "serial = \"20220000000\"");
    write("other.toml", "calibration = \"controller\"\nserial = \"1\"");
    write("own.toml", "calibration = \"controller\"\nserial = \"20220000000\"\nfirst_layer_rate = 0.4");
    let print = "print @wall.ifc --allow-non-rt --cell";

    let (code, _, error) = machine.screed(&format!("{print} @own.toml"));
    assert!(code == Some(2) && error.contains("--real-robot"), "{error}");
    let (code, _, error) = machine.screed(&format!("{print} @own.toml --real-robot --yes"));
    assert!(code == Some(2) && error.contains("--yes"), "{error}");
    let (code, _, error) = machine.screed(&format!("{print} @nominal.toml --real-robot"));
    assert!(
        code == Some(3) && error.contains("calibration = \"controller\"") && error.contains("mm from nominal"),
        "{error}"
    );
    let (code, _, error) = machine.screed(&format!("{print} @other.toml --real-robot"));
    assert!(code == Some(3) && error.contains("expected 1, found 20220000000"), "{error}");
    let (code, _, error) = machine.screed(&format!("{print} @own.toml --real-robot --serial 20220000000"));
    assert!(code == Some(4) && error.contains("none plays") && error.contains("--upload"), "{error}");
    // Nobody is at a terminal; then somebody names another robot.
    let (code, _, error) = machine.screed(&format!("{print} @own.toml --real-robot --upload"));
    assert!(code == Some(1) && error.contains("no terminal"), "{error}");
    let (code, _, error) = machine.at_terminal(&format!("{print} @own.toml --real-robot --upload"), &["upload", "2"]);
    assert!(code == Some(2) && error.contains("expected 20220000000, found \"2\""), "{error}");

    // The program plays by now. The number is typed, the motion confirmed.
    let (mut person, terminal) = TTYPort::pair().unwrap();
    let input = File::options().read(true).write(true).custom_flags(NOCTTY).open(terminal.name().unwrap()).unwrap();
    let words = machine.words(&format!("{print} @own.toml --real-robot --log @cycles.screedlog"));
    let mut command = machine.scene.screed(&words.iter().map(String::as_str).collect::<Vec<_>>());
    let mut host = command.stdin(Stdio::from(input)).spawn().unwrap();
    let mut asked_person = answered(&mut host, &mut person, &["20220000000", "yes"]);
    thread::sleep(Duration::from_secs(12));
    signal(host.id() as i32, "INT");
    let asked = Instant::now();
    let (code, out, _) = finished(host);
    asked_person.rest();
    let error = asked_person.text;
    assert_eq!(code, Some(130), "{out}{error}");
    assert!(asked.elapsed() < Duration::from_secs(5) && error.contains("first layer is laid at 40 %"), "{error}");
    let (code, csv, error) = machine.screed("log @cycles.screedlog --csv");
    assert_eq!(code, Some(0), "{error}");
    let mut rows = csv.lines();
    let column = rows.next().unwrap().split(',').position(|name| name == "rate").unwrap();
    let rates: Vec<f64> = rows.map(|row| row.split(',').nth(column).unwrap().parse().unwrap()).collect();
    assert!(
        rates.iter().all(|rate| *rate <= 0.4) && rates.iter().filter(|rate| **rate == 0.4).count() > 200,
        "{rates:?}"
    );
    drop((person, terminal));
    signal(extruder.id() as i32, "TERM");
    finished(extruder);
    assert!(machine.robot.try_wait().unwrap().is_none(), "the robot has ended");
}

#[test]
fn a_simulated_robot_is_looked_at_before_a_print_too() {
    let machine = Machine::new("", &["--no-autoplay"]);
    let model = machine.scene.path("wall.ifc");
    fs::write(&model, quarter_circle(&QuarterCircle { layers: 1, ..QuarterCircle::default() })).unwrap();
    let (code, _, error) = machine.screed("print @wall.ifc --yes --allow-non-rt --cell SIMULATED");
    assert!(code == Some(4) && error.contains("none plays") && error.contains("--upload"), "{error}");
    // Uploaded, the print goes on to what is missing next, the extruder.
    let (code, _, error) = machine.screed("print @wall.ifc --yes --allow-non-rt --upload --cell SIMULATED");
    assert!(code == Some(4) && error.contains("Screed's plays") && error.contains("/dev/ttyACM0"), "{error}");
}

/// A dashboard behind a port of this machine, whose robot has another serial number.
fn tunnel(dashboard: u16) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        for person in listener.incoming() {
            let mut person = person.unwrap();
            let Ok(mut robot) = TcpStream::connect(("127.0.0.1", dashboard)) else { return };
            let (mut asks, answers) = (person.try_clone().unwrap(), BufReader::new(robot.try_clone().unwrap()));
            thread::spawn(move || std::io::copy(&mut asks, &mut robot));
            thread::spawn(move || {
                for line in answers.lines() {
                    let line = line.unwrap_or_default().replace("20220000000", "20195500123") + "\n";
                    if person.write_all(line.as_bytes()).is_err() {
                        return;
                    }
                }
            });
        }
    });
    port
}

/// The cell says that its robot is simulated, and the controller does not look so.
#[test]
fn yes_does_not_answer_for_a_robot_behind_a_forwarded_port() {
    let machine = Machine::new("", &[]);
    let place = machine.place();
    let text = fs::read_to_string(machine.scene.path("simulated.toml")).unwrap();
    let (own, forwarded) = (format!("port = {}\n", place.rtde), tunnel(place.dashboard));
    assert!(text.contains(&own));
    fs::write(machine.scene.path("tunnel.toml"), text.replace(&own, &format!("{own}dashboard_port = {forwarded}\n")))
        .unwrap();
    let model = machine.scene.path("wall.ifc");
    fs::write(&model, quarter_circle(&QuarterCircle { layers: 1, ..QuarterCircle::default() })).unwrap();
    for words in ["robot brake-release --yes", "robot play --upload --yes", "print @wall.ifc --allow-non-rt --yes"] {
        let (code, _, error) = machine.screed(&format!("{words} --cell @tunnel.toml"));
        assert!(code == Some(2) && error.contains("(20195500123) is neither"), "{words}: {error}");
    }
    // Nor does a pipe.
    let (code, _, error) = machine.screed("print @wall.ifc --allow-non-rt --cell @tunnel.toml");
    assert!(code == Some(1) && error.contains("neither that of screed sim ur"), "{error}");
    let (code, out, error) = machine.screed("robot status --cell @tunnel.toml");
    assert!(code == Some(0) && out.contains("may be a real robot") && !out.contains("BAD"), "{out}{error}");
    // A person may.
    let (code, out, error) = machine.at_terminal("robot brake-release --cell @tunnel.toml", &["brake-release"]);
    assert!(code == Some(0) && out.contains("robot RUNNING"), "{out}{error}");
}

/// The advice at the end can be followed: nothing is re-armed where the kernel has ended, and the commands name cell and layer.
#[test]
fn a_print_that_ends_on_its_path_names_what_goes_on_from_there() {
    let scene = Scene::new();
    let mut extruder = scene.screed(&["sim", "extruder", "--json", "--exit-when-idle", "60"]).spawn().unwrap();
    let device = announced(&mut extruder, "device");
    let machine = Machine::new("", &[]);
    let text = fs::read_to_string(machine.scene.path("simulated.toml")).unwrap().replace("/dev/ttyACM0", &device);
    fs::write(machine.scene.path("simulated.toml"), text).unwrap();
    let model = machine.scene.path("wall.ifc");
    fs::write(&model, quarter_circle(&QuarterCircle { layers: 2, ..QuarterCircle::default() })).unwrap();
    // Ended by `end` as soon as the arm moves.
    let print = |words: &str, end: &dyn Fn(&str)| {
        let words = machine.words(&format!("print @wall.ifc --yes --allow-non-rt --dry --cell SIMULATED {words}"));
        let mut command = machine.scene.screed(&words.iter().map(String::as_str).collect::<Vec<_>>());
        let mut child = command.spawn().unwrap();
        let (mut text, mut moves) = (String::new(), false);
        for line in BufReader::new(child.stderr.take().unwrap()).lines() {
            let line = line.unwrap();
            text += &line;
            text.push('\n');
            if line.contains("layer 0 of 0 to 1") && !moves {
                moves = true;
                end(&text);
            }
        }
        (finished(child).0, text)
    };
    let (code, error) = print("--layers 2", &|text| {
        let (_, socket) = text.split_once("screed-rt answers at ").unwrap();
        let (socket, _) = socket.split_once(';').unwrap();
        let (code, _, error) = machine.screed(&format!("print @wall.ifc --yes --cell SIMULATED --attach {socket}"));
        assert!(code == Some(4) && error.contains("is busy: another print is attached"), "{error}");
        let (code, _, error) = machine.screed("robot status --cell SIMULATED");
        assert_eq!(code, Some(0), "{error}");
        // Another print of its own is refused before it touches the robot.
        let (code, _, error) = machine.screed("print @wall.ifc --yes --allow-non-rt --cell SIMULATED");
        assert!(code == Some(4) && error.contains("follows setpoints that somebody sends"), "{error}");
        let (code, _, error) = machine.screed("robot stop --cell SIMULATED");
        assert_eq!(code, Some(0), "{error}");
    });
    let again = "simulated.toml --dry --allow-non-rt --upload --from-layer 0 --layers 2 goes on";
    assert!(code == Some(5) && error.contains("alarm: K3") && error.contains(again), "{error}");
    assert!(error.contains("; screed robot status --cell /") && !error.contains("re-arm"), "{error}");
    assert!(error.contains("remedy: look at the robot's program and safety state"), "{error}");
    let (code, error) = print("--upload --layers 2", &|_| signal(machine.robot.id() as i32, "KILL"));
    assert!(code == Some(4) && error.contains("alarm: K15") && error.contains(again), "{error}");
    assert!(error.contains("; screed robot status --cell /") && !error.contains("re-arm"), "{error}");
    signal(extruder.id() as i32, "TERM");
    finished(extruder);
}

#[test]
fn the_calibration_is_written_to_a_file_that_a_cell_takes() {
    let folder = Scene::new();
    let unit = folder.path("unit.conf");
    let zero = "[0, 0, 0, 0, 0, 0]";
    let deltas = format!("[mounting]\ndelta_theta = {zero}\ndelta_alpha = {zero}\ndelta_a = [0, 0.002, 0, 0, 0, 0]\n");
    fs::write(&unit, deltas + "delta_d = [0, 0, 0, 0, 0, 0.001]\n").unwrap();
    let machine = Machine::new(&format!("calibration = {:?}", unit.to_str().unwrap()), &[]);
    let text = fs::read_to_string(machine.scene.path("simulated.toml")).unwrap();
    let port = text.lines().find_map(|line| line.strip_prefix("port = ")).unwrap();
    let (code, out, error) = machine.screed(&format!("robot calibration --address 127.0.0.1:{port} --out @read.conf"));
    assert!(code == Some(0) && out.is_empty() && error.contains("ur10e, serial number 20220000000"), "{error}");
    let (code, _, error) = machine.screed(&format!("robot calibration --address 127.0.0.1:{port} --out @read.yaml"));
    assert!(code == Some(2) && error.contains(".conf"), "{error}");
    let (code, _, error) = machine.screed(&format!("robot calibration --model ur5e --address 127.0.0.1:{port}"));
    assert!(code == Some(3) && error.contains("no calibration of a ur5e"), "{error}");
    let line = text.lines().find(|line| line.starts_with("calibration")).unwrap();
    fs::write(machine.scene.path("nominal.toml"), text.replace(line, "")).unwrap();
    fs::write(machine.scene.path("read.toml"), text.replace(line, "calibration = \"read.conf\"")).unwrap();
    let (code, out, _) = machine.screed("robot status --cell @nominal.toml");
    assert!(code == Some(3) && out.contains("BAD   kinematics"), "{out}");
    let (code, out, error) = machine.screed("robot status --cell @read.toml");
    assert!(code == Some(0) && !out.contains("BAD"), "{out}{error}");
}
