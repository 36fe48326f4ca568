//! The demo's wall, played by the kernel at any rate: the same path, the same bead; and what it costs on the wire.

mod common;

use common::Random;
use nalgebra::Vector3;
use screed::config::Cell;
use screed::model::fim;
use screed::plan::{Options, Plan};
use screed::run::job::frames;
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::frame::{self, Configure, ModeCode, MotionLimits, ToKernel, WIRE_MAX};
use screed_kernel::guard::{Periods, output_least};
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::Nanos;

const LOOK_AHEAD: u32 = 1000;

/// What is said to the kernel at a tick.
type Profile<'a> = &'a mut dyn FnMut(u64) -> Option<ToKernel<'static>>;

/// One tick of a print in motion.
#[derive(Clone, Copy)]
struct Point {
    seq: u32,
    tcp_in_base: Vector3<f64>,
    /// Laid down since the motion began (m³).
    volume: f64,
    deposit: bool,
}

fn plan(cell: &Cell) -> Plan {
    let text = quarter_circle(&QuarterCircle::default());
    let model = fim::parse("quarter-circle.ifc", text.as_bytes()).unwrap();
    let options = Options { layers: Some(1), ..Options::default() };
    Plan::new(&model, cell, &options, &cell.robot.start).unwrap()
}

/// The cell's configuration with so many ticks a setpoint.
fn configure(cell: &Cell, ticks: u64) -> Configure {
    let mut configure = cell.configure();
    configure.tick_period_ns = configure.sample_period_ns / ticks;
    let seconds = |ns: u64| ns as f64 * 1e-9;
    let (sample, tick) = (seconds(configure.sample_period_ns), seconds(configure.tick_period_ns));
    let plan = configure.plan.motion::<6>().unwrap();
    configure.output = MotionLimits::from(&output_least(&plan, Periods { sample, tick }, &configure.correction));
    configure
}

/// Plays the whole plan, and returns every tick in motion.
fn play(cell: &Cell, plan: &Plan, ticks: u64, profile: Profile<'_>) -> Vec<Point> {
    let configure = configure(cell, ticks);
    let (tick_ns, tick) = (configure.tick_period_ns, configure.tick_period_ns as f64 * 1e-9);
    let mut kernel = Box::new(Kernel::<6, 4096>::new(&cell.robot.arm));
    let mut waiting = Vec::new();
    let say = |waiting: &mut Vec<u8>, message: &ToKernel| {
        let mut out = [0; WIRE_MAX];
        let used = frame::encode(message, &mut out).unwrap();
        waiting.extend(&out[..used]);
    };
    say(&mut waiting, &ToKernel::Configure(configure));
    let mut batches = plan.batches().map(Result::unwrap).enumerate().peekable();
    let (mut actual, mut points, mut volume, mut started) = (cell.robot.start, Vec::new(), 0.0, false);
    for number in 1.. {
        let taken = kernel.receive(&waiting);
        waiting.drain(..taken);
        let command: Command<6> = kernel.tick(Nanos(number * tick_ns), &Sensors::robot(actual, true));
        kernel.poll_transmit(&mut [0; 4096]);
        let status = kernel.status();
        assert_eq!((status.fault, status.frames_broken, status.frames_unknown), (None, 0, 0));
        let Some(joints) = command.joints else { continue };
        actual = joints;
        volume += command.flow * tick;
        let moving = matches!(status.mode, ModeCode::Moving | ModeCode::Stopping);
        if moving {
            let tcp = cell.robot.arm.forward(&joints) * cell.tool.flange_from_tcp;
            points.push(Point { seq: command.seq, tcp_in_base: tcp.translation, volume, deposit: command.deposit });
        }
        if !waiting.is_empty() {
            continue;
        }
        // A new motion, or one at rest after a hold, needs a person's word.
        let resume = ToKernel::Resume { epoch: status.epoch };
        if moving {
            match profile(number) {
                Some(ToKernel::Resume { .. }) => say(&mut waiting, &resume),
                Some(message) => say(&mut waiting, &message),
                None => {}
            }
        } else if started && status.consumed == status.end_seq && batches.peek().is_none() {
            return points;
        } else if started {
            say(&mut waiting, &resume);
        }
        let ahead = status.end_seq - status.consumed;
        if ahead >= LOOK_AHEAD || batches.peek().is_none() {
            if !started {
                say(&mut waiting, &resume);
                started = true;
            }
        } else if let Some((number, batch)) = batches.next() {
            waiting.extend(frames(number as u32 + 1, &batch).unwrap());
        }
    }
    points
}

/// How far a point is from the polyline through `path` around `at` (m).
fn distance(path: &[Point], at: usize, point: &Vector3<f64>) -> f64 {
    let near = &path[at.saturating_sub(40)..(at + 60).min(path.len())];
    near.windows(2).fold(f64::INFINITY, |least, w| {
        let (a, step) = (w[0].tcp_in_base, w[1].tcp_in_base - w[0].tcp_in_base);
        let t = ((point - a).dot(&step) / step.norm_squared().max(1e-300)).clamp(0.0, 1.0);
        least.min((point - a - step * t).norm())
    })
}

/// Volume of every whole 10 mm that is laid down (m³).
fn per_centimetre(points: &[Point]) -> Vec<f64> {
    let first = points.iter().position(|point| point.deposit).unwrap();
    let mut marks = Vec::new();
    let mut length = 0.0;
    for w in points[first - 1..].windows(2).take_while(|w| w[1].deposit) {
        let step = (w[1].tcp_in_base - w[0].tcp_in_base).norm();
        while length + step >= 0.01 * marks.len() as f64 && step > 0.0 {
            let share = (0.01 * marks.len() as f64 - length) / step;
            marks.push(w[0].volume + share * (w[1].volume - w[0].volume));
        }
        length += step;
    }
    marks.windows(2).map(|w| w[1] - w[0]).collect()
}

#[test]
fn at_any_rate_the_path_stays_and_the_bead_too() {
    for rate_hz in [125, 500] {
        let cell = Cell::demo(rate_hz).unwrap();
        let plan = plan(&cell);
        let mut full_rate = |_: u64| None;
        let dense = play(&cell, &plan, 16, &mut full_rate);
        let full = per_centimetre(&play(&cell, &plan, 1, &mut full_rate));
        assert!(full.len() > 390, "{}", full.len());
        // Between its samples the path at 100 % is known every sixteenth of a period.
        let mut at_seq = vec![0; 1 + dense.iter().map(|point| point.seq as usize).max().unwrap()];
        dense.iter().enumerate().rev().for_each(|(index, point)| at_seq[point.seq as usize] = index);
        for (seed, ticks) in [(1, 1), (2, if rate_hz == 125 { 4 } else { 1 }), (3, if rate_hz == 125 { 8 } else { 2 })]
        {
            let mut random = Random::new(seed);
            let mut until = 0;
            let mut changing = |tick: u64| {
                if tick < until {
                    return None;
                }
                until = tick + random.bits() % (500 * ticks * u64::from(rate_hz) / 125);
                Some(match random.bits() % 4 {
                    0 => ToKernel::Hold,
                    1 => ToKernel::Resume { epoch: 0 },
                    2 => ToKernel::Rate(1.0),
                    _ => ToKernel::Rate(random.between(0.1, 1.0)),
                })
            };
            let played = play(&cell, &plan, ticks, &mut changing);
            let far = played
                .iter()
                .fold(0.0_f64, |far, point| far.max(distance(&dense, at_seq[point.seq as usize], &point.tcp_in_base)));
            assert!(far < 1e-6, "{rate_hz} Hz, {ticks} ticks: {far:e} m from the path");
            let bead = per_centimetre(&played);
            assert_eq!(bead.len(), full.len());
            let uneven = bead.iter().zip(&full).fold(0.0_f64, |most, (a, b)| most.max((a / b - 1.0).abs()));
            assert!(uneven < 1e-3, "{rate_hz} Hz, {ticks} ticks: a bead off by {uneven:e}");
            println!(
                "{rate_hz} Hz, {ticks} ticks a setpoint, {} ticks: {far:.1e} m from the path, bead within {uneven:.1e}",
                played.len()
            );
        }
    }
}

#[test]
fn a_setpoint_takes_less_than_24_bytes_on_the_wire() {
    for rate_hz in [125, 500] {
        let cell = Cell::demo(rate_hz).unwrap();
        let (mut bytes, mut setpoints, mut path) = (0, 0, 0);
        for (number, batch) in plan(&cell).batches().map(Result::unwrap).enumerate() {
            bytes += frames(number as u32 + 1, &batch).unwrap().len();
            (setpoints, path) = (setpoints + batch.setpoints.len(), path + batch.path_len);
        }
        let each = bytes as f64 / setpoints as f64;
        println!(
            "{rate_hz} Hz: {each:.2} bytes a setpoint, {:.2} a setpoint of the path with its share of the tails",
            bytes as f64 / path as f64
        );
        assert!(each < 24.0, "{rate_hz} Hz: {each} bytes");
    }
}

#[test]
fn played_setpoints_come_out_bit_for_bit_however_many_ticks_they_take() {
    let cell = Cell::demo(125).unwrap();
    let plan = plan(&cell);
    let mut silent = |_: u64| None;
    let once = play(&cell, &plan, 1, &mut silent);
    let four = play(&cell, &plan, 4, &mut silent);
    let mut last = 0;
    let mut firsts = four.iter().filter(|point| std::mem::replace(&mut last, point.seq) != point.seq);
    let mut seen = 0;
    for point in once.iter().filter(|point| point.seq > 0) {
        if point.seq == seen {
            continue;
        }
        seen = point.seq;
        let other = firsts.next().unwrap();
        assert_eq!((other.seq, other.tcp_in_base), (point.seq, point.tcp_in_base));
    }
    assert_eq!(seen, plan.last_seq() + 2);
}
