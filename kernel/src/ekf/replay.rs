//! Measurements that come late or out of order: the filter goes back to before the oldest of them and does the ticks since
//! then once more, as if all had come in order. Memory is fixed, and so is the most work of a tick: one replay of `DEPTH`
//! steps.

use super::pose::TrackedPose;
use super::{Ekf, EkfError, STEP_MAX, State, Verdict};
use crate::arm::Arm;
use crate::units::{JointJerk, JointPos, JointVel, Nanos};

/// Most measurements in one step: rates, encoders, and a tracker that is twice as fast as the ticks.
pub const STEP_MEASUREMENTS_MAX: usize = 4;

/// Most measurements that wait for the next tick, or for the tick that they belong to.
pub const WAITING_MAX: usize = 16;

/// What a sensor says.
// Memory is fixed and there is no heap: a slot has to hold the largest.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measurement<const N: usize> {
    /// For [`Ekf::pose`].
    Pose(TrackedPose),
    /// For [`Ekf::rates`].
    Rates {
        /// rad/s, m/s
        measured: JointVel<N>,
        /// Standard deviations (rad/s, m/s).
        deviation: JointVel<N>,
    },
    /// For [`Ekf::encoders`].
    Encoders {
        /// rad, m
        measured: JointPos<N>,
        /// Standard deviations (rad, m).
        deviation: JointPos<N>,
    },
}

/// A measurement and when it was true.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stamped<const N: usize> {
    /// When, by the clock of the ticks.
    pub at: Nanos,
    /// What.
    pub measurement: Measurement<N>,
}

/// Why a measurement was not taken in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OfferError {
    /// [`WAITING_MAX`] wait already. Tick, then offer it again.
    Full,
}

/// What a tick did. Every measurement that was offered is in one of the counts of one tick; one that waits is `deferred` at each
/// tick until then.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// Measurements that were sorted into their step.
    pub sorted: usize,
    /// Steps that were done once more before this tick's own.
    pub replayed: usize,
    /// Measurements from later than this tick; they wait for theirs.
    pub deferred: usize,
    /// Measurements from before the oldest step that is remembered; they are lost.
    pub too_old: usize,
    /// Measurements whose step has [`STEP_MEASUREMENTS_MAX`] already; they are lost.
    pub crowded: usize,
    /// Measurements of a kind and an instant that their step has already, as a line that says a thing twice brings them; left out, for
    /// twice the same tells no more than once.
    pub repeated: usize,
    /// Measurements in the replayed steps and this one that were gated.
    pub gated: usize,
    /// The first error of a measurement in those steps; it has been left out, the others have not.
    pub error: Option<EkfError>,
}

/// A filter that remembers the last `DEPTH` ticks (about 3 kB each for six joints).
#[derive(Clone, Debug)]
pub struct Replay<const N: usize, const DEPTH: usize> {
    ekf: Ekf<N>,
    now: Nanos,
    steps: [Option<Step<N>>; DEPTH],
    /// Where the newest step is.
    newest: usize,
    waiting: [Option<Stamped<N>>; WAITING_MAX],
}

/// From one tick to the next.
#[derive(Clone, Copy, Debug)]
struct Step<const N: usize> {
    /// The filter at the beginning.
    before: Ekf<N>,
    begins: Nanos,
    ends: Nanos,
    jerk: JointJerk<N>,
    /// By time, later than `begins` and not later than `ends`; the free ones are last.
    measurements: [Option<Stamped<N>>; STEP_MEASUREMENTS_MAX],
}

impl<const N: usize, const DEPTH: usize> Replay<N, DEPTH> {
    /// A filter whose state is that of `now`.
    pub const fn new(ekf: Ekf<N>, now: Nanos) -> Self {
        const { assert!(DEPTH > 0) };
        Self { ekf, now, steps: [None; DEPTH], newest: 0, waiting: [None; WAITING_MAX] }
    }

    /// The filter as of the last tick.
    pub const fn ekf(&self) -> &Ekf<N> {
        &self.ekf
    }

    /// Where the joints will be `dt` s after the last tick if they follow this jerk: for a command that acts then.
    #[must_use]
    pub fn ahead(&self, dt: f64, jerk: &JointJerk<N>) -> State<N> {
        self.ekf.state().after(dt, jerk)
    }

    /// Takes a measurement for the next tick.
    ///
    /// # Errors
    /// [`OfferError::Full`]
    pub fn offer(&mut self, stamped: &Stamped<N>) -> Result<(), OfferError> {
        for slot in &mut self.waiting {
            if slot.is_none() {
                *slot = Some(*stamped);
                return Ok(());
            }
        }
        Err(OfferError::Full)
    }

    /// Moves on to `now` with this commanded jerk since the last tick, and takes in what was offered, each at its own time.
    ///
    /// # Errors
    /// [`EkfError::Step`] when `now` is not later than the last tick or later by more than [`STEP_MAX`],
    /// [`EkfError::NotFinite`] for the jerk; nothing has changed then.
    pub fn tick(&mut self, arm: &Arm<N>, now: Nanos, jerk: &JointJerk<N>) -> Result<Report, EkfError> {
        let dt = seconds(self.now, now);
        if !(dt > 0.0 && dt <= STEP_MAX) {
            return Err(EkfError::Step { dt });
        }
        if !self.ekf.state().after(dt, jerk).is_finite() {
            return Err(EkfError::NotFinite);
        }
        self.newest = self.index(DEPTH - 1);
        let step = Step {
            before: self.ekf,
            begins: self.now,
            ends: now,
            jerk: *jerk,
            measurements: [None; STEP_MEASUREMENTS_MAX],
        };
        if let Some(slot) = self.steps.get_mut(self.newest) {
            *slot = Some(step);
        }
        self.now = now;
        let mut report = Report::default();
        report.replayed = self.sort_in(&mut report);
        self.replay(arm, &mut report);
        Ok(report)
    }

    /// Where the step is that began so many steps before the newest.
    const fn index(&self, back: usize) -> usize {
        self.newest.wrapping_add(DEPTH).wrapping_sub(back) % DEPTH
    }

    /// Sorts what waits into its steps; returns how many steps before the newest the oldest of them is.
    fn sort_in(&mut self, report: &mut Report) -> usize {
        let mut oldest = 0;
        for waiting in 0..WAITING_MAX {
            let Some(Some(stamped)) = self.waiting.get(waiting).copied() else { continue };
            if stamped.at > self.now {
                count(&mut report.deferred);
                continue;
            }
            if let Some(slot) = self.waiting.get_mut(waiting) {
                *slot = None;
            }
            let mut place = None;
            for back in 0..DEPTH {
                if let Some(Some(step)) = self.steps.get(self.index(back))
                    && stamped.at > step.begins
                    && stamped.at <= step.ends
                {
                    place = Some(back);
                    break;
                }
            }
            let Some(back) = place else {
                count(&mut report.too_old);
                continue;
            };
            let index = self.index(back);
            let Some(Some(step)) = self.steps.get_mut(index) else { continue };
            if step.has(&stamped) {
                count(&mut report.repeated);
            } else if step.insert(stamped) {
                count(&mut report.sorted);
                oldest = usize::max(oldest, back);
            } else {
                count(&mut report.crowded);
            }
        }
        oldest
    }

    /// Does the newest step, and `report.replayed` before it.
    fn replay(&mut self, arm: &Arm<N>, report: &mut Report) {
        let from = report.replayed;
        for back in (0..DEPTH).rev() {
            let index = self.index(back);
            let Some(Some(step)) = self.steps.get_mut(index) else { continue };
            if back > from {
                continue;
            }
            if back < from {
                step.before = self.ekf;
            }
            self.ekf = step.done(arm, report);
        }
    }
}

impl<const N: usize> Step<N> {
    /// Whether there is one of this kind and instant.
    fn has(&self, stamped: &Stamped<N>) -> bool {
        self.measurements.iter().flatten().any(|other| other.order() == stamped.order())
    }

    /// Puts a measurement in its place, if there is one.
    fn insert(&mut self, stamped: Stamped<N>) -> bool {
        if self.measurements.iter().all(Option::is_some) {
            return false;
        }
        let mut carried = stamped;
        for slot in &mut self.measurements {
            match slot {
                Some(other) if other.order() <= carried.order() => {}
                Some(other) => core::mem::swap(other, &mut carried),
                None => {
                    *slot = Some(carried);
                    return true;
                }
            }
        }
        false
    }

    /// The filter at the end.
    fn done(&self, arm: &Arm<N>, report: &mut Report) -> Ekf<N> {
        let mut ekf = self.before;
        let mut at = self.begins;
        for stamped in self.measurements.iter().flatten() {
            let result = self.predict(&mut ekf, at, stamped.at).and_then(|()| ekf.measure(arm, &stamped.measurement));
            at = stamped.at;
            match result {
                Ok(Verdict::Taken { .. }) => {}
                Ok(Verdict::Gated { .. }) => count(&mut report.gated),
                Err(error) => report.error = report.error.or(Some(error)),
            }
        }
        if let Err(error) = self.predict(&mut ekf, at, self.ends) {
            report.error = report.error.or(Some(error));
        }
        ekf
    }

    /// Moves on, unless that moment is now.
    fn predict(&self, ekf: &mut Ekf<N>, from: Nanos, to: Nanos) -> Result<(), EkfError> {
        if from == to { Ok(()) } else { ekf.predict(seconds(from, to), &self.jerk) }
    }
}

impl<const N: usize> Stamped<N> {
    /// What comes first: the earlier one, of two at one time always the same kind.
    fn order(&self) -> (Nanos, u8) {
        let kind = match self.measurement {
            Measurement::Pose(_) => 0,
            Measurement::Rates { .. } => 1,
            Measurement::Encoders { .. } => 2,
        };
        (self.at, kind)
    }
}

impl<const N: usize> Ekf<N> {
    /// Corrects with any kind of measurement.
    ///
    /// # Errors
    /// Those of [`Self::pose`], [`Self::rates`] and [`Self::encoders`].
    pub fn measure(&mut self, arm: &Arm<N>, measurement: &Measurement<N>) -> Result<Verdict, EkfError> {
        match measurement {
            Measurement::Pose(measured) => self.pose(arm, measured),
            Measurement::Rates { measured, deviation } => self.rates(measured, deviation),
            Measurement::Encoders { measured, deviation } => self.encoders(measured, deviation),
        }
    }
}

/// Seconds from one instant to a later one.
fn seconds(from: Nanos, to: Nanos) -> f64 {
    to.since(from) as f64 * 1e-9
}

/// One more; no count here gets beyond `DEPTH` times [`WAITING_MAX`].
const fn count(counter: &mut usize) {
    *counter = counter.wrapping_add(1);
}
