//! A kernel at the end of a serial line that spoils bytes, in virtual time: the board's loop without its registers, the host's
//! session, and a seeded line between them. What the board put out is the judge.

use screed::config::Cell;
use screed::model::fim::{self, FimModel};
use screed::plan::{Options as PlanOptions, Plan};
use screed::run::job::{JobError, Outcome};
use screed::run::session::{Session, SessionError, Step, Wishes};
use screed_firmware::{BYTES_MAX, Drives, FollowingDrives, Node, START};
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::arms::ur::{UR5E, UR10E};
use screed_kernel::frame::ModeCode;
use screed_kernel::units::{JointPos, Nanos};
use serialport::{SerialPort, TTYPort};
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Small, seeded, good enough to spoil bytes (Marsaglia, "Xorshift RNGs", 2003).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

/// What the line does to what is sent on it.
enum Line {
    Sound,
    /// One byte in so many is changed, lost or doubled.
    Spoils(Random, u64),
    /// Loses the bytes of this frame, counted from 0.
    Loses(usize, usize),
    /// Loses two of three answers to batches; the frame so far, and how many there were.
    LosesAccepted(Vec<u8>, u32),
}

impl Line {
    fn pass(&mut self, byte: u8, arrived: &mut VecDeque<u8>) {
        match self {
            Self::Sound => arrived.push_back(byte),
            Self::Spoils(random, one_in) => match random.below(*one_in) {
                0 => arrived.push_back(byte ^ 1 << random.below(8)),
                1 => {}
                2 => arrived.extend([byte, byte]),
                _ => arrived.push_back(byte),
            },
            Self::Loses(frame, at) => {
                if frame != at {
                    arrived.push_back(byte);
                }
                *at += usize::from(byte == 0);
            }
            Self::LosesAccepted(frame, count) => {
                frame.push(byte);
                if byte == 0 {
                    // Behind the code of COBS: version 1.0, message 1.
                    let accepted = matches!(frame.as_slice(), [code, 0x10, 1, ..] if *code > 2);
                    *count += u32::from(accepted);
                    if !accepted || count.is_multiple_of(3) {
                        arrived.extend(frame.iter());
                    }
                    frame.clear();
                }
            }
        }
    }
}

/// The board: its loop without registers, and what it put out.
struct Board {
    node: Box<Node<6>>,
    arm: FollowingDrives<6>,
    now: u64,
    last: Option<JointPos<6>>,
    rests: bool,
    /// Setpoints of the path that were put out, each once: how many, the last, those left out between them, and their
    /// fingerprint as `screed` takes it.
    put_out: u32,
    last_seq: u32,
    skipped: u32,
    hash: u64,
    /// Largest step of a joint in a tick (rad).
    step_max: f64,
}

impl Board {
    fn new() -> Self {
        Self {
            node: Box::new(Node::new(&UR10E)),
            arm: FollowingDrives(START),
            now: 0,
            last: None,
            rests: true,
            put_out: 0,
            last_seq: 0,
            skipped: 0,
            hash: 0xcbf2_9ce4_8422_2325,
            step_max: 0.0,
        }
    }

    /// One period: takes from `heard`, says by `say`. The path has so many setpoints.
    fn cycle(&mut self, heard: &mut VecDeque<u8>, say: impl FnMut(&[u8]), planned: u32) {
        self.now += self.node.period_ns();
        let now = Nanos(self.now);
        let bytes: Vec<u8> = (0..BYTES_MAX).map_while(|_| heard.pop_front()).collect();
        let command = self.node.cycle(now, 0, &bytes, &Drives { actual: self.arm.0, ready: true });
        self.arm.follow(&command);
        self.node.report(now, now, say);
        self.rests = !matches!(command.mode.code(), ModeCode::Moving | ModeCode::Stopping);
        let Some(joints) = command.joints else { return };
        let before = self.last.replace(joints).unwrap_or(joints);
        let steps = before.0.iter().zip(joints.0).map(|(before, now)| (now - before).abs());
        self.step_max = steps.fold(self.step_max, f64::max);
        if command.seq > self.last_seq && command.seq <= planned {
            self.put_out += 1;
            self.skipped += command.seq - self.last_seq - 1;
            self.last_seq = command.seq;
            let words = joints.0.into_iter().chain([command.flow]).flat_map(f64::to_le_bytes);
            for byte in command.seq.to_le_bytes().into_iter().chain(words) {
                self.hash = (self.hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
}

/// How a print ended.
struct Run {
    result: Result<Outcome, SessionError>,
    board: Board,
    planned: u32,
    said_again: u64,
    spoilt: u64,
    /// Frames that the host sent.
    frames: usize,
}

/// What becomes of a print.
struct Plot {
    there: Line,
    back: Line,
    stop_after: Option<f64>,
    /// The tick at which the board is reset.
    reset_at: u64,
    /// The tick from which on nothing reaches the board.
    cut_at: u64,
}

const SOUND: Plot =
    Plot { there: Line::Sound, back: Line::Sound, stop_after: None, reset_at: u64::MAX, cut_at: u64::MAX };

struct Scene {
    cell: Cell,
    model: FimModel,
}

impl Scene {
    fn new(rate_hz: u32) -> Self {
        let text = quarter_circle(&QuarterCircle { layers: 1, layer_time: 36.0, ..QuarterCircle::default() });
        Self { cell: Cell::demo(rate_hz).unwrap(), model: fim::parse("wall.ifc", text.as_bytes()).unwrap() }
    }

    /// Prints to the end or to the first error; then the host is gone, and what it sent is played for twelve seconds.
    fn print(&self, mut plot: Plot) -> Run {
        let wishes = Wishes {
            plan: PlanOptions { from_layer: 0, layers: Some(1), dry: false },
            stop_after: plot.stop_after,
            first_layer_rate: None,
        };
        let mut session = Session::new(&self.cell, &self.model, wishes, None);
        session.job().over_a_line(921_600);
        let mut board = Board::new();
        let (mut to_board, mut to_host) = (VecDeque::new(), VecDeque::new());
        let (mut planned, mut frames) = (u32::MAX, 0);
        let rate = u64::from(self.cell.link.rate_hz);
        // A minute and a half is twice what the print takes.
        let result = (0..90 * rate).find_map(|tick| {
            if tick == plot.reset_at {
                *board.node = Node::new(&UR10E);
            }
            let say = |frames: &[u8]| frames.iter().for_each(|&byte| plot.back.pass(byte, &mut to_host));
            board.cycle(&mut to_board, say, planned);
            let step = self.host(&mut session, to_host.make_contiguous(), board.now as f64 * 1e-9);
            to_host.clear();
            planned = session.plan().map_or(u32::MAX, Plan::last_seq);
            for byte in step.as_ref().map_or(&[][..], |(_, said)| said) {
                frames += usize::from(*byte == 0);
                if tick < plot.cut_at {
                    plot.there.pass(*byte, &mut to_board);
                }
            }
            step.map(|(outcome, _)| outcome).transpose()
        });
        let result = result.expect("an end or an error");
        for _ in 0..12 * rate {
            board.cycle(&mut to_board, |_| {}, planned);
        }
        let line = session.job().line().unwrap();
        let spoilt = line.spoilt_from_kernel + u64::from(line.spoilt_to_kernel);
        Run { result, board, planned, said_again: line.said_again, spoilt, frames }
    }

    /// The host hears bytes: how the print ended, if it did, and what it says.
    fn host(
        &self,
        session: &mut Session<'_>,
        bytes: &[u8],
        now: f64,
    ) -> Result<(Option<Outcome>, Vec<u8>), SessionError> {
        session.handle_bytes(bytes)?;
        let outcome = match session.step(now)? {
            Step::Confirm => {
                session.confirm();
                None
            }
            Step::Ended(outcome) => Some(outcome),
            Step::Running | Step::Rearm(_) => None,
        };
        Ok((outcome, std::mem::take(session.poll_transmit()?)))
    }

    fn spoilt(&self, seed: u64, one_in: u64) -> Run {
        let line = |seed| Line::Spoils(Random(seed), one_in);
        self.print(Plot { there: line(2 * seed + 1), back: line(2 * seed + 2), ..SOUND })
    }
}

/// The fingerprint of the same print's waypoints by way of `screed-rt`'s machine.
fn in_virtual_time(scene: &Scene, rate_hz: u32) -> u64 {
    use screed::run::print::Print;
    use screed::run::virtual_time::{self, Virtual};
    let program = screed::run::demo::program(&scene.cell).unwrap();
    let plan = PlanOptions { from_layer: 0, layers: Some(1), dry: false };
    let print = Print {
        cell: &scene.cell,
        model: &scene.model,
        wishes: Wishes { plan, stop_after: None, first_layer_rate: None },
        log: None,
        source: ("wall.ifc", b""),
        yes: true,
        quiet: true,
        again: None,
    };
    let summary = virtual_time::print(&print, Virtual { program, fault: None, record: None, quiet: true }).unwrap();
    assert_eq!((summary.outcome, summary.rate_hz), ("complete", rate_hz));
    u64::from_str_radix(&summary.hash, 16).unwrap()
}

#[test]
fn a_board_puts_out_the_bits_that_screed_rt_does() {
    for rate_hz in [125, 500] {
        let scene = Scene::new(rate_hz);
        let run = scene.print(SOUND);
        assert_eq!(run.result.unwrap(), Outcome::Complete);
        assert_eq!((run.board.put_out, run.board.skipped, run.said_again, run.spoilt), (run.planned, 0, 0, 0));
        assert_eq!(run.board.hash, in_virtual_time(&scene, rate_hz), "{rate_hz} Hz");
        // The board paced itself as the host's configuration says.
        assert_eq!(run.board.node.period_ns(), 1_000_000_000 / u64::from(rate_hz));
    }
}

#[test]
fn over_a_line_that_spoils_bytes_the_print_comes_to_its_end_with_the_same_bits() {
    let scene = Scene::new(125);
    let expected = in_virtual_time(&scene, 125);
    let (mut said_again, mut spoilt) = (0, 0);
    for seed in 1..=8 {
        let run = scene.spoilt(seed, 20_000);
        assert_eq!(run.result.unwrap(), Outcome::Complete, "seed {seed}");
        assert_eq!((run.board.put_out, run.board.skipped, run.board.hash), (run.planned, 0, expected), "seed {seed}");
        (said_again, spoilt) = (said_again + run.said_again, spoilt + run.spoilt);
    }
    assert!(said_again > 8 && spoilt > 100, "{said_again} {spoilt}");
}

#[test]
fn a_line_that_spoils_too_much_ends_the_print_with_its_name_and_the_arm_at_rest_on_the_path() {
    let scene = Scene::new(125);
    let mut failed = 0;
    for seed in 1..=8 {
        let run = scene.spoilt(seed, 600);
        match run.result {
            Ok(Outcome::Complete) => assert_eq!(run.board.put_out, run.planned),
            Err(SessionError::Job(JobError::Unanswered { .. } | JobError::Underrun { .. })) => failed += 1,
            other => panic!("seed {seed}: {other:?}"),
        }
        assert!(run.board.rests && run.board.skipped == 0, "seed {seed}");
        // No joint is faster than the cell allows, 180 degrees a second.
        assert!(run.board.step_max <= 180_f64.to_radians() / 125.0, "seed {seed}: {}", run.board.step_max);
    }
    assert!(failed > 0);
}

#[test]
fn whichever_frame_is_lost_the_host_says_it_again() {
    let scene = Scene::new(125);
    let stop_after = Some(3.0);
    let sound = scene.print(Plot { stop_after, ..SOUND });
    assert!((8..100).contains(&sound.frames), "{}", sound.frames);
    for frame in 0..sound.frames {
        let run = scene.print(Plot { there: Line::Loses(frame, 0), stop_after, ..SOUND });
        assert_eq!(run.result.unwrap(), Outcome::Stopped, "frame {frame}");
        assert!(
            run.board.rests && run.board.skipped == 0 && run.board.put_out > 50,
            "frame {frame}: {}",
            run.board.put_out
        );
    }
    // And back: the first ten seconds have about 1,300.
    for frame in (0..1_300).step_by(37) {
        let run = scene.print(Plot { back: Line::Loses(frame, 0), stop_after, ..SOUND });
        assert_eq!(run.result.unwrap(), Outcome::Stopped, "frame {frame} back");
        assert!(run.board.rests && run.board.skipped == 0, "frame {frame} back");
    }
}

#[test]
fn a_batch_whose_answer_is_lost_is_answered_by_a_status_or_sent_again() {
    for rate_hz in [125, 500] {
        let scene = Scene::new(rate_hz);
        let run = scene.print(Plot { back: Line::LosesAccepted(Vec::new(), 0), ..SOUND });
        assert_eq!(run.result.unwrap(), Outcome::Complete, "{rate_hz} Hz");
        assert_eq!((run.board.put_out, run.board.skipped), (run.planned, 0));
    }
}

#[test]
fn a_board_that_was_reset_is_noticed_and_not_moved() {
    let scene = Scene::new(125);
    for tick in [400, 900, 1_500] {
        let run = scene.print(Plot { reset_at: tick, ..SOUND });
        assert!(matches!(run.result, Err(SessionError::Job(JobError::Reset))), "{:?}", run.result);
        assert!(run.board.rests);
    }
}

#[test]
fn a_line_that_is_cut_one_way_ends_the_print_and_the_ring_is_played_to_its_end() {
    let scene = Scene::new(125);
    for tick in [50, 150, 700, 2_000] {
        let run = scene.print(Plot { cut_at: tick, ..SOUND });
        let cut = matches!(run.result, Err(SessionError::Job(JobError::Unanswered { .. } | JobError::Underrun { .. })));
        assert!(cut, "tick {tick}: {:?}", run.result);
        assert!(run.board.rests && run.board.skipped == 0);
    }
}

/// Exit code and what was said of a print over a device.
fn print_over(device: &str, more: &[&str]) -> (Option<i32>, String) {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures");
    let (model, cell) = (format!("{root}/data/FIM_fixture_IFC4.ifc"), format!("{root}/cells/fim_fixture.toml"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_screed"));
    command.args(["print", &model, "--cell", &cell, "--yes", "--board", device]).args(more);
    let output = command.stdin(Stdio::null()).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// A board that runs for so many ticks in real time; ends when its line is closed or all are over.
fn board_at(mut line: TTYPort, mut node: Box<Node<6>>, ticks: u64) {
    thread::spawn(move || {
        let (begun, mut arm, mut to_host) = (Instant::now(), FollowingDrives(START), Vec::new());
        for tick in 1..=ticks {
            thread::sleep(Duration::from_millis(8 * tick).saturating_sub(begun.elapsed()));
            let now = Nanos(begun.elapsed().as_nanos() as u64);
            let mut bytes = [0; BYTES_MAX];
            let heard = if line.bytes_to_read().unwrap_or(0) > 0 { line.read(&mut bytes).unwrap_or(0) } else { 0 };
            let command = node.cycle(now, 0, &bytes[..heard], &Drives { actual: arm.0, ready: true });
            arm.follow(&command);
            node.report(now, now, |frames| to_host.extend_from_slice(frames));
            // Where nobody reads, a line loses what is sent.
            let _ = line.write(&to_host);
            to_host.clear();
        }
        // Silent, but not closed.
        thread::sleep(Duration::from_secs(10));
    });
}

#[test]
fn a_board_for_another_arm_is_refused_before_anything_moves() {
    let (board, line) = TTYPort::pair().unwrap();
    let device = line.name().unwrap();
    drop(line);
    board_at(board, Box::new(Node::new(&UR5E)), 2_000);
    let (code, said) = print_over(&device, &[]);
    assert_eq!(code, Some(3), "{said}");
    assert!(said.contains("expected \"board, ur10e\", found \"board, ur5e\"") && !said.contains("approach"), "{said}");
}

#[test]
fn a_board_that_falls_silent_is_named() {
    let (board, line) = TTYPort::pair().unwrap();
    let device = line.name().unwrap();
    drop(line);
    board_at(board, Box::new(Node::new(&UR10E)), 500);
    let (code, said) = print_over(&device, &[]);
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains(&format!("the board at {device} has said nothing for 2 s")), "{said}");
    assert!(said.contains("approach"), "it had begun: {said}");
}

#[test]
fn a_device_without_a_board_is_named_and_nothing_is_asked() {
    let (_board, line) = TTYPort::pair().unwrap();
    let device = line.name().unwrap();
    drop(line);
    let (code, said) = print_over(&device, &[]);
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains(&format!("no board answers at {device}")), "{said}");
    let (code, said) = print_over("/nowhere/ttyACM0", &[]);
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains("cannot open the serial device /nowhere/ttyACM0"), "{said}");
    for other in ["--fast", "--allow-non-rt", "--attach=/tmp/rt.sock", "--baud=7"] {
        assert_eq!(print_over(&device, &[other]).0, Some(2), "{other}");
    }
}
