//! The filter's tests, with many ticks and other seeds: `cargo run --release -p screed-kernel --example ekf_campaign [ticks]`.
//! What is not as it has to be ends it with a panic.

#[path = "../tests/common/mod.rs"]
mod common;

use common::estimation::{against_dense, band, consistency, dropout, long, mean};
use common::plant::{PAPER, TRACKER};
use common::rival::{Rms, rivals};
use std::time::Instant;

/// Ticks against the dense filter.
const DENSE: usize = 100_000;

fn main() {
    let ticks = std::env::args().nth(1).map_or(10_000_000, |count| count.parse().expect("a count of ticks"));
    for (name, noise) in [("tracker", TRACKER), ("paper", PAPER)] {
        let began = Instant::now();
        let apart = against_dense(1000, noise, DENSE);
        println!(
            "{name}: {DENSE} ticks against a dense filter in Joseph's form: |Δx| ≤ {:.1e} σ, |ΔP| ≤ {:.1e} σσ, {:.0} s",
            apart.state,
            apart.covariance,
            began.elapsed().as_secs_f64()
        );
        assert!(apart.state <= 1e-6 && apart.covariance <= 1e-7);
        let result = consistency(1000..1200, noise, 1000, 50);
        let samples = 200.0 * 1000.0;
        for (what, runs, half) in [
            ("NEES (18)", &result.nees, mean(&result.nees).1),
            ("NIS of poses (6)", &result.nis_pose, band(6.0, 0.5 * samples)),
            ("NIS of rates (6)", &result.nis_rates, band(6.0, samples)),
        ] {
            println!("{name}: 200 matched runs: mean {what} {:.3} ± {half:.3}", mean(runs).0);
        }
        let bound = 1.96 / (result.products as f64).sqrt();
        println!("{name}: autocorrelation at lags 1 to 10 {:.4?}, 95 % within ± {bound:.4}", result.autocorrelation);
        println!("{name}: 3σ cover {:.2} % of the errors", 100.0 * result.covered);
        result.judge(name, [0.5 * samples, samples]);
        let result = rivals(1000..1200, noise, 1000);
        for (who, rms) in
            [("ours", result.ours), ("the paper's, mended", result.literal), ("as printed", result.printed)]
        {
            let Rms { place, turn, joints } = rms;
            println!(
                "{name}: 200 runs, half of z missing: {who:<20} {place:.3e} m, {turn:.3e} rad, joints {joints:.3e} rad"
            );
        }
        let [difference, half] = result.difference.map(|share| 100.0 * share);
        println!("{name}: mean square of the place, ours less the mended one's: {difference:.2} % ± {half:.2} %");
        assert!(difference <= half.max(1.0));
        for count in [1, 10, 100, 1000, 5000] {
            let covered = dropout(1000..1100, noise, count);
            println!("{name}: {count} ticks without a pose: 3σ cover {:.2} %", 100.0 * covered);
            assert!(covered >= 0.99);
        }
        let began = Instant::now();
        let result = long(1000, noise, ticks, 1000);
        println!("{name}: {ticks} ticks: {result:?}, {:.0} s", began.elapsed().as_secs_f64());
    }
}
