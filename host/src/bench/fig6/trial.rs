//! One run: the arm moves, its pose is measured badly, the kernel's filter follows, and a smoother goes back.

use super::{Case, Fig6Error, N, SetUp};
use nalgebra::{SMatrix, SVector, Vector3};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::ekf::{Ekf, EkfError, State};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};
use screed_tape::random::Random;
use std::f64::consts::TAU;

const X: usize = 3 * N;
type Vector = SVector<f64, X>;
type Matrix = SMatrix<f64, X, X>;

/// The filter's own statistics are looked at so often (s).
const LOOK: f64 = 0.04;

/// One tick.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// s
    pub time: f64,
    /// The flange in the base frame.
    pub truth: Pose,
    /// What was measured, if it was.
    pub raw: Option<Pose>,
    /// By the filter.
    pub filtered: Pose,
    /// By the smoother.
    pub smoothed: Pose,
    /// How the error compares with what the filter believes, now and then.
    pub consistency: Option<Consistency>,
}

/// Of the filter's state at one tick.
#[derive(Clone, Copy, Debug)]
pub struct Consistency {
    /// Normalised estimation error squared, 3·N degrees of freedom.
    pub nees: f64,
    /// That of the flange's place, 3 degrees of freedom.
    pub nees_place: f64,
    /// How many joint positions are inside three standard deviations.
    pub inside: usize,
}

/// Runs a case with one seed.
///
/// # Errors
/// [`Fig6Error::Filter`]
pub fn run(set_up: &SetUp, case: &Case, seed: u64) -> Result<Vec<Sample>, Fig6Error> {
    let mut random = Random(seed);
    let phases = [(); N].map(|()| [(); 3].map(|()| random.between(0.0, TAU)));
    let dt = 1e-3 * case.period_ms;
    let ticks = (set_up.duration_s / dt).round() as usize;
    let looks = (LOOK / dt).round().max(1.0) as usize;
    let mut ekf = start(set_up, case, &motion(set_up, &phases, 0.0), &mut random)?;
    let mut samples = Vec::with_capacity(ticks);
    let mut filters = Vec::with_capacity(ticks);
    for tick in 1..=ticks {
        let time = tick as f64 * dt;
        let state = motion(set_up, &phases, time);
        let truth = UR10E.forward(&state.position);
        let refused = |what| move |error: EkfError| Fig6Error::Filter { what, time, error };
        ekf.predict(dt, &JointJerk::ZERO).map_err(refused("a step"))?;
        let measured = noisy(set_up, &truth, &mut random);
        let raw = (random.between(0.0, 1.0) >= set_up.noise.missing).then_some(measured);
        if let Some(pose) = raw {
            ekf.pose_iterated(&UR10E, &tracked(set_up, pose)).map_err(refused("a pose"))?;
        }
        if let Some(deviation) = case.rate_deviation_rad_s {
            let rates = state.velocity.0.map(|rate| rate + deviation * normal(&mut random));
            ekf.rates(&JointVel(rates), &JointVel([deviation; N])).map_err(refused("rates"))?;
        }
        let filtered = UR10E.forward(&ekf.state().position);
        let consistency = if tick % looks == 0 {
            Some(consistency(&state, &ekf).ok_or(EkfError::Unsound).map_err(refused("its covariance"))?)
        } else {
            None
        };
        samples.push(Sample { time, truth, raw, filtered, smoothed: filtered, consistency });
        filters.push(ekf);
    }
    let end = ticks as f64 * dt;
    smooth(&filters, dt, &mut samples).map_err(|error| Fig6Error::Filter { what: "smoothing", time: end, error })?;
    Ok(samples)
}

/// The true joints.
fn motion(set_up: &SetUp, phases: &[[f64; 3]; N], time: f64) -> State<N> {
    let mut state = State::at_rest(JointPos(set_up.centre_rad));
    for (joint, phases) in phases.iter().enumerate() {
        let waves = set_up.amplitude_rad[joint].iter().zip(&set_up.frequency_hz[joint]).zip(phases);
        for ((amplitude, frequency), phase) in waves {
            let speed = TAU * frequency;
            let (sin, cos) = (speed * time + phase).sin_cos();
            state.position.0[joint] += amplitude * sin;
            state.velocity.0[joint] += amplitude * speed * cos;
            state.acceleration.0[joint] -= amplitude * speed * speed * sin;
        }
    }
    state
}

/// Of the white jerk that the filter believes in (rad²/s⁵): the mean square of the joint's true jerk over all phases, times the case's
/// time.
fn jerk_density(set_up: &SetUp, case: &Case) -> [f64; N] {
    core::array::from_fn(|joint| {
        let waves = set_up.amplitude_rad[joint].iter().zip(&set_up.frequency_hz[joint]);
        let squares = waves.map(|(amplitude, frequency)| 0.5 * (amplitude * (TAU * frequency).powi(3)).powi(2));
        case.jerk_time_s * squares.sum::<f64>()
    })
}

fn start(set_up: &SetUp, case: &Case, truth: &State<N>, random: &mut Random) -> Result<Ekf<N>, Fig6Error> {
    let start = &set_up.start;
    let deviation = State {
        position: JointPos([start.position_rad; N]),
        velocity: JointVel([start.velocity_rad_s; N]),
        acceleration: JointAcc([start.acceleration_rad_s2; N]),
    };
    let joints = truth.position.0.map(|joint| joint + start.position_rad * normal(random));
    Ekf::new(State::at_rest(JointPos(joints)), &deviation, &jerk_density(set_up, case))
        .map_err(|error| Fig6Error::Filter { what: "its start", time: 0.0, error })
}

/// The paper's noise: added to each coordinate, and to each component of the quaternion, which is then normalised.
fn noisy(set_up: &SetUp, truth: &Pose, random: &mut Random) -> Pose {
    let noise = &set_up.noise;
    let place = Vector3::from_fn(|_, _| noise.position_m * normal(random));
    let vector = truth.rotation_vector();
    let angle = vector.norm();
    let (sin, cos) = (0.5 * angle).sin_cos();
    let axis = if angle > 0.0 { vector / angle } else { Vector3::zeros() };
    let real = cos + noise.quaternion * normal(random);
    let imaginary = axis * sin + Vector3::from_fn(|_, _| noise.quaternion * normal(random));
    let sine = imaginary.norm();
    let turn = if sine > 0.0 { imaginary * (2.0 * sine.atan2(real) / sine) } else { Vector3::zeros() };
    Pose::from_rotation_vector(truth.translation + place, turn)
}

/// As the filter takes it. A quaternion's component is half of the rotation vector's.
fn tracked(set_up: &SetUp, pose: Pose) -> TrackedPose {
    TrackedPose {
        tracker_from_target: pose,
        tracker_from_base: Pose::identity(),
        flange_from_target: Pose::identity(),
        position_deviation: set_up.noise.position_m,
        rotation_deviation: 2.0 * set_up.noise.quaternion,
    }
}

/// Normal, mean 0 and standard deviation 1 (Box and Muller 1958).
fn normal(random: &mut Random) -> f64 {
    let radius = (-2.0 * (1.0 - random.between(0.0, 1.0)).ln()).sqrt();
    radius * random.between(0.0, TAU).cos()
}

fn stack(state: &State<N>) -> Vector {
    Vector::from_iterator(state.position.0.into_iter().chain(state.velocity.0).chain(state.acceleration.0))
}

fn matrix(ekf: &Ekf<N>) -> Matrix {
    // All indices are inside.
    Matrix::from_fn(|row, column| ekf.covariance().get(row, column).unwrap_or(f64::NAN))
}

fn consistency(truth: &State<N>, ekf: &Ekf<N>) -> Option<Consistency> {
    let (error, p) = (stack(truth) - stack(ekf.state()), matrix(ekf));
    let nees = error.dot(&p.cholesky()?.solve(&error));
    let (flange, jacobian) = UR10E.jacobian(&ekf.state().position);
    let off = UR10E.forward(&truth.position).translation - flange.translation;
    let linear = jacobian.fixed_rows::<3>(0);
    let spread = linear * p.fixed_view::<N, N>(0, 0) * linear.transpose();
    let nees_place = off.dot(&spread.cholesky()?.solve(&off));
    let inside = (0..N).filter(|&i| error[i].abs() <= 3.0 * p[(i, i)].sqrt()).count();
    Some(Consistency { nees, nees_place, inside })
}

/// Goes back from the last estimate: x̂ₖ ← x̂ₖ + Pₖ·Fᵀ·P⁻¹(k+1|k)·(x̂ₖ₊₁ − x̂(k+1|k)) (Rauch, Tung, Striebel, "Maximum likelihood estimates
/// of linear dynamic systems", 1965).
fn smooth(filters: &[Ekf<N>], dt: f64, samples: &mut [Sample]) -> Result<(), EkfError> {
    let Some(last) = filters.last() else { return Ok(()) };
    let mut f = Matrix::identity();
    for i in 0..N {
        (f[(i, i + N)], f[(i + N, i + 2 * N)], f[(i, i + 2 * N)]) = (dt, dt, 0.5 * dt * dt);
    }
    let mut smoothed = stack(last.state());
    for (ekf, sample) in filters.iter().zip(samples).rev().skip(1) {
        let mut next = *ekf;
        next.predict(dt, &JointJerk::ZERO)?;
        let factor = matrix(&next).cholesky().ok_or(EkfError::Unsound)?;
        let ahead = factor.solve(&(smoothed - stack(next.state())));
        smoothed = stack(ekf.state()) + matrix(ekf) * (f.transpose() * ahead);
        sample.smoothed = UR10E.forward(&JointPos(core::array::from_fn(|i| smoothed[i])));
    }
    Ok(())
}
