//! The arm as a program moves it: one movement at a time, begun by one thread.
//!
//! `servoj` is a model of its own, [`super::servo`]. The others follow their reference exactly: `movej` and `movel` with a
//! trapezoid of speed, from rest to rest (an arm in motion brakes first); `speedj` and `speedl` with the acceleration that is
//! asked for; `stopj` and `stopl` to rest. Blending (`r`) is not simulated: the arm comes to rest at each target.
//!
//! The speed slider slows all but stops: a program's second of motion then takes longer, also one of `servoj`, as the maker
//! describes it ("Trajectory improvements for servoj()": at 50 %, a `servoj` of 2 ms takes 4 ms).

mod readings;
mod trapezoid;

use super::servo::{Servo, ServoCommand, TargetRefused};
use nalgebra::Vector6;
use screed_kernel::arm::Arm;
use screed_kernel::ik::{Family, IkError};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, JointVel};
pub use trapezoid::Trapezoid;

/// A reference may ask for this much more than a joint's speed before the arm stops. A choice of this model.
const SPEED_MARGIN: f64 = 1.05;
/// How fast the arm's pace follows the speed slider (1/s). A choice of this model.
const PACE_CHANGE: f64 = 4.0;
/// A slower pace does not lengthen a call any more, so that a program goes on while the arm stands still. A choice of this model.
const PACE_LEAST: f64 = 0.01;
/// How long positions are kept for `get_actual_joint_positions_history` (cycles).
const HISTORY: usize = 2048;

/// A movement that the arm refuses: a protective stop.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MotionRefused {
    /// A target of `servoj`.
    #[error(transparent)]
    Target(#[from] TargetRefused),
    /// A place on a line that no joints reach.
    #[error("protective stop: the tool's path leaves what the arm can reach ({0:?})")]
    Unreachable(IkError),
    /// A path on which a joint would have to turn faster than it can.
    #[error("protective stop: joint {joint} would have to turn at {speed} rad/s, its limit is {speed_max} rad/s")]
    TooFast {
        /// Which joint (0 is the base).
        joint: usize,
        /// As needed (rad/s).
        speed: f64,
        /// The joint's limit (rad/s).
        speed_max: f64,
    },
    /// The program asked for it.
    #[error("protective stop: asked for by the program")]
    Asked,
}

/// Where a movement goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// `movej`: these joints (rad), all arriving at the same time.
    Joints([f64; 6]),
    /// `movel`: the tool in the base frame, along a line.
    Tool(Pose),
}

/// What a thread asks of the arm.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// `servoj`, until the cycle.
    Servo {
        /// The call.
        command: ServoCommand,
        /// First cycle in which it no longer holds.
        until: u64,
    },
    /// `movej` and `movel`: acceleration and speed of the leading joint (rad) or of the tool (m); a time above 0 overrides both.
    Move {
        /// Where to.
        goal: Goal,
        /// Acceleration (rad/s², m/s²).
        acceleration: f64,
        /// Speed (rad/s, m/s).
        speed: f64,
        /// Time for all of it (s), or 0.
        time: f64,
    },
    /// `speedj` and `speedl`.
    Speed {
        /// Speeds of the joints (rad/s), or of the tool (m/s, rad/s) in the base frame.
        target: [f64; 6],
        /// Whether the target is the tool's.
        of_tool: bool,
        /// Acceleration (rad/s², m/s²).
        acceleration: f64,
        /// First cycle in which it no longer holds; None: when the speed is reached.
        until: Option<u64>,
    },
    /// `stopj` and `stopl`.
    Stop {
        /// Deceleration (rad/s², m/s²).
        deceleration: f64,
        /// Whether it is the tool's.
        of_tool: bool,
    },
}

/// From where and how a [`Motion::Move`] goes, once the arm is at rest.
#[derive(Clone, Debug)]
struct Plan {
    from: JointPos<6>,
    base_from_start: Pose,
    profile: Trapezoid,
    elapsed: f64,
}

#[derive(Clone, Debug)]
struct Active {
    owner: u32,
    motion: Motion,
    plan: Option<Plan>,
    /// Joint speeds when a `Stop` began, and how long it takes (s).
    braking: Option<(JointVel<6>, f64, f64)>,
}

/// What is mounted on the flange.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Payload {
    /// Mass (kg).
    pub mass: f64,
    /// Its centre in the flange's frame (m).
    pub centre: [f64; 3],
    /// Its inertia as the controller lists it: xx, yy, zz, xy, xz, yz (kg·m²).
    pub inertia: [f64; 6],
}

/// The arm.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub arm: Arm<6>,
    family: Family,
    pub servo: Servo,
    speed_max: JointVel<6>,
    pub flange_from_tcp: Pose,
    pub payload: Payload,
    /// What gravity is opposed by, in the base frame (m/s²).
    pub gravity: [f64; 3],
    dt: f64,
    /// Seconds of a program's motion in a second, 0 to 1.
    pace: f64,
    /// Joints and their speeds a cycle ago.
    before: (JointPos<6>, JointVel<6>),
    latest: (JointPos<6>, JointVel<6>),
    active: Option<Active>,
    history: Vec<[f64; 6]>,
    newest: usize,
}

impl Body {
    pub(super) fn new(arm: Arm<6>, speed_max: JointVel<6>, start: JointPos<6>, flange_from_tcp: Pose, dt: f64) -> Self {
        Self {
            arm,
            family: Family::of(&arm),
            servo: Servo::new(speed_max, start, dt),
            speed_max,
            flange_from_tcp,
            payload: Payload::default(),
            gravity: [0.0, 0.0, 9.82],
            dt,
            pace: 1.0,
            before: (start, JointVel::ZERO),
            latest: (start, JointVel::ZERO),
            active: None,
            history: vec![start.0; HISTORY],
            newest: 0,
        }
    }

    /// One cycle nearer to where the speed slider stands, 0 to 1.
    pub(super) fn pace_towards(&mut self, slider: f64) {
        let step = PACE_CHANGE * self.dt;
        self.pace += (slider - self.pace).clamp(-step, step);
    }

    /// How long a call lasts that names this time (s).
    pub(super) fn stretched(&self, time: f64) -> f64 {
        time / self.pace.max(PACE_LEAST)
    }

    /// Takes a movement over, unless another thread's is going on.
    pub(super) fn begin(&mut self, owner: u32, motion: Motion) -> bool {
        if self.active.as_ref().is_some_and(|active| active.owner != owner) {
            return false;
        }
        if !matches!(motion, Motion::Servo { .. }) {
            self.servo.forget();
        }
        self.active = Some(Active { owner, motion, plan: None, braking: None });
        true
    }

    /// Whether the thread's movement goes on.
    pub(super) fn is_moving_for(&self, owner: u32) -> bool {
        self.active.as_ref().is_some_and(|active| active.owner == owner)
    }

    /// The thread has ended: what it began is over, and the arm brakes.
    pub(super) fn abandon(&mut self, owner: u32) {
        if self.is_moving_for(owner) {
            self.active = None;
        }
    }

    /// No thread moves the arm any more.
    pub(super) fn abandon_all(&mut self) {
        self.active = None;
    }

    /// Ends what holds for a time that is over; before the threads run.
    pub(super) fn expire(&mut self, cycle: u64) {
        let over = |motion: &Motion| match motion {
            Motion::Servo { until, .. } | Motion::Speed { until: Some(until), .. } => *until <= cycle,
            _ => false,
        };
        self.active.take_if(|active| over(&active.motion));
    }

    /// The program is held: the arm brakes, and a movement goes on from where it came to rest.
    pub(super) fn hold(&mut self) {
        if let Some(active) = &mut self.active {
            (active.plan, active.braking) = (None, None);
        }
        self.servo.stop();
        self.remember();
    }

    /// A protective stop.
    pub(super) fn freeze(&mut self) {
        self.servo.freeze();
        self.remember();
    }

    /// One cycle of movement.
    pub(super) fn step(&mut self) -> Result<(), MotionRefused> {
        let mut active = self.active.take();
        let result = match &mut active {
            None => self.servo.step(None, self.pace).map(|()| true).map_err(MotionRefused::from),
            Some(active) => self.follow(active),
        };
        self.remember();
        if result? {
            return Ok(());
        }
        self.active = active;
        Ok(())
    }

    /// Whether the movement is over.
    fn follow(&mut self, active: &mut Active) -> Result<bool, MotionRefused> {
        match &active.motion {
            Motion::Servo { command, .. } => {
                self.servo.step(Some(command.clone()), self.pace)?;
                Ok(false)
            }
            Motion::Move { goal, acceleration, speed, time } => {
                let (goal, limits) = (*goal, (*acceleration, *speed, *time));
                if active.plan.is_none() {
                    if !self.is_at_rest() {
                        self.servo.stop();
                        return Ok(false);
                    }
                    active.plan = Some(self.plan(&goal, limits));
                }
                let Some(plan) = &mut active.plan else { return Ok(true) };
                plan.elapsed += self.dt * self.pace;
                let (share, over) = plan.profile.share(plan.elapsed);
                let joints = match goal {
                    Goal::Joints(to) => between(&plan.from.0, &to, share),
                    Goal::Tool(to) => self.on_line(&plan.base_from_start, &to, share)?,
                };
                self.go_to(joints)?;
                if over {
                    self.servo.rest();
                }
                Ok(over)
            }
            Motion::Speed { target, of_tool, acceleration, until } => {
                let target = target.map(|speed| speed * self.pace);
                let (until, step) = (*until, *acceleration * self.dt);
                let next = if *of_tool {
                    self.joint_speeds(&towards(&self.tool_speed(), &target, step))?
                } else {
                    towards(&self.servo.qd.0, &target, step)
                };
                let mut joints = self.servo.q.0;
                for ((joint, now), next) in joints.iter_mut().zip(self.servo.qd.0).zip(next) {
                    *joint += 0.5 * (now + next) * self.dt;
                }
                let reached = if *of_tool { towards(&self.tool_speed(), &target, step) } else { next };
                self.go_to_with(joints, next)?;
                Ok(until.is_none() && reached == target)
            }
            Motion::Stop { deceleration, of_tool } => {
                let begun = *active.braking.get_or_insert_with(|| {
                    let time = if *of_tool { self.tool_braking_time(*deceleration) } else { 0.0 };
                    (self.servo.qd, time, 0.0)
                });
                if *of_tool && begun.1 > 0.0 {
                    let elapsed = begun.2 + self.dt;
                    active.braking = Some((begun.0, begun.1, elapsed));
                    let share = (1.0 - elapsed / begun.1).max(0.0);
                    let next = begun.0.0.map(|speed| speed * share);
                    let mut joints = self.servo.q.0;
                    for ((joint, now), next) in joints.iter_mut().zip(self.servo.qd.0).zip(next) {
                        *joint += 0.5 * (now + next) * self.dt;
                    }
                    self.go_to_with(joints, next)?;
                } else {
                    self.servo.brake(*deceleration);
                }
                Ok(self.is_at_rest())
            }
        }
    }

    fn plan(&self, goal: &Goal, (acceleration, speed, time): (f64, f64, f64)) -> Plan {
        let from = self.servo.q;
        let base_from_start = self.base_from_tcp();
        let distance = match goal {
            Goal::Joints(to) => from.0.iter().zip(to).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max),
            Goal::Tool(to) => {
                let along = (to.translation - base_from_start.translation).norm();
                let turn = turn_between(&base_from_start, to).norm();
                // A turn on the spot counts as metres, so that it takes time too.
                if along > 1e-6 { along } else { turn }
            }
        };
        // No joint faster than it can: the arm goes slower then, as on the teach pendant.
        let mut speed = speed;
        if let Goal::Joints(to) = goal {
            for ((from, to), limit) in from.0.iter().zip(to).zip(&self.speed_max.0) {
                let own = (to - from).abs();
                if own > 0.0 {
                    speed = speed.min(limit * distance / own);
                }
            }
        }
        let profile = Trapezoid::new(distance, acceleration, speed, time);
        Plan { from, base_from_start, profile, elapsed: 0.0 }
    }

    fn on_line(&self, from: &Pose, to: &Pose, share: f64) -> Result<[f64; 6], MotionRefused> {
        let turn = turn_between(from, to) * share;
        let turned = Pose::from_rotation_vector(from.translation, turn);
        let pose = Pose {
            rotation: turned.rotation * from.rotation,
            translation: from.translation + (to.translation - from.translation) * share,
        };
        self.inverse(&pose, &self.servo.q).map(|joints| joints.0).map_err(MotionRefused::Unreachable)
    }

    /// Joint speeds that move the tool so (m/s and rad/s in the base frame).
    fn joint_speeds(&self, tool: &[f64; 6]) -> Result<[f64; 6], MotionRefused> {
        let (base_from_flange, jacobian) = self.arm.jacobian(&self.servo.q);
        let tool = Vector6::from(*tool);
        let lever = (base_from_flange * self.flange_from_tcp).translation - base_from_flange.translation;
        let turning = nalgebra::Vector3::new(tool[3], tool[4], tool[5]);
        let at_flange = nalgebra::Vector3::new(tool[0], tool[1], tool[2]) - turning.cross(&lever);
        let wanted = Vector6::new(at_flange.x, at_flange.y, at_flange.z, turning.x, turning.y, turning.z);
        let speeds = jacobian.lu().solve(&wanted).unwrap_or(Vector6::repeat(f64::NAN));
        Ok(speeds.into())
    }

    /// Until the tool is at rest when it brakes so (s); never harder than the joints can.
    fn tool_braking_time(&self, deceleration: f64) -> f64 {
        let [x, y, z, ..] = self.tool_speed();
        let fastest = self.servo.qd.0.iter().fold(0.0, |fastest: f64, speed| fastest.max(speed.abs()));
        (nalgebra::Vector3::new(x, y, z).norm() / deceleration).max(fastest / super::servo::ACCELERATION_MAX)
    }

    fn go_to(&mut self, joints: [f64; 6]) -> Result<(), MotionRefused> {
        let mut speeds = [0.0; 6];
        for ((speed, to), from) in speeds.iter_mut().zip(joints).zip(self.servo.q.0) {
            *speed = (to - from) / self.dt;
        }
        self.go_to_with(joints, speeds)
    }

    fn go_to_with(&mut self, joints: [f64; 6], speeds: [f64; 6]) -> Result<(), MotionRefused> {
        for (joint, (&speed, &speed_max)) in speeds.iter().zip(&self.speed_max.0).enumerate() {
            // Written so that a speed that is not a number fails.
            let possible = speed.abs() <= speed_max * SPEED_MARGIN;
            if !possible {
                return Err(MotionRefused::TooFast { joint, speed, speed_max });
            }
        }
        self.servo.set(joints, speeds);
        Ok(())
    }

    fn is_at_rest(&self) -> bool {
        self.servo.qd.0.iter().all(|speed| *speed == 0.0)
    }

    /// Whether all joints stand still.
    pub(super) fn is_steady(&self) -> bool {
        self.is_at_rest() && self.active.is_none()
    }

    fn remember(&mut self) {
        self.before = self.latest;
        self.latest = (self.servo.q, self.servo.qd);
        self.newest = (self.newest + 1) % HISTORY;
        if let Some(place) = self.history.get_mut(self.newest) {
            *place = self.servo.q.0;
        }
    }

    /// The joints so many cycles ago; None beyond what is kept.
    pub(super) fn joints_before(&self, cycles: usize) -> Option<[f64; 6]> {
        if cycles >= HISTORY {
            return None;
        }
        self.history.get((self.newest + HISTORY - cycles) % HISTORY).copied()
    }

    /// The tool in the base frame.
    pub(super) fn base_from_tcp(&self) -> Pose {
        self.arm.forward(&self.servo.q) * self.flange_from_tcp
    }

    /// The target of the `servoj` that goes on (rad).
    #[cfg(test)]
    pub(super) fn servo_target(&self) -> Option<[f64; 6]> {
        match &self.active.as_ref()?.motion {
            Motion::Servo { command, .. } => Some(command.target),
            _ => None,
        }
    }

    /// Where the goal of the movement that goes on is, as joints.
    pub(super) fn waypoint(&self) -> Option<Goal> {
        match self.active.as_ref()?.motion {
            Motion::Move { goal, .. } => Some(goal),
            _ => None,
        }
    }

    /// Joints for a pose of the tool, nearest to the seed.
    pub(super) fn inverse(&self, base_from_tcp: &Pose, seed: &JointPos<6>) -> Result<JointPos<6>, IkError> {
        self.inverse_with(base_from_tcp, &self.flange_from_tcp, seed)
    }

    /// The same with another tool.
    pub(super) fn inverse_with(
        &self,
        base_from_tcp: &Pose,
        tool: &Pose,
        seed: &JointPos<6>,
    ) -> Result<JointPos<6>, IkError> {
        let base_from_flange = *base_from_tcp * tool.inverse();
        self.family.nearest(&self.arm, &base_from_flange, seed).map(|answer| answer.joints)
    }
}

/// The turn that takes one orientation to the other (rotation vector in the base frame, rad).
fn turn_between(from: &Pose, to: &Pose) -> nalgebra::Vector3<f64> {
    let turned = Pose { rotation: to.rotation * from.rotation.transpose(), ..Pose::identity() };
    turned.rotation_vector()
}

/// Each value a step nearer to its target.
fn towards(from: &[f64; 6], to: &[f64; 6], step: f64) -> [f64; 6] {
    let mut next = *to;
    for (next, from) in next.iter_mut().zip(from) {
        *next = from + (*next - from).clamp(-step, step);
    }
    next
}

fn between(from: &[f64; 6], to: &[f64; 6], share: f64) -> [f64; 6] {
    let mut joints = *from;
    for (joint, to) in joints.iter_mut().zip(to) {
        // Exact at the end.
        *joint = if share >= 1.0 { *to } else { *joint + (to - *joint) * share };
    }
    joints
}
