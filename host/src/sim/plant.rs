//! A plant to control: an arm with second-order drives, backlash and soft joints on a base that swings, drifts and steps, its
//! encoders, and a laser tracker. Seeded: the same parameters, seed and commands give the same bits.
//!
//! docs/plant.md says what is modelled and what is not, and from which ranges random plants are drawn.

mod base;
mod joint;
mod mode;
mod params;
mod random;
#[cfg(test)]
mod tests;
mod tracker;

use base::Base;
use joint::Joint;
use nalgebra::{Vector3, Vector6};
use random::Random;
use screed_kernel::arm::Jacobian;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, JointVel, Nanos};
use std::collections::VecDeque;
use tracker::Tracker;

pub use params::{BaseParams, JointParams, Kind, Params, RANGES, Range, TrackerParams};
pub use screed_kernel::base::Displacement;
pub use tracker::{ROTATION_DEVIATION, STAMP_ERROR, TRACKER_PERIOD_NS, Tracked, position_deviation};

/// Step of the simulation (ns).
pub const SUBSTEP_NS: u64 = 250_000;

/// The same (s).
const SUBSTEP: f64 = SUBSTEP_NS as f64 * 1e-9;

/// Standard gravity (m/s²).
const GRAVITY: f64 = 9.806_65;

/// What sensors say at the end of a control period.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// When.
    pub now: Nanos,
    /// Encoders (rad).
    pub joints: JointPos<6>,
    /// Joint rates (rad/s).
    pub rates: JointVel<6>,
    /// Poses that arrived in this period, the oldest first.
    pub poses: Vec<Tracked>,
}

/// What no sensor knows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Where the links are (rad).
    pub joints: JointPos<6>,
    /// Where the drives are (rad): what encoders would say without noise.
    pub motors: JointPos<6>,
    /// Where the base is.
    pub nominal_from_base: Pose,
    /// Where the tool's tip is.
    pub tracker_from_tcp: Pose,
}

/// The plant at one instant.
#[derive(Clone, Debug)]
pub struct Plant {
    params: Params,
    now: Nanos,
    joints: [Joint; 6],
    base: Base,
    tracker: Tracker,
    random: Random,
    /// Commands on their way, with the time from which they act.
    commands: VecDeque<(Nanos, JointPos<6>)>,
    reference: JointPos<6>,
    /// Of the flange in the base frame, a substep before (m/s).
    velocity: Vector3<f64>,
    /// Of the links, a substep before.
    jacobian: Jacobian<6>,
}

impl Plant {
    /// A plant drawn from [`RANGES`]: an NJ130-like one for an even seed, a UR10e-like one for an odd one.
    pub fn random(seed: u64) -> Self {
        let kind = if seed.is_multiple_of(2) { Kind::Nj130 } else { Kind::Ur10e };
        Self::new(&Params::random(kind, seed), seed)
    }

    /// At rest where the parameters say, the base where registration found it. The seed is that of all noise.
    pub fn new(params: &Params, seed: u64) -> Self {
        // Each part draws from a stream of its own.
        let [for_base, for_tracker, own] = [1, 2, 3].map(|part| Random::new(seed.wrapping_mul(4).wrapping_add(part)));
        let base = Base::new(&params.base, for_base);
        let weight = weight(params, &base.nominal_from_base());
        let mut links = params.start;
        // The weight's moments depend on how the joints give way to them.
        for _ in 0..20 {
            let moments = moments(&params.arm.jacobian(&links).1, &weight);
            links.0 = std::array::from_fn(|i| params.start.0[i] + params.joints[i].compliance * moments[i]);
        }
        let (base_from_flange, jacobian) = params.arm.jacobian(&links);
        let moments = moments(&jacobian, &weight);
        let joints = std::array::from_fn(|i| Joint::new(&params.joints[i], params.start.0[i], moments[i]));
        let target = params.tracker_from_nominal * base_from_flange * params.flange_from_target;
        Self {
            params: params.clone(),
            now: Nanos(0),
            joints,
            base,
            tracker: Tracker::new(&params.tracker, for_tracker, target),
            random: own,
            commands: VecDeque::new(),
            reference: params.start,
            velocity: Vector3::zeros(),
            jacobian,
        }
    }

    /// What it is made of.
    pub const fn params(&self) -> &Params {
        &self.params
    }

    /// Commands joint positions, and moves on by one control period.
    pub fn step(&mut self, command: &JointPos<6>) -> Measured {
        self.commands.push_back((self.now.plus(self.params.dead_time_ns), *command));
        for _ in 0..self.params.period_ns / SUBSTEP_NS {
            self.substep();
        }
        let Params { encoder_noise, encoder_quantum, rate_noise, .. } = self.params;
        let random = &mut self.random;
        let joints = self.joints.each_ref().map(|joint| {
            let noisy = joint.motor() + encoder_noise * random.normal();
            if encoder_quantum > 0.0 { libm::round(noisy / encoder_quantum) * encoder_quantum } else { noisy }
        });
        let rates = self.joints.each_ref().map(|joint| joint.motor_rate() + rate_noise * random.normal());
        Measured {
            now: self.now,
            joints: JointPos(joints),
            rates: JointVel(rates),
            poses: self.tracker.arrived(self.now),
        }
    }

    fn substep(&mut self) {
        while self.commands.front().is_some_and(|(from, _)| *from <= self.now)
            && let Some((_, reference)) = self.commands.pop_front()
        {
            self.reference = reference;
        }
        let weight = weight(&self.params, &self.base.nominal_from_base());
        let moments = moments(&self.jacobian, &weight);
        for ((joint, reference), moment) in self.joints.iter_mut().zip(&self.reference.0).zip(moments) {
            joint.step(*reference, moment);
        }
        let (base_from_flange, jacobian) = self.params.arm.jacobian(&self.links());
        self.jacobian = jacobian;
        let rates = Vector6::from(self.joints.each_ref().map(Joint::link_rate));
        let velocity = (jacobian * rates).fixed_rows::<3>(0).into_owned();
        let acceleration = (velocity - std::mem::replace(&mut self.velocity, velocity)) / SUBSTEP;
        self.base.step(&base_from_flange.translation, &acceleration, &weight);
        self.now = self.now.plus(SUBSTEP_NS);
        let target = self.tracker_from_base() * base_from_flange * self.params.flange_from_target;
        self.tracker.see(self.now, &target);
    }

    /// What no sensor knows, now.
    pub fn truth(&self) -> Truth {
        let joints = self.links();
        Truth {
            joints,
            motors: JointPos(self.joints.each_ref().map(Joint::motor)),
            nominal_from_base: self.base.nominal_from_base(),
            tracker_from_tcp: self.tracker_from_base() * self.params.arm.forward(&joints) * self.params.flange_from_tcp,
        }
    }

    /// Moves the place at which the base rests, at once; the base swings over to it.
    pub fn shift_base(&mut self, by: &Displacement) {
        self.base.shift(by);
    }

    fn links(&self) -> JointPos<6> {
        JointPos(self.joints.each_ref().map(Joint::link))
    }

    fn tracker_from_base(&self) -> Pose {
        self.params.tracker_from_nominal * self.base.nominal_from_base()
    }
}

/// The weight at the flange, in the base frame (N).
fn weight(params: &Params, nominal_from_base: &Pose) -> Vector3<f64> {
    let base_from_tracker = (params.tracker_from_nominal * *nominal_from_base).inverse();
    base_from_tracker.rotation * Vector3::new(0.0, 0.0, -GRAVITY * params.payload)
}

/// What the weight at the flange does to each joint (N·m): Jᵀ·force (Spong, Hutchinson, Vidyasagar, 4.10).
fn moments(jacobian: &Jacobian<6>, weight: &Vector3<f64>) -> [f64; 6] {
    std::array::from_fn(|i| jacobian.fixed_view::<3, 1>(0, i).dot(weight))
}
