//! The base on an elastic crane: six damped modes that the arm's motion drives, beside a place of rest that drifts and steps.

use super::SUBSTEP;
use super::mode::Mode;
use super::params::BaseParams;
use super::random::Random;
use nalgebra::Vector3;
use screed_kernel::base::Displacement;
use screed_kernel::pose::Pose;

/// Drift of rotation heads back beyond this (rad).
const TURN_RADIUS: f64 = 1e-3;

/// Time in which a drift takes up a new direction (s).
const EASE: f64 = 0.3;

/// Where it is, and where it will go.
#[derive(Clone, Debug)]
pub(super) struct Base {
    params: BaseParams,
    random: Random,
    /// Beside the place of rest: x, y, z and rotation vector.
    modes: [Mode; 6],
    place: Wander,
    turn: Wander,
    /// Until the drift changes, and until the next step (s).
    to_change: f64,
    to_step: f64,
    /// The weight's moment at first (N·m): registration has seen what that does.
    registered: Option<Vector3<f64>>,
}

/// A place of rest that moves.
#[derive(Clone, Debug)]
struct Wander {
    at: Vector3<f64>,
    rate: Vector3<f64>,
    heading: Vector3<f64>,
}

impl Wander {
    const fn new() -> Self {
        Self {
            at: Vector3::new(0.0, 0.0, 0.0),
            rate: Vector3::new(0.0, 0.0, 0.0),
            heading: Vector3::new(0.0, 0.0, 0.0),
        }
    }

    /// A new direction, or home when it is beyond `radius`.
    fn turn(&mut self, random: &mut Random, radius: f64) {
        let away = random.direction();
        self.heading = if self.at.norm() > radius { -self.at.normalize() } else { away };
    }

    /// One substep; returns its acceleration.
    fn step(&mut self, speed: f64) -> Vector3<f64> {
        let acceleration = (self.heading * speed - self.rate) / EASE;
        self.at += self.rate * SUBSTEP + acceleration * (0.5 * SUBSTEP * SUBSTEP);
        self.rate += acceleration * SUBSTEP;
        acceleration
    }
}

impl Base {
    pub fn new(params: &BaseParams, mut random: Random) -> Self {
        let modes = params.frequency.map(|frequency| Mode::at(frequency, params.damping, 0.0));
        let to_step = random.wait(params.step_interval);
        Self {
            params: *params,
            random,
            modes,
            place: Wander::new(),
            turn: Wander::new(),
            to_change: 0.0,
            to_step,
            registered: None,
        }
    }

    /// One substep: the flange is there, has this acceleration (mean over it), and this weight hangs on it, all in the base frame.
    pub fn step(&mut self, flange: &Vector3<f64>, acceleration: &Vector3<f64>, weight: &Vector3<f64>) {
        self.wander();
        let inertia = self.params.mass * self.params.gyration * self.params.gyration;
        let reaction = acceleration * -self.params.reaction_mass;
        let hanging = flange.cross(weight);
        let moment = flange.cross(&reaction) + hanging - *self.registered.get_or_insert(hanging);
        let place = self.place.step(self.params.drift_speed);
        let turn = self.turn.step(self.params.turn_speed);
        let along = reaction / self.params.mass - place;
        let about = moment / inertia - turn;
        for (mode, force) in self.modes.iter_mut().zip(along.iter().chain(about.iter())) {
            mode.step(*force);
        }
    }

    fn wander(&mut self) {
        self.to_change -= SUBSTEP;
        if self.to_change <= 0.0 {
            self.to_change = self.params.drift_time;
            self.place.turn(&mut self.random, self.params.drift_radius);
            self.turn.turn(&mut self.random, TURN_RADIUS);
        }
        self.to_step -= SUBSTEP;
        if self.to_step <= 0.0 {
            self.to_step = self.random.wait(self.params.step_interval);
            let way = self.random.direction() * self.params.step_size;
            self.shift(&Displacement { translation: way, rotation: Vector3::zeros() });
        }
    }

    /// The place of rest jumps; the base swings over to it.
    pub fn shift(&mut self, by: &Displacement) {
        self.place.at += by.translation;
        self.turn.at += by.rotation;
        for (mode, by) in self.modes.iter_mut().zip(by.translation.iter().chain(by.rotation.iter())) {
            mode.value -= by;
        }
    }

    /// Of the base's origin.
    pub fn displacement(&self) -> Displacement {
        let [x, y, z, a, b, c] = &self.modes;
        Displacement {
            translation: self.place.at + Vector3::new(x.value, y.value, z.value),
            rotation: self.turn.at + Vector3::new(a.value, b.value, c.value),
        }
    }

    pub fn nominal_from_base(&self) -> Pose {
        self.displacement().pose(&Vector3::zeros())
    }
}
