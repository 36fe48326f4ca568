//! Instructions of what the base's estimate does in a cycle: `cargo bench -p screed-benches --bench base`.
//!
//! Runs itself under `valgrind --tool=callgrind` once for each kind of call, which counts exactly and repeatably.

use nalgebra::Vector3;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::base::swing::Swing;
use screed_kernel::base::{Base, BaseConfig, BaseLimits, Drift, Measurement, Verdict};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};
use screed_tape::random::Random;
use std::error::Error;
use std::process::{Command, ExitCode, Stdio};

/// Cycles of a millisecond.
const CYCLES: u64 = 2000;

/// The function that each kind of call is counted in, and what it is.
const KINDS: [(&str, &str); 3] = [
    ("taken", "a pose that is taken"),
    ("gated", "a pose that is gated and agrees with a candidate: the most"),
    ("tick", "a tick"),
];

fn main() -> ExitCode {
    match std::env::args().nth(1).as_deref() {
        Some("--play") => {
            play();
            ExitCode::SUCCESS
        }
        _ => match measure() {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("{error}");
                ExitCode::FAILURE
            }
        },
    }
}

fn measure() -> Result<(), Box<dyn Error>> {
    let calls = play();
    println!("{:<60} {:>6} {:>12}", "call", "calls", "instructions");
    for ((kind, what), calls) in KINDS.iter().zip(calls) {
        println!("{what:<60} {calls:>6} {:>12.0}", instructions(kind)? / calls as f64);
    }
    Ok(())
}

/// What the function of that kind and all it calls took, by callgrind.
fn instructions(kind: &str) -> Result<f64, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("counts");
    let status = Command::new("valgrind")
        .args(["--tool=callgrind", "--collect-atstart=no", &format!("--toggle-collect=base::{kind}")])
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(std::env::current_exe()?)
        .arg("--play")
        .stderr(Stdio::null())
        .status()
        .map_err(|error| format!("valgrind does not start: {error}; install it (apt-get install valgrind)"))?;
    if !status.success() {
        return Err(format!("valgrind: {status}").into());
    }
    let text = std::fs::read_to_string(&file)?;
    let total = text.lines().find_map(|line| line.strip_prefix("summary: ")).ok_or("callgrind says no summary")?;
    match total.trim().parse::<f64>()? {
        0.0 => Err(format!("callgrind has not found the function {kind}").into()),
        total => Ok(total),
    }
}

#[inline(never)]
fn taken(base: &mut Base, measurement: &Measurement<6>) -> Verdict {
    base.measure(&UR10E, measurement).expect("a sound pose")
}

#[inline(never)]
fn gated(base: &mut Base, measurement: &Measurement<6>) -> Verdict {
    base.measure(&UR10E, measurement).expect("a sound pose")
}

#[inline(never)]
fn tick(base: &mut Base, at: Nanos) {
    std::hint::black_box(base.tick(at).expect("no excess"));
}

/// A base that drifts, and jumps in the middle of it; returns how often each kind was called.
fn play() -> [u64; 3] {
    let limits = BaseLimits {
        translation_max: 0.05,
        velocity_max: 0.01,
        acceleration_max: 0.2,
        rotation_max: 0.01,
        turn_rate_max: 0.005,
        turn_acceleration_max: 0.1,
    };
    let config = BaseConfig {
        tracker_from_nominal: Pose::from_roll_pitch_yaw(Vector3::new(3.0, -1.0, 0.5), 0.2, -0.1, 2.5),
        flange_from_target: Pose::from_roll_pitch_yaw(Vector3::new(0.05, 0.02, 0.1), 0.3, 0.0, 1.0),
        pivot: Vector3::new(0.7, -0.2, 0.4),
        drift: Drift { speed: 3e-3, turn_rate: 2e-4, time: 2.0 },
        swing: Swing::NONE,
        hold: 1.0,
        agreeing: 200,
        limits,
        period: 1e-3,
    };
    let mut base = Base::new(&config).expect("a sound configuration");
    let mut random = Random(1);
    let mut calls = [0; 3];
    for cycle in 1..=CYCLES {
        let (at, t) = (Nanos(cycle * 1_000_000), cycle as f64 * 1e-3);
        let jump = if cycle > CYCLES / 2 { 5e-3 } else { 0.0 };
        let shift = Pose::from_translation(3e-3 * t, jump, 0.0);
        let joints = JointPos([0.1 * t, -1.2, 1.4, -0.8 - 0.1 * t, 1.2, 0.0]);
        let truth = config.tracker_from_nominal * shift * UR10E.forward(&joints) * config.flange_from_target;
        let noise = Vector3::from_fn(|_, _| random.between(-40e-6, 40e-6));
        let measurement = Measurement {
            at,
            tracker_from_target: Pose { translation: truth.translation + noise, ..truth },
            position_deviation: 25e-6,
            rotation_deviation: 1.7e-4,
            joints,
            joint_deviation: JointPos([2e-5; 6]),
        };
        // The first of a row begins a candidate, and the last becomes the estimate.
        let is_gated = (CYCLES / 2 + 2..CYCLES / 2 + 200).contains(&cycle);
        let verdict = if is_gated { gated(&mut base, &measurement) } else { taken(&mut base, &measurement) };
        assert_eq!(matches!(verdict, Verdict::Gated { agreeing: 2.., .. }), is_gated, "cycle {cycle}: {verdict:?}");
        calls[usize::from(is_gated)] += 1;
        tick(&mut base, at);
        calls[2] += 1;
    }
    calls
}
