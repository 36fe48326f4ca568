//! Closed-form inverse kinematics of UR-type arms: joints 2, 3 and 4 parallel, joint 1 square to them and joint 5 too.
//!
//! The geometry is that of Hawkins, "Analytic Inverse Kinematics for the Universal Robots UR-5/UR-10 Arms" (Georgia Tech,
//! 2013), written in sines and cosines instead of angles. With w the origin of frame 5 in frame 0, ρ its distance from axis
//! 1, D = d₂ + d₃ + d₄, u = (cos θ₁, sin θ₁, 0) along the arm's plane and n = (sin θ₁, −cos θ₁, 0) square to it:
//!
//! * n·w = D and u·w = h = ±√(ρ² − D²) give θ₁; h also is the factor of the Jacobian's determinant that vanishes at the
//!   shoulder singularity, as sin θ₃ and sin θ₅ do at the others: det J = −a₂ a₃ h sin θ₃ sin θ₅ in size.
//! * With X, Y, Z the flange axes, n·X = sin θ₅ cos θ₆, n·Y = −sin θ₅ sin θ₆ and n·Z = cos θ₅ give θ₅ and θ₆.
//! * Frame 5's y axis, X sin θ₆ + Y cos θ₆, gives θ₂ + θ₃ + θ₄; then joints 2 and 3 are a planar arm to a known point.
//!
//! [`Branch`]: shoulder is the sign of h, elbow that of sin θ₃, wrist that of sin θ₅. [`Margins`]: |h|/ρ, |sin θ₃|, |sin θ₅|.
//! Every step is consistent with the one before, so that the pose is met to rounding however near a singularity; what is
//! badly determined there are the joints: by about 1e-15 over the margin.

mod corner;
mod near;

use super::{Answer, Beyond, Branch, Branches, IkError, Margins, Missed, Side, angle, check, distance, turned_about};
use crate::arm::{Arm, Dh, Joint, JointKind};
use crate::pose::Pose;
use crate::units::JointPos;
use core::f64::consts::PI;
use nalgebra::Vector3;

/// Lengths (m) within which rounding, not geometry, decides that a pose is out of reach.
const REACH_TOLERANCE: f64 = 2e-13;
/// sin θ₅ below which joints 4 and 6 are collinear and θ₆ is taken from the seed: the pose is missed by twice this at most.
const WRIST_SINGULAR: f64 = 4e-13;
/// The product of the margins from which on rounding moves joints by less than 1e-7.
const WELL_KNOWN: f64 = 1e-6;
/// Distance (m) from an axis below which the angle about it is free.
const ON_AXIS: f64 = 1e-13;

/// Every branch (shoulder × wrist × elbow) that reaches the pose inside the joint limits, each joint turned by full turns to
/// lie nearest to `seed`. At the wrist singularity θ₆ is the seed's, or as near to it as the elbow's reach lets it.
///
/// # Errors
/// [`IkError`] when the pose is no finite rigid transform, out of reach, or only reached beyond the joint limits; when the
/// arm's table does not have this shape.
pub fn inverse<const N: usize>(
    arm: &Arm<N>,
    base_from_flange: &Pose,
    seed: &JointPos<N>,
) -> Result<Branches<N>, IkError> {
    Geometry::of(arm).ok_or(IkError::OtherShape)?.inverse(arm, base_from_flange, seed)
}

/// The branch nearest to `seed`, by the largest joint difference. When the seed is nearer than half the way to any other
/// branch, which the margins prove, one of eight is computed.
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

/// What of an arm's table the closed form needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    zero_from_base: Option<Pose>,
    flange_from_last: Option<Pose>,
    /// Table angle less joint position (rad).
    offsets: [f64; 6],
    d1: f64,
    /// D.
    across: f64,
    d5: f64,
    d6: f64,
    a2: f64,
    a3: f64,
    /// How far (m) out of reach a pose may be and is then met as nearly as can be.
    slack: f64,
}

/// The pose, as seen from frame 0: the flange axes, and w with its height above joint 2.
struct Target {
    x: Vector3<f64>,
    y: Vector3<f64>,
    z: Vector3<f64>,
    wrist: Vector3<f64>,
    /// ρ².
    squared: f64,
}

/// The arm's plane for one θ₁, and the flange axes in it: along n, along u.
#[derive(Clone, Copy)]
struct Plane {
    theta1: f64,
    /// h.
    along: f64,
    margin: f64,
    nx: f64,
    ny: f64,
    nz: f64,
    ux: f64,
    uy: f64,
    free: bool,
}

/// The wrist's joints, for one sign of sin θ₅.
#[derive(Clone, Copy)]
struct Hand {
    theta5: f64,
    theta6: f64,
    theta234: f64,
    /// sin and cos of θ₂ + θ₃ + θ₄.
    sine: f64,
    cosine: f64,
    margin: f64,
    free: bool,
}

/// Where frame 4's origin lies in the arm's plane, seen from joint 2, and how the elbow is bent to reach it, for sin θ₃ > 0.
struct Bend {
    px: f64,
    py: f64,
    theta3: f64,
    /// Frame 4's origin seen along the upper arm and square to it.
    ahead: f64,
    aside: f64,
    margin: f64,
}

impl Geometry {
    /// If the table has this shape: α = 90° 0 0 90° −90° 0 exactly, lengths along x in rows 2 and 3 only, every joint turning
    /// for itself. θ offsets, d in any row, a base and a flange pose may be there.
    #[inline(always)]
    pub fn of<const N: usize>(arm: &Arm<N>) -> Option<Self> {
        let rows: &[Dh; 6] = arm.dh.as_slice().try_into().ok()?;
        let [r1, r2, r3, r4, r5, r6] = rows;
        // Sums of sizes: one comparison instead of many.
        let sizes = |values: [f64; 10]| values.iter().fold(0.0, |sum, value| sum + libm::fabs(*value));
        let [c1, s2, s3] = [r1.cos_alpha, r2.sin_alpha, r3.sin_alpha];
        let zeros = sizes([c1, s2, s3, r4.cos_alpha, r5.cos_alpha, r6.sin_alpha, r1.a, r4.a, r5.a, r6.a]);
        let right = r1.sin_alpha == 1.0 && r4.sin_alpha == 1.0 && r5.sin_alpha == -1.0;
        let flat = r2.cos_alpha == 1.0 && r3.cos_alpha == 1.0 && r6.cos_alpha == 1.0;
        let turning = |joint: &Joint| matches!(joint, Joint { kind: JointKind::Revolute, coupling: None });
        if !(zeros == 0.0 && right && flat && arm.joints.iter().all(turning)) {
            return None;
        }
        Some(Self {
            zero_from_base: arm.base_from_zero.map(|pose| pose.inverse()),
            flange_from_last: arm.last_from_flange.map(|pose| pose.inverse()),
            offsets: [r1.theta, r2.theta, r3.theta, r4.theta, r5.theta, r6.theta],
            d1: r1.d,
            across: r2.d + r3.d + r4.d,
            d5: r5.d,
            d6: r6.d,
            a2: r2.a,
            a3: r3.a,
            slack: REACH_TOLERANCE,
        })
    }

    /// See [`inverse`]; `arm` gives the limits.
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
        let mut found = Branches::empty();
        let missed = self.all(arm, &self.target(base_from_flange), seed, &mut found);
        if found.as_slice().is_empty() { Err(missed.error()) } else { Ok(found) }
    }

    /// See [`nearest`]; `arm` gives the limits.
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
        let target = self.target(base_from_flange);
        let guess = self.guess(arm, &target, seed);
        if let Some((answer, far)) = &guess {
            // Two branches differ by 2·atan2(h, D), 2·θ₃ or 2·θ₅ in a joint, none less than twice its sine: the nearest
            // singularity's margin is less than half the way to any other branch. Rounding is kept below a tenth of it.
            let alone = |margins: Margins| {
                let Margins { shoulder, elbow, wrist } = margins;
                *far <= 0.9 * margins.nearest().1 && shoulder * elbow * wrist >= WELL_KNOWN
            };
            if answer.margins.is_some_and(alone) {
                return Ok(*answer);
            }
        }
        let mut found = Branches::empty();
        let missed = self.all(arm, &target, seed, &mut found);
        let (mut best, mut least) = guess.unzip();
        for answer in found.as_slice() {
            let far = distance(&answer.joints, seed);
            if least.is_none_or(|least| far < least) {
                (best, least) = (Some(*answer), Some(far));
            }
        }
        best.ok_or(missed.error())
    }

    #[inline(always)]
    fn target(&self, base_from_flange: &Pose) -> Target {
        let mut pose = *base_from_flange;
        if let Some(zero_from_base) = &self.zero_from_base {
            pose = *zero_from_base * pose;
        }
        if let Some(flange_from_last) = &self.flange_from_last {
            pose = pose * *flange_from_last;
        }
        let axis = |column: usize| -> Vector3<f64> { pose.rotation.column(column).into() };
        let (x, y, z) = (axis(0), axis(1), axis(2));
        let wrist = pose.translation - z * self.d6 - Vector3::new(0.0, 0.0, self.d1);
        Target { x, y, z, wrist, squared: wrist.x * wrist.x + wrist.y * wrist.y }
    }

    /// The branch on whose sides the seed is, and how far it is from the seed; `None` if it has no answer.
    #[inline(always)]
    fn guess<const N: usize>(&self, arm: &Arm<N>, target: &Target, seed: &JointPos<N>) -> Option<(Answer<N>, f64)> {
        let table = self.table(seed);
        let (s1, c1) = libm::sincos(table[0]);
        let shoulder = Side::of(c1 * target.wrist.x + s1 * target.wrist.y);
        let side = |angle: f64| Side::of(if libm::fabs(angle) <= PI { angle } else { libm::sin(angle) });
        let (elbow, wrist) = (side(table[2]), side(table[4]));
        let plane = self.plane(target, self.along(target).ok()? * shoulder.sign(), table[0]);
        let hand = plane.hand(target, table[5]).on(wrist);
        let bend = self.bend_to(target, &plane, &hand).ok()?;
        let answer = self.answer(arm, (&plane, &hand, &bend), Branch { shoulder, elbow, wrist }, seed).ok()?;
        Some((answer, distance(&answer.joints, seed)))
    }

    /// Adds every branch's answer to those found; returns what was missed.
    #[inline(never)]
    fn all<const N: usize>(
        &self,
        arm: &Arm<N>,
        target: &Target,
        seed: &JointPos<N>,
        found: &mut Branches<N>,
    ) -> Missed {
        let mut missed = Missed::nothing();
        let table = self.table(seed);
        let along = match self.along(target) {
            Ok(along) => along,
            Err(by) => {
                missed.reach(by);
                return missed;
            }
        };
        for shoulder in [Side::Plus, Side::Minus] {
            let plane = self.plane(target, along * shoulder.sign(), table[0]);
            let hand = plane.hand(target, table[5]);
            for wrist in [Side::Plus, Side::Minus] {
                let hand = hand.on(wrist);
                let mut bent = |plane: &Plane, hand: &Hand, bend: &Bend| {
                    for elbow in [Side::Plus, Side::Minus] {
                        match self.answer(arm, (plane, hand, bend), Branch { shoulder, elbow, wrist }, seed) {
                            Ok(answer) => found.push(answer),
                            Err(beyond) => missed.limit(beyond),
                        }
                    }
                };
                match self.bend_to(target, &plane, &hand) {
                    Ok(bend) => bent(&plane, &hand, &bend),
                    Err(by) => match self.corner(target, (&plane, &hand, wrist), &table, by) {
                        Ok((plane, hand, bend)) => bent(&plane, &hand, &bend),
                        Err(by) => missed.reach(by),
                    },
                }
            }
        }
        missed
    }

    /// The angles of the table for joint positions.
    #[inline(always)]
    fn table<const N: usize>(&self, joints: &JointPos<N>) -> [f64; 6] {
        let mut table = self.offsets;
        for (angle, position) in table.iter_mut().zip(&joints.0) {
            *angle += position;
        }
        table
    }

    /// The size of h, or by how much (m) w is too near to axis 1.
    #[inline(always)]
    fn along(&self, target: &Target) -> Result<f64, f64> {
        let squared = target.squared - self.across * self.across;
        if squared >= 0.0 {
            return Ok(libm::sqrt(squared));
        }
        let missing = libm::fabs(self.across) - libm::sqrt(target.squared);
        match missing {
            _ if missing <= REACH_TOLERANCE => Ok(0.0),
            // As in `bend_to`.
            _ if missing <= self.slack => Ok(libm::sqrt(0.2 * self.slack * libm::fabs(self.across))),
            _ => Err(missing),
        }
    }

    #[inline(always)]
    fn plane(&self, target: &Target, along: f64, seed: f64) -> Plane {
        let (wx, wy, squared) = (target.wrist.x, target.wrist.y, target.squared);
        let free = squared < ON_AXIS * ON_AXIS;
        let (s1, c1) = if free {
            libm::sincos(seed)
        } else {
            let own = along * along + self.across * self.across;
            // Not the same only where h was set.
            let scale = if own == squared { squared } else { libm::sqrt(own * squared) };
            ((along * wy + self.across * wx) / scale, (along * wx - self.across * wy) / scale)
        };
        let Target { x, y, z, .. } = target;
        Plane {
            theta1: if free { seed } else { angle(s1, c1, 1.0) },
            along,
            margin: if free { 0.0 } else { libm::fabs(along) / libm::sqrt(squared) },
            nx: s1 * x.x - c1 * x.y,
            ny: s1 * y.x - c1 * y.y,
            nz: s1 * z.x - c1 * z.y,
            ux: c1 * x.x + s1 * x.y,
            uy: c1 * y.x + s1 * y.y,
            free,
        }
    }

    /// Frame 4's origin in the arm's plane, seen from joint 2 (m).
    fn goal(&self, target: &Target, plane: &Plane, hand: &Hand) -> (f64, f64) {
        (plane.along - self.d5 * hand.sine, target.wrist.z + self.d5 * hand.cosine)
    }

    /// Or by how much (m) the planar arm of joints 2 and 3 does not reach.
    #[inline(always)]
    fn bend_to(&self, target: &Target, plane: &Plane, hand: &Hand) -> Result<Bend, f64> {
        let (px, py) = self.goal(target, plane, hand);
        let (upper, fore) = (libm::fabs(self.a2), libm::fabs(self.a3));
        let (longest, shortest, squared) = (upper + fore, upper - fore, px * px + py * py);
        // 1 − cos θ₃ and 1 + cos θ₃ times 2·a₂·a₃: accurate where the elbow is nearly straight or folded.
        let mut straight = longest * longest - squared;
        let mut folded = squared - shortest * shortest;
        if straight < 0.0 || folded < 0.0 {
            let reach = libm::sqrt(squared);
            let missing = (reach - longest).max(libm::fabs(shortest) - reach);
            if missing > self.slack {
                return Err(missing);
            }
            // Only a start for what follows is wanted where so much is missing: it is better a little off the singularity.
            let open = if missing > REACH_TOLERANCE { 0.2 * self.slack * longest } else { 0.0 };
            (straight, folded) = (straight.max(open), folded.max(open));
        }
        let scale = 1.0 / (2.0 * self.a2 * self.a3);
        let margin = libm::sqrt(straight * folded) * libm::fabs(scale);
        let cosine = 0.5 * (folded - straight) * scale;
        Ok(Bend {
            px,
            py,
            theta3: angle(margin, cosine, 1.0),
            ahead: self.a2 + self.a3 * cosine,
            aside: self.a3 * margin,
            margin,
        })
    }

    #[inline(always)]
    fn answer<const N: usize>(
        &self,
        arm: &Arm<N>,
        (plane, hand, bend): (&Plane, &Hand, &Bend),
        branch: Branch,
        seed: &JointPos<N>,
    ) -> Result<Answer<N>, Beyond> {
        let aside = bend.aside * branch.elbow.sign();
        let theta3 = bend.theta3 * branch.elbow.sign();
        // Seen along the upper arm or in the plane, frame 4's origin is as far from joint 2.
        let theta2 = angle(
            bend.ahead * bend.py - aside * bend.px,
            bend.ahead * bend.px + aside * bend.py,
            bend.px * bend.px + bend.py * bend.py,
        );
        let table = [plane.theta1, theta2, theta3, hand.theta234 - theta2 - theta3, hand.theta5, hand.theta6];
        let mut joints = JointPos::ZERO;
        for ((position, angle), offset) in joints.0.iter_mut().zip(table).zip(self.offsets) {
            *position = angle - offset;
        }
        let free = match (plane.free, hand.free) {
            (true, _) => Some(0),
            (false, true) => Some(5),
            (false, false) => None,
        };
        let margins = Margins { shoulder: plane.margin, elbow: bend.margin, wrist: hand.margin };
        let joints = turned_about(arm, &joints, seed)?;
        Ok(Answer { joints, branch: Some(branch), margins: Some(margins), free })
    }
}

impl Plane {
    /// For sin θ₅ > 0.
    #[inline(always)]
    fn hand(&self, target: &Target, seed: f64) -> Hand {
        let margin = libm::sqrt(self.nx * self.nx + self.ny * self.ny);
        let free = margin < WRIST_SINGULAR;
        let (s6, c6) = if free { libm::sincos(seed) } else { (-self.ny / margin, self.nx / margin) };
        let theta6 = if free { seed } else { angle(s6, c6, 1.0) };
        self.hand_with(target, (s6, c6, theta6), margin, free)
    }

    #[inline(always)]
    fn hand_with(&self, target: &Target, (s6, c6, theta6): (f64, f64, f64), margin: f64, free: bool) -> Hand {
        let (sine, cosine) = (-(self.ux * s6 + self.uy * c6), target.x.z * s6 + target.y.z * c6);
        // With θ₆ given, what is seen of sin θ₅; less is lost than with its size.
        let seen = if free { self.nx * c6 - self.ny * s6 } else { margin };
        let theta234 = angle(sine, cosine, 1.0);
        Hand { theta5: angle(seen, self.nz, 1.0), theta6, theta234, sine, cosine, margin, free }
    }
}

impl Hand {
    /// The same flange axes with sin θ₅ of the other sign: half a turn before and after. Where joint 6 is free it stays, and
    /// sin θ₅ is zero if it would be of the wrong sign.
    #[inline(always)]
    fn on(&self, side: Side) -> Self {
        let opposite = |angle: f64| if angle > 0.0 { angle - PI } else { angle + PI };
        match (side, self.free) {
            (Side::Plus, false) => *self,
            (_, true) if Side::of(self.theta5) == side => *self,
            (_, true) => Self { theta5: if libm::fabs(self.theta5) < 1.0 { 0.0 } else { side.sign() * PI }, ..*self },
            (Side::Minus, false) => Self {
                theta5: -self.theta5,
                theta6: opposite(self.theta6),
                theta234: opposite(self.theta234),
                sine: -self.sine,
                cosine: -self.cosine,
                ..*self
            },
        }
    }
}
#[cfg(test)]
mod tests {
    use super::*;
    use crate::arms::ur::UR10E;
    use core::f64::consts::PI;

    /// splitmix64, as a number in [-π, π].
    fn angle(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 * PI - PI
    }

    #[test]
    fn nearest_is_the_nearest_of_all_branches_from_near_and_far_seeds() {
        let mut state = 5;
        let mut joints = || JointPos(core::array::from_fn(|_| angle(&mut state)));
        for case in 0..20_000 {
            let (goal, other) = (joints(), joints());
            let share = [1.0, 0.1, 1e-3, 1e-6][case % 4];
            let seed = JointPos(core::array::from_fn(|i| goal.0[i] + share * other.0[i]));
            let pose = UR10E.forward(&goal);
            let distance = |joints: &JointPos<6>| {
                joints.0.iter().zip(&seed.0).fold(0.0, |far: f64, (a, b)| far.max(libm::fabs(a - b)))
            };
            let nearest = nearest(&UR10E, &pose, &seed).unwrap();
            let all = inverse(&UR10E, &pose, &seed).unwrap();
            assert!(all.as_slice().contains(&nearest), "seed {seed:?}");
            let least = all.as_slice().iter().map(|answer| distance(&answer.joints)).fold(f64::INFINITY, f64::min);
            assert_eq!(distance(&nearest.joints), least, "seed {seed:?}");
        }
    }
}
