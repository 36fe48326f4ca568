//! What became of each of the robot's cycles, told by its own time stamps and by its echo of the setpoints' numbers.
//!
//! Counting begins with the state that first shows a setpoint's arrival, and pauses while none are sent. From then on each cycle is
//! one of four, so that their sum is the time by the robot's stamps, in cycles:
//!
//! * *skipped*: no state came of it; the next one's stamp is more than a period on.
//! * *sent*: its state shows another setpoint than the one before: an answer of its own had arrived.
//! * *stalled*: it shows the same as before, and this machine is known to have missed a slot for it.
//! * *doubled*: it shows the same as before though every state was answered: an answer came late, or two together.

/// The count.
#[derive(Clone, Copy, Debug)]
pub struct CycleCount {
    /// Cycles a second by the robot's clock.
    rate: f64,
    /// Number of the first setpoint since the count paused.
    first: Option<u32>,
    /// Whether its arrival has been seen.
    begun: bool,
    /// Time stamp (s) and echoed number of the last state.
    last: Option<(f64, u32)>,
    /// Cycles without a new setpoint whose cause is not known yet.
    stale: u64,
    /// Slots that were missed and have not shown as such a cycle yet.
    owed: u64,
    counts: Counts,
}

/// Robot cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// With a new setpoint.
    pub sent: u64,
    /// Without, though each state was answered.
    pub doubled: u64,
    /// Of which no state came.
    pub skipped: u64,
    /// Without a new setpoint because this machine missed a slot.
    pub stalled: u64,
}

impl CycleCount {
    /// For a robot of so many cycles a second.
    pub const fn new(rate_hz: u32) -> Self {
        let counts = Counts { sent: 0, doubled: 0, skipped: 0, stalled: 0 };
        Self { rate: rate_hz as f64, first: None, begun: false, last: None, stale: 0, owed: 0, counts }
    }

    /// A state came, also one that is overtaken before it is looked at: its time stamp (s), and the number of the setpoint that had
    /// arrived. A wire that does not tell which has, gives the number that left last: then what leaves counts as arrived.
    pub fn state(&mut self, timestamp: f64, arrived: u32) {
        let before = self.last.replace((timestamp, arrived));
        let Some(first) = self.first else { return };
        if !self.begun {
            // Half the numbers are later than a number, half are earlier.
            self.begun = arrived.wrapping_sub(first) < u32::MAX / 2;
            self.counts.sent += u64::from(self.begun);
            return;
        }
        let Some((then, newest)) = before else { return };
        // Plausible by now: the stamps grow, by ten seconds at most.
        let gap = (((timestamp - then) * self.rate).round() as u64).saturating_sub(1);
        self.counts.skipped += gap;
        // What was missed in a cycle that nobody saw is not missed in another one.
        self.owed = self.owed.saturating_sub(gap);
        if arrived == newest {
            self.stale += 1;
        } else {
            self.counts.sent += 1;
        }
    }

    /// A state is answered, and this machine missed so many slots before it: what has been seen until now can be told apart.
    pub fn answered(&mut self, missed: u32) {
        if self.first.is_some() {
            self.owed += u64::from(missed);
        }
        let stalled = self.stale.min(self.owed);
        self.owed -= stalled;
        self.counts.stalled += stalled;
        self.counts.doubled += self.stale - stalled;
        self.stale = 0;
    }

    /// A setpoint of this number leaves.
    pub fn leaves(&mut self, seq: u32) {
        self.first.get_or_insert(seq);
    }

    /// None is sent now: cycles without a new one are as they should be.
    pub fn pause(&mut self) {
        self.answered(0);
        *self = Self { last: self.last, counts: self.counts, ..Self::new(self.rate as u32) };
    }

    /// For a fresh connection, whose robot may have begun its time anew.
    pub fn restart(&mut self) {
        self.answered(0);
        *self = Self { counts: self.counts, ..Self::new(self.rate as u32) };
    }

    /// Since the client was made.
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feeds states (time in cycles, echoed number) and slots missed before each answer.
    fn count(states: &[(u32, u32, u32)]) -> Counts {
        let mut count = CycleCount::new(500);
        for (index, &(cycle, arrived, missed)) in states.iter().enumerate() {
            count.state(41.0 + f64::from(cycle) * 0.002, arrived);
            count.answered(missed);
            count.leaves(index as u32 + 1);
        }
        *count.counts()
    }

    #[test]
    fn each_cycle_from_the_first_arrival_on_is_one_of_four() {
        // Nothing is counted before the first arrival, in cycle 1; each state is answered, and the answer seen in the next.
        let even: Vec<_> = (0..100).map(|k| (k, k, 0)).collect();
        assert_eq!(count(&even), Counts { sent: 99, ..Counts::default() });
        // Two cycles are not told of: their setpoint is not missing.
        let gap: Vec<_> = (0..100).map(|k| (k + if k >= 50 { 2 } else { 0 }, k, 0)).collect();
        assert_eq!(count(&gap), Counts { sent: 99, skipped: 2, ..Counts::default() });
        // An answer comes a cycle late, together with the next.
        let late: Vec<_> = (0..100).map(|k| (k, if k == 50 { 49 } else { k }, 0)).collect();
        assert_eq!(count(&late), Counts { sent: 98, doubled: 1, ..Counts::default() });
    }

    #[test]
    fn what_this_machine_missed_is_stalled_whether_it_shows_before_or_after_the_slot_is_known_to_be_missed() {
        let mut count = CycleCount::new(500);
        let mut time = 41.0;
        let mut state = |count: &mut CycleCount, arrived| {
            time += 0.002;
            count.state(time, arrived);
        };
        count.leaves(1);
        for k in 1..=10 {
            state(&mut count, k);
            count.answered(0);
        }
        // Three states at once, of which the newest is answered: all of them show the setpoint that was there.
        for _ in 0..3 {
            state(&mut count, 10);
        }
        count.answered(2);
        // The slot of the first of them was answered late, so the third shows it by its own slot, missed later.
        assert_eq!(*count.counts(), Counts { sent: 10, doubled: 1, stalled: 2, skipped: 0 });
        // On a line whose round trip takes longer than a cycle it shows later.
        count.answered(1);
        state(&mut count, 11);
        count.answered(0);
        state(&mut count, 11);
        count.answered(0);
        assert_eq!(*count.counts(), Counts { sent: 11, doubled: 1, stalled: 3, skipped: 0 });
        // A missed slot whose cycle was skipped does not explain a doubled one.
        count.answered(1);
        time += 0.002;
        count.state(time + 0.002, 12);
        count.answered(0);
        count.state(time + 0.004, 12);
        count.answered(0);
        assert_eq!(*count.counts(), Counts { sent: 12, doubled: 2, stalled: 3, skipped: 1 });
    }

    #[test]
    fn a_wire_without_an_echo_gives_what_left_last_and_each_cycle_is_one_of_four() {
        let mut count = CycleCount::new(250);
        let mut left = 0;
        for cycle in 0..100_u32 {
            count.state(41.0 + 0.004 * f64::from(cycle), left);
            // One in ten is not answered in time: the next answer says so.
            if cycle % 10 != 5 {
                count.answered(u32::from(cycle % 10 == 6));
                left += 1;
                count.leaves(left);
            }
        }
        assert_eq!(*count.counts(), Counts { sent: 89, stalled: 10, ..Counts::default() });
    }

    #[test]
    fn nothing_is_counted_while_nothing_is_sent_and_a_fresh_connection_goes_on() {
        let mut count = CycleCount::new(125);
        for k in 0..50 {
            count.state(41.0 + 0.008 * f64::from(k), 0);
            count.answered(0);
        }
        assert_eq!(*count.counts(), Counts::default());
        count.leaves(7);
        for (k, arrived) in [(50, 0), (51, 7), (52, 8)] {
            count.state(41.0 + 0.008 * f64::from(k), arrived);
        }
        count.pause();
        count.state(50.0, 9);
        assert_eq!(count.counts().sent, 2);
        // The numbers wrap around.
        count.leaves(u32::MAX);
        for (time, arrived) in [(50.008, u32::MAX - 1), (50.016, u32::MAX), (50.024, 0)] {
            count.state(time, arrived);
        }
        assert_eq!(count.counts().sent, 4);
        count.restart();
        count.leaves(1);
        count.state(41.0, 0);
        count.state(41.008, 1);
        assert_eq!(*count.counts(), Counts { sent: 5, ..Counts::default() });
    }
}
