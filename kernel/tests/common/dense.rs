//! The filter as textbooks write it: dense matrices, Joseph's form, and a Jacobian by differences. Slow, and shares nothing
//! with the kernel's but forward kinematics.

use super::plant::{DENSITY, N};
use nalgebra::{Cholesky, SMatrix, SVector};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::ekf::{Ekf, State};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointJerk, JointPos};

pub const X: usize = 3 * N;
pub type MatrixX = SMatrix<f64, X, X>;
pub type VectorX = SVector<f64, X>;

/// θ, θ̇, θ̈ as one vector.
pub fn stack(state: &State<N>) -> VectorX {
    VectorX::from_iterator(state.position.0.into_iter().chain(state.velocity.0).chain(state.acceleration.0))
}

/// The kernel's blocks as one matrix.
pub fn matrix(ekf: &Ekf<N>) -> MatrixX {
    MatrixX::from_fn(|row, column| ekf.covariance().get(row, column).unwrap())
}

pub struct Dense {
    pub x: VectorX,
    pub p: MatrixX,
}

/// A measurement of M numbers, linearised.
pub struct Linear<const M: usize> {
    pub y: SVector<f64, M>,
    pub h: SMatrix<f64, M, X>,
    pub r: SMatrix<f64, M, M>,
}

impl Dense {
    pub fn of(ekf: &Ekf<N>) -> Self {
        Self { x: stack(ekf.state()), p: matrix(ekf) }
    }

    pub fn predict(&mut self, dt: f64, jerk: &JointJerk<N>) {
        let mut m = MatrixX::zeros();
        let (mut q, mut gain) = (MatrixX::zeros(), SMatrix::<f64, X, N>::zeros());
        for i in 0..N {
            let parts = [i, i + N, i + 2 * N];
            (m[(i, i + N)], m[(i + N, i + 2 * N)]) = (1.0, 1.0);
            let effect = [dt.powi(3) / 6.0, dt.powi(2) / 2.0, dt];
            let white = [
                [dt.powi(5) / 20.0, dt.powi(4) / 8.0, dt.powi(3) / 6.0],
                [dt.powi(4) / 8.0, dt.powi(3) / 3.0, dt.powi(2) / 2.0],
                [dt.powi(3) / 6.0, dt.powi(2) / 2.0, dt],
            ];
            for a in 0..3 {
                gain[(parts[a], i)] = effect[a];
                for b in 0..3 {
                    q[(parts[a], parts[b])] = DENSITY[i] * white[a][b];
                }
            }
        }
        let f = MatrixX::identity() + m * dt + m * m * (0.5 * dt * dt);
        self.x = f * self.x + gain * SVector::<f64, N>::from(jerk.0);
        self.p = f * self.p * f.transpose() + q;
    }

    pub fn joints(&self) -> JointPos<N> {
        JointPos(core::array::from_fn(|i| self.x[i]))
    }

    /// The difference of two poses of the target in the base frame.
    fn difference(to: &Pose, from: &Pose) -> SVector<f64, 6> {
        let turn = Pose { rotation: to.rotation * from.rotation.transpose(), translation: to.translation };
        let (place, turn) = (to.translation - from.translation, turn.rotation_vector());
        SVector::from([place.x, place.y, place.z, turn.x, turn.y, turn.z])
    }

    pub fn pose(&self, measured: &TrackedPose) -> Linear<6> {
        let expected = |joints: &JointPos<N>| UR10E.forward(joints) * measured.flange_from_target;
        let here = expected(&self.joints());
        let y = Self::difference(&(measured.tracker_from_base.inverse() * measured.tracker_from_target), &here);
        let mut h = SMatrix::<f64, 6, X>::zeros();
        for i in 0..N {
            let at = |factor: f64| {
                let mut joints = self.joints();
                joints.0[i] += factor * 1e-3;
                Self::difference(&expected(&joints), &here)
            };
            // Central differences of sixth order.
            let slope = (at(1.0) - at(-1.0)) * 45.0 - (at(2.0) - at(-2.0)) * 9.0 + (at(3.0) - at(-3.0));
            h.set_column(i, &(slope / 60e-3));
        }
        // What the pose bends away from its tangent; see the kernel's `bend`.
        let spread = h * self.p * h.transpose();
        let [way, turn] = [0, 3].map(|first| spread.fixed_view::<3, 3>(first, first).trace());
        let bends = [0.25 * way * turn, 0.25 * turn * turn];
        let variance = |k| match k {
            0..3 => measured.position_deviation.powi(2) + bends[0],
            _ => measured.rotation_deviation.powi(2) + bends[1],
        };
        Linear { y, h, r: SMatrix::from_diagonal(&SVector::from_fn(|k, _| variance(k))) }
    }

    /// Of N numbers that are measured themselves, beginning at this component of the state.
    pub fn direct(&self, first: usize, measured: &[f64; N], deviation: &[f64; N]) -> Linear<N> {
        let mut h = SMatrix::<f64, N, X>::zeros();
        h.fixed_view_mut::<N, N>(0, first).fill_with_identity();
        let y = SVector::<f64, N>::from(*measured) - self.x.fixed_rows::<N>(first);
        Linear { y, h, r: SMatrix::from_diagonal(&SVector::from(*deviation).map(|d: f64| d * d)) }
    }

    /// The innovation made white, of unit variance.
    pub fn white<const M: usize>(&self, linear: &Linear<M>) -> SVector<f64, M> {
        let s = linear.h * self.p * linear.h.transpose() + linear.r;
        let root = Cholesky::new(s).unwrap().l();
        root.solve_lower_triangular(&linear.y).unwrap()
    }

    /// x + K·y, and (I − K·H)·P·(I − K·H)ᵀ + K·R·Kᵀ (Bucy and Joseph 1968). Returns the normalised innovation squared.
    pub fn update<const M: usize>(&mut self, linear: &Linear<M>) -> f64 {
        let Linear { y, h, r } = linear;
        let factor = Cholesky::new(h * self.p * h.transpose() + r).unwrap();
        let gain = factor.solve(&(h * self.p)).transpose();
        let rest = MatrixX::identity() - gain * h;
        self.x += gain * y;
        self.p = rest * self.p * rest.transpose() + gain * r * gain.transpose();
        y.dot(&factor.solve(y))
    }
}
