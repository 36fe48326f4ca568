//! What robot and tracker say, made into what the controller asks: where the base is, and where the flange is in it.
//!
//! Two estimates that must not fight. The base's ([`crate::base`]) comes from poses and *raw* encoders, and is slow. The joints'
//! ([`crate::ekf`]) comes from poses, rates and encoders, poses being seen from the base as it is; it has what is fast. A filter
//! with a base that stands would take the base's motion for the joints'; a base from filtered joints would see nothing.
//!
//! Poses come late. Each is compared with the encoders of its own instant ([`History`]), and enters the filter by replay.

use crate::arm::Arm;
use crate::base::history::History;
use crate::base::{Base, BaseConfig, BaseError, Excess, Measurement as BaseMeasurement, Output, Trust, Verdict};
use crate::delay::Delay;
use crate::drive::DEAD_TICKS_MAX;
use crate::ekf::pose::TrackedPose;
use crate::ekf::replay::{self, Measurement, Replay, Stamped};
use crate::ekf::{Ekf, EkfError, State};
use crate::pose::Pose;
use crate::units::{JointAcc, JointJerk, JointPos, JointVel, Nanos};

/// After so many ticks in a row in which the filter did not believe something, it is not believed itself.
pub const DOUBT_MAX: u32 = 10;

/// And after so many it starts anew from the encoders.
pub const DISBELIEF_MAX: u32 = 50;

/// Most poses that a tick takes in: a tracker sixteen times as fast as the ticks.
pub const POSES_MAX: usize = 16;

/// What the robot says at a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Robot<const N: usize> {
    /// Encoders (rad, m).
    pub actual: JointPos<N>,
    /// Rates (rad/s, m/s), where it tells them.
    pub rates: Option<JointVel<N>>,
    /// As [`crate::tick::Sensors::ready`].
    pub ready: bool,
}

/// A pose from the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerPose {
    /// When it was true, by the clock of the ticks.
    pub at: Nanos,
    /// What was measured.
    pub tracker_from_target: Pose,
    /// Standard deviation of the position, the same along each axis (m).
    pub position_deviation: f64,
    /// Standard deviation of the rotation vector, the same about each axis (rad).
    pub rotation_deviation: f64,
}

/// What an estimator is made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatorConfig<const N: usize> {
    /// The base's, and how tracker, base and target are mounted.
    pub base: BaseConfig,
    /// How far the joints stray from what was commanded: density of their white jerk (rad²/s⁵, m²/s⁵).
    pub jerk_density: [f64; N],
    /// What links do beside the encoders, and noise (standard deviation, rad, m): for the filter.
    pub encoder_deviation: JointPos<N>,
    /// The same for the base.
    pub joint_deviation: JointPos<N>,
    /// Of measured rates (rad/s, m/s).
    pub rate_deviation: JointVel<N>,
    /// How uncertain the filter is when it starts from the encoders at rest.
    pub start_deviation: State<N>,
    /// From a command to its effect (s), at most [`DEAD_TICKS_MAX`] ticks: the filter's input waits as long, and the base is looked
    /// at as it will be then.
    pub dead_time: f64,
}

/// Why there is no estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EstimatorError {
    /// Of the base.
    Base(BaseError),
    /// Of the filter.
    Filter(EkfError),
    /// A dead time beyond [`DEAD_TICKS_MAX`] ticks, or no shorter than the base's hold, which ends trust before a command acts. Correct
    /// the configuration.
    DeadTime,
}

/// What a tick came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimated<const N: usize> {
    /// Where the base is.
    pub base: Output,
    /// Where the joints are by the filter.
    pub joints: JointPos<N>,
    /// The flange in the base as it is; `None` while the base is not trusted.
    pub base_from_flange: Option<Pose>,
    /// Poses that the base's estimate took in, and those that it did not believe or could not use; of more than [`POSES_MAX`]
    /// the oldest are not looked at.
    pub poses: [u32; 2],
    /// Normalised innovation squared of the last pose that the base's estimate judged at this tick, taken or gated.
    pub nis: Option<f64>,
    /// What the filter did; it starts anew after an error.
    pub filter: Result<replay::Report, EkfError>,
}

impl<const N: usize> Estimated<N> {
    /// How old the last pose is that was believed (s); none while the base is not trusted.
    pub const fn age(&self) -> Option<f64> {
        match self.base.trust {
            Trust::Held { age } => Some(age),
            Trust::Ended => None,
        }
    }
}

/// The estimator of an N-joint arm; it remembers `DEPTH` ticks.
#[derive(Clone, Debug)]
pub struct Estimator<const N: usize, const DEPTH: usize> {
    config: EstimatorConfig<N>,
    base: Base,
    encoders: History<N, DEPTH>,
    filter: Option<Replay<N, DEPTH>>,
    /// Accelerations that were commanded, one a tick.
    /// Up to a tick before the dead time.
    commanded: Delay<N, { DEAD_TICKS_MAX + 2 }>,
    disbelieved: u32,
}

impl<const N: usize, const DEPTH: usize> Estimator<N, DEPTH> {
    /// An estimator that knows nothing yet.
    ///
    /// # Errors
    /// [`EstimatorError`]
    pub fn new(config: &EstimatorConfig<N>) -> Result<Self, EstimatorError> {
        let longest = DEAD_TICKS_MAX as f64 * config.base.period;
        let base = Base::new(&config.base).map_err(EstimatorError::Base)?;
        if !(0.0..=longest).contains(&config.dead_time) || config.dead_time >= config.base.hold {
            return Err(EstimatorError::DeadTime);
        }
        let at_rest = State::at_rest(JointPos::ZERO);
        Ekf::new(at_rest, &config.start_deviation, &config.jerk_density).map_err(EstimatorError::Filter)?;
        Ok(Self {
            config: *config,
            base,
            encoders: History::new(),
            filter: None,
            commanded: Delay::at_rest(JointPos::ZERO),
            disbelieved: 0,
        })
    }

    /// The base.
    pub const fn base(&self) -> &Base {
        &self.base
    }

    /// For how long the base is trusted after the last pose that was believed (s).
    pub const fn hold(&self) -> f64 {
        self.config.base.hold
    }

    /// Forgets an excess of the base: a person has left the fault that it was.
    pub fn clear(&mut self) {
        self.base.clear();
    }

    /// The acceleration (rad/s², m/s²) that the path has at this tick: it acts a dead time from now, and the filter then knows.
    pub fn command(&mut self, acceleration: &JointAcc<N>) {
        self.commanded.push(&JointPos(acceleration.0));
    }

    /// One tick at `now`, with what has come since the last.
    ///
    /// # Errors
    /// An [`Excess`] of the base. A pose that makes no sense is counted and left out.
    pub fn tick(
        &mut self,
        arm: &Arm<N>,
        now: Nanos,
        robot: &Robot<N>,
        poses: &[TrackerPose],
    ) -> Result<Estimated<N>, Excess> {
        // A tick at the same time, or joints that are none, is for the kernel to tell.
        let _ = self.encoders.push(now, &robot.actual);
        let (mut counts, mut nis) = ([0_u32; 2], None);
        let over = poses.len().saturating_sub(POSES_MAX);
        for pose in poses.iter().skip(over) {
            let verdict = self.see(arm, pose);
            let [good, bad] = &mut counts;
            let count = if matches!(verdict, Some(Verdict::Taken { .. } | Verdict::Acquired)) { good } else { bad };
            *count = count.saturating_add(1);
            if let Some(Verdict::Taken { nis: judged } | Verdict::Gated { nis: judged, .. }) = verdict {
                nis = Some(judged);
            }
        }
        let filter = self.filter(arm, now, robot, poses.last());
        let acts = now.plus((self.config.dead_time * 1e9) as u64);
        let base = self.base.tick(acts)?;
        let joints = self.filter.as_ref().map_or(robot.actual, |filter| filter.ekf().state().position);
        let trusted = matches!(base.trust, Trust::Held { .. }) && self.disbelieved <= DOUBT_MAX && filter.is_ok();
        let base_from_flange = trusted.then(|| arm.forward(&joints));
        Ok(Estimated { base, joints, base_from_flange, poses: counts, nis, filter })
    }

    /// What the base's estimate made of the pose; `None` where it could not use it.
    fn see(&mut self, arm: &Arm<N>, pose: &TrackerPose) -> Option<Verdict> {
        let joints = self.encoders.at(pose.at).ok()?;
        let TrackerPose { at, tracker_from_target, position_deviation, rotation_deviation } = *pose;
        let joint_deviation = self.config.joint_deviation;
        let measurement = BaseMeasurement {
            at,
            tracker_from_target,
            position_deviation,
            rotation_deviation,
            joints,
            joint_deviation,
        };
        self.base.measure(arm, &measurement).ok()
    }

    /// Moves the filter on, with the newest of the poses: those of a tracker that is faster than the ticks tell it little more.
    fn filter(
        &mut self,
        arm: &Arm<N>,
        now: Nanos,
        robot: &Robot<N>,
        pose: Option<&TrackerPose>,
    ) -> Result<replay::Report, EkfError> {
        let config = &self.config;
        if self.disbelieved > DISBELIEF_MAX {
            self.filter = None;
        }
        let Some(filter) = &mut self.filter else {
            let ekf = Ekf::new(State::at_rest(robot.actual), &config.start_deviation, &config.jerk_density);
            self.filter = Some(Replay::new(ekf?, now));
            self.disbelieved = 0;
            return Ok(replay::Report::default());
        };
        let trusted = self.base.estimate().is_some();
        // One from later than the next tick would keep its place until then, and others out.
        let soon = |pose: &&TrackerPose| pose.at.since(now) as f64 * 1e-9 <= config.base.period;
        let pose = pose.filter(|_| trusted).filter(soon).map(|pose| {
            let tracked = TrackedPose {
                tracker_from_target: pose.tracker_from_target,
                tracker_from_base: self.base.tracker_from_base(pose.at),
                flange_from_target: config.base.flange_from_target,
                position_deviation: pose.position_deviation,
                rotation_deviation: pose.rotation_deviation,
            };
            Stamped { at: pose.at, measurement: Measurement::Pose(tracked) }
        });
        let encoders = Measurement::Encoders { measured: robot.actual, deviation: config.encoder_deviation };
        let rates = robot.rates.map(|measured| {
            let measurement = Measurement::Rates { measured, deviation: config.rate_deviation };
            Stamped { at: now, measurement }
        });
        let offered = [Some(Stamped { at: now, measurement: encoders }), rates, pose];
        for stamped in offered.iter().flatten() {
            // Three a tick, none of which waits for longer than the next, never fill it.
            let _ = filter.offer(stamped);
        }
        let back = config.dead_time / config.base.period;
        let [then, before] = [back, back + 1.0].map(|ticks| self.commanded.before(ticks));
        let mut jerk = JointJerk::ZERO;
        for (jerk, (then, before)) in jerk.0.iter_mut().zip(then.0.iter().zip(&before.0)) {
            *jerk = (then - before) / config.base.period;
        }
        match filter.tick(arm, now, &jerk) {
            Ok(report) => {
                self.disbelieved = if report.gated == 0 { 0 } else { self.disbelieved.saturating_add(1) };
                Ok(report)
            }
            // A clock that has not gone on: nothing has changed. One that stays is not believed, and then the filter starts anew.
            Err(EkfError::Step { dt }) if dt <= 0.0 => {
                self.disbelieved = self.disbelieved.saturating_add(1);
                Ok(replay::Report::default())
            }
            Err(error) => {
                self.filter = None;
                Err(error)
            }
        }
    }
}

#[cfg(test)]
mod tests;
