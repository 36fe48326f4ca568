use super::is_chi_squared;
use super::random::{measured, pose};
use crate::calibrate::pose_fit::TrackerNoise;
use crate::calibrate::target::{Frames, PosePair, calibrate};
use crate::calibrate::{CalibrateError, swing};
use nalgebra::{SVector, Vector3};
use screed_kernel::pose::Pose;
use screed_tape::random::Random;
use std::f64::consts::PI;

/// Half of the published maximum permissible error, as one standard deviation: 7.5 µm + 3 µm/m; 0.01°.
pub const TRACKER: TrackerNoise =
    TrackerNoise { position: 7.5e-6, position_per_metre: 3e-6, rotation: 0.01 * PI / 180.0 };

/// Frames as they stand in a cell: the target near the flange, the tracker some metres off.
fn frames(random: &mut Random) -> Frames {
    Frames { flange_from_target: pose(random, 0.2, PI), tracker_from_base: pose(random, 4.0, PI) }
}

fn poses(random: &mut Random, frames: &Frames, count: usize, turn: f64) -> Vec<PosePair> {
    let one = |_| {
        let base_from_flange = pose(random, 1.0, turn);
        PosePair { base_from_flange, tracker_from_target: frames.predicted(&base_from_flange) }
    };
    (0..count).map(one).collect()
}

/// Shifts of the origins (m) and turns (rad) that lead from some frames to others, ordered as the covariance is.
fn offsets(from: &Frames, to: &Frames) -> SVector<f64, 12> {
    let mut offsets = SVector::<f64, 12>::zeros();
    for (row, from, to) in
        [(0, &from.flange_from_target, &to.flange_from_target), (6, &from.tracker_from_base, &to.tracker_from_base)]
    {
        let turn = Pose { rotation: to.rotation * from.rotation.transpose(), translation: Vector3::zeros() };
        offsets.fixed_rows_mut::<3>(row).copy_from(&(to.translation - from.translation));
        offsets.fixed_rows_mut::<3>(row + 3).copy_from(&turn.rotation_vector());
    }
    offsets
}

#[test]
fn the_closed_form_is_exact_on_exact_poses() {
    let mut random = Random(21);
    for case in 0..500 {
        let truth = frames(&mut random);
        // From three poses on, from small turns to large ones.
        let (count, turn) = (3 + case % 8, [0.3, 1.0, PI][case % 3]);
        let poses = poses(&mut random, &truth, count, turn);
        let Ok(swing) = swing::held(poses.iter().map(|pair| pair.base_from_flange)) else { continue };
        let found = Frames::closed_form(&poses).expect("a start");
        let miss = offsets(&found, &truth).amax() * swing * swing;
        assert!(miss < 1e-12, "case {case}: {miss:e}");
    }
}

#[test]
fn the_jacobian_is_that_of_finite_differences() {
    let mut random = Random(22);
    let one = TrackerNoise { position: 1.0, position_per_metre: 0.3, rotation: 1.0 };
    for _ in 0..50 {
        let truth = frames(&mut random);
        // Far from the measurements too: residuals of up to half a turn.
        let mut poses = poses(&mut random, &truth, 3, 2.0);
        for pair in &mut poses {
            pair.tracker_from_target = pair.tracker_from_target * pose(&mut random, 0.5, 2.5);
        }
        let system = truth.system(&poses, &one);
        for parameter in 0..12 {
            let at = |h: f64| {
                let mut step = nalgebra::DVector::zeros(12);
                step[parameter] = h;
                truth.moved(&step).system(&poses, &one).residual
            };
            let h = 1e-5;
            let slope = (at(h) - at(-h)) / (2.0 * h);
            let miss = (slope + system.jacobian.column(parameter)).amax();
            assert!(miss < 1e-7, "{parameter}: {miss:e}");
        }
    }
}

#[test]
fn planted_frames_come_back_within_their_covariance() {
    const RUNS: usize = 400;
    const POSES: usize = 20;
    let mut random = Random(23);
    let (mut squared, mut chi_squared, mut inside) = (0.0, 0.0, 0);
    for _ in 0..RUNS {
        let truth = frames(&mut random);
        let mut poses = poses(&mut random, &truth, POSES, 1.0);
        for pair in &mut poses {
            pair.tracker_from_target = measured(&mut random, &pair.tracker_from_target, &TRACKER);
        }
        let found = calibrate(&poses, &TRACKER).expect("frames");
        let frames =
            Frames { flange_from_target: found.flange_from_target, tracker_from_base: found.tracker_from_base };
        let error = offsets(&frames, &truth);
        let inverse = found.covariance.try_inverse().expect("a covariance is regular");
        squared += (error.transpose() * inverse * error).x;
        chi_squared += found.fit.chi_squared;
        assert_eq!(found.fit.degrees, 6 * POSES - 12);
        let [low, high] = found.fit.noise_ratio_band();
        inside += usize::from((low..=high).contains(&found.fit.noise_ratio()));
    }
    let [squared, chi_squared] = [squared, chi_squared].map(|sum| sum / RUNS as f64);
    assert!(is_chi_squared(squared, 12, RUNS), "{squared}");
    assert!(is_chi_squared(chi_squared, 6 * POSES - 12, RUNS), "{chi_squared}");
    let share = inside as f64 / RUNS as f64;
    assert!((share - 0.95).abs() < 1.96 * (0.95 * 0.05 / RUNS as f64).sqrt(), "{share}");
}

#[test]
fn what_leaves_the_frames_open_is_refused() {
    let mut random = Random(24);
    let truth = frames(&mut random);
    let axis = Vector3::new(0.48, -0.6, 0.64);
    let about_one = |k: i32| {
        let turn = Pose::from_rotation_vector(Vector3::zeros(), axis * (0.2 * f64::from(k)));
        let base_from_flange = Pose::from_translation(0.1 * f64::from(k % 4), 0.2, 0.1 * f64::from(k % 3)) * turn;
        PosePair { base_from_flange, tracker_from_target: truth.predicted(&base_from_flange) }
    };
    let one_axis: Vec<_> = (0..12).map(about_one).collect();
    let refused = calibrate(&one_axis, &TRACKER).expect_err("one axis");
    let CalibrateError::OneAxis { axis_in_flange, .. } = refused else { panic!("{refused:?}") };
    assert!(axis_in_flange.cross(&axis).norm() < 1e-6);
    let mut sound = poses(&mut random, &truth, 10, 1.0);
    assert!(matches!(calibrate(&sound[..2], &TRACKER), Err(CalibrateError::TooFew { found: 2, least: 3, .. })));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let noise = TrackerNoise { rotation: bad, ..TRACKER };
        assert!(matches!(calibrate(&sound, &noise), Err(CalibrateError::Noise { .. })), "{bad}");
    }
    // Poses that do not belong together either do not converge or show it.
    sound.rotate_left(1);
    let shifted: Vec<_> = sound
        .iter()
        .zip(sound.iter().cycle().skip(1))
        .map(|(a, b)| PosePair { tracker_from_target: b.tracker_from_target, ..*a })
        .collect();
    match calibrate(&shifted, &TRACKER) {
        Ok(found) => assert!(found.fit.noise_ratio() > 100.0),
        Err(error) => assert!(matches!(error, CalibrateError::NotConverged { .. }), "{error:?}"),
    }
    sound[4].tracker_from_target.rotation[(1, 2)] = f64::NAN;
    assert!(matches!(calibrate(&sound, &TRACKER), Err(CalibrateError::NotFinite { measurement: 4 })));
}
