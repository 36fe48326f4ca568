//! A change of speed by hyperbolic tangent, its ends eased so that acceleration begins and ends at zero.
//!
//! From v₀ up to v₁ with the acceleration limit A and the jerk limit J, in four parts:
//! 1. the acceleration rises linearly to a = min(A, √(J·(v₁ − v₀)/2)) within a/J;
//! 2. it stays there while the speed rises to v₁ − W; a softness of 1 leaves this part out;
//! 3. v = v₁ − W + W·tanh(t/τ) with τ = W/a, so that the acceleration goes on from a as a·sech²(t/τ); this is the paper's
//!    ramp (see [`super`]). Its greatest jerk is 4/(3√3)·a²/W, so that J gives the least W. Distance:
//!    (v₁ − W)·t + W·τ·ln cosh(t/τ);
//! 4. at tanh = θ the acceleration left falls linearly to zero within 2τ/(1 + θ), which lands on v₁: the speed still
//!    missing, W(1 − θ), is half of that time by a(1 − θ²).
//!
//! The softness is the share that W takes of the speed left after part 1: at 1 the ramp is the paper's, at 0 nearly one of
//! constant acceleration, as quick as the limits let it be.

use super::State;

/// θ: where the tangent ends and the acceleration left falls linearly.
const CUT: f64 = 0.99;
/// artanh θ.
const CUT_TIME: f64 = 2.646_652_412_362_245_7;
/// ln cosh artanh θ.
const CUT_DISTANCE: f64 = 1.958_517_773_625_844_3;
/// 4/(3√3), the greatest value of 2·sech²·tanh.
const BEND: f64 = 0.769_800_358_919_501_1;

/// A rise of the speed from one value to a higher one. Played backwards it is the fall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    slow: f64,
    acceleration: f64,
    jerk: f64,
    /// W (m/s).
    rise: f64,
    /// τ (s).
    tau: f64,
    /// Speeds at the beginnings of the four parts (m/s).
    speeds: [f64; 4],
    /// Durations of the four parts (s).
    times: [f64; 4],
    /// Distances of the four parts (m).
    distances: [f64; 4],
}

impl Ramp {
    /// The rise from `slow` to `fast` (m/s), `softness` in [0, 1]; no time and no distance when `fast` is not above `slow`.
    pub fn new(slow: f64, fast: f64, acceleration_max: f64, jerk_max: f64, softness: f64) -> Self {
        if fast <= slow {
            let (nothing, speeds) = ([0.0; 4], [slow; 4]);
            let (acceleration, rise, tau) = (0.0, 0.0, 1.0);
            return Self { slow, acceleration, jerk: jerk_max, rise, tau, speeds, times: nothing, distances: nothing };
        }
        let a = acceleration_max.min((0.5 * jerk_max * (fast - slow)).sqrt());
        let easing = a / jerk_max;
        let eased = slow + 0.5 * a * easing;
        let rise = (softness * (fast - eased)).max(BEND * a * easing);
        let bent = fast - rise;
        let hold = (bent - eased).max(0.0) / a;
        let tau = rise / a;
        let landing = 2.0 * tau / (1.0 + CUT);
        let cut = bent + rise * CUT;
        let left = a * (1.0 - CUT * CUT);
        Self {
            slow,
            acceleration: a,
            jerk: jerk_max,
            rise,
            tau,
            speeds: [slow, eased, bent, cut],
            times: [easing, hold, tau * CUT_TIME, landing],
            distances: [
                (slow + a * easing / 6.0) * easing,
                (eased + 0.5 * a * hold) * hold,
                (bent * CUT_TIME + rise * CUT_DISTANCE) * tau,
                (cut + left * landing / 3.0) * landing,
            ],
        }
    }

    /// How long it takes (s).
    pub fn duration(&self) -> f64 {
        self.times.iter().sum()
    }

    /// How far it goes (m).
    pub fn distance(&self) -> f64 {
        self.distances.iter().sum()
    }

    /// The lower of its two speeds (m/s).
    pub fn slow(&self) -> f64 {
        self.slow
    }

    /// The state `t` seconds after the beginning, t in [0, duration].
    pub fn state_at(&self, t: f64) -> State {
        let [easing, hold, bend, landing] = self.times;
        let [eased, held, bent, _] = self.distances;
        let [slow, fast_enough, bending, cut] = self.speeds;
        let a = self.acceleration;
        if t < easing {
            let half = 0.5 * self.jerk * t * t;
            return State { s: (slow + half / 3.0) * t, velocity: slow + half, acceleration: self.jerk * t };
        }
        let t = t - easing;
        if t < hold {
            let velocity = fast_enough + a * t;
            return State { s: eased + 0.5 * (fast_enough + velocity) * t, velocity, acceleration: a };
        }
        let t = t - hold;
        if t < bend {
            let x = t / self.tau;
            let tanh = libm::tanh(x);
            let s = eased + held + bending * t + self.rise * self.tau * libm::log(libm::cosh(x));
            return State { s, velocity: bending + self.rise * tanh, acceleration: a * (1.0 - tanh * tanh) };
        }
        let (t, left) = ((t - bend).min(landing), a * (1.0 - CUT * CUT));
        let slope = if landing > 0.0 { left / landing } else { 0.0 };
        State {
            s: eased + held + bent + (cut + (0.5 * left - slope * t / 6.0) * t) * t,
            velocity: cut + (left - 0.5 * slope * t) * t,
            acceleration: left - slope * t,
        }
    }
}
