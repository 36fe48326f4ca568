//! The measurement of a robot's controller: how fast the joints turn.

use super::{Ekf, EkfError, Verdict, positive};
use crate::units::JointVel;

impl<const N: usize> Ekf<N> {
    /// Corrects with measured joint velocities (rad/s, m/s) and their standard deviations (same units): H = \[0, I, 0\].
    ///
    /// # Errors
    /// [`EkfError`] for numbers that are not finite, deviations that are not positive, and a filter that has broken down.
    pub fn rates(&mut self, measured: &JointVel<N>, deviation: &JointVel<N>) -> Result<Verdict, EkfError> {
        positive(&deviation.0)?;
        if !measured.is_finite() {
            return Err(EkfError::NotFinite);
        }
        let p = self.covariance();
        let mut rows = [[[0.0; N]; 3]; N];
        let mut s = p.vv;
        let mut y = measured.0;
        for k in 0..N {
            for j in 0..N {
                rows[k][0][j] = p.qv[j][k];
            }
            rows[k][1] = p.vv[k];
            rows[k][2] = p.va[k];
            s[k][k] += deviation.0[k] * deviation.0[k];
            y[k] -= self.state().velocity.0[k];
        }
        self.correct(&mut rows, &mut s, y)
    }
}
