//! Where a tracker's target sits on the flange, and where the tracker stands: from poses of the flange that the arm
//! knows and poses of the target that the tracker measures.
//!
//! For each measurement base_from_flange · flange_from_target = base_from_tracker · tracker_from_target, in the
//! literature A·X = Z·B. The start is Shah's closed form ("Solving the robot-world/hand-eye calibration problem using
//! the Kronecker product", J. Mechanisms and Robotics 5(3), 2013): the rotations from one singular value decomposition,
//! then the translations by linear least squares. Gauss–Newton on the tracker's residuals, by its noise, makes the best
//! estimate of it. A·X = X·B, the motion between two measurements, has the same X and needs no Z.

use super::least_squares::{System, gauss_newton};
use super::pose_fit::{PoseResidual, Prediction, TrackerNoise, fill, twist, twisted};
use super::{CalibrateError, Fit, swing};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6xX, SMatrix, Vector3, Vector6};
use screed_kernel::pose::Pose;

/// The fewest poses: two motions between them.
pub const POSES_MIN: usize = 3;

/// One pose, as the arm and as the tracker see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePair {
    /// By the arm's geometry.
    pub base_from_flange: Pose,
    /// As measured.
    pub tracker_from_target: Pose,
}

/// Target and tracker, found together.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// The target on the flange.
    pub flange_from_target: Pose,
    /// The arm's base as the tracker sees it.
    pub tracker_from_base: Pose,
    /// Covariance; rows and columns are the translation (m) and the turn left to do (rad) of `flange_from_target` in
    /// the flange frame, then those of `tracker_from_base` in the tracker frame.
    pub covariance: SMatrix<f64, 12, 12>,
    /// How well the poses agree with the noise given.
    pub fit: Fit,
    /// What is left of each pose.
    pub residuals: Vec<PoseResidual>,
    /// How far the flange direction that swings least is turned (root mean square, about rad).
    pub swing: f64,
    /// Largest over smallest singular value of the Jacobian with its columns scaled to one length.
    pub condition: f64,
}

/// Finds both frames from poses. `noise` is that of each measured pose against the arm's: where the arm's own errors
/// are larger than the tracker's, they belong into it.
///
/// # Errors
/// [`CalibrateError`] with too few poses, numbers that are none, turns about one axis only, or poses that do not belong
/// together.
pub fn calibrate(poses: &[PosePair], noise: &TrackerNoise) -> Result<Target, CalibrateError> {
    let noise = noise.checked()?;
    let found = poses.len();
    if found < POSES_MIN {
        return Err(CalibrateError::TooFew { what: "poses", found, least: POSES_MIN });
    }
    let finite = |pair: &PosePair| pair.base_from_flange.is_finite() && pair.tracker_from_target.is_finite();
    if let Some(measurement) = poses.iter().position(|pair| !finite(pair)) {
        return Err(CalibrateError::NotFinite { measurement });
    }
    let swing = swing::held(poses.iter().map(|pair| pair.base_from_flange))?;
    let start = Frames::closed_form(poses)?;
    let linearise = |frames: &Frames| frames.system(poses, noise);
    let best = gauss_newton(start, undetermined, linearise, |frames, step| frames.moved(step))?;
    let frames = best.state;
    let predicted = |pair: &PosePair| frames.predicted(&pair.base_from_flange);
    let residual = |pair: &PosePair| PoseResidual::between(&pair.tracker_from_target, &predicted(pair));
    let twists = SMatrix::<f64, 12, 12>::from_fn(|row, column| best.solved.covariance[(row, column)]);
    let outward = frames.twists_as_offsets();
    Ok(Target {
        flange_from_target: frames.flange_from_target,
        tracker_from_base: frames.tracker_from_base,
        covariance: outward * twists * outward.transpose(),
        fit: Fit { chi_squared: best.chi_squared, degrees: 6 * found - 12 },
        residuals: poses.iter().map(residual).collect(),
        swing,
        condition: best.solved.condition,
    })
}

fn undetermined() -> Vec<String> {
    vec!["the target on the flange".to_owned(), "the base in the tracker's frame".to_owned()]
}

/// The two unknown frames at the ends of the chain from tracker to target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frames {
    pub flange_from_target: Pose,
    pub tracker_from_base: Pose,
}

impl Frames {
    /// Shah's solution.
    pub fn closed_form(poses: &[PosePair]) -> Result<Self, CalibrateError> {
        let undetermined = || CalibrateError::Undetermined { parameters: undetermined() };
        // With vec() stacking columns, R_A·R_X = R_Z·R_B is vec(R_Z) = (R_B ⊗ R_A)·vec(R_X).
        let mut sum = SMatrix::<f64, 9, 9>::zeros();
        for pair in poses {
            sum += pair.tracker_from_target.rotation.kronecker(&pair.base_from_flange.rotation);
        }
        let svd = sum.svd(true, true);
        let (u, v_t) = svd.u.zip(svd.v_t).ok_or_else(undetermined)?;
        let largest = svd.singular_values.imax();
        let x = Matrix3::from_iterator(v_t.row(largest).iter().copied());
        let z = Matrix3::from_iterator(u.column(largest).iter().copied());
        let sign = x.determinant().signum();
        let rotation_x = nearest_rotation(&(x * sign)).ok_or_else(undetermined)?;
        let rotation_z = nearest_rotation(&(z * sign)).ok_or_else(undetermined)?;

        // R_A·t_X − t_Z = R_Z·t_B − t_A.
        let mut jacobian = DMatrix::zeros(3 * poses.len(), 6);
        let mut residual = DVector::zeros(3 * poses.len());
        for (index, pair) in poses.iter().enumerate() {
            let known = rotation_z * pair.tracker_from_target.translation - pair.base_from_flange.translation;
            jacobian.fixed_view_mut::<3, 3>(3 * index, 0).copy_from(&pair.base_from_flange.rotation);
            jacobian.fixed_view_mut::<3, 3>(3 * index, 3).copy_from(&-Matrix3::identity());
            residual.fixed_rows_mut::<3>(3 * index).copy_from(&known);
        }
        let translations = System { jacobian, residual }.solved().ok_or_else(undetermined)?.step;
        let base_from_tracker =
            Pose { rotation: rotation_z, translation: translations.fixed_rows::<3>(3).into_owned() };
        Ok(Self {
            flange_from_target: Pose {
                rotation: rotation_x,
                translation: translations.fixed_rows::<3>(0).into_owned(),
            },
            tracker_from_base: base_from_tracker.inverse(),
        })
    }

    pub fn predicted(&self, base_from_flange: &Pose) -> Pose {
        self.tracker_from_base * *base_from_flange * self.flange_from_target
    }

    /// How the predicted target moves with a twist of the base (in the base frame) and one of the target (in the flange
    /// frame).
    pub fn motion(&self, base_from_flange: &Pose) -> [Matrix6<f64>; 2] {
        let tracker_from_flange = self.tracker_from_base * *base_from_flange;
        let target = tracker_from_flange.transform_point(&self.flange_from_target.translation);
        [twist(&self.tracker_from_base, &target), twist(&tracker_from_flange, &target)]
    }

    /// Both frames after twists: of the target in the flange frame, of the base in the base frame.
    pub fn moved_by(&self, target: &Vector6<f64>, base: &Vector6<f64>) -> Self {
        Self {
            flange_from_target: twisted(&self.flange_from_target, target),
            tracker_from_base: self.tracker_from_base * twisted(&Pose::identity(), base),
        }
    }

    pub fn moved(&self, step: &DVector<f64>) -> Self {
        self.moved_by(&step.fixed_rows::<6>(0).into_owned(), &step.fixed_rows::<6>(6).into_owned())
    }

    pub fn system(&self, poses: &[PosePair], noise: &TrackerNoise) -> System {
        let (mut jacobian, mut residual) = (DMatrix::zeros(6 * poses.len(), 12), DVector::zeros(6 * poses.len()));
        for (index, pair) in poses.iter().enumerate() {
            let [base, target] = self.motion(&pair.base_from_flange);
            let mut motion = Matrix6xX::zeros(12);
            motion.fixed_columns_mut::<6>(0).copy_from(&target);
            motion.fixed_columns_mut::<6>(6).copy_from(&base);
            let prediction = Prediction { tracker_from_target: self.predicted(&pair.base_from_flange), motion };
            fill(&mut jacobian, &mut residual, 6 * index, &pair.tracker_from_target, &prediction, noise);
        }
        System { jacobian, residual }
    }

    /// Twists of target and base, as shifts of the frames' origins and turns, in the outer frames.
    pub fn twists_as_offsets(&self) -> SMatrix<f64, 12, 12> {
        let mut map = SMatrix::<f64, 12, 12>::identity();
        // The target's origin goes with a turn about the flange's.
        map.fixed_view_mut::<3, 3>(0, 3).copy_from(&-self.flange_from_target.translation.cross_matrix());
        map.fixed_view_mut::<3, 3>(6, 6).copy_from(&self.tracker_from_base.rotation);
        map.fixed_view_mut::<3, 3>(9, 9).copy_from(&self.tracker_from_base.rotation);
        map
    }
}

/// The rotation nearest to a matrix, which is one but for noise and a factor where the poses belong together.
fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = matrix.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let handed = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    Some(u * handed * v_t)
}
