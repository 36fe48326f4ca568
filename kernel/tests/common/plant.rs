//! An arm that moves exactly as the filter believes, and noisy sensors: what a filter's own statistics can be held against.

use super::Random;
use nalgebra::{Matrix3, Vector3};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::ekf::{Ekf, State};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};

pub const N: usize = 6;

/// Standard deviations of what is measured.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// m
    pub position: f64,
    /// rad
    pub rotation: f64,
    /// rad/s
    pub rates: f64,
    /// rad
    pub encoders: f64,
}

/// A laser tracker, 25 µm and 0.01°, and a controller's rates.
pub const TRACKER: Noise = Noise { position: 25e-6, rotation: 1.745e-4, rates: 1e-3, encoders: 1e-4 };

/// What the paper added to its simulated measurements: 0.10 m an axis, 0.05 per quaternion component (half a rotation vector).
pub const PAPER: Noise = Noise { position: 0.1, rotation: 0.1, rates: 0.1, encoders: 0.05 };

impl Random {
    /// Normal, mean 0 and standard deviation 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.between(0.0, 1.0)).ln()).sqrt();
        radius * self.between(0.0, std::f64::consts::TAU).cos()
    }

    pub fn normals<const K: usize>(&mut self, deviation: f64) -> [f64; K] {
        [(); K].map(|()| deviation * self.normal())
    }
}

/// Where the joints rest on average (rad).
const CENTRE: [f64; N] = [0.0, -1.2, 1.4, -0.8, 1.2, 0.0];
/// Pulls the joints back there: all three poles of the triple integrator (rad/s).
const POLE: f64 = 2.0;
/// Density of the white jerk (rad²/s⁵); the joints then stray by 0.24 rad, √(3/16·q̃/POLE⁵).
pub const DENSITY: [f64; N] = [10.0; N];

/// How uncertain the filters here are at first.
pub fn deviation(noise: &Noise) -> State<N> {
    let position = if noise.position < 1e-3 { 1e-3 } else { 0.1 };
    State { position: JointPos([position; N]), velocity: JointVel([0.3; N]), acceleration: JointAcc([0.5; N]) }
}

#[derive(Clone)]
pub struct Plant {
    pub truth: State<N>,
    pub random: Random,
    pub noise: Noise,
    pub dt: f64,
    /// Root of the covariance of what a step's white jerk does to a joint.
    root: Matrix3<f64>,
    tracker_from_base: Pose,
    flange_from_target: Pose,
}

impl Plant {
    pub fn new(seed: u64, noise: Noise, dt: f64) -> Self {
        let q = Matrix3::new(
            dt.powi(5) / 20.0,
            dt.powi(4) / 8.0,
            dt.powi(3) / 6.0,
            dt.powi(4) / 8.0,
            dt.powi(3) / 3.0,
            dt.powi(2) / 2.0,
            dt.powi(3) / 6.0,
            dt.powi(2) / 2.0,
            dt,
        );
        // Of the matrix scaled to a unit step, which is better conditioned.
        let scale = Matrix3::from_diagonal(&Vector3::new(dt * dt, dt, 1.0));
        let unit = scale.try_inverse().unwrap();
        let root = scale * (unit * q * unit / dt).cholesky().unwrap().l() * dt.sqrt();
        Self {
            truth: State::at_rest(JointPos(CENTRE)),
            random: Random(seed),
            noise,
            dt,
            root,
            tracker_from_base: Pose::from_roll_pitch_yaw(Vector3::new(3.0, -1.0, 0.5), 0.2, -0.1, 2.5),
            flange_from_target: Pose::from_roll_pitch_yaw(Vector3::new(0.05, 0.02, 0.1), 0.3, 0.0, 1.0),
        }
    }

    /// A filter that knows the plant, and begins as far from the truth as it believes.
    pub fn filter(&mut self) -> Ekf<N> {
        let deviation = deviation(&self.noise);
        let mut state = self.truth;
        for i in 0..N {
            state.position.0[i] += deviation.position.0[i] * self.random.normal();
            state.velocity.0[i] += deviation.velocity.0[i] * self.random.normal();
            state.acceleration.0[i] += deviation.acceleration.0[i] * self.random.normal();
        }
        Ekf::new(state, &deviation, &DENSITY).unwrap()
    }

    /// Moves on by a step and returns the jerk that was commanded for it.
    pub fn step(&mut self) -> JointJerk<N> {
        let State { position, velocity, acceleration } = self.truth;
        let jerk: [f64; N] = core::array::from_fn(|i| {
            let (q, v, a) = (position.0[i] - CENTRE[i], velocity.0[i], acceleration.0[i]);
            -POLE * (POLE * (POLE * q + 3.0 * v) + 3.0 * a)
        });
        let jerk = JointJerk(jerk);
        self.truth = self.truth.after(self.dt, &jerk);
        for (i, density) in DENSITY.iter().enumerate() {
            let w = self.root * Vector3::from(self.random.normals(density.sqrt()));
            self.truth.position.0[i] += w[0];
            self.truth.velocity.0[i] += w[1];
            self.truth.acceleration.0[i] += w[2];
        }
        jerk
    }

    pub fn pose(&mut self) -> TrackedPose {
        let Noise { position, rotation, .. } = self.noise;
        let truth = self.tracker_from_base * UR10E.forward(&self.truth.position) * self.flange_from_target;
        let place = Vector3::from(self.random.normals(position));
        let turn = Pose::from_rotation_vector(place, Vector3::from(self.random.normals(rotation)));
        TrackedPose {
            tracker_from_target: Pose {
                rotation: turn.rotation * truth.rotation,
                translation: truth.translation + place,
            },
            tracker_from_base: self.tracker_from_base,
            flange_from_target: self.flange_from_target,
            position_deviation: position,
            rotation_deviation: rotation,
        }
    }

    pub fn rates(&mut self) -> (JointVel<N>, JointVel<N>) {
        let deviation = self.noise.rates;
        (JointVel(self.truth.velocity.0.map(|v| v + deviation * self.random.normal())), JointVel([deviation; N]))
    }

    pub fn encoders(&mut self) -> (JointPos<N>, JointPos<N>) {
        let deviation = self.noise.encoders;
        (JointPos(self.truth.position.0.map(|q| q + deviation * self.random.normal())), JointPos([deviation; N]))
    }
}
