//! The measurement of a tracker: where its target is, position and rotation.

use super::covariance::Rows;
use super::{Ekf, EkfError, Verdict, add, positive};
use crate::arm::Arm;
use crate::pose::Pose;
use nalgebra::{Matrix3, Vector3};

/// How far RᵀR of a measured rotation may be from the identity: what single precision leaves of a unit quaternion.
const ORTHONORMAL: f64 = 1e-6;

/// One pose from a tracker (a "7-DoF" measurement is this and its stamp), and what ties it to the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedPose {
    /// What was measured.
    pub tracker_from_target: Pose,
    /// Where the arm's base is now.
    pub tracker_from_base: Pose,
    /// Where the target is mounted.
    pub flange_from_target: Pose,
    /// Standard deviation of the position, the same along each axis (m).
    pub position_deviation: f64,
    /// Standard deviation of the rotation vector, the same about each axis (rad).
    pub rotation_deviation: f64,
}

impl<const N: usize> Ekf<N> {
    /// Corrects with a tracked pose. The innovation is taken in the base frame: the difference of positions, and the rotation
    /// vector of R_measured·R_expectedᵀ. Small errors add up as vectors there, three numbers for three degrees of freedom,
    /// where four of a quaternion with their constraint would make R singular (Trawny and Roumeliotis, "Indirect Kalman
    /// filter for 3D attitude estimation", 2005, section 3). H is the geometric Jacobian of the target's origin. The noise
    /// is the same along all axes, so turning it into the base frame leaves it as it is.
    ///
    /// # Errors
    /// [`EkfError`] for input that is no pose, for deviations that are not positive, and for a filter that has broken down.
    pub fn pose(&mut self, arm: &Arm<N>, measured: &TrackedPose) -> Result<Verdict, EkfError> {
        positive(&[measured.position_deviation, measured.rotation_deviation])?;
        let base_from_target = measured.tracker_from_base.inverse() * measured.tracker_from_target;
        rotation_is_sound(&base_from_target.rotation)?;
        let (base_from_flange, mut jacobian) = arm.jacobian(&self.state().position);
        let expected = base_from_flange * measured.flange_from_target;
        let lever = expected.translation - base_from_flange.translation;
        let position = base_from_target.translation - expected.translation;
        let turn =
            Pose { rotation: base_from_target.rotation * expected.rotation.transpose(), translation: Vector3::zeros() };
        let rotation = turn.rotation_vector();
        let y = [position.x, position.y, position.z, rotation.x, rotation.y, rotation.z];
        if !y.iter().all(|value| value.is_finite()) {
            return Err(EkfError::NotFinite);
        }
        // The target moves with the flange's origin and turns about it.
        let columns = &mut jacobian.data.0;
        for [vx, vy, vz, wx, wy, wz] in &mut *columns {
            let around = Vector3::new(*wx, *wy, *wz).cross(&lever);
            *vx += around.x;
            *vy += around.y;
            *vz += around.z;
        }
        let mut rows = self.pose_rows(columns);
        let (place, turn) = (measured.position_deviation, measured.rotation_deviation);
        let mut s = spread(columns, &rows);
        let [bend_place, bend_turn] = bend(&s);
        let (p, r) = (place * place + bend_place, turn * turn + bend_turn);
        for (k, variance) in (0..6).zip([p, p, p, r, r, r]) {
            s[k][k] += variance;
        }
        self.correct(&mut rows, &mut s, y)
    }

    /// H·P = J·\[P_qq, P_qv, P_qa\], J given by its columns.
    fn pose_rows(&self, columns: &[[f64; 6]; N]) -> Rows<N, 6> {
        let p = self.covariance();
        let mut rows = [[[0.0; N]; 3]; 6];
        for (k, [q, v, a]) in rows.iter_mut().enumerate() {
            for i in 0..N {
                let factor = columns[i][k];
                add(q, &p.qq[i], factor);
                add(v, &p.qv[i], factor);
                add(a, &p.qa[i], factor);
            }
        }
        rows
    }
}

/// H·P·Hᵀ of rows H·P, on and above the diagonal; below it what comes with whole vectors.
#[inline(always)]
fn spread<const N: usize>(columns: &[[f64; 6]; N], rows: &Rows<N, 6>) -> [[f64; 6]; 6] {
    let mut s = [[0.0; 6]; 6];
    let mut add_row = |k: usize, first: usize| {
        for (column, factor) in columns.iter().zip(&rows[k][0]) {
            add(&mut s[k][first..], &column[first..], *factor);
        }
    };
    for k in 0..2 {
        add_row(k, 0);
    }
    for k in 2..6 {
        add_row(k, 2);
    }
    s
}

/// What h(x) bends away from its tangent, as variances of position (m²) and rotation (rad²), given H·P·Hᵀ. The second-order term
/// of a turn by ρ is up to ρ²/2, that of a way λ on an arc which turns by ρ is λ·ρ/2; H·P·Hᵀ has the squares of both. Second-order
/// filters add such a term to R (Jazwinski, "Stochastic Processes and Filtering Theory", 1970, 9.3); next to nothing for a filter
/// that follows, it keeps one that was uncertain from believing its first pose too much, and from gating what comes after.
#[inline(always)]
pub(crate) fn bend(s: &[[f64; 6]; 6]) -> [f64; 2] {
    let (way, turn) = (s[0][0] + s[1][1] + s[2][2], s[3][3] + s[4][4] + s[5][5]);
    [0.25 * way * turn, 0.25 * turn * turn]
}

/// Whether it is orthonormal, and finite with it.
pub(crate) fn rotation_is_sound(rotation: &Matrix3<f64>) -> Result<(), EkfError> {
    for miss in (rotation.tr_mul(rotation) - Matrix3::identity()).iter() {
        let miss = libm::fabs(*miss);
        if miss.is_nan() || miss > ORTHONORMAL {
            return Err(EkfError::Rotation { miss });
        }
    }
    Ok(())
}
