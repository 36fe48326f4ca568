//! What every filter is fed: a start, and a pose and joint rates a tick; seeded, in a file.

use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::State;
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointPos, JointVel};
use std::fs;
use std::io;
use std::path::Path;

pub const N: usize = 6;
/// Seconds between ticks.
pub const DT: f64 = 0.001;
/// Spectral density of the jerk (rad²/s⁵).
pub const DENSITY: f64 = 10.0;
/// Standard deviation of the rates (rad/s).
pub const RATE_DEVIATION: f64 = 1e-3;
/// A tracker's standard deviations: position (m), rotation (rad).
const POSE_DEVIATION: [f64; 2] = [25e-6, 1.745e-4];
/// Standard deviations at the start: rad, rad/s, rad/s².
const START_DEVIATION: [f64; 3] = [0.05, 1.0, 1.0];
/// Numbers at the head of the file: T, density, the standard deviations of position, rotation, rates, those of the start (3), and the
/// joints at the start.
const HEAD: usize = 8 + N;
/// Numbers of a tick: three poses as rows of \[R | t\], tracker_from_target, tracker_from_base and flange_from_target, and the rates.
const TICK: usize = 3 * 12 + N;

/// A start and what is measured then.
pub struct Tape {
    /// At rest there.
    pub start: State<N>,
    /// How uncertain the filter is of it.
    pub deviation: State<N>,
    /// Tick by tick.
    pub ticks: Vec<(TrackedPose, JointVel<N>)>,
}

/// The arm going about, with noise on what is measured.
pub fn random(ticks: usize, seed: u64) -> Vec<f64> {
    let mut bits = seed;
    // Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014).
    let mut unit = || {
        bits = bits.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = bits;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut noise = |deviation: f64| deviation * ((0..12).map(|_| unit()).sum::<f64>() - 6.0);
    let [place_deviation, turn_deviation] = POSE_DEVIATION;
    let mut numbers = vec![DT, DENSITY, place_deviation, turn_deviation, RATE_DEVIATION];
    numbers.extend(START_DEVIATION);
    numbers.extend(moving(0.0).position.0);
    let tracker_from_base = Pose::from_roll_pitch_yaw([2.0, 1.0, -0.5].into(), 0.1, 0.2, 0.3);
    let flange_from_target = Pose::from_roll_pitch_yaw([0.05, 0.02, 0.1].into(), 0.3, 0.0, 1.0);
    for tick in 1..=ticks {
        let state = moving(tick as f64 * DT);
        let place = [(); 3].map(|()| noise(place_deviation));
        let turn = [(); 3].map(|()| noise(turn_deviation));
        let truth = tracker_from_base * UR10E.forward(&state.position) * flange_from_target;
        let error = Pose::from_rotation_vector(place.into(), turn.into());
        let tracker_from_target =
            Pose { rotation: error.rotation * truth.rotation, translation: error.translation + truth.translation };
        for pose in [tracker_from_target, tracker_from_base, flange_from_target] {
            for row in 0..3 {
                numbers.extend([0, 1, 2].map(|column| pose.rotation[(row, column)]));
                numbers.push(pose.translation[row]);
            }
        }
        numbers.extend(state.velocity.0.map(|v| v + noise(RATE_DEVIATION)));
    }
    numbers
}

/// Where the arm is after so many seconds, and how fast.
fn moving(time: f64) -> State<N> {
    let mut state = State::at_rest(JointPos([0.0, -1.2, 1.4, -0.8, 1.2, 0.0]));
    for i in 0..N {
        let speed = 0.3 * (i + 1) as f64;
        state.position.0[i] += 0.3 * (speed * time + i as f64).sin();
        state.velocity.0[i] = 0.3 * speed * (speed * time + i as f64).cos();
    }
    state
}

/// Writes it for the workers; the hash (FNV-1a, 64 bits) is over every byte.
pub fn write(path: &Path, numbers: &[f64]) -> io::Result<u64> {
    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    fs::write(path, &bytes)?;
    Ok(bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3)))
}

/// Reads what [`write()`] wrote.
pub fn read(path: &Path) -> io::Result<Tape> {
    let bytes = fs::read(path)?;
    let numbers: Vec<f64> = bytes.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let (Some((head, rest)), true) = (numbers.split_first_chunk::<HEAD>(), bytes.len().is_multiple_of(8)) else {
        return Err(io::Error::other(format!("{}: no tape", path.display())));
    };
    let (ticks, []) = rest.as_chunks::<TICK>() else {
        return Err(io::Error::other(format!("{}: a broken tick", path.display())));
    };
    let [dt, density, place, turn, rate, position, velocity, acceleration, joints @ ..] = *head;
    if [dt, density, rate] != [DT, DENSITY, RATE_DEVIATION] {
        return Err(io::Error::other(format!("{}: another period, density or noise", path.display())));
    }
    let pose = |numbers: &[f64]| {
        let mut pose = Pose::identity();
        for row in 0..3 {
            for column in 0..3 {
                pose.rotation[(row, column)] = numbers[4 * row + column];
            }
            pose.translation[row] = numbers[4 * row + 3];
        }
        pose
    };
    let tick = |numbers: &[f64; TICK]| {
        let measured = TrackedPose {
            tracker_from_target: pose(&numbers[..12]),
            tracker_from_base: pose(&numbers[12..24]),
            flange_from_target: pose(&numbers[24..36]),
            position_deviation: place,
            rotation_deviation: turn,
        };
        (measured, JointVel(std::array::from_fn(|i| numbers[36 + i])))
    };
    let deviation = State {
        position: JointPos([position; N]),
        velocity: JointVel([velocity; N]),
        acceleration: JointAcc([acceleration; N]),
    };
    Ok(Tape { start: State::at_rest(JointPos(joints)), deviation, ticks: ticks.iter().map(tick).collect() })
}
