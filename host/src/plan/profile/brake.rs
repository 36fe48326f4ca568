//! The quickest way to rest within an acceleration and a jerk limit.

use super::State;

/// A fall of the speed to zero: the acceleration goes linearly to −b, stays there, and goes linearly back to zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brake {
    velocity: f64,
    acceleration: f64,
    jerk: f64,
    /// Durations of the three parts (s).
    times: [f64; 3],
}

impl Brake {
    /// From `velocity` (m/s) and `acceleration` (m/s²) to rest; none when the deceleration under way is more than
    /// `deceleration_max`, or too much to end in time.
    pub fn new(velocity: f64, acceleration: f64, deceleration_max: f64, jerk_max: f64) -> Option<Self> {
        let already = 0.5 * acceleration * acceleration / jerk_max;
        if acceleration < 0.0 && (velocity < already || -acceleration > deceleration_max) {
            return None;
        }
        // The three parts take away −a₀²/(2J) + b²/(2J), b·hold and b²/(2J) of speed, a₀ being the acceleration now.
        let speed = velocity + already;
        let deceleration = deceleration_max.min((jerk_max * speed).sqrt());
        let hold = if deceleration > 0.0 { (speed / deceleration - deceleration / jerk_max).max(0.0) } else { 0.0 };
        let times = [(acceleration + deceleration).max(0.0) / jerk_max, hold, deceleration / jerk_max];
        Some(Self { velocity, acceleration, jerk: jerk_max, times })
    }

    /// How long it takes (s).
    pub fn duration(&self) -> f64 {
        self.times.iter().sum()
    }

    /// The state `t` seconds after the beginning, `s` counted from there; at rest when it is over.
    pub fn state_at(&self, t: f64) -> State {
        let mut state = State { s: 0.0, velocity: self.velocity, acceleration: self.acceleration };
        let mut left = t.clamp(0.0, self.duration());
        for (time, jerk) in self.times.into_iter().zip([-self.jerk, 0.0, self.jerk]) {
            let dt = left.min(time);
            state.s += (state.velocity + (0.5 * state.acceleration + jerk * dt / 6.0) * dt) * dt;
            state.velocity += (state.acceleration + 0.5 * jerk * dt) * dt;
            state.acceleration += jerk * dt;
            left -= dt;
        }
        if t >= self.duration() { State { velocity: 0.0, acceleration: 0.0, ..state } } else { state }
    }
}
