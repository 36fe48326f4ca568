//! The chain from tracker to target with every small change that a calibration may find, and how its end moves with
//! each.

use super::parameter::{Change, Parameter};
use crate::calibrate::pose_fit::Prediction;
use crate::calibrate::target::Frames;
use nalgebra::{DVector, Matrix3, Matrix6xX, Vector3, Vector6};
use screed_kernel::arm::{Arm, Dh, JointKind};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

/// Changes of one row of the table: turn θ, shift d, shift a, tilt about y, turn α, in this order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::calibrate) struct LinkChange {
    pub theta: f64,
    pub d: f64,
    pub a: f64,
    pub tilt: f64,
    pub alpha: f64,
}

/// An arm with changed rows, between a tracker and its target.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::calibrate) struct Chain<const N: usize> {
    pub nominal: Arm<N>,
    pub changes: [LinkChange; N],
    pub frames: Frames,
}

/// An axis in the base frame along or about which a parameter moves all that comes after it.
#[derive(Clone, Copy)]
struct Axis {
    direction: Vector3<f64>,
    point: Vector3<f64>,
}

impl LinkChange {
    /// One of them.
    pub fn of(&self, change: Change) -> f64 {
        match change {
            Change::Theta => self.theta,
            Change::D => self.d,
            Change::A => self.a,
            Change::Tilt => self.tilt,
            Change::Alpha => self.alpha,
        }
    }

    fn add(&mut self, change: Change, step: f64) {
        match change {
            Change::Theta => self.theta += step,
            Change::D => self.d += step,
            Change::A => self.a += step,
            Change::Tilt => self.tilt += step,
            Change::Alpha => self.alpha += step,
        }
    }
}

impl<const N: usize> Chain<N> {
    /// The arm as its table says.
    pub fn nominal(arm: &Arm<N>, frames: Frames) -> Self {
        Self { nominal: *arm, changes: [LinkChange::default(); N], frames }
    }

    /// The flange in the base frame, and the axis of every change, by rows and in the order of [`Change`].
    fn walk(&self, joints: &JointPos<N>) -> (Pose, [[Axis; 5]; N]) {
        let mut base_from_link = self.nominal.base_from_zero.unwrap_or(Pose::identity());
        let axes = std::array::from_fn(|link| {
            let (row, change) = (&self.nominal.dh[link], &self.changes[link]);
            let (theta, d) = variable(&self.nominal, link, joints);
            let along_z = axis(&base_from_link, 2);
            let mut frame = base_from_link * about(2, libm::sincos(theta + change.theta));
            frame.translation += along_z.direction * (d + change.d);
            let along_x = axis(&frame, 0);
            frame.translation += along_x.direction * (row.a + change.a);
            let about_y = axis(&frame, 1);
            frame = frame * about(1, libm::sincos(change.tilt));
            let about_x = axis(&frame, 0);
            base_from_link = frame * about(0, turned(row, change.alpha));
            [along_z, along_z, along_x, about_y, about_x]
        });
        (base_from_link * self.nominal.last_from_flange.unwrap_or(Pose::identity()), axes)
    }

    /// The flange in the base frame.
    pub fn base_from_flange(&self, joints: &JointPos<N>) -> Pose {
        self.walk(joints).0
    }

    /// The target as the tracker should see it, and how it moves with each of these parameters.
    pub fn predicted(&self, joints: &JointPos<N>, parameters: &[Parameter]) -> Prediction {
        let (base_from_flange, axes) = self.walk(joints);
        let tracker_from_target = self.frames.predicted(&base_from_flange);
        let [base, target] = self.frames.motion(&base_from_flange);
        let to_tracker = self.frames.tracker_from_base.rotation;
        let target_in_base = base_from_flange.transform_point(&self.frames.flange_from_target.translation);
        let column = |parameter: &Parameter| -> Vector6<f64> {
            match *parameter {
                Parameter::Base(motion) => base.column(motion as usize).into_owned(),
                Parameter::Target(motion) => target.column(motion as usize).into_owned(),
                Parameter::Link { link, change } => {
                    let Axis { direction, point } = axes[link][change as usize];
                    let (linear, angular) = if parameter.is_angle() {
                        (direction.cross(&(target_in_base - point)), direction)
                    } else {
                        (direction, Vector3::zeros())
                    };
                    let (linear, angular) = (to_tracker * linear, to_tracker * angular);
                    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
                }
            }
        };
        let mut motion = Matrix6xX::zeros(parameters.len());
        for (mut moves, parameter) in motion.column_iter_mut().zip(parameters) {
            moves.copy_from(&column(parameter));
        }
        Prediction { tracker_from_target, motion }
    }

    /// The chain with a step added to these parameters.
    pub fn moved(&self, parameters: &[Parameter], step: &DVector<f64>) -> Self {
        let mut chain = self.clone();
        let (mut base, mut target) = (Vector6::zeros(), Vector6::zeros());
        for (parameter, step) in parameters.iter().zip(step) {
            match *parameter {
                Parameter::Base(motion) => base[motion as usize] += step,
                Parameter::Target(motion) => target[motion as usize] += step,
                Parameter::Link { link, change } => chain.changes[link].add(change, *step),
            }
        }
        chain.frames = self.frames.moved_by(&target, &base);
        chain
    }
}

fn axis(frame: &Pose, column: usize) -> Axis {
    Axis { direction: frame.rotation.column(column).into_owned(), point: frame.translation }
}

/// θ and d of a row with the joints where they are.
fn variable<const N: usize>(arm: &Arm<N>, link: usize, joints: &JointPos<N>) -> (f64, f64) {
    let coupled = arm.joints[link].coupling.and_then(|other| Some(other.factor * joints.0.get(other.joint)?));
    let position = joints.0[link] + coupled.unwrap_or(0.0);
    match arm.joints[link].kind {
        JointKind::Revolute => (arm.dh[link].theta + position, arm.dh[link].d),
        JointKind::Prismatic => (arm.dh[link].theta, arm.dh[link].d + position),
    }
}

/// Sine and cosine of a row's α and a change of it; the row's own, to the bit, when the change is zero.
pub(in crate::calibrate) fn turned(row: &Dh, change: f64) -> (f64, f64) {
    let (sine, cosine) = libm::sincos(change);
    (row.sin_alpha * cosine + row.cos_alpha * sine, row.cos_alpha * cosine - row.sin_alpha * sine)
}

/// A turn about one of the axes, by its sine and cosine.
fn about(axis: usize, (sine, cosine): (f64, f64)) -> Pose {
    let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut rotation = Matrix3::identity();
    (rotation[(j, j)], rotation[(j, k)]) = (cosine, -sine);
    (rotation[(k, j)], rotation[(k, k)]) = (sine, cosine);
    Pose { rotation, translation: Vector3::zeros() }
}
