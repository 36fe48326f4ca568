//! Weighted least squares: a linear system solved with its columns scaled, and Gauss–Newton on top of it.

use super::CalibrateError;
use nalgebra::{DMatrix, DVector};

/// Steps that Gauss–Newton may make; from a sound start it needs four or five.
const STEPS_MAX: usize = 50;
/// Halvings of one step that makes the fit worse.
const HALVINGS_MAX: i32 = 20;
/// A step that would change all predictions together by less than this share of the noise and of the residuals is the
/// last one: with quadratic convergence what remains is its square.
const CHANGE_MIN: f64 = 1e-5;

/// Singular values of the column-scaled Jacobian that span more are those of a singular one, and rounding.
const CONDITION_MAX: f64 = 1e12;

/// A model near a state: residuals (measured less predicted) and how the predictions change with each parameter, both
/// divided by the measurements' standard deviations.
pub(super) struct System {
    /// A row for each measured number, a column for each parameter.
    pub jacobian: DMatrix<f64>,
    /// A row for each measured number.
    pub residual: DVector<f64>,
}

/// What a [`System`] says.
pub(super) struct Solved {
    /// What to add to the parameters.
    pub step: DVector<f64>,
    /// Covariance of the parameters: (JᵀJ)⁻¹.
    pub covariance: DMatrix<f64>,
    /// Largest over smallest singular value of the column-scaled Jacobian.
    pub condition: f64,
}

impl System {
    /// Residuals' sum of squares.
    pub fn chi_squared(&self) -> f64 {
        self.residual.norm_squared()
    }

    /// The least-squares step; `None` when the parameters are not determined ([`CONDITION_MAX`]).
    pub fn solved(&self) -> Option<Solved> {
        let lengths = column_lengths(&self.jacobian);
        // A matrix with a number that is none would keep the decomposition busy for ever.
        if !lengths.iter().all(|length| *length > 0.0 && length.is_finite()) {
            return None;
        }
        let mut scaled = self.jacobian.clone();
        for (mut column, length) in scaled.column_iter_mut().zip(&lengths) {
            column /= *length;
        }
        // Steps by orthogonal triangles, which keep all digits; nalgebra's singular vectors may lose three.
        let qr = scaled.qr();
        let triangle = qr.r();
        let values = triangle.singular_values();
        let condition = values.max() / values.min();
        if condition.is_nan() || condition > CONDITION_MAX {
            return None;
        }
        let mut step = triangle.solve_upper_triangular(&qr.q().tr_mul(&self.residual))?;
        step.component_div_assign(&lengths);
        let size = triangle.ncols();
        let inverse = triangle.solve_upper_triangular(&DMatrix::identity(size, size))?;
        let mut covariance = &inverse * inverse.transpose();
        for (row, a) in lengths.iter().enumerate() {
            for (column, b) in lengths.iter().enumerate() {
                covariance[(row, column)] /= a * b;
            }
        }
        Some(Solved { step, covariance, condition })
    }
}

/// The columns' lengths: by how many standard deviations all measurements together change with one unit of a parameter.
pub(super) fn column_lengths(jacobian: &DMatrix<f64>) -> DVector<f64> {
    DVector::from_iterator(jacobian.ncols(), jacobian.column_iter().map(|column| column.norm()))
}

/// Where Gauss–Newton came to rest.
pub(super) struct Converged<S> {
    /// The best state.
    pub state: S,
    /// Its covariance and conditioning.
    pub solved: Solved,
    /// Its residuals' sum of squares.
    pub chi_squared: f64,
}

/// Gauss–Newton with step halving: `linearise` gives the system at a state, `moved` adds a step to a state.
///
/// # Errors
/// [`CalibrateError::NotConverged`] when no part of a step helps, or after [`STEPS_MAX`];
/// [`CalibrateError::Undetermined`] with the names when the system is singular.
pub(super) fn gauss_newton<S>(
    start: S,
    names: impl Fn() -> Vec<String>,
    linearise: impl Fn(&S) -> System,
    moved: impl Fn(&S, &DVector<f64>) -> S,
) -> Result<Converged<S>, CalibrateError> {
    let mut state = start;
    let mut system = linearise(&state);
    for iterations in 1..=STEPS_MAX {
        let Some(solved) = system.solved() else {
            return Err(CalibrateError::Undetermined { parameters: names() });
        };
        let chi_squared = system.chi_squared();
        let change = (&system.jacobian * &solved.step).norm();
        if change <= CHANGE_MIN * (1.0 + chi_squared.sqrt()) {
            state = moved(&state, &solved.step);
            let chi_squared = linearise(&state).chi_squared();
            return Ok(Converged { state, solved, chi_squared });
        }
        let halves = (0..HALVINGS_MAX).map(|halvings| &solved.step * 0.5_f64.powi(halvings));
        let better = halves.map(|step| moved(&state, &step)).map(|next| (linearise(&next), next));
        let Some((at_next, next)) = better.into_iter().find(|(at_next, _)| at_next.chi_squared() < chi_squared) else {
            return Err(not_converged(iterations, &system));
        };
        (state, system) = (next, at_next);
    }
    Err(not_converged(STEPS_MAX, &system))
}

fn not_converged(iterations: usize, system: &System) -> CalibrateError {
    CalibrateError::NotConverged {
        iterations,
        noise_ratio: (system.chi_squared() / system.residual.len() as f64).sqrt(),
    }
}
