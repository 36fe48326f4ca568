//! How a base swings about its place of rest, which is what the correction follows.
//!
//! An arm that follows a swing drives it: what the arm's acceleration does to its base is −μ·s²/(s² + 2ζω₀s + ω₀²), with μ the
//! share of the mass that the arm moves, so the loop through a base that is followed by F(s) is
//! L(s) = −μ·s²·F(s)/(s² + 2ζω₀s + ω₀²). With F = 1 that is μ/2ζ at the swing's frequency, far above one on a crane. So the
//! estimate holds swing and place of rest apart, and the arm follows the place alone. Whatever the filter's gains are, F has
//! zeros where the modelled swing has its poles (Franklin, Powell, Emami-Naeini, "Feedback Control of Dynamic Systems", 7.5: what
//! an observer explains by one state it does not see in another), and the resonance is gone from the loop. A frequency that is
//! wrong by a share ε leaves about ε·μ/2ζ of it.

use super::BaseError;
use super::estimate::Displacement;
use nalgebra::Vector3;

/// How the base swings along or about one axis: ẍ = −ω₀²·x − 2ζω₀·ẋ + white noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwingMode {
    /// Undamped natural frequency ω₀ (rad/s).
    pub frequency: f64,
    /// Damping ratio ζ, above 0 and below 1.
    pub damping: f64,
    /// Standard deviation of the swing (m, rad); 0 where it does not swing.
    pub deviation: f64,
}

/// How the base swings: six axes that do not act on one another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// The point about which it turns without being shifted (m, in the nominal base frame).
    pub centre: Vector3<f64>,
    /// Along x, y, z of the nominal base frame, and about them.
    pub modes: [SwingMode; 6],
}

/// What a time does to swing and rate: swing from swing and from rate, rate from swing and from rate, axis by axis.
pub(super) type Turns = [[[f64; 6]; 2]; 2];

impl SwingMode {
    /// None.
    pub const STILL: Self = Self { frequency: 1.0, damping: 0.5, deviation: 0.0 };

    /// exp(A·dt) of a damped oscillator.
    fn turn(&self, dt: f64) -> [[f64; 2]; 2] {
        let Self { frequency, damping, .. } = *self;
        let (decay, turning) = (damping * frequency, frequency * libm::sqrt(1.0 - damping * damping));
        let (sin, cos) = libm::sincos(turning * dt);
        let (left, part) = (libm::exp(-decay * dt), sin / turning);
        [
            [left * (cos + decay * part), left * part],
            [-left * frequency * frequency * part, left * (cos - decay * part)],
        ]
    }
}

impl Swing {
    /// A base that does not swing.
    pub const NONE: Self = Self { centre: Vector3::new(0.0, 0.0, 0.0), modes: [SwingMode::STILL; 6] };

    pub(super) fn check(&self) -> Result<(), BaseError> {
        for mode in &self.modes {
            for (field, value, is_valid) in [
                ("swing.frequency", mode.frequency, mode.frequency > 0.0),
                ("swing.damping", mode.damping, mode.damping > 0.0 && mode.damping < 1.0),
                ("swing.deviation", mode.deviation, mode.deviation >= 0.0),
            ] {
                if !(is_valid && value.is_finite()) {
                    return Err(BaseError::Config { field, value });
                }
            }
        }
        for value in self.centre.iter() {
            if !value.is_finite() {
                return Err(BaseError::Config { field: "swing.centre", value: *value });
            }
        }
        Ok(())
    }

    /// Whether it swings at all.
    pub(super) fn swings(&self) -> bool {
        self.modes.iter().any(|mode| mode.deviation > 0.0)
    }

    pub(super) fn turns(&self, dt: f64) -> Turns {
        let mut turns = [[[0.0; 6]; 2]; 2];
        let [[aa, ab], [ba, bb]] = &mut turns;
        let axes = aa.iter_mut().zip(ab).zip(ba.iter_mut().zip(bb));
        for (((aa, ab), (ba, bb)), mode) in axes.zip(&self.modes) {
            if mode.deviation > 0.0 {
                [[*aa, *ab], [*ba, *bb]] = mode.turn(dt);
            }
        }
        turns
    }

    /// Variances of swing and rate, when it has always swung: σ² and σ²ω₀².
    pub(super) fn variances(&self) -> [[f64; 6]; 2] {
        let swing = self.modes.map(|mode| mode.deviation * mode.deviation);
        let rate = self.modes.map(|mode| mode.deviation * mode.deviation * mode.frequency * mode.frequency);
        [swing, rate]
    }

    /// From the centre to the pivot.
    pub(super) fn lever(&self, pivot: &Vector3<f64>) -> Vector3<f64> {
        pivot - self.centre
    }
}

/// Swing and rate a time later.
pub(super) fn swung(turns: &Turns, swing: &Displacement, rate: &Displacement) -> [Displacement; 2] {
    let (swing, rate) = (swing.array(), rate.array());
    turns.map(|[from_swing, from_rate]| {
        Displacement::of(&core::array::from_fn(|k| from_swing[k] * swing[k] + from_rate[k] * rate[k]))
    })
}
