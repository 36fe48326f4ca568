//! Feed-forward through a drive: what to send so that the joint is where it should be, and what the drive is like.
//!
//! A joint under its controller is taken as q̈ = K·(r − q − L·q̇), r being what it was sent a dead time ago: on a ramp it lags by
//! L, and K is how hard it is pulled. To have it at q, send r = q + L·q̇ + q̈/K ([`Drive::lead`]). That law is what users measured
//! of `servoj`; L is its look-ahead and K its gain, as far as a maker says so. So both are identified while the path is played.
//!
//! The law is linear in (L, 1/K): r − q = L·q̇ + q̈/K. Both sides are passed through the same filter 1/(1 + τs)², whose states
//! give the derivatives of the filtered q; nothing is differentiated (state variable filters: Young, "Parameter estimation for
//! continuous-time models", 1981; Garnier and Wang, "Identification of Continuous-time Models from Sampled Data", 2008, 4). The
//! two numbers are then those of least squares with exponential forgetting (Åström and Wittenmark, "Adaptive Control", 1995,
//! 2.2), in the form of normal equations about what was assumed: these sums need no inverse to go on, cannot wind up, and
//! where the path tells nothing of one number, that stays what was assumed.
//!
//! **Dead time** and lag cannot be told apart on a smooth path: r(t − d) is r − d·ṙ + …, and d is found as a part of L. What is
//! configured as dead time is left as dead time; all the rest is compensated.

use crate::delay::Delay;
use crate::units::{JointAcc, JointPos, JointVel};

/// Most ticks of dead time.
pub const DEAD_TICKS_MAX: usize = 63;

/// Filter times to wait after a start before anything is learnt: e⁻⁸ of what the filter began with is left.
const SETTLING: f64 = 8.0;

/// One joint's drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// L (s).
    pub lag: f64,
    /// 1/K (s²).
    pub inverse_gain: f64,
}

impl Drive {
    /// A drive that is where it is told to be.
    pub const RIGID: Self = Self { lag: 0.0, inverse_gain: 0.0 };

    /// What to add to where the joint should be: L·q̇ + q̈/K (rad, m).
    pub const fn lead(&self, velocity: f64, acceleration: f64) -> f64 {
        self.lag * velocity + self.inverse_gain * acceleration
    }
}

/// The leads of all joints (rad, m).
pub fn lead<const N: usize>(drives: &[Drive; N], velocity: &JointVel<N>, acceleration: &JointAcc<N>) -> JointPos<N> {
    let mut lead = JointPos::ZERO;
    let motion = velocity.0.iter().zip(&acceleration.0);
    for ((lead, drive), (&velocity, &acceleration)) in lead.0.iter_mut().zip(drives).zip(motion) {
        *lead = drive.lead(velocity, acceleration);
    }
    lead
}

/// How drives are identified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learning {
    /// Least and greatest lag (s).
    pub lag: [f64; 2],
    /// Least and greatest 1/K (s²).
    pub inverse_gain: [f64; 2],
    /// From sending a target until it has its first effect on what the robot says of itself at a tick (s).
    pub dead_time: f64,
    /// τ of the filters (s): a few ticks, and not much longer than the drive's own times.
    pub filter_time: f64,
    /// Below this speed (rad/s, m/s) nothing is learnt.
    pub velocity_min: f64,
    /// How long what was learnt counts, in s of motion.
    pub memory: f64,
    /// What is wrong with a measured joint, and with the law (rad, m): the less, the faster what was assumed is given up.
    pub noise: f64,
    /// Time constant with which what is used follows what was learnt (s): leads shall not jump.
    pub adoption: f64,
}

/// Why nothing is identified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveError {
    /// Bounds that are not in order or negative, a time or noise that is not positive, a dead time beyond
    /// [`DEAD_TICKS_MAX`]; or a drive that is assumed outside the bounds. Correct the configuration.
    Configuration,
    /// A position or a time between ticks is not finite, or the time not positive. Start anew.
    NotFinite,
}

/// How far beyond its bounds a lag has to be asked for to be astray, as a share of their width: more than what noise does to a lag on
/// its bound.
const ASTRAY: f64 = 0.1;

/// A drive that is not what it can be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Astray {
    /// Joint, 0 for the first.
    pub joint: u8,
    /// The lag that its motion asks for (s).
    pub lag: f64,
    /// The bound beyond which that is (s).
    pub limit: f64,
}

/// The drives of N joints, as assumed and as learnt.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification<const N: usize> {
    learning: Learning,
    assumed: [Drive; N],
    learnt: [Drive; N],
    used: [Drive; N],
    sums: [Sums; N],
    filters: [Filters; N],
    sent: Delay<N, { DEAD_TICKS_MAX + 1 }>,
    /// Since the filters began (s); `None` before.
    since: Option<f64>,
    /// For how long each joint's motion has asked for a lag beyond the bounds (s of motion), and for which.
    astray: [(f64, f64); N],
}

/// The normal equations of one joint, about the assumed drive.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sums {
    vv: f64,
    va: f64,
    aa: f64,
    v: f64,
    a: f64,
}

/// 1/(1 + τs)² of r − q and of q.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Filters {
    ahead: Filter,
    position: Filter,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Filter {
    input: f64,
    once: f64,
    twice: f64,
}

impl Filter {
    const fn at(value: f64) -> Self {
        Self { input: value, once: value, twice: value }
    }

    /// One step by the bilinear rule, `ratio` being 2τ/h: filtered signal, and its first two derivatives. With y₁ behind the
    /// first lag and y₂ behind the second, ẏ₂ = (y₁ − y₂)/τ and ÿ₂ = (x − 2y₁ + y₂)/τ².
    fn step(&mut self, input: f64, ratio: f64, time: f64) -> [f64; 3] {
        let once = ((ratio - 1.0) * self.once + input + self.input) / (ratio + 1.0);
        self.twice = ((ratio - 1.0) * self.twice + once + self.once) / (ratio + 1.0);
        (self.input, self.once) = (input, once);
        [self.twice, (once - self.twice) / time, (input - 2.0 * once + self.twice) / (time * time)]
    }
}

impl Learning {
    /// Whether it can be used, with ticks of `period` s.
    pub fn is_valid(&self, period: f64) -> bool {
        let Self { lag, inverse_gain, dead_time, filter_time, velocity_min, memory, noise, adoption } = *self;
        let [shortest, longest] = lag;
        let [least, most] = inverse_gain;
        let positive = [filter_time, velocity_min, memory, noise, adoption, period];
        positive.iter().all(|value| value.is_finite() && *value > 0.0)
            && (0.0 <= shortest && shortest < longest && longest.is_finite())
            && (0.0 <= least && least < most && most.is_finite())
            && (0.0..=DEAD_TICKS_MAX as f64 * period).contains(&dead_time)
    }

    fn allows(&self, drive: &Drive) -> bool {
        let inside = |[low, high]: [f64; 2], value: f64| low <= value && value <= high;
        inside(self.lag, drive.lag) && inside(self.inverse_gain, drive.inverse_gain)
    }
}

impl<const N: usize> Identification<N> {
    /// Begins with what is assumed, for ticks of `period` s.
    ///
    /// # Errors
    /// [`DriveError::Configuration`]
    pub fn new(assumed: &[Drive; N], learning: &Learning, period: f64) -> Result<Self, DriveError> {
        if !learning.is_valid(period) || !assumed.iter().all(|drive| learning.allows(drive)) {
            return Err(DriveError::Configuration);
        }
        Ok(Self {
            learning: *learning,
            assumed: *assumed,
            learnt: *assumed,
            used: *assumed,
            sums: [Sums { vv: 0.0, va: 0.0, aa: 0.0, v: 0.0, a: 0.0 }; N],
            filters: [Filters { ahead: Filter::at(0.0), position: Filter::at(0.0) }; N],
            sent: Delay::at_rest(JointPos::ZERO),
            since: None,
            astray: [(0.0, 0.0); N],
        })
    }

    /// The drives to use now.
    pub const fn drives(&self) -> &[Drive; N] {
        &self.used
    }

    /// What has been learnt; [`Self::drives`] follow it.
    pub const fn learnt(&self) -> &[Drive; N] {
        &self.learnt
    }

    /// The first joint whose motion has asked for a lag beyond the bounds for as long as what is learnt counts. What is used stays
    /// inside them; a gain at its bound is none, as a slow path tells little of it.
    pub fn astray(&self) -> Option<Astray> {
        let Learning { lag: [low, high], memory, .. } = self.learning;
        let (joint, (_, lag)) = (0..).zip(self.astray.iter()).find(|(_, (time, _))| *time > memory)?;
        Some(Astray { joint, lag: *lag, limit: if *lag < low { low } else { high } })
    }

    /// The robot did not follow what was sent: what comes next begins anew. What was learnt stays.
    pub const fn pause(&mut self) {
        self.since = None;
        self.astray = [(0.0, 0.0); N];
    }

    /// What was sent at this tick, and where the joints were at its beginning (rad, m), `dt` s after the last.
    ///
    /// # Errors
    /// [`DriveError::NotFinite`]; the next call then begins anew.
    pub fn observe(&mut self, sent: &JointPos<N>, actual: &JointPos<N>, dt: f64) -> Result<(), DriveError> {
        if !(dt > 0.0 && dt.is_finite() && sent.is_finite() && actual.is_finite()) {
            self.pause();
            return Err(DriveError::NotFinite);
        }
        let Learning { filter_time, velocity_min, dead_time, adoption, .. } = self.learning;
        let Some(since) = self.since else {
            self.begin(sent, actual);
            return Ok(());
        };
        self.since = Some(since + dt);
        self.sent.push(sent);
        let effective = self.sent.before(dead_time / dt);
        let ratio = 2.0 * filter_time / dt;
        let share = -libm::expm1(-dt / adoption);
        let settled = since > SETTLING * filter_time;
        for joint in 0..N {
            let at = |joints: &JointPos<N>| joints.0.get(joint).copied();
            let (Some(target), Some(actual)) = (at(&effective), at(actual)) else { continue };
            let Some(filters) = self.filters.get_mut(joint) else { continue };
            let [ahead, ..] = filters.ahead.step(target - actual, ratio, filter_time);
            let [_, velocity, acceleration] = filters.position.step(actual, ratio, filter_time);
            if settled && libm::fabs(velocity) >= velocity_min {
                self.learn(joint, ahead, velocity, acceleration, dt);
            }
            if let (Some(used), Some(learnt)) = (self.used.get_mut(joint), self.learnt.get(joint)) {
                used.lag += share * (learnt.lag - used.lag);
                used.inverse_gain += share * (learnt.inverse_gain - used.inverse_gain);
            }
        }
        Ok(())
    }

    fn begin(&mut self, sent: &JointPos<N>, actual: &JointPos<N>) {
        for (filters, (sent, actual)) in self.filters.iter_mut().zip(sent.0.iter().zip(&actual.0)) {
            *filters = Filters { ahead: Filter::at(sent - actual), position: Filter::at(*actual) };
        }
        self.sent = Delay::at_rest(*sent);
        self.since = Some(0.0);
    }

    /// With δ what is to be added to the assumed drive, φ = (q̇, q̈) and y what the assumed drive leaves unexplained, the sum of
    /// (y − φ·δ)² over the past, forgotten by e^(−t/memory), plus (noise/σ·δ)², σ being half the width of the bounds, is least.
    fn learn(&mut self, joint: usize, ahead: f64, velocity: f64, acceleration: f64, dt: f64) {
        let Learning { lag, inverse_gain, memory, noise, .. } = self.learning;
        let (Some(sums), Some(assumed)) = (self.sums.get_mut(joint), self.assumed.get(joint)) else { return };
        let unexplained = ahead - assumed.lead(velocity, acceleration);
        let keep = libm::exp(-dt / memory);
        sums.vv = keep * sums.vv + velocity * velocity;
        sums.va = keep * sums.va + velocity * acceleration;
        sums.aa = keep * sums.aa + acceleration * acceleration;
        sums.v = keep * sums.v + velocity * unexplained;
        sums.a = keep * sums.a + acceleration * unexplained;
        let prior = |[low, high]: [f64; 2]| {
            let weight = 2.0 * noise / (high - low);
            weight * weight
        };
        let (vv, aa) = (sums.vv + prior(lag), sums.aa + prior(inverse_gain));
        // Positive, for the priors are.
        let determinant = vv * aa - sums.va * sums.va;
        let both = [aa * sums.v - sums.va * sums.a, vv * sums.a - sums.va * sums.v];
        let [dl, dk] = both.map(|value| value / determinant);
        let inside = |[low, high]: [f64; 2], value: f64| value.max(low).min(high);
        // A number on its bound leaves the other to be found alone.
        let found_lag = inside(lag, assumed.lag + dl);
        let rest = sums.a - sums.va * (found_lag - assumed.lag);
        let found_inverse =
            inside(inverse_gain, assumed.inverse_gain + if found_lag == assumed.lag + dl { dk } else { rest / aa });
        let rest = sums.v - sums.va * (found_inverse - assumed.inverse_gain);
        let found_lag =
            if found_inverse == assumed.inverse_gain + dk { found_lag } else { inside(lag, assumed.lag + rest / vv) };
        let [low, high] = lag;
        let (free, slack) = (assumed.lag + rest / vv, ASTRAY * (high - low));
        if let Some((time, asked)) = self.astray.get_mut(joint) {
            *time = if free < low - slack || free > high + slack { *time + dt } else { 0.0 };
            *asked = free;
        }
        if let Some(learnt) = self.learnt.get_mut(joint)
            && found_lag.is_finite()
            && found_inverse.is_finite()
        {
            *learnt = Drive { lag: found_lag, inverse_gain: found_inverse };
        }
    }
}

#[cfg(test)]
mod tests;
