//! The inverse kinematics of every arm of the catalogue leads back to the pose and to the seed. Many more poses:
//! `cargo run --release -p screed-kernel --example ik_campaign`.

mod common;

use common::inverse::UR;
use common::wrist;
use screed_kernel::arms::{gantry, ur};

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

#[test]
fn random_poses_of_spherical_wrists_are_met_on_every_branch() {
    for (arm, seed) in wrist::ARMS.iter().zip(200..) {
        let found = wrist::family().random(arm, seed, 5_000);
        assert!(found.answers > 6 * found.poses, "{}: {found:?}", arm.name);
        // Within narrow limits and where everything is reached.
        wrist::family().random(&wrist::wide(*arm), seed, 5_000);
    }
}

#[test]
fn spherical_wrists_miss_nothing_on_and_beside_singularities() {
    for (arm, seed) in wrist::ARMS.iter().zip(300..) {
        for which in [&[0][..], &[1], &[2], &[0, 1], &[0, 2], &[1, 2], &[0, 1, 2]] {
            wrist::family().singular(&wrist::wide(*arm), which, seed, 1_000);
        }
    }
}

#[test]
fn gantries_and_the_arm_on_the_crane_go_where_they_are_sent() {
    let found = wrist::GANTRY.random(&gantry::CONTOUR_CRAFTER, 400, 10_000);
    assert_eq!(found.free, 0);
    let found = wrist::on_the_crane(401, 10_000);
    assert!(found.answers > 3 * found.poses, "{found:?}");
}
