//! The estimate of the base against its own statistics and a dense filter, and the correction against its bounds.

mod common;

use common::Random;
use common::base::{DRIFT, Dense, LIMITS, Sim, config, list, matrix, swinging};
use common::estimation::{band, mean};
use nalgebra::{SMatrix, Vector3};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::base::history::{History, HistoryError};
use screed_kernel::base::{
    Base, BaseConfig, BaseError, BaseLimits, Displacement, Drift, Excess, Output, Part, Trust, Verdict,
};
use screed_kernel::ekf::EkfError;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};

/// A simulation that has its estimate, after half a second at rest.
fn acquired(seed: u64, config: BaseConfig) -> Sim {
    let mut sim = Sim::new(seed, config);
    for tick in 0..500 {
        sim.steady();
        let measurement = sim.measurement();
        let verdict = sim.base.measure(&UR10E, &measurement).unwrap();
        let first = config.agreeing - 1;
        assert!((verdict == Verdict::Acquired) == (tick == first), "{tick}: {verdict:?}");
        sim.base.tick(sim.now).unwrap();
    }
    sim
}

#[test]
fn errors_and_innovations_are_as_large_as_the_filter_says() {
    let (mut nees, mut nis, mut looks) = (Vec::new(), Vec::new(), 0);
    for seed in 0..60 {
        let mut sim = Sim::new(seed, swinging());
        sim.any_rate();
        let (mut errors, mut innovations) = ((0.0, 0.0), (0.0, 0.0));
        for tick in 0..2000 {
            sim.wander();
            let measurement = sim.measurement();
            let verdict = sim.base.measure(&UR10E, &measurement).unwrap();
            if tick >= 20 {
                let (Verdict::Taken { nis } | Verdict::Gated { nis, .. }) = verdict else {
                    panic!("seed {seed}, {tick}: {verdict:?}")
                };
                innovations = (innovations.0 + nis, innovations.1 + 1.0);
            }
            if tick % 100 == 99 {
                let estimate = sim.base.estimate().unwrap();
                let error = sim.error(estimate);
                errors = (errors.0 + error.dot(&matrix(estimate).cholesky().unwrap().solve(&error)), errors.1 + 1.0);
                looks += 1;
            }
        }
        nees.push(errors.0 / errors.1);
        nis.push(innovations.0 / innovations.1);
    }
    // Errors of neighbouring looks are not independent: their band comes from the scatter of the runs.
    let (mean_nees, own) = mean(&nees);
    assert!((mean_nees - 24.0).abs() <= own, "NEES {mean_nees} ± {own}, {looks} looks");
    let (mean_nis, half) = (mean(&nis).0, band(6.0, 60.0 * 1980.0));
    assert!((mean_nis - 6.0).abs() <= half, "NIS {mean_nis} ± {half}");
    println!("NEES {mean_nees:.3} ± {own:.3} of 24, NIS {mean_nis:.4} ± {half:.4} of 6");
}

/// The dense filter takes its Jacobians from central differences and its process noise from an integral. Where nothing swings the
/// kernel looks at half of the state, and the dense filter at all of it.
#[test]
fn blocks_and_a_dense_filter_in_josephs_form_agree() {
    agree(&config());
    agree(&swinging());
}

fn agree(config: &BaseConfig) {
    let mut sim = acquired(3, *config);
    let mut dense = Dense::of(sim.base.estimate().unwrap());
    let mut coin = Random(9);
    let mut last = sim.now;
    for tick in 0..2000 {
        sim.wander();
        sim.base.tick(sim.now).unwrap();
        let measurement = sim.measurement();
        if coin.below(3) == 0 {
            continue;
        }
        let Verdict::Taken { nis } = sim.base.measure(&UR10E, &measurement).unwrap() else { panic!() };
        let other = dense.step(&sim.config, sim.now.since(last) as f64 * 1e-9, &measurement);
        last = sim.now;
        // The kernel turns the arm's noise by the measured rotation, the dense filter by the estimated one.
        assert!((nis - other).abs() < 1e-3 * (1.0 + nis), "{tick}: {nis} {other}");
        let estimate = sim.base.estimate().unwrap();
        let sigma = dense.p.diagonal().map(f64::sqrt);
        // What does not swing is known to be zero.
        let inverse = sigma.map(|sigma| if sigma > 0.0 { 1.0 / sigma } else { f64::MAX });
        let scale = SMatrix::<f64, 24, 24>::from_diagonal(&inverse);
        let apart = (scale * (matrix(estimate) - dense.p) * scale).amax();
        assert!(apart < 1e-3, "{tick}: covariance {apart}");
        for (part, found) in
            [estimate.place(), estimate.rate(), estimate.swing(), estimate.swing_rate()].iter().enumerate()
        {
            let apart =
                (list(found) - dense.x.fixed_rows::<6>(6 * part)).component_mul(&inverse.fixed_rows::<6>(6 * part));
            assert!(apart.amax() < 1e-3, "{tick}: part {part} of the state {apart}");
        }
    }
}

/// The paper's disturbance. Figures in docs/estimation.md.
#[test]
fn a_drift_of_three_millimetres_a_second_in_any_direction_is_followed() {
    let (mut squares, mut worst, mut count) = ([0.0; 3], [0.0_f64; 3], 0);
    for seed in 0..60 {
        let mut sim = acquired(1000 + seed, config());
        sim.rate.translation = Vector3::from(sim.random.normals(1.0)).normalize() * 3e-3;
        for tick in 0..3000 {
            sim.steady();
            let measurement = sim.measurement();
            sim.base.measure(&UR10E, &measurement).unwrap();
            sim.base.tick(sim.now).unwrap();
            if tick >= 500 {
                let [pivot, turn] = sim.off();
                for (k, off) in [sim.flange_off(), pivot, turn].into_iter().enumerate() {
                    squares[k] += off * off;
                    worst[k] = worst[k].max(off);
                }
                count += 1;
            }
        }
    }
    for ((what, square), worst) in ["flange, µm", "pivot, µm", "rotation, µrad"].iter().zip(squares).zip(worst) {
        println!(
            "drift of 3 mm/s: {what}: {:.1} rms, {:.1} worst",
            1e6 * (square / f64::from(count)).sqrt(),
            1e6 * worst
        );
    }
    let flange = (squares[0] / f64::from(count)).sqrt();
    assert!(flange < 30e-6 && worst[0] < 100e-6, "{flange} {worst:?}");
    assert!(worst[1] < 200e-6 && worst[2] < 150e-6, "{worst:?}");
}

/// Holds outputs against the bounds, by differences.
struct Judge {
    limits: BaseLimits,
    last: Option<Displacement>,
    rate: Option<Displacement>,
}

impl Judge {
    fn new(limits: BaseLimits) -> Self {
        Self { limits, last: None, rate: None }
    }

    fn see(&mut self, output: &Output) {
        let now = output.displacement;
        let BaseLimits { translation_max, velocity_max, acceleration_max, .. } = self.limits;
        let BaseLimits { rotation_max, turn_rate_max, turn_acceleration_max, .. } = self.limits;
        let slack = 1.0 + 1e-6;
        assert!(now.translation.amax() <= translation_max && now.rotation.amax() <= rotation_max, "{now:?}");
        if let Some(last) = self.last {
            let rate = Displacement {
                translation: (now.translation - last.translation) * 1e3,
                rotation: (now.rotation - last.rotation) * 1e3,
            };
            assert!(rate.translation.amax() <= velocity_max * slack, "{rate:?}");
            assert!(rate.rotation.amax() <= turn_rate_max * slack, "{rate:?}");
            if let Some(before) = self.rate {
                let change = [rate.translation - before.translation, rate.rotation - before.rotation];
                assert!(change[0].amax() * 1e3 <= acceleration_max * slack, "{change:?}");
                assert!(change[1].amax() * 1e3 <= turn_acceleration_max * slack, "{change:?}");
            }
            self.rate = Some(rate);
        }
        self.last = Some(now);
        let around = output.nominal_from_base.inverse() * now.pose(&config().pivot);
        assert!(around.translation.norm() < 1e-12 && around.rotation_vector().norm() < 1e-12);
    }
}

#[test]
fn a_step_is_gated_acquired_anew_and_taken_up_no_faster_than_allowed() {
    for (way, turn) in [(5e-3, 0.0), (0.0, 0.1_f64.to_radians())] {
        let mut sim = acquired(7, config());
        sim.truth.translation += Vector3::new(0.6, -0.48, 0.64) * way;
        sim.truth.rotation += Vector3::new(0.64, 0.6, -0.48) * turn;
        let mut judge = Judge::new(LIMITS);
        judge.see(&sim.base.output());
        let (mut gated, mut acquired_at) = (0, None);
        let mut arrived = None;
        for tick in 0..2000 {
            sim.steady();
            let measurement = sim.measurement();
            match sim.base.measure(&UR10E, &measurement).unwrap() {
                Verdict::Gated { agreeing, .. } => {
                    gated += 1;
                    assert_eq!(agreeing, gated);
                }
                Verdict::Acquired => acquired_at = acquired_at.or(Some(tick)),
                Verdict::Taken { .. } => assert!(acquired_at.is_some() || gated == 0, "{way} {turn}: {tick}"),
                Verdict::Acquiring { .. } => panic!(),
            }
            let output = sim.base.tick(sim.now).unwrap();
            judge.see(&output);
            let off = sim.off();
            if off[0] < 100e-6 && off[1] < 100e-6 {
                arrived = arrived.or(Some(tick));
            }
        }
        assert_eq!((gated, acquired_at), (19, Some(19)), "{way} {turn}");
        // 3.2 mm along z at 10 mm/s and 0.2 m/s²: 0.32 s + 0.05 s, and 19 ms until then.
        let arrived = arrived.unwrap();
        if way > 0.0 {
            assert!((330..450).contains(&arrived), "{arrived}");
        }
        assert!(sim.off()[0] < 100e-6 && sim.off()[1] < 100e-6);
    }
}

#[test]
fn three_sigma_stay_honest_through_a_dropout_of_five_seconds() {
    let long = BaseConfig { hold: 10.0, ..swinging() };
    let (mut inside, mut all, mut gated) = (0, 0, 0);
    for seed in 0..40 {
        let mut sim = Sim::new(seed, long);
        sim.any_rate();
        for tick in 0..6600 {
            sim.wander();
            let measurement = sim.measurement();
            let is_dark = (500..5500).contains(&tick);
            if is_dark {
                continue;
            }
            let verdict = sim.base.measure(&UR10E, &measurement).unwrap();
            gated += usize::from(matches!(verdict, Verdict::Gated { .. }));
            // The first after the darkness hardly knows more than what was predicted.
            if tick >= 5500 && tick % 100 == 0 {
                let estimate = sim.base.estimate().unwrap();
                let (error, p) = (sim.error(estimate), matrix(estimate));
                for k in 0..24 {
                    inside += usize::from(error[k].abs() <= 3.0 * p[(k, k)].sqrt());
                    all += 1;
                }
            }
        }
    }
    // The gate drops one good measurement in 100,000; here are 64,000.
    assert!(inside as f64 >= 0.99 * f64::from(all) && gated <= 4, "{inside} of {all}, {gated} gated");
}

#[test]
fn without_poses_the_estimate_runs_on_then_trust_ends_and_the_correction_ramps_out() {
    let mut sim = acquired(11, config());
    sim.truth.translation.x += 4e-3;
    for _ in 0..1000 {
        sim.steady();
        let measurement = sim.measurement();
        sim.base.measure(&UR10E, &measurement).unwrap();
        sim.base.tick(sim.now).unwrap();
    }
    let mut judge = Judge::new(LIMITS);
    let held = sim.base.output().displacement;
    assert!((held.translation.x - 4e-3).abs() < 100e-6);
    let mut gone = None;
    for tick in 1..=5000 {
        sim.steady();
        let output = sim.base.tick(sim.now).unwrap();
        judge.see(&output);
        let age = f64::from(tick) * 1e-3;
        if tick <= 1000 {
            assert!(matches!(output.trust, Trust::Held { age: found } if (found - age).abs() < 1e-9), "{output:?}");
            assert!((output.displacement.translation - held.translation).norm() < 2e-3);
        } else {
            assert_eq!(output.trust, Trust::Ended);
            assert_eq!(sim.base.tracker_from_base(sim.now), sim.config.tracker_from_nominal);
        }
        if output.displacement == Displacement::zero() {
            gone = gone.or(Some(tick));
        }
    }
    // 4 mm at 10 mm/s and 0.2 m/s² take 0.45 s; the estimate has run on meanwhile.
    assert!((1300..1500).contains(&gone.unwrap()), "{gone:?}");
    // Poses come back: 20 of them, and it is known again.
    for tick in 0..1000 {
        sim.steady();
        let measurement = sim.measurement();
        let verdict = sim.base.measure(&UR10E, &measurement).unwrap();
        assert!(tick >= 19 || verdict == Verdict::Acquiring { agreeing: tick + 1 }, "{verdict:?}");
        judge.see(&sim.base.tick(sim.now).unwrap());
    }
    assert!(sim.off()[0] < 100e-6);
}

#[test]
fn outliers_of_a_metre_change_nothing() {
    let mut sim = acquired(5, config());
    let mut gated = 0;
    for tick in 0..3000 {
        sim.steady();
        let mut measurement = sim.measurement();
        // Now and then one, and once a third of a second of nothing else.
        if tick % 7 == 0 || (1000..1300).contains(&tick) {
            measurement.tracker_from_target.translation += Vector3::from(sim.random.normals(1.0)).normalize();
            let before = *sim.base.estimate().unwrap();
            let verdict = sim.base.measure(&UR10E, &measurement).unwrap();
            assert!(matches!(verdict, Verdict::Gated { nis, gate, agreeing: 1 } if nis > gate), "{verdict:?}");
            assert_eq!(*sim.base.estimate().unwrap(), before);
            gated += 1;
        } else {
            sim.base.measure(&UR10E, &measurement).unwrap();
        }
        sim.base.tick(sim.now).unwrap();
        assert!(sim.off()[0] < 200e-6, "{tick}: {:?}", sim.off());
    }
    assert!(gated > 600);
}

#[test]
fn a_displacement_beyond_its_bound_is_an_excess_until_it_is_cleared() {
    for (part, axis, value) in [(Part::Translation, 1, -0.03), (Part::Rotation, 2, 0.015)] {
        let mut sim = acquired(13, config());
        sim.truth.translation.x += 2e-3;
        let mut judge = Judge::new(LIMITS);
        let mut found = None;
        for tick in 0..3000 {
            if tick == 1000 {
                match part {
                    Part::Translation => sim.truth.translation[axis] = value,
                    Part::Rotation => sim.truth.rotation[axis] = value,
                }
            }
            if tick == 2000 {
                sim.truth = Displacement::zero();
            }
            sim.steady();
            let measurement = sim.measurement();
            sim.base.measure(&UR10E, &measurement).unwrap();
            let result = sim.base.tick(sim.now);
            judge.see(&sim.base.output());
            match result {
                Ok(_) => assert!(!(1020..=2500).contains(&tick), "{tick}"),
                Err(excess) => {
                    assert!((1000..=2500).contains(&tick));
                    assert_eq!(*found.get_or_insert(excess), excess);
                }
            }
            if tick == 2499 {
                assert_eq!(sim.base.output().displacement, Displacement::zero());
            }
            if tick == 2500 {
                sim.base.clear();
            }
        }
        let Excess { part: found, axis: which, value: seen, limit } = found.unwrap();
        assert_eq!((found, usize::from(which)), (part, axis));
        assert!((seen - value).abs() < 1e-3 && seen.abs() > limit, "{seen}");
    }
}

/// A base that drifts out of its bound is told before the correction would have to stop dead.
#[test]
fn a_base_that_leaves_its_bound_slowly_is_told_in_time() {
    let mut sim = acquired(17, config());
    sim.rate.translation.z = 3e-3;
    let mut judge = Judge::new(LIMITS);
    let mut last = 0.0;
    let ended = (0..10_000).find(|_| {
        sim.steady();
        let measurement = sim.measurement();
        sim.base.measure(&UR10E, &measurement).unwrap();
        let result = sim.base.tick(sim.now);
        judge.see(&sim.base.output());
        last = sim.base.output().displacement.translation.z;
        result.is_err()
    });
    assert!(ended.is_some() && last > 0.0195, "{ended:?} {last}");
}

#[test]
fn whatever_is_measured_the_output_keeps_its_bounds() {
    for seed in 0..40 {
        let mut sim = Sim::new(seed, config());
        let mut judge = Judge::new(LIMITS);
        let (mut excesses, mut acquired, mut dark) = (0, 0, 0_u64);
        for _ in 0..8000 {
            sim.wander();
            match sim.random.below(400) {
                0 => {
                    let way = sim.random.between(0.0, 0.02);
                    sim.truth.translation = Vector3::from(sim.random.normals(1.0)).normalize() * way;
                }
                1 => sim.truth.rotation = Vector3::from(sim.random.normals(3e-3)),
                2 => sim.any_rate(),
                3 => dark = sim.random.below(1500),
                4 => sim.base.clear(),
                _ => dark = dark.saturating_sub(1),
            }
            let mut measurement = sim.measurement();
            if sim.random.below(50) == 0 {
                measurement.tracker_from_target.translation.x += sim.random.between(-1.0, 1.0);
            }
            if dark == 0 {
                acquired += usize::from(sim.base.measure(&UR10E, &measurement).unwrap() == Verdict::Acquired);
            }
            excesses += usize::from(sim.base.tick(sim.now).is_err());
            judge.see(&sim.base.output());
        }
        assert!(acquired > 2, "seed {seed}: {acquired} times acquired, {excesses} ticks in excess");
    }
}

#[test]
fn the_covariance_stays_positive_and_symmetric_over_a_million_ticks() {
    let mut sim = Sim::new(19, BaseConfig { hold: 60.0, ..swinging() });
    let (mut least, mut worst) = (f64::INFINITY, 0.0_f64);
    for tick in 0..1_000_000 {
        sim.wander();
        // The arm's part costs most of the time, so most ticks go without.
        if tick > 100 && sim.random.below(4) != 0 {
            continue;
        }
        let measurement = sim.measurement();
        let verdict = sim.base.measure(&UR10E, &measurement).unwrap();
        assert!(!matches!(verdict, Verdict::Acquired) || tick < 100, "{tick}: {verdict:?}");
        if tick % 20_000 == 0
            && tick > 0
            && let Some(estimate) = sim.base.estimate()
            && estimate.at() == sim.now
        {
            let p = matrix(estimate);
            let sigma = p.diagonal().map(f64::sqrt);
            let scale = SMatrix::<f64, 24, 24>::from_diagonal(&sigma.map(|sigma| 1.0 / sigma));
            least = least.min((scale * p * scale).symmetric_eigenvalues().min());
            worst = worst.max((scale * sim.error(estimate)).amax());
            assert!(p == p.transpose());
        }
    }
    println!("least eigenvalue of P scaled to a unit diagonal {least:.2e}, largest error {worst:.2} σ");
    assert!(least > 1e-4 && worst < 5.0, "{least} {worst}");
}

#[test]
fn a_measurement_that_makes_no_sense_is_refused_and_changes_nothing() {
    let mut sim = acquired(23, config());
    sim.steady();
    let good = sim.measurement();
    let before = sim.base;
    let mut cases = vec![];
    let mut bad = good;
    bad.joints.0[3] = f64::NAN;
    cases.push((bad, BaseError::Measurement(EkfError::NotFinite)));
    let mut bad = good;
    bad.tracker_from_target.translation.y = f64::INFINITY;
    cases.push((bad, BaseError::Measurement(EkfError::NotFinite)));
    let mut bad = good;
    bad.position_deviation = 0.0;
    cases.push((bad, BaseError::Measurement(EkfError::Noise { value: 0.0 })));
    let mut bad = good;
    bad.joint_deviation.0[0] = -1.0;
    cases.push((bad, BaseError::Measurement(EkfError::Noise { value: -1.0 })));
    let mut bad = good;
    bad.at = Nanos(sim.now.0 - 3_000_000);
    cases.push((bad, BaseError::Late { by: 2_000_000 }));
    let mut bad = good;
    bad.at = Nanos(sim.now.0 - 1_000_000);
    cases.push((bad, BaseError::Late { by: 0 }));
    let mut bad = good;
    bad.at = sim.now.plus(5_000_000_000);
    cases.push((bad, BaseError::Early { by: 5_001_000_000 }));
    for (bad, error) in cases {
        assert_eq!(sim.base.measure(&UR10E, &bad), Err(error));
        assert_eq!(sim.base, before);
    }
    let mut bad = good;
    bad.tracker_from_target.rotation *= 1.01;
    assert!(matches!(
        sim.base.measure(&UR10E, &bad),
        Err(BaseError::Measurement(EkfError::Rotation { miss })) if (miss - 0.0201).abs() < 1e-9
    ));
    assert_eq!(sim.base, before);
    assert!(matches!(sim.base.measure(&UR10E, &good), Ok(Verdict::Taken { .. })));
}

#[test]
fn a_configuration_that_makes_no_sense_is_refused() {
    let refused = |change: &dyn Fn(&mut BaseConfig)| {
        let mut config = config();
        change(&mut config);
        match Base::new(&config) {
            Err(BaseError::Config { field, .. }) => Some(field),
            _ => None,
        }
    };
    assert_eq!(refused(&|_| {}), None);
    assert_eq!(refused(&|config| config.drift = Drift { speed: -1.0, ..DRIFT }), Some("drift.speed"));
    assert_eq!(refused(&|config| config.drift.time = f64::INFINITY), Some("drift.time"));
    assert_eq!(refused(&|config| config.hold = f64::NAN), Some("hold"));
    assert_eq!(refused(&|config| config.period = 0.0), Some("period"));
    assert_eq!(refused(&|config| config.agreeing = 1), Some("agreeing"));
    assert_eq!(refused(&|config| config.pivot.x = f64::NAN), Some("pivot"));
    assert_eq!(refused(&|config| config.limits.rotation_max = 0.3), Some("limits.rotation_max"));
    assert_eq!(refused(&|config| config.limits.velocity_max = 0.0), Some("limits.velocity_max"));
    let mut config = config();
    config.tracker_from_nominal.rotation *= 2.0;
    assert!(matches!(Base::new(&config), Err(BaseError::Measurement(EkfError::Rotation { .. }))));
}

/// The paper's two corrections do not fight because the encoders are raw: an arm that moves is no base that does.
#[test]
fn an_arm_that_moves_is_no_base_that_does_once_the_encoders_are_those_of_the_stamp() {
    let off = |late: bool| {
        let mut sim = Sim::new(29, config());
        let mut history = History::<6, 8>::new();
        let mut worst = 0.0_f64;
        for tick in 0..3000 {
            sim.steady();
            history.push(sim.now, &sim.joints()).unwrap();
            // The pose is from between two ticks, three milliseconds ago.
            let (now, stamp) = (sim.now, Nanos(sim.now.0.saturating_sub(2_600_000)));
            let latest = sim.joints();
            sim.now = stamp;
            let mut measurement = sim.measurement();
            sim.now = now;
            let Ok(joints) = history.at(stamp) else { continue };
            measurement.joints = if late { latest } else { joints };
            sim.base.measure(&UR10E, &measurement).unwrap();
            sim.base.tick(now).unwrap();
            if tick > 500 {
                worst = worst.max(sim.off()[0]);
            }
        }
        worst
    };
    let (right, wrong) = (off(false), off(true));
    assert!(right < 150e-6 && wrong > 4.0 * right, "{right} {wrong}");
}

/// What stays bent is taken for the base, and the TCP is where the two together put it.
#[test]
fn a_joint_that_stays_bent_is_a_displacement_that_puts_the_tcp_right() {
    let mut sim = acquired(31, config());
    let bent = |joints: &JointPos<6>| JointPos(core::array::from_fn(|i| joints.0[i] - if i == 1 { 5e-4 } else { 0.0 }));
    for _ in 0..1000 {
        sim.steady();
        let mut measurement = sim.measurement();
        measurement.joints = bent(&measurement.joints);
        sim.base.measure(&UR10E, &measurement).unwrap();
        sim.base.tick(sim.now).unwrap();
    }
    let output = sim.base.output();
    assert!(output.displacement.rotation.norm() > 4e-4);
    let tip = Pose::from_translation(0.0, 0.0, 0.2);
    let truth = UR10E.forward(&sim.joints()) * tip;
    let raw = UR10E.forward(&bent(&sim.joints())) * tip;
    let corrected = output.nominal_from_base * raw;
    let (before, after) =
        ((raw.translation - truth.translation).norm(), (corrected.translation - truth.translation).norm());
    assert!(before > 3e-4 && after < 5e-5, "{before} {after}");
}

#[test]
fn encoders_are_found_between_two_samples_and_nowhere_else() {
    let mut history = History::<6, 4>::default();
    assert_eq!(history.at(Nanos(1)), Err(HistoryError::TooNew));
    let joints = |value| JointPos([value; 6]);
    history.push(Nanos(1000), &joints(1.0)).unwrap();
    assert_eq!(history.at(Nanos(1000)), Ok(joints(1.0)));
    assert_eq!(history.at(Nanos(999)), Err(HistoryError::TooOld));
    for (at, value) in [(2000, 2.0), (4000, 3.0), (5000, 7.0), (6000, -1.0)] {
        history.push(Nanos(at), &joints(value)).unwrap();
    }
    let before = history;
    assert_eq!(history.push(Nanos(6000), &joints(0.0)), Err(HistoryError::Sample));
    assert_eq!(history.push(Nanos(7000), &joints(f64::NAN)), Err(HistoryError::Sample));
    assert_eq!(history, before);
    for (at, found) in [
        (1999, Err(HistoryError::TooOld)),
        (2000, Ok(joints(2.0))),
        (3000, Ok(joints(2.5))),
        (4000, Ok(joints(3.0))),
        (4250, Ok(joints(4.0))),
        (5500, Ok(joints(3.0))),
        (6000, Ok(joints(-1.0))),
        (6001, Err(HistoryError::TooNew)),
    ] {
        assert_eq!(history.at(Nanos(at)), found, "{at}");
    }
}
