//! The gate that every sample passes: finite, position, speed, acceleration, jerk, workspace.
//!
//! Judged are the finite differences of the samples as they will be sent, so that nothing between plan and wire can hide a
//! step. It stands at two places: setpoints are judged at the sample period when a batch comes in, against what a plan may
//! ask for; every output is judged at the tick period, against that plus what the kernel itself adds, [`output_least`].

use crate::arm::Arm;
use crate::clock::{RATE_CURVATURE_MAX, RATE_SLOPE_MAX};
use crate::correction::CorrectionLimits;
use crate::interpolate::{
    ACCELERATION_OVERSHOOT, JERK_GAIN, JERK_GAIN_EQUAL_PERIODS, POSITION_OVERSHOOT, VELOCITY_OVERSHOOT,
};
use crate::setpoint::JOINT_QUANTUM;
use crate::units::{JointAcc, JointJerk, JointPos, JointVel};
use core::cmp::Ordering;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Most planes that bound a workspace.
pub const PLANES_MAX: usize = 8;

/// How the joints may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion<const N: usize> {
    /// Highest speeds (rad/s or m/s).
    pub velocity_max: JointVel<N>,
    /// Highest accelerations (rad/s² or m/s²).
    pub acceleration_max: JointAcc<N>,
    /// Highest jerks (rad/s³ or m/s³).
    pub jerk_max: JointJerk<N>,
}

/// Where the joints may be and how they may move. All of it comes from the cell file by way of
/// [`crate::frame::Configure`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits<const N: usize> {
    /// Lowest positions (rad or m).
    pub position_min: JointPos<N>,
    /// Highest positions (rad or m).
    pub position_max: JointPos<N>,
    /// Speed, acceleration, jerk.
    pub motion: Motion<N>,
}

/// A half-space in which the tool must stay: normal · point ≤ offset, in the base frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// Unit vector that points out of the allowed side.
    pub normal_in_base: [f64; 3],
    /// Distance of the plane from the base's origin along the normal (m).
    pub offset: f64,
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
    /// Flange or tool centre point beyond a plane of the workspace.
    Workspace,
}

/// A broken limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// What is too large.
    pub quantity: Quantity,
    /// The joint, 0 for the first; for [`Quantity::Workspace`] the plane.
    pub joint: u8,
    /// What was found, in the quantity's unit; 0 for [`Quantity::Finite`], so that a message never carries NaN.
    pub value: f64,
    /// What is allowed.
    pub limit: f64,
}

/// Time between setpoints and between ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Periods {
    /// From setpoint to setpoint (s).
    pub sample: f64,
    /// From tick to tick (s); the sample period or a whole part of it.
    pub tick: f64,
}

/// The least limits that outputs need when setpoints keep `plan`: what the path clock, the interpolation and corrections can
/// add.
///
/// Let q(θ) be the path interpolated between samples of period T whose differences keep V, A and J (and the rounding of
/// their grid). Then (see [`crate::interpolate`]) |q'| ≤ V' = V + 0.185·J·T², |q''| ≤ A' = A + 0.7·J·T and |q'''| ≤ g·J. The
/// clock plays x(t) = q(θ(t)) with 0 ≤ θ̇ ≤ 1, |θ̈| ≤ a = 1.5/s and |θ⃛| ≤ c = 6/s². By the chain rule
///
/// - ẋ = q'θ̇, so |ẋ| ≤ V';
/// - ẍ = q''θ̇² + q'θ̈, so |ẍ| ≤ A' + a·V';
/// - x⃛ = q'''θ̇³ + 3q''θ̇θ̈ + q'θ⃛, so |x⃛| ≤ g·J + 3a·A' + c·V',
///
/// and differences over a tick are means of these derivatives. g is 4; with equal periods third differences average over
/// three samples, and 1.5 is enough. A correction adds its speed and acceleration, and as jerk twice its acceleration within
/// one tick.
pub fn output_least<const N: usize>(plan: &Motion<N>, periods: Periods, correction: &CorrectionLimits) -> Motion<N> {
    let sample = periods.sample;
    let gain = if periods.tick < sample { JERK_GAIN } else { JERK_GAIN_EQUAL_PERIODS };
    let mut least = *plan;
    let motion = least.velocity_max.0.iter_mut().zip(&mut least.acceleration_max.0).zip(&mut least.jerk_max.0);
    for ((velocity, acceleration), jerk) in motion {
        let j = *jerk + rounding(Quantity::Jerk, sample);
        let v = *velocity + rounding(Quantity::Velocity, sample) + VELOCITY_OVERSHOOT * j * sample * sample;
        let a = *acceleration + rounding(Quantity::Acceleration, sample) + ACCELERATION_OVERSHOOT * j * sample;
        *velocity = v + correction.velocity_max;
        *acceleration = a + RATE_SLOPE_MAX * v + correction.acceleration_max;
        *jerk = gain * j
            + 3.0 * RATE_SLOPE_MAX * a
            + RATE_CURVATURE_MAX * v
            + 2.0 * correction.acceleration_max / periods.tick;
    }
    least
}

/// The limits for setpoints, where outputs keep `output`: positions leave room for what lies between samples (A·T²/8 +
/// 0.017·J·T³) and for corrections.
pub fn plan_limits<const N: usize>(
    output: &Limits<N>,
    plan: &Motion<N>,
    periods: Periods,
    correction: &CorrectionLimits,
) -> Limits<N> {
    let t = periods.sample;
    let mut limits = Limits { motion: *plan, ..*output };
    let positions = limits.position_min.0.iter_mut().zip(&mut limits.position_max.0);
    for ((low, high), (a, j)) in positions.zip(plan.acceleration_max.0.iter().zip(&plan.jerk_max.0)) {
        let margin = (a / 8.0 + POSITION_OVERSHOOT * j * t) * t * t + correction.reach(periods.tick);
        *low += margin;
        *high -= margin;
    }
    limits
}

/// What rounding to the grid of setpoints, half a quantum each, can add to a difference over `period`.
fn rounding(quantity: Quantity, period: f64) -> f64 {
    match quantity {
        Quantity::Velocity => JOINT_QUANTUM / period,
        Quantity::Acceleration => 2.0 * JOINT_QUANTUM / (period * period),
        Quantity::Jerk => 4.0 * JOINT_QUANTUM / (period * period * period),
        Quantity::Finite | Quantity::Position | Quantity::Workspace => 0.0,
    }
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
        let [newest, ..] = &self.last;
        newest
    }

    /// Whether the last three samples are the same: then standing on breaks no limit, and what follows joins equally well
    /// now and after any time at rest.
    pub fn is_at_rest(&self) -> bool {
        let [newest, middle, oldest] = &self.last;
        newest == middle && middle == oldest
    }

    /// Takes the next sample when it passes every limit, the rounding of its grid allowed for.
    ///
    /// # Errors
    /// The first [`Violation`], joints in order; the differences are then unchanged.
    pub fn push(&mut self, next: &JointPos<N>, limits: &Limits<N>, period: f64) -> Result<(), Violation> {
        let [a, b, c] = &self.last;
        let motion = &limits.motion;
        let slack = [Quantity::Velocity, Quantity::Acceleration, Quantity::Jerk].map(|q| rounding(q, period));
        for joint in 0..N {
            #[cfg(test)]
            crate::steps::count();
            let at = |values: &[f64; N]| values.get(joint).copied().unwrap_or(f64::NAN);
            let (q0, q1, q2, q3) = (at(&next.0), at(&a.0), at(&b.0), at(&c.0));
            let (low, high) = (at(&limits.position_min.0), at(&limits.position_max.0));
            let fail = |quantity, value, limit| Err(Violation { quantity, joint: joint as u8, value, limit });
            if !q0.is_finite() {
                return fail(Quantity::Finite, 0.0, high);
            }
            if exceeds(low, q0) {
                return fail(Quantity::Position, q0, low);
            }
            if exceeds(q0, high) {
                return fail(Quantity::Position, q0, high);
            }
            let velocity = (q0 - q1) / period;
            let acceleration = (q0 - 2.0 * q1 + q2) / (period * period);
            let jerk = (q0 - 3.0 * (q1 - q2) - q3) / (period * period * period);
            let [v, a, j] = slack;
            for (quantity, value, limit, slack) in [
                (Quantity::Velocity, velocity, at(&motion.velocity_max.0), v),
                (Quantity::Acceleration, acceleration, at(&motion.acceleration_max.0), a),
                (Quantity::Jerk, jerk, at(&motion.jerk_max.0), j),
            ] {
                if exceeds(libm::fabs(value), limit + slack) {
                    return fail(quantity, value, limit);
                }
            }
        }
        self.last = [*next, *a, *b];
        Ok(())
    }
}

/// The space in which flange and tool centre point must stay.
#[derive(Clone, Debug, PartialEq)]
pub struct Workspace {
    /// The tool centre point, in the flange frame (m).
    pub tcp_in_flange: Vector3<f64>,
    /// The planes that bound it; none bound nothing.
    pub planes: heapless::Vec<Plane, PLANES_MAX>,
}

impl Workspace {
    /// Whether flange and tool centre point of an arm with these joints are inside.
    ///
    /// # Errors
    /// The first [`Violation`], planes in order.
    pub fn check<const N: usize>(&self, arm: &Arm<N>, joints: &JointPos<N>) -> Result<(), Violation> {
        if self.planes.is_empty() {
            return Ok(());
        }
        let points = arm.points(joints, [Vector3::zeros(), self.tcp_in_flange]);
        for (index, plane) in (0..PLANES_MAX as u8).zip(&self.planes) {
            let normal = Vector3::from(plane.normal_in_base);
            for point_in_base in &points {
                let value = normal.dot(point_in_base);
                if exceeds(value, plane.offset) {
                    let quantity = Quantity::Workspace;
                    return Err(Violation { quantity, joint: index, value, limit: plane.offset });
                }
            }
        }
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
    use crate::arms::ur::UR10E;

    const LIMITS: Limits<1> = Limits {
        position_min: JointPos([-1.0]),
        position_max: JointPos([1.0]),
        motion: Motion {
            velocity_max: JointVel([1.0]),
            acceleration_max: JointAcc([10.0]),
            jerk_max: JointJerk([1000.0]),
        },
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

    #[test]
    fn a_limit_that_is_met_exactly_is_kept_in_spite_of_the_grid() {
        // 10 rad/s² over 10 ms is 0.001 rad, which is no grid value.
        assert_eq!(quantity(&[crate::setpoint::joint_on_grid(0.001) + 0.5 * JOINT_QUANTUM]), None);
    }

    #[test]
    fn the_sum_for_outputs_is_that_of_the_chain_rule() {
        let none = CorrectionLimits::NONE;
        let equal = output_least(&LIMITS.motion, Periods { sample: 0.01, tick: 0.01 }, &none);
        let finer = output_least(&LIMITS.motion, Periods { sample: 0.01, tick: 0.002 }, &none);
        // V' = 1 + 0.185·1000·1e-4 = 1.0185; A' = 10 + 0.7·1000·0.01 = 17.
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-3, "{found}, not {expected}");
        near(equal.velocity_max.0[0], 1.0185);
        near(equal.acceleration_max.0[0], 17.0 + 1.5 * 1.0185);
        near(equal.jerk_max.0[0], 1500.0 + 4.5 * 17.0 + 6.0 * 1.0185);
        near(finer.jerk_max.0[0], 4000.0 + 4.5 * 17.0 + 6.0 * 1.0185);
        let correction = CorrectionLimits { size_max: 0.01, velocity_max: 0.1, acceleration_max: 2.0 };
        let corrected = output_least(&LIMITS.motion, Periods { sample: 0.01, tick: 0.002 }, &correction);
        near(corrected.acceleration_max.0[0] - finer.acceleration_max.0[0], 2.0);
        near(corrected.jerk_max.0[0] - finer.jerk_max.0[0], 2000.0);
    }

    #[test]
    fn flange_and_tool_are_both_held_inside_the_planes() {
        // Stretched out: flange at x = -1.18425, y = -0.2907, z = 0.0609 (see the arm's table), tool 0.2 m further along -y.
        let joints = JointPos([0.0; 6]);
        let plane = |normal_in_base, offset| Plane { normal_in_base, offset };
        let within = |planes: &[Plane]| {
            let planes = heapless::Vec::from_slice(planes).unwrap();
            Workspace { tcp_in_flange: Vector3::new(0.0, 0.0, 0.2), planes }.check(&UR10E, &joints)
        };
        assert_eq!(within(&[]), Ok(()));
        assert_eq!(within(&[plane([-1.0, 0.0, 0.0], 1.19), plane([0.0, -1.0, 0.0], 0.5)]), Ok(()));
        let flange = within(&[plane([0.0, 1.0, 0.0], 0.0), plane([-1.0, 0.0, 0.0], 1.18)]).unwrap_err();
        assert_eq!((flange.quantity, flange.joint, flange.limit), (Quantity::Workspace, 1, 1.18));
        assert!((flange.value - 1.18425).abs() < 1e-12);
        let tool = within(&[plane([0.0, -1.0, 0.0], 0.4)]).unwrap_err();
        assert!((tool.value - 0.4907).abs() < 1e-12);
    }
}
