//! Which parameters measurements cannot tell apart.

use super::least_squares::column_lengths;
use nalgebra::{DMatrix, DVector};

/// Singular values below this share of the largest, of the Jacobian with its columns scaled to one length, count as
/// zero: what they stand for would be determined a thousand times worse than what is determined best. (Schröer, "Theory
/// of kinematic modelling and numerical procedures for robot calibration", 1993, asks for a condition below 100 for a
/// sound one.)
pub(super) const RANK_TOLERANCE: f64 = 1e-3;
/// A parameter belongs to a dependence when its share in it, with columns scaled, is at least this part of the largest.
const SHARE_MIN: f64 = 0.05;

/// One direction in the space of parameters that changes no measurement.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Dependence {
    /// The parameter to hold where it is, so that the others are determined.
    pub held: usize,
    /// Those that it cannot be told apart from: they take up its error. Empty: it moves nothing.
    pub with: Vec<usize>,
}

/// The dependences among the columns, and which parameter to hold for each: the one with the largest share, weighed by
/// `willing` (how readily a parameter is held, above 0). The Jacobian needs as many rows as columns.
pub(super) fn dependences(jacobian: &DMatrix<f64>, willing: impl Fn(usize) -> f64) -> Vec<Dependence> {
    let lengths = column_lengths(jacobian);
    let silent = RANK_TOLERANCE * RANK_TOLERANCE * lengths.max();
    let heard: Vec<usize> = (0..lengths.len()).filter(|&column| lengths[column] > silent).collect();
    let alone = |held| Dependence { held, with: Vec::new() };
    let mut found: Vec<_> = (0..lengths.len()).filter(|column| !heard.contains(column)).map(alone).collect();

    let mut scaled = jacobian.select_columns(&heard);
    for (mut column, &index) in scaled.column_iter_mut().zip(&heard) {
        column /= lengths[index];
    }
    let svd = scaled.qr().r().svd(false, true);
    let Some(v_t) = svd.v_t else { return found };
    let largest = svd.singular_values.max();
    let zero = (0..svd.singular_values.len()).filter(|&k| svd.singular_values[k] < RANK_TOLERANCE * largest);
    let null = v_t.select_rows(&zero.collect::<Vec<_>>()).transpose();
    let held = pivots(null.clone(), |row| willing(heard[row]));
    // Each dependence as the combination with one held parameter in it and none of the others.
    let Some(inverse) = null.select_rows(&held).try_inverse() else { return found };
    for (combination, &held) in (null * inverse).column_iter().zip(&held) {
        let least = SHARE_MIN * combination.amax();
        let with = (0..heard.len()).filter(|&row| row != held && combination[row].abs() >= least);
        found.push(Dependence { held: heard[held], with: with.map(|row| heard[row]).collect() });
    }
    found
}

/// As many rows as there are columns, independent of each other: again and again the longest of what is left, weighed.
fn pivots(mut rows: DMatrix<f64>, willing: impl Fn(usize) -> f64) -> Vec<usize> {
    let mut chosen = Vec::new();
    for _ in 0..rows.ncols() {
        let weighed = DVector::from_iterator(
            rows.nrows(),
            rows.row_iter().enumerate().map(|(index, row)| willing(index) * row.norm()),
        );
        let pivot = weighed.imax();
        let length = rows.row(pivot).norm();
        if length == 0.0 {
            break;
        }
        let direction = rows.row(pivot) / length;
        let shares = &rows * direction.transpose();
        rows -= shares * direction;
        chosen.push(pivot);
    }
    chosen
}
