//! Calibration from measurements: where a tool's tip is, where a tracker's target sits and the tracker stands, and what
//! an arm's geometry really is. `docs/calibration.md` has the mathematics, the sources and the limits. (A frame from
//! point pairs is the kernel's: [`screed_kernel::registration`].)
//!
//! Each calibration gives its estimate with a covariance and with the residuals of every measurement, and refuses
//! measurements that leave something undetermined, by naming what.

pub mod arm;
mod dependence;
mod error;
pub mod file;
pub mod frame;
mod least_squares;
pub mod pose_fit;
pub mod report;
mod swing;
pub mod target;
pub mod tcp;
#[cfg(test)]
mod tests;

pub use error::CalibrateError;

use serde::Serialize;

/// How well a model fits measurements whose noise is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Sum of squares of the residuals, each divided by its standard deviation.
    pub chi_squared: f64,
    /// How many residuals there are more than parameters.
    pub degrees: usize,
}

impl Fit {
    /// The residuals' size in units of the noise stated: √(χ²/degrees), near 1 when the noise is as stated and the
    /// model right.
    pub fn noise_ratio(&self) -> f64 {
        (self.chi_squared / self.degrees as f64).sqrt()
    }

    /// Where [`Self::noise_ratio`] lies in 95 of 100 cases when the noise is as stated: from the 2.5 % and 97.5 %
    /// points of χ², by Wilson and Hilferty, "The distribution of chi-square", PNAS 17, 1931. Within 0.5 % of the exact
    /// ones from 10 degrees on; with 3, the lower is 9 % too low.
    pub fn noise_ratio_band(&self) -> [f64; 2] {
        let degrees = self.degrees as f64;
        let point = |normal: f64| {
            let root = 1.0 - 2.0 / (9.0 * degrees) + normal * (2.0 / (9.0 * degrees)).sqrt();
            // χ² / degrees = root³.
            root.max(0.0).powi(3).sqrt()
        };
        [point(-1.959_964), point(1.959_964)]
    }
}
