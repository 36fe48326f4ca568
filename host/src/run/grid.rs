//! The timer's grid: points of time a period apart. What comes late stays on the grid and is not made up for.

/// Where on the grid a loop stands. Times are nanoseconds of one clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    period: u64,
    due: u64,
}

/// A wake-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// When it was due.
    pub due: u64,
    /// How late it is.
    pub late: u64,
    /// Points behind it that had passed by then: they are left out.
    pub missed: u64,
}

impl Grid {
    /// A grid of `period` ns, above 0, whose first point lies a period after `now`.
    pub const fn new(period: u64, now: u64) -> Self {
        Self { period, due: now.saturating_add(period) }
    }

    /// The next point.
    pub const fn due(&self) -> u64 {
        self.due
    }

    /// Woken at `now` for the next point: the one after it is the first of the grid still to come.
    pub const fn wake(&mut self, now: u64) -> Slot {
        let due = self.due;
        let late = now.saturating_sub(due);
        let missed = late / self.period;
        self.due = due.saturating_add(self.period.saturating_mul(1 + missed));
        Slot { due, late, missed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_wake_ups_stay_on_the_grid_and_leave_out_what_has_passed() {
        let mut grid = Grid::new(1000, 5000);
        assert_eq!(grid.wake(6003), Slot { due: 6000, late: 3, missed: 0 });
        assert_eq!((grid.due(), grid.wake(7999)), (7000, Slot { due: 7000, late: 999, missed: 0 }));
        // Due at 8000, woken at 11,200: 9000, 10,000 and 11,000 have passed.
        assert_eq!(grid.wake(11_200), Slot { due: 8000, late: 3200, missed: 3 });
        assert_eq!(grid.due(), 12_000);
        // A clock that is early does not move the grid.
        assert_eq!(grid.wake(11_999), Slot { due: 12_000, late: 0, missed: 0 });
        assert_eq!(grid.due(), 13_000);
    }
}
