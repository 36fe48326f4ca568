//! Registration: what is refused, what is least, and whether the covariance is honest. Figures of another program's
//! answers stand in `tests/registration.rs` of the workspace.

mod common;

use common::Random;
use nalgebra::{Matrix3, Vector3, Vector6};
use screed_kernel::pose::Pose;
use screed_kernel::registration::{PointPair, Registration, RegistrationError, register};
use std::f64::consts::PI;

/// A number of the standard normal distribution (Box, Muller, "A note on the generation of random normal deviates",
/// 1958).
fn normal(random: &mut Random) -> f64 {
    let radius = (-2.0 * random.between(f64::MIN_POSITIVE, 1.0).ln()).sqrt();
    radius * random.between(0.0, 2.0 * PI).cos()
}

fn vector(random: &mut Random, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.between(-size, size))
}

fn pose(random: &mut Random) -> Pose {
    let turn = vector(random, 1.0).normalize() * random.between(0.0, PI);
    Pose::from_rotation_vector(vector(random, 5.0), turn)
}

/// Points in a box of the given half sizes, seen in both frames, with noise on the outer ones.
fn pairs(random: &mut Random, outer_from_inner: &Pose, count: usize, size: [f64; 3], sigma: f64) -> Vec<PointPair> {
    let one = |_| {
        let in_inner = Vector3::from_fn(|row, _| 0.3 + random.between(-size[row], size[row]));
        let noise = Vector3::from_fn(|_, _| sigma * normal(random));
        PointPair { in_outer: outer_from_inner.transform_point(&in_inner) + noise, in_inner }
    };
    (0..count).map(one).collect()
}

fn rotation_error(found: &Registration, truth: &Pose) -> Vector3<f64> {
    Pose { rotation: truth.rotation * found.outer_from_inner.rotation.transpose(), translation: Vector3::zeros() }
        .rotation_vector()
}

#[test]
fn exact_pairs_give_the_pose_back() {
    let mut random = Random(1);
    for case in 0..20_000 {
        let truth = pose(&mut random);
        let count = 3 + random.below(20) as usize;
        // A block, a sheet, a rod a tenth as thick as long.
        let size = [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 0.1, 0.1]][case % 3];
        let Ok(found) = register(&pairs(&mut random, &truth, count, size, 0.0)) else { panic!("case {case}") };
        let share = found.levers.x / found.levers.z;
        let tolerance = 1e-14 * (1.0 + 1.0 / (share * share));
        assert!(rotation_error(&found, &truth).norm() < tolerance, "case {case}: lever share {share}");
        let off = found.outer_from_inner.transform_point(&found.centroid_in_inner)
            - truth.transform_point(&found.centroid_in_inner);
        assert!(off.norm() < 1e-14, "case {case}: {off:?}");
        assert!(found.residual_max < 1e-12 && found.residual_rms <= found.residual_max);
        let unit = found.outer_from_inner.rotation;
        assert!((unit * unit.transpose() - Matrix3::identity()).amax() < 4e-15 && unit.determinant() > 0.0);
    }
}

#[test]
fn no_other_pose_leaves_less() {
    let mut random = Random(2);
    for _ in 0..500 {
        let truth = pose(&mut random);
        let count = 3 + random.below(10) as usize;
        let pairs = pairs(&mut random, &truth, count, [1.0, 0.8, 0.5], 0.05);
        let found = register(&pairs).expect("they hold a frame");
        for _ in 0..20 {
            let step = Pose::from_rotation_vector(vector(&mut random, 1e-3), vector(&mut random, 1e-3));
            let other = Registration { outer_from_inner: step * found.outer_from_inner, ..found };
            let rms = |found: &Registration| pairs.iter().map(|pair| found.residual(pair).norm_squared()).sum::<f64>();
            assert!(rms(&other) > rms(&found));
        }
        let squares = pairs.iter().map(|pair| found.residual(pair).norm_squared());
        let largest = squares.clone().fold(0.0, f64::max).sqrt();
        assert_eq!(largest, found.residual_max);
        assert_eq!(found.residual(&pairs[found.residual_max_pair]).norm(), largest);
        assert!((found.residual_rms - (squares.sum::<f64>() / pairs.len() as f64).sqrt()).abs() < 1e-15);
    }
}

#[test]
fn levers_are_the_points_distances_from_the_axes() {
    let mut random = Random(3);
    for _ in 0..1000 {
        let truth = pose(&mut random);
        let pairs = pairs(&mut random, &truth, 12, [1.0, 0.5, 0.2], 0.0);
        let found = register(&pairs).expect("they hold a frame");
        let centroid = pairs.iter().map(|pair| pair.in_outer).sum::<Vector3<f64>>() / 12.0;
        for (axis, lever) in found.axes_in_outer.column_iter().zip(&found.levers) {
            let squared = pairs.iter().map(|pair| axis.cross(&(pair.in_outer - centroid)).norm_squared()).sum::<f64>();
            assert!(((squared / 12.0).sqrt() - lever).abs() < 1e-12);
        }
        assert!(found.levers.x <= found.levers.y && found.levers.y <= found.levers.z);
    }
}

/// Normalised squared error of 4,000 poses against χ² with six degrees of freedom, and the noise found against the
/// noise given.
#[test]
fn the_covariance_is_that_of_the_errors() {
    const RUNS: usize = 4000;
    let mut random = Random(4);
    for (count, size) in [(4, [1.0, 1.0, 1.0]), (8, [2.0, 0.5, 0.0]), (30, [1.0, 0.1, 0.05])] {
        let sigma = 2e-5;
        let (mut sum, mut variance, mut outside) = (0.0, 0.0, 0);
        for _ in 0..RUNS {
            let truth = pose(&mut random);
            let found = register(&pairs(&mut random, &truth, count, size, sigma)).expect("they hold a frame");
            let turn = rotation_error(&found, &truth);
            let shift = truth.translation - found.outer_from_inner.translation;
            let error = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
            let inverse = found.covariance(sigma).try_inverse().expect("a covariance is regular");
            let squared = (error.transpose() * inverse * error).x;
            sum += squared;
            outside += usize::from(squared > 12.5916); // the 95 % point of χ²(6)
            variance += found.sigma() * found.sigma();
        }
        // Mean of RUNS values of χ²(6): 6 with the standard deviation √(12 / RUNS); of χ²(3·count − 6) over its degrees
        // likewise.
        let mean = sum / RUNS as f64;
        assert!((mean - 6.0).abs() < 1.96 * (12.0 / RUNS as f64).sqrt(), "{count} points: {mean}");
        let degrees = 3.0 * count as f64 - 6.0;
        let ratio = variance / RUNS as f64 / (sigma * sigma);
        assert!((ratio - 1.0).abs() < 1.96 * (2.0 / (degrees * RUNS as f64)).sqrt(), "{count} points: {ratio}");
        let share = outside as f64 / RUNS as f64;
        assert!((share - 0.05).abs() < 1.96 * (0.05 * 0.95 / RUNS as f64).sqrt(), "{count} points: {share}");
    }
}

#[test]
fn a_mirror_image_is_seen_and_not_taken_for_a_turn() {
    let mut random = Random(5);
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    for _ in 0..1000 {
        let truth = pose(&mut random);
        let mut pairs = pairs(&mut random, &truth, 6, [1.0, 0.7, 0.4], 0.0);
        for pair in &mut pairs {
            pair.in_inner = mirror * pair.in_inner;
        }
        match register(&pairs) {
            Ok(found) => {
                assert!(found.outer_from_inner.rotation.determinant() > 0.999);
                assert!(found.mirrored_rms < 1e-14 && found.residual_rms > 1e-3);
            }
            Err(error) => assert!(matches!(error, RegistrationError::Ambiguous { .. }), "{error:?}"),
        }
    }
    // Round about an axis and mirrored: every turn about it is as good.
    let round = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vector3::from);
    let pairs = round.map(|point| PointPair { in_outer: point, in_inner: mirror * point });
    assert!(matches!(register(&pairs), Err(RegistrationError::Ambiguous { .. })));
    // In a plane there is no handedness.
    let flat = round.map(|point| PointPair { in_outer: Vector3::new(point.x, 3.0 * point.y, 0.0), in_inner: point });
    let flat = flat.map(|pair| PointPair { in_inner: mirror * pair.in_outer, ..pair });
    let found = register(&flat).expect("they hold a frame");
    assert!(found.residual_rms < 1e-15 && found.mirrored_rms < 1e-15);
}

#[test]
fn what_holds_no_frame_is_refused_by_name() {
    let pair = |x: f64, y: f64, z: f64| PointPair { in_outer: Vector3::new(x, y, z), in_inner: Vector3::new(y, z, x) };
    let corner = [pair(0.0, 0.0, 0.0), pair(1.0, 0.0, 0.0), pair(0.0, 1.0, 0.0)];
    assert!(register(&corner).is_ok());
    assert_eq!(register(&[]), Err(RegistrationError::TooFew { found: 0 }));
    assert_eq!(register(&corner[..2]), Err(RegistrationError::TooFew { found: 2 }));
    for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1.1e6, f64::MAX] {
        let mut spoilt = corner;
        spoilt[1].in_inner.z = bad;
        assert_eq!(register(&spoilt), Err(RegistrationError::Coordinate { pair: 1 }));
        spoilt = corner;
        spoilt[2].in_outer.x = bad;
        assert_eq!(register(&spoilt), Err(RegistrationError::Coordinate { pair: 2 }));
    }
    assert!(matches!(register(&[corner[1]; 5]), Err(RegistrationError::Coincident { spread: 0.0 })));
    let line: Vec<_> = (0..9).map(|k| pair(f64::from(k), 2.0 * f64::from(k), -1.0 + f64::from(k))).collect();
    let Err(RegistrationError::Collinear { axis_in_outer, lever }) = register(&line) else { panic!("a line") };
    assert!(axis_in_outer.cross(&Vector3::new(1.0, 2.0, 1.0)).norm() < 1e-12 && lever < 1e-6);
    // A line bent by 10 µm in 20 m is one, by 10 mm it is none.
    let bent = |by: f64| {
        let mut bent = line.clone();
        bent[4].in_outer.x += by;
        bent[4].in_inner.z += by;
        register(&bent)
    };
    assert!(matches!(bent(1e-5), Err(RegistrationError::Collinear { .. })));
    assert!(bent(1e-2).is_ok());
    // Points that do not belong together: each other's place in a regular tetrahedron, the sum of products is nothing.
    let place = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vector3::from);
    let swapped = [(0, 0), (1, 0), (0, 1), (1, 1)]
        .map(|(outer, inner): (usize, usize)| PointPair { in_outer: place[outer], in_inner: place[2 + inner] });
    assert!(matches!(register(&swapped), Err(RegistrationError::Ambiguous { .. })));
}

#[test]
fn nothing_that_comes_in_leaves_a_pose_that_is_none() {
    let mut random = Random(6);
    let mut found = 0;
    for _ in 0..200_000 {
        let count = random.below(7) as usize;
        let number = |random: &mut Random| match random.below(6) {
            0 => 0.0,
            1 => f64::from_bits(random.bits()),
            2 => 10_f64.powf(random.between(-20.0, 6.0)),
            _ => random.between(-1.0, 1.0),
        };
        let pairs: Vec<_> = (0..count)
            .map(|_| PointPair {
                in_outer: Vector3::from_fn(|_, _| number(&mut random)),
                in_inner: Vector3::from_fn(|_, _| number(&mut random)),
            })
            .collect();
        if let Ok(result) = register(&pairs) {
            found += 1;
            let unit = result.outer_from_inner.rotation;
            assert!((unit * unit.transpose() - Matrix3::identity()).amax() < 1e-13, "{pairs:?}");
            assert!(result.outer_from_inner.is_finite() && result.residual_rms.is_finite() && result.levers.x > 0.0);
            assert!(result.covariance(1e-5).iter().all(|value| value.is_finite()), "{pairs:?}");
        }
    }
    assert!(found > 1000, "{found}");
}
