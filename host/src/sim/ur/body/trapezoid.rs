//! The speed of `movej` and `movel`.

/// Distance over time: speeds up, cruises, slows down, all at constant acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trapezoid {
    distance: f64,
    acceleration: f64,
    /// Until the cruise (s).
    ramp: f64,
    /// All of it (s).
    total: f64,
}

impl Trapezoid {
    /// Over the distance; a time above 0 overrides acceleration and speed: a third of it each for the ramps and the cruise.
    pub fn new(distance: f64, acceleration: f64, speed: f64, time: f64) -> Self {
        if distance <= 0.0 {
            return Self { distance: 0.0, acceleration: 1.0, ramp: 0.0, total: 0.0 };
        }
        let (acceleration, speed) =
            if time > 0.0 { (4.5 * distance / (time * time), 1.5 * distance / time) } else { (acceleration, speed) };
        let speed = speed.min((distance * acceleration).sqrt());
        let ramp = speed / acceleration;
        Self { distance, acceleration, ramp, total: distance / speed + ramp }
    }

    /// How much of the distance lies behind after a time, 0 to 1, and whether that is all.
    pub fn share(&self, elapsed: f64) -> (f64, bool) {
        if elapsed >= self.total || self.distance <= 0.0 {
            return (1.0, true);
        }
        let speed = self.acceleration * self.ramp;
        let rest = self.total - elapsed;
        let travelled = if elapsed < self.ramp {
            0.5 * self.acceleration * elapsed * elapsed
        } else if rest < self.ramp {
            self.distance - 0.5 * self.acceleration * rest * rest
        } else {
            0.5 * speed * self.ramp + speed * (elapsed - self.ramp)
        };
        (travelled / self.distance, false)
    }
}
