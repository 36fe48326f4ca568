//! Poses: where one frame lies in another. Read right to left: `base_from_tcp` takes a point in the tcp frame to the base
//! frame, and inner names cancel: `base_from_part = base_from_tcp * tcp_from_part`.

use core::ops::Mul;
use nalgebra::{ArrayStorage, Matrix3, Vector3};

/// A rigid transform: rotation (orthonormal, determinant +1) and translation (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Columns are the inner frame's axes in the outer frame.
    pub rotation: Matrix3<f64>,
    /// The inner frame's origin in the outer frame (m).
    pub translation: Vector3<f64>,
}

impl Pose {
    /// Both frames coincide.
    #[inline]
    pub const fn identity() -> Self {
        Self::from_translation(0.0, 0.0, 0.0)
    }

    /// A pure shift (m).
    #[inline]
    pub const fn from_translation(x: f64, y: f64, z: f64) -> Self {
        let rotation = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        Self { rotation, translation: Vector3::new(x, y, z) }
    }

    /// Translation (m) and rotation vector (axis times angle, rad): the six numbers of a UR controller's pose.
    pub fn from_rotation_vector(translation: Vector3<f64>, rotation_vector: Vector3<f64>) -> Self {
        Self { rotation: exp(&rotation_vector), translation }
    }

    /// Translation (m) and fixed-axis angles (rad), turned first about x, then y, then z: R = Rz(yaw)·Ry(pitch)·Rx(roll).
    pub fn from_roll_pitch_yaw(translation: Vector3<f64>, roll: f64, pitch: f64, yaw: f64) -> Self {
        Self { rotation: about_z(yaw) * about_y(pitch) * about_x(roll), translation }
    }

    /// The transform the other way round.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// A point of the inner frame, in the outer frame (m).
    pub fn transform_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    /// Axis times angle (rad), angle in [0, π].
    pub fn rotation_vector(&self) -> Vector3<f64> {
        log(&self.rotation)
    }

    /// Whether no component is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.rotation.iter().chain(self.translation.iter()).all(|value| value.is_finite())
    }
}

impl Mul for Pose {
    type Output = Self;

    #[inline]
    fn mul(self, inner: Self) -> Self {
        let ([x, y, z], [[tx, ty, tz]]) = (self.rotation.data.0, self.translation.data.0);
        // Column by column: in a loop over entries, compilers do not see that three lie side by side.
        let turned = |[a, b, c]: [f64; 3]| {
            [x[0] * a + y[0] * b + z[0] * c, x[1] * a + y[1] * b + z[1] * c, x[2] * a + y[2] * b + z[2] * c]
        };
        let (columns, [origin]) = (inner.rotation.data.0, inner.translation.data.0);
        let [px, py, pz] = turned(origin);
        Self {
            rotation: Matrix3::from_array_storage(ArrayStorage(columns.map(turned))),
            translation: Vector3::new(px + tx, py + ty, pz + tz),
        }
    }
}

fn about_x(angle: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle);
    Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
}

fn about_y(angle: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle);
    Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c)
}

fn about_z(angle: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle);
    Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

/// Exponential map of SO(3), Rodrigues' formula: R = I + sin φ/φ·W + (1 − cos φ)/φ²·W², W the cross-product matrix.
fn exp(rotation_vector: &Vector3<f64>) -> Matrix3<f64> {
    let angle_squared = rotation_vector.norm_squared();
    let angle = libm::sqrt(angle_squared);
    // Below 1e-4 rad the series' next terms are under 1e-17 and the quotients would lose digits.
    let (a, b) = if angle < 1e-4 {
        (1.0 - angle_squared / 6.0, 0.5 - angle_squared / 24.0)
    } else {
        let half = libm::sin(0.5 * angle) / angle;
        (libm::sin(angle) / angle, 2.0 * half * half)
    };
    let cross = rotation_vector.cross_matrix();
    Matrix3::identity() + cross * a + cross * cross * b
}

/// Logarithm of SO(3) by way of the unit quaternion (Shepperd's choice of the largest component), exact also near π.
fn log(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let r = rotation;
    let trace = r.trace();
    let (w, v) = if trace >= r[(0, 0)] && trace >= r[(1, 1)] && trace >= r[(2, 2)] {
        (1.0 + trace, Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]))
    } else if r[(0, 0)] >= r[(1, 1)] && r[(0, 0)] >= r[(2, 2)] {
        (
            r[(2, 1)] - r[(1, 2)],
            Vector3::new(1.0 + 2.0 * r[(0, 0)] - trace, r[(0, 1)] + r[(1, 0)], r[(0, 2)] + r[(2, 0)]),
        )
    } else if r[(1, 1)] >= r[(2, 2)] {
        (
            r[(0, 2)] - r[(2, 0)],
            Vector3::new(r[(0, 1)] + r[(1, 0)], 1.0 + 2.0 * r[(1, 1)] - trace, r[(1, 2)] + r[(2, 1)]),
        )
    } else {
        (
            r[(1, 0)] - r[(0, 1)],
            Vector3::new(r[(0, 2)] + r[(2, 0)], r[(1, 2)] + r[(2, 1)], 1.0 + 2.0 * r[(2, 2)] - trace),
        )
    };
    // (w, v) is the quaternion times a positive factor that atan2 and the ratio do not see.
    let sine = v.norm();
    if sine == 0.0 {
        return Vector3::zeros();
    }
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    v * (sign * 2.0 * libm::atan2(sine, sign * w) / sine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_and_logarithm_undo_each_other_up_to_a_half_turn() {
        let axis = Vector3::new(0.6, -0.48, 0.64);
        for angle in [0.0, 1e-12, 1e-5, 1e-4, 0.3, 1.5, 3.0, core::f64::consts::PI - 1e-9, core::f64::consts::PI] {
            let vector = axis * angle;
            let back = log(&exp(&vector));
            // At exactly π the axis and its opposite are one rotation.
            let miss = (back - vector).norm().min((back + vector).norm() + (core::f64::consts::PI - angle));
            assert!(miss < 1e-12, "angle {angle}: {miss:e}");
        }
    }

    #[test]
    fn a_pose_times_its_inverse_is_the_identity() {
        let pose = Pose::from_roll_pitch_yaw(Vector3::new(1.0, -2.0, 0.5), 0.3, -1.1, 2.7);
        let product = pose * pose.inverse();
        assert!((product.rotation - Matrix3::identity()).norm() < 1e-15);
        assert!(product.translation.norm() < 1e-15);
    }
}
