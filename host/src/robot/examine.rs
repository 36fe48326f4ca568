//! What `screed robot check` finds out about an arm, over seeded joint vectors.

use super::Description;
use super::description::JOINTS;
use super::sample::Random;
use screed_kernel::arm::Arm;
use screed_kernel::dexterity::Dexterity;
use screed_kernel::ik::{Answer, Family, IkError};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

/// How far a joint of the seed may be from where the pose was taken (rad, m).
const SEED_SPREAD: f64 = 0.1;
/// Step of the differences that a Jacobian is compared with (rad, m).
const STEP: f64 = 1e-5;
/// A round trip that ends farther from its pose than this (m, rad) has missed it, times the arm's size in metres from one on.
pub const MISS: f64 = 1e-9;
/// Misses that are kept as examples.
const EXAMPLES: usize = 3;

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Examination {
    /// How the inverse is found.
    pub family: &'static str,
    /// Joint vectors drawn, and the seed they follow from.
    pub count: usize,
    /// The seed.
    pub seed: u64,
    /// Largest distance of a round trip's end from its pose (m), misses left out.
    pub position_error: f64,
    /// Largest angle likewise (rad).
    pub rotation_error: f64,
    /// Round trips that failed.
    pub misses: usize,
    /// The first of them: joints, and what happened.
    pub examples: Vec<(Vec<f64>, String)>,
    /// Largest difference between a Jacobian's entry and central differences.
    pub jacobian_error: f64,
    /// Least and largest distance of the flange from the base's origin (m).
    pub reach: [f64; 2],
    /// Least and largest x, y and z of the flange in the base frame (m).
    pub bounds: [[f64; 2]; 3],
    /// Smallest singular value of the Jacobian: least and median.
    pub singular_value: [f64; 2],
    /// Where the flange was (m).
    pub points: Vec<[f64; 3]>,
}

/// Examines an arm of 3 to 9 joints; `None` for others.
pub fn examine(description: &Description, count: usize, seed: u64) -> Option<Examination> {
    let examine = [of::<3>, of::<4>, of::<5>, of::<6>, of::<7>, of::<8>, of::<9>];
    let index = description.links.len().checked_sub(*JOINTS.start())?;
    examine.get(index)?(description, count, seed)
}

fn of<const N: usize>(description: &Description, count: usize, seed: u64) -> Option<Examination> {
    let arm = description.arm::<N>("arm")?;
    let mut random = Random::new(seed);
    let family = Family::of(&arm);
    // The closed form of an arm that is carried leaves what carries it where the seed has it.
    let held = if matches!(family, Family::Wrist(_) | Family::Calibrated(_)) { N.saturating_sub(6) } else { 0 };
    let mut found = Examination {
        family: family.name(),
        count,
        seed,
        position_error: 0.0,
        rotation_error: 0.0,
        misses: 0,
        examples: Vec::new(),
        jacobian_error: 0.0,
        reach: [f64::INFINITY, 0.0],
        bounds: [[f64::INFINITY, f64::NEG_INFINITY]; 3],
        singular_value: [0.0; 2],
        points: Vec::new(),
    };
    let mut singular_values = Vec::with_capacity(count);
    for _ in 0..count {
        let joints = JointPos(random.joints(&arm));
        let (pose, jacobian) = arm.jacobian(&joints);
        found.place(&pose);
        singular_values.push(Dexterity::of(&jacobian).singular_value_min);
        found.jacobian_error = found.jacobian_error.max(difference(&arm, &joints));
        let near = near(&arm, held, &joints, &mut random);
        found.round_trip(family.nearest(&arm, &pose, &near), &arm, &joints, &pose);
    }
    singular_values.sort_by(f64::total_cmp);
    let at = |index: usize| singular_values.get(index).copied().unwrap_or(f64::NAN);
    found.singular_value = [at(0), at(count / 2)];
    Some(found)
}

/// A seed close by, within the ranges; the first `held` joints are where the pose was taken.
fn near<const N: usize>(arm: &Arm<N>, held: usize, joints: &JointPos<N>, random: &mut Random) -> JointPos<N> {
    let mut near = *joints;
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    for (position, (low, high)) in near.0.iter_mut().zip(limits).skip(held) {
        *position = (*position + random.between(-SEED_SPREAD, SEED_SPREAD)).clamp(*low, *high);
    }
    near
}

impl Examination {
    fn place(&mut self, pose: &Pose) {
        let at = pose.translation;
        self.reach = [self.reach[0].min(at.norm()), self.reach[1].max(at.norm())];
        for (bounds, value) in self.bounds.iter_mut().zip(at.iter()) {
            *bounds = [bounds[0].min(*value), bounds[1].max(*value)];
        }
        self.points.push(at.into());
    }

    fn round_trip<const N: usize>(
        &mut self,
        answer: Result<Answer<N>, IkError>,
        arm: &Arm<N>,
        joints: &JointPos<N>,
        pose: &Pose,
    ) {
        let mut missed = |why: String| {
            self.misses += 1;
            if self.examples.len() < EXAMPLES {
                self.examples.push((joints.0.to_vec(), why));
            }
        };
        let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
        match answer {
            Ok(answer) if !limits.zip(&answer.joints.0).all(|((low, high), at)| low <= at && at <= high) => {
                missed(format!("its answer {:?} is outside the ranges", answer.joints.0));
            }
            Ok(answer) => {
                let back = arm.forward(&answer.joints);
                let apart = (back.translation - pose.translation).norm();
                let turned = Pose { rotation: back.rotation * pose.rotation.transpose(), ..back };
                let turn = turned.rotation_vector().norm();
                // Written so that what is not a number is a miss.
                if apart <= MISS * pose.translation.norm().max(1.0) && turn <= MISS {
                    self.position_error = self.position_error.max(apart);
                    self.rotation_error = self.rotation_error.max(turn);
                } else {
                    missed(format!("it leads {:.3e} m and {turn:.3e} rad away", apart));
                }
            }
            Err(error) => missed(reason(&error)),
        }
    }
}

/// Largest difference between the Jacobian's entries and central differences of poses.
fn difference<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>) -> f64 {
    let (_, jacobian) = arm.jacobian(joints);
    let mut worst = 0.0_f64;
    for joint in 0..N {
        let beside = |shift: f64| {
            let mut joints = *joints;
            joints.0[joint] += shift;
            arm.forward(&joints)
        };
        let (below, above) = (beside(-STEP), beside(STEP));
        let turned = Pose { rotation: above.rotation * below.rotation.transpose(), ..above };
        let linear = (above.translation - below.translation) / (2.0 * STEP);
        let angular = turned.rotation_vector() / (2.0 * STEP);
        worst = worst.max((jacobian.fixed_view::<3, 1>(0, joint) - linear).amax());
        worst = worst.max((jacobian.fixed_view::<3, 1>(3, joint) - angular).amax());
    }
    worst
}

/// Why there is no answer, in words.
fn reason(error: &IkError) -> String {
    match error {
        IkError::NotFinite => "pose or seed is not finite".to_owned(),
        IkError::NotRotation { by } => format!("the rotation is none, by {by:.3e}"),
        IkError::OtherShape => "no inverse is known for this shape of table".to_owned(),
        IkError::OutOfReach { by } => format!("out of reach by {by:.3e} m"),
        IkError::Orientation { by } => format!("the orientation cannot be given, by {by:.3e} rad"),
        IkError::Limit { joint, position } => format!("joint {} would have to be at {position:.6} rad or m", joint + 1),
        IkError::Singular { singularity, distance } => {
            format!("singular at the {}, by {distance:.3e}", singularity.name())
        }
        IkError::NotConverged { residual } => format!("not converged, {residual:.3e} m or rad left"),
    }
}
