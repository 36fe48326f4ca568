//! Cuts of the link between `screed-rt` and a simulated controller in real time, as processes on loopback with a relay between: by
//! reset, by silence, by half a package, by a controller that is killed and started again, at seeded instants of the demo's print.
//!
//! Judged by the robot's own record, in its own cycles, and by the host's words: within the watchdog and one cycle after the last
//! package the robot's program has ended; the print ends with exit code 4 within the time-out and [`ALLOWANCE`]; nothing moves until
//! a person has re-armed, and then the arm holds. Last a control: a robot whose watchdog does nothing has to be found out. Exit code
//! 1 when a rule is broken. `--cuts N` (20); needs the programs of the same build. The same is exact in virtual time: `tests/cuts.rs`.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::scene::{Scene, announced, finished, program, signal};
use common::{Cycle, Random, program_with, read_record};
use screed::config::Cell;
use screed::link::rtde::program::WatchdogAction;
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, FromKernel, ModeCode, Reader, Status, ToKernel, WIRE_MAX};
use std::fs;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

/// At once: five processes each.
const TOGETHER: usize = 2;
/// What processes of a busy machine may add to the time-out until the print has ended: its last words to screed-rt, its table.
const ALLOWANCE: Duration = Duration::from_millis(1000);
/// A cut before which the machine itself has broken the link is made again, so often.
const TRIES: u32 = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Reset,
    Silence,
    HalfPackage,
    Restart,
}

const KINDS: [Kind; 4] = [Kind::Reset, Kind::Silence, Kind::HalfPackage, Kind::Restart];

/// What a pair of connections does with what comes.
const PASS: u8 = 0;
const DROP: u8 = 1;
const HALF: u8 = 2;
const RESET: u8 = 3;
const CLOSE: u8 = 4;

/// A relay between `screed-rt` and the robot.
struct Relay {
    address: SocketAddr,
    /// How each pair behaves, the newest last.
    pairs: Arc<Mutex<Vec<Arc<AtomicU8>>>>,
}

impl Relay {
    fn to(robot: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let pairs = Arc::new(Mutex::new(Vec::new()));
        let shared = Arc::clone(&pairs);
        thread::spawn(move || {
            for near in listener.incoming().flatten() {
                // A robot that is not there: the connection closes again.
                let Ok(far) = TcpStream::connect(robot) else { continue };
                let how = Arc::new(AtomicU8::new(PASS));
                shared.lock().unwrap().push(Arc::clone(&how));
                let (near, far) = (Arc::new(near), Arc::new(far));
                for socket in [&near, &far] {
                    socket.set_nodelay(true).unwrap();
                    socket.set_read_timeout(Some(Duration::from_millis(2))).unwrap();
                }
                for (from, to, halves) in [(&near, &far, false), (&far, &near, true)] {
                    let (from, to, how) = (Arc::clone(from), Arc::clone(to), Arc::clone(&how));
                    thread::spawn(move || pump(&from, &to, &how, halves));
                }
            }
        });
        Self { address, pairs }
    }

    fn set_newest(&self, how: u8) {
        self.pairs.lock().unwrap().last().unwrap().store(how, Ordering::SeqCst);
    }

    /// The robot notices at last that what had been silent is gone.
    fn close_silent(&self) {
        for how in self.pairs.lock().unwrap().iter() {
            let _ = how.compare_exchange(DROP, CLOSE, Ordering::SeqCst, Ordering::SeqCst);
        }
    }
}

fn pump(mut from: &TcpStream, mut to: &TcpStream, how: &AtomicU8, halves: bool) {
    let mut bytes = [0; 4096];
    loop {
        let read = from.read(&mut bytes);
        match how.load(Ordering::SeqCst) {
            RESET => {
                let linger = libc::linger { l_onoff: 1, l_linger: 0 };
                for socket in [from, to] {
                    // SAFETY: the option's value outlives the call and its size is given. It makes the close a reset.
                    unsafe {
                        let size = size_of::<libc::linger>() as libc::socklen_t;
                        let (level, name) = (libc::SOL_SOCKET, libc::SO_LINGER);
                        libc::setsockopt(socket.as_raw_fd(), level, name, (&raw const linger).cast(), size);
                    }
                }
                return;
            }
            CLOSE => return,
            behaviour => match read {
                Ok(0) if behaviour == PASS => {
                    how.store(CLOSE, Ordering::SeqCst);
                    return;
                }
                // What is silent does not tell that one end has gone.
                Ok(0) => thread::sleep(Duration::from_millis(2)),
                Ok(count) if behaviour == PASS => _ = to.write_all(&bytes[..count]),
                Ok(count) if behaviour == HALF && halves => {
                    how.store(DROP, Ordering::SeqCst);
                    let _ = to.write_all(&bytes[..count / 2]);
                }
                // Dropped; or nothing came in two milliseconds.
                _ => {}
            },
        }
    }
}

/// What a cut needs, started: robot, extruder, relay, real-time process.
struct Stand {
    scene: Scene,
    cell: Cell,
    relay: Relay,
    robot: Child,
    robot_port: u16,
    dashboard: SocketAddr,
    socket: PathBuf,
    rt: Child,
    _extruder: Child,
}

fn start_robot(scene: &Scene, port: u16, record: &str) -> Child {
    let mut command = scene.screed(&["sim", "ur", "--json", "--port", &port.to_string(), "--record"]);
    command.arg(scene.path(record)).arg("--program").arg(scene.path("robot.script"));
    command.arg("--cell").arg(scene.path("cell.toml")).spawn().unwrap()
}

fn ports(robot: &mut Child) -> (SocketAddr, SocketAddr) {
    let mut line = String::new();
    let out = robot.stdout.as_mut().unwrap();
    let mut byte = [0];
    while out.read(&mut byte).unwrap() == 1 && byte[0] != b'\n' {
        line.push(byte[0] as char);
    }
    let value: serde_json::Value = serde_json::from_str(&line).unwrap();
    let address = |key: &str| value[key].as_str().unwrap().parse().unwrap();
    (address("listening"), address("dashboard"))
}

fn start(action: WatchdogAction) -> Stand {
    let (scene, cell) = (Scene::new(), Cell::demo(500).unwrap());
    fs::write(scene.path("wall.ifc"), quarter_circle(&QuarterCircle::default())).unwrap();
    fs::write(scene.path("cell.toml"), Cell::demo_text(500).unwrap()).unwrap();
    fs::write(scene.path("robot.script"), program_with(&cell, action, cell.link.watchdog)).unwrap();
    let mut robot = start_robot(&scene, 0, "robot.csv");
    let (rtde, dashboard) = ports(&mut robot);
    let mut extruder = scene.screed(&["sim", "extruder", "--json"]).spawn().unwrap();
    let device = announced(&mut extruder, "device");
    let relay = Relay::to(rtde);
    let socket = scene.path("rt.sock");
    let mut rt = Command::new(program("screed-rt"));
    rt.arg("--cell").arg(scene.path("cell.toml")).arg("--socket").arg(&socket).arg("--allow-non-rt");
    rt.args(["--robot", &relay.address.to_string(), "--extruder", &device]);
    let rt = rt.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let until = Instant::now() + Duration::from_secs(10);
    while !socket.exists() && Instant::now() < until {
        thread::sleep(Duration::from_millis(10));
    }
    Stand { scene, cell, relay, robot, robot_port: rtde.port(), dashboard, socket, rt, _extruder: extruder }
}

/// A host of its own: hears statuses and says single messages.
struct Host {
    stream: UnixStream,
    reader: Reader,
    status: Option<Status>,
    alarms: Vec<String>,
}

impl Host {
    fn attach(socket: &Path) -> Self {
        let stream = UnixStream::connect(socket).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
        let mut host = Self { stream, reader: Reader::new(), status: None, alarms: Vec::new() };
        host.say(&ToKernel::Hello);
        host
    }

    fn say(&mut self, message: &ToKernel) {
        let mut bytes = [0; WIRE_MAX];
        let used = frame::encode(message, &mut bytes).unwrap();
        self.stream.write_all(&bytes[..used]).unwrap();
    }

    /// Listens until a status fits, for ten seconds at most.
    fn until(&mut self, fits: impl Fn(&Status) -> bool) -> Result<Status, String> {
        let until = Instant::now() + Duration::from_secs(10);
        let mut bytes = [0; 65536];
        while Instant::now() < until {
            let count = self.stream.read(&mut bytes).unwrap_or(0);
            for byte in &bytes[..count] {
                match self.reader.push(*byte).map(|frame| frame::decode(frame.unwrap()).unwrap()) {
                    Some(FromKernel::Status(status)) => self.status = Some(status),
                    Some(FromKernel::Alarm { note, .. }) => self.alarms.push(note.as_str().to_owned()),
                    _ => {}
                }
            }
            if let Some(status) = self.status.filter(|status| fits(status)) {
                return Ok(status);
            }
        }
        Err(format!("status {:?}, alarms {:?}", self.status, self.alarms))
    }
}

/// Why a cut was no cut, or what rule it broke.
enum Wrong {
    /// The link had failed before: this machine stood still.
    Machine(String),
    Rule(String),
}

fn rule(text: String) -> Wrong {
    Wrong::Rule(text)
}

/// The robot's rows from the one with the last package on; in its own cycles.
fn after_last_package(rows: &[Cycle]) -> &[Cycle] {
    let last = rows.iter().rposition(|row| row.packages > 0).unwrap_or(0);
    &rows[last..]
}

/// Prints, cuts after so long, and judges. Gives: cycles from the last package to the program's end, and the time to the report.
fn cut(kind: Kind, after: Duration, action: WatchdogAction) -> Result<(usize, Duration), Wrong> {
    let mut stand = start(action);
    let mut print = stand.scene.screed(&["print", "--yes", "--layers", "1", "--attach"]);
    let print = print.arg(&stand.socket).arg(stand.scene.path("wall.ifc"));
    let mut print = print.arg("--cell").arg(stand.scene.path("cell.toml")).spawn().unwrap();
    thread::sleep(after);
    if print.try_wait().unwrap().is_some() {
        return Err(Wrong::Machine(finished(print).2));
    }
    let began = Instant::now();
    match kind {
        Kind::Reset => stand.relay.set_newest(RESET),
        Kind::Silence => stand.relay.set_newest(DROP),
        Kind::HalfPackage => stand.relay.set_newest(HALF),
        Kind::Restart => {
            // Its record is written when it ends in order; its connections close with it.
            signal(stand.robot.id() as i32, "TERM");
        }
    }
    while print.try_wait().unwrap().is_none() && began.elapsed() < Duration::from_secs(20) {
        thread::sleep(Duration::from_millis(1));
    }
    let told = began.elapsed();
    if print.try_wait().unwrap().is_none() {
        print.kill().unwrap();
    }
    let (code, _, error) = finished(print);
    let timeout = Duration::from_secs_f64(stand.cell.link.timeout);
    let (due, words) = match kind {
        Kind::Reset | Kind::Restart => (Duration::ZERO, "closed the connection"),
        Kind::Silence => (timeout, "nothing from the robot for"),
        Kind::HalfPackage => (timeout, "the rest not within"),
    };
    if code != Some(4) || !error.contains(words) {
        return Err(rule(format!("the print ended with {code:?}: {error}")));
    }
    if told > due + ALLOWANCE || told < due.saturating_sub(Duration::from_millis(20)) {
        return Err(rule(format!("told after {told:?}, due after {due:?}")));
    }
    // The watchdog's time, and some more in which nothing may move.
    thread::sleep(Duration::from_secs_f64(stand.cell.link.watchdog) + Duration::from_millis(500));
    make_ready(&mut stand, kind);
    holds_until_re_armed(&mut stand, kind)?;
    Ok((judge_stop(&mut stand, kind)?, told))
}

/// A person at the teach pendant starts the program again, or the controller is switched on again.
fn make_ready(stand: &mut Stand, kind: Kind) {
    if kind == Kind::Restart {
        let _ = stand.robot.wait();
        let again = start_robot(&stand.scene, stand.robot_port, "again.csv");
        stand.robot = again;
        ports(&mut stand.robot);
        return;
    }
    let mut dashboard = TcpStream::connect(stand.dashboard).unwrap();
    dashboard.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    dashboard.write_all(b"play\n").unwrap();
    let mut bytes = [0; 512];
    while dashboard.read(&mut bytes).is_ok_and(|count| !bytes[..count].windows(7).any(|w| w == b"program")) {}
}

/// The link comes back, nothing is sent; re-armed, the arm holds.
fn holds_until_re_armed(stand: &mut Stand, kind: Kind) -> Result<(), Wrong> {
    let mut host = Host::attach(&stand.socket);
    let status = host.until(|status| status.fault.is_some()).map_err(rule)?;
    let report = status.fault.unwrap();
    if report.fault != Fault::Link || status.mode != ModeCode::Faulted {
        return Err(rule(format!("{status:?}")));
    }
    // It tries again every second; then states come, by which the ticks go on.
    thread::sleep(Duration::from_millis(1200));
    stand.relay.close_silent();
    let ticks = status.tick;
    host.until(|status| status.tick > ticks + 500).map_err(rule)?;
    if host.status.and_then(|status| status.fault) != Some(report) {
        return Err(rule(format!("the fault has gone by itself: {:?}", host.status)));
    }
    let said = host.alarms.join("; ");
    if matches!(kind, Kind::Silence | Kind::HalfPackage) && !said.contains("in use") {
        return Err(rule(format!("nothing was said of the connection that still stood: {said}")));
    }
    host.say(&ToKernel::Rearm { fault: report.number });
    host.until(|status| status.mode == ModeCode::Holding).map_err(rule)?;
    thread::sleep(Duration::from_millis(500));
    host.say(&ToKernel::Quit);
    // The process ends, and then the robot writes its record.
    let until = Instant::now() + Duration::from_secs(5);
    while stand.rt.try_wait().unwrap().is_none() && Instant::now() < until {
        let _ = host.stream.read(&mut [0; 65536]);
    }
    match stand.rt.try_wait().unwrap() {
        Some(status) if status.success() => Ok(()),
        other => Err(rule(format!("screed-rt ended with {other:?}"))),
    }
}

/// What the robot did, by its record: stopped in time, stood still, held.
fn judge_stop(stand: &mut Stand, kind: Kind) -> Result<usize, Wrong> {
    signal(stand.robot.id() as i32, "TERM");
    let _ = stand.robot.wait();
    let rows = read_record(&stand.scene.path("robot.csv"));
    let watchdog = (stand.cell.link.watchdog * 500.0).round() as usize;
    let (stopped, rest) = if kind == Kind::Restart {
        // It was ended at once; what counts is the record of the one that followed.
        (0, read_record(&stand.scene.path("again.csv")))
    } else {
        let playing = |row: &Cycle| row.runtime_state == 2;
        let end = rows.windows(2).position(|w| playing(&w[0]) && !playing(&w[1])).map(|end| end + 1);
        let end = end.ok_or_else(|| rule("the robot's program goes on".to_owned()))?;
        let cycles = after_last_package(&rows[..end]).len();
        if cycles > watchdog + 1 {
            return Err(rule(format!("the program ended {cycles} cycles after the last package")));
        }
        let speed = |w: &[Cycle]| (0..6).map(|j| (w[1].actual_q[j] - w[0].actual_q[j]).abs()).fold(0.0, f64::max);
        let speeds: Vec<f64> = rows[end - 1..].windows(2).map(speed).collect();
        let rest = speeds.iter().position(|speed| *speed == 0.0);
        let rest = rest.ok_or_else(|| rule("it never stands".to_owned()))?;
        if speeds[..rest].windows(2).any(|w| w[1] > w[0] + 1e-12) || rest > 105 {
            return Err(rule(format!("it did not brake: {rest} cycles")));
        }
        (cycles, rows[end + rest..].to_vec())
    };
    // Nothing moves in all that follows; what is sent after re-arming is where the joints are.
    let Some(at) = rest.first().map(|row| row.actual_q) else { return Err(rule("no record".to_owned())) };
    let held = rest.iter().filter(|row| row.packages > 0).count();
    if let Some(row) = rest.iter().find(|row| row.actual_q != at || (row.packages > 0 && row.registers != at)) {
        return Err(rule(format!("it moved: {row:?}")));
    }
    if held < 100 { Err(rule(format!("re-armed it was sent {held} packages"))) } else { Ok(stopped) }
}

/// The same again where the machine was to blame.
fn judged(kind: Kind, after: Duration, action: WatchdogAction) -> Result<(usize, Duration), String> {
    for _ in 0..TRIES {
        match cut(kind, after, action) {
            Ok(found) => return Ok(found),
            Err(Wrong::Rule(text)) => return Err(text),
            Err(Wrong::Machine(text)) => println!("  again: the machine broke the link before the cut: {text}"),
        }
    }
    Err(format!("the machine broke the link before the cut {TRIES} times"))
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let cuts = arguments.iter().position(|argument| argument == "--cuts").map(|at| arguments[at + 1].parse().unwrap());
    let cuts: usize = cuts.unwrap_or(20);
    let mut random = Random::new(77);
    let planned: Vec<(Kind, Duration)> = (0..cuts)
        .map(|number| (KINDS[number % KINDS.len()], Duration::from_secs_f64(random.between(3.0, 11.0))))
        .collect();
    let mut broken = 0;
    let (mut latest, mut slowest) = (0, Duration::ZERO);
    for part in planned.chunks(TOGETHER) {
        let found: Vec<_> = thread::scope(|scope| {
            let started: Vec<_> = part
                .iter()
                .map(|&(kind, after)| (kind, after, scope.spawn(move || judged(kind, after, WatchdogAction::Stop))))
                .collect();
            started.into_iter().map(|(kind, after, cut)| (kind, after, cut.join())).collect()
        });
        for (kind, after, result) in found {
            match result {
                Ok(Ok((cycles, told))) => {
                    let end = match kind {
                        Kind::Restart => "the controller was ended".to_owned(),
                        _ => format!("program ended {cycles} cycles after the last package"),
                    };
                    println!("{kind:?} after {after:.2?}: {end}, told in {told:.0?}");
                    (latest, slowest) = (latest.max(cycles), slowest.max(told));
                }
                Ok(Err(text)) => {
                    println!("{kind:?} after {after:.2?}: BROKEN: {text}");
                    broken += 1;
                }
                Err(_) => broken += 1,
            }
        }
    }
    // The control: with nobody to stop it, the robot's program goes on.
    let control = judged(Kind::Silence, Duration::from_secs(4), WatchdogAction::Ignore);
    let found_out = matches!(&control, Err(text) if text.contains("goes on"));
    println!("control, a watchdog that does nothing: {}", if found_out { "found out" } else { "NOT found out" });
    println!(
        "{cuts} cuts, {broken} broken rules; program ended {latest} cycles after the last package at most, told in {slowest:.0?}"
    );
    if broken > 0 || !found_out {
        if let Err(text) = control {
            println!("control: {text}");
        }
        std::process::exit(1);
    }
}
