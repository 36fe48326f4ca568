//! A tick of the filter (prediction, a tracked pose, joint rates; in blocks) against the same filter with dense matrices by
//! nalgebra, in the same run: `cargo bench -p screed-benches --bench ekf`.
//!
//! Instructions by callgrind, which repeat; the wall clock's medians are of slices that take turns. Both filters get the same
//! measurements and have to agree at the end. Set `RUSTFLAGS=-Ctarget-cpu=x86-64-v3` for the other column of the README.

use nalgebra::{SMatrix, SVector};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::ekf::{Ekf, EkfError, State, Verdict};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};
use screed_tape::random::Random;
use std::error::Error;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

const N: usize = 6;
/// Seconds between ticks.
const DT: f64 = 0.001;
/// Spectral density of the jerk (rad²/s⁵).
const DENSITY: f64 = 10.0;
/// Standard deviations: position (m), rotation (rad), rates (rad/s).
const NOISE: [f64; 3] = [25e-6, 1.745e-4, 1e-3];
/// Ticks under the profiler, and in a slice under the wall clock.
const TICKS: usize = 1000;
const SLICES: usize = 41;
/// Ways to run this program under the profiler.
const FILTERS: [&str; 2] = ["block", "dense"];

type Measurement = (TrackedPose, JointVel<N>);
type Matrix18 = SMatrix<f64, 18, 18>;

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args().collect();
    let measurements = measurements();
    match arguments.get(1).map(String::as_str) {
        Some("block") => {
            std::hint::black_box(play_block(&measurements));
        }
        Some("dense") => {
            std::hint::black_box(play_dense(&measurements));
        }
        _ => {
            if let Err(error) = compare(&measurements) {
                eprintln!("{error}");
                return ExitCode::FAILURE;
            }
        }
    }
    ExitCode::SUCCESS
}

fn compare(measurements: &[Measurement]) -> Result<(), Box<dyn Error>> {
    let (block, dense) = (play_block(measurements), play_dense(measurements));
    let miss =
        block.state().position.0.iter().zip(dense.x.iter()).fold(0.0, |miss: f64, (a, b)| miss.max((a - b).abs()));
    if miss.is_nan() || miss > 1e-10 {
        return Err(format!("the filters end {miss:e} rad apart").into());
    }
    let hash = measurements.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, (pose, rates)| {
        let numbers = pose.tracker_from_target.translation.iter().chain(&rates.0);
        numbers.fold(hash, |hash, number| (hash ^ number.to_bits()).wrapping_mul(0x0100_0000_01b3))
    });
    let flags = option_env!("RUSTFLAGS").unwrap_or("");
    println!("{TICKS} ticks of pose and rates, input {hash:#018x}, RUSTFLAGS \"{flags}\", ends {miss:.1e} rad apart");
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..SLICES {
        let start = Instant::now();
        std::hint::black_box(play_block(measurements));
        times[0].push(start.elapsed().as_nanos() as f64 / TICKS as f64);
        let start = Instant::now();
        std::hint::black_box(play_dense(measurements));
        times[1].push(start.elapsed().as_nanos() as f64 / TICKS as f64);
    }
    println!("{:<8} {:>13} {:>10}", "filter", "instructions", "median ns");
    let mut counts = [0.0; 2];
    for ((name, times), counted) in FILTERS.iter().zip(&mut times).zip(&mut counts) {
        times.sort_by(f64::total_cmp);
        *counted = instructions(name)?;
        println!("{name:<8} {counted:>13.0} {:>10.0}", times[SLICES / 2]);
    }
    let ratio = times[1][SLICES / 2] / times[0][SLICES / 2];
    println!("{:<8} {:>13.2} {ratio:>10.2}", "ratio", counts[1] / counts[0]);
    Ok(())
}

/// Instructions a tick: what the tick's function and all it calls took, by callgrind.
fn instructions(filter: &str) -> Result<f64, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("counts");
    let status = Command::new("valgrind")
        .args(["--tool=callgrind", "--collect-atstart=no", &format!("--toggle-collect=ekf::tick_{filter}*")])
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(std::env::current_exe()?)
        .arg(filter)
        .stderr(Stdio::null())
        .status()
        .map_err(|error| format!("valgrind does not start: {error}; install it (apt-get install valgrind)"))?;
    if !status.success() {
        return Err(format!("valgrind: {status}").into());
    }
    let text = std::fs::read_to_string(&file)?;
    let total = text.lines().find_map(|line| line.strip_prefix("summary: ")).ok_or("callgrind says no summary")?;
    let total = total.trim().parse::<f64>()?;
    if total == 0.0 {
        return Err("callgrind has not found the tick's function".into());
    }
    Ok(total / TICKS as f64)
}

/// The arm going about, with noise on what is measured.
fn measurements() -> Vec<Measurement> {
    let mut random = Random(2);
    let mut noise = |deviation: f64| deviation * (0..12).map(|_| random.between(-0.5, 0.5)).sum::<f64>();
    let tracker_from_base = Pose::from_roll_pitch_yaw([2.0, 1.0, -0.5].into(), 0.1, 0.2, 0.3);
    let flange_from_target = Pose::from_roll_pitch_yaw([0.05, 0.02, 0.1].into(), 0.3, 0.0, 1.0);
    let at = |k: usize| {
        let t = (k + 1) as f64 * DT;
        let phase = |i: usize| 0.3 * (i + 1) as f64 * t + i as f64;
        let position = [0.0, -1.2, 1.4, -0.8, 1.2, 0.0];
        let mut state = State::at_rest(JointPos(position));
        for i in 0..N {
            state.position.0[i] += 0.3 * phase(i).sin();
            state.velocity.0[i] = 0.3 * 0.3 * (i + 1) as f64 * phase(i).cos();
        }
        state
    };
    let one = |k| {
        let state = at(k);
        let place = [(); 3].map(|()| noise(NOISE[0]));
        let turn = [(); 3].map(|()| noise(NOISE[1]));
        let rates = JointVel(state.velocity.0.map(|v| v + noise(NOISE[2])));
        let truth = tracker_from_base * UR10E.forward(&state.position) * flange_from_target;
        let error = Pose::from_rotation_vector(place.into(), turn.into());
        let tracker_from_target =
            Pose { rotation: error.rotation * truth.rotation, translation: error.translation + truth.translation };
        let pose = TrackedPose {
            tracker_from_target,
            tracker_from_base,
            flange_from_target,
            position_deviation: NOISE[0],
            rotation_deviation: NOISE[1],
        };
        (pose, rates)
    };
    (0..TICKS).map(one).collect()
}

/// Both begin where the measured arm does, as uncertain as this.
fn start() -> (State<N>, State<N>) {
    let mut state = State::at_rest(JointPos([0.0, -1.2, 1.4, -0.8, 1.2, 0.0]));
    for i in 0..N {
        state.position.0[i] += 0.3 * (i as f64).sin();
    }
    let deviation =
        State { position: JointPos([0.05; N]), velocity: JointVel([1.0; N]), acceleration: JointAcc([1.0; N]) };
    (state, deviation)
}

fn play_block(measurements: &[Measurement]) -> Ekf<N> {
    let (state, deviation) = start();
    let mut ekf = Ekf::new(state, &deviation, &[DENSITY; N]).expect("a sound start");
    for measurement in measurements {
        tick_block(&mut ekf, measurement);
    }
    ekf
}

/// What is measured: prediction, pose, rates.
#[inline(never)]
fn tick_block(ekf: &mut Ekf<N>, (pose, rates): &Measurement) {
    let done = ekf
        .predict(DT, &JointJerk::ZERO)
        .and_then(|()| ekf.pose(&UR10E, pose))
        .and_then(|verdict| if verdict.is_taken() { Ok(()) } else { Err(EkfError::Unsound) })
        .and_then(|()| ekf.rates(rates, &JointVel([NOISE[2]; N])));
    assert!(matches!(done, Ok(Verdict::Taken { .. })), "{done:?}");
}

/// The same filter as textbooks write it.
struct Dense {
    x: SVector<f64, 18>,
    p: Matrix18,
    f: Matrix18,
    q: Matrix18,
}

fn play_dense(measurements: &[Measurement]) -> Dense {
    let (state, deviation) = start();
    let stack = |state: &State<N>| -> SVector<f64, 18> {
        SVector::from_iterator(state.position.0.into_iter().chain(state.velocity.0).chain(state.acceleration.0))
    };
    let (mut f, mut q) = (Matrix18::identity(), Matrix18::zeros());
    let white = [[DT.powi(5) / 20.0, DT.powi(4) / 8.0, DT.powi(3) / 6.0], [0.0, DT.powi(3) / 3.0, DT.powi(2) / 2.0]];
    for i in 0..N {
        (f[(i, i + 6)], f[(i + 6, i + 12)], f[(i, i + 12)]) = (DT, DT, 0.5 * DT * DT);
        for (a, b, value) in [
            (0, 0, white[0][0]),
            (0, 1, white[0][1]),
            (0, 2, white[0][2]),
            (1, 1, white[1][1]),
            (1, 2, white[1][2]),
            (2, 2, DT),
        ] {
            q[(i + 6 * a, i + 6 * b)] = DENSITY * value;
            q[(i + 6 * b, i + 6 * a)] = DENSITY * value;
        }
    }
    let p = Matrix18::from_diagonal(&stack(&deviation).map(|deviation: f64| deviation * deviation));
    let mut dense = Dense { x: stack(&state), p, f, q };
    for measurement in measurements {
        tick_dense(&mut dense, measurement);
    }
    dense
}

/// What is measured: prediction, pose, rates, as one update of twelve rows each.
#[inline(never)]
fn tick_dense(dense: &mut Dense, (pose, rates): &Measurement) {
    dense.x = dense.f * dense.x;
    dense.p = dense.f * dense.p * dense.f.transpose() + dense.q;
    let joints = JointPos(core::array::from_fn(|i| dense.x[i]));
    let (base_from_flange, jacobian) = UR10E.jacobian(&joints);
    let expected = base_from_flange * pose.flange_from_target;
    let measured = pose.tracker_from_base.inverse() * pose.tracker_from_target;
    let lever = expected.translation - base_from_flange.translation;
    let place = measured.translation - expected.translation;
    let turn =
        Pose { rotation: measured.rotation * expected.rotation.transpose(), translation: place }.rotation_vector();
    let mut h = SMatrix::<f64, 12, 18>::zeros();
    let mut y = SVector::<f64, 12>::zeros();
    let mut r = SMatrix::<f64, 12, 12>::zeros();
    for i in 0..N {
        let axis = jacobian.fixed_view::<3, 1>(3, i).into_owned();
        h.fixed_view_mut::<3, 1>(0, i).copy_from(&(jacobian.fixed_view::<3, 1>(0, i) + axis.cross(&lever)));
        h.fixed_view_mut::<3, 1>(3, i).copy_from(&axis);
        h[(6 + i, 6 + i)] = 1.0;
        y[6 + i] = rates.0[i] - dense.x[6 + i];
        r[(6 + i, 6 + i)] = NOISE[2] * NOISE[2];
    }
    for k in 0..3 {
        (y[k], y[3 + k]) = (place[k], turn[k]);
        (r[(k, k)], r[(3 + k, 3 + k)]) = (NOISE[0] * NOISE[0], NOISE[1] * NOISE[1]);
    }
    let hp = h * dense.p;
    let mut s = hp * h.transpose();
    // What the pose bends away from its tangent, as in the kernel.
    let (way, turn) = (s.fixed_view::<3, 3>(0, 0).trace(), s.fixed_view::<3, 3>(3, 3).trace());
    for k in 0..3 {
        (r[(k, k)], r[(3 + k, 3 + k)]) = (r[(k, k)] + 0.25 * way * turn, r[(3 + k, 3 + k)] + 0.25 * turn * turn);
    }
    s += r;
    let factor = s.cholesky().expect("a positive definite matrix");
    let gain = factor.solve(&hp).transpose();
    dense.x += gain * y;
    dense.p -= gain * hp;
}
