//! Whether something can move; and if not, when the host is told why.

use crate::link::NotReady;
use screed_kernel::units::Nanos;
use std::fmt;

/// How long a robot that has not been ready yet may take no setpoints before the host is told why (ns). One that was ready is
/// asked at once.
const PATIENCE_NS: u64 = 3_000_000_000;

/// Why nothing can move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// The robot takes no setpoints.
    Robot(NotReady),
    /// The robot does; the extruder does not.
    Extruder,
}

/// Cause and action.
impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Robot(why) => why.fmt(f),
            Self::Extruder => f.write_str(
                "the extruder is not ready, it has not answered without a fault: check its line, its power and its display",
            ),
        }
    }
}

/// What the host has been told of it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Readiness {
    was_ready: bool,
    /// Since when not.
    since: Option<Nanos>,
    told: Option<Obstacle>,
}

impl Readiness {
    /// Another host has come, or another connection: it is told again.
    pub(super) fn begin(&mut self) {
        *self = Self::default();
    }

    /// What the host is to be told at `now`, each reason once: nothing would ever move, and nobody would know why.
    pub(super) fn watch(&mut self, now: Nanos, why: Option<Obstacle>) -> Option<Obstacle> {
        let Some(why) = why else {
            *self = Self { was_ready: true, since: None, told: None };
            return None;
        };
        let since = *self.since.get_or_insert(now);
        let patience = if self.was_ready || self.told.is_some() { 0 } else { PATIENCE_NS };
        if self.told == Some(why) || now.since(since) < patience {
            return None;
        }
        self.told = Some(why);
        self.told
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{Code, Remedy};

    fn not_ready(cause: &'static str, code: i64) -> Obstacle {
        Obstacle::Robot(NotReady {
            remedy: Remedy { cause, action: "see to it" },
            code: Code::Number("state", code, 7),
        })
    }

    #[test]
    fn the_gravest_reason_is_told_and_a_new_one_at_once() {
        let second = Nanos(1_000_000_000);
        let mut readiness = Readiness::default();
        let stopped = not_ready("stopped", 1);
        // Never ready: it may still be on its way there.
        assert_eq!(readiness.watch(second, Some(stopped)), None);
        assert_eq!(readiness.watch(second.plus(2_999_999_999), Some(stopped)), None);
        assert_eq!(readiness.watch(second.plus(3_000_000_000), Some(stopped)), Some(stopped));
        assert_eq!(readiness.watch(second.plus(9_000_000_000), Some(stopped)), None, "once");
        let pressed = not_ready("pressed", 2);
        assert_eq!(
            readiness.watch(second.plus(9_000_000_001), Some(pressed)),
            Some(pressed),
            "another reason, at once"
        );
        assert_eq!(readiness.watch(second, None), None);
        assert_eq!(readiness.watch(second, Some(stopped)), Some(stopped), "it was ready: at once");
    }
}
