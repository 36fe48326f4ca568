//! The kernel's tests with random programs and fuzzed frames, many times over:
//! `cargo run --release -p screed-kernel --example campaign [programs [frames]]`.

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

/// Seeds that the tests do not use.
const FIRST_SEED: u64 = 1_000_000;

fn main() {
    let mut counts = std::env::args().skip(1).map(|count| count.parse().expect("a count"));
    let (programs, frames) = (counts.next().unwrap_or(100_000), counts.next().unwrap_or(10_000_000));
    let began = Instant::now();
    common::program::programs(FIRST_SEED..FIRST_SEED + programs);
    println!("{programs} programs in {:.0} s", began.elapsed().as_secs_f64());
    let began = Instant::now();
    let done = common::fuzz::fuzz(FIRST_SEED, frames);
    // One corrupt frame in 2^32 passes the CRC.
    assert!(done.corrupt <= 1 + frames / (1 << 31), "{} corrupt frames passed the CRC", done.corrupt);
    println!(
        "{frames} inputs in {:.0} s: {} frames with a known message, {} broken, {} corrupt ones passed",
        began.elapsed().as_secs_f64(),
        done.obeyed,
        done.broken,
        done.corrupt
    );
}
