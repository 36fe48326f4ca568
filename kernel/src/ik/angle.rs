//! The angle of a pair of numbers: what the closed forms do most.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// (atan x − x) / x³ as a polynomial in x², lowest power first, for |x| ≤ tan 22.5°: Chebyshev interpolation in 40 digits; its
/// error is 5e-18 of atan x.
const COEFFICIENTS: [f64; 11] = [
    -0.3333333333333333,
    0.19999999999995516,
    -0.1428571428466568,
    0.11111111015187006,
    -0.09090904575306077,
    0.07692183125369063,
    -0.06664510525415601,
    0.058581409041635196,
    -0.050854078313439584,
    0.0392304477008921,
    -0.01917540461813167,
];

/// tan 22.5°.
const OCTANT: f64 = core::f64::consts::SQRT_2 - 1.0;

/// The angle (rad) of the direction (cosine, sine) times any length, in [−π, π]: what `libm::atan2` gives to 9e-16, in fewer
/// steps. Both finite; of two zeros the angle is zero.
///
/// The direction is reflected into the first octant, and from its upper half turned back by 45°; that leaves one quotient and
/// one polynomial.
pub(super) fn angle_of(sine: f64, cosine: f64) -> f64 {
    let (rise, run) = (libm::fabs(sine), libm::fabs(cosine));
    let steep = rise > run;
    let (low, high) = if steep { (run, rise) } else { (rise, run) };
    let upper = low > OCTANT * high;
    let (opposite, adjacent) = if upper { (low - high, low + high) } else { (low, high) };
    if adjacent == 0.0 {
        return 0.0;
    }
    let x = opposite / adjacent;
    let z = x * x;
    let polynomial = COEFFICIENTS.iter().rev().fold(0.0, |sum, coefficient| sum * z + coefficient);
    let own = x + x * z * polynomial;
    // Reflected back; one sum, so one rounding.
    let base = if upper { FRAC_PI_4 } else { 0.0 };
    let (base, own) = if steep { (FRAC_PI_2 - base, -own) } else { (base, own) };
    let angle = if cosine < 0.0 { PI - base - own } else { base + own };
    if sine < 0.0 { -angle } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_arc_tangent() {
        let mut worst = 0.0_f64;
        for k in 0..1_000_000 {
            let turn = f64::from(k) * 1e-6 * 2.0 * PI - PI;
            let (sine, cosine) = libm::sincos(turn);
            let length = libm::exp(libm::sin(f64::from(k)) * 30.0);
            worst = worst.max(libm::fabs(angle_of(sine * length, cosine * length) - libm::atan2(sine, cosine)));
        }
        assert!(worst < 9e-16, "{worst:e}");
        for power in 0..300 {
            let small = libm::pow(10.0, -f64::from(power));
            for (sine, cosine) in
                [(small, 1.0), (1.0, small), (-small, 1.0), (1.0, -small), (small, -1.0), (-1.0, -small)]
            {
                let (found, expected) = (angle_of(sine, cosine), libm::atan2(sine, cosine));
                assert!(libm::fabs(found - expected) <= 4.5e-16 * libm::fabs(expected), "{sine} {cosine}: {found}");
            }
        }
        assert_eq!(angle_of(0.0, 0.0), 0.0);
        assert_eq!([angle_of(0.0, 1.0), angle_of(1.0, 0.0), angle_of(0.0, -1.0)], [0.0, FRAC_PI_2, PI]);
        assert!(angle_of(f64::NAN, 1.0).is_nan() && angle_of(1.0, f64::NAN).is_nan());
    }
}
