//! The inverse kinematics of every arm of the catalogue: forward of inverse at random poses, and on and beside every
//! singularity. Stops at the first pose that is missed; prints what was the worst.
//!
//! `cargo run --release -p screed-kernel --example ik_campaign [poses a family [poses a singularity and arm]]`

#[path = "../tests/common/mod.rs"]
mod common;

use common::inverse::{Found, UR};
use common::wrist;
use screed_kernel::arms::{gantry, ur};
use std::time::Instant;

/// Seeds that the tests do not use.
const FIRST_SEED: u64 = 1_000_000;

const SINGULAR: [(&str, &[usize]); 7] = [
    ("shoulder", &[0]),
    ("elbow", &[1]),
    ("wrist", &[2]),
    ("shoulder, elbow", &[0, 1]),
    ("shoulder, wrist", &[0, 2]),
    ("elbow, wrist", &[1, 2]),
    ("all three", &[0, 1, 2]),
];

fn row(name: &str, what: &str, found: &Found) {
    let Found { poses, answers, free, position, rotation, joints } = found;
    println!(
        "{name:<16} {what:<16} {poses:>9} {answers:>10} {free:>9} {position:>9.1e} {rotation:>9.1e} {joints:>9.1e}"
    );
}

fn main() {
    let mut counts = std::env::args().skip(1).map(|count| count.parse().expect("a count"));
    let (random, singular): (u64, u64) = (counts.next().unwrap_or(10_000_000), counts.next().unwrap_or(100_000));
    let began = Instant::now();
    println!(
        "joints: the way from a pose's own joints to the answer on their branch, times the product of the margins"
    );
    println!(
        "{:<16} {:<16} {:>9} {:>10} {:>9} {:>9} {:>9} {:>9}",
        "arm", "poses at", "poses", "answers", "free", "m", "rad", "joints"
    );
    for (arm, seed) in ur::ALL.iter().zip(FIRST_SEED..) {
        row(arm.name, "random", &UR.random(arm, seed, random.div_ceil(ur::ALL.len() as u64)));
        for (what, which) in SINGULAR {
            // Half of them on either side.
            row(arm.name, what, &UR.singular(arm, which, seed, 2 * singular));
        }
    }
    for (arm, seed) in wrist::ARMS.iter().zip(FIRST_SEED + 100..) {
        let count = random.div_ceil(2 * wrist::ARMS.len() as u64);
        row(arm.name, "random", &wrist::family().random(arm, seed, count));
        let arm = &wrist::wide(*arm);
        row(arm.name, "random, any turn", &wrist::family().random(arm, seed, count));
        for (what, which) in SINGULAR {
            row(arm.name, what, &wrist::family().singular(arm, which, seed, 2 * singular));
        }
    }
    row("crane", "random", &wrist::on_the_crane(FIRST_SEED + 200, random.div_ceil(10)));
    row("gantry", "random", &wrist::GANTRY.random(&gantry::CONTOUR_CRAFTER, FIRST_SEED + 201, random));
    println!("in {:.0} s", began.elapsed().as_secs_f64());
}
