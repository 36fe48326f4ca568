//! The covariance of the filter's state in blocks, one for each pair of position, velocity and acceleration.

use super::{State, add};

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
        let (dt2, both, half2) = (dt * dt, dt * half, half * half);
        for i in 0..N {
            for j in i..N {
                let qq_new = qq[i][j]
                    + dt * (qv[i][j] + qv[j][i])
                    + half * (qa[i][j] + qa[j][i])
                    + dt2 * vv[i][j]
                    + both * (va[i][j] + va[j][i])
                    + half2 * aa[i][j];
                qq[i][j] = qq_new;
                qq[j][i] = qq_new;
            }
        }
        for i in 0..N {
            for j in 0..N {
                qa[i][j] += dt * va[i][j] + half * aa[i][j];
                qv[i][j] += dt * (vv[i][j] + qa[i][j]) + half * va[j][i];
            }
        }
        for i in 0..N {
            for j in i..N {
                let vv_new = vv[i][j] + dt * (va[i][j] + va[j][i]) + dt2 * aa[i][j];
                vv[i][j] = vv_new;
                vv[j][i] = vv_new;
            }
        }
        for (va, aa) in va.iter_mut().zip(aa.iter()) {
            add(va, aa, dt);
        }
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

    /// P ← P − WᵀW.
    #[inline(always)]
    pub(super) fn reduce<const M: usize>(&mut self, w: &Rows<N, M>) {
        for i in 0..N {
            let (mut qq, mut qv, mut qa) = (self.qq[i], self.qv[i], self.qa[i]);
            for [q, v, a] in w {
                add(&mut qq, q, -q[i]);
                add(&mut qv, v, -q[i]);
                add(&mut qa, a, -q[i]);
            }
            (self.qq[i], self.qv[i], self.qa[i]) = (qq, qv, qa);
        }
        for i in 0..N {
            let (mut vv, mut va, mut aa) = (self.vv[i], self.va[i], self.aa[i]);
            for [_, v, a] in w {
                add(&mut vv, v, -v[i]);
                add(&mut va, a, -v[i]);
                add(&mut aa, a, -a[i]);
            }
            (self.vv[i], self.va[i], self.aa[i]) = (vv, va, aa);
        }
    }
}
