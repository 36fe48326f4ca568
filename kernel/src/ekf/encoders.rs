//! The measurement of a robot's encoders: where the joints are.

use super::{Ekf, EkfError, Verdict, positive};
use crate::units::JointPos;

impl<const N: usize> Ekf<N> {
    /// Corrects with measured joint positions (rad, m) and their standard deviations (same units): H = \[I, 0, 0\]. An encoder
    /// knows nothing of a base that has moved nor of a link that bends: with a tracker beside it, its deviations have to
    /// cover what those make of a joint, or the pose has to come with the base as it is.
    ///
    /// # Errors
    /// [`EkfError`] for numbers that are not finite, deviations that are not positive, and a filter that has broken down.
    pub fn encoders(&mut self, measured: &JointPos<N>, deviation: &JointPos<N>) -> Result<Verdict, EkfError> {
        positive(&deviation.0)?;
        if !measured.is_finite() {
            return Err(EkfError::NotFinite);
        }
        let p = self.covariance();
        let mut rows = [[[0.0; N]; 3]; N];
        let mut s = p.qq;
        let mut y = measured.0;
        for k in 0..N {
            rows[k] = [p.qq[k], p.qv[k], p.qa[k]];
            s[k][k] += deviation.0[k] * deviation.0[k];
            y[k] -= self.state().position.0[k];
        }
        self.correct(&mut rows, &mut s, y)
    }
}
