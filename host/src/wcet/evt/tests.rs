//! Figures with a source are SciPy's 1.17 (`scipy.stats`, `scipy.special`), on the same values.

use super::tests_of::{anderson_darling, halves, kolmogorov, ljung_box, runs};
use super::*;
use screed_tape::random::Random;

const SHAPE: f64 = 0.08045956041033715;
const SCALE: f64 = 0.9377469394401649;
const QUANTILE: f64 = 8.66338265221504;
const BELOW: f64 = 0.7779168214507042;
const ANDERSON_DARLING: f64 = 0.08148829611292996;
const LJUNG_BOX: [f64; 2] = [9.938584872739858, 0.9692719407870184];
const RUNS: [f64; 2] = [105.0, 0.5706380060211999];
const HALVES: f64 = 0.16;
const KOLMOGOROV: [(f64, f64); 3] =
    [(0.5, 0.9639452436648751), (1.2, 0.11224966667072497), (2.0, 0.0006709252557796953)];

/// Values that follow from their number alone.
fn wavy() -> Vec<f64> {
    (0..60).map(f64::from).map(|i| -(1.0 - (i + 0.5) / 60.0).ln() * (1.0 + 0.3 * i.sin())).collect()
}

fn row() -> Vec<f64> {
    (0..200).map(f64::from).map(|k| 0.2 * (0.9 * k).sin() + (2.3 * k * k).cos()).collect()
}

fn near(found: f64, expected: f64, within: f64) {
    assert!((found - expected).abs() <= within * expected.abs().max(1e-12), "{found}, expected {expected}");
}

/// Independent values of a law, from a seed.
fn drawn(law: Pareto, count: usize, seed: u64) -> Vec<f64> {
    let mut random = Random(seed);
    (0..count).map(|_| 100.0 + law.quantile(1.0 - random.between(0.0, 1.0))).collect()
}

#[test]
fn the_most_likely_law_is_scipys() {
    let law = Pareto::fit(&wavy()).unwrap();
    near(law.shape, SHAPE, 1e-4);
    near(law.scale, SCALE, 1e-5);
    near(law.quantile(1e-3), QUANTILE, 1e-4);
    near(law.below(1.5), BELOW, 1e-5);
    let mut sorted = wavy();
    sorted.sort_by(f64::total_cmp);
    near(anderson_darling(&sorted, &law), ANDERSON_DARLING, 1e-4);
}

#[test]
fn the_tests_statistics_and_probabilities_are_scipys() {
    let found = ljung_box(&row(), 20);
    near(found.statistic, LJUNG_BOX[0], 1e-9);
    near(found.probability.unwrap(), LJUNG_BOX[1], 1e-6);
    let mut sorted = row();
    sorted.sort_by(f64::total_cmp);
    let found = runs(&row(), 0.5 * (sorted[99] + sorted[100]));
    near(found.statistic, RUNS[0], 0.0);
    near(found.probability.unwrap(), RUNS[1], 1e-9);
    near(halves(&row()).statistic, HALVES, 1e-12);
    for (lambda, probability) in KOLMOGOROV {
        near(kolmogorov(lambda), probability, 1e-9);
    }
}

#[test]
fn the_known_quantile_of_independent_values_is_inside_its_interval() {
    for shape in [0.0, -0.2, 0.15] {
        let law = Pareto { shape, scale: 10.0 };
        let (mut fitted, mut inside) = (0, 0);
        for seed in 0..12 {
            let evt = Evt::of(&drawn(law, 4000, 1000 + seed));
            let Verdict::Fitted { quantiles, .. } = evt.verdict else { continue };
            fitted += 1;
            let Quantile { probability, low, high, value } = quantiles[0];
            assert!(low <= value && value <= high, "{low} {value} {high}");
            let truth = 100.0 + law.quantile(probability);
            inside += u32::from((low..=high).contains(&truth));
        }
        // Each of the tests may refuse one in a hundred by chance, and an interval misses one in twenty: more than three of twelve once in
        // five hundred.
        assert!(fitted >= 9, "shape {shape}: {fitted} of 12 fitted");
        assert!(inside + 3 >= fitted, "shape {shape}: {inside} of {fitted} inside");
    }
}

#[test]
fn an_interval_holds_the_known_quantile_95_times_of_100() {
    for shape in [0.0, -0.2, 0.15] {
        let law = Pareto { shape, scale: 10.0 };
        let held = (0..100).filter(|seed| {
            let values: Vec<f64> = drawn(law, 400, 77_000 + 13 * seed).iter().map(|value| value - 100.0).collect();
            let fitted = Pareto::fit(&values).unwrap();
            let [low, high] = fitted.interval(&values, 1e-3);
            (low..=high).contains(&law.quantile(1e-3))
        });
        // 95 are expected, give or take three times 2.2.
        let held = held.count();
        assert!((89..=100).contains(&held), "shape {shape}: {held} of 100");
    }
}

#[test]
fn values_that_hang_together_are_refused() {
    let mut random = Random(7);
    let independent: Vec<f64> = drawn(Pareto { shape: 0.0, scale: 10.0 }, 4000, 3);
    let mut carried = 0.0;
    let autocorrelated: Vec<f64> = independent
        .iter()
        .map(|value| {
            carried = 0.3 * carried + value;
            carried
        })
        .collect();
    let drifting: Vec<f64> = independent.iter().enumerate().map(|(i, value)| value + 0.002 * i as f64).collect();
    let bursts: Vec<f64> =
        independent.iter().enumerate().map(|(i, value)| if i % 800 < 60 { value + 30.0 } else { *value }).collect();
    let discrete: Vec<f64> = independent.iter().map(|value| (value / 5.0).round() * 5.0).collect();
    let two: Vec<f64> =
        independent.iter().map(|value| if random.once_in(50) { value + 200.0 } else { *value }).collect();
    for (name, samples) in [
        ("autocorrelated", autocorrelated),
        ("drifting", drifting),
        ("in bursts", bursts),
        ("discrete", discrete),
        ("of two kinds", two),
        ("too few", independent[..500].to_vec()),
        ("equal", vec![5.0; 2000]),
        ("not a number", vec![f64::NAN; 2000]),
    ] {
        let evt = Evt::of(&samples);
        let Verdict::Refused(why) = &evt.verdict else { panic!("{name}: {:?}", evt.verdict) };
        assert!(!why.is_empty(), "{name}: refused without a reason");
    }
}
