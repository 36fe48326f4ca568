//! What the whole-flow tests share: seeded numbers, and a judge of what the robot received that shares no code with Screed.
#![allow(dead_code)] // Each test takes what it needs.

pub mod robot;
pub mod scene;

use screed::config::Cell;
use screed::link::rtde::program::{Program, WatchdogAction};
use screed::model::fim;
use screed::plan::{Options, Plan};
use screed_fixtures::{QuarterCircle, quarter_circle};
use std::path::Path;

/// SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014): the same numbers for the same
/// seed everywhere.
pub struct Random(u64);

impl Random {
    /// Numbers that follow from `seed`.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub const fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// A cycle of the simulated robot, as its record has it.
#[derive(Clone, Copy, Debug)]
pub struct Cycle {
    pub packages: u32,
    pub seq: i64,
    pub registers: [f64; 6],
    pub actual_q: [f64; 6],
    pub runtime_state: u32,
}

/// Reads the record that `--record` writes.
pub fn read_record(path: &Path) -> Vec<Cycle> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| names.iter().position(|n| *n == name).unwrap();
    let (packages, seq, register) = (column("packages"), column("seq"), column("register_0"));
    let (actual, state) = (column("actual_q_0"), column("runtime_state"));
    // A process that is killed may leave half a line.
    let whole = lines.map(|line| line.split(',').collect::<Vec<_>>()).filter(|cells| cells.len() == names.len());
    let six = |cells: &[&str], from: usize| std::array::from_fn(|k| cells[from + k].parse().unwrap());
    whole
        .map(|cells| Cycle {
            packages: cells[packages].parse().unwrap(),
            seq: cells[seq].parse().unwrap(),
            registers: six(&cells, register),
            actual_q: six(&cells, actual),
            runtime_state: cells[state].parse().unwrap(),
        })
        .collect()
}

/// Tool centre point of a UR10e (m) with a straight tool of `tool` m, by 4×4 matrices from the published DH table.
pub fn tcp(q: &[f64; 6], tool: f64) -> [f64; 3] {
    const D: [f64; 6] = [0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655];
    const A: [f64; 6] = [0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0];
    const QUARTERS: [f64; 6] = [1.0, 0.0, 0.0, 1.0, -1.0, 0.0];
    let mut t = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    for j in 0..6 {
        let (s, c) = q[j].sin_cos();
        let (sa, ca) = (QUARTERS[j], if QUARTERS[j] == 0.0 { 1.0 } else { 0.0 });
        let d = if j == 5 { D[j] + tool } else { D[j] };
        let link =
            [[c, -s * ca, s * sa, A[j] * c], [s, c * ca, -c * sa, A[j] * s], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]];
        t = std::array::from_fn(|r| std::array::from_fn(|k| (0..4).map(|i| t[r][i] * link[i][k]).sum()));
    }
    [t[0][3], t[1][3], t[2][3]]
}

/// What a judged run of setpoints may do.
pub struct Limits {
    /// Tool acceleration (m/s²), rounding included.
    pub acceleration: f64,
    /// Tool speed (m/s).
    pub velocity: f64,
    /// Joint speeds (rad/s).
    pub joint_velocity: [f64; 6],
    /// Length of the tool (m).
    pub tool: f64,
}

/// The limits of the demo's cell.
pub fn demo_limits() -> Limits {
    let joint_velocity = [120.0, 120.0, 180.0, 180.0, 180.0, 180.0_f64].map(f64::to_radians);
    Limits { acceleration: 0.25 * 1.001, velocity: 0.25, joint_velocity, tool: 0.2 }
}

/// The distinct setpoints that the robot received, in order: one a package counter.
pub fn received(record: &[Cycle]) -> Vec<[f64; 6]> {
    let mut setpoints: Vec<[f64; 6]> = Vec::new();
    let mut last = 0;
    for cycle in record.iter().filter(|cycle| cycle.packages > 0) {
        assert!(cycle.seq == last + 1, "package {} after {last}: the robot lost what was between", cycle.seq);
        last = cycle.seq;
        setpoints.push(cycle.registers);
    }
    setpoints
}

/// Asserts that the setpoints, at their nominal period, keep the limits: the velocity vector never steps by more than the
/// acceleration allows.
pub fn judge(setpoints: &[[f64; 6]], period: f64, limits: &Limits) {
    assert!(setpoints.len() > 10, "only {} setpoints", setpoints.len());
    let points: Vec<[f64; 3]> = setpoints.iter().map(|q| tcp(q, limits.tool)).collect();
    let norm = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    for (k, w) in points.windows(3).enumerate() {
        let velocity = norm(std::array::from_fn(|i| (w[2][i] - w[1][i]) / period));
        assert!(velocity <= limits.velocity * 1.001, "setpoint {k}: {velocity} m/s");
        let acceleration = norm(std::array::from_fn(|i| (w[2][i] - 2.0 * w[1][i] + w[0][i]) / (period * period)));
        assert!(acceleration <= limits.acceleration, "setpoint {k} of {}: {acceleration} m/s²", setpoints.len());
    }
    for (k, w) in setpoints.windows(2).enumerate() {
        for (j, limit) in limits.joint_velocity.iter().enumerate() {
            let speed = (w[1][j] - w[0][j]).abs() / period;
            assert!(speed <= *limit, "setpoint {k}, joint {j}: {speed} rad/s");
        }
    }
}

/// The robot's program for a cell with another watchdog (s).
pub fn program_with(cell: &Cell, watchdog_action: WatchdogAction, watchdog: f64) -> String {
    let link = &cell.link;
    let program = Program {
        rate_hz: link.rate_hz,
        register_offset: link.register_offset,
        lookahead: link.servoj_lookahead,
        gain: link.servoj_gain,
        watchdog,
        watchdog_action,
    };
    program.text().unwrap()
}

/// Tool positions of the demo's planned path, in order (m, base frame).
pub fn planned_path(rate_hz: u32) -> Vec<[f64; 3]> {
    let text = quarter_circle(&QuarterCircle::default());
    let model = fim::parse("demo", text.as_bytes()).unwrap();
    let cell = Cell::demo(rate_hz).unwrap();
    let options = Options { layers: Some(1), ..Options::default() };
    let plan = Plan::new(&model, &cell, &options, &cell.robot.start).unwrap();
    let batches = plan.batches().map(Result::unwrap);
    batches.flat_map(|b| b.setpoints[..b.path_len].to_vec()).map(|setpoint| tcp(&setpoint.joints.0, 0.2)).collect()
}

/// Asserts that every point lies on the path, in order and from index `at` on: within `tolerance` m of the chords between
/// planned setpoints.
pub fn assert_on_path(setpoints: &[[f64; 6]], path: &[[f64; 3]], mut at: usize, tolerance: f64) {
    for (k, q) in setpoints.iter().enumerate() {
        let point = tcp(q, 0.2);
        let near = (at.max(1) - 1..path.len().min(at + 400) - 1)
            .map(|i| (i, to_chord(&point, &path[i], &path[i + 1])))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let (i, distance) = near.unwrap();
        assert!(distance < tolerance, "received setpoint {k} is {distance} m off the path");
        at = i;
    }
}

/// Distance of a point from a chord (m).
pub fn to_chord(p: &[f64; 3], a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let sub = |u: &[f64; 3], v: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|i| u[i] - v[i]) };
    let dot = |u: &[f64; 3], v: &[f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let (ab, ap) = (sub(b, a), sub(p, a));
    let t = if dot(&ab, &ab) > 0.0 { (dot(&ap, &ab) / dot(&ab, &ab)).clamp(0.0, 1.0) } else { 0.0 };
    let off: [f64; 3] = std::array::from_fn(|i| ap[i] - t * ab[i]);
    dot(&off, &off).sqrt()
}
