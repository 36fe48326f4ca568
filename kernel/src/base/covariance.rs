//! The covariance of the base's estimate.

// In matrices an index says more than a chain of iterators does.
#![allow(clippy::needless_range_loop)]

use super::estimate::Drift;
use super::swing::{Swing, Turns};
use crate::ekf::covariance::Block;
use crate::ekf::{add, subtract};

/// A row over the whole state: place, its rate, swing, its rate; in each, translation before rotation.
pub type Row = [[f64; 6]; 4];

/// The rows of the first parts, of those parts.
pub(super) type Parts<const PARTS: usize> = [[[[f64; 6]; PARTS]; 6]; PARTS];

/// P, 24 by 24 and symmetric to the bit: `rows[part][axis]` is a row, parts and axes as in [`Row`]. Units are products of those of the
/// state (m, rad, and per second).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance {
    /// Row by row.
    pub rows: [[Row; 6]; 4],
}

impl Covariance {
    /// When one measurement has been seen whose displacement, at the pivot, has covariance `seen`; `lever` runs from the swing's
    /// centre to the pivot. Place = displacement − M·swing, M being what a swing does to the pivot.
    pub(super) fn alone(seen: &Block<6>, drift: &Drift, swing: &Swing, lever: [[f64; 3]; 3]) -> Self {
        let mut rows = [[[[0.0; 6]; 4]; 6]; 4];
        let [swings, swing_rates] = swing.variances();
        let deviations = [drift.speed, drift.speed, drift.speed, drift.turn_rate, drift.turn_rate, drift.turn_rate];
        for i in 0..6 {
            rows[0][i][0] = seen[i];
            rows[1][i][1][i] = deviations[i] * deviations[i];
            rows[2][i][2][i] = swings[i];
            rows[3][i][3][i] = swing_rates[i];
            rows[0][i][2][i] = -swings[i];
            rows[0][i][0][i] += swings[i];
        }
        for i in 0..3 {
            for k in 0..3 {
                rows[0][i][2][3 + k] = -lever[i][k] * swings[3 + k];
                rows[0][i][0][3 + k] += lever[i][k] * swings[3 + k];
                for j in 0..3 {
                    rows[0][i][0][j] += lever[i][k] * swings[3 + k] * lever[j][k];
                }
            }
        }
        let mut covariance = Self { rows };
        covariance.mirror::<4>();
        covariance
    }

    /// Of the first parts, what [`Self::step`] and [`Self::reduce`] change.
    pub(super) fn parts<const PARTS: usize>(&self) -> Parts<PARTS> {
        let mut parts = [[[[0.0; 6]; PARTS]; 6]; PARTS];
        for (to, from) in parts.as_flattened_mut().iter_mut().zip(self.rows.as_flattened()) {
            for (to, from) in to.iter_mut().zip(from) {
                *to = *from;
            }
        }
        parts
    }

    /// Those back as they were.
    pub(super) fn set_parts<const PARTS: usize>(&mut self, parts: &Parts<PARTS>) {
        for (to, from) in self.rows.as_flattened_mut().iter_mut().zip(parts.as_flattened()) {
            for (to, from) in to.iter_mut().zip(from) {
                *to = *from;
            }
        }
    }

    /// P ← F·P·Fᵀ + Q over `dt` s. Place and rate: F = \[I, a·I; 0, φ·I\] with φ = exp(−dt/τ) and a = τ·(1 − φ). Swing and rate:
    /// `turns`; as a swing that has always been there stays as large as it is, Q = Σ − F·Σ·Fᵀ, Σ being [`Swing::variances`].
    ///
    /// Of the state's parts only the first are looked at: 4, or 2 where nothing swings.
    pub(super) fn step<const PARTS: usize>(&mut self, dt: f64, drift: &Drift, swing: &Swing, turns: &Turns) {
        let lost = -libm::expm1(-dt / drift.time);
        let (a, kept) = (drift.time * lost, 1.0 - lost);
        let variances = swing.variances();
        let [[aa, ab], [ba, bb]] = turns;
        let [places, rates, swings, swing_rates] = &mut self.rows;
        for i in 0..6 {
            let (place, rate) = (places[i].as_flattened_mut(), rates[i].as_flattened_mut());
            for (place, rate) in place.iter_mut().zip(rate).take(6 * PARTS) {
                *place += a * *rate;
                *rate *= kept;
            }
            if PARTS < 4 {
                continue;
            }
            swings[i][2][i] -= variances[0][i];
            swing_rates[i][3][i] -= variances[1][i];
            let (swing, rate) = (swings[i].as_flattened_mut(), swing_rates[i].as_flattened_mut());
            for (swing, rate) in swing.iter_mut().zip(rate) {
                (*swing, *rate) = (aa[i] * *swing + ab[i] * *rate, ba[i] * *swing + bb[i] * *rate);
            }
        }
        for [place, rate, swing, swing_rate] in self.rows.as_flattened_mut().iter_mut().take(6 * PARTS) {
            for k in 0..6 {
                place[k] += a * rate[k];
                rate[k] *= kept;
            }
            if PARTS < 4 {
                continue;
            }
            for k in 0..6 {
                (swing[k], swing_rate[k]) =
                    (aa[k] * swing[k] + ab[k] * swing_rate[k], ba[k] * swing[k] + bb[k] * swing_rate[k]);
            }
        }
        let [places, rates, swings, swing_rates] = &mut self.rows;
        // With σ² the variance of a rate: ∫∫ of its correlation. The first is the difference of nearly equal numbers when u is
        // small, so it has a series: Σ (−1)ⁿ⁺¹·(2ⁿ − 4)/n!·uⁿ from 3 on.
        let u = dt / drift.time;
        let series = 2.0 / 3.0 - u * (0.5 - u * (7.0 / 30.0 - u * (1.0 / 12.0 - u * (31.0 / 1260.0 - u / 160.0))));
        let wandered = if u < 0.02 { u * u * u * series } else { 2.0 * u - 2.0 * lost - lost * lost };
        for (k, deviation) in
            (0..6).zip([drift.speed, drift.speed, drift.speed, drift.turn_rate, drift.turn_rate, drift.turn_rate])
        {
            let variance = deviation * deviation;
            places[k][0][k] += variance * drift.time * drift.time * wandered;
            places[k][1][k] += variance * drift.time * lost * lost;
            rates[k][1][k] += variance * lost * (2.0 - lost);
            swings[k][2][k] += variances[0][k];
            swing_rates[k][3][k] += variances[1][k];
        }
        self.mirror::<PARTS>();
    }

    /// H·P, H seeing place and swing by these levers.
    pub(super) fn seen<const PARTS: usize>(&self, levers: &[[[f64; 3]; 3]; 2]) -> [[[f64; 6]; PARTS]; 6] {
        let [places, _, swings, _] = &self.rows;
        let seen = if PARTS < 4 { 1 } else { 2 };
        let mut rows = [[[0.0; 6]; PARTS]; 6];
        for (part, lever) in [places, swings].into_iter().zip(levers).take(seen) {
            for (row, from) in rows.iter_mut().zip(part) {
                add(row.as_flattened_mut(), from.as_flattened(), 1.0);
            }
            let [_, _, _, about @ ..] = part;
            for (row, factors) in rows.iter_mut().zip(lever) {
                for (rotation, factor) in about.iter().zip(factors) {
                    add(row.as_flattened_mut(), rotation.as_flattened(), *factor);
                }
            }
        }
        rows
    }

    /// P ← P − WᵀD⁻¹W, given 1/D.
    pub(super) fn reduce<const PARTS: usize>(&mut self, w: &[[[f64; 6]; PARTS]; 6], weights: &[f64; 6]) {
        for (part, rows) in self.rows.iter_mut().enumerate().take(PARTS) {
            for (i, row) in rows.iter_mut().enumerate() {
                for (w, weight) in w.iter().zip(weights) {
                    let factor = weight * w[part][i];
                    for (piece, w) in row.iter_mut().zip(w).skip(part) {
                        subtract(piece, w, factor);
                    }
                }
            }
        }
        self.mirror::<PARTS>();
    }

    /// What is above the diagonal, below it as well.
    fn mirror<const PARTS: usize>(&mut self) {
        for part in 0..PARTS {
            for i in 0..6 {
                for j in 0..i {
                    self.rows[part][i][part][j] = self.rows[part][j][part][i];
                }
                for before in 0..part {
                    for j in 0..6 {
                        self.rows[part][i][before][j] = self.rows[before][j][part][i];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::swing::SwingMode;

    const SWING: Swing = Swing {
        centre: nalgebra::Vector3::new(0.0, 0.0, 0.0),
        modes: [SwingMode { frequency: 14.0, damping: 0.04, deviation: 2e-4 }; 6],
    };

    /// Anything symmetric.
    fn any() -> Covariance {
        let mut rows = [[[[0.0; 6]; 4]; 6]; 4];
        for (i, row) in rows.as_flattened_mut().iter_mut().enumerate() {
            for (j, value) in row.as_flattened_mut().iter_mut().enumerate() {
                *value = 1e-8 / (1.0 + (i as f64 - j as f64) * (i as f64 - j as f64));
            }
        }
        Covariance { rows }
    }

    /// Q of a rate with deviation 1 over T: ∫ g·gᵀ·2/τ ds with g(s) = [τ(1 − e^(−s/τ)), e^(−s/τ)]; of a swing: ∫ g·gᵀ·4ζω³σ² ds with
    /// g(s) the response to an impulse and its rate; by Simpson's rule.
    #[test]
    fn process_noise_is_the_integral_at_any_step() {
        let drift = Drift { speed: 1.0, turn_rate: 0.1, time: 2.0 };
        let SwingMode { frequency, damping, deviation } = SWING.modes[0];
        for dt in [1e-5, 1e-3, 0.008, 0.039, 0.041, 0.3, 2.0, 10.0] {
            let mut covariance = Covariance { rows: [[[[0.0; 6]; 4]; 6]; 4] };
            covariance.step::<4>(dt, &drift, &SWING, &SWING.turns(dt));
            let (mut sums, mut swung, count) = ([0.0; 3], [0.0; 3], 40_000);
            for k in 0..=count {
                let s = dt * f64::from(k) / f64::from(count);
                let weight = if k == 0 || k == count { 1.0 } else { 2.0 + 2.0 * f64::from(k % 2) };
                let weight = weight * dt / (3.0 * f64::from(count));
                let (x, v) = (-2.0 * libm::expm1(-s / 2.0), libm::exp(-s / 2.0));
                for (sum, value) in sums.iter_mut().zip([x * x, x * v, v * v]) {
                    *sum += weight * value;
                }
                let turning = frequency * libm::sqrt(1.0 - damping * damping);
                let (sin, cos) = libm::sincos(turning * s);
                let left = libm::exp(-damping * frequency * s);
                let (x, v) = (left * sin / turning, left * (cos - damping * frequency * sin / turning));
                let density = 4.0 * damping * libm::pow(frequency, 3.0) * deviation * deviation;
                for (sum, value) in swung.iter_mut().zip([x * x, x * v, v * v]) {
                    *sum += weight * density * value;
                }
            }
            let rows = &covariance.rows;
            for (found, sum) in [rows[0][1][0][1], rows[0][1][1][1], rows[1][1][1][1]].iter().zip(sums) {
                assert!((found / sum - 1.0).abs() < 1e-10, "{dt}: {found:e} {sum:e}");
            }
            assert!((rows[0][4][0][4] / rows[0][1][0][1] - 0.01).abs() < 1e-12);
            // Beside what a swing can be, what is left of Σ − FΣFᵀ is rounding.
            let [swing, rate] = SWING.variances().map(|variances| variances[0]);
            let found = [rows[2][1][2][1], rows[2][1][3][1], rows[3][1][3][1]];
            for ((found, sum), size) in found.iter().zip(swung).zip([swing, libm::sqrt(swing * rate), rate]) {
                assert!((found - sum).abs() < 1e-12 * size + 1e-8 * sum.abs(), "{dt}: {found:e} {sum:e}");
            }
        }
    }

    #[test]
    fn parts_put_back_undo_a_step_and_a_reduction_to_the_bit() {
        fn undone<const PARTS: usize>(swing: &Swing) {
            let (drift, mut covariance) = (Drift { speed: 3e-3, turn_rate: 1e-4, time: 2.0 }, any());
            let before = covariance.parts::<PARTS>();
            covariance.step::<PARTS>(0.5, &drift, swing, &swing.turns(0.5));
            let rows = covariance.seen::<PARTS>(&[[[0.3, -0.2, 0.5]; 3]; 2]);
            covariance.reduce(&rows, &[1e6; 6]);
            assert_ne!(covariance, any());
            covariance.set_parts(&before);
            assert_eq!(covariance, any());
        }
        undone::<2>(&Swing::NONE);
        undone::<4>(&SWING);
    }

    #[test]
    fn two_steps_are_one_of_their_length() {
        let drift = Drift { speed: 3e-3, turn_rate: 1e-4, time: 2.0 };
        let (mut once, mut twice) = (any(), any());
        once.step::<4>(0.5, &drift, &SWING, &SWING.turns(0.5));
        for dt in [0.007, 0.493] {
            twice.step::<4>(dt, &drift, &SWING, &SWING.turns(dt));
        }
        let flat = |covariance: &Covariance| covariance.rows.as_flattened().as_flattened().as_flattened().to_vec();
        for (a, b) in flat(&once).iter().zip(flat(&twice)) {
            assert!((a - b).abs() < 1e-12 * a.abs().max(1e-5), "{a:e} {b:e}");
        }
    }
}
