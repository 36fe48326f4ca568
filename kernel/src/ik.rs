//! Inverse kinematics: every joint vector that puts the flange where it is wanted.
//!
//! An [`Answer`] says which [`Branch`] it is on and how far from each singularity; an answer close to one is still an answer.
//! Errors are for poses to which none can be given.

pub mod calibrated;
mod family;
pub mod gantry;
pub mod numeric;
pub mod track;
pub mod ur;
pub mod wrist;

pub use family::Family;

use crate::arm::{Arm, JointKind};
use crate::pose::Pose;
use crate::units::JointPos;
use core::f64::consts::PI;
use nalgebra::Vector3;

/// How far (rad) a joint may lie beyond its limit and be taken to lie on it: what rounding alone does.
pub const LIMIT_TOLERANCE: f64 = 1e-13;
/// The most full turns of one joint that [`turns`] lists.
pub const TURNS_MAX: f64 = 64.0;
/// The most answers that six joints can have for a pose (Primrose, "On the input-output equation of the general 7R-mechanism",
/// Mechanism and Machine Theory 21(6), 1986). Closed forms have eight at most.
pub const ANSWERS_MAX: usize = 16;
/// How far a pose's axes may be from unit length and right angles to each other.
pub const ROTATION_TOLERANCE: f64 = 1e-6;

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum IkError {
    /// The pose or the seed has a component that is NaN or infinite.
    NotFinite,
    /// The pose's rotation is none: its axes are not of unit length, not square to each other, or left-handed.
    NotRotation {
        /// The root of the sum of squares of the deviations found, more than [`ROTATION_TOLERANCE`].
        by: f64,
    },
    /// The arm's table does not have the shape that this closed form needs.
    OtherShape,
    /// The pose lies outside what the arm can reach; by how much, in metres, the nearest branch misses it.
    OutOfReach {
        /// Distance missing (m).
        by: f64,
    },
    /// The arm cannot give the flange this orientation wherever it is (arms with fewer than six axes).
    Orientation {
        /// The angle missing (rad).
        by: f64,
    },
    /// The pose can be reached, but no branch lies inside the joint limits.
    Limit {
        /// The joint (0 is the first) that the branch nearest to its limits needs beyond them.
        joint: usize,
        /// Where that joint would have to be (rad, m).
        position: f64,
    },
    /// So close to a singularity that the joints cannot be found.
    Singular {
        /// Which.
        singularity: Singularity,
        /// How far from it, as in [`Margins`].
        distance: f64,
    },
    /// The iteration's cap was reached.
    NotConverged {
        /// What was left: the larger of the distance (m) and the angle (rad) to the pose.
        residual: f64,
    },
}

/// Where two branches meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Singularity {
    /// The wrist centre is as near to the axis of joint 1 as the arm's shape lets it.
    Shoulder,
    /// The arm is stretched or folded.
    Elbow,
    /// Joints 4 and 6 turn about parallel axes.
    Wrist,
}

/// How far an answer is from each singularity, without unit and not negative; 0 is on it. What each is the sine or the share
/// of, the family's module says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// From [`Singularity::Shoulder`].
    pub shoulder: f64,
    /// From [`Singularity::Elbow`].
    pub elbow: f64,
    /// From [`Singularity::Wrist`].
    pub wrist: f64,
}

impl Margins {
    /// The nearest singularity, and how far it is.
    pub fn nearest(&self) -> (Singularity, f64) {
        let mut nearest = (Singularity::Shoulder, self.shoulder);
        for other in [(Singularity::Elbow, self.elbow), (Singularity::Wrist, self.wrist)] {
            if other.1 < nearest.1 {
                nearest = other;
            }
        }
        nearest
    }
}

/// One of the two ways of a choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Side {
    /// The family's module says what is positive.
    Plus,
    /// And negative.
    Minus,
}

/// Which of the (at most) eight answers: it stays the same along a path until that crosses a singularity, and at one it still
/// tells the answers apart that meet there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Branch {
    /// On which side of joint 1's axis the arm reaches.
    pub shoulder: Side,
    /// To which side the elbow is bent.
    pub elbow: Side,
    /// To which side the wrist is bent.
    pub wrist: Side,
}

/// Joints that reach the pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer<const N: usize> {
    /// Where they are, inside the limits; of all full turns the nearest to the seed.
    pub joints: JointPos<N>,
    /// Which branch; `None` where the arm has no such branches (a gantry) or they are not known (a numeric answer).
    pub branch: Option<Branch>,
    /// How far from each singularity; `None` as for the branch.
    pub margins: Option<Margins>,
    /// At a singularity, the joint that the pose leaves free: it stays where the seed has it.
    pub free: Option<usize>,
}

/// All branches: at most eight answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branches<const N: usize> {
    answers: [Answer<N>; ANSWERS_MAX],
    len: usize,
}

impl Singularity {
    /// The word for a person.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Shoulder => "shoulder",
            Self::Elbow => "elbow",
            Self::Wrist => "wrist",
        }
    }
}

impl Side {
    /// +1 or −1.
    pub const fn sign(self) -> f64 {
        match self {
            Self::Plus => 1.0,
            Self::Minus => -1.0,
        }
    }

    /// The side of a number; zero is [`Side::Plus`].
    pub const fn of(value: f64) -> Self {
        if value < 0.0 { Self::Minus } else { Self::Plus }
    }
}

impl<const N: usize> Branches<N> {
    const fn empty() -> Self {
        let none = Answer { joints: JointPos::ZERO, branch: None, margins: None, free: None };
        Self { answers: [none; ANSWERS_MAX], len: 0 }
    }

    fn one(answer: Answer<N>) -> Self {
        let mut one = Self::empty();
        one.push(answer);
        one
    }

    fn push(&mut self, answer: Answer<N>) {
        if let Some(slot) = self.answers.get_mut(self.len) {
            *slot = answer;
            self.len = self.len.wrapping_add(1);
        }
    }

    /// The answers found, in no promised order.
    pub fn as_slice(&self) -> &[Answer<N>] {
        self.answers.get(..self.len).unwrap_or(&[])
    }

    /// By how much the worst of the answers misses the pose they are of: the larger of the distance (m) and the angle (rad),
    /// by forward kinematics of the joints that they have.
    pub fn residual(&self, arm: &Arm<N>, base_from_flange: &Pose) -> f64 {
        let (mut away, mut turned) = (0.0, 0.0);
        let larger = |a: f64, b: f64| if b > a || b.is_nan() { b } else { a };
        for four in self.as_slice().chunks(4) {
            let [first, ..] = four else { continue };
            let joints: [_; 4] = core::array::from_fn(|k| &four.get(k).unwrap_or(first).joints);
            let (far, wide) = arm.flanges(joints).farthest(base_from_flange);
            (away, turned) = (larger(away, far), larger(turned, wide));
        }
        // The axes of two rotations an angle φ apart differ by 2√2·sin φ/2 together; by rounding, more than 2√2.
        let sine = libm::sqrt(0.125 * turned);
        larger(libm::sqrt(away), 2.0 * libm::asin(if sine > 1.0 { 1.0 } else { sine }))
    }

    /// The answer whose largest joint difference to `seed` (rad, m) is the least.
    pub fn nearest(&self, seed: &JointPos<N>) -> Option<&Answer<N>> {
        let mut best = (f64::INFINITY, None);
        for answer in self.as_slice() {
            let distance = distance(&answer.joints, seed);
            if distance < best.0 {
                best = (distance, Some(answer));
            }
        }
        best.1
    }
}

/// What the branches that gave no answer missed, to say why there is none at all.
#[derive(Clone, Copy, Debug)]
struct Missed {
    by: f64,
    beyond: f64,
    limit: Option<(usize, f64)>,
}

impl Missed {
    const fn nothing() -> Self {
        Self { by: f64::INFINITY, beyond: f64::INFINITY, limit: None }
    }

    /// A branch is out of reach by so much (m).
    const fn reach(&mut self, by: f64) {
        self.by = self.by.min(by);
    }

    /// A branch needs a joint beyond its limit.
    const fn limit(&mut self, beyond: Beyond) {
        if beyond.by < self.beyond {
            self.beyond = beyond.by;
            self.limit = Some((beyond.joint, beyond.position));
        }
    }

    const fn error(&self) -> IkError {
        match self.limit {
            Some((joint, position)) => IkError::Limit { joint, position },
            None => IkError::OutOfReach { by: self.by },
        }
    }
}

/// A joint that no full turn puts inside its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Beyond {
    joint: usize,
    position: f64,
    by: f64,
}

impl Beyond {
    const fn error(self) -> IkError {
        IkError::Limit { joint: self.joint, position: self.position }
    }
}

/// What every inverse asks of its arguments. A NaN or an infinity makes each sum NaN.
fn check<const N: usize>(pose: &Pose, seed: &JointPos<N>) -> Result<(), IkError> {
    let Pose { rotation, translation } = pose;
    let axis = |column: usize| -> Vector3<f64> { rotation.column(column).into() };
    let (x, y, z) = (axis(0), axis(1), axis(2));
    let (long, wide) = (x.norm_squared() - 1.0, y.norm_squared() - 1.0);
    let squared = (x.cross(&y) - z).norm_squared() + long * long + wide * wide;
    let others = translation.iter().chain(&seed.0).fold(0.0, |sum, value| sum + value * 0.0);
    if squared <= ROTATION_TOLERANCE * ROTATION_TOLERANCE && others == 0.0 {
        return Ok(());
    }
    if !pose.is_finite() || !seed.is_finite() {
        return Err(IkError::NotFinite);
    }
    Err(IkError::NotRotation { by: libm::sqrt(squared) })
}

/// atan2(y, x) for who knows the length of (x, y): by tan φ/2 = sin φ/(1 + cos φ) (Abramowitz, Stegun, "Handbook of
/// Mathematical Functions", 4.3.20) of the angle to the nearer end of the x axis. Two thirds of the instructions of libm's
/// atan2, which chooses among more ranges and special cases. A wrong length is a wrong angle by no more than its relative error.
#[inline(always)]
fn angle(y: f64, x: f64, length: f64) -> f64 {
    // Of (0, 0) the angle is zero, not 0/0.
    let nearer = 2.0 * libm::atan(y / (length + libm::fabs(x) + f64::MIN_POSITIVE));
    if x < 0.0 { libm::copysign(PI, y) - nearer } else { nearer }
}

/// The largest joint difference (rad, m).
fn distance<const N: usize>(a: &JointPos<N>, b: &JointPos<N>) -> f64 {
    a.0.iter().zip(&b.0).fold(0.0, |far: f64, (a, b)| far.max(libm::fabs(a - b)))
}

/// [`turned`] of an arm whose joints turn or are where the seed has them. Mostly one turn is enough; without a branch for
/// each joint, that is quickly found.
fn turned_about<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>, seed: &JointPos<N>) -> Result<JointPos<N>, Beyond> {
    let mut near = *joints;
    let mut inside = true;
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    for ((position, seed), (low, high)) in near.0.iter_mut().zip(&seed.0).zip(limits) {
        let away = *position - seed;
        *position -= if away > PI { 2.0 * PI } else { 0.0 } - if away < -PI { 2.0 * PI } else { 0.0 };
        inside &= (*low <= *position) & (*position <= *high) & (libm::fabs(*position - seed) <= PI);
    }
    if inside { Ok(near) } else { turned(arm, joints, seed) }
}

/// Turns each revolute joint by full turns to lie nearest to the seed and inside the limits, or names the joint that cannot.
fn turned<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>, seed: &JointPos<N>) -> Result<JointPos<N>, Beyond> {
    let mut turned = *joints;
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    let given = arm.joints.iter().zip(&seed.0).zip(limits);
    for (joint, (position, ((moved, seed), (&low, &high)))) in (0..N).zip(turned.0.iter_mut().zip(given)) {
        *position = match moved.kind {
            JointKind::Revolute => full_turns(*position, *seed, low, high),
            JointKind::Prismatic => on_limit(*position, low, high),
        }
        .map_err(|(position, by)| Beyond { joint, position, by })?;
    }
    Ok(turned)
}

/// The position plus the count of full turns that puts it nearest to the seed inside the limits; or the position nearest to
/// the seed, and how far the nearest of all is beyond the limits.
fn full_turns(position: f64, seed: f64, low: f64, high: f64) -> Result<f64, (f64, f64)> {
    let away = position - seed;
    let nearest = match away {
        // No turn or one, mostly: without a quotient.
        _ if libm::fabs(away) <= PI => position,
        _ if libm::fabs(away) <= 3.0 * PI => position - if away > 0.0 { 2.0 * PI } else { -2.0 * PI },
        _ => position - 2.0 * PI * libm::round(away / (2.0 * PI)),
    };
    if low <= nearest && nearest <= high {
        return Ok(nearest);
    }
    // The first turn inside, seen from the side that `nearest` is on.
    let inside = if nearest < low {
        nearest + 2.0 * PI * libm::ceil((low - LIMIT_TOLERANCE - nearest) / (2.0 * PI))
    } else {
        nearest - 2.0 * PI * libm::ceil((nearest - high - LIMIT_TOLERANCE) / (2.0 * PI))
    };
    on_limit(inside, low, high).map_err(|(_, by)| {
        let back = if nearest < low { low - (inside - 2.0 * PI) } else { inside + 2.0 * PI - high };
        (nearest, by.min(libm::fabs(back)))
    })
}

/// The position, if it is inside the limits or beyond them by no more than rounding; or itself and how far it is beyond.
fn on_limit(position: f64, low: f64, high: f64) -> Result<f64, (f64, f64)> {
    let by = (low - position).max(position - high);
    if by <= LIMIT_TOLERANCE { Ok(position.max(low).min(high)) } else { Err((position, by)) }
}

/// Every way to reach the same pose by full turns of the joints inside their limits.
///
/// A joint without end (an infinite limit, or more than [`TURNS_MAX`] turns) or a sliding one keeps its position. The count is
/// the product over the joints: a UR's ±360° give two for each joint, three for one at 0°. The first joint changes first.
pub fn turns<const N: usize>(arm: &Arm<N>, joints: &JointPos<N>) -> Turns<N> {
    let mut turns = Turns { lowest: *joints, highest: *joints, next: Some(*joints) };
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    let ends = turns.lowest.0.iter_mut().zip(turns.highest.0.iter_mut());
    for (((lowest, highest), joint), (low, high)) in ends.zip(&arm.joints).zip(limits) {
        if joint.kind == JointKind::Revolute && high - low <= 2.0 * PI * TURNS_MAX {
            *lowest -= 2.0 * PI * libm::floor((*lowest - low + LIMIT_TOLERANCE) / (2.0 * PI));
            *highest += 2.0 * PI * libm::floor((high + LIMIT_TOLERANCE - *highest) / (2.0 * PI));
        }
        if *lowest > *highest || !(on_limit(*lowest, *low, *high).is_ok() && on_limit(*highest, *low, *high).is_ok()) {
            turns.next = None;
        }
    }
    turns.next = turns.next.map(|_| turns.lowest);
    turns
}

/// The iterator of [`turns`].
#[derive(Clone, Copy, Debug)]
pub struct Turns<const N: usize> {
    lowest: JointPos<N>,
    highest: JointPos<N>,
    next: Option<JointPos<N>>,
}

impl<const N: usize> Iterator for Turns<N> {
    type Item = JointPos<N>;

    fn next(&mut self) -> Option<JointPos<N>> {
        let this = self.next?;
        let mut following = this;
        self.next = None;
        // Counting: the first joint that can go on does, those before it start again.
        for ((position, lowest), highest) in following.0.iter_mut().zip(&self.lowest.0).zip(&self.highest.0) {
            let turned = *position + 2.0 * PI;
            // Of positions beyond 1e16 rad a turn is less than rounding.
            if *highest - *position > PI && turned > *position {
                *position = turned;
                self.next = Some(following);
                break;
            }
            *position = *lowest;
        }
        Some(this)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::arms::ur::UR10E;
    use std::vec::Vec;

    fn ur_with(position_min: f64, position_max: f64) -> Arm<6> {
        Arm { position_min: JointPos([position_min; 6]), position_max: JointPos([position_max; 6]), ..UR10E }
    }

    #[test]
    fn turns_are_all_that_limits_leave() {
        let joints = JointPos([0.0, 1.0, -1.0, 3.0, 2.0 * PI, -6.0]);
        let all: Vec<_> = turns(&UR10E, &joints).collect();
        assert_eq!(all.len(), 3 * 2 * 2 * 2 * 3 * 2);
        let pose = UR10E.forward(&joints);
        for (k, turned) in all.iter().enumerate() {
            assert!(turned.0.iter().all(|position| libm::fabs(*position) <= 2.0 * PI + LIMIT_TOLERANCE), "{turned:?}");
            assert!((UR10E.forward(turned).rotation - pose.rotation).amax() < 1e-14);
            assert!(all[..k].iter().all(|other| distance(other, turned) > 6.0), "{turned:?} twice");
        }
        let mut endless = UR10E;
        (endless.position_min.0[5], endless.position_max.0[5]) = (f64::NEG_INFINITY, f64::INFINITY);
        assert_eq!(turns(&endless, &joints).count(), 3 * 2 * 2 * 2 * 3);
        assert!(turns(&endless, &joints).all(|turned| turned.0[5] == -6.0));
        assert_eq!(turns(&ur_with(-1.0, 0.5), &joints).count(), 0, "no turn puts joint 4 inside");
        assert_eq!(turns(&ur_with(1e17, 1e17 + 100.0), &JointPos([1e17; 6])).count(), 1, "a turn is lost in rounding");
        assert!(turns(&ur_with(-f64::MAX, f64::MAX), &joints).eq([joints]));
    }

    #[test]
    fn the_turn_nearest_to_the_seed_inside_the_limits_is_taken() {
        let zero = JointPos([0.0; 6]);
        for (seed, expected) in
            [(0.0, 0.0), (3.0, 0.0), (3.2, 2.0 * PI), (9.0, 2.0 * PI), (100.0, 2.0 * PI), (-9.9, -2.0 * PI)]
        {
            assert_eq!(turned(&UR10E, &zero, &JointPos([seed; 6])), Ok(JointPos([expected; 6])), "seed {seed}");
        }
        // On the limit but for rounding is on it; beyond it is not.
        let narrow = ur_with(-1.0, 1.0);
        assert_eq!(turned(&narrow, &JointPos([1.0 + 5e-14; 6]), &zero), Ok(JointPos([1.0; 6])));
        assert_eq!(turned(&narrow, &JointPos([-1.0 - 5e-14 + 4.0 * PI; 6]), &zero).unwrap().0[3], -1.0);
        let beyond = turned(&narrow, &JointPos([0.0, 0.0, 1.5, 0.0, 0.0, 0.0]), &zero);
        assert_eq!(beyond, Err(Beyond { joint: 2, position: 1.5, by: 0.5 }));
        let beyond =
            turned(&narrow, &JointPos([2.0 * PI - 1.2, 0.0, 0.0, 0.0, 0.0, 0.0]), &JointPos([5.0; 6])).unwrap_err();
        assert!(beyond.joint == 0 && libm::fabs(beyond.by - 0.2) < 1e-15 && libm::fabs(beyond.position - 5.083) < 1e-3);
    }

    #[test]
    fn an_angle_is_that_of_atan2() {
        for k in 0..10_000 {
            let (sin, cos) = libm::sincos(f64::from(k - 5_000) * 1e-3);
            for (y, x) in [(sin, cos), (sin * 1e-9, cos), (sin, cos * 1e-9), (sin * 1e-200, cos * 1e-200)] {
                let (found, expected) = (angle(y, x, libm::hypot(x, y)), libm::atan2(y, x));
                assert!(libm::fabs(found - expected) <= 9e-16, "{y}, {x}: {found}, {expected}");
                assert!(x < 0.0 || libm::fabs(found - expected) <= 6e-16 * libm::fabs(expected), "{y}, {x}");
            }
        }
        for (y, x) in [(0.0, 1.0), (-0.0, 1.0), (0.0, -1.0), (-0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 0.0)] {
            assert_eq!(angle(y, x, libm::hypot(x, y)), libm::atan2(y, x), "{y}, {x}");
        }
    }

    #[test]
    fn the_residual_is_that_of_the_worst_answer() {
        let joints = JointPos([0.1, -1.0, 1.0, 0.4, 0.7, 0.2]);
        let pose = UR10E.forward(&joints);
        let found = ur::inverse(&UR10E, &pose, &joints).unwrap();
        assert_eq!(found.as_slice().len(), 8);
        assert!(found.residual(&UR10E, &pose) < 5e-15);
        for worst in 0..8 {
            // Joint 6 turns the flange about its own axis and moves it nowhere; the elbow does both.
            let mut moved = found;
            moved.answers[worst].joints.0[5] += 1e-7;
            assert!(libm::fabs(moved.residual(&UR10E, &pose) - 1e-7) < 1e-14, "answer {worst}");
            moved.answers[worst].joints.0[2] += 2.0;
            let there = UR10E.forward(&moved.answers[worst].joints);
            let turned =
                Pose { rotation: pose.rotation.transpose() * there.rotation, ..there }.rotation_vector().norm();
            let expected = turned.max((there.translation - pose.translation).norm());
            assert!(libm::fabs(moved.residual(&UR10E, &pose) - expected) < 1e-14, "answer {worst}");
            moved.answers[worst].joints.0[0] = f64::NAN;
            assert!(moved.residual(&UR10E, &pose).is_nan(), "answer {worst}");
        }
        assert_eq!(Branches::<6>::empty().residual(&UR10E, &pose), 0.0);
    }

    #[test]
    fn what_is_no_rotation_is_refused() {
        let pose = UR10E.forward(&JointPos([0.1, -1.0, 1.0, 0.4, 0.7, 0.2]));
        assert_eq!(check(&pose, &JointPos::<6>::ZERO), Ok(()));
        let with = |rotation| check(&Pose { rotation, ..pose }, &JointPos::<6>::ZERO);
        for rotation in [pose.rotation * 1.1, -pose.rotation, pose.rotation.map(|entry| entry + 1e-5)] {
            assert!(matches!(with(rotation), Err(IkError::NotRotation { by }) if by > 1e-6), "{rotation}");
        }
        assert_eq!(with(pose.rotation * f64::NAN), Err(IkError::NotFinite));
        assert_eq!(check(&pose, &JointPos([f64::INFINITY; 6])), Err(IkError::NotFinite));
    }
}
