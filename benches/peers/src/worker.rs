//! A worker: one kind of work on one file of inputs, in a process of its own. cpp/worker.hpp is the same in C++.
//!
//! `WORKER ITEM ARM INPUTS` obeys lines on its standard input: to `run N` it does the work N times on every input and answers
//! with the nanoseconds of processor time that took; to `show` it answers with its results, for each input how many and then their numbers,
//! all as 64-bit floats. `WORKER ITEM ARM INPUTS N` does the work N times and ends, for a profiler that counts instructions.

use crate::arms::Ours;
use crate::child::Outcome;
use crate::filter::{tape, work as filter};
use crate::opw;
use crate::record::{self, Record};
use rustix::time::{ClockId, clock_gettime};
use screed_kernel::arm::Jacobian;
use screed_kernel::ik::{Answer, Branches};
use screed_kernel::pose::Pose;
use std::hint::black_box;
use std::io::{BufRead, BufWriter, Write};
use std::path::Path;

/// How far the forward kinematics of an answer may be from the pose sought, in each entry: the tolerance of
/// ur-analytic-ik's own verification.
const VERIFIED: f64 = 1e-9;

/// Does the work that `item` names for an arm on the inputs in a file.
///
/// # Errors
/// An item, arm or file that is not there; lines that are not understood.
pub fn work(item: &str, arm: &str, inputs: &Path, passes: Option<u64>) -> Outcome<()> {
    if let Some(item) = item.strip_prefix("filter-") {
        let tape = &[tape::read(inputs)?];
        return match item {
            "block" => serve(tape, passes, filter::block, filter::show_block),
            "replay" => serve(tape, passes, filter::replay, filter::show_block),
            "dense" => serve(tape, passes, filter::dense, filter::show),
            "literal" => serve(tape, passes, filter::literal, filter::show),
            _ => Err(format!("no such item: filter-{item}").into()),
        };
    }
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
    let ours = &Ours::named(arm).ok_or_else(|| format!("no such arm: {arm}"))?;
    match item {
        "all" => serve(inputs, passes, |input| ours.all(input), show_all),
        "all-verified" => serve(inputs, passes, |input| all_verified(ours, input), show_all),
        "nearest" => serve(inputs, passes, |input| ours.nearest(input), show_nearest),
        "nearest-verified" => serve(inputs, passes, |input| nearest_verified(ours, input), show_nearest),
        "jacobian" => serve(inputs, passes, |input| ours.arm.jacobian(&input.joints), show_jacobian),
        _ => Err(format!("no such item: {item}").into()),
    }
}

fn all_verified(ours: &Ours, input: &Record) -> Option<Branches<6>> {
    ours.all(input).filter(|all| verified(ours, input, all.as_slice()))
}

fn nearest_verified(ours: &Ours, input: &Record) -> Option<Answer<6>> {
    ours.nearest(input).filter(|answer| verified(ours, input, std::slice::from_ref(answer)))
}

fn verified(ours: &Ours, input: &Record, answers: &[Answer<6>]) -> bool {
    answers.iter().all(|answer| reaches(&ours.arm.forward(&answer.joints), &input.base_from_flange))
}

fn reaches(is: &Pose, sought: &Pose) -> bool {
    let rotation = (is.rotation - sought.rotation).amax();
    let translation = (is.translation - sought.translation).amax();
    rotation <= VERIFIED && translation <= VERIFIED
}

fn show_all(branches: &Option<Branches<6>>, numbers: &mut Vec<f64>) {
    show(branches.as_ref().map_or(&[], Branches::as_slice), numbers);
}

fn show_nearest(answer: &Option<Answer<6>>, numbers: &mut Vec<f64>) {
    show(answer.as_slice(), numbers);
}

fn show(answers: &[Answer<6>], numbers: &mut Vec<f64>) {
    numbers.push(answers.len() as f64);
    numbers.extend(answers.iter().flat_map(|answer| answer.joints.0));
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

/// Time that this process has had on a processor (ns): what the machine does meanwhile for others is left out.
fn processor_time() -> i64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
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
            let start = processor_time();
            run(passes);
            writeln!(out, "{}", processor_time() - start)?;
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
