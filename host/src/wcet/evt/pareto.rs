//! The generalised Pareto law: what exceeds a high threshold (Pickands, "Statistical inference using extreme order statistics",
//! Annals of Statistics 3, 1975).

use serde::Serialize;

/// P(Y > y) = (1 + ξ y/σ)^(−1/ξ), exp(−y/σ) for ξ = 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pareto {
    /// ξ: below 0 there is a greatest value, 0 is the exponential law, above 0 the tail is heavy.
    pub shape: f64,
    /// σ.
    pub scale: f64,
}

/// Least count of values for a fit.
const COUNT_MIN: usize = 30;

/// Nearer to 0 than this a shape is 0.
const SHAPE_MIN: f64 = 1e-9;

impl Pareto {
    /// The most likely law of positive values, by the likelihood as a function of θ = ξ/σ alone: ξ(θ) is the mean of log(1 + θy)
    /// (Davison and Smith, "Models for exceedances over high thresholds", JRSS B 52, 1990; Grimshaw, Technometrics 35, 1993). None of
    /// fewer than thirty values, or of equal ones.
    pub fn fit(values: &[f64]) -> Option<Self> {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let largest = values.iter().copied().fold(0.0, f64::max);
        if values.len() < COUNT_MIN || !(mean > 0.0 && largest.is_finite() && largest > mean) {
            return None;
        }
        let shape = |theta: f64| values.iter().map(|value| (theta * value).ln_1p()).sum::<f64>() / count;
        let likelihood = |theta: f64| {
            if (theta * mean).abs() < 1e-8 {
                return -mean.ln() - 1.0;
            }
            let shape = shape(theta);
            // ξ below −1 has no most likely law: the likelihood grows without bound at the largest value.
            if shape <= -1.0 { f64::NEG_INFINITY } else { -(shape / theta).ln() - shape - 1.0 }
        };
        // θ lies above −1/largest. On a logarithmic grid of its distance from there, then by golden section.
        let at = |u: f64| (u.exp() - 1.0) / largest;
        let grid: Vec<f64> = (0..=80).map(|k| -12.0 + 0.25 * f64::from(k)).collect();
        let best = (0..grid.len()).max_by(|a, b| likelihood(at(grid[*a])).total_cmp(&likelihood(at(grid[*b]))))?;
        let (mut low, mut high) = (grid[best.saturating_sub(1)], grid[(best + 1).min(grid.len() - 1)]);
        let golden = 0.5 * (5_f64.sqrt() - 1.0);
        for _ in 0..40 {
            let (a, b) = (high - golden * (high - low), low + golden * (high - low));
            if likelihood(at(a)) < likelihood(at(b)) { low = a } else { high = b }
        }
        let theta = at(0.5 * (low + high));
        let shape = shape(theta);
        let law = if shape.abs() < SHAPE_MIN {
            Self { shape: 0.0, scale: mean }
        } else {
            Self { shape, scale: shape / theta }
        };
        (law.shape.is_finite() && law.scale > 0.0 && law.scale.is_finite()).then_some(law)
    }

    /// P(Y ≤ y).
    pub fn below(&self, value: f64) -> f64 {
        if self.shape == 0.0 {
            return -(-value / self.scale).exp_m1();
        }
        let base = 1.0 + self.shape * value / self.scale;
        if base <= 0.0 { 1.0 } else { 1.0 - base.powf(-1.0 / self.shape) }
    }

    /// The value that is exceeded with a probability.
    pub fn quantile(&self, above: f64) -> f64 {
        if self.shape == 0.0 {
            return -self.scale * above.ln();
        }
        self.scale / self.shape * (above.powf(-self.shape) - 1.0)
    }

    /// The interval that holds the value exceeded with a probability 95 times of 100, of the values that this law was fitted to: where the
    /// likelihood with that value held comes within 1.92 of the greatest (Coles, "An Introduction to Statistical Modeling of Extreme
    /// Values", 2001, 4.3.3). It is not symmetric, as the uncertainty of a tail is not.
    pub fn interval(&self, values: &[f64], above: f64) -> [f64; 2] {
        let best = self.quantile(above);
        let least = self.likelihood(values) - 0.5 * 3.841_458_820_694_124;
        let inside = |quantile: f64| profile(values, quantile, above) >= least;
        let bisect = |mut inner: f64, mut outer: f64| {
            for _ in 0..30 {
                let half = 0.5 * (inner + outer);
                if inside(half) { inner = half } else { outer = half }
            }
            outer
        };
        let mut beyond = 1.5 * best;
        while beyond < 1e9 * best && inside(beyond) {
            beyond *= 1.5;
        }
        [bisect(best, 0.0), bisect(best, beyond)]
    }

    /// The logarithm of the likelihood of values.
    fn likelihood(&self, values: &[f64]) -> f64 {
        let Self { shape, scale } = *self;
        let count = values.len() as f64;
        if shape.abs() < 1e-6 {
            return -count * scale.ln() - values.iter().sum::<f64>() / scale;
        }
        let largest = values.iter().copied().fold(0.0, f64::max);
        if !(scale > 0.0 && 1.0 + shape * largest / scale > 0.0) {
            return f64::NEG_INFINITY;
        }
        let sum: f64 = values.iter().map(|value| (shape * value / scale).ln_1p()).sum();
        -count * scale.ln() - (1.0 + 1.0 / shape) * sum
    }

    /// Standard error of a fitted shape, for large counts: (1 + ξ)/√n, for ξ > −½ (Smith, Biometrika 72, 1985).
    pub fn shape_error(&self, count: usize) -> f64 {
        (1.0 + self.shape).abs().max(0.1) / (count as f64).sqrt()
    }
}

/// The greatest likelihood of a law whose value exceeded with a probability is given.
fn profile(values: &[f64], quantile: f64, above: f64) -> f64 {
    let likelihood = |shape: f64| {
        let scale =
            if shape.abs() < 1e-6 { -quantile / above.ln() } else { shape * quantile / (above.powf(-shape) - 1.0) };
        Pareto { shape, scale }.likelihood(values)
    };
    let at = |k: i32| -0.95 + 0.05 * f64::from(k);
    let best = (0..=60).max_by(|a, b| likelihood(at(*a)).total_cmp(&likelihood(at(*b)))).unwrap_or(0);
    let (mut low, mut high) = (at(best - 1), at(best + 1));
    let golden = 0.5 * (5_f64.sqrt() - 1.0);
    for _ in 0..20 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if likelihood(a) < likelihood(b) { low = a } else { high = b }
    }
    likelihood(0.5 * (low + high))
}
