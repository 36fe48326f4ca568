//! The last samples of a signal, to be looked at some time ago.

use crate::units::JointPos;

/// The last `LEN` samples, one a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay<const N: usize, const LEN: usize> {
    samples: [JointPos<N>; LEN],
    /// Where the newest is.
    newest: usize,
}

impl<const N: usize, const LEN: usize> Delay<N, LEN> {
    /// There since long.
    pub const fn at_rest(at: JointPos<N>) -> Self {
        const { assert!(LEN > 1) };
        Self { samples: [at; LEN], newest: 0 }
    }

    /// Takes the next sample.
    pub fn push(&mut self, joints: &JointPos<N>) {
        self.newest = self.newest.wrapping_add(1) % LEN;
        if let Some(slot) = self.samples.get_mut(self.newest) {
            *slot = *joints;
        }
    }

    /// The signal so many ticks before the newest sample, on the straight line between two samples. Before the oldest it was
    /// where the oldest is; whoever configures a delay makes sure that it is at most LEN − 1.
    pub fn before(&self, ticks: f64) -> JointPos<N> {
        let ticks = ticks.max(0.0).min((LEN - 1) as f64);
        // Not negative and below LEN: exact.
        let whole = ticks as usize;
        let part = ticks - whole as f64;
        let at = |back: usize| self.samples.get(self.newest.wrapping_add(LEN).wrapping_sub(back) % LEN);
        let mut joints = at(whole).copied().unwrap_or(JointPos::ZERO);
        // Behind the oldest comes the newest, with no part in the sum.
        if let Some(older) = at(whole.wrapping_add(1)) {
            for (joint, older) in joints.0.iter_mut().zip(&older.0) {
                *joint += part * (older - *joint);
            }
        }
        joints
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_is_found_again_between_samples_too() {
        let mut delay = Delay::<1, 5>::at_rest(JointPos([-1.0]));
        assert_eq!(delay.before(3.7), JointPos([-1.0]));
        for k in 0..13 {
            delay.push(&JointPos([f64::from(k)]));
        }
        for (ticks, expected) in [(0.0, 12.0), (1.0, 11.0), (2.25, 9.75), (4.0, 8.0), (9.0, 8.0), (-1.0, 12.0)] {
            assert_eq!(delay.before(ticks), JointPos([expected]), "{ticks} ticks ago");
        }
    }
}
