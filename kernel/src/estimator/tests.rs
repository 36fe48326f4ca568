extern crate std;

use super::*;
use crate::arms::ur::UR10E;
use crate::base::{BaseLimits, Drift};
use nalgebra::Vector3;
use std::vec::Vec;

const H: f64 = 0.002;
const TICK_NS: u64 = 2_000_000;
const AT: JointPos<6> = JointPos([0.1, -0.9, 1.2, -0.6, 0.8, 0.2]);
const PLACE: f64 = 25e-6;
const TURN: f64 = 1.7e-4;

fn config() -> EstimatorConfig<6> {
    EstimatorConfig {
        base: BaseConfig {
            tracker_from_nominal: Pose::from_roll_pitch_yaw(Vector3::new(3.0, -1.0, 0.5), 0.2, -0.1, 2.5),
            flange_from_target: Pose::from_roll_pitch_yaw(Vector3::new(0.05, 0.02, 0.1), 0.3, 0.0, 1.0),
            pivot: Vector3::new(0.7, -0.2, 0.4),
            drift: Drift { speed: 3e-3, turn_rate: 2e-4, time: 2.0 },
            swing: crate::base::swing::Swing::NONE,
            hold: 0.2,
            agreeing: 5,
            limits: BaseLimits {
                translation_max: 0.02,
                velocity_max: 0.05,
                acceleration_max: 0.5,
                rotation_max: 0.02,
                turn_rate_max: 0.05,
                turn_acceleration_max: 0.5,
            },
            period: H,
        },
        jerk_density: [1.0; 6],
        encoder_deviation: JointPos([1e-4; 6]),
        joint_deviation: JointPos([3e-4; 6]),
        rate_deviation: JointVel([1e-2; 6]),
        start_deviation: State {
            position: JointPos([1e-2; 6]),
            velocity: JointVel([0.1; 6]),
            acceleration: JointAcc([1.0; 6]),
        },
        dead_time: 0.0,
    }
}

/// An arm whose links are where they are and whose encoders say what they say, on a base that is shifted.
struct World {
    estimator: Estimator<6, 8>,
    config: EstimatorConfig<6>,
    now: Nanos,
    /// What encoders and links do, and the base's shift along x (m).
    encoders: JointPos<6>,
    links: JointPos<6>,
    shift: f64,
    rates: Option<JointVel<6>>,
}

impl World {
    fn new(config: EstimatorConfig<6>) -> Self {
        let estimator = Estimator::new(&config).unwrap();
        Self { estimator, config, now: Nanos(1_000_000_000), encoders: AT, links: AT, shift: 0.0, rates: None }
    }

    /// What the tracker sees of the links.
    fn pose(&self, at: Nanos) -> TrackerPose {
        let base = self.config.base.tracker_from_nominal * Pose::from_translation(self.shift, 0.0, 0.0);
        TrackerPose {
            at,
            tracker_from_target: base * UR10E.forward(&self.links) * self.config.base.flange_from_target,
            position_deviation: PLACE,
            rotation_deviation: TURN,
        }
    }

    fn tick_with(&mut self, poses: &[TrackerPose]) -> Result<Estimated<6>, Excess> {
        self.now = self.now.plus(TICK_NS);
        let robot = Robot { actual: self.encoders, rates: self.rates, ready: true };
        self.estimator.tick(&UR10E, self.now, &robot, poses)
    }

    /// So many ticks, each with the pose of its own instant.
    fn ticks(&mut self, count: u32) -> Result<Estimated<6>, Excess> {
        let mut last = None;
        for _ in 0..count {
            let pose = self.pose(self.now.plus(TICK_NS));
            last = Some(self.tick_with(&[pose])?);
        }
        Ok(last.unwrap())
    }
}

#[test]
fn the_base_is_found_and_the_flange_in_it_once_enough_poses_agree() {
    let mut world = World::new(config());
    world.shift = 0.003;
    let first = world.ticks(4).unwrap();
    assert_eq!((first.base.trust, first.base_from_flange, first.nis, first.age()), (Trust::Ended, None, None, None));
    let then = world.ticks(400).unwrap();
    assert_eq!((then.age(), then.poses), (Some(0.0), [1, 0]));
    assert!(then.nis.is_some_and(|nis| nis < 1e-3), "a pose without noise: {:?}", then.nis);
    let miss = then.base.displacement.translation - Vector3::new(0.003, 0.0, 0.0);
    assert!(miss.norm() < 2e-6, "{miss}");
    // What is left of the base is no business of the joints.
    let flange = then.base_from_flange.unwrap();
    assert!((flange.translation - UR10E.forward(&AT).translation).norm() < 1e-5, "{flange:?}");
    assert_eq!(world.estimator.hold(), 0.2);
    // Without poses the base is believed as long as the hold, the joints as long as the base.
    for _ in 0..99 {
        assert!(world.tick_with(&[]).unwrap().base_from_flange.is_some());
    }
    let lost = (0..3).map(|_| world.tick_with(&[]).unwrap()).last().unwrap();
    assert_eq!((lost.age(), lost.base_from_flange, lost.poses), (None, None, [0, 0]));
}

#[test]
fn a_late_pose_is_compared_with_the_encoders_of_its_own_instant() {
    let (mut world, mut poses) = (World::new(config()), Vec::new());
    let mut worst = 0.0_f64;
    for tick in 0..600 {
        // 0.5 rad/s: 0.35 m/s at the target, 2 mm in the 6 ms by which each pose is late.
        world.links.0[0] = AT.0[0] + 0.5 * H * f64::from(tick);
        world.encoders = world.links;
        poses.push(world.pose(world.now.plus(TICK_NS)));
        let late = if tick < 3 { None } else { poses.get(tick as usize - 3).copied() };
        let estimated = world.tick_with(late.as_slice()).unwrap();
        if tick > 100 {
            assert_eq!(estimated.poses, [1, 0]);
            assert!(estimated.filter.unwrap().replayed >= 3, "{:?}", estimated.filter);
            worst = worst.max(estimated.base.displacement.translation.norm());
        }
    }
    assert!(worst < 2e-5, "{worst}");
}

#[test]
fn poses_that_cannot_be_used_are_counted_and_of_too_many_the_oldest_left() {
    let mut world = World::new(config());
    world.ticks(100).unwrap();
    let now = world.now.plus(TICK_NS);
    // Twenty within the last two ticks, in order; sixteen are looked at.
    let poses: Vec<_> = (0..20).map(|k| world.pose(before(now, 19 * 100_000).plus(k * 100_000))).collect();
    assert_eq!(world.tick_with(&poses).unwrap().poses, [POSES_MAX as u32, 0]);
    // One from before what is remembered, one out of order, one that is no pose.
    let now = world.now.plus(TICK_NS);
    let mut none = world.pose(now);
    none.tracker_from_target.translation.x = f64::NAN;
    let poses = [world.pose(before(now, 100 * TICK_NS)), world.pose(before(now, 2 * TICK_NS)), none];
    let estimated = world.tick_with(&poses).unwrap();
    assert_eq!((estimated.poses, estimated.nis), ([0, 3], None));
    assert!(estimated.base_from_flange.is_some());
    // One that lies by 1 m: gated, and its innovation told.
    let mut lie = world.pose(world.now.plus(TICK_NS));
    lie.tracker_from_target.translation.y += 1.0;
    let estimated = world.tick_with(&[lie]).unwrap();
    assert_eq!(estimated.poses, [0, 1]);
    assert!(estimated.nis.is_some_and(|nis| nis > 1e3) && estimated.filter.unwrap().gated == 1, "{estimated:?}");
    assert!(estimated.base.displacement.translation.norm() < 1e-5, "{:?}", estimated.base);
}

/// A tracker that repeats its last pose until it has the next, and a clock that stands for a tick.
#[test]
fn a_pose_that_comes_again_and_a_clock_that_stands_tell_nothing() {
    let (mut once, mut again) = (World::new(config()), World::new(config()));
    let mut repeated = 0;
    for tick in 0..300 {
        let pose = once.pose(once.now.plus(TICK_NS));
        let new = tick % 5 == 0;
        let seen = once.tick_with(if new { std::slice::from_ref(&pose) } else { &[] }).unwrap();
        let held = again.pose(before(once.now, (tick % 5) * TICK_NS));
        let estimated = again.tick_with(&[held]).unwrap();
        repeated += estimated.filter.unwrap().repeated;
        assert_eq!(seen.joints, estimated.joints, "{tick}");
        assert_eq!(estimated.poses, [u32::from(new && estimated.poses[0] == 1), u32::from(estimated.poses[0] == 0)]);
    }
    assert!(repeated > 200, "{repeated}");
    // The clock stands for a tick.
    let robot = Robot { actual: again.encoders, rates: None, ready: true };
    let stood = again.estimator.tick(&UR10E, again.now, &robot, &[]).unwrap();
    assert!(stood.base_from_flange.is_some() && stood.filter.is_ok(), "{stood:?}");
    let after = again.ticks(1).unwrap();
    assert!(after.base_from_flange.is_some() && (after.joints.0[0] - AT.0[0]).abs() < 1e-5, "{after:?}");
    // One that stands for good is not believed, and when it goes on the filter starts anew.
    for _ in 0..60 {
        let _ = again.estimator.tick(&UR10E, again.now, &robot, &[]);
    }
    assert_eq!(again.estimator.tick(&UR10E, again.now, &robot, &[]).unwrap().filter, Ok(replay::Report::default()));
    let after = again.ticks(100).unwrap();
    assert!(after.base_from_flange.is_some() && (after.joints.0[0] - AT.0[0]).abs() < 1e-5, "{after:?}");
}

/// Two minutes behind a wall, in which the base has gone elsewhere: nothing breaks down, and it is found again.
#[test]
fn a_tracker_that_is_gone_for_minutes_is_believed_again() {
    let mut world = World::new(config());
    world.ticks(200).unwrap();
    world.shift = -0.012;
    for _ in 0..60_000 {
        let dark = world.tick_with(&[]).unwrap();
        assert!(dark.filter.is_ok_and(|report| report.error.is_none() && report.gated == 0), "{dark:?}");
    }
    assert_eq!(world.tick_with(&[]).unwrap().base_from_flange, None);
    let found = world.ticks(1500).unwrap();
    let miss = found.base.displacement.translation - Vector3::new(-0.012, 0.0, 0.0);
    assert!(miss.norm() < 5e-6 && found.age() == Some(0.0), "{miss} {found:?}");
    let flange = found.base_from_flange.unwrap();
    assert!((flange.translation - UR10E.forward(&AT).translation).norm() < 1e-5, "{flange:?}");
}

/// A tracker whose clock is an hour ahead for a while: its poses are refused, and keep no good one out of the filter.
#[test]
fn poses_from_the_future_keep_no_other_out() {
    let mut world = World::new(config());
    world.ticks(200).unwrap();
    for _ in 0..30 {
        let ahead = world.pose(world.now.plus(3_600_000_000_000));
        assert_eq!(world.tick_with(&[ahead]).unwrap().poses, [0, 1]);
    }
    let sorted = |estimated: Estimated<6>| estimated.filter.unwrap().sorted;
    let without = sorted(world.tick_with(&[]).unwrap());
    assert_eq!(sorted(world.ticks(1).unwrap()), without + 1);
}

/// Poses of nonsense at every tick among good ones: each is counted, the good ones are believed all the same.
#[test]
fn nonsense_among_good_poses_changes_nothing() {
    let (mut clean, mut spoilt) = (World::new(config()), World::new(config()));
    let nonsense: [fn(&mut TrackerPose); 6] = [
        |pose| pose.tracker_from_target.translation.x = f64::NAN,
        |pose| pose.tracker_from_target.rotation[(0, 1)] = f64::INFINITY,
        |pose| pose.tracker_from_target.rotation *= 0.0,
        |pose| pose.position_deviation = 0.0,
        |pose| pose.rotation_deviation = -1.0,
        |pose| pose.position_deviation = f64::NAN,
    ];
    for tick in 0..600 {
        let pose = clean.pose(clean.now.plus(TICK_NS));
        let mut bad = clean.pose(before(clean.now.plus(TICK_NS), 1_000_000));
        nonsense[tick % nonsense.len()](&mut bad);
        let seen = clean.tick_with(&[pose]).unwrap();
        let estimated = spoilt.tick_with(&[bad, pose]).unwrap();
        assert_eq!((estimated.joints, estimated.base), (seen.joints, seen.base), "{tick}");
        assert_eq!(estimated.poses, [seen.poses[0], seen.poses[1] + 1], "{tick}");
    }
    // As the only pose of a tick it is no more than one that is missing.
    let mut bad = spoilt.pose(spoilt.now.plus(TICK_NS));
    bad.tracker_from_target.translation.z = f64::NAN;
    let estimated = spoilt.tick_with(&[bad]).unwrap();
    assert!(estimated.base_from_flange.is_some() && estimated.poses == [0, 1], "{estimated:?}");
}

#[test]
fn what_is_fast_is_the_links_and_not_the_base() {
    let bends = EstimatorConfig {
        jerk_density: [100.0; 6],
        encoder_deviation: JointPos([3e-3; 6]),
        joint_deviation: JointPos([3e-3; 6]),
        ..config()
    };
    let mut world = World::new(bends);
    world.ticks(300).unwrap();
    // The second joint bends by 1 mrad within 40 ms: 0.8 mm at the target.
    for k in 1..=20 {
        world.links.0[1] = AT.0[1] + 5e-5 * f64::from(k);
        world.ticks(1).unwrap();
    }
    let estimated = world.ticks(10).unwrap();
    let seen = estimated.joints.0[1] - AT.0[1];
    let tool = UR10E.forward(&world.links).translation - UR10E.forward(&AT).translation;
    assert!(seen > 0.6e-3, "{seen}");
    let base = estimated.base.displacement.translation.norm();
    assert!(base < 0.25 * tool.norm(), "{base} of {}", tool.norm());
}

#[test]
fn the_filter_is_not_believed_while_it_believes_nothing_and_starts_anew() {
    let mut world = World::new(config());
    world.rates = Some(JointVel::ZERO);
    assert!(world.ticks(100).unwrap().base_from_flange.is_some());
    // Rates that cannot be, at every tick from now on.
    world.rates = Some(JointVel([5.0; 6]));
    let believed: Vec<bool> =
        (0..=DISBELIEF_MAX + 3).map(|_| world.ticks(1).unwrap().base_from_flange.is_some()).collect();
    let doubt = believed.iter().position(|believed| !believed).unwrap();
    assert_eq!(doubt as u32, DOUBT_MAX, "as many are gated before");
    let anew = doubt + believed[doubt..].iter().position(|believed| *believed).unwrap();
    assert_eq!(anew as u32, DISBELIEF_MAX + 1);
    // It starts from the encoders; with rates that are right it goes on.
    world.rates = Some(JointVel::ZERO);
    let then = world.ticks(20).unwrap();
    let off = then.joints.0.iter().zip(&AT.0).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    assert!(then.base_from_flange.is_some() && off < 1e-4, "{off}");
}

/// Joints that swing as they were commanded 6 ms ago, seen by encoders the filter does not trust much: how far its joints are off.
fn swinging(told: bool) -> f64 {
    let config = EstimatorConfig {
        jerk_density: [1e-2; 6],
        encoder_deviation: JointPos([1e-3; 6]),
        dead_time: 3.0 * H,
        ..config()
    };
    let (mut world, mut worst) = (World::new(config), 0.0_f64);
    let (size, w) = (0.2, 6.0);
    for tick in 0..1500 {
        let t = H * f64::from(tick);
        world.encoders.0[0] = AT.0[0] + size * (1.0 - libm::cos(w * t));
        world.links = world.encoders;
        let estimated = world.tick_with(&[]).unwrap();
        let mut acceleration = JointAcc::ZERO;
        if told {
            // It acts a dead time from now.
            acceleration.0[0] = size * w * w * libm::cos(w * (t + 3.0 * H));
        }
        world.estimator.command(&acceleration);
        if tick > 500 {
            worst = worst.max((estimated.joints.0[0] - world.encoders.0[0]).abs());
        }
    }
    worst
}

#[test]
fn a_command_that_is_known_leaves_no_lag() {
    let (told, untold) = (swinging(true), swinging(false));
    assert!(untold > 1e-3 && told < 0.05 * untold, "{told} {untold}");
}

#[test]
fn an_excess_stays_until_it_is_cleared() {
    let mut world = World::new(config());
    world.ticks(100).unwrap();
    world.shift = 0.03;
    let excess = world.ticks(100).unwrap_err();
    assert!((excess.axis, excess.limit) == (0, 0.02) && excess.value > 0.02, "{excess:?}");
    world.shift = 0.001;
    for _ in 0..200 {
        assert!(world.ticks(1).is_err());
    }
    world.estimator.clear();
    assert!(world.ticks(1).is_ok());
    assert!((world.estimator.base().output().displacement.translation.x).abs() < 0.02);
}

#[test]
fn what_cannot_be_is_refused() {
    let refused = |config: &EstimatorConfig<6>| Estimator::<6, 8>::new(config).err();
    assert_eq!(refused(&config()), None);
    let longest = DEAD_TICKS_MAX as f64 * H;
    assert_eq!(refused(&EstimatorConfig { dead_time: longest, ..config() }), None);
    for dead_time in [longest + H, -H, f64::NAN] {
        assert_eq!(refused(&EstimatorConfig { dead_time, ..config() }), Some(EstimatorError::DeadTime), "{dead_time}");
    }
    // Trust would have ended before any command acts.
    let base = BaseConfig { hold: 0.05, ..config().base };
    assert_eq!(refused(&EstimatorConfig { base, dead_time: 0.05, ..config() }), Some(EstimatorError::DeadTime));
    let base = BaseConfig { hold: 0.0, ..config().base };
    let error = Some(EstimatorError::Base(BaseError::Config { field: "hold", value: 0.0 }));
    assert_eq!(refused(&EstimatorConfig { base, ..config() }), error);
    let density = EstimatorConfig { jerk_density: [-1.0; 6], ..config() };
    assert!(matches!(refused(&density), Some(EstimatorError::Filter(_))));
}

fn before(now: Nanos, nanoseconds: u64) -> Nanos {
    Nanos(now.0 - nanoseconds)
}
