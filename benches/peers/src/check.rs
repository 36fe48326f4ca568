//! Do both give the same answers? Only then is it worth asking which is faster.

use crate::child::{Job, Outcome};
use crate::record::Record;
use std::f64::consts::PI;

/// How far the joints of one branch may differ between two programs (rad), full turns aside.
const JOINTS: f64 = 1e-8;

/// How far entries of poses and Jacobians may differ (m, rad).
const ENTRIES: f64 = 1e-12;

/// What a comparison found.
#[derive(Default)]
pub struct Agreement {
    /// Answers that both gave.
    pub common: usize,
    /// The largest difference among them (rad, m).
    pub worst: f64,
    /// Answers that differ because ours is nearer to the seed.
    pub nearer: usize,
}

/// Whether both find the same branches for every one of `inputs` inputs.
///
/// # Errors
/// The first input with a branch that only one of them has, or one of them twice.
pub fn branches(ours: &Job, theirs: &Job, inputs: usize) -> Outcome<Agreement> {
    compare(ours, theirs, inputs, 6, |_, ours, theirs, agreement| {
        for (have, other) in [(ours, theirs), (theirs, ours)] {
            for joints in have {
                let near = other.iter().map(|candidate| turn_between(joints, candidate)).fold(f64::INFINITY, f64::min);
                if near > JOINTS {
                    return false;
                }
                agreement.worst = agreement.worst.max(near);
            }
        }
        agreement.common += ours.len();
        ours.len() == theirs.len()
    })
}

/// Whether both pick the same branch for every input, or ours the one nearer to the seed by the largest joint difference.
/// (ur-analytic-ik measures by the sum of the differences, and its first branch by the root of their squares; picks differ
/// where two branches are about to become one.)
///
/// # Errors
/// The first input where theirs is nearer, or one of them has no answer.
pub fn nearest(ours: &Job, theirs: &Job, inputs: &[Record]) -> Outcome<Agreement> {
    compare(ours, theirs, inputs.len(), 6, |input, ours, theirs, agreement| {
        let ([ours], [theirs]) = (ours, theirs) else { return false };
        let apart = turn_between(ours, theirs);
        if apart <= JOINTS {
            agreement.common += 1;
            agreement.worst = agreement.worst.max(apart);
            return true;
        }
        agreement.nearer += 1;
        let seed = &inputs[input].seed.0;
        turn_between(ours, seed) <= turn_between(theirs, seed) + JOINTS
    })
}

/// Whether both give one answer with the same numbers for every input.
///
/// # Errors
/// The first input where they do not.
pub fn numbers(ours: &Job, theirs: &Job, inputs: usize, width: usize) -> Outcome<Agreement> {
    compare(ours, theirs, inputs, width, |_, ours, theirs, agreement| {
        let ([ours], [theirs]) = (ours, theirs) else { return false };
        let worst = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        agreement.common += 1;
        agreement.worst = agreement.worst.max(worst);
        worst <= ENTRIES
    })
}

fn compare(
    ours: &Job,
    theirs: &Job,
    inputs: usize,
    width: usize,
    same: impl Fn(usize, &[Vec<f64>], &[Vec<f64>], &mut Agreement) -> bool,
) -> Outcome<Agreement> {
    let (mut left, mut right) = (ours.start()?, theirs.start()?);
    left.show()?;
    right.show()?;
    let mut agreement = Agreement::default();
    for input in 0..inputs {
        let (a, b) = (left.answer(width)?, right.answer(width)?);
        if !same(input, &a, &b, &mut agreement) {
            return Err(format!("input {input}: ours {a:?}, theirs {b:?}").into());
        }
    }
    Ok(agreement)
}

/// The largest difference between the joints of two answers, full turns aside.
fn turn_between(a: &[f64], b: &[f64]) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| a - b);
    differences.map(|turn| (turn - 2.0 * PI * (turn / (2.0 * PI)).round()).abs()).fold(0.0, f64::max)
}
