//! Tests of what an extreme value law supposes.

use super::{LEVEL, Pareto};
use screed_tape::random::Random;
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// Values of which no more than so many are equal can pass for continuous: distinct ones as a share of all.
const DISTINCT_MIN: f64 = 0.5;

/// A test and what it said.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Test {
    /// What was tested.
    pub name: &'static str,
    /// The statistic.
    pub statistic: f64,
    /// How likely a statistic as far out is if the precondition holds; none where a rule judges.
    pub probability: Option<f64>,
    /// Whether the precondition is held to be true.
    pub holds: bool,
}

impl Test {
    pub(super) fn of(name: &'static str, statistic: f64, probability: f64) -> Self {
        Self { name, statistic, probability: Some(probability), holds: probability >= LEVEL }
    }

    pub(super) const fn judged(name: &'static str, statistic: f64, probability: Option<f64>, holds: bool) -> Self {
        Self { name, statistic, probability, holds }
    }

    /// The test in words, for a refusal.
    pub fn words(&self) -> String {
        let Self { name, statistic, probability, .. } = self;
        let probability = probability.map_or(String::new(), |p| format!(", p {}", words(p)));
        format!("{name}: {statistic:.4}{probability}")
    }
}

/// A probability with its relation, as one reads it.
pub fn words(probability: f64) -> String {
    match probability {
        p if p < 1e-99 => "< 1e-99".to_owned(),
        p if p < 1e-3 => format!("= {p:.0e}"),
        p => format!("= {p:.3}"),
    }
}

/// Independence: Q = n(n+2) Σ ρ_k²/(n−k) over so many lags is χ² with as many degrees of freedom (Ljung and Box, Biometrika 65,
/// 1978).
pub(super) fn ljung_box(samples: &[f64], lags: usize) -> Test {
    let name = "independence: Ljung-Box, 20 lags";
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let variance: f64 = samples.iter().map(|sample| (sample - mean).powi(2)).sum();
    if variance == 0.0 {
        return Test::judged(name, f64::NAN, None, false);
    }
    let sum: f64 = (1..=lags)
        .map(|lag| {
            let pairs = samples.iter().zip(samples.iter().skip(lag));
            let correlation: f64 = pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / variance;
            correlation * correlation / (n - lag as f64)
        })
        .sum();
    let statistic = n * (n + 2.0) * sum;
    let probability = ChiSquared::new(lags as f64).map_or(0.0, |law| law.sf(statistic));
    Test::of(name, statistic, probability)
}

/// Independence: how often samples change from one side of the median to the other (Wald and Wolfowitz, Annals of Mathematical
/// Statistics 11, 1940). Those on it are left out.
pub(super) fn runs(samples: &[f64], median: f64) -> Test {
    let sides: Vec<bool> = samples.iter().filter(|sample| **sample != median).map(|sample| *sample > median).collect();
    let above = sides.iter().filter(|side| **side).count() as f64;
    let below = sides.len() as f64 - above;
    let name = "independence: runs above and below the median";
    if above < 10.0 || below < 10.0 {
        return Test::judged(name, f64::NAN, None, false);
    }
    let found = 1.0 + sides.windows(2).filter(|pair| pair[0] != pair[1]).count() as f64;
    let n = above + below;
    let mean = 1.0 + 2.0 * above * below / n;
    let variance = 2.0 * above * below * (2.0 * above * below - n) / (n * n * (n - 1.0));
    Test::of(name, found, two_sided((found - mean) / variance.sqrt()))
}

/// Identical distribution: the first half and the second (Kolmogorov and Smirnov, two samples; asymptotic, as in Stephens, JRSS B 32,
/// 1970).
pub(super) fn halves(samples: &[f64]) -> Test {
    let (first, second) = samples.split_at(samples.len() / 2);
    let [mut a, mut b] = [first.to_vec(), second.to_vec()];
    a.sort_by(f64::total_cmp);
    b.sort_by(f64::total_cmp);
    let (mut i, mut j, mut distance) = (0, 0, 0.0_f64);
    while let (Some(x), Some(y)) = (a.get(i), b.get(j)) {
        let value = x.min(*y);
        while a.get(i).is_some_and(|x| *x <= value) {
            i += 1;
        }
        while b.get(j).is_some_and(|y| *y <= value) {
            j += 1;
        }
        distance = distance.max((i as f64 / a.len() as f64 - j as f64 / b.len() as f64).abs());
    }
    let size = (a.len() as f64 * b.len() as f64 / (a.len() + b.len()) as f64).sqrt();
    let lambda = (size + 0.12 + 0.11 / size) * distance;
    Test::of("identical distribution: first and second half, Kolmogorov-Smirnov", distance, kolmogorov(lambda))
}

/// Q(λ) = 2 Σ (−1)^(k−1) exp(−2k²λ²).
pub(super) fn kolmogorov(lambda: f64) -> f64 {
    if lambda < 0.2 {
        return 1.0;
    }
    let term = |k: f64| (-2.0 * k * k * lambda * lambda).exp();
    let sum: f64 = (1..=100).map(|k| if k % 2 == 1 { term(f64::from(k)) } else { -term(f64::from(k)) }).sum();
    (2.0 * sum).clamp(0.0, 1.0)
}

/// Whether values can pass for continuous.
pub(super) fn discrete(excesses: &[f64]) -> Test {
    let mut distinct = excesses.to_vec();
    distinct.dedup();
    let share = distinct.len() as f64 / excesses.len().max(1) as f64;
    Test::judged("continuity: distinct values among the exceedances", share, None, share >= DISTINCT_MIN)
}

/// Whether the law fits: Anderson and Darling's A², which looks at the tails most; its law with fitted parameters by drawing from the
/// fit (Stute, Manteiga and Quindimil, Metrika 40, 1993).
pub(super) fn goodness(excesses: &[f64], law: &Pareto, resamples: usize, seed: u64) -> Test {
    let statistic = anderson_darling(excesses, law);
    let mut random = Random(seed);
    let (mut larger, mut drawn) = (0, 0);
    for _ in 0..resamples {
        let mut sample: Vec<f64> = excesses.iter().map(|_| law.quantile(1.0 - random.between(0.0, 1.0))).collect();
        sample.sort_by(f64::total_cmp);
        if let Some(again) = Pareto::fit(&sample) {
            drawn += 1;
            larger += usize::from(anderson_darling(&sample, &again) >= statistic);
        }
    }
    let probability = (larger + 1) as f64 / (drawn + 1) as f64;
    Test::of("goodness of fit: Anderson-Darling, by bootstrap", statistic, probability)
}

/// A² = −n − Σ (2i−1)/n [ln F(y_i) + ln(1 − F(y_{n+1−i}))] of sorted values.
pub(super) fn anderson_darling(sorted: &[f64], law: &Pareto) -> f64 {
    let n = sorted.len() as f64;
    let inside = |value: f64| value.clamp(1e-300, 1.0 - 1e-16);
    let sum: f64 = sorted
        .iter()
        .zip(sorted.iter().rev())
        .enumerate()
        .map(|(i, (low, high))| {
            (2 * i + 1) as f64 / n * (inside(law.below(*low)).ln() + (1.0 - inside(law.below(*high))).ln())
        })
        .sum();
    -n - sum
}

/// How likely a standard normal value is as far out on either side.
pub(super) fn two_sided(z: f64) -> f64 {
    Normal::new(0.0, 1.0).map_or(0.0, |law| 2.0 * law.sf(z.abs()))
}
