//! The filter of the base's displacement: of its place of rest 12 states, translation of the pivot, rotation vector, and their
//! rates; of its swing about that as many ([`super::swing`]), which stay zero where it has none. All in the nominal base frame.
//!
//! Rates are first-order Gauss–Markov processes, ẇ = −w/τ + white noise: they have a standard deviation, last for τ, and fade
//! over a dropout instead of carrying the base away (Gelb, "Applied Optimal Estimation", 1974, 3.8). Rotation is an error state
//! to the left, R = exp(δ)·R̂ (Trawny and Roumeliotis 2005), folded into the rotation vector after each step: a displacement
//! turns by milliradians, so that δ's transition is taken as the identity.

// In matrices an index says more than a chain of iterators does.
#![allow(clippy::needless_range_loop)]

use super::covariance::Covariance;
use super::swing::{Turns, swung};
use super::{BaseConfig, seconds};
use crate::arm::Arm;
use crate::ekf::covariance::{Block, mirror};
use crate::ekf::pose::{bend, rotation_is_sound};
use crate::ekf::{EkfError, Verdict, add, judge, positive};
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

    pub(super) fn of([x, y, z, a, b, c]: &[f64; 6]) -> Self {
        Self { translation: Vector3::new(*x, *y, *z), rotation: Vector3::new(*a, *b, *c) }
    }

    fn plus(&self, other: &Self) -> Self {
        Self { translation: self.translation + other.translation, rotation: self.rotation + other.rotation }
    }

    fn scaled(&self, factor: f64) -> Self {
        Self { translation: self.translation * factor, rotation: self.rotation * factor }
    }

    pub(super) fn array(&self) -> [f64; 6] {
        let (a, b) = (&self.translation, &self.rotation);
        [a.x, a.y, a.z, b.x, b.y, b.z]
    }

    /// What a swing about a centre, from which `lever` runs to the pivot, makes of this displacement.
    fn with_swing(&self, swing: &Self, lever: &Vector3<f64>) -> Self {
        let turn = Pose::from_rotation_vector(Vector3::zeros(), swing.rotation);
        Self {
            translation: self.translation + swing.translation + turn.rotation * lever - lever,
            rotation: (turn * Pose::from_rotation_vector(Vector3::zeros(), self.rotation)).rotation_vector(),
        }
    }

    fn is_finite(&self) -> bool {
        self.translation.iter().chain(self.rotation.iter()).all(|value| value.is_finite())
    }
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
    motion: Motion,
    covariance: Covariance,
}

/// Where the base rests, how it swings about that, and the rates of both.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Motion {
    place: Displacement,
    rate: Displacement,
    swing: Displacement,
    swing_rate: Displacement,
}

impl Motion {
    /// After `dt` s.
    fn after(&self, dt: f64, config: &BaseConfig, turns: &Turns) -> Self {
        let time = config.drift.time;
        let lost = -libm::expm1(-dt / time);
        let [swing, swing_rate] = swung(turns, &self.swing, &self.swing_rate);
        let (place, rate) = (self.place.moved(&self.rate, time * lost), self.rate.scaled(1.0 - lost));
        Self { place, rate, swing, swing_rate }
    }

    /// Where the base is, with its swing.
    fn displacement(&self, config: &BaseConfig) -> Displacement {
        if config.swing.swings() {
            self.place.with_swing(&self.swing, &config.swing.lever(&config.pivot))
        } else {
            self.place
        }
    }

    /// Moved on by steps of its parts.
    fn stepped(&self, steps: &[[f64; 6]; 4]) -> Self {
        let [place, rate, swing, swing_rate] = steps.each_ref().map(Displacement::of);
        Self {
            place: self.place.moved(&place, 1.0),
            rate: self.rate.plus(&rate),
            swing: self.swing.plus(&swing),
            swing_rate: self.swing_rate.plus(&swing_rate),
        }
    }
}

/// The base at a later time, if nothing is measured until then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ahead {
    /// Where it would rest.
    pub place: Displacement,
    /// The rate of that (m/s, rad/s).
    pub rate: Displacement,
    /// Where it is: with its swing.
    pub displacement: Displacement,
}

impl Estimate {
    /// When it is true: the stamp of the last measurement that it took.
    pub const fn at(&self) -> Nanos {
        self.at
    }

    /// Where the base would rest: of the pivot, and rotation.
    pub const fn place(&self) -> &Displacement {
        &self.motion.place
    }

    /// The rate of that (m/s, rad/s).
    pub const fn rate(&self) -> &Displacement {
        &self.motion.rate
    }

    /// Of the swing's centre, and rotation: what is to be added to the place of rest.
    pub const fn swing(&self) -> &Displacement {
        &self.motion.swing
    }

    /// The rate of that (m/s, rad/s).
    pub const fn swing_rate(&self) -> &Displacement {
        &self.motion.swing_rate
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
        let swing = &config.swing;
        let covariance = Covariance::alone(&xx, &config.drift, swing, crossing(&swing.lever(&config.pivot)));
        let still = Displacement::zero();
        let motion = Motion { place: displacement, rate: still, swing: still, swing_rate: still };
        Ok(Self { at: seen.at, motion, covariance })
    }

    /// The base at a later time, if nothing is measured until then.
    pub(super) fn ahead(&self, at: Nanos, config: &BaseConfig) -> Ahead {
        let dt = seconds(self.at, at);
        let motion = self.motion.after(dt, config, &config.swing.turns(dt));
        Ahead { place: motion.place, rate: motion.rate, displacement: motion.displacement(config) }
    }

    /// Moves on to the measurement's stamp and towards it. A measurement that is gated changes nothing, nor does an error.
    ///
    /// The innovation is that of the target, where the noise is simple: the difference of positions, and the rotation vector
    /// of R_measured·R_expectedᵀ. The target lies at the pivot plus a lever r that turns with the base, and the pivot at the
    /// swing's centre plus a lever c, so that H = \[I, −\[r\]×, 0, 0, I, −\[r + c\]×, 0, 0; 0, I, 0, 0, 0, I, 0, 0\]: what a swing
    /// turns of the place's own displacement is of second order and left out.
    pub(super) fn take(&mut self, seen: &Seen, config: &BaseConfig) -> Result<Verdict, EkfError> {
        if config.swing.swings() { self.take_parts::<4>(seen, config) } else { self.take_parts::<2>(seen, config) }
    }

    /// Of the state's parts only so many are looked at.
    fn take_parts<const PARTS: usize>(&mut self, seen: &Seen, config: &BaseConfig) -> Result<Verdict, EkfError> {
        let dt = seconds(self.at, seen.at);
        let turns = config.swing.turns(dt);
        let motion = self.motion.after(dt, config, &turns);
        // In place, and back where it is not taken: that is less to copy than the whole.
        let before = self.covariance.parts::<PARTS>();
        let covariance = &mut self.covariance;
        covariance.step::<PARTS>(dt, &config.drift, &config.swing, &turns);
        let displacement = motion.displacement(config);
        let turn = Pose::from_rotation_vector(Vector3::zeros(), displacement.rotation).rotation;
        let lever = turn * (seen.base_from_target.translation - config.pivot);
        let expected = config.pivot + displacement.translation + lever;
        let place = seen.nominal_from_target.translation - expected;
        let miss = Pose { rotation: seen.rotation * turn.transpose(), translation: place };
        let rotation = miss.rotation_vector();
        let mut y = [place.x, place.y, place.z, rotation.x, rotation.y, rotation.z];
        let levers = [crossing(&lever), crossing(&(lever + config.swing.lever(&config.pivot)))];
        let mut rows = covariance.seen::<PARTS>(&levers);
        let mut s: Block<6> = [[0.0; 6]; 6];
        for (s, row) in s.iter_mut().zip(&rows) {
            // Place and swing; what lies between are rates, which are not seen.
            for (part, lever) in row.iter().step_by(2).zip(&levers) {
                add(s, &seen_by(part, lever), 1.0);
            }
        }
        let [bend_place, bend_turn] = bend(&s);
        for (k, bend) in (0..6).zip([bend_place, bend_place, bend_place, bend_turn, bend_turn, bend_turn]) {
            add(&mut s[k], &seen.noise[k], 1.0);
            s[k][k] += bend;
        }
        let judged = judge(&mut rows, &mut s, &mut y);
        if let Ok((Verdict::Taken { .. }, weights)) = &judged {
            let mut steps = [[0.0; 6]; 4];
            for (row, e) in rows.iter().zip(y) {
                add(steps.as_flattened_mut(), row.as_flattened(), e);
            }
            covariance.reduce(&rows, weights);
            (self.at, self.motion) = (seen.at, motion.stepped(&steps));
        } else {
            covariance.set_parts(&before);
        }
        judged.map(|(verdict, _)| verdict)
    }
}

/// −\[r\]×, the part of H that is neither one nor zero: what a small rotation does to a point at that lever, row by row.
fn crossing(r: &Vector3<f64>) -> [[f64; 3]; 3] {
    [[0.0, r.z, -r.y], [-r.z, 0.0, r.x], [r.y, -r.x, 0.0]]
}

/// H·B.
pub(super) fn product(crossing: &[[f64; 3]; 3], block: &Block<6>) -> Block<6> {
    let mut product = *block;
    let [_, _, _, a, b, c] = block;
    for (row, [x, y, z]) in product.iter_mut().zip(crossing) {
        add(row, a, *x);
        add(row, b, *y);
        add(row, c, *z);
    }
    product
}

/// A row times Hᵀ.
fn seen_by(row: &[f64; 6], crossing: &[[f64; 3]; 3]) -> [f64; 6] {
    let [_, _, _, a, b, c] = *row;
    let mut seen = *row;
    for (value, [x, y, z]) in seen.iter_mut().zip(crossing) {
        *value += x * a + y * b + z * c;
    }
    seen
}

/// B·Hᵀ.
fn transposed_product(block: &Block<6>, crossing: &[[f64; 3]; 3]) -> Block<6> {
    block.map(|row| seen_by(&row, crossing))
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
}
