//! Arms with planted errors, measured by a simulated tracker.

use super::is_chi_squared;
use super::random::{measured, normal, pose};
use super::target::TRACKER;
use crate::calibrate::arm::chain::{Chain, turned};
use crate::calibrate::arm::{ArmMeasurement, Identified, Parameter, identify, parameters, system, table};
use crate::calibrate::pose_fit::TrackerNoise;
use crate::calibrate::target::{Frames, PosePair, calibrate};
use crate::calibrate::{CalibrateError, report};
use nalgebra::{DVector, Vector3};
use screed_kernel::arm::{Arm, Coupling, Dh, Joint, Rating};
use screed_kernel::arms::comau::NJ130;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ik::{self, Family};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use screed_tape::random::Random;
use std::f64::consts::{FRAC_PI_2, PI};

/// Poses that are measured for a calibration.
const POSES: usize = 60;
/// Standard deviations of the errors planted in each row.
const PLANTED: [f64; 2] = [1.1e-4, 1.1e-4]; // m, rad

fn arm<const N: usize>(dh: [Dh; N], joints: [Joint; N]) -> Arm<N> {
    Arm {
        name: "test",
        base_from_zero: None,
        dh,
        joints,
        last_from_flange: None,
        position_min: JointPos([-PI; N]),
        position_max: JointPos([PI; N]),
        velocity_max: Rating::Unknown,
        acceleration_max: Rating::Unknown,
    }
}

/// A row with an exact right angle (sin α = ±1) or none.
fn row(theta: f64, d: f64, a: f64, sin_alpha: f64) -> Dh {
    Dh { theta, d, a, sin_alpha, cos_alpha: 1.0 - sin_alpha.abs() }
}

/// Three slides at right angles, a spherical wrist below.
fn gantry() -> Arm<6> {
    let rows = [
        row(FRAC_PI_2, 0.0, 0.0, 1.0),
        row(FRAC_PI_2, 0.0, 0.0, 1.0),
        row(0.0, 0.0, 0.0, 0.0),
        row(0.0, 0.4, 0.0, -1.0),
        row(0.0, 0.0, 0.0, 1.0),
        row(0.0, 0.2, 0.0, 0.0),
    ];
    let (slide, turn) = (Joint::PRISMATIC, Joint::REVOLUTE);
    arm(rows, [slide, slide, slide, turn, turn, turn])
}

/// Without a right angle or zero, its second joint slides, its third row is nearly parallel, its last joint is coupled;
/// between shifted frames.
fn crooked<const N: usize>() -> Arm<N> {
    let row = |k: usize| {
        let (sin_alpha, cos_alpha) = libm::sincos(if k == 2 { 0.05 } else { 0.3 + k as f64 });
        Dh { theta: 0.2 - k as f64, d: 0.1 + 0.2 * k as f64, a: 0.4 - 0.1 * k as f64, sin_alpha, cos_alpha }
    };
    let mut joints = [Joint::REVOLUTE; N];
    joints[1] = Joint::PRISMATIC;
    joints[N - 1].coupling = Some(Coupling { joint: 1, factor: -0.7 });
    let shifted = |x, roll| Some(Pose::from_roll_pitch_yaw(Vector3::new(x, -0.3, 0.2), roll, 0.5, -0.6));
    Arm {
        base_from_zero: shifted(0.5, 0.4),
        last_from_flange: shifted(-0.1, 1.4),
        ..arm(std::array::from_fn(row), joints)
    }
}

/// Within the arm's limits and ±1.5 rad or m of their middle, or of zero.
fn joints<const N: usize>(random: &mut Random, arm: &Arm<N>) -> JointPos<N> {
    JointPos(std::array::from_fn(|joint| {
        let (low, high) = (arm.position_min.0[joint], arm.position_max.0[joint]);
        let middle = if low.is_finite() && high.is_finite() { 0.5 * (low + high) } else { 0.0 };
        random.between(low.max(middle - 1.5), high.min(middle + 1.5))
    }))
}

/// The arm with errors in every row, the target at arm's length from its flange, the tracker some metres off.
fn planted<const N: usize>(random: &mut Random, arm: &Arm<N>, [length, angle]: [f64; 2]) -> Chain<N> {
    let frames = Frames {
        flange_from_target: Pose::from_translation(0.15, -0.1, 0.12) * pose(random, 0.05, PI),
        tracker_from_base: Pose::from_translation(3.0, 1.0, 0.5) * pose(random, 0.5, PI),
    };
    let all = parameters(arm);
    let error = |parameter: &Parameter| match parameter {
        Parameter::Link { .. } => normal(random) * if parameter.is_angle() { angle } else { length },
        Parameter::Base(_) | Parameter::Target(_) => 0.0,
    };
    let step = DVector::from_iterator(all.len(), all.iter().map(error));
    Chain::nominal(arm, frames).moved(&all, &step)
}

fn target<const N: usize>(chain: &Chain<N>, joints: &JointPos<N>) -> Pose {
    chain.frames.predicted(&chain.base_from_flange(joints))
}

fn measurements<const N: usize>(
    random: &mut Random,
    truth: &Chain<N>,
    count: usize,
    noise: Option<&TrackerNoise>,
) -> Vec<ArmMeasurement<N>> {
    let one = |_| {
        let joints = joints(random, &truth.nominal);
        let target = target(truth, &joints);
        let tracker_from_target = noise.map_or(target, |noise| measured(random, &target, noise));
        ArmMeasurement { joints, tracker_from_target }
    };
    (0..count).map(one).collect()
}

/// How far (m) the tool is from where the arm as found has them, at 200 poses that were not measured.
#[derive(Debug)]
struct TipErrors {
    /// Of the tool's tip, 0.3 m from the target: root mean square.
    rms: f64,
    /// Of the tip: largest.
    largest: f64,
    /// Of the target: root mean square.
    target_rms: f64,
}

fn tip_errors<const N: usize>(
    random: &mut Random,
    truth: &Chain<N>,
    arm: &Arm<N>,
    tracker_from_base: &Pose,
    flange_from_target: &Pose,
) -> TipErrors {
    let tip_in_target = Vector3::new(0.2, -0.1, 0.2);
    let mut errors = TipErrors { rms: 0.0, largest: 0.0, target_rms: 0.0 };
    for _ in 0..200 {
        let joints = joints(random, arm);
        let found = *tracker_from_base * arm.forward(&joints) * *flange_from_target;
        let real = target(truth, &joints);
        let miss = found.transform_point(&tip_in_target) - real.transform_point(&tip_in_target);
        errors.rms += miss.norm_squared() / 200.0;
        errors.largest = errors.largest.max(miss.norm());
        errors.target_rms += (found.translation - real.translation).norm_squared() / 200.0;
    }
    errors.rms = errors.rms.sqrt();
    errors.target_rms = errors.target_rms.sqrt();
    errors
}

fn tip_errors_of<const N: usize>(random: &mut Random, truth: &Chain<N>, found: &Identified<N>) -> TipErrors {
    tip_errors(random, truth, &found.arm, &found.tracker_from_base, &found.flange_from_target)
}

fn jacobian_is_differences<const N: usize>(random: &mut Random, arm: &Arm<N>) {
    let one = TrackerNoise { position: 1.0, position_per_metre: 0.3, rotation: 1.0 };
    let all = parameters(arm);
    for _ in 0..20 {
        let truth = planted(random, arm, [0.1, 0.3]);
        let mut set = measurements(random, &truth, 3, None);
        for measurement in &mut set {
            measurement.tracker_from_target = measurement.tracker_from_target * pose(random, 0.5, 2.5);
        }
        let jacobian = system(&truth, &all, &set, &one).jacobian;
        for (index, parameter) in all.iter().enumerate() {
            let at = |h: f64| {
                let mut step = DVector::zeros(all.len());
                step[index] = h;
                system(&truth.moved(&all, &step), &all, &set, &one).residual
            };
            let h = 1e-5;
            let slope = (at(h) - at(-h)) / (2.0 * h);
            let miss = (slope + jacobian.column(index)).amax();
            assert!(miss < 1e-7, "{parameter}: {miss:e}");
        }
    }
}

#[test]
fn the_jacobian_is_that_of_finite_differences() {
    let mut random = Random(31);
    jacobian_is_differences(&mut random, &UR10E);
    jacobian_is_differences(&mut random, &NJ130);
    jacobian_is_differences(&mut random, &gantry());
    jacobian_is_differences(&mut random, &crooked::<4>());
    jacobian_is_differences(&mut random, &crooked::<9>());
}

/// How far (m, and in the elements of the rotation) a table may be from its chain because axes count as parallel.
fn left_out<const N: usize>(chain: &Chain<N>) -> f64 {
    let parallel = chain.nominal.dh.iter().zip(&chain.changes).filter(|(row, change)| {
        let (sine, _) = turned(row, change.alpha);
        change.tilt != 0.0 && sine.hypot(change.tilt) < table::PARALLEL
    });
    parallel.count() as f64 * 2.0 * table::PARALLEL
}

/// The changed arm as a table takes the flange where the chain takes it.
fn table_is_the_chain<const N: usize>(random: &mut Random, arm: &Arm<N>) {
    for size in [1e-1, 1e-3, 1e-5, 1e-7, 1e-8, 1e-9, 1e-15] {
        for _ in 0..50 {
            let chain = planted(random, arm, [size, size]);
            let table = table::standard(arm, &chain.changes);
            // A row whose normal is far away has its digits spent on the distance.
            let far = table.dh.iter().fold(1.0, |far: f64, row| far.max(row.d.abs()));
            assert!(far < 3e6, "{far}");
            let left_out = left_out(&chain);
            for _ in 0..50 {
                let joints = joints(random, arm);
                let (found, expected) = (table.forward(&joints), chain.base_from_flange(&joints));
                let miss = (found.translation - expected.translation).amax();
                let turn = (found.rotation - expected.rotation).amax();
                assert!(
                    miss < 4e-15 * far + left_out && turn < 1e-14 + left_out,
                    "{miss:e} m, {turn:e} with d up to {far:e} m"
                );
            }
        }
    }
}

#[test]
fn a_table_without_tilts_says_the_same() {
    let mut random = Random(32);
    table_is_the_chain(&mut random, &UR10E);
    table_is_the_chain(&mut random, &NJ130);
    table_is_the_chain(&mut random, &gantry());
    table_is_the_chain(&mut random, &crooked::<6>());
    let unchanged = Chain::nominal(&UR10E, planted(&mut random, &UR10E, [0.0; 2]).frames);
    assert_eq!(table::standard(&UR10E, &unchanged.changes), UR10E);
}

fn names(found: &Identified<6>) -> Vec<String> {
    let list = |parameters: &[Parameter]| parameters.iter().map(Parameter::to_string).collect::<Vec<_>>().join(" ");
    found.groups.iter().map(|group| format!("{}: {}", list(&group.held), list(&group.with))).collect()
}

#[test]
fn what_cannot_be_told_apart_is_named() {
    let mut random = Random(33);
    let ends = ["theta6: target rz", "d6: target z", "a6: target x", "alpha6: target rx"];
    for (arm, parallel) in [(NJ130, "d3: d2"), (UR10E, "d3 d4: d2")] {
        let truth = planted(&mut random, &arm, PLANTED);
        let set = measurements(&mut random, &truth, POSES, Some(&TRACKER));
        let found = identify(&arm, &set, &TRACKER).expect("an arm");
        let expected = [&["theta1: base rz", "d1: base z", parallel], &ends[..]].concat();
        assert_eq!(names(&found), expected);
        // A chain of six turning joints between two free frames has 30 numbers, 12 of them the frames'.
        assert_eq!((found.estimates.len(), found.fit.degrees), (18, 6 * POSES - 30));
        assert!(found.condition < 100.0, "{}", found.condition);
        let words = report::arm(&found, "an arm").words;
        assert!(
            words.contains("\n  theta1 and base rz: theta1 held as it was\n") && words.contains("condition"),
            "{words}"
        );

        // Joint 5 is never moved: rows 4 and 5 are one link, a chain of five.
        let one = |_| {
            let mut joints = joints(&mut random, &arm);
            joints.0[4] = 0.7;
            ArmMeasurement { joints, tracker_from_target: target(&truth, &joints) }
        };
        let still: Vec<_> = (0..POSES).map(one).collect();
        let found = identify(&arm, &still, &TRACKER).expect("an arm");
        assert_eq!(found.estimates.len(), 14);
        let wrist = names(&found).into_iter().find(|group| group.contains("theta6")).expect("it is at the end");
        assert!(wrist.contains("theta4") && wrist.contains("target rz"), "{wrist}");
    }
}

fn exact_measurements_lead_back<const N: usize>(random: &mut Random, arm: &Arm<N>) {
    for size in [0.0, 1e-8, 1e-5, 1e-3, 1e-2] {
        let truth = planted(random, arm, [size, size]);
        let set = measurements(random, &truth, POSES, None);
        let found = identify(arm, &set, &TRACKER).expect("an arm");
        let largest = found.residuals.iter().fold(0.0, |most: f64, residual| most.max(residual.position_m));
        let tip = tip_errors_of(random, &truth, &found).largest;
        let far = found.arm.dh.iter().fold(1.0, |far: f64, row| far.max(row.d.abs()));
        let left_out = left_out(&truth);
        assert!(largest < 1e-14 && tip < 1e-14 * far + left_out, "{size}: {largest:e}, {tip:e} with d up to {far:e} m");
    }
}

#[test]
fn exact_measurements_give_the_arm_to_rounding() {
    let mut random = Random(34);
    exact_measurements_lead_back(&mut random, &NJ130);
    exact_measurements_lead_back(&mut random, &UR10E);
    exact_measurements_lead_back(&mut random, &gantry());
    exact_measurements_lead_back(&mut random, &crooked::<7>());
    // An arm under a crane.
    let (slides, arm_rows) = (gantry().dh, UR10E.dh);
    let rows = std::array::from_fn(|row| if row < 3 { slides[row] } else { arm_rows[row - 3] });
    let joints = std::array::from_fn(|row| if row < 3 { Joint::PRISMATIC } else { Joint::REVOLUTE });
    exact_measurements_lead_back::<9>(&mut random, &arm(rows, joints));
}

/// The aim of all this: tool errors of 0.3 mm, 60 poses with the published noise of the tracker, less than 0.05 mm left
/// at other poses. With half the maximum permissible error as standard deviation, and with all of it.
#[test]
fn planted_errors_of_0_3_mm_leave_less_than_0_05_mm() {
    const RUNS: u64 = 25;
    let worst_case = TrackerNoise { position: 15e-6, position_per_metre: 6e-6, ..TRACKER };
    for (first_seed, arm, noise) in
        [(100, NJ130, TRACKER), (200, UR10E, TRACKER), (100, NJ130, worst_case), (200, UR10E, worst_case)]
    {
        let (mut before_mean, mut expected) = (0.0, 0.0);
        for seed in first_seed..first_seed + RUNS {
            let mut random = Random(seed);
            let truth = planted(&mut random, &arm, PLANTED);
            let set = measurements(&mut random, &truth, POSES, Some(&noise));
            let pair = |measurement: &ArmMeasurement<6>| PosePair {
                base_from_flange: arm.forward(&measurement.joints),
                tracker_from_target: measurement.tracker_from_target,
            };
            let nominal = calibrate(&set.iter().map(pair).collect::<Vec<_>>(), &noise).expect("frames");
            let frames = (&nominal.tracker_from_base, &nominal.flange_from_target);
            let before = tip_errors(&mut random, &truth, &arm, frames.0, frames.1);
            let found = identify(&arm, &set, &noise).expect("an arm");
            let after = tip_errors_of(&mut random, &truth, &found);
            assert!(after.rms < 5e-5 && after.rms < 0.5 * before.rms, "seed {seed}: {after:?} after {before:?}");
            before_mean += before.rms / RUNS as f64;
            expected += (after.target_rms / found.target_sigma).powi(2) / RUNS as f64;
        }
        assert!((2.5e-4..4e-4).contains(&before_mean), "{before_mean}");
        // What the covariance has told to expect, at poses like those measured.
        assert!((0.9..1.2).contains(&expected.sqrt()), "{}", expected.sqrt());
    }
}

/// Normalised squared errors of the estimates against χ². The truth is what the same poses give without noise: where
/// rows cannot be told apart, the errors planted show in those that are sought.
#[test]
fn planted_errors_come_back_within_their_covariance() {
    const RUNS: usize = 100;
    for (first_seed, arm) in [(300, NJ130), (500, UR10E)] {
        let (mut squared, mut chi_squared, mut inside, mut degrees) = (0.0, 0.0, 0, 0);
        for seed in first_seed..first_seed + RUNS as u64 {
            let mut random = Random(seed);
            let truth = planted(&mut random, &arm, PLANTED);
            let mut set = measurements(&mut random, &truth, POSES, None);
            let exact = identify(&arm, &set, &TRACKER).expect("an arm");
            for measurement in &mut set {
                measurement.tracker_from_target = measured(&mut random, &measurement.tracker_from_target, &TRACKER);
            }
            let found = identify(&arm, &set, &TRACKER).expect("an arm");
            assert_eq!(found.groups, exact.groups);
            let pairs = found.estimates.iter().zip(&exact.estimates);
            let errors = pairs.map(|(found, exact)| {
                assert_eq!(found.parameter, exact.parameter);
                found.change - exact.change
            });
            let errors = DVector::from_iterator(found.estimates.len(), errors);
            let inverse = found.covariance.clone().try_inverse().expect("a covariance is regular");
            squared += errors.dot(&(inverse * &errors)) / RUNS as f64;
            chi_squared += found.fit.chi_squared / RUNS as f64;
            degrees = found.fit.degrees;
            let sigmas = errors.iter().zip(&found.estimates).map(|(error, estimate)| error.abs() / estimate.sigma);
            inside += sigmas.filter(|sigmas| *sigmas < 1.959_964).count();
        }
        assert!(is_chi_squared(squared, 18, RUNS), "{squared}");
        assert!(is_chi_squared(chi_squared, degrees, RUNS), "{chi_squared} for {degrees}");
        // Each estimate by itself, too; those of one run depend on each other, so the band is that of the runs.
        let share = inside as f64 / (18 * RUNS) as f64;
        assert!((share - 0.95).abs() < 1.96 * (0.95 * 0.05 / RUNS as f64).sqrt(), "{share}");
    }
}

#[test]
fn an_arm_that_was_calibrated_before_can_be_again() {
    let mut random = Random(35);
    let truth = planted(&mut random, &UR10E, [5e-4, 5e-4]);
    let first = measurements(&mut random, &truth, POSES, Some(&TRACKER));
    let once = identify(&UR10E, &first, &TRACKER).expect("an arm");
    let second = measurements(&mut random, &truth, POSES, Some(&TRACKER));
    let again = identify(&once.arm, &second, &TRACKER).expect("an arm");
    let after = tip_errors_of(&mut random, &truth, &again);
    assert!(after.rms < 5e-5, "{after:?}");
}

/// What was found is an arm that can be planned with on every branch, also when its axes are nearly parallel and their normals
/// far away.
#[test]
fn a_calibrated_arm_has_an_inverse() {
    for (seed, size) in (600..640).zip([1e-4, 1e-5, 1e-6, 1e-7].into_iter().cycle()) {
        let mut random = Random(seed);
        let nominal = if seed % 8 < 4 { &UR10E } else { &NJ130 };
        let truth = planted(&mut random, nominal, [size, size]);
        let set = measurements(&mut random, &truth, POSES, None);
        let found = identify(nominal, &set, &TRACKER).expect("an arm");
        let family = Family::of(&found.arm);
        assert!(matches!(family, Family::Calibrated(_)), "seed {seed}: {family:?}");
        for _ in 0..100 {
            let joints = joints(&mut random, nominal);
            let pose = found.arm.forward(&joints);
            let beside = JointPos(joints.0.map(|position| position + 0.05));
            let answer = family.nearest(&found.arm, &pose, &beside).expect("it was there");
            let back = found.arm.forward(&answer.joints);
            assert!((back.translation - pose.translation).norm() < 1e-10, "seed {seed}");
            let all = family.inverse(&found.arm, &pose, &JointPos::ZERO).expect("answers");
            let own = |answer: &ik::Answer<6>| found.arm.forward(&answer.joints).translation - pose.translation;
            assert!(all.as_slice().iter().all(|answer| own(answer).norm() < 1e-10), "seed {seed}");
        }
    }
}

#[test]
fn measurements_that_cannot_be_used_are_refused() {
    let mut random = Random(36);
    let arm = NJ130;
    let truth = planted(&mut random, &arm, PLANTED);
    let mut set = measurements(&mut random, &truth, POSES, Some(&TRACKER));
    let few = identify(&arm, &set[..6], &TRACKER);
    assert!(matches!(few, Err(CalibrateError::TooFew { found: 6, least: 7, .. })), "{few:?}");
    let mut only_first = set.clone();
    for (k, measurement) in only_first.iter_mut().enumerate() {
        measurement.joints = JointPos([0.02 * k as f64, 0.3, -0.2, 0.1, 0.8, 0.0]);
        measurement.tracker_from_target = target(&truth, &measurement.joints);
    }
    assert!(matches!(identify(&arm, &only_first, &TRACKER), Err(CalibrateError::OneAxis { .. })));
    // Degrees where radians belong.
    let mut degrees = set.clone();
    for measurement in &mut degrees {
        measurement.joints.0 = measurement.joints.0.map(f64::to_degrees);
    }
    match identify(&arm, &degrees, &TRACKER) {
        Ok(found) => assert!(found.fit.noise_ratio() > 100.0),
        Err(error) => assert!(matches!(error, CalibrateError::NotConverged { .. }), "{error:?}"),
    }
    set[7].joints.0[2] = f64::INFINITY;
    let refused = identify(&arm, &set, &TRACKER);
    assert!(matches!(refused, Err(CalibrateError::NotFinite { measurement: 7 })), "{refused:?}");
}
