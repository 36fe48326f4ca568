//! A value that goes to a target under a bound on its slope and on how fast the slope changes: the path clock's rate, and a
//! correction on its way out.

/// Value and slope at one tick. Between ticks the slope runs straight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    /// The value.
    pub value: f64,
    /// Its slope (1/s).
    pub slope: f64,
}

/// The bounds of a [`Ramp`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RampLimits {
    /// Largest slope (1/s).
    pub slope_max: f64,
    /// Largest change of the slope (1/s²).
    pub curvature_max: f64,
}

impl Ramp {
    /// At rest.
    pub const fn at(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }

    /// One period towards `target`, as fast as the bounds allow, and exactly onto it. Returns the mean over the period.
    ///
    /// The target is only passed when it has been set nearer than the slope under way can be braken; then by just that much.
    ///
    /// With the slope running straight from s to s', and c the largest change of it in a period h, the value moves by
    /// (s + s')·h/2. Braking from s' in steps of c, the last one shorter, takes n = ⌈s'/c⌉ periods, and the value moves
    /// (n·s' − c·n(n−1)/2)·h beyond s·h/2 in all. The new slope is the largest for which this is not more than is left; so
    /// every later step is exactly c, and the last lands on the target with slope zero. (This is the discrete time-optimal
    /// control of a double integrator, e.g. Han, "From PID to Active Disturbance Rejection Control", 2009, with the slope's
    /// trapezoid in place of a step.)
    pub fn step(&mut self, target: f64, limits: &RampLimits, period: f64) -> f64 {
        let Self { value, slope } = *self;
        let change = limits.curvature_max * period;
        let ahead = target - value - 0.5 * slope * period;
        let wanted = brakable(libm::fabs(ahead), change, period);
        let wanted = libm::copysign(wanted.min(limits.slope_max), ahead);
        self.slope = slope + (wanted - slope).max(-change).min(change);
        self.value = value + 0.5 * (slope + self.slope) * period;
        if libm::fabs(target - self.value) < ROUNDING && libm::fabs(self.slope) * period < ROUNDING {
            *self = Self::at(target);
        }
        value + period * (slope / 3.0 + self.slope / 6.0)
    }
}

/// The largest slope from which `distance` is enough to brake in steps of `change`, one a period, the last one shorter, when
/// the slope of a period moves the value by slope · period: see [`Ramp::step`].
pub(crate) fn brakable(distance: f64, change: f64, period: f64) -> f64 {
    // n(n+1)/2 ≥ distance/(c·h): how many steps of braking fit.
    let steps = libm::ceil(0.5 * (libm::sqrt(1.0 + 8.0 * distance / (change * period)) - 1.0)).max(1.0);
    (distance / period + 0.5 * change * steps * (steps - 1.0)) / steps
}

/// Nearer than this to the target, all that is left is rounding.
const ROUNDING: f64 = 1e-13;

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: RampLimits = RampLimits { slope_max: 1.5, curvature_max: 6.0 };

    #[test]
    fn it_keeps_its_bounds_and_lands_exactly_whatever_the_targets_are() {
        let mut seed = 7_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / (1_u64 << 31) as f64
        };
        for period in [0.001, 0.002, 0.008] {
            let mut ramp = Ramp::at(0.0);
            for _ in 0..3000 {
                let target = [0.0, 1.0, random()][(random() * 3.0) as usize];
                // Where the ramp comes to rest if braken from now on is where passing the target ends.
                let braking = |ramp: &Ramp| ramp.slope * libm::fabs(ramp.slope) / (2.0 * LIMITS.curvature_max);
                let rest = ramp.value + braking(&ramp);
                let slack = LIMITS.curvature_max * period * period;
                let (low, high) = (target.min(ramp.value).min(rest) - slack, target.max(ramp.value).max(rest) + slack);
                let steps = if random() < 0.5 { 2000 } else { (random() * 200.0) as usize };
                for _ in 0..steps {
                    let before = ramp;
                    let mean = ramp.step(target, &LIMITS, period);
                    assert!(libm::fabs(ramp.slope) <= LIMITS.slope_max);
                    assert!(libm::fabs(ramp.slope - before.slope) <= LIMITS.curvature_max * period * 1.000_001);
                    let moved = 0.5 * (before.slope + ramp.slope) * period;
                    assert!(libm::fabs(ramp.value - before.value - moved) < 1e-12);
                    assert!((low..=high).contains(&ramp.value), "{ramp:?} to {target}, from {low} to {high}");
                    assert!((-1e-12..=1.0 + 1e-12).contains(&ramp.value), "left 0 to 1: {ramp:?}");
                    assert!(
                        mean >= before.value.min(ramp.value) - slack && mean <= before.value.max(ramp.value) + slack
                    );
                }
                if steps == 2000 {
                    assert_eq!(ramp, Ramp::at(target));
                }
            }
        }
    }

    #[test]
    fn from_full_to_rest_takes_the_time_of_the_continuous_optimum() {
        let (mut ramp, mut ticks) = (Ramp::at(1.0), 0);
        while ramp != Ramp::at(0.0) {
            ramp.step(0.0, &LIMITS, 0.001);
            ticks += 1;
        }
        // v/a + a/j = 1/1.5 + 1.5/6 = 0.9167 s.
        assert!((916..=919).contains(&ticks), "{ticks}");
    }
}
