//! What an arm's geometry really is: changes of its DH table, from poses of a target that a tracker measured.
//!
//! Unknown are the changes of every row, where the target sits on the flange and where the tracker stands; Gauss–Newton
//! on the tracker's residuals, by its noise, with the analytic Jacobian of the chain. Sources: Mooring, Roth, Driels,
//! "Fundamentals of Manipulator Calibration", 1991; Hollerbach, Khalil, Gautier, "Model Identification", Springer
//! Handbook of Robotics, 2016.
//!
//! Not all of them can be told apart: the first row's θ and d from a motion of the base, the last row's four from one
//! of the target, the d of rows with parallel axes from each other; with few or similar poses, more. The singular
//! values of the column-scaled Jacobian say so; for each such dependence one change is held at zero, a row's before a
//! frame's and a later row's before an earlier one's, and the dependence is named.

pub(super) mod chain;
mod parameter;
pub(super) mod table;

pub use parameter::{Change, Motion, Parameter};

use super::dependence::{Dependence, dependences};
use super::least_squares::{System, gauss_newton};
use super::pose_fit::{PoseResidual, TrackerNoise, fill};
use super::target::{self, Frames, PosePair};
use super::{CalibrateError, Fit};
use chain::Chain;
use nalgebra::{DMatrix, DVector};
use screed_kernel::arm::Arm;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

/// |sin α| below which the axes of a joint and the next count as parallel, so that the row gets a tilt.
const PARALLEL: f64 = 0.1;

/// The target's pose, measured with the joints somewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmMeasurement<const N: usize> {
    /// The joints as the arm reads them (rad, m).
    pub joints: JointPos<N>,
    /// As measured.
    pub tracker_from_target: Pose,
}

/// A change that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Of what.
    pub parameter: Parameter,
    /// By how much the arm differs from its table (m, rad).
    pub change: f64,
    /// Standard deviation of it (m, rad).
    pub sigma: f64,
}

/// Changes that the measurements cannot tell apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Those that were held at zero; what they really are shows in the others.
    pub held: Vec<Parameter>,
    /// Those that take up their part. Empty: what was held moves nothing.
    pub with: Vec<Parameter>,
}

/// An arm as it was found to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Identified<const N: usize> {
    /// The arm with the changes in its table.
    pub arm: Arm<N>,
    /// The target on the flange.
    pub flange_from_target: Pose,
    /// The arm's base as the tracker sees it.
    pub tracker_from_base: Pose,
    /// The changes of the table that are determined.
    pub estimates: Vec<Estimate>,
    /// Covariance of the estimates, in their order (m, rad).
    pub covariance: DMatrix<f64>,
    /// What cannot be told apart.
    pub groups: Vec<Group>,
    /// How well the poses agree with the noise given.
    pub fit: Fit,
    /// What is left of each pose.
    pub residuals: Vec<PoseResidual>,
    /// What the table as it was, with target and tracker fitted alone, leaves of each pose.
    pub residuals_before: Vec<PoseResidual>,
    /// How far off the target's predicted place is to be expected at poses like those measured, by the covariance: root
    /// mean square distance (m), one standard deviation.
    pub target_sigma: f64,
    /// Largest over smallest singular value of the Jacobian of what was sought, with its columns scaled to one length.
    /// Above 100 the poses are badly chosen.
    pub condition: f64,
}

/// Finds how an arm differs from its table.
///
/// # Errors
/// [`CalibrateError`] with too few poses, numbers that are none, turns about one axis only, or poses that do not belong
/// together.
pub fn identify<const N: usize>(
    nominal: &Arm<N>,
    measurements: &[ArmMeasurement<N>],
    noise: &TrackerNoise,
) -> Result<Identified<N>, CalibrateError> {
    let all = parameters(nominal);
    let (found, least) = (measurements.len(), all.len() / 6 + 1);
    if found < least {
        return Err(CalibrateError::TooFew { what: "poses", found, least });
    }
    let pair = |measurement: &ArmMeasurement<N>| PosePair {
        base_from_flange: nominal.forward(&measurement.joints),
        tracker_from_target: measurement.tracker_from_target,
    };
    let pairs: Vec<_> = measurements.iter().map(pair).collect();
    let before = target::calibrate(&pairs, noise)?;
    let frames = Frames { flange_from_target: before.flange_from_target, tracker_from_base: before.tracker_from_base };
    let start = Chain::nominal(nominal, frames);

    let dependences = dependences(&system(&start, &all, measurements, noise).jacobian, |index| willing(&all[index]));
    let is_free = |index: &usize| dependences.iter().all(|dependence| dependence.held != *index);
    let free: Vec<_> = (0..all.len()).filter(is_free).map(|index| all[index]).collect();
    let names = || free.iter().map(Parameter::to_string).collect();
    let linearise = |chain: &Chain<N>| system(chain, &free, measurements, noise);
    let best = gauss_newton(start, names, linearise, |chain, step| chain.moved(&free, step))?;

    let (estimates, covariance) = estimates(&best.state, &free, &best.solved.covariance);
    let residual = |measurement: &ArmMeasurement<N>| {
        let predicted = best.state.frames.predicted(&best.state.base_from_flange(&measurement.joints));
        PoseResidual::between(&measurement.tracker_from_target, &predicted)
    };
    Ok(Identified {
        arm: table::standard(nominal, &best.state.changes),
        flange_from_target: best.state.frames.flange_from_target,
        tracker_from_base: best.state.frames.tracker_from_base,
        estimates,
        groups: groups(&all, &dependences),
        fit: Fit { chi_squared: best.chi_squared, degrees: 6 * found - free.len() },
        residuals: measurements.iter().map(residual).collect(),
        residuals_before: before.residuals,
        target_sigma: target_sigma(&linearise(&best.state).jacobian, &best.solved.covariance, measurements, noise),
        condition: best.solved.condition,
        covariance,
    })
}

/// All that can change: the base, each row's four numbers, a tilt where the next axis is parallel, the target.
pub(super) fn parameters<const N: usize>(arm: &Arm<N>) -> Vec<Parameter> {
    let mut all: Vec<_> = Motion::ALL.map(Parameter::Base).to_vec();
    for (link, row) in arm.dh.iter().enumerate() {
        let parallel = link + 1 < N && row.sin_alpha.abs() < PARALLEL;
        let changes = Change::ALL.into_iter().filter(|change| *change != Change::Tilt || parallel);
        all.extend(changes.map(|change| Parameter::Link { link, change }));
    }
    all.extend(Motion::ALL.map(Parameter::Target));
    all
}

/// How readily a parameter is held: a frame hardly, a row the more readily the later it comes.
fn willing(parameter: &Parameter) -> f64 {
    match parameter {
        Parameter::Base(_) | Parameter::Target(_) => 0.01,
        Parameter::Link { link, .. } => 1.0 + 0.01 * *link as f64,
    }
}

pub(super) fn system<const N: usize>(
    chain: &Chain<N>,
    parameters: &[Parameter],
    measurements: &[ArmMeasurement<N>],
    noise: &TrackerNoise,
) -> System {
    let rows = 6 * measurements.len();
    let (mut jacobian, mut residual) = (DMatrix::zeros(rows, parameters.len()), DVector::zeros(rows));
    for (index, measurement) in measurements.iter().enumerate() {
        let prediction = chain.predicted(&measurement.joints, parameters);
        fill(&mut jacobian, &mut residual, 6 * index, &measurement.tracker_from_target, &prediction, noise);
    }
    System { jacobian, residual }
}

/// Root of the mean over the poses of trace(J·C·Jᵀ), J the rows of the position with their weights taken back.
fn target_sigma<const N: usize>(
    jacobian: &DMatrix<f64>,
    covariance: &DMatrix<f64>,
    measurements: &[ArmMeasurement<N>],
    noise: &TrackerNoise,
) -> f64 {
    let variance = |(index, measurement): (usize, &ArmMeasurement<N>)| {
        let rows = jacobian.fixed_rows::<3>(6 * index);
        let sigma = noise.position_at(&measurement.tracker_from_target.translation);
        (rows * covariance).component_mul(&rows).sum() * sigma * sigma
    };
    (measurements.iter().enumerate().map(variance).sum::<f64>() / measurements.len() as f64).sqrt()
}

/// Of all that was sought, the changes of the table, with their part of the covariance.
fn estimates<const N: usize>(
    chain: &Chain<N>,
    free: &[Parameter],
    covariance: &DMatrix<f64>,
) -> (Vec<Estimate>, DMatrix<f64>) {
    let (mut rows, mut estimates) = (Vec::new(), Vec::new());
    for (row, &parameter) in free.iter().enumerate() {
        if let Parameter::Link { link, change } = parameter {
            let (change, sigma) = (chain.changes[link].of(change), covariance[(row, row)].sqrt());
            estimates.push(Estimate { parameter, change, sigma });
            rows.push(row);
        }
    }
    (estimates, covariance.select_rows(&rows).select_columns(&rows))
}

/// Dependences that share a parameter are one group.
fn groups(all: &[Parameter], dependences: &[Dependence]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for dependence in dependences {
        let with = dependence.with.iter().map(|&index| all[index]);
        let mut group = Group { held: vec![all[dependence.held]], with: with.collect() };
        let shares = |other: &Group| other.with.iter().any(|parameter| group.with.contains(parameter));
        let (joined, apart): (Vec<_>, Vec<_>) = groups.into_iter().partition(shares);
        for other in joined {
            group.held.extend(other.held);
            group.with.extend(other.with);
        }
        groups = apart;
        groups.push(group);
    }
    let place = |parameter: &Parameter| all.iter().position(|other| other == parameter);
    for group in &mut groups {
        group.held.sort_by_key(place);
        group.with.sort_by_key(place);
        group.with.dedup();
    }
    groups.sort_by_key(|group| group.held.first().and_then(place));
    groups
}
