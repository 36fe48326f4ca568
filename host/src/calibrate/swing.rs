//! How far a set of poses turns each direction of the flange: what holds whatever is mounted there.

use super::CalibrateError;
use nalgebra::{Matrix3, Vector3};
use screed_kernel::pose::Pose;

/// A direction of the flange that swings less (root mean square, about rad) does not hold what lies along it: 3°.
pub const SWING_MIN: f64 = 0.05;

/// Root mean square distance of a unit vector, fixed to the flange, from its mean in the base: for the direction that
/// swings least. It is the smallest singular value of the R − R̄, stacked, over √count. Turns about one axis leave the
/// axis where it is, whatever their size; two axes swing every direction.
///
/// # Errors
/// [`CalibrateError::NoTurn`] and [`CalibrateError::OneAxis`] below [`SWING_MIN`].
pub(super) fn held(base_from_flange: impl Iterator<Item = Pose> + Clone) -> Result<f64, CalibrateError> {
    let count = base_from_flange.clone().count() as f64;
    let mean = base_from_flange.clone().map(|pose| pose.rotation).sum::<Matrix3<f64>>() / count;
    let moment: Matrix3<f64> =
        base_from_flange.map(|pose| (pose.rotation - mean).tr_mul(&(pose.rotation - mean))).sum();
    let eigen = (moment / count).symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let [swing, largest] = [eigen.eigenvalues.min(), eigen.eigenvalues.max()].map(|squared| squared.max(0.0).sqrt());
    if largest < SWING_MIN {
        return Err(CalibrateError::NoTurn);
    }
    if swing < SWING_MIN {
        let axis_in_flange: Vector3<f64> = eigen.eigenvectors.column(least).into_owned();
        return Err(CalibrateError::OneAxis { axis_in_flange, swing });
    }
    Ok(swing)
}
