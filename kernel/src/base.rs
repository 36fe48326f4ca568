//! Where the robot's base really is: its displacement from where registration put it, from a tracker's pose and raw encoders.
//!
//! The KRAKEN paper (section 2.5) estimates the robot's actual base from the measured joints, the measured pose and the
//! kinematics, and recalculates the reference trajectory in it. Here a Kalman filter of its own does so ([`estimate`]): what a
//! pose and forward kinematics of the same instant disagree by is a displacement of the base and noise.
//!
//! **What is taken for the base.** A pose that is not where raw encoders put it may come from a base that has shifted or from an
//! arm that is bent; one tracker and one arm cannot tell these apart at one instant. The assumption is that they differ in
//! time: the base is slow, with a speed and a persistence that [`Drift`] states; what is faster is the arm's and noise, and
//! [`crate::ekf`] estimates it with the base as it is. A bend that stays (gravity, a play that lies on one side, an error of the
//! kinematics) is indistinguishable from a shift and is reported as one. For the TCP that does not matter, as the sum is what
//! puts the TCP where it is, except through levers: it holds where it was measured, and fades as the arm moves away from there.
//!
//! The encoders must be raw. Joints that a filter has already pulled towards the pose see no displacement, and a filter with a
//! base that stands takes the base's motion for the joints'.
//!
//! **What comes out** is bounded and smooth whatever comes in: each of its six numbers goes to the estimate with a bounded
//! speed and acceleration ([`Ramp`]). A displacement beyond its bounds is an [`Excess`], never a smaller correction. Without a
//! believed pose the estimate runs on for [`BaseConfig::hold`]; then trust ends, and the correction ramps out. A jump is gated at
//! first; [`BaseConfig::agreeing`] measurements in a row that agree with one another start the estimate anew there.

pub mod covariance;
pub mod estimate;
pub mod history;
pub mod swing;

use crate::arm::Arm;
use crate::ekf::{EkfError, Verdict as Judged};
use crate::pose::Pose;
use crate::ramp::{Ramp, RampLimits};
use crate::units::Nanos;
use estimate::{Ahead, Estimate, Seen};
use nalgebra::Vector3;
use swing::Swing;

pub use estimate::{Displacement, Drift, Measurement};

/// Largest bound on a displacement's rotation (rad): its three numbers are bounded and ramped one by one, as small angles.
pub const ROTATION_MAX: f64 = 0.2;

/// What is known beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseConfig {
    /// Where registration put the base.
    pub tracker_from_nominal: Pose,
    /// Where the target is mounted.
    pub flange_from_target: Pose,
    /// The point whose displacement is estimated (m, in the nominal base frame). Choose the middle of where the tool works: a
    /// displacement of the base's origin would lie a long lever away from where it is measured, and an error of rotation would
    /// come with a large one of translation.
    pub pivot: Vector3<f64>,
    /// How its place of rest moves.
    pub drift: Drift,
    /// How it swings about that.
    pub swing: Swing,
    /// For how long the estimate is trusted after the last pose that was believed (s).
    pub hold: f64,
    /// How many measurements in a row have to agree with one another to begin an estimate, at first and after a jump; 2 or more.
    pub agreeing: u32,
    /// What the correction may be.
    pub limits: BaseLimits,
    /// Time between two ticks (s).
    pub period: f64,
}

/// What the correction may be, along and about each axis of the nominal base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseLimits {
    /// Largest displacement of the pivot (m).
    pub translation_max: f64,
    /// How fast it may change (m/s).
    pub velocity_max: f64,
    /// How fast that may change (m/s²).
    pub acceleration_max: f64,
    /// Largest component of the rotation vector (rad), at most [`ROTATION_MAX`].
    pub rotation_max: f64,
    /// How fast it may change (rad/s).
    pub turn_rate_max: f64,
    /// How fast that may change (rad/s²).
    pub turn_acceleration_max: f64,
}

/// Why something was refused; nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BaseError {
    /// A number of the configuration is not positive and finite, or beyond its bound. Correct it.
    Config {
        /// Which.
        field: &'static str,
        /// What was given.
        value: f64,
    },
    /// A measurement makes no sense.
    Measurement(EkfError),
    /// A measurement is not later than one before it. A base is slow: what came out of order would tell nothing new.
    Late {
        /// By how much (ns).
        by: u64,
    },
    /// A measurement is later than the last tick by more than the hold. Correct the stamps.
    Early {
        /// By how much it is later than the last tick (ns).
        by: u64,
    },
}

impl From<EkfError> for BaseError {
    fn from(error: EkfError) -> Self {
        Self::Measurement(error)
    }
}

/// What became of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// The estimate has moved towards it.
    Taken {
        /// Normalised innovation squared, χ² with 6 degrees of freedom.
        nis: f64,
    },
    /// It lies too far from the estimate, which has not changed.
    Gated {
        /// Normalised innovation squared.
        nis: f64,
        /// The gate it did not pass.
        gate: f64,
        /// So many in a row, this one included, agree with one another.
        agreeing: u32,
    },
    /// There is no estimate yet, or no longer.
    Acquiring {
        /// So many in a row, this one included, agree with one another.
        agreeing: u32,
    },
    /// Enough agreed: the estimate begins anew with them.
    Acquired,
}

/// Whether the base is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trust {
    /// A pose of so many seconds ago was believed, less than the hold.
    Held {
        /// (s)
        age: f64,
    },
    /// None, or too long ago.
    Ended,
}

/// The displacement is, or will be before it could be braken, beyond its bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Excess {
    /// Translation or rotation.
    pub part: Part,
    /// 0 to 2: x, y, z of the nominal base frame.
    pub axis: u8,
    /// What it is (m, rad).
    pub value: f64,
    /// What it may be (m, rad).
    pub limit: f64,
}

/// What a displacement consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Of the pivot.
    Translation,
    /// The rotation vector.
    Rotation,
}

/// What a tick puts out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// The correction: bounded and smooth.
    pub displacement: Displacement,
    /// The same as a pose: where the base is in the nominal base frame.
    pub nominal_from_base: Pose,
    /// Whether the base is known.
    pub trust: Trust,
    /// How far the correction is behind the estimate (m, rad): more than noise after a jump, and when the base is faster than the
    /// limits. Zero without an estimate.
    pub behind: [f64; 2],
}

/// The estimate, and the correction that follows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Base {
    config: BaseConfig,
    nominal_from_tracker: Pose,
    estimate: Option<Estimate>,
    /// What may replace it: an estimate from measurements that were gated, and how many they are.
    candidate: Option<(Estimate, u32)>,
    /// Stamp of the newest measurement that was judged.
    newest: Option<Nanos>,
    /// The last tick.
    ticked: Option<Nanos>,
    translation: [Ramp; 3],
    rotation: [Ramp; 3],
    trust: Trust,
    behind: [f64; 2],
    excess: Option<Excess>,
}

impl Base {
    /// A base that nothing is known of, without correction.
    ///
    /// # Errors
    /// [`BaseError::Config`], [`BaseError::Measurement`] for poses that are none.
    pub fn new(config: &BaseConfig) -> Result<Self, BaseError> {
        config.check()?;
        Ok(Self {
            config: *config,
            nominal_from_tracker: config.tracker_from_nominal.inverse(),
            estimate: None,
            candidate: None,
            newest: None,
            ticked: None,
            translation: [Ramp::at(0.0); 3],
            rotation: [Ramp::at(0.0); 3],
            trust: Trust::Ended,
            behind: [0.0; 2],
            excess: None,
        })
    }

    /// Takes a pose and the raw encoders of the same instant. The estimate moves on to the measurement's own stamp, so a
    /// tracker's latency costs no accuracy but that of [`Self::tick`]'s look ahead.
    ///
    /// # Errors
    /// [`BaseError`]
    pub fn measure<const N: usize>(
        &mut self,
        arm: &Arm<N>,
        measurement: &Measurement<N>,
    ) -> Result<Verdict, BaseError> {
        let at = measurement.at;
        if let Some(newest) = self.newest
            && at <= newest
        {
            return Err(BaseError::Late { by: newest.since(at) });
        }
        if let Some(ticked) = self.ticked
            && seconds(ticked, at) > self.config.hold
        {
            return Err(BaseError::Early { by: at.since(ticked) });
        }
        let seen = Seen::of(arm, measurement, &self.nominal_from_tracker, &self.config)?;
        let (config, hold) = (&self.config, self.config.hold);
        let held = |estimate: &Estimate| seconds(estimate.at(), at) <= hold;
        let judged = match &mut self.estimate {
            Some(estimate) if held(estimate) => Some(estimate.take(&seen, config)?),
            _ => None,
        };
        if let Some(Judged::Taken { nis }) = judged {
            self.newest = Some(at);
            self.candidate = None;
            return Ok(Verdict::Taken { nis });
        }
        // The candidate with one measurement more that agrees with it, or a new one from that measurement alone.
        let agreeing = if let Some((candidate, agreeing)) = &mut self.candidate
            && held(candidate)
            && candidate.take(&seen, config)?.is_taken()
        {
            *agreeing = agreeing.saturating_add(1);
            *agreeing
        } else {
            self.candidate = Some((Estimate::alone(&seen, config)?, 1));
            1
        };
        self.newest = Some(at);
        if agreeing >= config.agreeing {
            self.estimate = self.candidate.as_ref().map(|(candidate, _)| *candidate);
            self.candidate = None;
            return Ok(Verdict::Acquired);
        }
        Ok(match judged {
            Some(Judged::Gated { nis, gate }) => Verdict::Gated { nis, gate, agreeing },
            _ => Verdict::Acquiring { agreeing },
        })
    }

    /// One period on. `at` is when the correction is to act: now, or later by the dead time of the command. The estimate is
    /// looked at as it will be then, and the correction goes where the base would come to rest if it braked from there as
    /// hard as the correction can: so it follows a base that moves evenly without lag, and can always brake within its bounds.
    ///
    /// # Errors
    /// An [`Excess`], from the tick on that finds it until [`Self::clear`]. The correction ramps out meanwhile; it is in
    /// [`Self::output`] all the same.
    pub fn tick(&mut self, at: Nanos) -> Result<Output, Excess> {
        self.ticked = Some(at);
        if self.estimate.as_ref().is_some_and(|estimate| seconds(estimate.at(), at) > self.config.hold) {
            self.estimate = None;
        }
        let ahead =
            self.estimate.as_ref().map(|estimate| (estimate.ahead(at, &self.config), seconds(estimate.at(), at)));
        let limits = self.config.limits;
        let mut aims = [Vector3::zeros(); 2];
        if let Some((Ahead { place, rate, displacement }, _)) = &ahead {
            aims = [
                place.translation + stop(&rate.translation, limits.velocity_max, limits.acceleration_max),
                place.rotation + stop(&rate.rotation, limits.turn_rate_max, limits.turn_acceleration_max),
            ];
            let excess = limits.excess(&[displacement.translation, displacement.rotation]);
            self.excess = self.excess.or(excess).or(limits.excess(&aims));
        }
        if self.excess.is_some() {
            aims = [Vector3::zeros(); 2];
        }
        let [translation, rotation] = aims;
        let period = self.config.period;
        go(&mut self.translation, &translation, limits.velocity_max, limits.acceleration_max, period);
        go(&mut self.rotation, &rotation, limits.turn_rate_max, limits.turn_acceleration_max, period);
        let now = self.displacement();
        (self.trust, self.behind) = match &ahead {
            Some((Ahead { place, .. }, age)) => (
                Trust::Held { age: *age },
                [(place.translation - now.translation).norm(), (place.rotation - now.rotation).norm()],
            ),
            None => (Trust::Ended, [0.0; 2]),
        };
        self.excess.map_or(Ok(self.output()), Err)
    }

    /// What the last tick put out.
    pub fn output(&self) -> Output {
        let displacement = self.displacement();
        Output {
            displacement,
            nominal_from_base: displacement.pose(&self.config.pivot),
            trust: self.trust,
            behind: self.behind,
        }
    }

    /// Forgets an excess: a person has looked at what moved the base.
    pub fn clear(&mut self) {
        self.excess = None;
    }

    /// The estimate, when there is one.
    pub const fn estimate(&self) -> Option<&Estimate> {
        self.estimate.as_ref()
    }

    /// Where the base is, by the estimate and not by the correction that follows it: what [`crate::ekf::pose`] needs. Where
    /// registration put it when there is no estimate.
    pub fn tracker_from_base(&self, at: Nanos) -> Pose {
        match &self.estimate {
            Some(estimate) => {
                self.config.tracker_from_nominal
                    * estimate.ahead(at, &self.config).displacement.pose(&self.config.pivot)
            }
            None => self.config.tracker_from_nominal,
        }
    }

    fn displacement(&self) -> Displacement {
        let vector = |[x, y, z]: &[Ramp; 3]| Vector3::new(x.value, y.value, z.value);
        Displacement { translation: vector(&self.translation), rotation: vector(&self.rotation) }
    }
}

impl BaseConfig {
    fn check(&self) -> Result<(), BaseError> {
        let BaseLimits {
            translation_max,
            velocity_max,
            acceleration_max,
            rotation_max,
            turn_rate_max,
            turn_acceleration_max,
        } = self.limits;
        for (field, value) in [
            ("drift.speed", self.drift.speed),
            ("drift.turn_rate", self.drift.turn_rate),
            ("drift.time", self.drift.time),
            ("hold", self.hold),
            ("period", self.period),
            ("limits.translation_max", translation_max),
            ("limits.velocity_max", velocity_max),
            ("limits.acceleration_max", acceleration_max),
            ("limits.rotation_max", rotation_max),
            ("limits.turn_rate_max", turn_rate_max),
            ("limits.turn_acceleration_max", turn_acceleration_max),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(BaseError::Config { field, value });
            }
        }
        self.swing.check()?;
        if rotation_max > ROTATION_MAX {
            return Err(BaseError::Config { field: "limits.rotation_max", value: rotation_max });
        }
        if self.agreeing < 2 {
            return Err(BaseError::Config { field: "agreeing", value: f64::from(self.agreeing) });
        }
        for value in self.pivot.iter() {
            if !value.is_finite() {
                return Err(BaseError::Config { field: "pivot", value: *value });
            }
        }
        for pose in [&self.tracker_from_nominal, &self.flange_from_target] {
            if !pose.is_finite() {
                return Err(EkfError::NotFinite.into());
            }
            crate::ekf::pose::rotation_is_sound(&pose.rotation)?;
        }
        Ok(())
    }
}

impl BaseLimits {
    /// The first number of these two vectors, translation and rotation, that is beyond its bound.
    fn excess(&self, displacement: &[Vector3<f64>; 2]) -> Option<Excess> {
        let limits = [(Part::Translation, self.translation_max), (Part::Rotation, self.rotation_max)];
        for ((part, limit), vector) in limits.into_iter().zip(displacement) {
            for (axis, value) in (0..3).zip(vector.iter()) {
                if value.is_nan() || libm::fabs(*value) > limit {
                    return Some(Excess { part, axis, value: *value, limit });
                }
            }
        }
        None
    }
}

/// How far each component comes that moves with this rate, or the largest that can be followed, and brakes.
fn stop(rate: &Vector3<f64>, rate_max: f64, braking: f64) -> Vector3<f64> {
    rate.map(|rate| {
        let rate = rate.max(-rate_max).min(rate_max);
        0.5 * rate * libm::fabs(rate) / braking
    })
}

/// One period of three ramps.
fn go(ramps: &mut [Ramp; 3], aims: &Vector3<f64>, slope_max: f64, curvature_max: f64, period: f64) {
    let limits = RampLimits { slope_max, curvature_max };
    for (ramp, aim) in ramps.iter_mut().zip(aims.iter()) {
        ramp.step(*aim, &limits, period);
    }
}

/// Seconds from one instant to another, 0 when that is earlier.
fn seconds(from: Nanos, to: Nanos) -> f64 {
    to.since(from) as f64 * 1e-9
}
