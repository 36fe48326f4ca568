//! Thirty hosts lost in real time, killed and stopped in turns, at seeded instants of the demo; the robot's received bytes are
//! the judge, as in `tests/processes.rs`. Takes two to three minutes; needs the programs of the same build.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::scene::{Lost, lose_host_at};
use common::{Random, planned_path};
use std::thread;
use std::time::Duration;

const HOSTS: usize = 30;
/// At once: five demos are twenty processes.
const TOGETHER: usize = 5;

fn main() {
    let path = planned_path(500);
    let mut random = Random::new(30);
    let lost: Vec<(Lost, Duration)> = (0..HOSTS)
        .map(|number| {
            let how = if number % 2 == 0 { Lost::Killed } else { Lost::Stopped };
            (how, Duration::from_secs_f64(random.between(2.5, 12.0)))
        })
        .collect();
    for part in lost.chunks(TOGETHER) {
        thread::scope(|scope| {
            for (how, after) in part {
                let path = &path;
                scope.spawn(move || lose_host_at(*how, *after, path));
            }
        });
    }
    println!("{HOSTS} hosts lost, killed and stopped in turns: at rest on the path each time");
}
