//! What a tracker measures of a target, and how a model of it is held against that.

use super::CalibrateError;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6xX, Vector3, Vector6};
use screed_kernel::pose::Pose;
use serde::Serialize;

/// Noise of a tracker's pose: independent in each axis, the same along all three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerNoise {
    /// Standard deviation of a coordinate near the tracker (m).
    pub position: f64,
    /// Its growth with the distance (m/m).
    pub position_per_metre: f64,
    /// Standard deviation of the turn about each axis (rad).
    pub rotation: f64,
}

impl TrackerNoise {
    /// Standard deviation of a coordinate at this place in the tracker frame (m).
    pub fn position_at(&self, point_in_tracker: &Vector3<f64>) -> f64 {
        self.position + self.position_per_metre * point_in_tracker.norm()
    }

    pub(super) fn checked(&self) -> Result<&Self, CalibrateError> {
        for (found, least) in
            [(self.position, 0.0), (self.position_per_metre, -f64::MIN_POSITIVE), (self.rotation, 0.0)]
        {
            if !(found > least && found.is_finite()) {
                return Err(CalibrateError::Noise { found });
            }
        }
        Ok(self)
    }
}

/// What is left of a measured pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PoseResidual {
    /// Distance between measured and predicted position (m).
    pub position_m: f64,
    /// Angle between measured and predicted orientation (rad).
    pub rotation_rad: f64,
}

impl PoseResidual {
    /// Between two poses in one frame.
    pub fn between(measured: &Pose, predicted: &Pose) -> Self {
        let residual = residual(measured, predicted);
        Self { position_m: residual.fixed_rows::<3>(0).norm(), rotation_rad: residual.fixed_rows::<3>(3).norm() }
    }
}

/// Measured less predicted: position (m), then the turn (rad) that takes the predicted orientation to the measured one;
/// both in the outer frame.
fn residual(measured: &Pose, predicted: &Pose) -> Vector6<f64> {
    let position = measured.translation - predicted.translation;
    let rotation = measured.rotation * predicted.rotation.transpose();
    let turn = Pose { rotation, translation: Vector3::zeros() }.rotation_vector();
    Vector6::new(position.x, position.y, position.z, turn.x, turn.y, turn.z)
}

/// A predicted pose, and how it moves with each parameter: columns of linear velocity of its origin and angular
/// velocity, in the tracker frame.
pub(super) struct Prediction {
    pub tracker_from_target: Pose,
    pub motion: Matrix6xX<f64>,
}

/// Six rows of a [`super::least_squares::System`], from `row` on: the measured pose less the predicted one, by the
/// noise.
pub(super) fn fill(
    jacobian: &mut DMatrix<f64>,
    residuals: &mut DVector<f64>,
    row: usize,
    measured: &Pose,
    prediction: &Prediction,
    noise: &TrackerNoise,
) {
    let found = residual(measured, &prediction.tracker_from_target);
    let turn = found.fixed_rows::<3>(3).into_owned();
    let weight = 1.0 / noise.position_at(&measured.translation);
    let turning = right_inverse(&turn) / noise.rotation;
    residuals.fixed_rows_mut::<3>(row).copy_from(&(found.fixed_rows::<3>(0) * weight));
    residuals.fixed_rows_mut::<3>(row + 3).copy_from(&(turn / noise.rotation));
    for (column, motion) in prediction.motion.column_iter().enumerate() {
        jacobian.fixed_view_mut::<3, 1>(row, column).copy_from(&(motion.fixed_rows::<3>(0) * weight));
        jacobian.fixed_view_mut::<3, 1>(row + 3, column).copy_from(&(turning * motion.fixed_rows::<3>(3)));
    }
}

/// Inverse of SO(3)'s right Jacobian: log(exp(v)·exp(−δ)) = v − J⁻¹(v)·δ to first order. Chirikjian, "Stochastic
/// Models, Information Theory, and Lie Groups" 2, 2012, 10.6.
fn right_inverse(v: &Vector3<f64>) -> Matrix3<f64> {
    let angle_squared = v.norm_squared();
    let half = 0.5 * angle_squared.sqrt();
    let second =
        if half < 1e-4 { (1.0 + angle_squared / 60.0) / 12.0 } else { (1.0 - half / half.tan()) / angle_squared };
    let cross = v.cross_matrix();
    Matrix3::identity() + cross * 0.5 + cross * cross * second
}

/// A twist of a frame, as it moves `point` that is fixed to it: columns of translation along and rotation about each of
/// the frame's axes, the frame's rotation and origin and the point given in the tracker frame.
pub(super) fn twist(frame: &Pose, point: &Vector3<f64>) -> Matrix6<f64> {
    let mut motion = Matrix6::zeros();
    let arm = point - frame.translation;
    for (axis, direction) in frame.rotation.column_iter().enumerate() {
        motion.fixed_view_mut::<3, 1>(0, axis).copy_from(&direction);
        motion.fixed_view_mut::<3, 1>(0, axis + 3).copy_from(&direction.cross(&arm));
        motion.fixed_view_mut::<3, 1>(3, axis + 3).copy_from(&direction);
    }
    motion
}

/// The pose with a small motion in front of it: exp of the turn, and the shift.
pub(super) fn twisted(pose: &Pose, step: &Vector6<f64>) -> Pose {
    Pose::from_rotation_vector(step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned()) * *pose
}
