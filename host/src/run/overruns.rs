//! Overruns: cycles that came too late, counted exactly, and when they are too many.
//!
//! A *slot* is a cycle of the robot that paces the loop, or a point of the timer's grid. A slot without an answer of its own is
//! *missed*. A run of missed slots, however long, is one *overrun*: one stall is one, and its slots are counted beside it.
//! Slots that were missed are not made up for.
//!
//! The *leaky counter* is OROCOS RTT's (`Activity`, periodic threads): one more for an overrun, one less for a good cycle, never
//! below 0; where it reaches its limit, the motion is stopped. So a stall now and then does no harm, however long it is;
//! overruns that come as often as good cycles do.

use screed_kernel::fault::Fault;

/// The count since the process started.
#[derive(Clone, Copy, Debug)]
pub struct Overruns {
    limit: u32,
    count: u64,
    slots: u64,
    level: u32,
    level_max: u32,
    /// Slots missed since the counter was last 0.
    recent: u32,
}

impl Overruns {
    /// Nothing has happened. The counter stops the motion at `limit`.
    pub const fn new(limit: u32) -> Self {
        Self { limit, count: 0, slots: 0, level: 0, level_max: 0, recent: 0 }
    }

    /// A cycle is made, `missed` slots after the one before. Gives the fault where the counter has reached its limit; it begins
    /// at 0 again then.
    pub fn cycle(&mut self, missed: u32) -> Option<Fault> {
        if missed == 0 {
            self.level = self.level.saturating_sub(1);
            if self.level == 0 {
                self.recent = 0;
            }
            return None;
        }
        self.count += 1;
        self.slots += u64::from(missed);
        self.recent = self.recent.saturating_add(missed);
        self.level += 1;
        self.level_max = self.level_max.max(self.level);
        if self.level < self.limit {
            return None;
        }
        self.level = 0;
        Some(Fault::Overrun { missed: std::mem::take(&mut self.recent), limit: self.limit })
    }

    /// Overruns.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// Slots missed in them.
    pub const fn slots(&self) -> u64 {
        self.slots
    }

    /// The leaky counter.
    pub const fn level(&self) -> u32 {
        self.level
    }

    /// The most that it has been.
    pub const fn level_max(&self) -> u32 {
        self.level_max
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_stall_is_one_overrun_with_its_slots_beside_it() {
        let mut overruns = Overruns::new(3);
        for missed in [0, 1, 0, 3, 0, 20, 0, 0] {
            assert_eq!(overruns.cycle(missed), None);
        }
        assert_eq!((overruns.count(), overruns.slots(), overruns.level(), overruns.level_max()), (3, 24, 0, 1));
    }

    #[test]
    fn the_counter_leaks_and_stops_at_its_limit() {
        let mut overruns = Overruns::new(3);
        // Up by one more than it leaks: 1 2 1 2, then 3.
        for (missed, level) in [(1, 1), (2, 2), (0, 1), (5, 2)] {
            assert_eq!((overruns.cycle(missed), overruns.level()), (None, level));
        }
        assert_eq!(overruns.cycle(4), Some(Fault::Overrun { missed: 12, limit: 3 }));
        assert_eq!((overruns.count(), overruns.slots(), overruns.level(), overruns.level_max()), (4, 12, 0, 3));
        // After it, it begins anew; what had leaked away is not told.
        assert_eq!((overruns.cycle(7), overruns.cycle(0)), (None, None));
        assert_eq!((overruns.cycle(1), overruns.cycle(1)), (None, None));
        assert_eq!(overruns.cycle(1), Some(Fault::Overrun { missed: 3, limit: 3 }));
        assert_eq!(Overruns::new(1).cycle(2), Some(Fault::Overrun { missed: 2, limit: 1 }));
    }
}
