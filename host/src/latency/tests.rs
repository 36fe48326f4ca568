use super::*;
use crate::config::Realtime;
use crate::doctor::Diagnosis;

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

/// So many pairs, all alike.
fn alike(ours_median_us: u32, ours_p99_us: u32, pairs: usize) -> Comparison {
    let pair = Pair { ours_median_us, theirs_median_us: 10, ours_p99_us, theirs_p99_us: 20 };
    Comparison::of(vec![pair; pairs], 1).unwrap()
}

#[test]
fn an_aim_that_is_missed_is_told_by_how_much_and_with_what_doctor_finds() {
    // A machine that tells nothing but that it is virtual.
    let root = tempfile::TempDir::new().unwrap();
    std::fs::create_dir(root.path().join("proc")).unwrap();
    std::fs::write(root.path().join("proc/cpuinfo"), "flags : hypervisor").unwrap();
    let machine = Diagnosis::of(root.path(), &Realtime::default());
    let judged = |comparison| Judged::of(comparison, Rule::new(5.0, 40, 200), &machine);

    let met = judged(alike(13, 20, 40));
    assert!(met.narrow && met.aims.iter().all(|aim| aim.met) && met.likely_why.is_empty(), "{met}");
    for words in ["40 pairs", "1 more discarded", "20000 µs", "slices of 5 s", "6 µs wide", "after 200"] {
        assert!(met.to_string().contains(words), "{words}: {met}");
    }

    // 17 µs more than theirs is 14 above; 61.5 over 20.5 is 3, 1 above.
    let slow = judged(alike(27, 61, 40));
    assert_eq!(slow.aims.map(|aim| (aim.met, aim.below_by, aim.above_by)), [(false, 0.0, 14.0), (false, 0.0, 1.0)]);
    let text = slow.to_string();
    assert!(text.contains("missed, 14.00 µs above") && text.contains("missed, 1.00 above"), "{text}");
    assert!(text.contains("BAD  virtual machine") && text.contains("POOR isolated processors"), "{text}");
    let json = serde_json::to_value(&slow).unwrap();
    assert_eq!((&json["aims"][0]["above_by"], &json["rule"]["discard_us"]), (&14.0.into(), &20_000.into()));
    assert_eq!(
        (&json["narrow"], &json["discarded"], json["likely_why"][0]["what"].as_str()),
        (&true.into(), &1.into(), Some("virtual machine"))
    );
    let quick = judged(alike(5, 4, 40));
    assert_eq!(quick.aims.map(|aim| aim.met), [true, false]);
    assert!((quick.aims[1].below_by - (0.5 - 4.5 / 20.5)).abs() < 1e-12 && quick.aims[1].above_by == 0.0);

    // Two kinds of pairs, half and half: the interval spans both.
    let mut mixed = alike(0, 20, 20);
    mixed.pairs.extend(alike(12, 20, 20).pairs);
    let wide = judged(Comparison::of(mixed.pairs, 0).unwrap());
    assert!(!wide.narrow && wide.to_string().contains("stayed wider") && !wide.likely_why.is_empty(), "{wide}");
}
