//! The ring against a model that is a plain vector, under random operations (seeded).

mod common;

use common::Random;
use screed_kernel::ring::{Ring, RingError};
use screed_kernel::setpoint::Setpoint;
use screed_kernel::units::JointPos;

const CAP: usize = 64;

fn setpoint(mark: f64) -> Setpoint<1> {
    Setpoint { joints: JointPos([mark]), flow: 0.0, deposit: false }
}

/// The ring, and what it has to hold: sequence numbers, and a mark that no other setpoint has.
struct Twins {
    random: Random,
    ring: Ring<1, CAP>,
    model: Vec<(u32, f64)>,
    consumed: u32,
    mark: f64,
    replaced: usize,
    refused: usize,
}

impl Twins {
    fn new(seed: u64) -> Self {
        let (random, ring) = (Random(seed), Ring::new());
        Self { random, ring, model: Vec::new(), consumed: 0, mark: 0.0, replaced: 0, refused: 0 }
    }

    fn end(&self) -> u32 {
        self.model.last().map_or(self.consumed, |last| last.0)
    }

    fn clear(&mut self) {
        self.ring.clear();
        self.model.clear();
    }

    fn consume(&mut self) {
        let took = self.ring.consume();
        assert_eq!(took.map(|(seq, s)| (seq, s.joints.0[0])), self.model.first().copied());
        if !self.model.is_empty() {
            self.consumed = self.model.remove(0).0;
        }
    }

    /// Opens a batch somewhere: its first sequence number, unless it is refused as it has to be.
    fn stage(&mut self, after: Option<u32>) -> Option<u32> {
        let first = after.unwrap_or(self.end()) + 1;
        let opened = self.ring.stage(first, after);
        if opened == Err(RingError::Full) {
            assert_eq!(self.ring.credits(), 0);
            return None;
        }
        let expected = match after {
            Some(seq) if seq < self.consumed => Err(RingError::TooLate),
            Some(seq) if seq > self.end() => Err(RingError::Sequence),
            _ => Ok(()),
        };
        assert_eq!(opened, expected);
        opened.ok().map(|()| first)
    }

    fn batch(&mut self) {
        let after = match self.random.below(3) {
            0 => None,
            _ => Some((self.consumed + self.random.below(12) as u32).saturating_sub(2)),
        };
        let end = self.end();
        let Some(first) = self.stage(after) else { return };
        let count = 1 + self.random.below(20) as u32;
        let staged: Vec<_> = (0..count).map(|k| (first + k, self.mark + 1.0 + f64::from(k))).collect();
        self.mark += f64::from(count);
        let room = self.ring.credits() as usize;
        let fits = staged.iter().all(|&(_, mark)| self.ring.push(&setpoint(mark)).is_ok());
        assert_eq!(fits, staged.len() <= room);
        if !fits {
            self.refused += 1;
            assert_eq!(self.ring.commit(), Err(RingError::Sequence));
            return;
        }
        // The clock plays on while a batch comes in.
        for _ in 0..self.random.below(3) {
            self.consume();
        }
        let late = after.is_some_and(|seq| seq < self.consumed);
        assert_eq!(self.ring.commit(), if late { Err(RingError::TooLate) } else { Ok(()) });
        if !late {
            self.replaced += usize::from(after.is_some_and(|seq| seq < end));
            self.model.retain(|&(seq, _)| seq < first);
            self.model.extend(staged);
        }
    }

    fn agree(&self) {
        assert_eq!((self.ring.consumed(), self.ring.end_seq()), (self.consumed, self.end()));
        for &(seq, mark) in &self.model {
            assert_eq!(self.ring.get(seq).map(|s| s.joints.0[0]), Some(mark));
        }
        assert_eq!([self.consumed, self.end() + 1].map(|seq| self.ring.get(seq)), [None; 2]);
        if self.model.is_empty() {
            assert_eq!(self.ring.credits(), CAP as u32, "an empty ring gives all its room back");
        }
    }
}

#[test]
fn random_batches_replacements_and_consumption_match_a_vector() {
    for seed in 0..200 {
        let mut twins = Twins::new(seed);
        for _ in 0..2000 {
            match twins.random.below(500) {
                0 => twins.clear(),
                1..200 => twins.batch(),
                _ => twins.consume(),
            }
            twins.agree();
        }
        let Twins { replaced, refused, .. } = twins;
        assert!(
            replaced > 20 && refused > 0,
            "seed {seed}: {replaced} replaced, {refused} refused: the test missed its aim"
        );
    }
}
