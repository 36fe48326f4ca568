//! What the filter was fed and what it made of it, in text, for a program that does the same:
//! `cargo run --release -p screed-kernel --example ekf_tape -- tracker|paper SEED TICKS`. A line a call, numbers in full:
//!
//! `start DENSITY θ.. θ̇.. θ̈.. σ..` 18 numbers and their 18 standard deviations;
//! `predict T jerk..`;
//! `pose tracker_from_target tracker_from_base flange_from_target σ_position σ_rotation`, poses as rows of \[R | t\];
//! `rates θ̇.. σ..`, `encoders θ.. σ..`;
//! after each of those three `verdict TAKEN NIS GATE`; at the end of a tick `state θ.. θ̇.. θ̈..`, now and then `covariance` row by row.

#[path = "../tests/common/mod.rs"]
mod common;

use common::Random;
use common::dense::{matrix, stack};
use common::plant::{DENSITY, N, PAPER, Plant, TRACKER, deviation};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::{EkfError, GATES, Verdict};
use screed_kernel::pose::Pose;
use std::fmt::Write;
use std::process::ExitCode;

/// Ticks from one covariance to the next.
const COVARIANCE: u64 = 50;
/// One pose of so many is off by a metre.
const OUTLIERS: u64 = 40;

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let numbers = |text: &String| text.parse::<u64>().ok();
    let (noise, seed, ticks) = match arguments.as_slice() {
        [noise, seed, ticks] => (noise.as_str(), numbers(seed), numbers(ticks)),
        _ => ("", None, None),
    };
    let noise = match noise {
        "tracker" => Some(TRACKER),
        "paper" => Some(PAPER),
        _ => None,
    };
    let (Some(noise), Some(seed), Some(ticks)) = (noise, seed, ticks) else {
        eprintln!("usage: ekf_tape tracker|paper SEED TICKS");
        return ExitCode::from(2);
    };
    let mut plant = Plant::new(seed, noise, 1e-3);
    match play(&mut plant, seed, ticks) {
        Ok(tape) => {
            print!("{tape}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("the filter refused its input: {error:?}");
            ExitCode::FAILURE
        }
    }
}

fn play(plant: &mut Plant, seed: u64, ticks: u64) -> Result<String, EkfError> {
    let mut tape = String::new();
    let mut ekf = plant.filter();
    let mut coin = Random(seed ^ 1);
    let start = stack(ekf.state());
    let deviations = stack(&deviation(&plant.noise));
    line(&mut tape, "start", DENSITY[..1].iter().chain(&start).chain(&deviations));
    for tick in 1..=ticks {
        let jerk = plant.step();
        ekf.predict(plant.dt, &jerk)?;
        line(&mut tape, "predict", [plant.dt].iter().chain(&jerk.0));
        if coin.below(2) == 0 {
            let mut pose = plant.pose();
            if coin.below(OUTLIERS) == 0 {
                pose.tracker_from_target.translation.x += 1.0;
            }
            let poses =
                [pose.tracker_from_target, pose.tracker_from_base, pose.flange_from_target].map(|pose| rows(&pose));
            let deviations = [pose.position_deviation, pose.rotation_deviation];
            line(&mut tape, "pose", poses.iter().flatten().chain(&deviations));
            judged(&mut tape, &ekf.pose(&UR10E, &pose)?);
        }
        if coin.below(2) == 0 {
            let (measured, deviation) = plant.rates();
            line(&mut tape, "rates", measured.0.iter().chain(&deviation.0));
            judged(&mut tape, &ekf.rates(&measured, &deviation)?);
        }
        if coin.below(4) == 0 {
            let (measured, deviation) = plant.encoders();
            line(&mut tape, "encoders", measured.0.iter().chain(&deviation.0));
            judged(&mut tape, &ekf.encoders(&measured, &deviation)?);
        }
        line(&mut tape, "state", &stack(ekf.state()));
        if tick % COVARIANCE == 0 {
            line(&mut tape, "covariance", &matrix(&ekf));
        }
    }
    Ok(tape)
}

fn rows(pose: &Pose) -> [f64; 12] {
    std::array::from_fn(|k| match k % 4 {
        3 => pose.translation[k / 4],
        column => pose.rotation[(k / 4, column)],
    })
}

fn judged(tape: &mut String, verdict: &Verdict) {
    let taken = if verdict.is_taken() { 1.0 } else { 0.0 };
    line(tape, "verdict", &[taken, verdict.nis(), GATES[N - 1]]);
}

fn line<'a>(tape: &mut String, head: &str, numbers: impl IntoIterator<Item = &'a f64>) {
    *tape += head;
    for number in numbers {
        // Writing to a string does not fail.
        let _ = write!(tape, " {number:?}");
    }
    *tape += "\n";
}
