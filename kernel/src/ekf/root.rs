//! Cholesky's root of an innovation's covariance, and what it whitens.

use super::covariance::Rows;
use super::{EkfError, subtract};

/// U of S = UᵀU, upper triangular (Golub and Van Loan, "Matrix Computations", 4.2), in the place of S, a symmetric matrix of
/// which only the upper triangle is read. On the diagonal of U stand the reciprocals.
#[inline(always)]
pub(super) fn factor<const M: usize>(s: &mut [[f64; M]; M]) -> Result<(), EkfError> {
    for k in 0..M {
        let mut row = s[k];
        for i in 0..k {
            let above = &s[i];
            subtract(&mut row, above, above[k]);
        }
        let pivot = row[k];
        if !(pivot > 0.0 && pivot <= f64::MAX) {
            return Err(EkfError::Unsound);
        }
        let scale = 1.0 / libm::sqrt(pivot);
        for value in &mut row {
            *value *= scale;
        }
        row[k] = scale;
        s[k] = row;
    }
    Ok(())
}

/// rows ← U⁻ᵀ·rows.
#[inline(always)]
pub(super) fn whiten<const N: usize, const M: usize>(upper: &[[f64; M]; M], rows: &mut Rows<N, M>) {
    for k in 0..M {
        let [mut q, mut v, mut a] = rows[k];
        for i in 0..k {
            let factor = upper[i][k];
            subtract(&mut q, &rows[i][0], factor);
            subtract(&mut v, &rows[i][1], factor);
            subtract(&mut a, &rows[i][2], factor);
        }
        let scale = upper[k][k];
        for i in 0..N {
            (q[i], v[i], a[i]) = (scale * q[i], scale * v[i], scale * a[i]);
        }
        rows[k] = [q, v, a];
    }
}

/// U⁻ᵀ·y.
#[inline(always)]
pub(super) fn whitened<const M: usize>(upper: &[[f64; M]; M], y: &[f64; M]) -> [f64; M] {
    let mut e = *y;
    for k in 0..M {
        for i in 0..k {
            e[k] -= upper[i][k] * e[i];
        }
        e[k] *= upper[k][k];
    }
    e
}
