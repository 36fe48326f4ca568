//! A base that moves exactly as the filter believes, or as a test says, under an arm that moves, and noisy sensors.

use super::Random;
use super::plant::N;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector3};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::base::estimate::Estimate;
use screed_kernel::base::swing::{Swing, SwingMode};
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
        swing: Swing::NONE,
        hold: 1.0,
        agreeing: 20,
        limits: LIMITS,
        period: 1e-3,
    }
}

/// The same on a base that swings.
pub fn swinging() -> BaseConfig {
    let mode = |(hertz, damping, deviation)| SwingMode { frequency: std::f64::consts::TAU * hertz, damping, deviation };
    let modes = [
        (1.6, 0.03, 2e-4),
        (2.4, 0.05, 1e-4),
        (3.7, 0.02, 5e-5),
        (2.7, 0.04, 1e-4),
        (4.1, 0.08, 5e-5),
        (5.6, 0.03, 2e-5),
    ];
    let swing = Swing { centre: Vector3::new(-0.3, 0.1, -0.8), modes: modes.map(mode) };
    BaseConfig { swing, ..config() }
}

pub struct Sim {
    pub config: BaseConfig,
    pub base: Base,
    pub random: Random,
    pub now: Nanos,
    /// Where the base rests, and its rates.
    pub truth: Displacement,
    pub rate: Displacement,
    /// How it swings about that: translation and rotation, and their rates.
    pub swing: [SVector<f64, 6>; 2],
    /// What a tick does to a swing and its rate, and √Q.
    swings: [(Matrix2<f64>, Matrix2<f64>); 6],
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
            swing: [SVector::zeros(); 2],
            swings: config.swing.modes.map(|mode| {
                let (turns, noise) = oscillator(&mode, config.period);
                (turns, noise.cholesky().map_or(Matrix2::zeros(), |root| root.l()))
            }),
            noise: 1.0,
            root: root(config.period, config.drift.time),
        }
    }

    /// The base's rates are any, and so is its swing.
    pub fn any_rate(&mut self) {
        for (axis, mode) in self.config.swing.modes.iter().enumerate() {
            self.swing[0][axis] = mode.deviation * self.random.normal();
            self.swing[1][axis] = mode.deviation * mode.frequency * self.random.normal();
        }
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
        for (axis, (turns, root)) in self.swings.iter().enumerate() {
            let state = turns * Vector2::new(self.swing[0][axis], self.swing[1][axis]);
            let state = state + root * Vector2::new(self.random.normal(), self.random.normal());
            (self.swing[0][axis], self.swing[1][axis]) = (state.x, state.y);
        }
    }

    /// Where the base is.
    fn nominal_from_base(&self) -> Pose {
        let [swing, _] = &self.swing;
        swung(&self.config, &self.truth, swing)
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
        let base = self.config.tracker_from_nominal * self.nominal_from_base();
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

    /// Error of an estimate as of now: place, its rates, swing, its rates, translation before rotation in each.
    pub fn error(&self, estimate: &Estimate) -> SVector<f64, 24> {
        assert_eq!(estimate.at(), self.now);
        let turn = |vector| Pose::from_rotation_vector(Vector3::zeros(), vector);
        let mut place = list(&self.truth) - list(estimate.place());
        let rotation = (turn(self.truth.rotation) * turn(estimate.place().rotation).inverse()).rotation_vector();
        place.fixed_rows_mut::<3>(3).copy_from(&rotation);
        let [swing, swing_rate] = &self.swing;
        let parts = [
            place,
            list(&self.rate) - list(estimate.rate()),
            swing - list(estimate.swing()),
            swing_rate - list(estimate.swing_rate()),
        ];
        SVector::from_fn(|row, _| parts[row / 6][row % 6])
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

/// exp(A·dt) of a swing by its series, and the noise of that time: ∫ exp(A·s)·g·gᵀ·exp(Aᵀ·s) ds by Simpson's rule, g being a
/// white acceleration with the density 4ζω³σ² that keeps a swing as large as σ.
pub fn oscillator(mode: &SwingMode, dt: f64) -> (Matrix2<f64>, Matrix2<f64>) {
    let SwingMode { frequency, damping, deviation } = *mode;
    let a = Matrix2::new(0.0, 1.0, -frequency * frequency, -2.0 * damping * frequency);
    let exponential = |time: f64| {
        let (mut sum, mut term) = (Matrix2::identity(), Matrix2::identity());
        for order in 1..40 {
            term = term * a * time / f64::from(order);
            sum += term;
        }
        sum
    };
    let (steps, mut q) = (200, Matrix2::zeros());
    for step in 0..=steps {
        let weight = if step == 0 || step == steps { 1.0 } else { 2.0 + 2.0 * f64::from(step % 2) };
        let reached = exponential(dt * f64::from(step) / f64::from(steps)).column(1).into_owned();
        q += reached * reached.transpose() * weight;
    }
    let density = 4.0 * damping * frequency.powi(3) * deviation * deviation;
    (exponential(dt), q * density * dt / f64::from(3 * steps))
}

/// Where a base is that swings: the swing's centre is shifted with the place of rest, its axes stay as they are.
fn swung(config: &BaseConfig, place: &Displacement, swing: &SVector<f64, 6>) -> Pose {
    let turn = Pose::from_rotation_vector(Vector3::zeros(), swing.fixed_rows::<3>(3).into_owned());
    let centre = config.swing.centre + place.translation;
    let swing = Pose { translation: centre - turn.rotation * centre + swing.fixed_rows::<3>(0), ..turn };
    swing * place.pose(&config.pivot)
}

pub fn list(displacement: &Displacement) -> SVector<f64, 6> {
    let Displacement { translation, rotation } = displacement;
    SVector::from_iterator(translation.iter().chain(rotation.iter()).copied())
}

/// P as one matrix.
pub fn matrix(estimate: &Estimate) -> SMatrix<f64, 24, 24> {
    let p = estimate.covariance();
    SMatrix::from_fn(|i, j| p.rows[i / 6][i % 6][j / 6][j % 6])
}

/// A 24-state filter without blocks, its update in Joseph's form.
pub struct Dense {
    pub x: SVector<f64, 24>,
    pub p: SMatrix<f64, 24, 24>,
}

impl Dense {
    /// Begins with an estimate.
    pub fn of(estimate: &Estimate) -> Self {
        let parts = [estimate.place(), estimate.rate(), estimate.swing(), estimate.swing_rate()].map(list);
        Self { x: SVector::from_fn(|row, _| parts[row / 6][row % 6]), p: matrix(estimate) }
    }

    /// Moves on by `dt` and takes a measurement, all by its own formulas; returns the normalised innovation squared.
    pub fn step(&mut self, config: &BaseConfig, dt: f64, measurement: &Measurement<N>) -> f64 {
        let Drift { speed, turn_rate, time } = config.drift;
        let (kept, [xx, xv, vv]) = ((-dt / time).exp(), integral(dt, time));
        let mut f = SMatrix::<f64, 24, 24>::identity();
        let mut q = SMatrix::<f64, 24, 24>::zeros();
        for k in 0..6 {
            let variance = if k < 3 { speed * speed } else { turn_rate * turn_rate };
            f[(k, k + 6)] = time * (1.0 - kept);
            f[(k + 6, k + 6)] = kept;
            q[(k, k)] = variance * xx;
            q[(k, k + 6)] = variance * xv;
            q[(k + 6, k)] = variance * xv;
            q[(k + 6, k + 6)] = variance * vv;
            let (turns, noise) = oscillator(&config.swing.modes[k], dt);
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                f[(k + 12 + 6 * i, k + 12 + 6 * j)] = turns[(i, j)];
                q[(k + 12 + 6 * i, k + 12 + 6 * j)] = noise[(i, j)];
            }
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
        let left = SMatrix::<f64, 24, 24>::identity() - k * h;
        self.p = left * self.p * left.transpose() + k * r * k.transpose();
        y.dot(&(inverse * y))
    }

    /// Innovation, H and R; H and the arm's part of R by central differences of what is expected.
    fn linear(
        &self,
        config: &BaseConfig,
        measurement: &Measurement<N>,
    ) -> (SVector<f64, 6>, SMatrix<f64, 6, 24>, SMatrix<f64, 6, 6>) {
        let expected = |beside: &SVector<f64, 24>, joints: &JointPos<N>| {
            let part =
                |row: usize| (self.x.fixed_rows::<3>(row).into_owned(), beside.fixed_rows::<3>(row).into_owned());
            let ((way, way_more), (turn, turn_more)) = (part(0), part(3));
            let place = Displacement { translation: way + way_more, rotation: turned(&turn_more, &turn) };
            let swing = self.x.fixed_rows::<6>(12) + beside.fixed_rows::<6>(12);
            swung(config, &place, &swing.into_owned()) * UR10E.forward(joints) * config.flange_from_target
        };
        let none = SVector::<f64, 24>::zeros();
        let here = expected(&none, &measurement.joints);
        let difference = |from: &Pose, to: &Pose| {
            let turn = Pose { rotation: to.rotation * from.rotation.transpose(), translation: Vector3::zeros() };
            let (p, r) = (to.translation - from.translation, turn.rotation_vector());
            SVector::<f64, 6>::new(p.x, p.y, p.z, r.x, r.y, r.z)
        };
        let measured = config.tracker_from_nominal.inverse() * measurement.tracker_from_target;
        let step = 1e-5;
        let mut h = SMatrix::<f64, 6, 24>::zeros();
        for k in (0..6).chain(12..18) {
            let mut way = none;
            way[k] = step;
            let [low, high] = [-way, way].map(|way| expected(&way, &measurement.joints));
            h.set_column(k, &(difference(&low, &high) / (2.0 * step)));
        }
        let (p, t) = (measurement.position_deviation, measurement.rotation_deviation);
        let mut r = SMatrix::<f64, 6, 6>::from_diagonal(&SVector::from([p * p, p * p, p * p, t * t, t * t, t * t]));
        for joint in 0..N {
            let beside = |by: f64| {
                let mut joints = measurement.joints;
                joints.0[joint] += by;
                expected(&none, &joints)
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
