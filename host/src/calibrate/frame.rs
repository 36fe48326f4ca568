//! A frame from point pairs: the kernel's registration, judged by its noise.

use super::{CalibrateError, Fit};
use nalgebra::{Matrix6, Vector3};
use screed_kernel::registration::{PointPair, Registration, register};

/// Where a mirror image leaves less than this share of what the best turn leaves, that is no chance: a frame is
/// left-handed, or points are swapped.
const MIRRORED: f64 = 0.2;

/// A frame, how well it is known, and what is left of each pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The pose, its levers and its largest residual.
    pub registration: Registration,
    /// Standard deviation of one coordinate of a pair (m): the one given, or the one that the residuals show.
    pub sigma: f64,
    /// How well the pairs agree with the noise given; `None` where it was taken from them.
    pub fit: Option<Fit>,
    /// Covariance of the pose, see [`Registration::covariance`].
    pub covariance: Matrix6<f64>,
    /// What is left of each pair (m, outer frame).
    pub residuals: Vec<Vector3<f64>>,
}

/// Finds the frame. `sigma`: standard deviation of each coordinate of a pair, both measurements together (m); without
/// it, the residuals tell.
///
/// # Errors
/// [`CalibrateError::Registration`] when the pairs hold no frame, [`CalibrateError::Mirrored`] when they fit a mirror
/// image.
pub fn fit(pairs: &[PointPair], sigma: Option<f64>) -> Result<Frame, CalibrateError> {
    if let Some(found) = sigma.filter(|sigma| !(*sigma > 0.0 && sigma.is_finite())) {
        return Err(CalibrateError::Noise { found });
    }
    let registration = register(pairs)?;
    let Registration { residual_rms, mirrored_rms, .. } = registration;
    if mirrored_rms < MIRRORED * residual_rms {
        return Err(CalibrateError::Mirrored { residual_rms, mirrored_rms });
    }
    let squares = residual_rms * residual_rms * pairs.len() as f64;
    let fit = |sigma| Fit { chi_squared: squares / (sigma * sigma), degrees: 3 * pairs.len() - 6 };
    let fit = sigma.map(fit);
    let sigma = sigma.unwrap_or(registration.sigma());
    Ok(Frame {
        registration,
        sigma,
        fit,
        covariance: registration.covariance(sigma),
        residuals: pairs.iter().map(|pair| registration.residual(pair)).collect(),
    })
}
