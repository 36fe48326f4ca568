//! A worker: one kind of work on one file of inputs, in a process of its own. cpp/worker.hpp is the same in C++.
//!
//! `WORKER ITEM ARM INPUTS` obeys lines on its standard input: to `run N` it does the work N times on every input and answers
//! with the nanoseconds that took; to `show` it answers with its results, for each input how many and then their numbers,
//! all as 64-bit floats. `WORKER ITEM ARM INPUTS N` does the work N times and ends, for a profiler that counts instructions.

use crate::child::Outcome;
use crate::opw;
use crate::record::{self, Record};
use screed_kernel::arm::{Arm, Jacobian};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ik;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use std::hint::black_box;
use std::io::{BufRead, BufWriter, Write};
use std::path::Path;
use std::time::Instant;

/// How far the forward kinematics of an answer may be from the pose sought, in each entry: the tolerance of
/// ur-analytic-ik's own verification.
const VERIFIED: f64 = 1e-9;

/// Does the work that `item` names for an arm on the inputs in a file.
///
/// # Errors
/// An item, arm or file that is not there; lines that are not understood.
pub fn work(item: &str, arm: &str, inputs: &Path, passes: Option<u64>) -> Outcome<()> {
    let inputs = &record::read(inputs)?;
    if let Some(item) = item.strip_prefix("opw-") {
        let peer = opw::Peer::new(arm)?;
        let inputs: Vec<opw::Input> = inputs.iter().map(|record| peer.input(record)).collect();
        return match item {
            "all" => {
                serve(&inputs, passes, |input| peer.all(input), |answers, numbers| opw::show_all(answers, numbers))
            }
            "nearest" => serve(
                &inputs,
                passes,
                |input| peer.nearest(input),
                |answers, numbers| opw::show_first(answers, numbers),
            ),
            _ => Err(format!("no such item: opw-{item}").into()),
        };
    }
    let arm = [&UR10E].into_iter().find(|known| known.name == arm).ok_or_else(|| format!("no such arm: {arm}"))?;
    match item {
        "all" => serve(inputs, passes, |input| all(arm, input), show_all),
        "all-verified" => serve(inputs, passes, |input| all_verified(arm, input), show_all),
        "nearest" => serve(inputs, passes, |input| nearest(arm, input), show_one),
        "nearest-verified" => serve(inputs, passes, |input| nearest_verified(arm, input), show_one),
        "jacobian" => serve(inputs, passes, |input| arm.jacobian(&input.joints), show_jacobian),
        _ => Err(format!("no such item: {item}").into()),
    }
}

fn all(arm: &Arm<6>, input: &Record) -> Option<ik::Branches<6>> {
    ik::ur::inverse(arm, &input.base_from_flange, &input.seed).ok()
}

fn nearest(arm: &Arm<6>, input: &Record) -> Option<JointPos<6>> {
    ik::ur::nearest(arm, &input.base_from_flange, &input.seed).ok().map(|answer| answer.joints)
}

fn all_verified(arm: &Arm<6>, input: &Record) -> Option<ik::Branches<6>> {
    all(arm, input).filter(|all| verified(arm, input, all.as_slice().iter().map(|answer| &answer.joints)))
}

fn nearest_verified(arm: &Arm<6>, input: &Record) -> Option<JointPos<6>> {
    nearest(arm, input).filter(|joints| verified(arm, input, [joints]))
}

fn verified<'a>(arm: &Arm<6>, input: &Record, answers: impl IntoIterator<Item = &'a JointPos<6>>) -> bool {
    answers.into_iter().all(|joints| reaches(&arm.forward(joints), &input.base_from_flange))
}

fn reaches(is: &Pose, sought: &Pose) -> bool {
    let rotation = (is.rotation - sought.rotation).amax();
    let translation = (is.translation - sought.translation).amax();
    rotation <= VERIFIED && translation <= VERIFIED
}

fn show_all(answer: &Option<ik::Branches<6>>, numbers: &mut Vec<f64>) {
    let branches = answer.as_ref().map_or(&[][..], ik::Branches::as_slice);
    numbers.push(branches.len() as f64);
    numbers.extend(branches.iter().flat_map(|answer| answer.joints.0));
}

fn show_one(answer: &Option<JointPos<6>>, numbers: &mut Vec<f64>) {
    numbers.push(f64::from(u8::from(answer.is_some())));
    numbers.extend(answer.iter().flat_map(|joints| joints.0));
}

/// Rows of [R | t], then the Jacobian's columns.
fn show_jacobian((pose, jacobian): &(Pose, Jacobian<6>), numbers: &mut Vec<f64>) {
    numbers.push(1.0);
    for row in 0..3 {
        numbers.extend((0..3).map(|column| pose.rotation[(row, column)]));
        numbers.push(pose.translation[row]);
    }
    numbers.extend(jacobian.iter());
}

/// `work` is what is timed, for one input; `show` makes numbers of its answer.
fn serve<Input, Answer>(
    inputs: &[Input],
    passes: Option<u64>,
    work: impl Fn(&Input) -> Answer,
    show: impl Fn(&Answer, &mut Vec<f64>),
) -> Outcome<()> {
    let run = |passes: u64| {
        for _ in 0..passes {
            for input in inputs {
                black_box(&work(black_box(input)));
            }
        }
    };
    if let Some(passes) = passes {
        run(passes);
        return Ok(());
    }
    let mut out = BufWriter::new(std::io::stdout().lock());
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        if let Some(passes) = line.strip_prefix("run ") {
            let passes = passes.parse()?;
            let start = Instant::now();
            run(passes);
            writeln!(out, "{}", start.elapsed().as_nanos())?;
        } else if line == "show" {
            let mut numbers = Vec::new();
            for input in inputs {
                numbers.clear();
                show(&work(input), &mut numbers);
                for number in &numbers {
                    out.write_all(&number.to_le_bytes())?;
                }
            }
        } else {
            return Err(format!("not understood: {line}").into());
        }
        out.flush()?;
    }
    Ok(())
}
