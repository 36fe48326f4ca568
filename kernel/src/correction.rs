//! Joint offsets from outside, added to what the path clock puts out: bounded, and ramped out when they end.

use crate::arm::Arm;
use crate::guard::{Quantity, Violation, Workspace, exceeds};
use crate::ramp::{Ramp, RampLimits, brakable};
use crate::units::JointPos;
use serde::{Deserialize, Serialize};

/// What a correction may be, the same for every joint. All zero: no correction is taken.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CorrectionLimits {
    /// Largest offset (rad or m).
    pub size_max: f64,
    /// How fast it may change (rad/s or m/s).
    pub velocity_max: f64,
    /// How fast that may change (rad/s² or m/s²).
    pub acceleration_max: f64,
}

impl CorrectionLimits {
    /// No correction is taken.
    pub const NONE: Self = Self { size_max: 0.0, velocity_max: 0.0, acceleration_max: 0.0 };

    /// Whether these are limits: all positive, or all zero.
    pub fn is_valid(&self) -> bool {
        let all = [self.size_max, self.velocity_max, self.acceleration_max];
        all.iter().all(|limit| limit.is_finite() && *limit > 0.0) || *self == Self::NONE
    }

    /// Farthest that an offset can get (rad or m), with `period` s between ticks: one that must be ramped out runs on until
    /// its speed is braken.
    pub fn reach(&self, period: f64) -> f64 {
        if self.size_max > 0.0 {
            let v = self.velocity_max;
            self.size_max + v * (0.5 * v / self.acceleration_max + period)
        } else {
            0.0
        }
    }
}

/// The correction now.
#[derive(Clone, Copy, Debug)]
pub struct Correction<const N: usize> {
    joints: [Offset; N],
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Offset {
    ramp: Ramp,
    /// Mean slope over the last period, a first difference: what the next is judged against.
    velocity: f64,
}

impl Offset {
    const NONE: Self = Self { ramp: Ramp::at(0.0), velocity: 0.0 };
}

impl<const N: usize> Correction<N> {
    /// None.
    pub const fn none() -> Self {
        Self { joints: [Offset::NONE; N] }
    }

    /// Whether it is none.
    pub fn is_none(&self) -> bool {
        self.joints.iter().all(|joint| *joint == Offset::NONE)
    }

    /// Offsets (rad or m).
    pub fn offsets(&self) -> JointPos<N> {
        JointPos(self.joints.map(|joint| joint.ramp.value))
    }

    /// The path's joints, corrected.
    pub fn applied_to(&self, path: &JointPos<N>) -> JointPos<N> {
        let mut joints = *path;
        for (q, correction) in joints.0.iter_mut().zip(&self.joints) {
            *q += correction.ramp.value;
        }
        joints
    }

    /// Whether the path's joints, which are inside the workspace by themselves, stay there when corrected.
    ///
    /// # Errors
    /// The first [`Violation`], planes in order.
    pub fn check(&self, path: &JointPos<N>, workspace: &Workspace, arm: &Arm<N>) -> Result<(), Violation> {
        if self.is_none() { Ok(()) } else { workspace.check(arm, &self.applied_to(path)) }
    }

    /// Takes the next correction when size, first and second difference keep their limits.
    ///
    /// # Errors
    /// The first [`Violation`], joints in order; nothing has changed then.
    pub fn follow(&mut self, next: &JointPos<N>, limits: &CorrectionLimits, period: f64) -> Result<(), Violation> {
        let mut joints = self.joints;
        for (index, (joint, &value)) in (0..N as u8).zip(joints.iter_mut().zip(&next.0)) {
            let fail = |quantity, value, limit| Err(Violation { quantity, joint: index, value, limit });
            if !value.is_finite() {
                return fail(Quantity::Finite, 0.0, limits.size_max);
            }
            let velocity = (value - joint.ramp.value) / period;
            for (quantity, value, limit) in [
                (Quantity::Position, value, limits.size_max),
                (Quantity::Velocity, velocity, limits.velocity_max),
                (Quantity::Acceleration, (velocity - joint.velocity) / period, limits.acceleration_max),
            ] {
                if exceeds(libm::fabs(value), limit) {
                    return fail(quantity, value, limit);
                }
            }
            *joint = Offset { ramp: Ramp { value, slope: velocity }, velocity };
        }
        self.joints = joints;
        Ok(())
    }

    /// The next correction on the way to `wanted`: that itself where the limits allow it, else as near as they do, such that the
    /// way back to rest stays within them too. [`Self::follow`] takes what this gives. `before` is what was wanted a period ago:
    /// a correction that had to stay behind catches up with a wanted one that moves. Returns with it how far it stays behind
    /// (rad, m), the most of all joints.
    ///
    /// The slope for the coming period is the wanted one plus what closes the gap and can be braken within it
    /// ([`crate::ramp`]), held inside the limits of speed and acceleration, and to what can be braken before the limit of size.
    pub fn towards(
        &self,
        wanted: &JointPos<N>,
        before: &JointPos<N>,
        limits: &CorrectionLimits,
        period: f64,
    ) -> (JointPos<N>, f64) {
        let [size, speed, change] = [limits.size_max, limits.velocity_max, limits.acceleration_max * period]
            .map(|limit| limit * (1.0 - LIMIT_ROUNDING));
        let (mut next, mut behind) = (self.offsets(), 0.0_f64);
        if change <= 0.0 {
            return (next, wanted.0.iter().fold(behind, |most, wanted| most.max(libm::fabs(*wanted))));
        }
        let joints = next.0.iter_mut().zip(&self.joints);
        for ((value, joint), (&wanted, &before)) in joints.zip(wanted.0.iter().zip(&before.0)) {
            let now = *value;
            let room = |distance: f64| brakable(distance.max(0.0), change, period).min(speed);
            let high = room(size - now).min(joint.velocity + change);
            let low = (-room(size + now)).max(joint.velocity - change);
            let gap = before - now;
            let slope = (wanted - before) / period + libm::copysign(brakable(libm::fabs(gap), change, period), gap);
            *value = now + slope.min(high).max(low) * period;
            behind = behind.max(libm::fabs(wanted - *value));
        }
        (next, behind)
    }

    /// What [`Self::towards`] gave is the correction now.
    pub(crate) fn lead_to(&mut self, next: &JointPos<N>, period: f64) {
        for (joint, &value) in self.joints.iter_mut().zip(&next.0) {
            let velocity = (value - joint.ramp.value) / period;
            *joint = Offset { ramp: Ramp { value, slope: velocity }, velocity };
        }
    }

    /// One period on the way to none.
    pub fn ramp_out(&mut self, limits: &CorrectionLimits, period: f64) {
        let limits = RampLimits { slope_max: limits.velocity_max, curvature_max: limits.acceleration_max };
        for joint in self.joints.iter_mut().filter(|joint| **joint != Offset::NONE) {
            let before = joint.ramp.value;
            joint.ramp.step(0.0, &limits, period);
            joint.velocity = if joint.ramp == Ramp::at(0.0) { 0.0 } else { (joint.ramp.value - before) / period };
        }
    }
}

/// How far inside its limits [`Correction::towards`] stays, so that [`Correction::follow`] takes what it gives whatever is rounded.
const LIMIT_ROUNDING: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: CorrectionLimits = CorrectionLimits { size_max: 0.01, velocity_max: 0.02, acceleration_max: 0.1 };
    const PERIOD: f64 = 0.002;

    fn refused(before: &[f64], next: f64) -> Option<Quantity> {
        let mut correction = Correction::none();
        for &value in before {
            correction.follow(&JointPos([value]), &LIMITS, PERIOD).unwrap();
        }
        correction.follow(&JointPos([next]), &LIMITS, PERIOD).err().map(|violation| violation.quantity)
    }

    #[test]
    fn each_limit_is_named_when_it_breaks() {
        assert_eq!(refused(&[], 3e-7), None);
        assert_eq!(refused(&[], f64::INFINITY), Some(Quantity::Finite));
        assert_eq!(refused(&[], 0.011), Some(Quantity::Position));
        assert_eq!(refused(&[], 1e-4), Some(Quantity::Velocity));
        assert_eq!(refused(&[3e-7], 3e-7 - 2e-7), Some(Quantity::Acceleration));
    }

    /// Whatever is wanted, steps and noise and waves, what comes out is what [`Correction::follow`] takes; and where the wanted
    /// keeps the limits by itself, it is what comes out.
    #[test]
    fn on_the_way_to_anything_the_limits_are_kept_and_what_keeps_them_comes_out_as_it_is() {
        let mut seed = 5_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / (1_u64 << 30) as f64 - 1.0
        };
        for period in [0.001, 0.002, 0.008] {
            let (mut correction, mut before, mut exact) = (Correction::<1>::none(), 0.0, 0);
            for k in 0..(48.0 / period) as u32 {
                let t = f64::from(k) * period;
                let phase = (t / 4.0) as u32 % 6;
                let wanted = match phase {
                    0 => 0.008 * libm::sin(2.0 * t),
                    1 => 0.03 * random(),
                    2 if k % 300 == 0 => 0.02 * random(),
                    2 => before,
                    3 => 0.02 * libm::sin(20.0 * t),
                    4 => 0.0,
                    _ => -0.5,
                };
                let (next, behind) = correction.towards(&JointPos([wanted]), &JointPos([before]), &LIMITS, period);
                correction.follow(&next, &LIMITS, period).unwrap_or_else(|error| panic!("{k}: {error:?}"));
                assert!((behind - libm::fabs(wanted - next.0[0])).abs() < 1e-15);
                // Three seconds to catch up with a wave whose speed is 80 %, its acceleration 32 % of the limits.
                if phase == 0 && t % 4.0 > 3.0 {
                    assert!(behind < 1e-12, "{k}: {behind}");
                    exact += 1;
                }
                before = wanted;
            }
            assert!(exact > 200, "{exact}");
        }
        let none = Correction::<1>::none();
        assert_eq!(
            none.towards(&JointPos([0.1]), &JointPos([0.1]), &CorrectionLimits::NONE, PERIOD),
            (JointPos([0.0]), 0.1)
        );
    }

    #[test]
    fn it_is_ramped_out_within_its_limits_and_its_reach() {
        let mut correction = Correction::<1>::none();
        let (mut value, mut slope) = (0.0, 0.0);
        while value + (slope + 0.0999 * PERIOD) * PERIOD < LIMITS.size_max {
            slope = (slope + 0.0999 * PERIOD).min(0.019_99);
            value += slope * PERIOD;
            correction.follow(&JointPos([value]), &LIMITS, PERIOD).unwrap();
        }
        let mut last = [value, value - slope * PERIOD];
        let mut ticks = 0;
        while !correction.is_none() {
            correction.ramp_out(&LIMITS, PERIOD);
            let next = correction.offsets().0[0];
            let (v, a) = ((next - last[0]) / PERIOD, (next - 2.0 * last[0] + last[1]) / (PERIOD * PERIOD));
            assert!(v.abs() <= 0.02 * 1.000_001 && a.abs() <= 0.1 * 1.000_001, "tick {ticks}: {v} {a}");
            assert!(next.abs() <= LIMITS.reach(PERIOD));
            last = [next, last[0]];
            ticks += 1;
            assert!(ticks < 1000);
        }
    }
}
