//! From starts to answers, and from answers to their neighbours.

use super::scan::Scan;
use super::{Curve, Geometry, NEAR};
use crate::arm::Arm;
use crate::ik::numeric::{RESIDUAL_MAX, approach};
use crate::ik::{ANSWERS_MAX, Answer, Branch, Branches, IkError, Margins, Missed, Side, Singularity};
use crate::pose::Pose;
use crate::units::JointPos;
use core::f64::consts::PI;
use nalgebra::Vector3;

/// Answers on one branch nearer to each other than this (rad) are one: where two branches meet, rounding moves them so far.
const SAME: f64 = 1e-4;
/// Answers on two branches nearer than this are one.
const SAME_OF_TWO: f64 = 1e-9;
/// Margin below which an answer that is not one says which singularity it is that keeps the unit from the pose.
pub(super) const CLOSE: f64 = 0.05;
/// How far (rad) an answer may be from where the curve's value is zero, to lie on it.
const ON_CURVE: f64 = 1e-3;
/// Poses beside the goal that start parts of a circle, and by how much they are beside it: turn (rad), shift (m).
const BESIDE: usize = 18;
const TURN: f64 = 0.1;
const SHIFT: f64 = 0.03;

const SINGULARITIES: [Singularity; 3] = [Singularity::Shoulder, Singularity::Elbow, Singularity::Wrist];

/// What is found on the way.
pub(super) struct Search<'a, const N: usize> {
    geometry: &'a Geometry,
    /// The arm without limits ([`super::held`]).
    unit: &'a Arm<N>,
    goal: &'a Pose,
    seed: &'a JointPos<N>,
    found: [Option<Known<N>>; ANSWERS_MAX],
    /// The least that was left by a start that did not lead to the pose, and where.
    least: Option<(f64, JointPos<N>)>,
}

#[derive(Clone, Copy)]
struct Known<const N: usize> {
    joints: JointPos<N>,
    branch: Branch,
    /// Which of [`SINGULARITIES`] it was found around; those need no second look from here.
    seen: [bool; 3],
    /// Which of them are near, to the answer or to a start that led here.
    near: [bool; 3],
}

/// A part of a circle that was walked along: the sides of the other two choices, and from where to where.
type Arc = ([Side; 2], f64, f64);

impl<'a, const N: usize> Search<'a, N> {
    pub fn new(geometry: &'a Geometry, unit: &'a Arm<N>, goal: &'a Pose, seed: &'a JointPos<N>) -> Self {
        Self { geometry, unit, goal, seed, found: [None; ANSWERS_MAX], least: None }
    }

    /// Where a start leads: the answer, if it leads to the pose.
    pub fn start(&mut self, start: &JointPos<N>) -> Option<usize> {
        let (joints, residual) = approach(self.unit, self.goal, start);
        if residual > RESIDUAL_MAX {
            if self.least.is_none_or(|(least, _)| residual < least) {
                self.least = Some((residual, joints));
            }
            return None;
        }
        let (branch, margins) = self.geometry.posture(self.unit, &joints);
        for (index, slot) in self.found.iter_mut().enumerate() {
            match slot {
                Some(known) => {
                    let same = if known.branch == branch { SAME } else { SAME_OF_TWO };
                    if turns_between(&known.joints, &joints) < same {
                        return Some(index);
                    }
                }
                None => {
                    *slot = Some(Known { joints, branch, seen: [false; 3], near: near(&margins) });
                    return Some(index);
                }
            }
        }
        None
    }

    /// From an answer of the nominal arm; and what is around it where it has no answer of its own.
    pub fn nominal(&mut self, start: &Answer<N>) {
        let found = self.start(&start.joints);
        let (Some(branch), Some(margins)) = (start.branch, start.margins) else { return };
        let near = near(&margins);
        match found.and_then(|index| self.found.get_mut(index)) {
            Some(Some(known)) if known.branch == branch => {
                for (known, near) in known.near.iter_mut().zip(near) {
                    *known |= near;
                }
            }
            _ => {
                for (singularity, near) in SINGULARITIES.into_iter().zip(near) {
                    if near {
                        self.scan(&start.joints, branch, singularity);
                    }
                }
            }
        }
    }

    /// What there is around each answer, those included that are found on the way.
    pub fn neighbours(&mut self) {
        for index in 0..ANSWERS_MAX {
            let Some(Some(known)) = self.found.get(index).copied() else { break };
            for (which, singularity) in SINGULARITIES.into_iter().enumerate() {
                let Some(Some(now)) = self.found.get(index) else { break };
                let (close, seen) = (known.near.get(which) == Some(&true), now.seen.get(which) == Some(&true));
                if close && !seen && !self.is_paired(&known, singularity) {
                    self.scan(&known.joints, known.branch, singularity);
                }
            }
        }
    }

    /// Whether the other answer of a fold is known; there is no third.
    fn is_paired(&self, known: &Known<N>, singularity: Singularity) -> bool {
        let twin = opposite(known.branch, singularity);
        matches!(self.geometry.curve(singularity), Curve { is_circle: false, .. })
            && self.found.iter().flatten().any(|other| other.branch == twin)
    }

    /// All answers on the curve through, or close to, a start.
    fn scan(&mut self, start: &JointPos<N>, branch: Branch, singularity: Singularity) {
        let Curve { joint, is_circle, .. } = self.geometry.curve(singularity);
        let mut arcs: [Option<Arc>; BESIDE + 1] = [None; BESIDE + 1];
        let (low, high) = self.walk(start, singularity);
        if !is_circle || high - low >= 2.0 * PI - 1e-6 {
            return;
        }
        // Where the elbow does not reach, a part of the circle is missing, and there may be other parts.
        let around = others(branch, singularity);
        if let Some(slot) = arcs.first_mut() {
            *slot = Some((around, low, high));
        }
        for beside in 0..BESIDE {
            let goal = self.beside(start, singularity, beside);
            let Ok(starts) = self.geometry.nominal.inverse(self.unit, &goal, self.seed) else { continue };
            for start in starts.as_slice() {
                let Some(branch) = start.branch.filter(|branch| others(*branch, singularity) == around) else {
                    continue;
                };
                let led = start.joints.0.get(joint_of::<N>(joint)).copied().unwrap_or(0.0);
                let covered = |arc: &Arc| {
                    let (_, low, high) = *arc;
                    let past = (led - low) - 2.0 * PI * libm::floor((led - low) / (2.0 * PI));
                    past <= high - low
                };
                if arcs.iter().flatten().any(covered) {
                    continue;
                }
                let (low, high) = self.walk(&start.joints, singularity);
                if let Some(slot) = arcs.iter_mut().find(|slot| slot.is_none()) {
                    *slot = Some((others(branch, singularity), low, high));
                }
            }
        }
    }

    /// Walks along the curve and takes what is found; returns from where to where the joint was led.
    fn walk(&mut self, start: &JointPos<N>, singularity: Singularity) -> (f64, f64) {
        let Curve { joint, step, reach, .. } = self.geometry.curve(singularity);
        let scan = Scan { arm: self.unit, goal: self.goal, joint: joint_of::<N>(joint), step, reach };
        scan.run(start, |joints| {
            // Where the curve was lost, steps may lead to an answer elsewhere.
            if let Some(Some(known)) = self.start(joints).and_then(|index| self.found.get_mut(index))
                && turns_between(&known.joints, joints) < ON_CURVE
            {
                for (seen, which) in known.seen.iter_mut().zip(SINGULARITIES) {
                    *seen |= which == singularity;
                }
            }
        })
    }

    /// A pose beside the goal: turned about an axis square to that of joint 6, or shifted square to that of joint 1.
    fn beside(&self, start: &JointPos<N>, singularity: Singularity, which: usize) -> Pose {
        let (_, jacobian) = self.unit.jacobian(start);
        let column = if singularity == Singularity::Wrist { N.saturating_sub(1) } else { N.saturating_sub(6) };
        let [_, _, _, x, y, z] = jacobian.data.0.get(column).copied().unwrap_or_default();
        let axis = Vector3::new(x, y, z);
        let away = if libm::fabs(axis.x) < 0.6 { Vector3::x() } else { Vector3::y() };
        let first = axis.cross(&away).normalize();
        let second = axis.cross(&first);
        let (sin, cos) = libm::sincos(2.0 * PI * which as f64 / BESIDE as f64);
        let direction = first * cos + second * sin;
        if singularity == Singularity::Wrist {
            let turn = Pose::from_rotation_vector(Vector3::zeros(), direction * TURN);
            Pose { rotation: turn.rotation * self.goal.rotation, ..*self.goal }
        } else {
            Pose { translation: self.goal.translation + direction * SHIFT, ..*self.goal }
        }
    }

    /// The answers inside the limits of the arm, or why there is none.
    pub fn end(self, arm: &Arm<N>, nominal: Option<IkError>) -> Result<Branches<N>, IkError> {
        let (mut found, mut missed) = (Branches::empty(), Missed::nothing());
        for known in self.found.iter().flatten() {
            match self.geometry.answer(arm, &known.joints, self.seed) {
                Ok(answer) => found.push(answer),
                Err(beyond) => missed.limit(beyond),
            }
        }
        if !found.as_slice().is_empty() {
            return Ok(found);
        }
        match (missed.limit, nominal, self.least) {
            (Some(_), ..) => Err(missed.error()),
            (None, Some(error), _) => Err(error),
            (None, None, Some((residual, joints))) => Err(self.why(residual, &joints)),
            (None, None, None) => Err(IkError::NotConverged { residual: f64::INFINITY }),
        }
    }

    /// Why so much is left at these joints.
    fn why(&self, residual: f64, joints: &JointPos<N>) -> IkError {
        let (_, margins) = self.geometry.posture(self.unit, joints);
        match margins.nearest() {
            (_, distance) if distance > CLOSE => IkError::NotConverged { residual },
            (Singularity::Wrist, distance) => IkError::Singular { singularity: Singularity::Wrist, distance },
            _ => IkError::OutOfReach { by: residual },
        }
    }
}

const fn joint_of<const N: usize>(of_last_six: usize) -> usize {
    N.saturating_sub(6).saturating_add(of_last_six)
}

fn near(margins: &Margins) -> [bool; 3] {
    [margins.shoulder, margins.elbow, margins.wrist].map(|margin| margin < NEAR)
}

/// The branch that meets this one at the singularity.
const fn opposite(mut branch: Branch, singularity: Singularity) -> Branch {
    let side = match singularity {
        Singularity::Shoulder => &mut branch.shoulder,
        Singularity::Elbow => &mut branch.elbow,
        Singularity::Wrist => &mut branch.wrist,
    };
    *side = match side {
        Side::Plus => Side::Minus,
        Side::Minus => Side::Plus,
    };
    branch
}

/// The sides of the two choices that the singularity leaves.
const fn others(branch: Branch, singularity: Singularity) -> [Side; 2] {
    match singularity {
        Singularity::Shoulder => [branch.elbow, branch.wrist],
        Singularity::Elbow => [branch.shoulder, branch.wrist],
        Singularity::Wrist => [branch.shoulder, branch.elbow],
    }
}

/// The largest joint difference, full turns aside.
fn turns_between<const N: usize>(a: &JointPos<N>, b: &JointPos<N>) -> f64 {
    a.0.iter().zip(&b.0).fold(0.0, |far: f64, (a, b)| {
        let away = a - b;
        far.max(libm::fabs(away - 2.0 * PI * libm::round(away / (2.0 * PI))))
    })
}
