//! The factors of an innovation's covariance, S = UᵀDU, and what they make independent. There is no square root in it: that
//! would be the longest wait of an update.

use super::covariance::Rows;
use super::{EkfError, subtract};

/// S = UᵀDU, U with a unit diagonal (Golub and Van Loan, "Matrix Computations", 4.1.2).
pub(super) struct Factor<'a, const M: usize> {
    /// D·U on and above the diagonal.
    upper: &'a [[f64; M]; M],
    /// 1/D: the inverse variances of the innovation's independent parts.
    pub weights: [f64; M],
}

impl<'a, const M: usize> Factor<'a, M> {
    /// In the place of a symmetric matrix of which only the upper triangle is read.
    #[inline(always)]
    pub(super) fn of(s: &'a mut [[f64; M]; M]) -> Result<Self, EkfError> {
        let mut weights = [0.0; M];
        for k in 0..M {
            let mut row = s[k];
            for i in 0..k {
                subtract(&mut row, &s[i], weights[i] * s[i][k]);
            }
            let pivot = row[k];
            if !(pivot > 0.0 && pivot <= f64::MAX) {
                return Err(EkfError::Unsound);
            }
            weights[k] = 1.0 / pivot;
            s[k] = row;
        }
        Ok(Self { upper: s, weights })
    }

    /// The entry of U in row i and column k, i < k.
    #[inline(always)]
    fn entry(&self, i: usize, k: usize) -> f64 {
        self.weights[i] * self.upper[i][k]
    }

    /// rows ← U⁻ᵀ·rows.
    #[inline(always)]
    pub(super) fn separate<const N: usize>(&self, rows: &mut Rows<N, M>) {
        for k in 0..M {
            let [mut q, mut v, mut a] = rows[k];
            for i in 0..k {
                let factor = self.entry(i, k);
                subtract(&mut q, &rows[i][0], factor);
                subtract(&mut v, &rows[i][1], factor);
                subtract(&mut a, &rows[i][2], factor);
            }
            rows[k] = [q, v, a];
        }
    }

    /// U⁻ᵀ·y.
    #[inline(always)]
    pub(super) fn separated(&self, y: &[f64; M]) -> [f64; M] {
        let mut e = *y;
        for k in 0..M {
            for i in 0..k {
                e[k] -= self.entry(i, k) * e[i];
            }
        }
        e
    }
}
