//! The filter against a dense one, against its own statistics, and against input that makes no sense.

mod common;

use common::Random;
use common::dense::{Dense, matrix, stack};
use common::estimation::{against_dense, consistency, dropout, long};
use common::plant::{DENSITY, N, Noise, PAPER, Plant, TRACKER, deviation};
use nalgebra::Vector3;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::{Ekf, EkfError, GATES, State, Verdict};
use screed_kernel::units::{JointJerk, JointPos, JointVel};

const NOISES: [Noise; 2] = [TRACKER, PAPER];

#[test]
fn blocks_and_a_dense_filter_in_josephs_form_agree() {
    for noise in NOISES {
        let apart = against_dense(1, noise, 3000);
        assert!(apart.state <= 1e-6 && apart.covariance <= 1e-7, "{noise:?}: {apart:?}");
    }
}

#[test]
fn errors_and_innovations_are_as_large_as_the_filter_says_and_innovations_white() {
    for noise in NOISES {
        let result = consistency(100..150, noise, 400, 20);
        result.judge(&format!("{noise:?}"), [50.0 * 200.0, 50.0 * 400.0]);
    }
}

#[test]
fn three_sigma_stay_honest_through_dropouts_of_a_tick_to_five_seconds() {
    for noise in NOISES {
        for ticks in [1, 10, 100, 1000, 5000] {
            let covered = dropout(0..30, noise, ticks);
            assert!(covered >= 0.99, "{noise:?}: {ticks} ticks: {covered}");
        }
    }
}

#[test]
fn outliers_of_a_metre_change_nothing() {
    let mut plant = Plant::new(5, TRACKER, 1e-3);
    let mut ekf = plant.filter();
    let mut gated = 0;
    for tick in 0..2000 {
        let jerk = plant.step();
        ekf.predict(plant.dt, &jerk).unwrap();
        let mut pose = plant.pose();
        if tick > 100 && tick % 7 == 0 {
            let way = Vector3::from(plant.random.normals(1.0)).normalize();
            pose.tracker_from_target.translation += way;
            let before = ekf;
            let verdict = ekf.pose(&UR10E, &pose).unwrap();
            assert!(matches!(verdict, Verdict::Gated { nis, gate } if nis > gate), "{verdict:?}");
            assert_eq!(ekf, before);
            gated += 1;
        } else {
            ekf.pose(&UR10E, &pose).unwrap();
        }
    }
    assert!(gated > 250);
    let error = stack(&plant.truth) - stack(ekf.state());
    let joints = (0..N).map(|i| error[i].abs()).fold(0.0, f64::max);
    assert!(joints < 1e-3, "{joints}");
}

#[test]
fn the_covariance_stays_positive_and_symmetric() {
    for noise in NOISES {
        let result = long(9, noise, 20_000, 500);
        assert!(result.scaled_min > 0.0, "{result:?}");
    }
    let mut plant = Plant::new(5, TRACKER, 1e-3);
    let mut ekf = plant.filter();
    for _ in 0..1000 {
        let jerk = plant.step();
        ekf.predict(plant.dt, &jerk).unwrap();
        ekf.pose(&UR10E, &plant.pose()).unwrap();
        let p = ekf.covariance();
        for (i, j) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))) {
            assert!(p.qq[i][j] == p.qq[j][i] && p.vv[i][j] == p.vv[j][i] && p.aa[i][j] == p.aa[j][i]);
        }
    }
}

/// With the command as input a motion that follows it is no surprise; without, the estimate lags.
#[test]
fn a_commanded_motion_does_not_lag() {
    let worst = |known: bool| {
        let mut plant = Plant::new(3, TRACKER, 1e-3);
        let mut ekf = Ekf::new(plant.truth, &deviation(&TRACKER), &[0.01; N]).unwrap();
        let mut worst: f64 = 0.0;
        for tick in 0..2000 {
            let jerk = JointJerk([80.0 * (0.01 * f64::from(tick)).cos(); N]);
            plant.truth = plant.truth.after(1e-3, &jerk);
            ekf.predict(1e-3, if known { &jerk } else { &JointJerk::ZERO }).unwrap();
            ekf.pose(&UR10E, &plant.pose()).unwrap();
            let off = ekf.state().position.0[0] - plant.truth.position.0[0];
            worst = worst.max(if tick > 500 { off.abs() } else { 0.0 });
        }
        worst
    };
    let (known, unknown) = (worst(true), worst(false));
    assert!(known < 3e-4 && unknown > 100.0 * known, "{known:e} {unknown:e}");
}

#[test]
fn a_state_after_a_time_is_where_constant_jerk_leads() {
    let mut random = Random(4);
    let mut state = State::at_rest(JointPos(random.normals(1.0)));
    state.velocity.0 = random.normals(1.0);
    state.acceleration.0 = random.normals(1.0);
    let jerk = JointJerk(random.normals(1.0));
    let (whole, mut steps) = (state.after(0.5, &jerk), state);
    for _ in 0..1000 {
        steps = steps.after(0.5e-3, &jerk);
    }
    assert!((stack(&whole) - stack(&steps)).amax() < 1e-12);
    let q = state.position.0[2] + 0.5 * (state.velocity.0[2] + 0.25 * (state.acceleration.0[2] + jerk.0[2] / 6.0));
    assert!((whole.position.0[2] - q).abs() < 1e-15);
}

/// By integrating the density of χ².
#[test]
fn gates_leave_one_good_measurement_in_a_hundred_thousand_outside() {
    for (k, gate) in (1..).zip(GATES) {
        let half = 0.5 * f64::from(k);
        // Γ(k/2): from Γ(1/2) = √π and Γ(1) = 1 by Γ(x + 1) = x·Γ(x).
        let (mut gamma, mut x) = if k % 2 == 1 { (std::f64::consts::PI.sqrt(), 0.5) } else { (1.0, 1.0) };
        while x < half - 0.25 {
            gamma *= x;
            x += 1.0;
        }
        let density = |x: f64| x.powf(half - 1.0) * (-0.5 * x).exp() / (2f64.powf(half) * gamma);
        let above: f64 = (0..100_000).map(|i| 1e-3 * density(gate + (f64::from(i) + 0.5) * 1e-3)).sum();
        assert!((above - 1e-5).abs() < 5e-9, "{k}: {above}");
    }
}

#[test]
fn input_without_sense_is_named_and_changes_nothing() {
    let mut plant = Plant::new(8, TRACKER, 1e-3);
    let mut ekf = plant.filter();
    ekf.predict(1e-3, &JointJerk::ZERO).unwrap();
    let before = ekf;
    for dt in [0.0, -1e-3, f64::NAN, f64::INFINITY, 11.0] {
        assert!(matches!(ekf.predict(dt, &JointJerk::ZERO), Err(EkfError::Step { .. })), "{dt}");
    }
    let nan = JointJerk([0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0]);
    assert_eq!(ekf.predict(1e-3, &nan), Err(EkfError::NotFinite));
    let far = JointJerk([f64::MAX; N]);
    assert_eq!(ekf.predict(9.0, &far), Err(EkfError::NotFinite));
    let good = plant.pose();
    for bad in [f64::NAN, f64::INFINITY] {
        let mut pose = good;
        pose.tracker_from_target.translation.y = bad;
        assert_eq!(ekf.pose(&UR10E, &pose), Err(EkfError::NotFinite));
        let mut pose = good;
        pose.tracker_from_target.rotation[(1, 1)] = bad;
        assert!(matches!(ekf.pose(&UR10E, &pose), Err(EkfError::Rotation { .. })));
        let mut pose = good;
        pose.flange_from_target.rotation[(1, 1)] = bad;
        assert_eq!(ekf.pose(&UR10E, &pose), Err(EkfError::NotFinite));
        assert_eq!(ekf.rates(&JointVel([bad; N]), &JointVel([1.0; N])), Err(EkfError::NotFinite));
        assert_eq!(ekf.encoders(&JointPos([bad; N]), &JointPos([1.0; N])), Err(EkfError::NotFinite));
    }
    let mut pose = good;
    pose.tracker_from_target.rotation *= 1.001;
    assert!(matches!(ekf.pose(&UR10E, &pose), Err(EkfError::Rotation { miss }) if miss > 1e-3));
    for value in [0.0, -1.0, f64::INFINITY] {
        let pose = {
            let mut pose = good;
            pose.rotation_deviation = value;
            pose
        };
        assert_eq!(ekf.pose(&UR10E, &pose), Err(EkfError::Noise { value }));
        assert_eq!(ekf.rates(&JointVel::ZERO, &JointVel([value; N])), Err(EkfError::Noise { value }));
        assert_eq!(ekf.encoders(&JointPos::ZERO, &JointPos([value; N])), Err(EkfError::Noise { value }));
        let state = *ekf.state();
        assert_eq!(Ekf::new(state, &deviation(&TRACKER), &[value; N]), Err(EkfError::Noise { value }));
    }
    assert_eq!(
        Ekf::new(State::at_rest(JointPos([f64::NAN; N])), &deviation(&TRACKER), &DENSITY),
        Err(EkfError::NotFinite)
    );
    assert_eq!(ekf, before);
}

/// One update, by the dense filter's own words: what a pose does to the state.
#[test]
fn a_pose_moves_the_estimate_towards_the_truth() {
    let mut plant = Plant::new(6, TRACKER, 1e-3);
    let mut ekf = plant.filter();
    let before = (stack(&plant.truth) - stack(ekf.state())).fixed_rows::<N>(0).norm();
    let dense = Dense::of(&ekf);
    let pose = plant.pose();
    let nis = dense.white(&dense.pose(&pose)).norm_squared();
    let verdict = ekf.pose(&UR10E, &pose).unwrap();
    assert!((verdict.nis() - nis).abs() < 1e-6 * nis);
    let after = (stack(&plant.truth) - stack(ekf.state())).fixed_rows::<N>(0).norm();
    assert!(after < 0.5 * before, "{before} {after}");
}

/// From far away one tangent does not reach the measured place; a second one from there does. Near it there is nothing to gain.
#[test]
fn an_iterated_pose_comes_nearer_to_what_was_measured() {
    let (mut once_off, mut twice_off) = (0.0, 0.0);
    for seed in 0..50 {
        let mut plant = Plant::new(seed, TRACKER, 1e-3);
        let far = deviation(&PAPER);
        let mut start = plant.truth;
        for q in &mut start.position.0 {
            *q += far.position.0[0] * plant.random.normal();
        }
        let pose = plant.pose();
        let mut once = Ekf::new(start, &far, &DENSITY).unwrap();
        let mut twice = once;
        let (first, second) = (once.pose(&UR10E, &pose).unwrap(), twice.pose_iterated(&UR10E, &pose).unwrap());
        assert!(first.is_taken() && second.is_taken());
        let off = |ekf: &Ekf<N>| Dense::of(ekf).pose(&pose).y.fixed_rows::<3>(0).norm();
        (once_off, twice_off) = (once_off + off(&once), twice_off + off(&twice));
    }
    assert!(twice_off < 0.7 * once_off, "{once_off} {twice_off}");
    let mut plant = Plant::new(1, TRACKER, 1e-3);
    let mut ekf = plant.filter();
    for _ in 0..300 {
        let jerk = plant.step();
        ekf.predict(plant.dt, &jerk).unwrap();
        ekf.pose(&UR10E, &plant.pose()).unwrap();
    }
    let mut twice = ekf;
    let pose = plant.pose();
    ekf.pose(&UR10E, &pose).unwrap();
    twice.pose_iterated(&UR10E, &pose).unwrap();
    let sigma = matrix(&ekf).diagonal().map(f64::sqrt);
    let apart = (stack(ekf.state()) - stack(twice.state())).component_div(&sigma).amax();
    assert!(apart < 1e-2, "{apart}");
}
