//! The filter on paths as they are printed: a quarter of a circle in a level plane at a layer's speed, the command known, the joints
//! straying from it as the filter believes.

mod common;

use common::Random;
use common::dense::{matrix, stack};
use common::plant::{DENSITY, N, TRACKER, deviation};
use nalgebra::Vector3;
use screed_kernel::arm::Arm;
use screed_kernel::arms::comau::NJ130;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::ekf::{Ekf, State};
use screed_kernel::ik::Family;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointJerk, JointPos, JointVel};
use std::f64::consts::FRAC_PI_2;

const DT: f64 = 2e-3;
const RADIUS: f64 = 0.4;
/// Mean speed of the paths (m/s).
const SPEED: f64 = 0.057;
/// The drives pull the joints to their reference: three poles (rad/s).
const POLE: f64 = 20.0;

/// Joints along the quarter circle, tick by tick, from rest to rest.
fn reference(arm: &Arm<N>, start: [f64; N]) -> Vec<[f64; N]> {
    let family = Family::of(arm);
    let first = arm.forward(&JointPos(start));
    let mut joints = JointPos(start);
    let ticks = (RADIUS * FRAC_PI_2 / SPEED / DT) as usize;
    (0..=ticks)
        .map(|tick| {
            let t = tick as f64 / ticks as f64;
            let angle = FRAC_PI_2 * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
            let way = Vector3::new(RADIUS * (angle.cos() - 1.0), RADIUS * angle.sin(), 0.0);
            let pose = Pose { translation: first.translation + way, ..first };
            joints = family.nearest(arm, &pose, &joints).unwrap().joints;
            joints.0
        })
        .collect()
}

/// What came of one print.
struct Printed {
    /// Share of errors inside three standard deviations.
    covered: f64,
    /// Poses taken and offered, but for those that lie.
    poses: [usize; 2],
    /// The same of those that lie by 1 m.
    lies: [usize; 2],
    /// The largest error of a joint's place at any time (rad).
    worst: f64,
}

/// One print; of so many poses one lies, 0 for none.
fn print(arm: &Arm<N>, reference: &[[f64; N]], seed: u64, one_lies_in: u64) -> Printed {
    let mut random = Random(seed);
    let noise = TRACKER;
    let deviation = deviation(&noise);
    let mut truth = State::at_rest(JointPos(reference[0]));
    let mut start = truth;
    for q in &mut start.position.0 {
        *q += deviation.position.0[0] * random.normal();
    }
    let mut ekf = Ekf::new(start, &deviation, &DENSITY).unwrap();
    let tracker_from_base = Pose::from_roll_pitch_yaw(Vector3::new(3.0, -1.0, 0.5), 0.2, -0.1, 2.5);
    let flange_from_target = Pose::from_roll_pitch_yaw(Vector3::new(0.05, 0.02, 0.1), 0.3, 0.0, 1.0);
    let (mut inside, mut all, mut poses, mut lies, mut worst) = (0, 0, [0, 0], [0, 0], 0.0_f64);
    let mut liar = Random(seed ^ 0x11e5);
    let mut out_of_sight = 0;
    for (tick, samples) in reference.windows(4).enumerate() {
        let command = JointJerk(std::array::from_fn(|i| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| samples[k][i]);
            let (speed, acceleration) = ((c - a) / (2.0 * DT), (a - 2.0 * b + c) / (DT * DT));
            let jerk = (d - 3.0 * c + 3.0 * b - a) / (DT * DT * DT);
            let off = [truth.position.0[i] - b, truth.velocity.0[i] - speed, truth.acceleration.0[i] - acceleration];
            jerk - POLE * (POLE * (POLE * off[0] + 3.0 * off[1]) + 3.0 * off[2])
        }));
        let strayed = DENSITY.map(|density| (density / DT).sqrt() * random.normal());
        truth = truth.after(DT, &JointJerk(std::array::from_fn(|i| command.0[i] + strayed[i])));
        ekf.predict(DT, &command).unwrap();
        // Now and then somebody stands between tracker and target, for 1 tick to half a second.
        if random.below(400) == 0 {
            out_of_sight = 1 + random.below(250);
        }
        let seen = out_of_sight == 0;
        out_of_sight = out_of_sight.saturating_sub(1);
        if seen {
            let is = tracker_from_base * arm.forward(&truth.position) * flange_from_target;
            let place = Vector3::from(random.normals(noise.position));
            let turn = Pose::from_rotation_vector(place, Vector3::from(random.normals(noise.rotation)));
            let lies_now = one_lies_in > 0 && liar.below(one_lies_in) == 0;
            let lie = if lies_now { Vector3::from(liar.normals(1.0)).normalize() } else { Vector3::zeros() };
            let tracker_from_target =
                Pose { rotation: turn.rotation * is.rotation, translation: is.translation + place + lie };
            let measured = TrackedPose {
                tracker_from_target,
                tracker_from_base,
                flange_from_target,
                position_deviation: noise.position,
                rotation_deviation: noise.rotation,
            };
            let [taken, offered] = if lies_now { &mut lies } else { &mut poses };
            *taken += usize::from(ekf.pose(arm, &measured).unwrap().is_taken());
            *offered += 1;
        }
        let rates = JointVel(truth.velocity.0.map(|v| v + noise.rates * random.normal()));
        ekf.rates(&rates, &JointVel([noise.rates; N])).unwrap();
        if tick > 100 && tick % 5 == 0 {
            let (error, p) = (stack(&truth) - stack(ekf.state()), matrix(&ekf));
            inside += (0..3 * N).filter(|&i| error[i].abs() <= 3.0 * p[(i, i)].sqrt()).count();
            all += 3 * N;
            worst = worst.max(error.fixed_rows::<N>(0).amax());
        }
    }
    Printed { covered: inside as f64 / all as f64, poses, lies, worst }
}

/// Fifty prints of each arm; of so many poses one lies, 0 for none.
fn prints(one_lies_in: u64) {
    for (arm, start) in [(UR10E, [0.3, -1.2, 1.6, -2.0, -1.5, 0.4]), (NJ130, [0.2, 0.3, -1.5, 0.3, 0.9, 0.2])] {
        let reference = reference(&arm, start);
        let (mut covered, mut taken, mut offered, mut runs, mut lied) = (0.0, 0, 0, 0.0, 0);
        for seed in 0..50 {
            let Printed { covered: share, poses, lies, worst } = print(&arm, &reference, seed, one_lies_in);
            assert_eq!(lies[0], 0, "{} seed {seed}: a pose that lies by 1 m was taken", arm.name);
            lied += lies[1];
            covered += share;
            runs += 1.0;
            (taken, offered) = (taken + poses[0], offered + poses[1]);
            assert!(worst < 0.02, "{} seed {seed}: {worst}", arm.name);
        }
        covered /= runs;
        println!("{}: 3σ cover {:.2} %, {taken} of {offered} poses taken, {lied} that lie", arm.name, 100.0 * covered);
        assert_eq!(lied > 1000, one_lies_in > 0, "{lied}");
        assert!(covered >= 0.99, "{}: {covered}", arm.name);
        assert!(taken as f64 > 0.999 * offered as f64, "{}: {taken} of {offered}", arm.name);
    }
}

#[test]
fn three_sigma_cover_the_errors_of_a_print_through_dropouts() {
    prints(0);
}

/// As many lies as a bad line of sight has: one pose in fifty is off by 1 m in any direction.
#[test]
fn three_sigma_cover_them_too_where_poses_lie_by_a_metre() {
    prints(50);
}
