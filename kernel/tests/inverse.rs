//! The inverse kinematics of every arm of the catalogue leads back to the pose and to the seed. Many more poses:
//! `cargo run --release -p screed-kernel --example ik_campaign`.

mod common;

use common::inverse::UR;
use screed_kernel::arms::ur;

#[test]
fn random_poses_of_ur_arms_are_met_on_every_branch() {
    for (arm, seed) in ur::ALL.iter().zip(1..) {
        let found = UR.random(arm, seed, 3_000);
        assert!(found.answers > 10 * found.poses, "{}: {found:?}", arm.name);
    }
}

#[test]
fn ur_arms_miss_nothing_on_and_beside_singularities() {
    for (arm, seed) in ur::ALL.iter().zip(100..) {
        for which in [&[0][..], &[1], &[2], &[0, 1], &[0, 2], &[1, 2], &[0, 1, 2]] {
            UR.singular(arm, which, seed, 1_000);
        }
    }
}
