//! A laser tracker with the published accuracy: Table 1 of the KRAKEN paper.

use super::SUBSTEP_NS;
use super::params::TrackerParams;
use super::random::Random;
use nalgebra::Vector3;
use screed_kernel::pose::Pose;
use screed_kernel::units::Nanos;
use std::collections::VecDeque;

/// Time between two poses (ns): 1 kHz.
pub const TRACKER_PERIOD_NS: u64 = 1_000_000;

/// Standard deviation of a rotation about each axis (rad): the table's ±0.01°, taken as one standard deviation.
pub const ROTATION_DEVIATION: f64 = 0.01 * std::f64::consts::PI / 180.0;

/// A stamp is wrong by at most so much (s): the table's 5 µs.
pub const STAMP_ERROR: f64 = 5e-6;

/// Standard deviation of a position along each axis (m) at a distance (m) from the tracker: half of the maximum permissible
/// error, 15 µm + 6 µm/m, as the table calls typical.
pub const fn position_deviation(distance: f64) -> f64 {
    0.5 * (15e-6 + 6e-6 * distance)
}

/// A pose that has arrived.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracked {
    /// When it was true, but for the error of the stamp.
    pub at: Nanos,
    /// What was measured.
    pub tracker_from_target: Pose,
}

#[derive(Clone, Debug)]
pub(super) struct Tracker {
    params: TrackerParams,
    random: Random,
    latency_ns: u64,
    /// When the beam breaks next, and until when nothing is seen.
    breaks: f64,
    blind_until: f64,
    /// The target a substep before.
    before: Pose,
    on_the_way: VecDeque<Tracked>,
}

impl Tracker {
    pub fn new(params: &TrackerParams, mut random: Random, target: Pose) -> Self {
        let breaks = random.wait(params.break_interval);
        Self {
            params: *params,
            random,
            latency_ns: (params.latency * 1e9) as u64,
            breaks,
            blind_until: 0.0,
            before: target,
            on_the_way: VecDeque::new(),
        }
    }

    /// The target is there now.
    pub fn see(&mut self, now: Nanos, target: &Pose) {
        let before = std::mem::replace(&mut self.before, *target);
        if !now.0.is_multiple_of(TRACKER_PERIOD_NS) {
            return;
        }
        let time = now.0 as f64 * 1e-9;
        if time >= self.breaks {
            let [shortest, longest] = self.params.break_length;
            let [soonest, latest] = self.params.relock;
            let length = self.random.between(shortest, longest) + self.random.between(soonest, latest);
            self.blind_until = time + length;
            self.breaks = self.blind_until + self.random.wait(self.params.break_interval);
        }
        // Drawn whether it is needed or not, so that one parameter does not change what others draw.
        let (place, turn) = (self.random.normals(1.0), self.random.normals(1.0));
        let (late, lost) = (self.random.between(-STAMP_ERROR, STAMP_ERROR), self.random.between(0.0, 1.0));
        if time < self.blind_until || lost < self.params.missing {
            return;
        }
        let noise = self.params.noise;
        let share = noise * late * 1e9 / SUBSTEP_NS as f64;
        let turned = Pose { rotation: target.rotation * before.rotation.transpose(), translation: Vector3::zeros() };
        let turn = turned.rotation_vector() * share + turn * (noise * ROTATION_DEVIATION);
        let way = (target.translation - before.translation) * share;
        let deviation = noise * position_deviation(target.translation.norm());
        let off = Pose::from_rotation_vector(Vector3::zeros(), turn);
        let tracker_from_target = Pose {
            rotation: off.rotation * target.rotation,
            translation: target.translation + way + place * deviation,
        };
        self.on_the_way.push_back(Tracked { at: now, tracker_from_target });
    }

    /// What has arrived by now, the oldest first.
    pub fn arrived(&mut self, now: Nanos) -> Vec<Tracked> {
        let count = self.on_the_way.iter().take_while(|pose| pose.at.plus(self.latency_ns) <= now).count();
        self.on_the_way.drain(..count).collect()
    }
}
