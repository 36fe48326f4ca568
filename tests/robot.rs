//! The robot's controller from the host's side, over true sockets: looked at, powered, given its program; servers that are none; and
//! a print on a robot that counts as real.

mod common;

use common::scene::{Scene, announced, finished, signal};
use screed::config::Cell;
use screed::failure::{Exit, Failure};
use screed::link::dashboard::{ProgramState, RobotMode, Safety};
use screed::link::rtde::program::ProgramState as ProgramPhase;
use screed::link::rtde::wire::Protocol;
use screed::run::controller::acts::{Act, act};
use screed::run::controller::check::{self, Verdict};
use screed::run::controller::{DashboardLine, Place, inputs, program, view};
use screed::run::demo;
use screed::sim::ur::Options;
use screed::sim::ur::inputs::Fieldbus;
use screed::sim::ur::robot::Generation;
use screed::sim::ur::server::{ServeOptions, Server};
use screed_fixtures::{QuarterCircle, quarter_circle};
use serialport::{SerialPort, TTYPort};
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::OpenOptionsExt;
use std::process::{Child, ChildStderr, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// A simulated controller of the cell in a thread of its own, that ends when nobody has been connected for a while.
fn serve(cell: &Cell, change: impl FnOnce(&mut Options)) -> Place {
    let mut controller = Options::of(cell, demo::program(cell).unwrap());
    (controller.powered, controller.autoplay) = (false, false);
    change(&mut controller);
    let options = ServeOptions {
        arm: cell.robot.arm,
        controller,
        host: [127, 0, 0, 1].into(),
        port: 0,
        allow_remote: false,
        record: None,
        exit_when_idle: Some(Duration::from_secs(20)),
        rtde_protocol: Protocol::Two,
        fieldbus: Fieldbus::Off,
        faults: Vec::new(),
        control: false,
        json: true,
        stop: || false,
    };
    let mut server = Server::bind(&options).unwrap();
    let [rtde, primary, _, _, dashboard] = server.addresses().map(|address| address.port());
    thread::spawn(move || server.run(|| false).unwrap());
    Place { host: "127.0.0.1".to_owned(), dashboard, primary, rtde }
}

fn bad(cell: &Cell, place: &Place) -> Vec<&'static str> {
    let view = view::view(place, cell.link.register_offset).unwrap();
    let findings = check::judge(cell, &view);
    findings.into_iter().filter(|f| matches!(f.verdict, Verdict::Bad { .. })).map(|finding| finding.what).collect()
}

fn refused<T: std::fmt::Debug>(result: Result<T, Failure>, exit: Exit, texts: &[&str]) {
    let failure = result.unwrap_err();
    let told = failure.to_string();
    assert!(failure.exit == exit && told.contains("remedy: "), "{exit:?}: {told}");
    for text in texts {
        assert!(told.contains(text), "{text}: {told}");
    }
}

#[test]
fn a_robot_of_either_generation_is_powered_given_its_program_and_found_ready() {
    for (generation, rate, offset) in
        [(Generation::ESeries, 500, 0), (Generation::ESeries, 125, 24), (Generation::Cb3, 125, 24)]
    {
        let mut cell = Cell::demo(rate).unwrap();
        cell.link.register_offset = offset;
        if generation == Generation::Cb3 {
            (cell.robot.model, cell.robot.arm) = ("ur10".to_owned(), screed_kernel::arms::ur::UR10);
        }
        let place = serve(&cell, |options| options.generation = generation);
        let text = demo::program(&cell).unwrap();
        assert_eq!(bad(&cell, &place), ["robot", "program"]);
        let mut line = DashboardLine::connect(&place).unwrap();
        refused(act(&mut line, Act::Play), Exit::Link, &["Failed to execute: play", "POWER_OFF", "power-on"]);
        refused(program::upload(&place, offset, &text), Exit::Link, &["not ready", "has no power"]);
        assert_eq!(act(&mut line, Act::PowerOn).unwrap().mode, RobotMode::Idle);
        assert_eq!(act(&mut line, Act::BrakeRelease).unwrap().mode, RobotMode::Running);
        assert_eq!(bad(&cell, &place), ["program"]);
        program::upload(&place, offset, &text).unwrap();
        assert_eq!(bad(&cell, &place), [""; 0]);
        // A program that runs is not replaced.
        refused(program::upload(&place, offset, &text), Exit::Link, &["a program runs", "screed robot stop"]);
        assert_eq!(act(&mut line, Act::Stop).unwrap().program, ProgramState::Stopped);
        // The installed one is Screed's too.
        assert_eq!(act(&mut line, Act::Play).unwrap().program, ProgramState::Playing);
        assert_eq!(bad(&cell, &place), [""; 0]);
        assert_eq!(act(&mut line, Act::PowerOff).unwrap().mode, RobotMode::PowerOff);
    }
}

/// An RTDE client that sends setpoints to hold `joints` 50 times a second, until it is dropped.
struct Sender(Option<mpsc::Sender<()>>, Option<thread::JoinHandle<()>>);

impl Sender {
    fn new(place: &Place, joints: [f64; 6]) -> Self {
        let mut stream = TcpStream::connect((place.host.as_str(), place.rtde)).unwrap();
        let mut ask = |kind: u8, content: &[u8]| {
            let package = [&(content.len() as u16 + 3).to_be_bytes()[..], &[kind], content].concat();
            stream.write_all(&package).unwrap();
            let mut head = [0; 3];
            stream.read_exact(&mut head).unwrap();
            let mut answer = vec![0; usize::from(u16::from_be_bytes([head[0], head[1]])) - 3];
            stream.read_exact(&mut answer).unwrap();
            answer
        };
        ask(b'V', &2_u16.to_be_bytes());
        let doubles: Vec<String> = (0..6).map(|n| format!("input_double_register_{n}")).collect();
        let recipe = ask(b'I', format!("input_int_register_0,{}", doubles.join(",")).as_bytes());
        assert_eq!(recipe[0], 1, "{recipe:?}");
        let (end, ended) = mpsc::channel::<()>();
        let thread = thread::spawn(move || {
            for count in 1_i32.. {
                let values = joints.iter().flat_map(|value| value.to_be_bytes());
                let bytes: Vec<u8> = [0, 56, b'U', 1].into_iter().chain(count.to_be_bytes()).chain(values).collect();
                let wait = ended.recv_timeout(Duration::from_millis(20));
                if stream.write_all(&bytes).is_err() || wait == Err(mpsc::RecvTimeoutError::Disconnected) {
                    return;
                }
            }
        });
        Self(Some(end), Some(thread))
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        drop(self.0.take());
        let _ = self.1.take().map(thread::JoinHandle::join);
    }
}

#[test]
fn only_screeds_own_program_passes_for_it_and_how_far_it_is_is_told() {
    let mut cell = Cell::demo(125).unwrap();
    cell.link.watchdog = 2.0;
    let place = serve(&cell, |options| (options.powered, options.autoplay) = (true, true));
    let program = || {
        let view = view::view(&place, 0).unwrap();
        check::playing(&view)
    };
    thread::sleep(Duration::from_millis(200));
    assert_eq!(program(), Some(ProgramPhase::Waiting));
    let sender = Sender::new(&place, cell.robot.start.0);
    thread::sleep(Duration::from_millis(200));
    assert_eq!(program(), Some(ProgramPhase::Following));
    drop(sender);
    let mut line = DashboardLine::connect(&place).unwrap();
    act(&mut line, Act::Stop).unwrap();
    assert_eq!(program(), None);
    // The register still says that Screed's follows, while another program plays.
    let mut primary = TcpStream::connect((place.host.as_str(), place.primary)).unwrap();
    primary.write_all(b"def other():\n  while True:\n    sync()\n  end\nend\n").unwrap();
    thread::sleep(Duration::from_millis(300));
    let view = view::view(&place, 0).unwrap();
    assert_eq!((view.state.runtime_state, view.state.program_state), (2, 2));
    assert_eq!((check::playing(&view), bad(&cell, &place)), (None, vec!["program"]));
}

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

#[test]
fn a_program_that_the_controller_does_not_take_is_told_as_such() {
    let cell = Cell::demo(125).unwrap();
    let place = serve(&cell, |options| options.powered = true);
    let ours = demo::program(&cell).unwrap();
    let upload = |text: &str| program::upload(&place, 0, text);
    // It does not load.
    refused(upload(&ours.replace("servoj(", "servoi(")), Exit::Link, &["did not take the program", "no program plays"]);
    // It runs and is another.
    let other = "def other():\n  while True:\n    sync()\n  end\nend\n";
    refused(upload(other), Exit::Link, &["did not take the program", "output registers are not Screed's"]);
    assert_eq!(bad(&cell, &place), ["program"]);
    let mut line = DashboardLine::connect(&place).unwrap();
    act(&mut line, Act::Stop).unwrap();
    // Its registers are others.
    let mut shifted = cell.clone();
    shifted.link.register_offset = 24;
    refused(upload(&demo::program(&shifted).unwrap()), Exit::Link, &["output registers are not Screed's"]);
    act(&mut line, Act::Stop).unwrap();
    upload(&ours).unwrap();
}

#[test]
fn stops_and_popups_are_found_and_left_by_a_person() {
    let cell = Cell::demo(125).unwrap();
    let stop = "def stop():\n  popup(\"look\", blocking=True)\n  protective_stop()\nend\n";
    let place = serve(&cell, |options| {
        (options.powered, options.autoplay, options.program) = (true, true, stop.to_owned());
    });
    thread::sleep(Duration::from_millis(200));
    assert_eq!(bad(&cell, &place), ["program"]);
    let mut line = DashboardLine::connect(&place).unwrap();
    assert!(
        Act::ClosePopup.warning(&view::standing(&mut line).unwrap()).is_some(),
        "closing it lets the program go on"
    );
    act(&mut line, Act::ClosePopup).unwrap();
    thread::sleep(Duration::from_millis(200));
    assert_eq!(bad(&cell, &place), ["safety"]);
    refused(act(&mut line, Act::Unlock), Exit::SafetyStop, &["until 5s", "PROTECTIVE_STOP", "wait five seconds"]);
    refused(act(&mut line, Act::Play), Exit::SafetyStop, &["PROTECTIVE_STOP", "screed robot unlock"]);
    refused(program::upload(&place, 0, &demo::program(&cell).unwrap()), Exit::Link, &["a program runs"]);
    thread::sleep(Duration::from_secs(5));
    assert_eq!(act(&mut line, Act::Unlock).unwrap().safety, Safety::Normal);
    // Nothing goes on by itself.
    assert_eq!(view::standing(&mut line).unwrap().program, ProgramState::Paused);
    assert_eq!(bad(&cell, &place), ["program"]);
}

#[test]
fn another_robot_than_the_cells_is_found() {
    let cell = Cell::demo(125).unwrap();
    let mut other = cell.clone();
    other.robot.model = "ur5e".to_owned();
    other.robot.arm = screed_kernel::arms::ur::UR5E;
    let place = serve(&other, |options| (options.powered, options.autoplay) = (true, true));
    thread::sleep(Duration::from_millis(200));
    assert_eq!(bad(&cell, &place), ["robot model", "kinematics", "tool pose"]);
    assert_eq!(bad(&other, &place), [""; 0]);
    // Where ports are not as on a robot, the cell names them.
    let mut forwarded = other.clone();
    forwarded.link.port = place.rtde;
    (forwarded.link.dashboard_port, forwarded.link.primary_port) = (Some(place.dashboard), Some(place.primary));
    assert_eq!(Place::of(&forwarded).unwrap(), place);
    let mut named = other.clone();
    named.robot.serial = Some("1".to_owned());
    assert_eq!(bad(&named, &place), ["serial number"]);
}

/// What one answers who listens: to the first line of a client, or at once.
fn stranger(answer: &'static [u8], ends: bool) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        let mut kept: Vec<TcpStream> = Vec::new();
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let _ = stream.write_all(answer);
            if !ends {
                kept.push(stream);
            }
        }
    });
    port
}

#[test]
fn servers_that_are_no_controller_are_told_apart_and_waited_for_in_vain_only_so_long() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let at = |port| Place { host: "127.0.0.1".to_owned(), dashboard: port, primary: port, rtde: port };
    let standing = |port| {
        let mut line = DashboardLine::connect(&at(port)).map_err(Failure::from)?;
        line.set_patience(Duration::from_millis(300));
        view::standing(&mut line).map_err(Failure::from)
    };
    refused(standing(free), Exit::Link, &["does not answer"]);
    refused(standing(stranger(b"", false)), Exit::Link, &["says nothing"]);
    refused(standing(stranger(b"", true)), Exit::Link, &["closed the connection"]);
    refused(standing(stranger(b"220 mail\n", false)), Exit::Link, &["no dashboard", "220 mail"]);
    let hello = b"Connected: Universal Robots Dashboard Server\nNormal\n";
    refused(standing(stranger(hello, false)), Exit::Link, &["Normal"]);
    let kinematics = |port| view::kinematics(&at(port)).map_err(Failure::from);
    refused(
        kinematics(stranger(b"HTTP/1.1 400 Bad Request\r\n", false)),
        Exit::Link,
        &["bytes on the primary interface"],
    );
    refused(kinematics(stranger(b"", true)), Exit::Link, &["closed the connection"]);
    // A dashboard that is one, and an RTDE that is none.
    let place = serve(&Cell::demo(125).unwrap(), |_| {});
    let look = |rtde| view::view(&Place { rtde, ..place.clone() }, 0).map_err(Failure::from);
    refused(look(stranger(b"\x00\x05V\x00", false)), Exit::Link, &["RTDE", "check address and port"]);
    refused(look(stranger(b"\x00\x04V\x00\x00\x04V\x00", false)), Exit::Link, &["protocols 2 and 1"]);
    refused(look(stranger(b"", true)), Exit::Link, &["closed the connection"]);
    refused(look(free), Exit::Link, &["does not answer"]);
}

/// RTDE's port with room for the others below it; tests that run at once look in places of their own.
fn free_ports() -> u16 {
    static PLACES: AtomicU16 = AtomicU16::new(0);
    let free = |port: u16| (0..6).all(|below| TcpListener::bind(("127.0.0.1", port - below)).is_ok());
    let start = 16_000 + (std::process::id() % 8_000) as u16 + 1_000 * PLACES.fetch_add(1, Ordering::Relaxed);
    (0..100_u16).map(|step| start + 7 * step).find(|port| free(*port)).expect("free ports")
}

/// A scene with a cell file whose robot is simulated, or counts as real, and the robot.
struct Machine {
    scene: Scene,
    robot: Child,
}

impl Machine {
    fn new(robot: &str, more: &[&str]) -> Self {
        let (scene, port) = (Scene::new(), free_ports());
        let text = Cell::demo_text(125).unwrap().replace("\n[link]\n", &format!("\n[link]\nport = {port}\n"));
        let text = text.replace("simulated = true", &format!("simulated = true\n{robot}"));
        fs::write(scene.path("simulated.toml"), &text).unwrap();
        fs::write(scene.path("real.toml"), text.replace("simulated = true", "simulated = false")).unwrap();
        let port = port.to_string();
        let mut robot = scene.screed(&["sim", "ur", "--json", "--exit-when-idle", "60", "--port", &port]);
        let mut robot = robot.args(more).arg("--cell").arg(scene.path("simulated.toml")).spawn().unwrap();
        announced(&mut robot, "listening");
        Self { scene, robot }
    }

    fn place(&self) -> Place {
        let text = fs::read_to_string(self.scene.path("real.toml")).unwrap();
        let port = text.lines().find_map(|line| line.strip_prefix("port = ")).unwrap();
        Place::new("127.0.0.1", port.parse().unwrap()).unwrap()
    }

    /// Without a terminal: exit code, standard output and error.
    fn screed(&self, words: &str) -> (Option<i32>, String, String) {
        let words: Vec<String> = self.words(words);
        finished(self.scene.screed(&words.iter().map(String::as_str).collect::<Vec<_>>()).spawn().unwrap())
    }

    /// SIMULATED and REAL stand for the cell files.
    fn words(&self, words: &str) -> Vec<String> {
        let path = |name: &str| self.scene.path(name).to_str().unwrap().to_owned();
        let word = |word: &str| match word {
            "SIMULATED" => path("simulated.toml"),
            "REAL" => path("real.toml"),
            _ if word.starts_with('@') => path(&word[1..]),
            _ => word.to_owned(),
        };
        words.split_whitespace().map(word).collect()
    }

    /// At a terminal where a person answers each question with the next of `answers`.
    fn at_terminal(&self, words: &str, answers: &[&str]) -> (Option<i32>, String, String) {
        let (mut person, terminal) = TTYPort::pair().unwrap();
        let device = terminal.name().unwrap();
        let input = File::options().read(true).write(true).custom_flags(NOCTTY).open(device).unwrap();
        let words = self.words(words);
        let mut command = self.scene.screed(&words.iter().map(String::as_str).collect::<Vec<_>>());
        // What was typed before a question answers none.
        person.write_all(b"power-on\n").unwrap();
        let mut child = command.stdin(Stdio::from(input)).spawn().unwrap();
        let mut asked = answered(&mut child, &mut person, answers);
        let (code, out, _) = finished(child);
        asked.rest();
        drop((person, terminal));
        (code, out, asked.text)
    }
}

/// What a command says on standard error, read as it comes.
struct Asked {
    stderr: ChildStderr,
    text: String,
}

impl Asked {
    /// Reads until it ends, or until the last line is a question.
    fn question(&mut self) -> bool {
        let mut byte = [0];
        while self.stderr.read(&mut byte).unwrap() == 1 {
            self.text.push(char::from(byte[0]));
            let line = self.text.rsplit('\n').next().unwrap();
            if line.contains("Type ") && line.ends_with(": ") {
                return true;
            }
        }
        false
    }

    fn rest(&mut self) {
        while self.question() {}
    }
}

/// A person answers each question when it is shown, with the next of `answers`.
fn answered(child: &mut Child, person: &mut TTYPort, answers: &[&str]) -> Asked {
    let mut asked = Asked { stderr: child.stderr.take().unwrap(), text: String::new() };
    for answer in answers {
        if !asked.question() {
            break;
        }
        person.write_all(format!("{answer}\n").as_bytes()).unwrap();
    }
    asked
}

/// O_NOCTTY: the test's own process shall not get the terminal as its controlling one.
const NOCTTY: i32 = 0o400;

impl Drop for Machine {
    fn drop(&mut self) {
        signal(self.robot.id() as i32, "TERM");
        let _ = self.robot.wait();
    }
}

#[test]
fn commands_need_a_person_at_a_terminal_and_yes_is_for_simulated_robots() {
    let machine = Machine::new("", &["--power-off", "--no-autoplay"]);
    let address = {
        let text = fs::read_to_string(machine.scene.path("real.toml")).unwrap();
        let port = text.lines().find_map(|line| line.strip_prefix("port = ")).unwrap().to_owned();
        format!("127.0.0.1:{port}")
    };
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
    let real = fs::read_to_string(machine.scene.path("real.toml")).unwrap();
    let write = |name: &str, from: &str, to: &str| {
        assert!(real.contains(from), "{from}");
        fs::write(machine.scene.path(name), real.replace(from, to)).unwrap();
    };
    write("named.toml", "simulated = false", "simulated = false\nserial = \"20220000000\"");
    write("other.toml", "simulated = false", "simulated = false\nserial = \"1\"");
    write("model.toml", "model = \"ur10e\"", "model = \"ur5e\"");
    write("unit.toml", "simulated = false", "simulated = true\nserial = \"1\"");
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
    let (code, out, error) = machine.screed(&format!("robot power-off --address {address}"));
    assert!(code == Some(0) && out.contains("POWER_OFF"), "{error}");

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
