//! All answers along the curve on which five of the six numbers of the pose are met: one joint is led through its range, the
//! others follow by least squares, and what is left changes its sign at each answer.
//!
//! At a singularity the Jacobian loses one direction, and steps towards the pose lose their way in a curved valley. Without
//! the column of a joint that moves along that direction it is well conditioned, and the valley is a function of one joint.
//! With e the error left and the joint's column replaced by it, the Jacobian's determinant is that function, by Cramer's rule:
//! zero where nothing is left, smooth and with a sign, unlike the size of e.

use crate::arm::Arm;
use crate::ik::numeric::{between, solve};
use crate::ik::track::determinant;
use crate::pose::Pose;
use crate::units::JointPos;
use nalgebra::{SMatrix, Vector6};

/// Samples on one side of the start.
const SAMPLES: usize = 64;
/// Where the first sample is, in steps from the start: the first of these that lies on the curve.
const FIRST: [f64; 5] = [0.4, -0.4, 0.1, -0.1, 0.01];
/// The least share of a step that is tried where the curve is lost.
const SHARE_MIN: f64 = 1.0 / 64.0;
/// Steps of least squares at a sample.
const CORRECTIONS: usize = 6;
/// A step (rad) longer than this has lost the curve.
const STEP_MAX: f64 = 0.6;
/// The last step (rad) of a sample that lies on the curve.
const STEP_LAST: f64 = 1e-3;
/// Step (rad) that is rounding.
const STEP_LEAST: f64 = 1e-13;
/// Steps to a sign change, and to an extremum between samples.
const REFINEMENTS: usize = 12;
const NARROWINGS: usize = 32;
/// What two samples are apart (rad) that are as good as one.
const LED_LEAST: f64 = 1e-7;
/// Way (rad) over which slopes are measured.
const BESIDE: f64 = 1e-5;

/// A joint that is led, and where to.
#[derive(Clone, Copy)]
pub(super) struct Scan<'a, const N: usize> {
    pub arm: &'a Arm<N>,
    pub goal: &'a Pose,
    pub joint: usize,
    /// From sample to sample (rad).
    pub step: f64,
    /// To either side (rad).
    pub reach: f64,
}

#[derive(Clone, Copy)]
struct Sample<const N: usize> {
    joints: JointPos<N>,
    led: f64,
    value: f64,
    /// Of the value over the led joint's position, where it is asked for.
    slope: f64,
}

impl<const N: usize> Sample<N> {
    /// Divided by the way from a zero that is known.
    fn without(self, known: Option<f64>) -> Self {
        let Some(zero) = known else { return self };
        let way = self.led - zero;
        let value = self.value / way;
        Self { value, slope: (self.slope - value) / way, ..self }
    }
}

impl<const N: usize> Scan<'_, N> {
    /// Calls `found` with joints close to each answer on the curve through, or close to, `start`; returns from where to where
    /// the joint could be led.
    pub fn run(&self, start: &JointPos<N>, mut found: impl FnMut(&JointPos<N>)) -> (f64, f64) {
        let from = self.led(start);
        // Beside the start: that may be an answer itself, and its value then a rounding error without a sign.
        let first = FIRST.iter().find_map(|share| self.sloped(start, from + share * self.step));
        let Some(first) = first else { return (from, from) };
        let high = self.walk(&first, 1.0, &mut found);
        let low = self.walk(&first, -1.0, &mut found);
        (low, high)
    }

    /// From the first sample on in one sense; returns where it ended.
    fn walk(&self, first: &Sample<N>, sense: f64, found: &mut impl FnMut(&JointPos<N>)) -> f64 {
        let (mut now, mut share, end) = (*first, 1.0, self.reach - LED_LEAST);
        for _ in 0..SAMPLES {
            let way = libm::fabs(now.led - first.led);
            if way >= end || share < SHARE_MIN {
                break;
            }
            let led = now.led + sense * (self.step * share).min(self.reach - way);
            let Some(next) = self.sloped(&now.joints, led) else {
                share *= 0.5;
                continue;
            };
            if (now.value < 0.0) != (next.value < 0.0) {
                let zero = self.zero(&now, &next, None);
                found(&zero.joints);
                // There may be two more: without this zero, they are between two samples of one sign.
                self.turn(&now.without(Some(zero.led)), &next.without(Some(zero.led)), Some(zero.led), found);
            } else {
                self.turn(&now, &next, None, found);
            }
            now = next;
            share = (2.0 * share).min(1.0);
        }
        now.led
    }

    fn led(&self, joints: &JointPos<N>) -> f64 {
        joints.0.get(self.joint).copied().unwrap_or(0.0)
    }

    /// The curve where the joint is led to, close to some joints.
    fn sample(&self, near: &JointPos<N>, led: f64) -> Option<Sample<N>> {
        let mut joints = *near;
        if let Some(slot) = joints.0.get_mut(self.joint) {
            *slot = led;
        }
        let mut last = f64::INFINITY;
        for _ in 0..CORRECTIONS {
            let (mut jacobian, error) = self.linear(&joints);
            self.replace(&mut jacobian, &Vector6::zeros());
            let step = solve(&jacobian, &error, 0.0)?;
            last = step.amax();
            if last > STEP_MAX {
                return None;
            }
            for (position, step) in joints.0.iter_mut().zip(step.iter()) {
                *position += step;
            }
            if last <= STEP_LEAST {
                break;
            }
        }
        if last > STEP_LAST {
            return None;
        }
        let (mut jacobian, error) = self.linear(&joints);
        self.replace(&mut jacobian, &error);
        Some(Sample { joints, led, value: determinant(&jacobian), slope: 0.0 })
    }

    /// The same with the slope there.
    fn sloped(&self, near: &JointPos<N>, led: f64) -> Option<Sample<N>> {
        let sample = self.sample(near, led)?;
        let beside = self.sample(&sample.joints, led + BESIDE)?;
        Some(Sample { slope: (beside.value - sample.value) / BESIDE, ..sample })
    }

    /// The Jacobian, without the joints that stand, and the error.
    fn linear(&self, joints: &JointPos<N>) -> (SMatrix<f64, 6, N>, Vector6<f64>) {
        let (flange, mut jacobian) = self.arm.jacobian(joints);
        for column in jacobian.data.0.iter_mut().take(N.saturating_sub(6)) {
            *column = [0.0; 6];
        }
        (jacobian, between(&flange, self.goal))
    }

    fn replace(&self, jacobian: &mut SMatrix<f64, 6, N>, by: &Vector6<f64>) {
        if let Some(column) = jacobian.data.0.get_mut(self.joint) {
            *column = by.data.0[0];
        }
    }

    /// Close to the zero between two samples of different sign: false position, the older end's value halved (Illinois).
    fn zero(&self, a: &Sample<N>, b: &Sample<N>, known: Option<f64>) -> Sample<N> {
        let (mut old, mut new) = (*a, *b);
        let (mut old_value, mut new_value) = (a.value, b.value);
        for _ in 0..REFINEMENTS {
            let led = (old.led * new_value - new.led * old_value) / (new_value - old_value);
            let next = self.sample(&new.joints, led).map(|next| next.without(known));
            let Some(next) = next.filter(|next| next.value != 0.0) else { break };
            if (next.value < 0.0) == (new_value < 0.0) {
                old_value *= 0.5;
            } else {
                (old, old_value) = (new, new_value);
            }
            (new, new_value) = (next, next.value);
            if libm::fabs(new.led - old.led) <= 1e-9 {
                break;
            }
        }
        new
    }

    /// The zeros between two samples of one sign, if the value turns between them and comes to the other sign or nearly so.
    fn turn(&self, a: &Sample<N>, b: &Sample<N>, known: Option<f64>, found: &mut impl FnMut(&JointPos<N>)) {
        // Towards zero at one end, away from it at the other.
        let falls = |sample: &Sample<N>, ahead: f64| sample.value * sample.slope * ahead < 0.0;
        let (mut a, mut b) = (*a, *b);
        if !(falls(&a, b.led - a.led) && falls(&b, a.led - b.led)) {
            return;
        }
        for narrowing in 0..NARROWINGS {
            // By the slopes, and every third time by halves, so that both ends move.
            let share = if narrowing % 3 == 2 { 0.5 } else { a.slope / (a.slope - b.slope) };
            let led = a.led + (b.led - a.led) * share.clamp(0.01, 0.99);
            let Some(next) = self.sloped(&a.joints, led).map(|next| next.without(known)) else { break };
            if (next.value < 0.0) != (a.value < 0.0) {
                found(&self.zero(&a, &next, known).joints);
                found(&self.zero(&b, &next, known).joints);
                return;
            }
            if falls(&next, b.led - next.led) {
                a = next;
            } else {
                b = next;
            }
            if libm::fabs(b.led - a.led) <= LED_LEAST {
                break;
            }
        }
        let lower = if libm::fabs(a.value) < libm::fabs(b.value) { a } else { b };
        found(&lower.joints);
    }
}
