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

#[test]
fn random_batches_replacements_and_consumption_match_a_vector() {
    for seed in 0..200 {
        let mut random = Random(seed);
        let mut ring = Ring::<1, CAP>::new();
        let mut model: Vec<(u32, f64)> = Vec::new();
        let (mut consumed, mut mark, mut replaced, mut refused) = (0_u32, 0.0, 0, 0);
        for _ in 0..2000 {
            let end = model.last().map_or(consumed, |last| last.0);
            match random.below(5) {
                0 | 1 => {
                    let after = match random.below(3) {
                        0 => None,
                        _ => Some((consumed + random.below(12) as u32).saturating_sub(2)),
                    };
                    let first = after.unwrap_or(end) + 1;
                    let opened = ring.stage(first, after);
                    let expected = match after {
                        Some(seq) if seq < consumed => Err(RingError::TooLate),
                        Some(seq) if seq > end => Err(RingError::Sequence),
                        _ => Ok(()),
                    };
                    if opened == Err(RingError::Full) {
                        assert_eq!(ring.credits(), 0);
                        continue;
                    }
                    assert_eq!(opened, expected);
                    if opened.is_err() {
                        continue;
                    }
                    let staged: Vec<_> = (0..1 + random.below(20) as u32)
                        .map(|k| {
                            mark += 1.0;
                            (first + k, mark)
                        })
                        .collect();
                    let room = ring.credits() as usize;
                    let fits = staged.iter().all(|&(_, mark)| ring.push(&setpoint(mark)).is_ok());
                    assert_eq!(fits, staged.len() <= room);
                    if !fits {
                        refused += 1;
                        assert_eq!(ring.commit(), Err(RingError::Sequence));
                        continue;
                    }
                    // The clock plays on while a batch comes in.
                    for _ in 0..random.below(3) {
                        let took = ring.consume();
                        assert_eq!(took.map(|(seq, s)| (seq, s.joints.0[0])), (!model.is_empty()).then(|| model[0]));
                        if !model.is_empty() {
                            consumed = model.remove(0).0;
                        }
                    }
                    let late = after.is_some_and(|seq| seq < consumed);
                    assert_eq!(ring.commit(), if late { Err(RingError::TooLate) } else { Ok(()) });
                    if !late {
                        replaced += usize::from(after.is_some_and(|seq| seq < end));
                        model.retain(|&(seq, _)| seq < first);
                        model.extend(staged);
                    }
                }
                _ => {
                    let took = ring.consume();
                    assert_eq!(took.map(|(seq, s)| (seq, s.joints.0[0])), (!model.is_empty()).then(|| model[0]));
                    if !model.is_empty() {
                        consumed = model.remove(0).0;
                    }
                }
            }
            assert_eq!(ring.consumed(), consumed);
            assert_eq!(ring.end_seq(), model.last().map_or(consumed, |last| last.0));
            for &(seq, mark) in &model {
                assert_eq!(ring.get(seq).map(|s| s.joints.0[0]), Some(mark));
            }
            if model.is_empty() {
                assert_eq!(ring.credits(), CAP as u32, "an empty ring gives all its room back");
            }
        }
        assert!(
            replaced > 20 && refused > 0,
            "seed {seed}: {replaced} replaced, {refused} refused: the test missed its aim"
        );
    }
}
