//! The filter of the base's displacement: 12 states, translation of the pivot, rotation vector, and their rates, all in the
//! nominal base frame.
//!
//! Rates are first-order Gauss–Markov processes, ẇ = −w/τ + white noise: they have a standard deviation, last for τ, and fade
//! over a dropout instead of carrying the base away (Gelb, "Applied Optimal Estimation", 1974, 3.8). Rotation is an error state
//! to the left, R = exp(δ)·R̂ (Trawny and Roumeliotis 2005), folded into the rotation vector after each step: a displacement
//! turns by milliradians, so that δ's transition is taken as the identity.

// In matrices an index says more than a chain of iterators does.
#![allow(clippy::needless_range_loop)]

use super::{BaseConfig, seconds};
use crate::arm::Arm;
use crate::ekf::covariance::{Block, mirror};
use crate::ekf::pose::{bend, rotation_is_sound};
use crate::ekf::{EkfError, Verdict, add, judge, positive, subtract};
use crate::pose::Pose;
use crate::units::{JointPos, Nanos};
use nalgebra::{Matrix3, Vector3};

/// How the base moves when it does: what tells it from the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Standard deviation of the pivot's speed along each axis (m/s).
    pub speed: f64,
    /// Standard deviation of the turn rate about each axis (rad/s).
    pub turn_rate: f64,
    /// For how long a rate lasts: its correlation is exp(−t/time) (s).
    pub time: f64,
}

/// A pose and the raw encoders of the same instant ([`super::history`] finds them).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement<const N: usize> {
    /// When.
    pub at: Nanos,
    /// What the tracker measured.
    pub tracker_from_target: Pose,
    /// Standard deviation of its position, the same along each axis (m).
    pub position_deviation: f64,
    /// Standard deviation of its rotation vector, the same about each axis (rad).
    pub rotation_deviation: f64,
    /// Raw encoders (rad, m).
    pub joints: JointPos<N>,
    /// Standard deviations of what the links do beside the encoders, joint by joint: noise, play, vibration (rad, m). They
    /// act through the arm's levers.
    pub joint_deviation: JointPos<N>,
}

/// A small motion, or its rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// Of the pivot (m, m/s).
    pub translation: Vector3<f64>,
    /// Rotation vector (rad), turn rate (rad/s).
    pub rotation: Vector3<f64>,
}

impl Displacement {
    /// None.
    pub fn zero() -> Self {
        Self { translation: Vector3::zeros(), rotation: Vector3::zeros() }
    }

    /// As a pose: x ↦ R·(x − pivot) + pivot + translation.
    pub fn pose(&self, pivot: &Vector3<f64>) -> Pose {
        let turn = Pose::from_rotation_vector(Vector3::zeros(), self.rotation);
        Pose { translation: pivot + self.translation - turn.rotation * pivot, ..turn }
    }

    /// Moved on by `factor` times a rate, the rotation on the left.
    fn moved(&self, rate: &Self, factor: f64) -> Self {
        let turn = |vector| Pose::from_rotation_vector(Vector3::zeros(), vector);
        Self {
            translation: self.translation + rate.translation * factor,
            rotation: (turn(rate.rotation * factor) * turn(self.rotation)).rotation_vector(),
        }
    }

    fn of([x, y, z, a, b, c]: &[f64; 6]) -> Self {
        Self { translation: Vector3::new(*x, *y, *z), rotation: Vector3::new(*a, *b, *c) }
    }

    fn plus(&self, other: &Self) -> Self {
        Self { translation: self.translation + other.translation, rotation: self.rotation + other.rotation }
    }

    fn scaled(&self, factor: f64) -> Self {
        Self { translation: self.translation * factor, rotation: self.rotation * factor }
    }

    fn is_finite(&self) -> bool {
        self.translation.iter().chain(self.rotation.iter()).all(|value| value.is_finite())
    }
}

/// P in blocks, symmetric: displacement with displacement, displacement (rows) with rates, rates with rates; in each,
/// translation before rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance {
    /// m², m·rad, rad²
    pub xx: Block<6>,
    /// The same per second.
    pub xv: Block<6>,
    /// The same per second squared.
    pub vv: Block<6>,
}

/// A measurement as the filter wants it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seen {
    pub at: Nanos,
    nominal_from_target: Pose,
    /// By forward kinematics, in the arm's own base.
    base_from_target: Pose,
    /// What turns the second's rotation into the first's.
    rotation: Matrix3<f64>,
    /// R, along and about the nominal base's axes: the tracker's noise, and the joints' through their levers.
    noise: Block<6>,
}

impl Seen {
    pub fn of<const N: usize>(
        arm: &Arm<N>,
        measurement: &Measurement<N>,
        nominal_from_tracker: &Pose,
        config: &BaseConfig,
    ) -> Result<Self, EkfError> {
        let (place, turn) = (measurement.position_deviation, measurement.rotation_deviation);
        positive(&[place, turn])?;
        positive(&measurement.joint_deviation.0)?;
        if !(measurement.joints.is_finite() && measurement.tracker_from_target.is_finite()) {
            return Err(EkfError::NotFinite);
        }
        rotation_is_sound(&measurement.tracker_from_target.rotation)?;
        let (base_from_flange, jacobian) = arm.jacobian(&measurement.joints);
        let base_from_target = base_from_flange * config.flange_from_target;
        let nominal_from_target = *nominal_from_tracker * measurement.tracker_from_target;
        let rotation = nominal_from_target.rotation * base_from_target.rotation.transpose();
        let lever = base_from_target.translation - base_from_flange.translation;
        let mut noise = [[0.0; 6]; 6];
        for (k, deviation) in (0..6).zip([place, place, place, turn, turn, turn]) {
            noise[k][k] = deviation * deviation;
        }
        let joints = jacobian.data.0.iter().zip(&measurement.joint_deviation.0);
        for ([vx, vy, vz, wx, wy, wz], deviation) in joints {
            let angular = Vector3::new(*wx, *wy, *wz);
            let linear = Vector3::new(*vx, *vy, *vz) + angular.cross(&lever);
            let (v, w) = (rotation * linear * *deviation, rotation * angular * *deviation);
            let column = [v.x, v.y, v.z, w.x, w.y, w.z];
            for (row, factor) in noise.iter_mut().zip(column) {
                add(row, &column, factor);
            }
        }
        Ok(Self { at: measurement.at, nominal_from_target, base_from_target, rotation, noise })
    }
}

/// The displacement and how good it is, as of the last measurement that it took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    at: Nanos,
    displacement: Displacement,
    rate: Displacement,
    covariance: Covariance,
}

impl Estimate {
    /// When it is true: the stamp of the last measurement that it took.
    pub const fn at(&self) -> Nanos {
        self.at
    }

    /// Of the pivot, and rotation.
    pub const fn displacement(&self) -> &Displacement {
        &self.displacement
    }

    /// m/s, rad/s
    pub const fn rate(&self) -> &Displacement {
        &self.rate
    }

    /// How good it is.
    pub const fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// What one measurement tells: the displacement that it needs, as uncertain as the measurement is; a rate of zero, as
    /// uncertain as any.
    pub(super) fn alone(seen: &Seen, config: &BaseConfig) -> Result<Self, EkfError> {
        let lever = seen.rotation * (seen.base_from_target.translation - config.pivot);
        let turn = Pose { rotation: seen.rotation, translation: Vector3::zeros() };
        let displacement = Displacement {
            translation: seen.nominal_from_target.translation - config.pivot - lever,
            rotation: turn.rotation_vector(),
        };
        if !displacement.is_finite() {
            return Err(EkfError::NotFinite);
        }
        // P = H⁻¹·R·H⁻ᵀ; H⁻¹ is H with the lever the other way round.
        let inverse = crossing(&-lever);
        let mut xx = transposed_product(&product(&inverse, &seen.noise), &inverse);
        mirror(&mut xx);
        let Drift { speed, turn_rate, .. } = config.drift;
        let mut vv = [[0.0; 6]; 6];
        for (k, deviation) in (0..6).zip([speed, speed, speed, turn_rate, turn_rate, turn_rate]) {
            vv[k][k] = deviation * deviation;
        }
        let covariance = Covariance { xx, xv: [[0.0; 6]; 6], vv };
        Ok(Self { at: seen.at, displacement, rate: Displacement::zero(), covariance })
    }

    /// Displacement and rates at a later time, if nothing is measured until then.
    pub(super) fn ahead(&self, at: Nanos, drift: &Drift) -> (Displacement, Displacement) {
        let lost = -libm::expm1(-seconds(self.at, at) / drift.time);
        (self.displacement.moved(&self.rate, drift.time * lost), self.rate.scaled(1.0 - lost))
    }

    /// The estimate at the measurement's stamp, moved towards it if that is not gated.
    ///
    /// The innovation is that of the target, where the noise is simple: the difference of positions, and the rotation vector
    /// of R_measured·R_expectedᵀ. The target lies at the pivot plus a lever r that turns with the base, so that
    /// H = \[I, −\[r\]×, 0, 0; 0, I, 0, 0\].
    pub(super) fn with(&self, seen: &Seen, config: &BaseConfig) -> Result<(Self, Verdict), EkfError> {
        let mut next = *self;
        next.at = seen.at;
        (next.displacement, next.rate) = self.ahead(seen.at, &config.drift);
        next.covariance.step(seconds(self.at, seen.at), &config.drift);
        let turn = Pose::from_rotation_vector(Vector3::zeros(), next.displacement.rotation).rotation;
        let lever = turn * (seen.base_from_target.translation - config.pivot);
        let expected = config.pivot + next.displacement.translation + lever;
        let place = seen.nominal_from_target.translation - expected;
        let miss = Pose { rotation: seen.rotation * turn.transpose(), translation: place };
        let rotation = miss.rotation_vector();
        let mut y = [place.x, place.y, place.z, rotation.x, rotation.y, rotation.z];
        let crossing = crossing(&lever);
        let (hx, hv) = (product(&crossing, &next.covariance.xx), product(&crossing, &next.covariance.xv));
        let mut s = transposed_product(&hx, &crossing);
        let [bend_place, bend_turn] = bend(&s);
        for (k, bend) in (0..6).zip([bend_place, bend_place, bend_place, bend_turn, bend_turn, bend_turn]) {
            add(&mut s[k], &seen.noise[k], 1.0);
            s[k][k] += bend;
        }
        let mut rows: [[[f64; 6]; 2]; 6] = core::array::from_fn(|k| [hx[k], hv[k]]);
        let (verdict, weights) = judge(&mut rows, &mut s, &mut y)?;
        if verdict.is_taken() {
            let (mut step, mut faster) = ([0.0; 6], [0.0; 6]);
            for ([x, v], e) in rows.iter().zip(y) {
                add(&mut step, x, e);
                add(&mut faster, v, e);
            }
            next.displacement = next.displacement.moved(&Displacement::of(&step), 1.0);
            next.rate = next.rate.plus(&Displacement::of(&faster));
            next.covariance.reduce(&rows, &weights);
        }
        Ok((next, verdict))
    }
}

impl Covariance {
    /// P ← F·P·Fᵀ + Q over `dt` s, F = \[I, a·I; 0, φ·I\] with φ = exp(−dt/τ) and a = τ·(1 − φ).
    fn step(&mut self, dt: f64, drift: &Drift) {
        let Self { xx, xv, vv } = self;
        let (u, lost) = (dt / drift.time, -libm::expm1(-dt / drift.time));
        let (a, kept) = (drift.time * lost, 1.0 - lost);
        for i in 0..6 {
            for j in i..6 {
                let sum = xx[i][j] + a * (xv[i][j] + xv[j][i]) + a * a * vv[i][j];
                xx[i][j] = sum;
                xx[j][i] = sum;
            }
        }
        for i in 0..6 {
            for j in 0..6 {
                xv[i][j] = kept * (xv[i][j] + a * vv[i][j]);
                vv[i][j] *= kept * kept;
            }
        }
        // With σ² the variance of a rate: ∫∫ of its correlation. The first is the difference of nearly equal numbers when u is
        // small, so it has a series: Σ (−1)ⁿ⁺¹·(2ⁿ − 4)/n!·uⁿ from 3 on.
        let series = 2.0 / 3.0 - u * (0.5 - u * (7.0 / 30.0 - u * (1.0 / 12.0 - u * (31.0 / 1260.0 - u / 160.0))));
        let wandered = if u < 0.02 { u * u * u * series } else { 2.0 * u - 2.0 * lost - lost * lost };
        for (k, deviation) in
            (0..6).zip([drift.speed, drift.speed, drift.speed, drift.turn_rate, drift.turn_rate, drift.turn_rate])
        {
            let variance = deviation * deviation;
            xx[k][k] += variance * drift.time * drift.time * wandered;
            xv[k][k] += variance * drift.time * lost * lost;
            vv[k][k] += variance * lost * (2.0 - lost);
        }
    }

    /// P ← P − WᵀD⁻¹W, given 1/D.
    fn reduce(&mut self, w: &[[[f64; 6]; 2]; 6], weights: &[f64; 6]) {
        let Self { xx, xv, vv } = self;
        for i in 0..6 {
            for ([x, v], weight) in w.iter().zip(weights) {
                let factor = weight * x[i];
                subtract(&mut xx[i], x, factor);
                subtract(&mut xv[i], v, factor);
                subtract(&mut vv[i], v, weight * v[i]);
            }
        }
        mirror(xx);
        mirror(vv);
    }
}

/// −\[r\]×, the part of H that is neither one nor zero: what a small rotation does to a point at that lever, row by row.
fn crossing(r: &Vector3<f64>) -> [[f64; 3]; 3] {
    [[0.0, r.z, -r.y], [-r.z, 0.0, r.x], [r.y, -r.x, 0.0]]
}

/// H·B.
fn product(crossing: &[[f64; 3]; 3], block: &Block<6>) -> Block<6> {
    let mut product = *block;
    let [_, _, _, a, b, c] = block;
    for (row, [x, y, z]) in product.iter_mut().zip(crossing) {
        add(row, a, *x);
        add(row, b, *y);
        add(row, c, *z);
    }
    product
}

/// B·Hᵀ.
fn transposed_product(block: &Block<6>, crossing: &[[f64; 3]; 3]) -> Block<6> {
    let mut product = *block;
    for row in &mut product {
        let [_, _, _, a, b, c] = *row;
        for (value, [x, y, z]) in row.iter_mut().zip(crossing) {
            *value += x * a + y * b + z * c;
        }
    }
    product
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_what_small_displacements_do_to_the_target() {
        let (pivot, target) = (Vector3::new(0.7, -0.2, 0.4), Vector3::new(1.3, 0.5, -0.6));
        for k in 0..200 {
            let t = f64::from(k);
            let displacement = Displacement {
                translation: Vector3::new(libm::sin(t), libm::cos(t), libm::sin(2.0 * t)) * 0.02,
                rotation: Vector3::new(libm::cos(3.0 * t), libm::sin(5.0 * t), libm::cos(t)) * 0.1,
            };
            let here = displacement.pose(&pivot);
            let lever = here.rotation * (target - pivot);
            let (crossing, mut identity) = (crossing(&lever), [[0.0; 6]; 6]);
            for axis in 0..6 {
                identity[axis][axis] = 1.0;
            }
            let h = product(&crossing, &identity);
            assert_eq!(transposed_product(&identity, &crossing), core::array::from_fn(|i| h.map(|row| row[i])));
            for axis in 0..6 {
                let beside = |by: f64| {
                    let mut step = [0.0; 6];
                    step[axis] = by;
                    displacement.moved(&Displacement::of(&step), 1.0).pose(&pivot)
                };
                let (below, above) = (beside(-1e-5), beside(1e-5));
                let way = (above.transform_point(&target) - below.transform_point(&target)) / 2e-5;
                let turn = Pose { rotation: above.rotation * below.rotation.transpose(), ..above };
                let found = Displacement { translation: way, rotation: turn.rotation_vector() / 2e-5 };
                let miss = found.plus(&Displacement::of(&h.map(|row| row[axis])).scaled(-1.0));
                assert!(miss.translation.norm() < 1e-8 && miss.rotation.norm() < 1e-8, "{k} {axis}: {miss:?}");
            }
        }
    }

    /// Q of a rate with deviation 1 over T: ∫ g·gᵀ·2/τ ds with g(s) = [τ(1 − e^(−s/τ)), e^(−s/τ)], by Simpson's rule.
    #[test]
    fn process_noise_is_the_integral_at_any_step() {
        let drift = Drift { speed: 1.0, turn_rate: 0.1, time: 2.0 };
        for dt in [1e-5, 1e-3, 0.008, 0.039, 0.041, 0.3, 2.0, 10.0] {
            let none = [[0.0; 6]; 6];
            let mut covariance = Covariance { xx: none, xv: none, vv: none };
            covariance.step(dt, &drift);
            let (mut sums, count) = ([0.0; 3], 4000);
            for k in 0..=count {
                let s = dt * f64::from(k) / f64::from(count);
                let weight = if k == 0 || k == count { 1.0 } else { 2.0 + 2.0 * f64::from(k % 2) };
                let (x, v) = (-2.0 * libm::expm1(-s / 2.0), libm::exp(-s / 2.0));
                for (sum, value) in sums.iter_mut().zip([x * x, x * v, v * v]) {
                    *sum += weight * value * dt / (3.0 * f64::from(count));
                }
            }
            let found = [covariance.xx[1][1], covariance.xv[1][1], covariance.vv[1][1]];
            for (found, sum) in found.iter().zip(sums) {
                assert!((found / sum - 1.0).abs() < 1e-10, "{dt}: {found:e} {sum:e}");
            }
            assert!((covariance.xx[4][4] / covariance.xx[1][1] - 0.01).abs() < 1e-12);
        }
    }

    #[test]
    fn two_steps_are_one_of_their_length() {
        let drift = Drift { speed: 3e-3, turn_rate: 1e-4, time: 2.0 };
        let start = {
            let mut block = [[0.0; 6]; 6];
            for i in 0..6 {
                for j in 0..6 {
                    block[i][j] = 1e-8 / (1.0 + (i as f64 - j as f64) * (i as f64 - j as f64));
                }
            }
            Covariance { xx: block, xv: block, vv: block }
        };
        let (mut once, mut twice) = (start, start);
        once.step(0.5, &drift);
        twice.step(0.007, &drift);
        twice.step(0.493, &drift);
        for (a, b) in [(once.xx, twice.xx), (once.xv, twice.xv), (once.vv, twice.vv)] {
            for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
                assert!((a - b).abs() < 1e-12 * a.abs().max(1e-8), "{a:e} {b:e}");
            }
        }
    }
}
