//! The covariance of the filter's state in blocks, one for each pair of position, velocity and acceleration.

use super::{State, add, subtract};

/// N by N numbers, row by row: `block[i][j]` belongs to joints i and j.
pub type Block<const N: usize> = [[f64; N]; N];

/// M rows over the whole state, each in three pieces: position, velocity, acceleration.
pub type Rows<const N: usize, const M: usize> = [[[f64; N]; 3]; M];

/// P, symmetric: the blocks on and above the diagonal. Units are products of those of the state (rad, rad/s, rad/s²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance<const N: usize> {
    /// Positions with positions, symmetric to the bit.
    pub qq: Block<N>,
    /// Positions (rows) with velocities.
    pub qv: Block<N>,
    /// Positions (rows) with accelerations.
    pub qa: Block<N>,
    /// Velocities with velocities, symmetric to the bit.
    pub vv: Block<N>,
    /// Velocities (rows) with accelerations.
    pub va: Block<N>,
    /// Accelerations with accelerations, symmetric to the bit.
    pub aa: Block<N>,
}

impl<const N: usize> Covariance<N> {
    /// Independent components with these standard deviations.
    pub(super) fn diagonal(deviation: &State<N>) -> Self {
        let block = |deviations: &[f64; N]| {
            let mut block = [[0.0; N]; N];
            for i in 0..N {
                block[i][i] = deviations[i] * deviations[i];
            }
            block
        };
        let zero = [[0.0; N]; N];
        Self {
            qq: block(&deviation.position.0),
            qv: zero,
            qa: zero,
            vv: block(&deviation.velocity.0),
            va: zero,
            aa: block(&deviation.acceleration.0),
        }
    }

    /// One entry: components are all positions, then all velocities, then all accelerations. `None` beyond 3·N.
    pub fn get(&self, row: usize, column: usize) -> Option<f64> {
        let (first, second) = if row / N <= column / N { (row, column) } else { (column, row) };
        let block = match (first / N, second / N) {
            (0, 0) => &self.qq,
            (0, 1) => &self.qv,
            (0, 2) => &self.qa,
            (1, 1) => &self.vv,
            (1, 2) => &self.va,
            (2, 2) => &self.aa,
            _ => return None,
        };
        block.get(first % N)?.get(second % N).copied()
    }

    /// P ← F·P·Fᵀ + Q over `dt` = T s. F = \[I, T·I, T²/2·I; 0, I, T·I; 0, 0, I\] is exp(M·T), for M³ = 0; so each entry of a
    /// block is a sum of entries at the same place of the others. Q is the integral of the white jerk's effect
    /// (Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 6.2.3).
    pub(super) fn step(&mut self, dt: f64, jerk_density: &[f64; N]) {
        let Self { qq, qv, qa, vv, va, aa } = self;
        let half = 0.5 * dt * dt;
        for i in 0..N {
            // Columns i are as they were from row i on, which is what is needed of them.
            let [qv_column, qa_column, va_column] = [&*qv, &*qa, &*va].map(|block| column(block, i));
            let (mut qq_row, mut qv_row, mut qa_row) = (qq[i], qv[i], qa[i]);
            add(&mut qa_row, &va[i], dt);
            add(&mut qa_row, &aa[i], half);
            add(&mut qv_row, &vv[i], dt);
            add(&mut qv_row, &va_column, half);
            for j in 0..N {
                qq_row[j] += dt * (qv_column[j] + qv_row[j]) + half * (qa_column[j] + qa_row[j]);
            }
            add(&mut qv_row, &qa_row, dt);
            (qq[i], qv[i], qa[i]) = (qq_row, qv_row, qa_row);
        }
        for i in 0..N {
            let va_column = column(va, i);
            let (mut vv_row, mut va_row) = (vv[i], va[i]);
            add(&mut va_row, &aa[i], dt);
            for j in 0..N {
                vv_row[j] += dt * (va_column[j] + va_row[j]);
            }
            (vv[i], va[i]) = (vv_row, va_row);
        }
        mirror(qq);
        mirror(vv);
        let dt2 = dt * dt;
        let (dt3, dt4, dt5) = (dt2 * dt, dt2 * dt2, dt2 * dt2 * dt);
        for i in 0..N {
            let density = jerk_density[i];
            qq[i][i] += density * (dt5 / 20.0);
            qv[i][i] += density * (dt4 / 8.0);
            qa[i][i] += density * (dt3 / 6.0);
            vv[i][i] += density * (dt3 / 3.0);
            va[i][i] += density * (dt2 / 2.0);
            aa[i][i] += density * dt;
        }
    }

    /// P ← P − WᵀD⁻¹W, given 1/D. Of symmetric blocks what is below the diagonal is left out where that leaves whole vectors.
    #[inline(always)]
    pub(super) fn reduce<const M: usize>(&mut self, w: &Rows<N, M>, weights: &[f64; M]) {
        let half = const { (N / 2) & !1 };
        for i in 0..half {
            self.reduce_row(w, weights, i, 0);
        }
        for i in half..N {
            self.reduce_row(w, weights, i, half);
        }
        mirror(&mut self.qq);
        mirror(&mut self.vv);
        mirror(&mut self.aa);
    }

    /// Row i of each block; of symmetric ones from this column on.
    #[inline(always)]
    fn reduce_row<const M: usize>(&mut self, w: &Rows<N, M>, weights: &[f64; M], i: usize, first: usize) {
        let (mut qq, mut qv, mut qa) = (self.qq[i], self.qv[i], self.qa[i]);
        for ([q, v, a], weight) in w.iter().zip(weights) {
            let factor = weight * q[i];
            subtract(&mut qq[first..], &q[first..], factor);
            subtract(&mut qv, v, factor);
            subtract(&mut qa, a, factor);
        }
        (self.qq[i], self.qv[i], self.qa[i]) = (qq, qv, qa);
        let (mut vv, mut va, mut aa) = (self.vv[i], self.va[i], self.aa[i]);
        for ([_, v, a], weight) in w.iter().zip(weights) {
            let factor = weight * v[i];
            subtract(&mut vv[first..], &v[first..], factor);
            subtract(&mut va, a, factor);
            subtract(&mut aa[first..], &a[first..], weight * a[i]);
        }
        (self.vv[i], self.va[i], self.aa[i]) = (vv, va, aa);
    }
}

/// A column.
#[inline(always)]
fn column<const N: usize>(block: &Block<N>, j: usize) -> [f64; N] {
    let mut column = [0.0; N];
    for i in 0..N {
        column[i] = block[i][j];
    }
    column
}

/// Below the diagonal what is above.
#[inline(always)]
pub(crate) fn mirror<const N: usize>(block: &mut Block<N>) {
    for i in 0..N {
        for j in 0..i {
            block[i][j] = block[j][i];
        }
    }
}
