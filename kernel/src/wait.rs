//! When the path waits for its correction: no material is laid where the base is not known, nor where the correction has still to
//! catch up.
//!
//! While the tracker is not to be trusted the correction ramps out, and back again afterwards; what is laid down meanwhile would be
//! off by all that the base has moved. So the path clock comes to rest, on the path, and goes on by itself when the correction has
//! caught up. The flow follows the clock. Where no material is laid, nothing waits.
//!
//! The clock needs [`STOP_TIME`] to come to rest. So it begins that much before trust ends, though not before half of the hold is
//! over, as most breaks of a beam are short: with a hold of twice that time or more, the path rests when trust ends.

use crate::clock::{RATE_CURVATURE_MAX, RATE_SLOPE_MAX};
use crate::control::Bound;
use crate::fault::Fault;

/// From full rate to rest (s).
pub const STOP_TIME: f64 = 1.0 / RATE_SLOPE_MAX + RATE_SLOPE_MAX / RATE_CURVATURE_MAX;

/// A correction that is farther behind than this (m, rad) is waited for.
pub const BEHIND_MAX: f64 = 1e-3;

/// And until it is no farther behind than this.
pub const CAUGHT_UP: f64 = 3e-4;

/// What decides at a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// How old the last pose is that was believed (s); none while the base is not trusted.
    pub age: Option<f64>,
    /// For how long the base is trusted after it (s).
    pub hold: f64,
    /// How far the tool's correction is behind the base (m), and how far behind its turn (rad).
    pub behind: [f64; 2],
}

/// Whether the path waits, and for how long it has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wait {
    waits: bool,
    /// Without trust (s).
    lost: f64,
    /// With trust, for a correction (s).
    late: f64,
}

impl Wait {
    /// Whether the path waits at this tick, `period` s after the last.
    ///
    /// # Errors
    /// [`Fault::Tracker`], [`Fault::Saturated`]: it has waited for longer than `patience` (s).
    pub fn step(&mut self, sight: &Sight, patience: f64, period: f64) -> Result<bool, Fault> {
        let old = (0.5 * sight.hold).max(sight.hold - STOP_TIME);
        let limit = if self.waits { CAUGHT_UP } else { BEHIND_MAX };
        let [shift, turn] = sight.behind;
        self.waits = sight.age.is_none_or(|age| age > old) || shift > limit || turn > limit;
        (self.lost, self.late) = match sight.age {
            _ if !self.waits => (0.0, 0.0),
            None => (self.lost + period, 0.0),
            Some(_) => (0.0, self.late + period),
        };
        if self.lost > patience {
            return Err(Fault::Tracker { value: self.lost, limit: patience });
        }
        if self.late > patience {
            return Err(Fault::Saturated { bound: Bound::Speed, value: self.late, limit: patience });
        }
        Ok(self.waits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const H: f64 = 0.002;

    /// Of so many ticks with this, in how many the path waited, and what ended them.
    fn run(wait: &mut Wait, ticks: u32, sight: &Sight) -> (u32, Option<Fault>) {
        let mut waited = 0;
        for _ in 0..ticks {
            match wait.step(sight, 1.0, H) {
                Ok(waits) => waited += u32::from(waits),
                Err(fault) => return (waited, Some(fault)),
            }
        }
        (waited, None)
    }

    #[test]
    fn it_waits_in_time_to_stand_when_trust_ends_and_until_the_correction_has_caught_up() {
        let mut wait = Wait::default();
        let known = Sight { age: Some(0.0), hold: 3.0, behind: [0.9e-3, 0.0] };
        assert_eq!(run(&mut wait, 100, &known), (0, None));
        // 3 s less the 0.92 s to come to rest.
        assert_eq!(run(&mut wait, 1, &Sight { age: Some(2.08), ..known }), (0, None));
        assert_eq!(run(&mut wait, 1, &Sight { age: Some(2.09), ..known }), (1, None));
        // A short hold: half of it.
        let short = Sight { hold: 0.5, behind: [0.0; 2], ..known };
        assert_eq!(run(&mut Wait::default(), 1, &Sight { age: Some(0.24), ..short }), (0, None));
        assert_eq!(run(&mut Wait::default(), 1, &Sight { age: Some(0.26), ..short }), (1, None));
        assert_eq!(run(&mut wait, 400, &Sight { age: None, ..known }), (400, None));
        // Back again, and still behind in the one or the other.
        assert_eq!(run(&mut wait, 100, &Sight { behind: [4e-4, 0.0], ..known }), (100, None));
        assert_eq!(run(&mut wait, 100, &Sight { behind: [0.0, 4e-4], ..known }), (100, None));
        assert_eq!(run(&mut wait, 100, &Sight { behind: [2e-4; 2], ..known }), (0, None));
        assert_eq!(run(&mut wait, 100, &Sight { behind: [0.0, 1.1e-3], ..known }), (100, None));
    }

    #[test]
    fn patience_ends_for_a_tracker_and_for_a_correction_each_for_itself() {
        let lost = Sight { age: None, hold: 0.5, behind: [0.0; 2] };
        let late = Sight { age: Some(0.0), hold: 0.5, behind: [2e-3, 0.0] };
        let (waited, fault) = run(&mut Wait::default(), 2000, &lost);
        assert!((499..=501).contains(&waited), "{waited}");
        assert!(matches!(fault, Some(Fault::Tracker { limit: 1.0, .. })), "{fault:?}");
        let (waited, fault) = run(&mut Wait::default(), 2000, &late);
        assert!((499..=501).contains(&waited), "{waited}");
        assert!(matches!(fault, Some(Fault::Saturated { bound: Bound::Speed, .. })), "{fault:?}");
        let mut wait = Wait::default();
        for _ in 0..10 {
            assert_eq!(run(&mut wait, 300, &lost), (300, None));
            assert_eq!(run(&mut wait, 300, &late), (300, None));
        }
    }
}
