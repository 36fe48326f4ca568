//! Cholesky's root of an innovation's covariance, and what it whitens.

use super::{EkfError, add};

/// U of S = UᵀU, upper triangular (Golub and Van Loan, "Matrix Computations", 4.2).
pub(super) struct Root<const M: usize> {
    /// Above the diagonal U; on it the reciprocals.
    upper: [[f64; M]; M],
}

impl<const M: usize> Root<M> {
    /// Of a symmetric matrix of which only the upper triangle is read.
    #[inline(always)]
    pub(super) fn of(s: &[[f64; M]; M]) -> Result<Self, EkfError> {
        let mut upper = *s;
        for k in 0..M {
            for i in 0..k {
                let factor = upper[i][k];
                for j in k..M {
                    upper[k][j] -= factor * upper[i][j];
                }
            }
            let pivot = upper[k][k];
            if !(pivot > 0.0 && pivot.is_finite()) {
                return Err(EkfError::Unsound);
            }
            let scale = 1.0 / libm::sqrt(pivot);
            upper[k][k] = scale;
            for j in k + 1..M {
                upper[k][j] *= scale;
            }
        }
        Ok(Self { upper })
    }

    /// rows ← U⁻ᵀ·rows, each row in D pieces.
    #[inline(always)]
    pub(super) fn whiten<const N: usize, const D: usize>(&self, rows: &mut [[[f64; N]; D]; M]) {
        for k in 0..M {
            let mut row = rows[k];
            for i in 0..k {
                let factor = -self.upper[i][k];
                for (piece, other) in row.iter_mut().zip(&rows[i]) {
                    add(piece, other, factor);
                }
            }
            let scale = self.upper[k][k];
            rows[k] = row.map(|piece| piece.map(|value| scale * value));
        }
    }

    /// U⁻ᵀ·y.
    #[inline(always)]
    pub(super) fn whitened(&self, y: &[f64; M]) -> [f64; M] {
        let mut e = *y;
        for k in 0..M {
            for i in 0..k {
                e[k] -= self.upper[i][k] * e[i];
            }
            e[k] *= self.upper[k][k];
        }
        e
    }
}
