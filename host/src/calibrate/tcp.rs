//! The tool centre point from a pivot: the tip touches one fixed point while the flange takes many poses.
//!
//! With R and t of each base_from_flange, x the tip in the flange and p the point in the base: R·x + t = p. Linear in x
//! and p, so least squares has one answer, and needs no start. It gives where the tip is, not which way the tool
//! points.

use super::least_squares::System;
use super::{CalibrateError, Fit, swing};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3};
use screed_kernel::pose::Pose;

/// The fewest touches: nine numbers for six unknowns.
pub const TOUCHES_MIN: usize = 3;

/// A tip found by touching a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Tcp {
    /// The tip in the flange frame (m).
    pub tip_in_flange: Vector3<f64>,
    /// The point touched, in the base frame (m).
    pub point_in_base: Vector3<f64>,
    /// Covariance (m²): rows and columns are tip_in_flange, then point_in_base.
    pub covariance: Matrix6<f64>,
    /// Standard deviation of one coordinate of a touch (m): the one given, or the one that the residuals show.
    pub sigma: f64,
    /// How well the touches agree with the noise given; `None` where it was taken from them.
    pub fit: Option<Fit>,
    /// What is left of each touch (m, in the base frame): where the tip was by these figures, less the point.
    pub residuals: Vec<Vector3<f64>>,
    /// How far the flange direction that swings least is turned (root mean square, about rad).
    pub swing: f64,
}

/// Finds the tip from the flange's poses at its touches. `sigma`: standard deviation of each coordinate by which a
/// touch misses the point (m); without it, the residuals tell.
///
/// # Errors
/// [`CalibrateError`] with too few touches, a number that is none, or turns that leave a direction open.
pub fn pivot(base_from_flange: &[Pose], sigma: Option<f64>) -> Result<Tcp, CalibrateError> {
    let found = base_from_flange.len();
    if found < TOUCHES_MIN {
        return Err(CalibrateError::TooFew { what: "touches", found, least: TOUCHES_MIN });
    }
    if let Some(measurement) = base_from_flange.iter().position(|pose| !pose.is_finite()) {
        return Err(CalibrateError::NotFinite { measurement });
    }
    if let Some(found) = sigma.filter(|sigma| !(*sigma > 0.0 && sigma.is_finite())) {
        return Err(CalibrateError::Noise { found });
    }
    let swing = swing::held(base_from_flange.iter().copied())?;
    let mut jacobian = DMatrix::zeros(3 * found, 6);
    let mut residual = DVector::zeros(3 * found);
    for (touch, pose) in base_from_flange.iter().enumerate() {
        jacobian.fixed_view_mut::<3, 3>(3 * touch, 0).copy_from(&pose.rotation);
        jacobian.fixed_view_mut::<3, 3>(3 * touch, 3).copy_from(&-Matrix3::identity());
        residual.fixed_rows_mut::<3>(3 * touch).copy_from(&-pose.translation);
    }
    let solved = System { jacobian, residual }.solved();
    let undetermined =
        || CalibrateError::Undetermined { parameters: vec!["the tip".to_owned(), "the point".to_owned()] };
    let solved = solved.ok_or_else(undetermined)?;
    let tip_in_flange = solved.step.fixed_rows::<3>(0).into_owned();
    let point_in_base = solved.step.fixed_rows::<3>(3).into_owned();
    let missed = |pose: &Pose| pose.transform_point(&tip_in_flange) - point_in_base;
    let residuals: Vec<_> = base_from_flange.iter().map(missed).collect();
    let squares: f64 = residuals.iter().map(Vector3::norm_squared).sum();
    let degrees = 3 * found - 6;
    let fit = sigma.map(|sigma| Fit { chi_squared: squares / (sigma * sigma), degrees });
    let sigma = sigma.unwrap_or((squares / degrees as f64).sqrt());
    let covariance = Matrix6::from_fn(|row, column| solved.covariance[(row, column)] * sigma * sigma);
    Ok(Tcp { tip_in_flange, point_in_base, covariance, sigma, fit, residuals, swing })
}
