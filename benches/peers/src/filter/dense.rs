//! The kernel's filter as textbooks write it, with dense matrices: pose and rates as one update of twelve rows.

use super::tape::{DENSITY, DT, N, RATE_DEVIATION};
use nalgebra::{SMatrix, SVector};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::State;
use screed_kernel::ekf::pose::TrackedPose;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, JointVel};

const X: usize = 3 * N;
type Matrix = SMatrix<f64, X, X>;

/// The dense filter.
pub struct Dense {
    pub x: SVector<f64, X>,
    pub p: Matrix,
    f: Matrix,
    q: Matrix,
}

impl Dense {
    /// Begins at `state`, uncertain by `deviation`.
    pub fn new(state: &State<N>, deviation: &State<N>) -> Self {
        let stack = |state: &State<N>| -> SVector<f64, X> {
            SVector::from_iterator(state.position.0.into_iter().chain(state.velocity.0).chain(state.acceleration.0))
        };
        let (mut f, mut q) = (Matrix::identity(), Matrix::zeros());
        let white = [
            [DT.powi(5) / 20.0, DT.powi(4) / 8.0, DT.powi(3) / 6.0],
            [DT.powi(4) / 8.0, DT.powi(3) / 3.0, DT.powi(2) / 2.0],
            [DT.powi(3) / 6.0, DT.powi(2) / 2.0, DT],
        ];
        for i in 0..N {
            (f[(i, i + N)], f[(i + N, i + 2 * N)], f[(i, i + 2 * N)]) = (DT, DT, 0.5 * DT * DT);
            for (a, row) in white.iter().enumerate() {
                for (b, value) in row.iter().enumerate() {
                    q[(i + a * N, i + b * N)] = DENSITY * value;
                }
            }
        }
        let p = Matrix::from_diagonal(&stack(deviation).map(|deviation: f64| deviation * deviation));
        Self { x: stack(state), p, f, q }
    }

    /// What is measured: prediction, pose, rates.
    pub fn tick(&mut self, pose: &TrackedPose, rates: &JointVel<N>) {
        self.x = self.f * self.x;
        self.p = self.f * self.p * self.f.transpose() + self.q;
        let joints = JointPos(std::array::from_fn(|i| self.x[i]));
        let (base_from_flange, jacobian) = UR10E.jacobian(&joints);
        let expected = base_from_flange * pose.flange_from_target;
        let measured = pose.tracker_from_base.inverse() * pose.tracker_from_target;
        let lever = expected.translation - base_from_flange.translation;
        let place = measured.translation - expected.translation;
        let turn =
            Pose { rotation: measured.rotation * expected.rotation.transpose(), translation: place }.rotation_vector();
        let mut h = SMatrix::<f64, 12, X>::zeros();
        let mut y = SVector::<f64, 12>::zeros();
        let mut r = SMatrix::<f64, 12, 12>::zeros();
        for i in 0..N {
            let axis = jacobian.fixed_view::<3, 1>(3, i).into_owned();
            h.fixed_view_mut::<3, 1>(0, i).copy_from(&(jacobian.fixed_view::<3, 1>(0, i) + axis.cross(&lever)));
            h.fixed_view_mut::<3, 1>(3, i).copy_from(&axis);
            h[(6 + i, N + i)] = 1.0;
            y[6 + i] = rates.0[i] - self.x[N + i];
            r[(6 + i, 6 + i)] = RATE_DEVIATION * RATE_DEVIATION;
        }
        for k in 0..3 {
            (y[k], y[3 + k]) = (place[k], turn[k]);
            r[(k, k)] = pose.position_deviation * pose.position_deviation;
            r[(3 + k, 3 + k)] = pose.rotation_deviation * pose.rotation_deviation;
        }
        let hp = h * self.p;
        let mut s = hp * h.transpose();
        // What the pose bends away from its tangent, as in the kernel.
        let (way, turn) = (s.fixed_view::<3, 3>(0, 0).trace(), s.fixed_view::<3, 3>(3, 3).trace());
        for k in 0..3 {
            r[(k, k)] += 0.25 * way * turn;
            r[(3 + k, 3 + k)] += 0.25 * turn * turn;
        }
        s += r;
        let factor = s.cholesky().expect("a positive definite matrix");
        let gain = factor.solve(&hp).transpose();
        self.x += gain * y;
        self.p -= gain * hp;
    }
}
