//! A simulated controller in a thread or a process, and a person at a terminal beside it.

use super::scene::{Scene, announced, finished, signal};
use screed::config::Cell;
use screed::failure::{Exit, Failure};
use screed::link::rtde::wire::Protocol;
use screed::run::controller::check::{self, Verdict};
use screed::run::controller::{Place, view};
use screed::run::demo;
use screed::sim::ur::Options;
use screed::sim::ur::inputs::Fieldbus;
use screed::sim::ur::server::{ServeOptions, Server};
use serialport::{SerialPort, TTYPort};
use std::fs::{self, File};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::OpenOptionsExt;
use std::process::{Child, ChildStderr, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// A simulated controller of the cell in a thread of its own, that ends when nobody has been connected for a while.
pub fn serve(cell: &Cell, change: impl FnOnce(&mut Options)) -> Place {
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

pub fn bad(cell: &Cell, place: &Place) -> Vec<&'static str> {
    let view = view::view(place, cell.link.register_offset).unwrap();
    let findings = check::judge(cell, &view);
    findings.into_iter().filter(|f| matches!(f.verdict, Verdict::Bad { .. })).map(|finding| finding.what).collect()
}

pub fn refused<T: std::fmt::Debug>(result: Result<T, Failure>, exit: Exit, texts: &[&str]) {
    let failure = result.unwrap_err();
    let told = failure.to_string();
    assert!(failure.exit == exit && told.contains("remedy: "), "{exit:?}: {told}");
    for text in texts {
        assert!(told.contains(text), "{text}: {told}");
    }
}

/// An RTDE client that sends setpoints to hold `joints` 50 times a second, until it is dropped.
pub struct Sender(Option<mpsc::Sender<()>>, Option<thread::JoinHandle<()>>);

impl Sender {
    pub fn new(place: &Place, joints: [f64; 6]) -> Self {
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

/// RTDE's port with room for the others below it; tests that run at once look in places of their own.
pub fn free_ports() -> u16 {
    static PLACES: AtomicU16 = AtomicU16::new(0);
    let free = |port: u16| (0..6).all(|below| TcpListener::bind(("127.0.0.1", port - below)).is_ok());
    let start = 16_000 + (std::process::id() % 8_000) as u16 + 1_000 * PLACES.fetch_add(1, Ordering::Relaxed);
    (0..100_u16).map(|step| start + 7 * step).find(|port| free(*port)).expect("free ports")
}

/// A scene with a cell file whose robot is simulated, or counts as real, and the robot.
pub struct Machine {
    pub scene: Scene,
    pub robot: Child,
}

impl Machine {
    pub fn new(robot: &str, more: &[&str]) -> Self {
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

    pub fn place(&self) -> Place {
        let text = fs::read_to_string(self.scene.path("real.toml")).unwrap();
        let port = text.lines().find_map(|line| line.strip_prefix("port = ")).unwrap();
        Place::new("127.0.0.1", port.parse().unwrap()).unwrap()
    }

    /// Without a terminal: exit code, standard output and error.
    pub fn screed(&self, words: &str) -> (Option<i32>, String, String) {
        let words: Vec<String> = self.words(words);
        finished(self.scene.screed(&words.iter().map(String::as_str).collect::<Vec<_>>()).spawn().unwrap())
    }

    /// SIMULATED and REAL stand for the cell files.
    pub fn words(&self, words: &str) -> Vec<String> {
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
    pub fn at_terminal(&self, words: &str, answers: &[&str]) -> (Option<i32>, String, String) {
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
pub struct Asked {
    stderr: ChildStderr,
    pub text: String,
}

impl Asked {
    /// Reads until it ends, or until the last line is a question.
    pub fn question(&mut self) -> bool {
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

    pub fn rest(&mut self) {
        while self.question() {}
    }
}

/// A person answers each question when it is shown, with the next of `answers`.
pub fn answered(child: &mut Child, person: &mut TTYPort, answers: &[&str]) -> Asked {
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
pub const NOCTTY: i32 = 0o400;

impl Drop for Machine {
    fn drop(&mut self) {
        signal(self.robot.id() as i32, "TERM");
        let _ = self.robot.wait();
    }
}
