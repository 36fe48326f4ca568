//! The gate that every sample passes: finite, position, speed, acceleration, jerk.
//!
//! Judged are the finite differences of the samples as they will be sent, so that nothing between plan and wire can hide a
//! step.

use crate::units::{JointAcc, JointJerk, JointPos, JointVel};
use core::cmp::Ordering;
use serde::{Deserialize, Serialize};

/// What the joints may do. All of it comes from the cell file by way of [`crate::frame::Configure`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits<const N: usize> {
    /// Lowest positions (rad or m).
    pub position_min: JointPos<N>,
    /// Highest positions (rad or m).
    pub position_max: JointPos<N>,
    /// Highest speeds (rad/s or m/s).
    pub velocity_max: JointVel<N>,
    /// Highest accelerations (rad/s² or m/s²).
    pub acceleration_max: JointAcc<N>,
    /// Highest jerks (rad/s³ or m/s³).
    pub jerk_max: JointJerk<N>,
}

/// Which limit a sample breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quantity {
    /// NaN or infinite.
    Finite,
    /// Position.
    Position,
    /// First difference over the period.
    Velocity,
    /// Second difference.
    Acceleration,
    /// Third difference.
    Jerk,
}

/// A broken limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// What is too large.
    pub quantity: Quantity,
    /// The joint, 0 for the first.
    pub joint: u8,
    /// What was found, in the quantity's unit.
    pub value: f64,
    /// What is allowed.
    pub limit: f64,
}

/// Finite differences of a run of samples, one period apart, newest first.
#[derive(Clone, Copy, Debug)]
pub struct Differences<const N: usize> {
    last: [JointPos<N>; 3],
}

impl<const N: usize> Differences<N> {
    /// At rest at `at` since long.
    pub const fn at_rest(at: JointPos<N>) -> Self {
        Self { last: [at; 3] }
    }

    /// After the three samples `newest`, `middle`, `oldest`.
    pub const fn after(newest: JointPos<N>, middle: JointPos<N>, oldest: JointPos<N>) -> Self {
        Self { last: [newest, middle, oldest] }
    }

    /// The newest sample.
    pub const fn newest(&self) -> &JointPos<N> {
        &self.last[0]
    }

    /// Whether the last two samples are the same.
    pub fn is_at_rest(&self) -> bool {
        self.last[0] == self.last[1]
    }

    /// Takes the next sample when it passes every limit.
    ///
    /// # Errors
    /// The first [`Violation`], joints in order; the differences are then unchanged.
    pub fn push(&mut self, next: &JointPos<N>, limits: &Limits<N>, period: f64) -> Result<(), Violation> {
        let [a, b, c] = &self.last;
        for joint in 0..N {
            let at = |values: &[f64; N]| values.get(joint).copied().unwrap_or(f64::NAN);
            let (q0, q1, q2, q3) = (at(&next.0), at(&a.0), at(&b.0), at(&c.0));
            let (low, high) = (at(&limits.position_min.0), at(&limits.position_max.0));
            let fail = |quantity, value, limit| Err(Violation { quantity, joint: joint as u8, value, limit });
            if !q0.is_finite() {
                return fail(Quantity::Finite, q0, high);
            }
            if q0 < low {
                return fail(Quantity::Position, q0, low);
            }
            if q0 > high {
                return fail(Quantity::Position, q0, high);
            }
            let velocity = (q0 - q1) / period;
            let acceleration = (q0 - 2.0 * q1 + q2) / (period * period);
            let jerk = (q0 - 3.0 * (q1 - q2) - q3) / (period * period * period);
            for (quantity, value, limit) in [
                (Quantity::Velocity, velocity, at(&limits.velocity_max.0)),
                (Quantity::Acceleration, acceleration, at(&limits.acceleration_max.0)),
                (Quantity::Jerk, jerk, at(&limits.jerk_max.0)),
            ] {
                if exceeds(libm::fabs(value), limit) {
                    return fail(quantity, value, limit);
                }
            }
        }
        self.last = [*next, self.last[0], self.last[1]];
        Ok(())
    }
}

/// Whether a value is above its limit, or either is NaN.
pub(crate) fn exceeds(value: f64, limit: f64) -> bool {
    !matches!(value.partial_cmp(&limit), Some(Ordering::Less | Ordering::Equal))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits<1> = Limits {
        position_min: JointPos([-1.0]),
        position_max: JointPos([1.0]),
        velocity_max: JointVel([1.0]),
        acceleration_max: JointAcc([10.0]),
        jerk_max: JointJerk([1000.0]),
    };

    fn quantity(samples: &[f64]) -> Option<Quantity> {
        let mut differences = Differences::at_rest(JointPos([0.0]));
        samples.iter().find_map(|&q| differences.push(&JointPos([q]), &LIMITS, 0.01).err().map(|v| v.quantity))
    }

    #[test]
    fn each_limit_is_named_when_it_breaks() {
        assert_eq!(quantity(&[0.0009, 0.0027, 0.0045]), None);
        assert_eq!(quantity(&[f64::NAN]), Some(Quantity::Finite));
        assert_eq!(quantity(&[1.5]), Some(Quantity::Position));
        assert_eq!(quantity(&[0.02]), Some(Quantity::Velocity));
        assert_eq!(quantity(&[0.0011]), Some(Quantity::Acceleration));
        assert_eq!(quantity(&[0.0009, 0.0009]), Some(Quantity::Jerk));
    }
}
