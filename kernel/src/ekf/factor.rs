//! The factors of an innovation's covariance, S = UᵀDU, and what they make independent. There is no square root in it: that
//! would be the longest wait of an update.

use super::{EkfError, subtract};

/// Takes an innovation apart, by elimination down from the top: S = UᵀDU with ones on U's diagonal (Golub and Van Loan, "Matrix
/// Computations", 4.1.2), `rows` ← U⁻ᵀ·rows (each in D pieces), `y` ← U⁻ᵀ·y. Returns 1/D, the inverse variances of y's parts, which then are
/// independent. Of `s` only the upper triangle is read; D·U is left there. All three go on together, so that the processor
/// has something to do while it waits for a pivot.
#[inline(always)]
pub(super) fn separate<const N: usize, const D: usize, const M: usize>(
    s: &mut [[f64; M]; M],
    rows: &mut [[[f64; N]; D]; M],
    y: &mut [f64; M],
) -> Result<[f64; M], EkfError> {
    let mut weights = [0.0; M];
    for k in 0..M {
        let mut row = s[k];
        let mut pieces = rows[k];
        for i in 0..k {
            let factor = weights[i] * s[i][k];
            subtract(&mut row, &s[i], factor);
            for (piece, other) in pieces.iter_mut().zip(&rows[i]) {
                subtract(piece, other, factor);
            }
            y[k] -= factor * y[i];
        }
        let pivot = row[k];
        if !(pivot > 0.0 && pivot <= f64::MAX) {
            return Err(EkfError::Unsound);
        }
        weights[k] = 1.0 / pivot;
        (s[k], rows[k]) = (row, pieces);
    }
    Ok(weights)
}
