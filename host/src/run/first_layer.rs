//! The first layer of a real robot: at a reduced rate of the path clock until it is laid, then as planned.

use crate::plan::moves::MoveKind;
use crate::plan::stream::Setpoint as Planned;

/// A rate that the kernel does not have after so long (s) is said again: it needs less than a second to get there.
const AGAIN: f64 = 2.0;

/// How far the first layer is, and which rate was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct FirstLayer {
    rate: f64,
    layer: Option<usize>,
    /// Whether material was laid in it, so that the next move which lays none ends it.
    begun: bool,
    laid: bool,
    said: Option<(f64, f64)>,
}

impl FirstLayer {
    /// At `rate` (0 to 1).
    pub const fn new(rate: f64) -> Self {
        Self { rate, layer: None, begun: false, laid: false, said: None }
    }

    /// Its rate (0 to 1).
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// Whether it is laid.
    pub const fn is_laid(&self) -> bool {
        self.laid
    }

    /// The rate to ask the kernel for at time `now` (s), while the path is `at` this setpoint and its clock goes at `rate`; none
    /// where nothing is to be said.
    pub fn step(&mut self, now: f64, at: Option<&Planned>, rate: f64) -> Option<f64> {
        if let Some(at) = at {
            let layer = *self.layer.get_or_insert(at.layer);
            self.laid |= at.layer != layer || (self.begun && at.kind != MoveKind::Deposit);
            self.begun |= at.kind == MoveKind::Deposit;
        }
        let wanted = if self.laid { 1.0 } else { self.rate };
        let is_said = self.said.is_some_and(|(said, when)| said == wanted && (rate == wanted || now - when < AGAIN));
        if is_said {
            return None;
        }
        self.said = Some((wanted, now));
        Some(wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use screed_kernel::units::JointPos;

    fn at(layer: usize, kind: MoveKind) -> Planned {
        Planned { seq: 1, joints: JointPos::ZERO, flow: 0.0, deposit: kind == MoveKind::Deposit, layer, kind }
    }

    #[test]
    fn it_is_slow_until_the_first_layer_is_laid_and_says_again_what_does_not_come() {
        let mut first = FirstLayer::new(0.5);
        assert_eq!(first.step(0.0, None, 0.0), Some(0.5));
        assert_eq!(first.step(1.9, None, 0.0), None, "it takes a moment");
        assert_eq!(first.step(2.1, None, 0.0), Some(0.5), "said again");
        for (now, kind) in [(3.0, MoveKind::Approach), (9.0, MoveKind::Lower), (15.0, MoveKind::Deposit)] {
            assert_eq!(first.step(now, Some(&at(4, kind)), 0.5), None);
        }
        assert!(!first.is_laid());
        assert_eq!(first.step(20.0, Some(&at(4, MoveKind::Lift)), 0.5), Some(1.0));
        assert_eq!(first.step(21.0, Some(&at(4, MoveKind::Travel)), 0.9), None);
        assert_eq!(first.step(23.0, Some(&at(5, MoveKind::Deposit)), 0.9), Some(1.0));
        assert_eq!(first.step(29.0, Some(&at(5, MoveKind::Deposit)), 1.0), None);
        assert!(first.is_laid());
    }
}
