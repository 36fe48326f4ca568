//! Where the joints really are: an extended Kalman filter over joint positions, velocities and accelerations.
//!
//! It is the filter of Tables 2 and 3 of the KRAKEN paper ("An all-in-one robotic platform for hybrid manufacturing of large volume parts", section 3.2): state
//! x = \[θ, θ̇, θ̈\], a constant acceleration driven by white jerk, F = I + T·M + T²/2·M². Five things differ, and
//! docs/estimation.md derives them: the commanded jerk is a known input; a pose is compared by six numbers, position and
//! rotation vector, and not by position and quaternion (Trawny and Roumeliotis 2005); encoder angles are a measurement; a gate; and
//! a measurement that is not believed changes nothing, where Table 3 as printed shrinks P all the same.
//!
//! Each measurement has a file of its own ([`pose`], [`rates`], [`encoders`]); all end in one update. F is made of
//! multiples of the identity, so P is kept and moved on in N by N blocks ([`covariance`]).

// In matrices an index says more than a chain of iterators does.
#![allow(clippy::needless_range_loop)]

pub mod covariance;
pub mod encoders;
mod factor;
pub mod pose;
pub mod rates;
pub mod replay;

use crate::units::{JointAcc, JointJerk, JointPos, JointVel};
use covariance::{Covariance, Rows};
use factor::separate;

/// Longest step of a prediction (s). Whoever has heard nothing for longer has to start anew.
pub const STEP_MAX: f64 = 10.0;

/// Largest count of numbers in one measurement: the joints of an arm.
const ROWS_MAX: usize = 9;

/// Where the χ² distribution of 1 to 9 degrees of freedom has one part in 100,000 above it. A measurement whose normalised
/// innovation squared is larger is not believed. At a kilohertz that drops a good one in 100 s; a gate of 0.1 %, as tables have it,
/// drops one a second, and those that it drops are not independent: innovations are no longer white.
pub const GATES: [f64; ROWS_MAX] = [19.511, 23.026, 25.902, 28.473, 30.856, 33.107, 35.259, 37.332, 39.341];

/// How the joints move at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<const N: usize> {
    /// θ (rad, m).
    pub position: JointPos<N>,
    /// θ̇ (rad/s, m/s).
    pub velocity: JointVel<N>,
    /// θ̈ (rad/s², m/s²).
    pub acceleration: JointAcc<N>,
}

impl<const N: usize> State<N> {
    /// At rest there.
    pub const fn at_rest(position: JointPos<N>) -> Self {
        Self { position, velocity: JointVel::ZERO, acceleration: JointAcc::ZERO }
    }

    /// After `dt` s with this jerk throughout: x ← F·x + \[T³/6, T²/2, T\]·j, exact for a constant jerk. For a command that
    /// acts some time from now, this is where it will find the joints.
    #[must_use]
    pub fn after(&self, dt: f64, jerk: &JointJerk<N>) -> Self {
        let half = 0.5 * dt * dt;
        let sixth = half * dt / 3.0;
        let mut next = *self;
        let ends = next.position.0.iter_mut().zip(&mut next.velocity.0).zip(&mut next.acceleration.0).zip(&jerk.0);
        for (((q, v), a), j) in ends {
            *q += dt * *v + half * *a + sixth * j;
            *v += dt * *a + half * j;
            *a += dt * j;
        }
        next
    }

    /// Whether no component is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.velocity.is_finite() && self.acceleration.is_finite()
    }
}

/// What became of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// The state has moved towards it.
    Taken {
        /// Normalised innovation squared, yᵀ·S⁻¹·y: χ² with as many degrees of freedom as the measurement has numbers.
        nis: f64,
    },
    /// It lies too far from what was expected; neither the state nor its covariance has changed.
    Gated {
        /// Normalised innovation squared.
        nis: f64,
        /// The gate it did not pass, of [`GATES`].
        gate: f64,
    },
}

impl Verdict {
    /// Normalised innovation squared.
    pub const fn nis(&self) -> f64 {
        match *self {
            Self::Taken { nis } | Self::Gated { nis, .. } => nis,
        }
    }

    /// Whether the measurement was believed.
    pub const fn is_taken(&self) -> bool {
        matches!(self, Self::Taken { .. })
    }
}

/// Why the filter did not do what was asked; it has not changed then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EkfError {
    /// A number of the input is NaN or infinite. Give numbers.
    NotFinite,
    /// A step has to be more than 0 and at most [`STEP_MAX`]. Correct the stamps, or start anew.
    Step {
        /// What was asked for (s).
        dt: f64,
    },
    /// A standard deviation has to be positive, a jerk density too. Correct the configuration.
    Noise {
        /// What was given.
        value: f64,
    },
    /// The measured rotation is not orthonormal. Normalise the quaternion it was made from.
    Rotation {
        /// A component of RᵀR − I (absolute).
        miss: f64,
    },
    /// The covariance of the innovation is not positive definite: the filter's numbers have broken down. Start anew.
    Unsound,
}

/// The filter: an estimate and how good it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ekf<const N: usize> {
    state: State<N>,
    covariance: Covariance<N>,
    /// Spectral density of the white jerk, joint by joint (rad²/s⁵, m²/s⁵).
    jerk_density: [f64; N],
}

impl<const N: usize> Ekf<N> {
    /// A filter that begins at `state`, each component uncertain by the standard deviation at its place in `deviation`,
    /// independent of the others. `jerk_density` says how far the joints' motion strays from the commanded one: the spectral
    /// density q̃ of a white jerk (rad²/s⁵, m²/s⁵), √(q̃·T) being how much an acceleration drifts in T s.
    ///
    /// # Errors
    /// [`EkfError::NotFinite`] for the state, [`EkfError::Noise`] for a deviation or density that is not positive.
    pub fn new(state: State<N>, deviation: &State<N>, jerk_density: &[f64; N]) -> Result<Self, EkfError> {
        if !state.is_finite() {
            return Err(EkfError::NotFinite);
        }
        let State { position, velocity, acceleration } = deviation;
        for values in [&position.0, &velocity.0, &acceleration.0, jerk_density] {
            positive(values)?;
        }
        Ok(Self { state, covariance: Covariance::diagonal(deviation), jerk_density: *jerk_density })
    }

    /// The estimate.
    pub const fn state(&self) -> &State<N> {
        &self.state
    }

    /// How good it is.
    pub const fn covariance(&self) -> &Covariance<N> {
        &self.covariance
    }

    /// Moves on by `dt` s: x ← F·x + G·u, P ← F·P·Fᵀ + Q. The input u is the jerk that was commanded for this time (mean over
    /// it: the change of the commanded acceleration by `dt`), zero where nothing is known of it; Q is the rest.
    ///
    /// # Errors
    /// [`EkfError::Step`], or [`EkfError::NotFinite`] for the jerk and for a state that would overflow.
    pub fn predict(&mut self, dt: f64, jerk: &JointJerk<N>) -> Result<(), EkfError> {
        if !(dt > 0.0 && dt <= STEP_MAX) {
            return Err(EkfError::Step { dt });
        }
        let state = self.state.after(dt, jerk);
        if !state.is_finite() {
            return Err(EkfError::NotFinite);
        }
        self.state = state;
        self.covariance.step(dt, &self.jerk_density);
        Ok(())
    }

    /// The update that all measurements share, given `rows` = H·P, the upper triangle of S = H·P·Hᵀ + R, and the innovation
    /// y = z − h(x). With S = UᵀDU it takes the innovation apart into independent numbers e = U⁻ᵀ·y of variances D, whose rows are
    /// W = U⁻ᵀ·H·P: the normalised innovation squared is eᵀD⁻¹e, x ← x + Wᵀ·D⁻¹·e, P ← P − WᵀD⁻¹W (Bierman, "Factorization
    /// Methods for Discrete Sequential Estimation", 1977, chapters II and V). No inverse of a matrix is formed, and P stays
    /// symmetric to the bit.
    #[inline(always)]
    fn correct<const M: usize>(
        &mut self,
        rows: &mut Rows<N, M>,
        s: &mut [[f64; M]; M],
        mut y: [f64; M],
    ) -> Result<Verdict, EkfError> {
        let (verdict, weights) = judge(rows, s, &mut y)?;
        if !verdict.is_taken() {
            return Ok(verdict);
        }
        let State { position, velocity, acceleration } = &mut self.state;
        for ([q, v, a], e) in rows.iter().zip(y) {
            add(&mut position.0, q, e);
            add(&mut velocity.0, v, e);
            add(&mut acceleration.0, a, e);
        }
        self.covariance.reduce(rows, &weights);
        Ok(verdict)
    }
}

/// Takes an innovation y with S = UᵀDU apart as [`separate`] does, `rows` = H·P being in pieces, and holds it against its gate.
/// Returns the verdict and 1/D; `y` becomes D⁻¹U⁻ᵀ·y.
#[inline(always)]
pub(crate) fn judge<const N: usize, const PIECES: usize, const M: usize>(
    rows: &mut [[[f64; N]; PIECES]; M],
    s: &mut [[f64; M]; M],
    y: &mut [f64; M],
) -> Result<(Verdict, [f64; M]), EkfError> {
    let gate = const { GATES[M - 1] };
    let weights = separate(s, rows, y)?;
    let mut nis = 0.0;
    for (e, weight) in y.iter_mut().zip(&weights) {
        let weighted = *e * weight;
        nis += *e * weighted;
        *e = weighted;
    }
    if !nis.is_finite() {
        return Err(EkfError::NotFinite);
    }
    Ok((if nis > gate { Verdict::Gated { nis, gate } } else { Verdict::Taken { nis } }, weights))
}

/// a ← a + factor·b.
#[inline(always)]
pub(crate) fn add(a: &mut [f64], b: &[f64], factor: f64) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += factor * b;
    }
}

/// a ← a − factor·b.
#[inline(always)]
pub(crate) fn subtract(a: &mut [f64], b: &[f64], factor: f64) {
    for (a, b) in a.iter_mut().zip(b) {
        *a -= factor * b;
    }
}

/// Whether all are finite and more than zero.
#[inline(always)]
pub(crate) fn positive(values: &[f64]) -> Result<(), EkfError> {
    for &value in values {
        if !(value > 0.0 && value <= f64::MAX) {
            return Err(EkfError::Noise { value });
        }
    }
    Ok(())
}
