//! The published control law (KRAKEN paper, section 2.5 and figure 4), made right: what to add to the path's joints.
//!
//! 1. The reference pose, planned for the base where it should be, is taken to the base where it is, and by inverse kinematics
//!    on the same branch to joints: q_r. This is what the paper does with its corrected pose of the base.
//! 2. The joints at which the flange is, by the filter's estimate of its pose, come the same way: q_e. A PID per joint acts on
//!    q_r − q_e, q_r being that of a dead time ago, when what is seen now was sent.
//! 3. A lead, L·q̇_r + q̈_r/K, undoes the lag of the drives ([`crate::drive`]).
//!
//! What 1 and 2 add moves the tool; it is bounded in the tool's own terms ([`Bounds`]). The lead moves nothing but the time at
//! which the tool is there. The sum is led within the limits of corrections ([`Correction::towards`]), and these are part of
//! what the guard leaves room for: so no output breaks its limits. Where the sum has to stay behind, the [`Report`] says by
//! how much.
//!
//! Nothing is corrected anew while the path stands: what has been added stays, and a resume goes on from there.
//!
//! [`Correction::towards`]: crate::correction::Correction::towards

use crate::arm::Arm;
use crate::correction::{Correction, CorrectionLimits};
use crate::delay::Delay;
use crate::drive::{DEAD_TICKS_MAX, Drive, lead};
use crate::guard::exceeds;
use crate::ik::{Answer, Branch, Family, IkError};
use crate::pid::{ByProcess, Gains, Pid, PidError, Process};
use crate::pose::Pose;
use crate::tick::Reference;
use crate::units::JointPos;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Time constant of the speed with which the base's shift moves the joints (s): the base moves slowly, and the drives have to lead
/// for that too.
const SHIFT_TIME: f64 = 0.05;

/// How far (rad, m) the sum may stay behind before the integral waits for it.
const BEHIND_MAX: f64 = 1e-4;

/// How far the tool's shift (m) and turn (rad) may stay behind before the feedback waits: more than a swing whose acceleration is
/// not followed.
const HELD_MAX: f64 = 1e-4;

/// How far they may before the patience runs.
const LOST_MAX: f64 = 1e-3;

/// How far the sum may stay behind at a joint (rad, m) while material is laid before the patience runs.
const LEAD_LOST: f64 = 1e-3;

/// Nearer than this (m, rad), what is added is just what is wanted.
const EXACT: f64 = 1e-12;

/// How far corrections may move the tool centre point. Beyond it they stop, and so does the path: a base that has moved so far
/// is not to be made up for by the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Farthest from the path as planned for the nominal base (m).
    pub shift_max: f64,
    /// Farthest turned from it (rad).
    pub turn_max: f64,
    /// How fast it is shifted at most along each axis (m/s).
    pub shift_speed_max: f64,
    /// How fast that may change (m/s²): what carries the arm is not to be swung.
    pub shift_acceleration_max: f64,
    /// How fast it is turned at most about each axis (rad/s).
    pub turn_speed_max: f64,
    /// How fast that may change (rad/s²).
    pub turn_acceleration_max: f64,
    /// How long it may stay behind by more than 1 mm or 1 mrad (s): a step is gone by then, a base that runs away is not. Nor may
    /// a joint stay behind by more than 1 mrad or 1 mm for longer while material is laid, nor the path wait for longer, be it
    /// for the tracker or for a correction ([`crate::wait`]).
    pub patience: f64,
}

/// What a controller is made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings<const N: usize> {
    /// Gains of each joint.
    pub gains: ByProcess<[Gains; N]>,
    /// How far corrections may go.
    pub bounds: ByProcess<Bounds>,
    /// What is done along paths on which the tool works.
    pub works: Process,
    /// The tool.
    pub flange_from_tcp: Pose,
    /// From sending a target until its effect is in the estimate (s): [`crate::drive::Learning::dead_time`], and what the
    /// estimator adds to it.
    pub dead_time: f64,
}

/// What is known at a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen<'a, const N: usize> {
    /// Where the base is, in the frame of where it should be.
    pub nominal_from_base: Pose,
    /// Where the flange is in the base as it is, by the filter; `None` while that is not to be trusted.
    pub base_from_flange: Option<Pose>,
    /// The joints by the filter, from which steps to those of that pose begin.
    pub joints: JointPos<N>,
    /// The drives as identified.
    pub drives: &'a [Drive; N],
    /// Since the last tick (s).
    pub dt: f64,
}

/// Which bound a correction broke.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Bound {
    /// [`Bounds::shift_max`], m.
    Shift,
    /// [`Bounds::turn_max`], rad.
    Turn,
    /// [`Bounds::patience`], s.
    Speed,
}

/// Why there is no correction; whoever asked stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ControlError {
    /// A correction is larger than it may be, or not fast enough for too long.
    Saturated {
        /// Which bound.
        bound: Bound,
        /// What was asked for.
        value: f64,
        /// What is allowed.
        limit: f64,
    },
    /// No joints put the flange on its path from where the base is now.
    Unreachable(IkError),
    /// While material is laid, a joint stayed behind for longer than the patience: the limits of corrections leave no room to lead.
    Behind {
        /// Joint, 0 for the first.
        joint: u8,
        /// How far (rad, m).
        value: f64,
        /// How far it may for long.
        limit: f64,
    },
    /// Gains, times or numbers that are none.
    Pid(PidError),
    /// Bounds that are not positive, or a dead time beyond [`DEAD_TICKS_MAX`] ticks.
    Configuration,
}

/// What a tick came to, for telemetry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// Whether the feedback acts.
    pub closed: bool,
    /// How far the tool is shifted by corrections (m).
    pub shift: f64,
    /// How far it is turned (rad).
    pub turn: f64,
    /// How far the tool's shift stays behind what was wanted, for the bounds of its speed (m), and its turn (rad).
    pub held: [f64; 2],
    /// By how much the sum stays behind what was wanted, for the limits of the joints (rad, m): a lead is then too short.
    pub behind: f64,
    /// Whether what was wanted has been held back, so that the feedback waits.
    pub saturated: bool,
    /// The branch of the estimate where it is not that of the reference: then feedback has nothing to say.
    pub other_branch: Option<Branch>,
    /// The reference's branch where it is not that of the tick before.
    pub changed_branch: Option<Branch>,
}

/// The controller of an N-joint arm.
#[derive(Clone, Debug)]
pub struct Control<const N: usize> {
    settings: Settings<N>,
    family: Family,
    pid: Pid<N>,
    process: Process,
    /// Whether the feedback acted at the last tick.
    closed: bool,
    /// q_r at the last ticks; `None` before the first.
    references: Option<Delay<N, { DEAD_TICKS_MAX + 1 }>>,
    branch: Option<Branch>,
    /// What the base's shift is to add, smoothed.
    smooth: JointPos<N>,
    /// What the PID adds.
    feedback: JointPos<N>,
    /// What base and PID add, and by how much that shifts (m) and turns (rad) the tool.
    added: JointPos<N>,
    moved: [Correction<3>; 2],
    /// By how much they wanted to.
    aims: [JointPos<3>; 2],
    /// The sum wanted at the last tick.
    wanted: JointPos<N>,
    /// Whether what was wanted at the last tick has been held back.
    waits: bool,
    /// How long it has stayed far behind at the tool (s), and at a joint.
    held: f64,
    late: f64,
}

impl Bounds {
    fn is_valid(&self) -> bool {
        let limits = [self.shift(), self.turn()];
        let valid = limits.iter().all(|limits| limits.is_valid() && *limits != CorrectionLimits::NONE);
        valid && self.patience.is_finite() && self.patience > 0.0
    }

    /// Along each axis.
    const fn shift(&self) -> CorrectionLimits {
        let Self { shift_max, shift_speed_max, shift_acceleration_max, .. } = *self;
        CorrectionLimits {
            size_max: shift_max,
            velocity_max: shift_speed_max,
            acceleration_max: shift_acceleration_max,
        }
    }

    /// About each axis.
    const fn turn(&self) -> CorrectionLimits {
        let Self { turn_max, turn_speed_max, turn_acceleration_max, .. } = *self;
        CorrectionLimits { size_max: turn_max, velocity_max: turn_speed_max, acceleration_max: turn_acceleration_max }
    }
}

impl<const N: usize> Control<N> {
    /// How long the path may wait while material is laid (s).
    pub const fn patience(&self) -> f64 {
        self.settings.bounds.of(self.settings.works).patience
    }

    /// A controller that adds nothing yet, for ticks of `period` s. `family` is that of the arm.
    ///
    /// # Errors
    /// [`ControlError::Configuration`], [`ControlError::Pid`] for gains.
    pub fn new(settings: &Settings<N>, family: Family, period: f64) -> Result<Self, ControlError> {
        let ByProcess { deposit, travel, mill } = &settings.bounds;
        let bounded = deposit.is_valid() && travel.is_valid() && mill.is_valid();
        let longest = DEAD_TICKS_MAX as f64 * period;
        if !(bounded && settings.flange_from_tcp.is_finite() && (0.0..=longest).contains(&settings.dead_time)) {
            return Err(ControlError::Configuration);
        }
        let ByProcess { deposit, travel, mill } = &settings.gains;
        for gains in [deposit, mill] {
            Pid::new(gains).map_err(ControlError::Pid)?;
        }
        Ok(Self {
            settings: *settings,
            family,
            pid: Pid::new(travel).map_err(ControlError::Pid)?,
            process: Process::Travel,
            closed: false,
            references: None,
            branch: None,
            smooth: JointPos::ZERO,
            feedback: JointPos::ZERO,
            added: JointPos::ZERO,
            moved: [Correction::none(); 2],
            aims: [JointPos::ZERO; 2],
            wanted: JointPos::ZERO,
            waits: false,
            held: 0.0,
            late: 0.0,
        })
    }

    /// What to add to the path at this tick, within the limits for corrections, and how that came about.
    ///
    /// # Errors
    /// [`ControlError`]; corrections are to be taken out then.
    pub fn step(
        &mut self,
        arm: &Arm<N>,
        reference: &Reference<N>,
        seen: &Seen<'_, N>,
    ) -> Result<(JointPos<N>, Report), ControlError> {
        let mut report = Report::default();
        if reference.correction.is_none() {
            // Before the first, and after they have been taken out.
            (self.added, self.feedback, self.wanted) = (JointPos::ZERO, JointPos::ZERO, JointPos::ZERO);
            (self.moved, self.aims, self.closed) = ([Correction::none(); 2], [JointPos::ZERO; 2], false);
            self.held = 0.0;
        }
        let mut leads = JointPos::ZERO;
        if reference.plays {
            let base_from_flange = arm.forward(&reference.joints);
            let shift = self.shifted(arm, (reference, &base_from_flange), seen, &mut report)?;
            let feedback = self.feed_back(arm, reference, seen, &mut report)?;
            if !self.waits {
                self.feedback = feedback;
            }
            if report.closed && seen.dt > 0.0 {
                self.pid.put_out(&self.feedback).map_err(ControlError::Pid)?;
            }
            let wanted = sum(&shift, &self.feedback);
            self.bound(arm, (reference, &base_from_flange), &wanted, &mut report)?;
            let mut velocity = reference.velocity;
            let rates = velocity.0.iter_mut().zip(self.smooth.0.iter_mut().zip(&shift.0));
            let part = -libm::expm1(-seen.dt / SHIFT_TIME);
            for (velocity, (smooth, shift)) in rates {
                *velocity += (shift - *smooth) / SHIFT_TIME;
                *smooth += part * (shift - *smooth);
            }
            leads = lead(seen.drives, &velocity, &reference.acceleration);
        } else {
            (self.closed, self.references) = (false, None);
        }
        let wanted = sum(&self.added, &leads);
        let Reference { limits, period, .. } = reference;
        let (next, behind) = reference.correction.towards(&wanted, &self.wanted, limits, *period);
        self.wanted = wanted;
        // The feedback waits for what is held back.
        let [shift, turn] = report.held;
        self.waits = behind > BEHIND_MAX || shift > HELD_MAX || turn > HELD_MAX;
        (report.behind, report.saturated) = (behind, self.waits);
        self.late = if reference.deposit && reference.plays && behind > LEAD_LOST { self.late + period } else { 0.0 };
        if self.late > self.settings.bounds.of(self.process).patience {
            let (joint, value) = farthest(&wanted, &next);
            return Err(ControlError::Behind { joint, value, limit: LEAD_LOST });
        }
        let [shift, turn] = self.moved.map(|part| norm(&part.offsets()));
        (report.shift, report.turn) = (shift, turn);
        Ok((next, report))
    }

    /// q_r − q: the path's pose by the base that is, on its own branch. With the reference, where its joints put the flange.
    fn shifted(
        &mut self,
        arm: &Arm<N>,
        (reference, base_from_flange): (&Reference<N>, &Pose),
        seen: &Seen<'_, N>,
        report: &mut Report,
    ) -> Result<JointPos<N>, ControlError> {
        let joints = reference.joints;
        // Nothing is to be taken from the path where nothing is known of the base: it may pass singularities.
        let answer = if seen.nominal_from_base == Pose::identity() && seen.base_from_flange.is_none() {
            Answer { joints, branch: self.branch, margins: None, free: None }
        } else {
            self.track(arm, &(seen.nominal_from_base.inverse() * *base_from_flange), &joints)?
        };
        if self.branch.is_some() && self.references.is_some() && answer.branch != self.branch {
            report.changed_branch = answer.branch;
        }
        self.branch = answer.branch;
        match &mut self.references {
            Some(references) => references.push(&answer.joints),
            None => {
                self.references = Some(Delay::at_rest(answer.joints));
                // A base that had moved before the path goes on does not move now.
                self.smooth = difference(&answer.joints, &joints);
            }
        }
        Ok(difference(&answer.joints, &joints))
    }

    /// What the PID is to add: nothing where there is no estimate.
    fn feed_back(
        &mut self,
        arm: &Arm<N>,
        reference: &Reference<N>,
        seen: &Seen<'_, N>,
        report: &mut Report,
    ) -> Result<JointPos<N>, ControlError> {
        let process = if reference.deposit { self.settings.works } else { Process::Travel };
        if process != self.process {
            self.pid.set_gains(self.settings.gains.of(process)).map_err(ControlError::Pid)?;
            self.process = process;
        }
        let (Some(base_from_flange), Some(references)) = (seen.base_from_flange, &self.references) else {
            self.closed = false;
            return Ok(JointPos::ZERO);
        };
        let then = references.before(self.settings.dead_time / reference.period);
        let mut seed = then;
        // What carries the last six joints is where it should be.
        let carried = N.saturating_sub(6);
        for (seed, joint) in seed.0.iter_mut().zip(&seen.joints.0).skip(carried) {
            *seed = *joint;
        }
        let answer = self.track(arm, &base_from_flange, &seed)?;
        if answer.branch != self.branch {
            report.other_branch = answer.branch;
            self.closed = false;
            return Ok(JointPos::ZERO);
        }
        let error = difference(&then, &answer.joints);
        if !self.closed {
            // From what is added now, which may be on its way out.
            self.pid.start(&error, &self.feedback).map_err(ControlError::Pid)?;
            self.closed = true;
        }
        report.closed = true;
        if seen.dt <= 0.0 {
            // No time has passed since the last tick: there is nothing to integrate over, and no slope.
            return Ok(self.feedback);
        }
        self.pid.step(&error, seen.dt, !self.waits).map_err(ControlError::Pid)
    }

    /// Adds what is wanted as far and as fast as the tool may be moved. With the reference, where its joints put the flange.
    fn bound(
        &mut self,
        arm: &Arm<N>,
        (reference, base_from_flange): (&Reference<N>, &Pose),
        wanted: &JointPos<N>,
        report: &mut Report,
    ) -> Result<(), ControlError> {
        let bounds = self.settings.bounds.of(self.process);
        let tool = self.settings.flange_from_tcp;
        let planned = *base_from_flange * tool;
        let corrected = arm.forward(&sum(&reference.joints, wanted)) * tool;
        let turned =
            Pose { rotation: corrected.rotation * planned.rotation.transpose(), translation: Vector3::zeros() };
        let aims = [corrected.translation - planned.translation, turned.rotation_vector()];
        let [shift, turn] = aims.map(|part| part.norm());
        for (bound, value, limit) in [(Bound::Shift, shift, bounds.shift_max), (Bound::Turn, turn, bounds.turn_max)] {
            if exceeds(value, limit) {
                return Err(ControlError::Saturated { bound, value, limit });
            }
        }
        let aims = aims.map(|part| JointPos([part.x, part.y, part.z]));
        let mut behind = [0.0; 2];
        for (k, limits) in [bounds.shift(), bounds.turn()].iter().enumerate() {
            let (Some(moved), Some(aim), Some(before)) = (self.moved.get_mut(k), aims.get(k), self.aims.get(k)) else {
                continue;
            };
            let (next, held) = moved.towards(aim, before, limits, reference.period);
            moved.lead_to(&next, reference.period);
            if let Some(behind) = behind.get_mut(k) {
                *behind = held;
            }
        }
        (self.aims, report.held) = (aims, behind);
        let [far, round] = behind;
        if far > EXACT || round > EXACT {
            let [shift, turn] = self.moved.map(|part| Vector3::from(part.offsets().0));
            let turned = Pose::from_rotation_vector(Vector3::zeros(), turn);
            let pose = Pose { rotation: turned.rotation * planned.rotation, translation: planned.translation + shift };
            // By what was added at the last tick it is a small step.
            let seed = sum(&reference.joints, &self.added);
            let answer = self.track(arm, &(pose * tool.inverse()), &seed)?;
            self.added = difference(&answer.joints, &reference.joints);
        } else {
            self.added = *wanted;
        }
        self.held = if far > LOST_MAX || round > LOST_MAX { self.held + reference.period } else { 0.0 };
        if self.held > bounds.patience {
            let (value, limit) = (self.held, bounds.patience);
            return Err(ControlError::Saturated { bound: Bound::Speed, value, limit });
        }
        Ok(())
    }

    fn track(&self, arm: &Arm<N>, pose: &Pose, seed: &JointPos<N>) -> Result<Answer<N>, ControlError> {
        self.family.track(arm, pose, seed).map_err(ControlError::Unreachable)
    }
}

/// The joint in which two positions differ most, and by how much.
fn farthest<const N: usize>(a: &JointPos<N>, b: &JointPos<N>) -> (u8, f64) {
    let far = difference(a, b).0;
    (0..).zip(far.iter()).fold((0, 0.0), |most, (joint, far)| {
        let far = libm::fabs(*far);
        if far > most.1 { (joint, far) } else { most }
    })
}

fn norm(parts: &JointPos<3>) -> f64 {
    Vector3::from(parts.0).norm()
}

fn sum<const N: usize>(a: &JointPos<N>, b: &JointPos<N>) -> JointPos<N> {
    let mut sum = *a;
    for (sum, b) in sum.0.iter_mut().zip(&b.0) {
        *sum += b;
    }
    sum
}

fn difference<const N: usize>(a: &JointPos<N>, b: &JointPos<N>) -> JointPos<N> {
    let mut difference = *a;
    for (difference, b) in difference.0.iter_mut().zip(&b.0) {
        *difference -= b;
    }
    difference
}

#[cfg(test)]
mod tests;
