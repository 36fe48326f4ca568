//! A change of speed by hyperbolic tangent, its ends eased so that acceleration begins and ends at zero.
//!
//! From v₀ up to v₁ with the acceleration limit A and the jerk limit J, in three parts:
//! 1. the acceleration rises linearly to a = min(A, √(J·(v₁ − v₀)/2)) within a/J;
//! 2. v = vᵢ + W·tanh(t/τ), where vᵢ is the speed reached, W = v₁ − vᵢ and τ = W/a, so that the acceleration goes on from a
//!    as a·sech²(t/τ); this part is the paper's ramp (see [`super`]). Its greatest jerk, 4/(3√3)·a²/W, is at most 0.52·J by
//!    the choice of a. Distance: vᵢ·t + W·τ·ln cosh(t/τ);
//! 3. at tanh = θ the acceleration left falls linearly to zero within 2τ/(1 + θ), which lands on v₁: the speed still
//!    missing, W(1 − θ), is half of that time by a(1 − θ²).

use super::State;

/// θ: where the tangent ends and the acceleration left falls linearly.
const CUT: f64 = 0.99;
/// artanh θ.
const CUT_TIME: f64 = 2.646_652_412_362_245_7;
/// ln cosh artanh θ.
const CUT_DISTANCE: f64 = 1.958_517_773_625_844_3;

/// A rise of the speed from one value to a higher one. Played backwards it is the fall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    slow: f64,
    acceleration: f64,
    jerk: f64,
    /// Speed after part 1 (m/s).
    eased: f64,
    /// W (m/s).
    rise: f64,
    /// τ (s).
    tau: f64,
    /// Durations of the three parts (s).
    times: [f64; 3],
    /// Distances of the three parts (m).
    distances: [f64; 3],
}

impl Ramp {
    /// The rise from `slow` to `fast` (m/s); no time and no distance when `fast` is not above `slow`.
    pub fn new(slow: f64, fast: f64, acceleration_max: f64, jerk_max: f64) -> Self {
        if fast <= slow {
            let nothing = [0.0; 3];
            let (acceleration, jerk, tau) = (0.0, jerk_max, 1.0);
            return Self { slow, acceleration, jerk, eased: slow, rise: 0.0, tau, times: nothing, distances: nothing };
        }
        let acceleration = acceleration_max.min((0.5 * jerk_max * (fast - slow)).sqrt());
        let easing = acceleration / jerk_max;
        let eased = slow + 0.5 * acceleration * easing;
        let rise = fast - eased;
        let tau = rise / acceleration;
        let landing = 2.0 * tau / (1.0 + CUT);
        let left = acceleration * (1.0 - CUT * CUT);
        Self {
            slow,
            acceleration,
            jerk: jerk_max,
            eased,
            rise,
            tau,
            times: [easing, tau * CUT_TIME, landing],
            distances: [
                (slow + acceleration * easing / 6.0) * easing,
                (eased * CUT_TIME + rise * CUT_DISTANCE) * tau,
                (eased + rise * CUT + left * landing / 3.0) * landing,
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
        let [easing, bend, landing] = self.times;
        if t < easing {
            let half = 0.5 * self.jerk * t * t;
            return State { s: (self.slow + half / 3.0) * t, velocity: self.slow + half, acceleration: self.jerk * t };
        }
        let t = t - easing;
        if t < bend {
            let x = t / self.tau;
            let tanh = libm::tanh(x);
            return State {
                s: self.distances[0] + self.eased * t + self.rise * self.tau * libm::log(libm::cosh(x)),
                velocity: self.eased + self.rise * tanh,
                acceleration: self.acceleration * (1.0 - tanh * tanh),
            };
        }
        // Counted from the landing, where the acceleration is zero.
        let left = (landing - (t - bend)).max(0.0);
        let fast = self.eased + self.rise;
        let slope = if landing > 0.0 { self.acceleration * (1.0 - CUT * CUT) / landing } else { 0.0 };
        State {
            s: self.distance() - (fast - slope * left * left / 6.0) * left,
            velocity: fast - 0.5 * slope * left * left,
            acceleration: slope * left,
        }
    }
}
