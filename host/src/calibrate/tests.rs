//! Planted frames come back within the covariance stated, on seeded noise; what is not determined is refused.

mod arm;
mod file;
mod random;
mod target;
mod tcp;

use super::Fit;

#[test]
fn the_band_is_that_of_the_tables() {
    // Points of χ² as printed in any table (NIST/SEMATECH e-Handbook of Statistical Methods, 1.3.6.7.4).
    for (degrees, low, high) in
        [(3_usize, 0.216, 9.348), (10, 3.247, 20.483), (30, 16.791, 46.979), (100, 74.222, 129.561)]
    {
        let band = Fit { chi_squared: 0.0, degrees }.noise_ratio_band();
        let tolerance = if degrees == 3 { 0.09 } else { 0.005 };
        for (found, point) in band.into_iter().zip([low, high]) {
            let expected = (point / degrees as f64).sqrt();
            assert!((found / expected - 1.0).abs() < tolerance, "{degrees}: {found} for {expected}");
        }
    }
}

/// Whether a mean over `runs` of sums of squares of `degrees` standard normal numbers is what chance allows in 95 of
/// 100 cases.
fn is_chi_squared(mean: f64, degrees: usize, runs: usize) -> bool {
    (mean - degrees as f64).abs() < 1.96 * (2.0 * degrees as f64 / runs as f64).sqrt()
}
