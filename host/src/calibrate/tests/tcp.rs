use super::is_chi_squared;
use super::random::{normals, pose};
use crate::calibrate::CalibrateError;
use crate::calibrate::tcp::pivot;
use nalgebra::{Vector3, Vector6};
use screed_kernel::pose::Pose;
use screed_tape::random::Random;

/// Flange poses that put the tip at the point, but for noise.
fn touches(random: &mut Random, tip: &Vector3<f64>, point: &Vector3<f64>, count: usize, sigma: f64) -> Vec<Pose> {
    let one = |_| {
        let rotation = pose(random, 0.0, 0.8).rotation;
        Pose { rotation, translation: point - rotation * tip + normals(random, sigma) }
    };
    (0..count).map(one).collect()
}

#[test]
fn a_tip_comes_back_within_its_covariance() {
    const RUNS: usize = 1000;
    let mut random = Random(11);
    let (sigma, count) = (5e-5, 12);
    let (mut squared, mut chi_squared, mut shown) = (0.0, 0.0, 0.0);
    for _ in 0..RUNS {
        let (tip, point) = (normals(&mut random, 0.2), normals(&mut random, 1.0));
        let poses = touches(&mut random, &tip, &point, count, sigma);
        let found = pivot(&poses, Some(sigma)).expect("a tip");
        let (tip, point) = (tip - found.tip_in_flange, point - found.point_in_base);
        let error = Vector6::new(tip.x, tip.y, tip.z, point.x, point.y, point.z);
        let inverse = found.covariance.try_inverse().expect("a covariance is regular");
        squared += (error.transpose() * inverse * error).x;
        let fit = found.fit.expect("the noise was given");
        assert_eq!(fit.degrees, 3 * count - 6);
        chi_squared += fit.chi_squared;
        // Without the noise, the residuals tell it, and the covariance is as much larger.
        let told = pivot(&poses, None).expect("a tip");
        assert!((told.sigma - sigma * fit.noise_ratio()).abs() < 1e-12 && told.fit.is_none());
        assert!((told.covariance / (told.sigma * told.sigma) - found.covariance / (sigma * sigma)).amax() < 1e-9);
        shown += told.sigma * told.sigma / RUNS as f64;
    }
    assert!(is_chi_squared(squared / RUNS as f64, 6, RUNS), "{}", squared / RUNS as f64);
    assert!(is_chi_squared(chi_squared / RUNS as f64, 3 * count - 6, RUNS), "{}", chi_squared / RUNS as f64);
    assert!((shown.sqrt() / sigma - 1.0).abs() < 0.01);
}

#[test]
fn exact_touches_give_the_tip_to_rounding() {
    let mut random = Random(12);
    for _ in 0..200 {
        let (tip, point) = (normals(&mut random, 0.2), normals(&mut random, 1.0));
        let found = pivot(&touches(&mut random, &tip, &point, 8, 0.0), None).expect("a tip");
        let miss = (found.tip_in_flange - tip).norm().max((found.point_in_base - point).norm()) * found.swing;
        assert!(miss < 1e-14, "{miss:e}");
        assert!(found.residuals.iter().all(|residual| residual.norm() < 1e-14), "{:?}", found.residuals);
    }
}

#[test]
fn what_leaves_the_tip_open_is_refused() {
    let mut random = Random(13);
    let (tip, point) = (Vector3::new(0.01, 0.02, 0.3), Vector3::new(1.0, 0.2, 0.3));
    let about = |axis: Vector3<f64>, angle: f64| {
        let rotation = Pose::from_rotation_vector(Vector3::zeros(), axis * angle).rotation;
        Pose { rotation, translation: point - rotation * tip }
    };
    let axis = Vector3::new(0.0, 0.6, 0.8);
    let one_axis: Vec<_> = (0..10).map(|k| about(axis, 0.3 * f64::from(k))).collect();
    let refused = pivot(&one_axis, None).expect_err("one axis");
    let CalibrateError::OneAxis { axis_in_flange, swing } = &refused else { panic!("{refused:?}") };
    assert!(axis_in_flange.cross(&axis).norm() < 1e-6 && *swing < 1e-6);
    assert!(refused.to_string().contains("one axis only") && refused.to_string().contains("; add poses"));
    let still: Vec<_> = (0..10).map(|k| about(axis, 1e-3 * f64::from(k))).collect();
    assert_eq!(pivot(&still, None), Err(CalibrateError::NoTurn));
    let mut poses = touches(&mut random, &tip, &point, 5, 0.0);
    assert!(matches!(pivot(&poses[..2], None), Err(CalibrateError::TooFew { found: 2, least: 3, .. })));
    assert_eq!(pivot(&poses, Some(0.0)), Err(CalibrateError::Noise { found: 0.0 }));
    assert!(matches!(pivot(&poses, Some(f64::NAN)), Err(CalibrateError::Noise { .. })));
    poses[3].translation.y = f64::NAN;
    assert_eq!(pivot(&poses, None), Err(CalibrateError::NotFinite { measurement: 3 }));
}
