//! Closed-form inverse kinematics of arms with a spherical wrist: joints 2 and 3 parallel, joint 1 square to them, and the
//! axes of joints 4, 5 and 6 through one point, the wrist's centre. That point depends on joints 1 to 3 only, and the rest of
//! the orientation is the wrist's (Pieper, "The Kinematics of Manipulators Under Computer Control", Stanford, 1968). Offsets
//! as by Brandstötter, Angerer, Hofbaur (Austrian Robotics Workshop, 2014): a₁ between axes 1 and 2, a₂ between the elbow and
//! axis 4, b sideways. Derived here for the DH table itself, so that axes may point either way.
//!
//! An arm with 7 to 9 joints whose last six are of this shape (on a rail, on a crane) is solved with the joints before them
//! held where the seed has them: what carries the arm stands while the arm works, and moving it is the planner's choice.
//!
//! Branches. Shoulder: the wrist's centre lies on the x side of frame 1's axis, or behind it. Elbow: the sign of the sine of
//! the angle from frame 2's x axis, along the upper arm, to the line from the elbow to the wrist's centre. Wrist: the sign of sin θ₅. Margins.
//! Shoulder: distance of the wrist's centre from axis 1 (with b: from the cylinder around it that cannot be reached) as a
//! share of the stretched arm. Elbow and wrist: those two sines. A margin below [`FREE`] leaves a joint free: θ₁, θ₄, and θ₂
//! where upper arm and forearm are of one length and the wrist's centre comes to axis 2.

mod near;
mod shape;

use super::{
    Answer, Beyond, Branch, Branches, IkError, Margins, Missed, Side, angle, check, distance, on_limit, turned_about,
};
use crate::arm::Arm;
use crate::pose::Pose;
use crate::units::JointPos;
use core::f64::consts::{FRAC_PI_2, PI};
use nalgebra::{Matrix3, Vector3};

/// Lengths (m) within which rounding, not geometry, decides that a pose is out of reach.
pub const REACH_TOLERANCE: f64 = 5e-13;
/// Lengths (m) and sines below which a joint is free, and stays where the seed has it.
pub const FREE: f64 = 1e-13;
/// What rounding may make of a difference of two angles (rad), and far more.
const ROUNDING: f64 = 1e-9;

/// What a table says of an arm with a spherical wrist.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Frame 1 above frame 0, and in front of it (m).
    d1: f64,
    a1: f64,
    /// The wrist's centre beside the plane through axis 1 (m).
    b: f64,
    /// Upper arm (m), and the line from the elbow to the wrist's centre: its length (m), and cosine, sine and angle of its
    /// direction in the arm's plane, seen from frame 3's x axis.
    upper: f64,
    fore: f64,
    fore_x: f64,
    fore_y: f64,
    fore_angle: f64,
    /// One over the length of the stretched arm from axis 2 to the wrist's centre (1/m).
    stretched: f64,
    /// The senses of the twists: sin α₁, cos α₂, sin α₃, sin α₄, sin α₅, each ±1.
    s1: f64,
    c2: f64,
    s3: f64,
    s4: f64,
    s5: f64,
    /// What of a difference of an angle one joint has at least: all of it without a coupling.
    share: f64,
    /// What the table has of each angle where the joint reads zero (rad).
    offsets: [f64; 6],
    /// Whether a joint moves another one's link.
    coupled: bool,
    /// The base in frame 0, of an arm that nothing carries.
    zero_from_base: Option<Pose>,
    /// Frame 6 before its joint turns, in the flange.
    flange_from_six: Pose,
    /// How far (m) out of reach a pose may be and is then met as nearly as can be.
    slack: f64,
}

/// Every branch (shoulder × elbow × wrist) that reaches the pose, each joint turned by full turns to lie nearest to `seed` and
/// inside the limits. Where a joint is free the branches that meet there have the same joints.
///
/// # Errors
/// [`IkError`]: [`IkError::OtherShape`] when [`Geometry::of`] knows no geometry; a pose or seed that is not finite, no
/// rotation, out of reach, or only reached beyond the joint limits.
pub fn inverse<const N: usize>(
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Branches<N>, IkError> {
    Geometry::of(arm).ok_or(IkError::OtherShape)?.inverse(arm, base_from_flange, seed)
}

/// The answer nearest to `seed`, by the largest joint difference. When the seed is nearer than half the way to any other
/// branch, one of eight is computed.
///
/// # Errors
/// As [`inverse`].
pub fn nearest<const N: usize>(
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Answer<N>, IkError> {
    Geometry::of(arm).ok_or(IkError::OtherShape)?.nearest(arm, base_from_flange, seed)
}

impl Geometry {
    /// As the free function [`inverse`], for a caller that keeps the geometry.
    ///
    /// # Errors
    /// As [`inverse`].
    pub fn inverse<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Branches<N>, IkError> {
        check(base_from_flange, seed)?;
        held(arm, seed)?;
        let mut found = Branches::empty();
        let goal = Goal::new(self, arm, base_from_flange, seed);
        self.all(arm, &goal, seed, f64::INFINITY, |answer| {
            found.push(answer);
            f64::INFINITY
        })?;
        Ok(found)
    }

    /// As the free function [`nearest`], for a caller that keeps the geometry.
    ///
    /// # Errors
    /// As [`inverse`].
    pub fn nearest<const N: usize>(
        &self,
        arm: &Arm<N>,
        base_from_flange: &Pose,
        seed: &JointPos<N>,
    ) -> Result<Answer<N>, IkError> {
        check(base_from_flange, seed)?;
        held(arm, seed)?;
        let goal = Goal::new(self, arm, base_from_flange, seed);
        let guess = self.guess(arm, &goal, seed);
        if let Some((answer, far, apart)) = &guess
            && far <= apart
        {
            return Ok(*answer);
        }
        let (mut best, mut least) = match guess {
            Some((answer, far, _)) => (Some(answer), far),
            None => (None, f64::INFINITY),
        };
        let all = self.all(arm, &goal, seed, least, |answer| {
            let far = distance(&answer.joints, seed);
            if far < least {
                (best, least) = (Some(answer), far);
            }
            least
        });
        // Without a best one nothing was left out, and `all` says why there is none.
        best.ok_or_else(|| all.err().unwrap_or(IkError::NotFinite))
    }

    /// Every branch's answer is given to `found`, which says how far from the seed an answer may be to be of interest; what one
    /// angle alone shows to be farther is left out. An error if there is none.
    fn all<const N: usize>(
        &self,
        arm: &Arm<N>,
        goal: &Goal,
        seed: &JointPos<N>,
        mut most: f64,
        mut found: impl FnMut(Answer<N>) -> f64,
    ) -> Result<(), IkError> {
        let (mut any, mut missed) = (false, Missed::nothing());
        let [seed1, _, seed3, seed4, ..] = goal.seed;
        for shoulder in self.shoulders(goal)? {
            if self.least(shoulder.theta1, seed1) > most {
                continue;
            }
            let bend = match self.bend(goal, &shoulder) {
                Ok(bend) => bend,
                Err(by) => {
                    missed.reach(by);
                    continue;
                }
            };
            let across = Across::new(self, goal, &shoulder);
            for side in [Side::Plus, Side::Minus] {
                if self.least(self.theta3(&bend, side), seed3) > most {
                    continue;
                }
                let elbow = self.elbow(goal, &bend, side);
                let wrist = self.wrist(goal, &across, &elbow);
                for wrist in [wrist, wrist.flipped()] {
                    if self.least(wrist.theta4, seed4) > most {
                        continue;
                    }
                    match self.answer(arm, seed, (&shoulder, &elbow, &wrist)) {
                        Ok(answer) => {
                            any = true;
                            most = found(answer);
                        }
                        Err(beyond) => missed.limit(beyond),
                    }
                }
            }
        }
        if any { Ok(()) } else { Err(missed.error()) }
    }

    /// How far from the seed an answer is at least whose link has this angle where the seed's has that, whatever full turns its
    /// joints make. Less by what rounding may take from it: what lies so near is computed.
    fn least(&self, angle: f64, seed: f64) -> f64 {
        let away = libm::fabs(angle - seed);
        let turned = if away <= PI { away } else { libm::fabs(away - 2.0 * PI * libm::round(away / (2.0 * PI))) };
        self.share * turned - ROUNDING
    }

    /// The branch on whose sides the seed is, how far it is from the seed, and half of the least that any other branch
    /// differs from it in a joint; `None` if it has no answer.
    ///
    /// Another branch differs by 2·atan2(r, b) in θ₁, twice the elbow's angle in θ₃ or 2·θ₅, modulo full turns: none less than
    /// twice its sine. With a coupling two joints may share that.
    fn guess<const N: usize>(&self, arm: &Arm<N>, goal: &Goal, seed: &JointPos<N>) -> Option<(Answer<N>, f64, f64)> {
        let [seed1, _, seed3, _, seed5, _] = goal.seed;
        let side = |angle: f64| Side::of(if libm::fabs(angle) <= PI { angle } else { libm::sin(angle) });
        let [front, behind] = self.shoulders(goal).ok()?;
        // Less than a quarter turn away.
        let shoulder = if side(front.theta1 - seed1 + FRAC_PI_2) == Side::Plus { front } else { behind };
        let bend = self.bend(goal, &shoulder).ok()?;
        let elbow = self.elbow(goal, &bend, side(self.c2 * seed3 + self.fore_angle));
        let mut wrist = self.wrist(goal, &Across::new(self, goal, &shoulder), &elbow);
        if side(seed5) == Side::Minus {
            wrist = wrist.flipped();
        }
        let answer = self.answer(arm, seed, (&shoulder, &elbow, &wrist)).ok()?;
        let apart = self.share * shoulder.apart.min(elbow.margin).min(wrist.margin);
        Some((answer, distance(&answer.joints, seed), apart))
    }

    /// θ₁ on both sides: sin θ₁ x − cos θ₁ y of the wrist's centre is b.
    fn shoulders(&self, goal: &Goal) -> Result<[Shoulder; 2], IkError> {
        let (px, py) = (goal.wrist.x, goal.wrist.y);
        let distance = libm::sqrt(px * px + py * py);
        let beside = libm::fabs(self.b);
        if beside - distance > self.slack {
            return Err(IkError::OutOfReach { by: beside - distance });
        }
        if distance < FREE {
            let [theta1, ..] = goal.seed;
            let (sin, cos) = libm::sincos(theta1);
            let x = cos * px + sin * py;
            let free = Shoulder {
                side: Side::Plus,
                theta1,
                sin,
                cos,
                x,
                margin: distance * self.stretched,
                apart: 0.0,
                free: true,
            };
            return Ok([free, Shoulder { side: Side::Minus, ..free }]);
        }
        let ahead = libm::sqrt(((distance - beside) * (distance + beside)).max(0.0));
        let scale = 1.0 / (ahead * ahead + self.b * self.b);
        let pair = |x: f64| ((py * x + px * self.b) * scale, (px * x - py * self.b) * scale);
        let ((sin, cos), (sin_behind, cos_behind)) = (pair(ahead), pair(-ahead));
        let theta1 = angle(sin, cos, 1.0);
        let behind = if self.b == 0.0 { opposite(theta1) } else { angle(sin_behind, cos_behind, 1.0) };
        let apart = if self.b == 0.0 { 1.0 } else { ahead / distance };
        let front = Shoulder {
            side: Side::Plus,
            theta1,
            sin,
            cos,
            x: ahead,
            margin: ahead * self.stretched,
            apart,
            free: false,
        };
        let (sin, cos) = (sin_behind, cos_behind);
        Ok([front, Shoulder { side: Side::Minus, theta1: behind, sin, cos, x: -ahead, ..front }])
    }

    /// The elbow's angle by the law of cosines; or by how much (m) the arm is too short or too long.
    fn bend(&self, goal: &Goal, shoulder: &Shoulder) -> Result<Bend, f64> {
        let (x, y) = (shoulder.x - self.a1, self.s1 * (goal.wrist.z - self.d1));
        let squared = x * x + y * y;
        let (upper, fore) = (libm::fabs(self.upper), self.fore);
        // The product of these two is the square of 2·upper·fore·sine, also near both ends.
        let straight = (upper + fore) * (upper + fore) - squared;
        let folded = squared - (upper - fore) * (upper - fore);
        if straight < 0.0 || folded < 0.0 {
            let reach = libm::sqrt(squared);
            let missing = (reach - (upper + fore)).max(libm::fabs(upper - fore) - reach);
            if missing > self.slack {
                return Err(missing);
            }
        }
        let scale = 0.5 / (self.upper * fore);
        let sin = libm::sqrt((straight * folded).max(0.0)) * libm::fabs(scale);
        let cos = ((squared - upper * upper - fore * fore) * scale).clamp(-1.0, 1.0);
        Ok(Bend { x, y, squared, sin, cos, angle: angle(sin, cos, 1.0) })
    }

    fn theta3(&self, bend: &Bend, side: Side) -> f64 {
        self.c2 * (side.sign() * bend.angle - self.fore_angle)
    }

    #[inline(always)]
    fn elbow(&self, goal: &Goal, bend: &Bend, side: Side) -> Elbow {
        let (sin, cos) = (side.sign() * bend.sin, bend.cos);
        // The wrist's centre seen along the upper arm, and square to it.
        let (along, across) = (self.upper + self.fore * cos, self.fore * sin);
        let free = bend.squared < FREE * FREE;
        let (theta2, (sin2, cos2)) = if free {
            let [_, theta2, ..] = goal.seed;
            (theta2, libm::sincos(theta2))
        } else {
            let scale = 1.0 / libm::sqrt(bend.squared * (along * along + across * across));
            let (sin2, cos2) = (bend.y * along - bend.x * across, bend.x * along + bend.y * across);
            (angle(sin2 * scale, cos2 * scale, 1.0), (sin2 * scale, cos2 * scale))
        };
        // The line from the elbow to the wrist's centre, then frame 3's x axis.
        let (sin, cos) = (sin2 * cos + cos2 * sin, cos2 * cos - sin2 * sin);
        Elbow {
            side,
            theta2,
            theta3: self.theta3(bend, side),
            sin: sin * self.fore_x - cos * self.fore_y,
            cos: cos * self.fore_x + sin * self.fore_y,
            margin: bend.sin,
            free,
        }
    }

    /// Joints 4 to 6 with sin θ₅ ≥ 0, from the rotation that joints 1 to 3 leave to them. θ₆ is found after θ₄, and fits it
    /// also where that is ill determined.
    #[inline(always)]
    fn wrist(&self, goal: &Goal, across: &Across, elbow: &Elbow) -> Wrist {
        let Across { level: [g1, g2, g3], up: [e1, e2, e3], side: [h1, h2, h3] } = *across;
        let (sin, cos) = (elbow.sin, elbow.cos);
        let approach = (cos * g3 + sin * e3, h3, self.s3 * self.c2 * (sin * g3 - cos * e3));
        let margin = libm::sqrt(approach.0 * approach.0 + approach.1 * approach.1);
        let free = margin < FREE;
        let (theta4, (sin4, cos4)) = if free {
            let [_, _, _, theta4, ..] = goal.seed;
            (theta4, libm::sincos(theta4))
        } else {
            let (sin4, cos4) = (self.s5 * approach.1, self.s5 * approach.0);
            (angle(sin4, cos4, margin), (sin4 / margin, cos4 / margin))
        };
        let sense = -self.s4 * self.s5;
        let sin6 = sense * (cos4 * h1 - sin4 * (cos * g1 + sin * e1));
        let cos6 = sense * (cos4 * h2 - sin4 * (cos * g2 + sin * e2));
        Wrist {
            side: Side::Plus,
            theta4,
            theta5: angle(self.s5 * (cos4 * approach.0 + sin4 * approach.1), sense * approach.2, 1.0),
            theta6: angle(sin6, cos6, 1.0),
            margin,
            free,
        }
    }

    /// The joints that give the links these angles, each inside its limits and nearest to the seed. A coupled joint may
    /// follow one before its full turns: with a whole factor they are full turns of its own.
    #[inline(always)]
    fn answer<const N: usize>(
        &self,
        arm: &Arm<N>,
        seed: &JointPos<N>,
        (shoulder, elbow, wrist): (&Shoulder, &Elbow, &Wrist),
    ) -> Result<Answer<N>, Beyond> {
        let angles = [shoulder.theta1, elbow.theta2, elbow.theta3, wrist.theta4, wrist.theta5, wrist.theta6];
        let mut joints = *seed;
        let first = N.wrapping_sub(6);
        for ((joint, angle), offset) in (first..N).zip(angles).zip(self.offsets) {
            let coupled = if self.coupled { coupled(arm, joint, &joints) } else { 0.0 };
            if let Some(position) = joints.0.get_mut(joint) {
                *position = angle - offset - coupled;
            }
        }
        let free = match (shoulder.free, elbow.free, wrist.free) {
            (true, ..) => Some(first),
            (_, true, _) => Some(first.wrapping_add(1)),
            (.., true) => Some(first.wrapping_add(3)),
            _ => None,
        };
        Ok(Answer {
            joints: turned_about(arm, &joints, seed)?,
            branch: Some(Branch { shoulder: shoulder.side, elbow: elbow.side, wrist: wrist.side }),
            margins: Some(Margins { shoulder: shoulder.margin, elbow: elbow.margin, wrist: wrist.margin }),
            free,
        })
    }
}

/// The joints that carry the arm, where the seed has them; or one of them is beyond its limits.
fn held<const N: usize>(arm: &Arm<N>, seed: &JointPos<N>) -> Result<(), IkError> {
    let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
    for ((joint, position), (low, high)) in (0..N.wrapping_sub(6)).zip(&seed.0).zip(limits) {
        on_limit(*position, *low, *high).map_err(|(position, _)| IkError::Limit { joint, position })?;
    }
    Ok(())
}

/// The wrist's centre and the orientation of frame 6 before its joint turns, in frame 0 of the arm; and the seed.
struct Goal {
    wrist: Vector3<f64>,
    rotation: Matrix3<f64>,
    /// The DH angles that the seed gives.
    seed: [f64; 6],
}

/// A choice of θ₁, and how far in front of axis 1 the wrist's centre lies (m).
#[derive(Clone, Copy)]
struct Shoulder {
    side: Side,
    theta1: f64,
    sin: f64,
    cos: f64,
    x: f64,
    margin: f64,
    /// Sine of half the angle between the two choices, or less.
    apart: f64,
    free: bool,
}

/// The wrist's centre in the arm's plane, seen from axis 2 (m; its distance squared), and the elbow's angle in [0, π].
struct Bend {
    x: f64,
    y: f64,
    squared: f64,
    sin: f64,
    cos: f64,
    angle: f64,
}

/// A choice of θ₂ and θ₃, with the direction of frame 3's x axis in the arm's plane.
struct Elbow {
    side: Side,
    theta2: f64,
    theta3: f64,
    sin: f64,
    cos: f64,
    margin: f64,
    free: bool,
}

/// The goal's axes as the arm's plane sees them: along its x and y axis, and along frame 3's y axis.
struct Across {
    level: [f64; 3],
    up: [f64; 3],
    side: [f64; 3],
}

/// A choice of θ₄ to θ₆.
#[derive(Clone, Copy)]
struct Wrist {
    side: Side,
    theta4: f64,
    theta5: f64,
    theta6: f64,
    margin: f64,
    free: bool,
}

impl Goal {
    fn new<const N: usize>(geometry: &Geometry, arm: &Arm<N>, base_from_flange: &Pose, seed: &JointPos<N>) -> Self {
        let base_from_six = *base_from_flange * geometry.flange_from_six;
        let zero_from_base = if N > 6 {
            arm.frames(seed).get(N.wrapping_sub(7)).map(|base_from_zero| base_from_zero.inverse())
        } else {
            geometry.zero_from_base
        };
        let zero_from_six = zero_from_base.map_or(base_from_six, |zero_from_base| zero_from_base * base_from_six);
        let mut angles = geometry.offsets;
        for (joint, angle) in (N.wrapping_sub(6)..N).zip(angles.iter_mut()) {
            if let Some(position) = seed.0.get(joint) {
                *angle += position + if geometry.coupled { coupled(arm, joint, seed) } else { 0.0 };
            }
        }
        Self { wrist: zero_from_six.translation, rotation: zero_from_six.rotation, seed: angles }
    }
}

impl Across {
    fn new(geometry: &Geometry, goal: &Goal, shoulder: &Shoulder) -> Self {
        let (sin, cos) = (shoulder.sin, shoulder.cos);
        let (x, y, z) = (goal.rotation.row(0), goal.rotation.row(1), goal.rotation.row(2));
        let sense = geometry.s1 * geometry.c2 * geometry.s3;
        let (sin_side, cos_side) = (sense * sin, sense * cos);
        Self {
            level: [cos * x[0] + sin * y[0], cos * x[1] + sin * y[1], cos * x[2] + sin * y[2]],
            up: [geometry.s1 * z[0], geometry.s1 * z[1], geometry.s1 * z[2]],
            side: [
                sin_side * x[0] - cos_side * y[0],
                sin_side * x[1] - cos_side * y[1],
                sin_side * x[2] - cos_side * y[2],
            ],
        }
    }
}

impl Wrist {
    /// The other way to point: half a turn of joint 4, θ₅ to the other side, half a turn back.
    fn flipped(self) -> Self {
        let side = Side::Minus;
        if self.free {
            return Self { side, ..self };
        }
        Self { side, theta4: opposite(self.theta4), theta5: -self.theta5, theta6: opposite(self.theta6), ..self }
    }
}

/// The same angle half a turn away, in [−π, π].
fn opposite(angle: f64) -> f64 {
    if angle > 0.0 { angle - PI } else { angle + PI }
}

/// How far another joint moves this joint's link.
fn coupled<const N: usize>(arm: &Arm<N>, joint: usize, joints: &JointPos<N>) -> f64 {
    let coupling = arm.joints.get(joint).and_then(|joint| joint.coupling);
    coupling.and_then(|coupling| Some(coupling.factor * joints.0.get(coupling.joint)?)).unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
