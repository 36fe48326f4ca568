use super::*;

#[test]
fn quantiles_are_the_least_latency_that_the_share_does_not_exceed() {
    let mut histogram = Histogram::new(1000);
    (1..=100).for_each(|latency| histogram.add(latency));
    let at = |share| histogram.quantile_us(share).unwrap();
    assert_eq!([at(0.0), at(0.01), at(0.5), at(0.501), at(0.99), at(1.0)], [1, 1, 50, 51, 99, 100]);
    histogram.add(5_000);
    assert_eq!((histogram.quantile_us(1.0), histogram.max_us(), histogram.total()), (Some(5_000), 5_000, 101));
    assert_eq!(Histogram::new(10).quantile_us(0.5), None);
    assert!(Summary::of(&Histogram::new(10), 0).is_none());
}

#[test]
fn a_pair_with_a_stall_is_discarded_whole() {
    let slice = |latencies: &[u32]| {
        let mut histogram = Histogram::new(30_000);
        latencies.iter().for_each(|&latency| histogram.add(latency));
        histogram
    };
    assert!(Pair::of(&slice(&[3, 4]), &slice(&[5, DISCARD_US])).is_some());
    assert!(Pair::of(&slice(&[3, 4]), &slice(&[5, DISCARD_US + 1])).is_none());
    assert!(Pair::of(&slice(&[DISCARD_US + 1]), &slice(&[5])).is_none());
    assert!(Pair::of(&slice(&[]), &slice(&[5])).is_none());
}

#[test]
fn the_interval_holds_the_planted_difference_in_about_95_of_100_experiments() {
    let mut state = 7_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64
    };
    let held = (0..200)
        .filter(|_| {
            let values: Vec<f64> = (0..40).map(|_| 2.0 + uniform() + uniform() + uniform() - 1.5).collect();
            let interval = Interval::of_median(&values).unwrap();
            assert!(interval.low <= interval.value && interval.value <= interval.high);
            interval.low <= 2.0 && 2.0 <= interval.high
        })
        .count();
    // 200 experiments at 95 %: 190, with a standard deviation of 3.
    assert!((178..=199).contains(&held), "{held}");
    let once = Interval::of_median(&[1.0, 2.0, 4.0]).unwrap();
    assert_eq!(once, Interval::of_median(&[1.0, 2.0, 4.0]).unwrap(), "seeded");
    assert_eq!(Interval::of_median(&[]), None);
}
