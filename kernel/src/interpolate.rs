//! The path between samples: passes through every sample, continuous to the second derivative, from six samples at a time.

/// Quintic Hermite interpolation at `t` in 0 to 1 between the middle two of six equidistant samples, in units of the sample
/// period (the basis is the usual one, e.g. Biagiotti and Melchiorri, "Trajectory Planning for Automatic Machines and
/// Robots", 2.1.7). At a sample q₀ its derivatives are
///
/// - v = (q₁ − q₋₁)/2 − (q₂ − 2q₁ + 2q₋₁ − q₋₂)/12, the five-point formula, so that cubics are reproduced exactly;
/// - a = Δ²q₀ − Δ⁴q₀/3. On cubics every weight of Δ⁴ does; 1/12 would follow quartics too, but make up to 7 times the
///   samples' jerk where that jumps. 1/3 keeps it below 4 ([`JERK_GAIN`]); no interpolant can keep it below 3 (Favard).
pub fn interpolate(q: [f64; 6], t: f64) -> f64 {
    let [c0, c1, c2, c3, c4, c5] = coefficients(q);
    c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
}

/// First and second derivative of [`interpolate`] at `t`, per sample period and its square.
#[inline(always)]
pub fn slopes(q: [f64; 6], t: f64) -> [f64; 2] {
    let [_, c1, c2, c3, c4, c5] = coefficients(q);
    [
        c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * (5.0 * c5)))),
        2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * (20.0 * c5))),
    ]
}

/// The quintic's coefficients, of t⁰ first.
fn coefficients(q: [f64; 6]) -> [f64; 6] {
    let [q0, q1, q2, q3, q4, q5] = q;
    let [d0, d1, step, d3, d4] = [q1 - q0, q2 - q1, q3 - q2, q4 - q3, q5 - q4];
    let [j0, j1, j2] = [step - d1 - (d1 - d0), d3 - step - (step - d1), d4 - d3 - (d3 - step)];
    let v1 = 0.5 * (d1 + step) - (j0 + j1) / 12.0;
    let v2 = 0.5 * (step + d3) - (j1 + j2) / 12.0;
    let a1 = step - d1 - (j1 - j0) / 3.0;
    let a2 = d3 - step - (j2 - j1) / 3.0;
    let c3 = 10.0 * step - 6.0 * v1 - 4.0 * v2 - 1.5 * a1 + 0.5 * a2;
    let c4 = -15.0 * step + 8.0 * v1 + 7.0 * v2 + 1.5 * a1 - a2;
    let c5 = 6.0 * step - 3.0 * (v1 + v2) - 0.5 * (a1 - a2);
    [q2, v1, 0.5 * a1, c3, c4, c5]
}

// With V, A and J the largest first, second and third differences of any samples over their period T, everywhere between
// them (the largest L1 norm, over t, of the weights of the samples' third differences):

/// Speed exceeds V by at most this times J·T².
pub const VELOCITY_OVERSHOOT: f64 = 0.185;
/// Acceleration exceeds A by at most this times J·T.
pub const ACCELERATION_OVERSHOOT: f64 = 0.7;
/// Jerk is at most this times J.
pub const JERK_GAIN: f64 = 4.0;
/// When played at one tick a sample, at any rate, third differences over a tick are at most this times J: at full rate they
/// average over three samples. The largest at a constant rate is 43/32; the rest is for a rate that changes within them.
pub const JERK_GAIN_EQUAL_PERIODS: f64 = 1.5;
/// Position passes both neighbours by at most A·T²/8 and this times J·T³.
pub const POSITION_OVERSHOOT: f64 = 0.017;

#[cfg(test)]
mod tests {
    use super::*;

    /// Derivatives at t by the polynomial through six points of the quintic, exact but for rounding.
    fn derivatives(q: [f64; 6], t: f64) -> [f64; 4] {
        let h = 1e-3;
        let at = |k: f64| interpolate(q, t + k * h);
        [
            at(0.0),
            (at(1.0) - at(-1.0)) / (2.0 * h),
            (at(1.0) - 2.0 * at(0.0) + at(-1.0)) / (h * h),
            (at(2.0) - 2.0 * at(1.0) + 2.0 * at(-1.0) - at(-2.0)) / (2.0 * h * h * h),
        ]
    }

    #[test]
    fn cubics_come_back_and_neighbouring_pieces_meet_in_three_derivatives() {
        let cubic = |x: f64| 1.0 + x * (0.5 + x * (-0.25 + x * 0.125));
        let samples = core::array::from_fn(|k| cubic(k as f64 - 2.0));
        for t in [0.0, 0.1, 0.5, 0.9, 1.0] {
            assert!(libm::fabs(interpolate(samples, t) - cubic(t)) < 1e-14);
        }
        let rough = [0.3, -0.2, 0.5, 0.1, 0.9, -0.4, 0.2];
        let piece = |from: usize| core::array::from_fn(|k| rough[from + k]);
        let (left, right) = (derivatives(piece(0), 1.0), derivatives(piece(1), 0.0));
        for (k, tolerance) in [1e-14, 1e-5, 1e-3].into_iter().enumerate() {
            assert!(libm::fabs(left[k] - right[k]) < tolerance, "derivative {k}: {} and {}", left[k], right[k]);
        }
        assert_eq!((interpolate(piece(0), 0.0), interpolate(piece(1), 0.0)), (rough[2], rough[3]));
    }

    #[test]
    fn slopes_are_those_of_the_quintic() {
        let q = [0.3, -0.2, 0.5, 0.1, 0.9, -0.4];
        for t in [0.0, 0.2, 0.5, 0.7, 1.0] {
            let [_, v, a, _] = derivatives(q, t);
            let [first, second] = slopes(q, t);
            assert!((first - v).abs() < 1e-4 && (second - a).abs() < 1e-4, "{t}: {first} {v}, {second} {a}");
        }
        // Of x² at sample k, period 1: 2·(k − 2 + t) and 2.
        let [first, second] = slopes(core::array::from_fn(|k| (k as f64 - 2.0) * (k as f64 - 2.0)), 0.25);
        assert!((first - 0.5).abs() < 1e-14 && (second - 2.0).abs() < 1e-13);
    }

    #[test]
    fn the_stated_overshoots_hold_for_the_worst_jerks_and_are_met() {
        let mut worst = [0.0_f64; 5];
        // A third difference's extremes are at its bound's corners; speed and acceleration are varied to each bound.
        for corner in 0..8_u32 {
            let j: [f64; 3] = core::array::from_fn(|k| if corner >> k & 1 == 0 { 1.0 } else { -1.0 });
            for k in 0..=8 {
                let a0 = f64::from(k) * 0.5 - 2.0;
                let a = [a0, a0 + j[0], a0 + j[0] + j[1], a0 + j[0] + j[1] + j[2]];
                let a_max = a.iter().fold(0.0, |far: f64, a| far.max(libm::fabs(*a)));
                for offset in 0..=12 {
                    let d0 = f64::from(offset) * 0.5 - 3.0;
                    let mut d = [d0; 5];
                    (0..4).for_each(|k| d[k + 1] = d[k] + a[k]);
                    let v_max = d.iter().fold(0.0, |far: f64, d| far.max(libm::fabs(*d)));
                    let mut q = [0.0; 6];
                    (0..5).for_each(|k| q[k + 1] = q[k] + d[k]);
                    for step in 0..=100 {
                        let [at, v, a, jerk] = derivatives(q, f64::from(step) * 0.01);
                        let above = at - q[2].max(q[3]) - a_max / 8.0;
                        let found = [above, libm::fabs(v) - v_max, libm::fabs(a) - a_max, libm::fabs(jerk), 0.0];
                        (0..4).for_each(|k| worst[k] = worst[k].max(found[k]));
                    }
                }
            }
        }
        let stated = [POSITION_OVERSHOOT, VELOCITY_OVERSHOOT, ACCELERATION_OVERSHOOT, JERK_GAIN];
        for (found, stated) in worst.into_iter().zip(stated) {
            assert!(found <= stated * 1.000_1, "{found} above the stated {stated}");
        }
        assert!(worst[1] > 0.9 * VELOCITY_OVERSHOOT, "{worst:?}");
        assert!(worst[2] > 0.98 * ACCELERATION_OVERSHOOT && worst[3] > 0.98 * JERK_GAIN, "{worst:?}");
    }

    #[test]
    fn at_one_tick_a_sample_third_differences_stay_below_the_gain_for_equal_periods() {
        // What a single third difference of 1, at each place, leaves in the output's; the worst signs add their magnitudes.
        const PLACES: usize = 12;
        let mut worst = 0.0_f64;
        for rate in (1..=50).map(|k| f64::from(k) / 50.0) {
            for phase in (0..32).map(|k| f64::from(k) / 32.0) {
                let mut sum = 0.0;
                for place in 0..PLACES {
                    // Samples whose third differences are all 0 but one: a half parabola behind it.
                    let sample = |k: usize| {
                        let n = k as f64 - place as f64 - 2.0;
                        if n > 0.0 { 0.5 * n * (n + 1.0) } else { 0.0 }
                    };
                    let at = |x: f64| {
                        let whole = libm::floor(x);
                        interpolate(core::array::from_fn(|k| sample(whole as usize + k - 2)), x - whole)
                    };
                    let from = 4.0 + phase;
                    let [a, b, c, d] = [0.0, 1.0, 2.0, 3.0].map(|k| at(from + k * rate));
                    sum += libm::fabs(d - 3.0 * (c - b) - a);
                }
                worst = worst.max(sum);
            }
        }
        assert!((worst - 43.0 / 32.0).abs() < 1e-9 && worst < JERK_GAIN_EQUAL_PERIODS, "{worst}");
    }
}
