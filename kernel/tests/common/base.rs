//! A base that moves exactly as the filter believes, or as a test says, under an arm that moves, and noisy sensors.

use super::Random;
use super::plant::N;
use nalgebra::{SMatrix, SVector, Vector3};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::base::estimate::Estimate;
use screed_kernel::base::{Base, BaseConfig, BaseLimits, Displacement, Drift, Measurement};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};

/// Deviations of a tracker a few metres away (m, rad), and of a joint (rad).
pub const PLACE: f64 = 25e-6;
pub const TURN: f64 = 1.745e-4;
pub const JOINT: f64 = 2e-5;

pub const LIMITS: BaseLimits = BaseLimits {
    translation_max: 0.02,
    velocity_max: 0.01,
    acceleration_max: 0.2,
    rotation_max: 0.01,
    turn_rate_max: 0.005,
    turn_acceleration_max: 0.1,
};

pub const DRIFT: Drift = Drift { speed: 3e-3, turn_rate: 2e-4, time: 2.0 };

/// Ticks and measurements each millisecond.
pub fn config() -> BaseConfig {
    BaseConfig {
        tracker_from_nominal: Pose::from_roll_pitch_yaw(Vector3::new(3.0, -1.0, 0.5), 0.2, -0.1, 2.5),
        flange_from_target: Pose::from_roll_pitch_yaw(Vector3::new(0.05, 0.02, 0.1), 0.3, 0.0, 1.0),
        pivot: Vector3::new(0.7, -0.2, 0.4),
        drift: DRIFT,
        hold: 1.0,
        agreeing: 20,
        limits: LIMITS,
        period: 1e-3,
    }
}

pub struct Sim {
    pub config: BaseConfig,
    pub base: Base,
    pub random: Random,
    pub now: Nanos,
    /// Where the base is, and its rates.
    pub truth: Displacement,
    pub rate: Displacement,
    /// Noise is that times what the measurement says of itself.
    pub noise: f64,
    /// What a tick does to a displacement and its rate with rates of deviation 1: √Q, lower triangle.
    root: [f64; 3],
}

impl Sim {
    pub fn new(seed: u64, config: BaseConfig) -> Self {
        Self {
            config,
            base: Base::new(&config).unwrap(),
            random: Random(seed),
            now: Nanos(0),
            truth: Displacement::zero(),
            rate: Displacement::zero(),
            noise: 1.0,
            root: root(config.period, config.drift.time),
        }
    }

    /// The base's rates are any.
    pub fn any_rate(&mut self) {
        let Drift { speed, turn_rate, .. } = self.config.drift;
        self.rate.translation = Vector3::from(self.random.normals(speed));
        self.rate.rotation = Vector3::from(self.random.normals(turn_rate));
    }

    /// One period, the base at the rate it has.
    pub fn steady(&mut self) {
        self.now = self.now.plus(1_000_000);
        self.move_on(self.config.period);
    }

    fn move_on(&mut self, dt: f64) {
        self.truth.translation += self.rate.translation * dt;
        let turn = |vector| Pose::from_rotation_vector(Vector3::zeros(), vector);
        self.truth.rotation = (turn(self.rate.rotation * dt) * turn(self.truth.rotation)).rotation_vector();
    }

    /// One period, the base as the filter believes.
    pub fn wander(&mut self) {
        self.now = self.now.plus(1_000_000);
        let Drift { speed, turn_rate, time } = self.config.drift;
        let kept = (-self.config.period / time).exp();
        self.move_on(time * (1.0 - kept));
        let [xx, xv, vv] = self.root;
        for (way, rate, deviation) in [
            (&mut self.truth.translation, &mut self.rate.translation, speed),
            (&mut self.truth.rotation, &mut self.rate.rotation, turn_rate),
        ] {
            for axis in 0..3 {
                let (first, second) = (deviation * self.random.normal(), deviation * self.random.normal());
                way[axis] += xx * first;
                rate[axis] = kept * rate[axis] + xv * first + vv * second;
            }
        }
    }

    /// Where the arm is: it never rests.
    pub fn joints(&self) -> JointPos<N> {
        let t = self.now.0 as f64 * 1e-9;
        JointPos(core::array::from_fn(|i| {
            [0.0, -1.2, 1.4, -0.8, 1.2, 0.0][i] + 0.2 * (t * (0.5 + 0.1 * i as f64) + i as f64).sin()
        }))
    }

    /// What the tracker and the encoders say now.
    pub fn measurement(&mut self) -> Measurement<N> {
        let joints = self.joints();
        let base = self.config.tracker_from_nominal * self.truth.pose(&self.config.pivot);
        let truth = base * UR10E.forward(&joints) * self.config.flange_from_target;
        let place = Vector3::from(self.random.normals(self.noise * PLACE));
        let turn = Vector3::from(self.random.normals(self.noise * TURN));
        let off = Pose::from_rotation_vector(Vector3::zeros(), turn);
        let noise = self.random.normals::<N>(self.noise * JOINT);
        Measurement {
            at: self.now,
            tracker_from_target: Pose {
                rotation: off.rotation * truth.rotation,
                translation: truth.translation + place,
            },
            position_deviation: PLACE,
            rotation_deviation: TURN,
            joints: JointPos(core::array::from_fn(|i| joints.0[i] + noise[i])),
            joint_deviation: JointPos([JOINT; N]),
        }
    }

    /// Error of an estimate as of now: translation, rotation, their rates.
    pub fn error(&self, estimate: &Estimate) -> SVector<f64, 12> {
        assert_eq!(estimate.at(), self.now);
        let (found, rate) = (estimate.displacement(), estimate.rate());
        let turn = |vector| Pose::from_rotation_vector(Vector3::zeros(), vector);
        let rotation = (turn(self.truth.rotation) * turn(found.rotation).inverse()).rotation_vector();
        let mut error = SVector::<f64, 12>::zeros();
        for (k, part) in [
            self.truth.translation - found.translation,
            rotation,
            self.rate.translation - rate.translation,
            self.rate.rotation - rate.rotation,
        ]
        .iter()
        .enumerate()
        {
            error.fixed_rows_mut::<3>(3 * k).copy_from(part);
        }
        error
    }

    /// How far the correction puts the flange wrong (m).
    pub fn flange_off(&self) -> f64 {
        let flange = UR10E.forward(&self.joints()).translation;
        let out = self.base.output().nominal_from_base.transform_point(&flange);
        (self.truth.pose(&self.config.pivot).transform_point(&flange) - out).norm()
    }

    /// How far the correction puts the pivot and the rotation wrong (m, rad).
    pub fn off(&self) -> [f64; 2] {
        let out = self.base.output().displacement;
        [(self.truth.translation - out.translation).norm(), (self.truth.rotation - out.rotation).norm()]
    }
}

/// √Q of a rate with deviation 1, from an integral by Simpson's rule: Q = ∫ g·gᵀ·2/τ ds, g(s) = \[τ(1 − e^(−s/τ)), e^(−s/τ)\].
fn root(dt: f64, time: f64) -> [f64; 3] {
    let q = integral(dt, time);
    let xx = q[0].sqrt();
    let xv = q[1] / xx;
    [xx, xv, (q[2] - xv * xv).sqrt()]
}

/// Q itself: xx, xv, vv.
pub fn integral(dt: f64, time: f64) -> [f64; 3] {
    let steps = 200;
    let mut q = [0.0; 3];
    for step in 0..=steps {
        let s = dt * f64::from(step) / f64::from(steps);
        let weight = match step {
            0 => 1.0,
            _ if step == steps => 1.0,
            _ if step % 2 == 1 => 4.0,
            _ => 2.0,
        };
        let (x, v) = (-time * (-s / time).exp_m1(), (-s / time).exp());
        for (sum, value) in q.iter_mut().zip([x * x, x * v, v * v]) {
            *sum += weight * value * 2.0 / time * dt / f64::from(3 * steps);
        }
    }
    q
}

/// P as one matrix.
pub fn matrix(estimate: &Estimate) -> SMatrix<f64, 12, 12> {
    let p = estimate.covariance();
    SMatrix::from_fn(|i, j| match (i / 6, j / 6) {
        (0, 0) => p.xx[i][j],
        (0, 1) => p.xv[i][j - 6],
        (1, 0) => p.xv[j][i - 6],
        _ => p.vv[i - 6][j - 6],
    })
}

/// A 12-state filter without blocks, its update in Joseph's form.
pub struct Dense {
    pub x: SVector<f64, 12>,
    pub p: SMatrix<f64, 12, 12>,
}

impl Dense {
    /// Moves on by `dt` and takes a measurement, all by its own formulas; returns the normalised innovation squared.
    pub fn step(&mut self, config: &BaseConfig, dt: f64, measurement: &Measurement<N>) -> f64 {
        let Drift { speed, turn_rate, time } = config.drift;
        let (kept, [xx, xv, vv]) = ((-dt / time).exp(), integral(dt, time));
        let mut f = SMatrix::<f64, 12, 12>::identity();
        let mut q = SMatrix::<f64, 12, 12>::zeros();
        for k in 0..6 {
            let variance = if k < 3 { speed * speed } else { turn_rate * turn_rate };
            f[(k, k + 6)] = time * (1.0 - kept);
            f[(k + 6, k + 6)] = kept;
            q[(k, k)] = variance * xx;
            q[(k, k + 6)] = variance * xv;
            q[(k + 6, k)] = variance * xv;
            q[(k + 6, k + 6)] = variance * vv;
        }
        let rate: Vector3<f64> = self.x.fixed_rows::<3>(9).into_owned() * (time * (1.0 - kept));
        let predicted = turned(&rate, &self.x.fixed_rows::<3>(3).into_owned());
        self.x = f * self.x;
        self.x.fixed_rows_mut::<3>(3).copy_from(&predicted);
        self.p = f * self.p * f.transpose() + q;
        let (y, h, r) = self.linear(config, measurement);
        let s = h * self.p * h.transpose() + r;
        let inverse = s.try_inverse().unwrap();
        let k = self.p * h.transpose() * inverse;
        let step = k * y;
        let corrected = turned(&step.fixed_rows::<3>(3).into_owned(), &predicted);
        self.x += step;
        self.x.fixed_rows_mut::<3>(3).copy_from(&corrected);
        let left = SMatrix::<f64, 12, 12>::identity() - k * h;
        self.p = left * self.p * left.transpose() + k * r * k.transpose();
        y.dot(&(inverse * y))
    }

    /// Innovation, H and R; H and the arm's part of R by central differences of what is expected.
    fn linear(
        &self,
        config: &BaseConfig,
        measurement: &Measurement<N>,
    ) -> (SVector<f64, 6>, SMatrix<f64, 6, 12>, SMatrix<f64, 6, 6>) {
        let expected = |way: Vector3<f64>, turn: Vector3<f64>, joints: &JointPos<N>| {
            let rotation = turned(&turn, &self.x.fixed_rows::<3>(3).into_owned());
            let displacement = Displacement { translation: self.x.fixed_rows::<3>(0) + way, rotation };
            displacement.pose(&config.pivot) * UR10E.forward(joints) * config.flange_from_target
        };
        let none = Vector3::zeros();
        let here = expected(none, none, &measurement.joints);
        let difference = |from: &Pose, to: &Pose| {
            let turn = Pose { rotation: to.rotation * from.rotation.transpose(), translation: none };
            let (p, r) = (to.translation - from.translation, turn.rotation_vector());
            SVector::<f64, 6>::new(p.x, p.y, p.z, r.x, r.y, r.z)
        };
        let measured = config.tracker_from_nominal.inverse() * measurement.tracker_from_target;
        let step = 1e-5;
        let mut h = SMatrix::<f64, 6, 12>::zeros();
        for k in 0..3 {
            let mut way = none;
            way[k] = step;
            let column = |low: Pose, high: Pose| difference(&low, &high) / (2.0 * step);
            let j = &measurement.joints;
            h.set_column(k, &column(expected(-way, none, j), expected(way, none, j)));
            h.set_column(k + 3, &column(expected(none, -way, j), expected(none, way, j)));
        }
        let (p, t) = (measurement.position_deviation, measurement.rotation_deviation);
        let mut r = SMatrix::<f64, 6, 6>::from_diagonal(&SVector::from([p * p, p * p, p * p, t * t, t * t, t * t]));
        for joint in 0..N {
            let beside = |by: f64| {
                let mut joints = measurement.joints;
                joints.0[joint] += by;
                expected(none, none, &joints)
            };
            let column =
                difference(&beside(-step), &beside(step)) / (2.0 * step) * measurement.joint_deviation.0[joint];
            r += column * column.transpose();
        }
        (difference(&here, &measured), h, r)
    }
}

fn turned(by: &Vector3<f64>, rotation: &Vector3<f64>) -> Vector3<f64> {
    let turn = |vector| Pose::from_rotation_vector(Vector3::zeros(), vector);
    (turn(*by) * turn(*rotation)).rotation_vector()
}
