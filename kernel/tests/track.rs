//! The inverse that a loop asks at every tick: away from singularities the nearest answer, and through and beside them the seed's own
//! branch or a typed error.

mod common;

use common::Random;
use nalgebra::{Matrix6, Vector3};
use screed_kernel::arm::{Arm, Dh};
use screed_kernel::arms::comau::NJ130;
use screed_kernel::arms::crane::CRANE_NJ130;
use screed_kernel::arms::gantry::CONTOUR_CRAFTER;
use screed_kernel::arms::kuka::KR120_R2500;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ik::numeric::RESIDUAL_MAX;
use screed_kernel::ik::{Family, IkError};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

/// The arm with its axis of joint 6 a little beside that of joint 5 and turned: a calibrated one; or, by 0.3, one without a closed
/// form.
fn displaced<const N: usize>(arm: &Arm<N>, offset: f64) -> Arm<N> {
    let mut arm = *arm;
    let row = &mut arm.dh[N - 2];
    let (sin, cos) = offset.sin_cos();
    *row = Dh {
        a: row.a + offset,
        sin_alpha: row.sin_alpha * cos + row.cos_alpha * sin,
        cos_alpha: row.cos_alpha * cos - row.sin_alpha * sin,
        ..*row
    };
    arm
}

/// A UR whose axes 2 and 3 are out of parallel, with 4 m to and fro, as real units have it.
fn tilted() -> Arm<6> {
    let mut arm = UR10E;
    (arm.dh[1].sin_alpha, arm.dh[1].cos_alpha) = 0.01_f64.sin_cos();
    (arm.dh[1].d, arm.dh[2].d) = (4.0, -4.0);
    arm
}

/// Of the last six joints' columns.
fn determinant<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>) -> f64 {
    let (_, jacobian) = arm.jacobian(joints);
    let last: Matrix6<f64> = jacobian.fixed_columns::<6>(N - 6).into_owned();
    last.lu().determinant()
}

fn distance<const N: usize>(a: &JointPos<N>, b: &JointPos<N>) -> f64 {
    a.0.iter().zip(&b.0).fold(0.0, |far, (a, b)| f64::max(far, (a - b).abs()))
}

fn miss<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>, pose: &Pose) -> f64 {
    let is = arm.forward(joints);
    let turn = Pose { rotation: pose.rotation * is.rotation.transpose(), ..*pose };
    (is.translation - pose.translation).norm().max(turn.rotation_vector().norm())
}

/// Where the base is that has moved by so much.
fn moved(random: &mut Random, shift: f64, turn: f64) -> Pose {
    let mut vector = |size: f64| Vector3::from_fn(|_, _| random.between(-size, size));
    Pose::from_rotation_vector(vector(shift), vector(turn))
}

/// Bases that have moved by up to 10 mm and mrad, at a thousand random postures of margins over 0.2 from where the pose can still be
/// reached: how many have a tracked answer, each of which is the nearest.
fn nearest_of_a_thousand<const N: usize>(arm: &Arm<N>, regular: impl Fn(&JointPos<N>) -> bool, seed: u64) -> usize {
    let (family, mut random) = (Family::of(arm), Random(seed));
    let (mut tried, mut found) = (0, 0);
    while tried < 1000 {
        let joints = JointPos(core::array::from_fn(|k| {
            let (low, high) = (arm.position_min.0[k].max(-3.0), arm.position_max.0[k].min(3.0));
            random.between(low + 0.1 * (high - low), high - 0.1 * (high - low))
        }));
        if !regular(&joints) {
            continue;
        }
        let pose = moved(&mut random, 0.01, 0.01) * arm.forward(&joints);
        let Ok(nearest) = family.nearest(arm, &pose, &joints) else { continue };
        tried += 1;
        if let Ok(tracked) = family.track(arm, &pose, &joints) {
            assert!(distance(&tracked.joints, &nearest.joints) <= 1e-9, "{} {joints:?}", family.name());
            assert_eq!(tracked.branch, nearest.branch, "{} {joints:?}", family.name());
            assert!(miss(arm, &tracked.joints, &pose) <= RESIDUAL_MAX);
            found += 1;
        }
    }
    found
}

#[test]
fn away_from_singularities_the_tracked_answer_is_the_nearest() {
    let six = |arm: &Arm<6>, seed| {
        let family = Family::of(arm);
        let regular = |joints: &JointPos<6>| {
            let margins = family.nearest(arm, &arm.forward(joints), joints).ok().and_then(|answer| answer.margins);
            margins.map_or(determinant(arm, joints).abs() > 0.05, |margins| margins.nearest().1 > 0.2)
        };
        nearest_of_a_thousand(arm, regular, seed)
    };
    let calibrated = displaced(&KR120_R2500, 0.002);
    for arm in [tilted(), calibrated] {
        assert!(matches!(Family::of(&arm), Family::Calibrated(_)));
    }
    let without = displaced(&UR10E, 0.3);
    assert_eq!(Family::of(&without), Family::Numeric);
    for (k, arm) in [UR10E, KR120_R2500, NJ130, tilted(), calibrated, without].iter().enumerate() {
        let found = six(arm, 40 + k as u64);
        println!("{}: {found} of 1000", Family::of(arm).name());
        assert!(found >= 990, "{}: {found}", arm.name);
    }
    let crane = displaced(&CRANE_NJ130, 0.002);
    let Family::Calibrated(geometry) = Family::of(&crane) else { panic!("calibrated") };
    let regular = |joints: &JointPos<9>| geometry.posture(&crane, joints).1.nearest().1 > 0.2;
    let found = nearest_of_a_thousand(&crane, regular, 50);
    assert!(found >= 990, "{found}");
    // A gantry has no singularity, and cannot tilt its tool.
    let joints = JointPos([1.0, 2.0, 0.5, 0.3]);
    let pose = Pose::from_translation(0.01, -0.02, 0.005) * CONTOUR_CRAFTER.forward(&joints);
    let family = Family::of(&CONTOUR_CRAFTER);
    assert_eq!(family.track(&CONTOUR_CRAFTER, &pose, &joints), family.nearest(&CONTOUR_CRAFTER, &pose, &joints));
}

#[test]
fn arms_of_other_counts_of_joints_are_tracked() {
    for_count::<4>();
    for_count::<5>();
    for_count::<7>();
    for_count::<8>();
    for_count::<9>();
}

/// An arm without any right angle; poses of joints 0.02 rad beside the seed. Where there are more joints than needed, others than those.
fn for_count<const N: usize>() {
    let row = |k: usize| {
        let (sin_alpha, cos_alpha) = (0.3 + k as f64).sin_cos();
        Dh { theta: 0.2 - k as f64, d: 0.1 + 0.1 * k as f64, a: 0.4 - 0.05 * k as f64, sin_alpha, cos_alpha }
    };
    let arm = Arm {
        name: "crooked",
        base_from_zero: None,
        dh: core::array::from_fn(row),
        joints: [screed_kernel::arm::Joint::REVOLUTE; N],
        last_from_flange: None,
        position_min: JointPos([-2.0; N]),
        position_max: JointPos([2.0; N]),
        velocity_max: screed_kernel::arm::Rating::Unknown,
        acceleration_max: screed_kernel::arm::Rating::Unknown,
    };
    let (mut random, mut found) = (Random(N as u64), 0);
    for _ in 0..500 {
        let seed = JointPos(core::array::from_fn(|_| random.between(-1.5, 1.5)));
        let joints = JointPos(seed.0.map(|position| position + random.between(-0.02, 0.02)));
        let pose = arm.forward(&joints);
        let Ok(tracked) = Family::Numeric.track(&arm, &pose, &seed) else { continue };
        found += 1;
        assert!(miss(&arm, &tracked.joints, &pose) <= RESIDUAL_MAX, "{N}: {}", miss(&arm, &tracked.joints, &pose));
        assert!(
            N > 6 || distance(&tracked.joints, &joints) <= 1e-9 * 1e3,
            "{N} {}",
            distance(&tracked.joints, &joints)
        );
    }
    assert!(found >= 450, "{N}: {found}");
    // A pose that fewer than six joints cannot give.
    let tilted = Pose::from_roll_pitch_yaw(Vector3::zeros(), 0.02, 0.01, 0.0);
    let answer = Family::Numeric.track(&arm, &(tilted * arm.forward(&JointPos([0.3; N]))), &JointPos([0.3; N]));
    assert_eq!(N < 6, matches!(answer, Err(IkError::NotConverged { residual }) if residual > 1e-3), "{N}: {answer:?}");
}

/// The joint that leads through a singularity of an arm, and where that is.
struct Crossing {
    arm: Arm<6>,
    joint: usize,
    at: JointPos<6>,
}

/// Where joint 2 puts the determinant through zero: of the shoulder, as elbow and wrist are bent.
fn over_axis(arm: &Arm<6>, [third, fourth, fifth]: [f64; 3]) -> JointPos<6> {
    let at = |second: f64| JointPos([0.3, second, third, fourth, fifth, 0.2]);
    let sign = |second: f64| determinant(arm, &at(second)) > 0.0;
    let start = (0..420).map(|k| -2.1 + 0.01 * f64::from(k)).find(|second| sign(*second) != sign(second + 0.01));
    let (mut low, mut high) = start.map(|second| (second, second + 0.01)).expect("a shoulder singularity");
    for _ in 0..60 {
        let half = 0.5 * (low + high);
        if sign(half) == sign(low) { low = half } else { high = half }
    }
    at(low)
}

/// Straight through each singularity of the two calibrated arms and the one without a closed form.
fn crossings() -> Vec<Crossing> {
    let (ur, kuka, without) = (tilted(), displaced(&KR120_R2500, 0.002), displaced(&UR10E, 0.3));
    let mut all = Vec::new();
    for (arm, elbow, bent) in [(ur, 0.0, 1.1), (without, 0.0, 1.1), (kuka, -0.041_f64.atan(), 0.9)] {
        let arm = Arm { position_min: JointPos([-10.0; 6]), position_max: JointPos([10.0; 6]), ..arm };
        let wrist = [0.3, -1.2, 1.4, -0.8, 0.0, 0.2];
        let stretched = [0.3, -1.0, elbow, -0.8, bent, 0.2];
        all.push(Crossing { arm, joint: 4, at: JointPos(wrist) });
        all.push(Crossing { arm, joint: 2, at: JointPos(stretched) });
        all.push(Crossing { arm, joint: 1, at: over_axis(&arm, [1.3, -0.8, bent]) });
    }
    all
}

#[test]
fn through_and_beside_singularities_an_answer_is_on_the_seeds_own_branch_or_there_is_none() {
    let mut random = Random(7);
    for Crossing { arm, joint, at } in crossings() {
        let (family, mut errors, mut answers) = (Family::of(&arm), 0, 0);
        for round in 0..60 {
            // From rounding to a crane's sway.
            let size = [1e-15, 1e-10, 1e-6, 1e-4, 1e-3, 1e-2][round % 6];
            let nominal_from_base = moved(&mut random, size, size);
            let mut tracked = |k: f64| {
                let mut seed = at;
                seed.0[joint] += 1e-3 * k;
                let pose = nominal_from_base * arm.forward(&seed);
                match family.track(&arm, &pose, &seed) {
                    Ok(answer) => {
                        answers += 1;
                        assert!(miss(&arm, &answer.joints, &pose) <= RESIDUAL_MAX);
                        let (own, its) = (determinant(&arm, &seed), determinant(&arm, &answer.joints));
                        assert!(own * its >= 0.0, "{} joint {joint} at {k}: {own:e} {its:e}", arm.name);
                        Some(answer.joints)
                    }
                    Err(IkError::Singular { distance: 0.0..0.05, .. } | IkError::NotConverged { .. }) => {
                        errors += 1;
                        None
                    }
                    Err(error) => panic!("{} joint {joint} at {k}: {error:?}", arm.name),
                }
            };
            let mut before = tracked(-300.0);
            for k in -299..=300 {
                let now = tracked(f64::from(k));
                if let (Some(from), Some(to)) = (before, now)
                    && distance(&from, &to) > 0.02
                {
                    // Fast, for the path is; a jump does not get smaller between.
                    let mut last = Some(from);
                    for part in 1..=1000 {
                        let next = tracked(f64::from(k - 1) + 1e-3 * f64::from(part));
                        if let (Some(last), Some(next)) = (last, next) {
                            let jump = distance(&last, &next);
                            assert!(jump < 0.02, "{} joint {joint} at {k} {part}, {size:e}: {jump}", arm.name);
                        }
                        last = next;
                    }
                }
                before = now;
            }
        }
        println!("{} joint {joint}: {answers} answers, {errors} refused", family.name());
        assert!(answers > 25_000 && errors > 10, "{} joint {joint}: {answers} {errors}", family.name());
    }
}

#[test]
fn what_no_small_step_reaches_is_refused() {
    let seed = JointPos([0.3, -1.2, 1.4, -0.8, 1.2, 0.2]);
    for arm in [tilted(), displaced(&UR10E, 0.3)] {
        let family = Family::of(&arm);
        let track = |pose: &Pose, arm: &Arm<6>| family.track(arm, pose, &seed);
        let here = arm.forward(&seed);
        assert!(track(&here, &arm).is_ok());
        assert_eq!(track(&Pose::from_translation(f64::NAN, 0.0, 0.0), &arm), Err(IkError::NotFinite));
        let stretched = Pose { rotation: here.rotation * 1.1, ..here };
        assert!(matches!(track(&stretched, &arm), Err(IkError::NotRotation { .. })));
        for away in [0.9, 5.0, 1e9] {
            let far = Pose::from_translation(away, 0.0, 0.0) * here;
            assert!(matches!(track(&far, &arm), Err(IkError::NotConverged { residual }) if residual > 0.01), "{away}");
        }
        // The joints are there, but not inside the limits, and a full turn is no small step.
        let mut narrow = arm;
        narrow.position_max.0[5] = 0.19;
        assert!(matches!(track(&here, &narrow), Err(IkError::Limit { joint: 5, .. })), "{:?}", track(&here, &narrow));
    }
}
