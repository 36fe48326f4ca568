//! A PID controller for each joint: true time between ticks, filtered derivative, back-calculation, no bump.
//!
//! With the error e, the gains k_p, k_i, k_d, the derivative's filter time T_f and the tracking time T_t, tick k being h s
//! after the one before (Åström and Murray, "Feedback Systems", 2008, 10.5; Åström and Hägglund, "Advanced PID Control",
//! 2006, 13.3 and 3.5):
//!
//! - P_k = k_p·e_k
//! - D_k = T_f/(T_f + h)·D_(k−1) + k_d/(T_f + h)·(e_k − e_(k−1)), backward differences: stable for every h and T_f
//! - I_k = I_(k−1) + k_i·h·e_k, and v_k = P_k + I_k + D_k is what is wanted
//! - I_k ← I_k + (1 − e^(−h/T_t))·(u_k − v_k), u_k being what was really put out: back-calculation, exact for any h, so that
//!   a long tick does not overshoot
//!
//! **The derivative is that of the error**, not of the measurement alone. The usual reason against it, steps of the setpoint,
//! is none here: the reference is a path within limits of jerk. One of the measurement alone would pull against all motion.
//!
//! The integral is kept as an output, k_i and all: a new k_i moves nothing. What new k_p, k_d would move, the integral takes
//! up ([`Pid::set_gains`]), and the same way it begins from what is already put out ([`Pid::start`]).

use crate::drive::Drive;
use crate::units::JointPos;

/// Longest time between ticks that is integrated over (s). Whoever has not controlled for longer has to start anew.
pub const DT_MAX: f64 = 1.0;

/// The gains of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// k_p, without unit: error and output are both rad or m.
    pub proportional: f64,
    /// k_i (1/s).
    pub integral: f64,
    /// k_d (s).
    pub derivative: f64,
    /// T_f (s), more than 0.
    pub filter_time: f64,
    /// T_t (s), more than 0: how fast the integral lets go of what is not put out.
    pub tracking_time: f64,
}

impl Gains {
    /// No feedback.
    pub const NONE: Self =
        Self { proportional: 0.0, integral: 0.0, derivative: 0.0, filter_time: 1.0, tracking_time: 1.0 };

    /// Gains for a drive q̈ = K·(r − q − L·q̇) such that the loop crosses 1 at `crossover` (rad/s), by its zeros on the drive's
    /// poles: C = ω·(1/s + L + s/K)/(1 + T_f·s) leaves the loop ω·e^(−ds)/(s·(1 + T_f·s)), d being all its dead time (internal
    /// model control: Rivera, Morari, Skogestad, "Internal model control 4. PID controller design", 1986). Its phase margin is
    /// 90° − ω·(d + T_f) in rad and its gain margin at least π/2/(ω·(d + T_f)): with ω·(d + T_f) ≤ 0.5, 61° and 9.9 dB.
    pub const fn for_drive(drive: &Drive, crossover: f64, filter_time: f64) -> Self {
        let Drive { lag, inverse_gain } = *drive;
        Self {
            // k_d and T_f act on the derivative only; what the filter takes from P and I, it leaves here.
            proportional: crossover * (lag - filter_time),
            integral: crossover,
            derivative: crossover * (inverse_gain - filter_time * (lag - filter_time)),
            filter_time,
            tracking_time: lag,
        }
    }

    /// Whether these are gains: none negative but the derivative, which may be, the times positive, all finite.
    pub fn is_valid(&self) -> bool {
        let Self { proportional, integral, derivative, filter_time, tracking_time } = *self;
        let at_least_zero = [proportional, integral].iter().all(|gain| gain.is_finite() && *gain >= 0.0);
        let positive = [filter_time, tracking_time].iter().all(|time| time.is_finite() && *time > 0.0);
        at_least_zero && positive && derivative.is_finite()
    }
}

/// Which set of gains and bounds: what is being done decides how stiff the loop may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Process {
    /// Material is laid down.
    Deposit,
    /// The tool moves free.
    Travel,
    /// The tool cuts.
    Mill,
}

/// One value for each [`Process`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ByProcess<T> {
    /// For [`Process::Deposit`].
    pub deposit: T,
    /// For [`Process::Travel`].
    pub travel: T,
    /// For [`Process::Mill`].
    pub mill: T,
}

impl<T> ByProcess<T> {
    /// The value for one.
    pub const fn of(&self, process: Process) -> &T {
        match process {
            Process::Deposit => &self.deposit,
            Process::Travel => &self.travel,
            Process::Mill => &self.mill,
        }
    }
}

/// Why a tick was not controlled; nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PidError {
    /// Gains that [`Gains::is_valid`] refuses. Correct the configuration.
    Gains,
    /// The error is NaN or infinite. Give numbers.
    NotFinite,
    /// A time between ticks has to be more than 0 and at most [`DT_MAX`]. Start anew.
    Step {
        /// What was given (s).
        dt: f64,
    },
}

/// The controller of N joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pid<const N: usize> {
    gains: [Gains; N],
    joints: [Terms; N],
    /// Time of the last step (s).
    dt: f64,
}

/// One joint at the last tick.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Terms {
    error: f64,
    integral: f64,
    derivative: f64,
    /// v, what was wanted.
    wanted: f64,
}

impl Terms {
    const NONE: Self = Self { error: 0.0, integral: 0.0, derivative: 0.0, wanted: 0.0 };
}

impl<const N: usize> Pid<N> {
    /// At rest, nothing put out.
    ///
    /// # Errors
    /// [`PidError::Gains`]
    pub fn new(gains: &[Gains; N]) -> Result<Self, PidError> {
        if !gains.iter().all(Gains::is_valid) {
            return Err(PidError::Gains);
        }
        Ok(Self { gains: *gains, joints: [Terms::NONE; N], dt: 0.0 })
    }

    /// Begins at this error so that the next step wants just `output` (rad, m), if the error stays: on without a bump.
    ///
    /// # Errors
    /// [`PidError::NotFinite`]
    pub fn start(&mut self, error: &JointPos<N>, output: &JointPos<N>) -> Result<(), PidError> {
        if !error.is_finite() || !output.is_finite() {
            return Err(PidError::NotFinite);
        }
        for (((terms, gains), &error), &output) in self.joints.iter_mut().zip(&self.gains).zip(&error.0).zip(&output.0)
        {
            *terms = Terms { error, integral: output - gains.proportional * error, derivative: 0.0, wanted: output };
        }
        Ok(())
    }

    /// Takes other gains; what is put out stays, were the error to stay.
    ///
    /// # Errors
    /// [`PidError::Gains`]
    pub fn set_gains(&mut self, gains: &[Gains; N]) -> Result<(), PidError> {
        if !gains.iter().all(Gains::is_valid) {
            return Err(PidError::Gains);
        }
        for ((terms, old), new) in self.joints.iter_mut().zip(&self.gains).zip(gains) {
            terms.integral += (old.proportional - new.proportional) * terms.error;
        }
        self.gains = *gains;
        Ok(())
    }

    /// The gains.
    pub const fn gains(&self) -> &[Gains; N] {
        &self.gains
    }

    /// What is to be put out (rad, m) at this error (rad, m), `dt` s after the last step. Say afterwards what was:
    /// [`Self::put_out`]. While something else than this controller holds the output back, the error is not for the integral:
    /// then without `integrate` it stays as it is.
    ///
    /// # Errors
    /// [`PidError::NotFinite`], [`PidError::Step`]
    pub fn step(&mut self, error: &JointPos<N>, dt: f64, integrate: bool) -> Result<JointPos<N>, PidError> {
        if !(dt > 0.0 && dt <= DT_MAX) {
            return Err(PidError::Step { dt });
        }
        if !error.is_finite() {
            return Err(PidError::NotFinite);
        }
        let mut wanted = JointPos::ZERO;
        for (((terms, gains), &error), out) in self.joints.iter_mut().zip(&self.gains).zip(&error.0).zip(&mut wanted.0)
        {
            let Gains { proportional, integral, derivative, filter_time, .. } = *gains;
            let rise = derivative * (error - terms.error);
            terms.derivative = (filter_time * terms.derivative + rise) / (filter_time + dt);
            if integrate {
                terms.integral += integral * dt * error;
            }
            terms.error = error;
            terms.wanted = proportional * error + terms.integral + terms.derivative;
            *out = terms.wanted;
        }
        self.dt = dt;
        Ok(wanted)
    }

    /// What was put out (rad, m) of what the last step wanted: where that was less, the integral lets go.
    ///
    /// # Errors
    /// [`PidError::NotFinite`]
    pub fn put_out(&mut self, output: &JointPos<N>) -> Result<(), PidError> {
        if !output.is_finite() {
            return Err(PidError::NotFinite);
        }
        for ((terms, gains), &output) in self.joints.iter_mut().zip(&self.gains).zip(&output.0) {
            let share = -libm::expm1(-self.dt / gains.tracking_time);
            terms.integral += share * (output - terms.wanted);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
