//! What a loop says of itself: [`LoopRecord`].

use super::LoopReport;
use crate::drive::Drive;
use crate::estimator::Estimated;
use crate::frame::{BaseRecord, JOINTS_MAX, JointValues, LoopRecord};
use crate::tick::STATUS_INTERVAL;

/// What has been counted since the start, and what was said last.
#[derive(Clone, Debug, Default)]
pub(super) struct Telemetry {
    /// Poses that the base's estimate took in, and that it did not; measurements of the filter gated, late, deferred.
    counts: [u32; 5],
    nis: Option<f64>,
    /// Whether the feedback acted, the base was trusted, the path waited.
    said: Option<[bool; 3]>,
}

impl Telemetry {
    /// Counts a tick's report; what is to be said of it, if anything.
    pub fn of<const N: usize>(&mut self, tick: u64, report: &LoopReport<N>, drives: &[Drive; N]) -> Option<LoopRecord> {
        let estimated = report.estimated.and_then(Result::ok);
        if let Some(estimated) = &estimated {
            self.count(estimated);
        }
        let base = estimated.map(|estimated| self.base(&estimated));
        let now = [report.control.closed, base.is_some_and(|base| base.age.is_some()), report.waits];
        if self.said == Some(now) && !tick.is_multiple_of(STATUS_INTERVAL) {
            return None;
        }
        self.said = Some(now);
        let control = &report.control;
        Some(LoopRecord {
            tick,
            base,
            closed: control.closed,
            waits: report.waits,
            saturated: control.saturated,
            moved: [control.shift, control.turn],
            held: control.held,
            behind: control.behind,
            lag: each(drives, |drive| drive.lag),
            inverse_gain: each(drives, |drive| drive.inverse_gain),
        })
    }

    fn count<const N: usize>(&mut self, estimated: &Estimated<N>) {
        let [taken, refused] = estimated.poses;
        let filter = estimated.filter.unwrap_or_default();
        let [gated, late, deferred] =
            [filter.gated, filter.too_old, filter.deferred].map(|count| u32::try_from(count).unwrap_or(u32::MAX));
        for (count, more) in self.counts.iter_mut().zip([taken, refused, gated, late, deferred]) {
            *count = count.saturating_add(more);
        }
        self.nis = estimated.nis.or(self.nis);
    }

    fn base<const N: usize>(&self, estimated: &Estimated<N>) -> BaseRecord {
        let (shift, turn) = (estimated.base.displacement.translation, estimated.base.displacement.rotation);
        let [taken, refused, gated, late, deferred] = self.counts;
        BaseRecord {
            age: estimated.age(),
            displacement: [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z],
            behind: estimated.base.behind,
            nis: self.nis,
            taken,
            refused,
            gated,
            late,
            deferred,
        }
    }
}

fn each<const N: usize>(drives: &[Drive; N], of: fn(&Drive) -> f64) -> JointValues {
    drives.iter().take(JOINTS_MAX).map(of).collect()
}
