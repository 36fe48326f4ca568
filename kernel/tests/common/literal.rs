//! The filter as the KRAKEN paper prints it (section 3.2, Tables 2 and 3): z of 13 numbers, position, quaternion and joint rates,
//! with dense matrices and an innovation z − h(x) that simply subtracts quaternions. One line is mended: a z that is not reliable
//! leaves P as it is. [`Literal::printed`] leaves that line as it was printed.

use nalgebra::{Matrix3, SMatrix, SVector, Vector4};
use screed_kernel::arm::Arm;
use screed_kernel::ekf::State;
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::units::{JointJerk, JointPos, JointVel};

const N: usize = 6;
const X: usize = 3 * N;
const Z: usize = 7 + N;

/// The 13-row filter.
#[derive(Clone, Debug)]
pub struct Literal {
    pub x: SVector<f64, X>,
    pub p: SMatrix<f64, X, X>,
    f: SMatrix<f64, X, X>,
    q: SMatrix<f64, X, X>,
    /// Whether a z that is not reliable shrinks P all the same.
    printed: bool,
}

impl Literal {
    /// Begins at `state`, uncertain by `deviation`; T = `dt` (s), the white jerk of this density (rad²/s⁵) in every joint.
    pub fn new(state: &State<N>, deviation: &State<N>, density: f64, dt: f64) -> Self {
        let stack = |state: &State<N>| -> SVector<f64, X> {
            SVector::from_iterator(state.position.0.into_iter().chain(state.velocity.0).chain(state.acceleration.0))
        };
        let white = [
            [dt.powi(5) / 20.0, dt.powi(4) / 8.0, dt.powi(3) / 6.0],
            [dt.powi(4) / 8.0, dt.powi(3) / 3.0, dt.powi(2) / 2.0],
            [dt.powi(3) / 6.0, dt.powi(2) / 2.0, dt],
        ];
        let (mut m, mut q) = (SMatrix::<f64, X, X>::zeros(), SMatrix::zeros());
        for i in 0..N {
            (m[(i, i + N)], m[(i + N, i + 2 * N)]) = (1.0, 1.0);
            for (a, row) in white.iter().enumerate() {
                for (b, value) in row.iter().enumerate() {
                    q[(i + a * N, i + b * N)] = density * value;
                }
            }
        }
        let f = SMatrix::identity() + m * dt + m * m * (0.5 * dt * dt);
        let p = SMatrix::from_diagonal(&stack(deviation).map(|deviation: f64| deviation * deviation));
        Self { x: stack(state), p, f, q, printed: false }
    }

    /// The same with Table 3's last line as it is printed.
    pub fn printed(self) -> Self {
        Self { printed: true, ..self }
    }

    pub fn joints(&self) -> JointPos<N> {
        JointPos(std::array::from_fn(|i| self.x[i]))
    }

    /// What the paper's prediction leaves out: the effect of a commanded jerk over the next T, \[T³/6, T²/2, T\]·j, brought back to
    /// before it by F⁻¹, so that the next tick's F·x has it.
    pub fn command(&mut self, jerk: &JointJerk<N>, dt: f64) {
        for (i, jerk) in jerk.0.iter().enumerate() {
            self.x[i] += dt.powi(3) / 6.0 * jerk;
            self.x[N + i] -= 0.5 * dt * dt * jerk;
            self.x[2 * N + i] += dt * jerk;
        }
    }

    /// A prediction, and an update if z is reliable. z's quaternion is taken with the sign that is nearer to the expected one;
    /// the rates all have one standard deviation.
    pub fn tick(&mut self, arm: &Arm<N>, pose: &TrackedPose, rates: &JointVel<N>, rate_deviation: f64, reliable: bool) {
        self.x = self.f * self.x;
        self.p = self.f * self.p * self.f.transpose() + self.q;
        if !reliable && !self.printed {
            return;
        }
        let (base_from_flange, jacobian) = arm.jacobian(&self.joints());
        let expected = base_from_flange * pose.flange_from_target;
        let measured = pose.tracker_from_base.inverse() * pose.tracker_from_target;
        let lever = expected.translation - base_from_flange.translation;
        let (h_quaternion, z_quaternion) = (quaternion(&expected.rotation), quaternion(&measured.rotation));
        let sign = if h_quaternion.dot(&z_quaternion) < 0.0 { -1.0 } else { 1.0 };
        let mut h = SMatrix::<f64, Z, X>::zeros();
        let mut y = SVector::<f64, Z>::zeros();
        let mut r = SMatrix::<f64, Z, Z>::zeros();
        y.fixed_rows_mut::<3>(0).copy_from(&(measured.translation - expected.translation));
        y.fixed_rows_mut::<4>(3).copy_from(&(z_quaternion * sign - h_quaternion));
        let [w, x, y1, z] = h_quaternion.into();
        for i in 0..N {
            let axis = jacobian.fixed_view::<3, 1>(3, i).into_owned();
            h.fixed_view_mut::<3, 1>(0, i).copy_from(&(jacobian.fixed_view::<3, 1>(0, i) + axis.cross(&lever)));
            // q̇ = ½·(0, ω)·q.
            let turned = Vector4::new(
                -axis.x * x - axis.y * y1 - axis.z * z,
                axis.x * w + axis.y * z - axis.z * y1,
                axis.y * w + axis.z * x - axis.x * z,
                axis.z * w + axis.x * y1 - axis.y * x,
            );
            h.fixed_view_mut::<4, 1>(3, i).copy_from(&(turned * 0.5));
            h[(7 + i, N + i)] = 1.0;
            y[7 + i] = rates.0[i] - self.x[N + i];
            r[(7 + i, 7 + i)] = rate_deviation * rate_deviation;
        }
        for k in 0..3 {
            r[(k, k)] = pose.position_deviation * pose.position_deviation;
        }
        for k in 3..7 {
            // A small turn's quaternion is half of its rotation vector.
            r[(k, k)] = 0.25 * pose.rotation_deviation * pose.rotation_deviation;
        }
        let hp = h * self.p;
        let s = hp * h.transpose() + r;
        let gain = s.cholesky().expect("a positive definite matrix").solve(&hp).transpose();
        if reliable {
            self.x += gain * y;
        }
        self.p -= gain * hp;
    }
}

/// w, x, y, z of a rotation (Shepperd, "Quaternion from rotation matrix", 1978).
fn quaternion(r: &Matrix3<f64>) -> Vector4<f64> {
    let trace = r.trace();
    let diagonal = [trace, r[(0, 0)], r[(1, 1)], r[(2, 2)]];
    let largest = (1..4).fold(0, |best, k| if diagonal[k] > diagonal[best] { k } else { best });
    let unscaled = match largest {
        0 => Vector4::new(1.0 + trace, r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]),
        1 => Vector4::new(
            r[(2, 1)] - r[(1, 2)],
            1.0 + 2.0 * r[(0, 0)] - trace,
            r[(0, 1)] + r[(1, 0)],
            r[(2, 0)] + r[(0, 2)],
        ),
        2 => Vector4::new(
            r[(0, 2)] - r[(2, 0)],
            r[(0, 1)] + r[(1, 0)],
            1.0 + 2.0 * r[(1, 1)] - trace,
            r[(1, 2)] + r[(2, 1)],
        ),
        _ => Vector4::new(
            r[(1, 0)] - r[(0, 1)],
            r[(2, 0)] + r[(0, 2)],
            r[(1, 2)] + r[(2, 1)],
            1.0 + 2.0 * r[(2, 2)] - trace,
        ),
    };
    unscaled.normalize()
}
