//! Registers point pairs from standard input, for comparison with other programs (`.ci/check_registration.py`).
//!
//! In: a line for each case, six numbers for each pair: the point in the outer frame, the point in the inner one (m).
//! Out: a line for each case: the rotation by rows, the translation, the three levers, residual and mirrored rms (m);
//! or `refused` and why.

use nalgebra::Vector3;
use screed_kernel::registration::{PointPair, register};
use std::io::{BufRead, Write};
use std::process::ExitCode;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("{problem}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let numbers = line?.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        let pairs: Vec<_> = numbers
            .chunks_exact(6)
            .map(|six| PointPair {
                in_outer: Vector3::new(six[0], six[1], six[2]),
                in_inner: Vector3::new(six[3], six[4], six[5]),
            })
            .collect();
        match register(&pairs) {
            Ok(found) => {
                let rotation = found.outer_from_inner.rotation.transpose();
                let pose = rotation.iter().chain(&found.outer_from_inner.translation).chain(&found.levers);
                for number in pose.chain(&[found.residual_rms, found.mirrored_rms]) {
                    write!(out, "{number:e} ")?;
                }
                writeln!(out)?;
            }
            Err(error) => writeln!(out, "refused {error:?}")?,
        }
    }
    Ok(())
}
