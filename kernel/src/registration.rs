//! Where one frame lies in another, from points measured in both: least squares over pairs.
//!
//! With q and p the points of a pair in the outer and the inner frame, seen from the centroids of all, the rotation
//! that makes Σ|q − R·p|² least is U·diag(1, 1, det(U·Vᵀ))·Vᵀ of H = Σ q·pᵀ = U·diag(σ)·Vᵀ; the translation takes one
//! centroid to the other. Sources: Veldpaus, Woltring, Dortmans, "A least-squares algorithm for the equiform
//! transformation from spatial marker co-ordinates", J. Biomechanics 21(1), 1988 (with the scale held at 1); Umeyama,
//! "Least-squares estimation of transformation parameters between two point patterns", IEEE PAMI 13(4), 1991, for the
//! sign that keeps R from being a mirror image.
//!
//! How well a turn is held: the cost's second derivative for a turn about a left singular vector is the sum of the other
//! two singular values, σ₃ with the sign above. For pairs that fit, it is the sum of squares of the points' distances
//! from that axis, which gives the lever of [`Registration::levers`].

use crate::pose::Pose;
use nalgebra::{Matrix3, Matrix6, Vector3};

/// The fewest points that hold a frame.
pub const PAIRS_MIN: usize = 3;
/// A coordinate farther out (m) is taken for a slip; within it no sum of squares can overflow.
pub const COORDINATE_MAX: f64 = 1e6;
/// Points less far from their centroid (m, root mean square) are one point.
pub const SPREAD_MIN: f64 = 1e-9;
/// A lever shorter than this share of the points' spread does not hold a turn: rounding alone would turn the frame by
/// 1e-8 rad.
pub const LEVER_SHARE_MIN: f64 = 1e-4;

/// Sweeps of the singular value decomposition, always as many: [`decompose`] has converged to rounding after four.
const SWEEPS: usize = 8;

/// One point, measured in both frames (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointPair {
    /// In the outer frame, in which the inner frame's pose is sought.
    pub in_outer: Vector3<f64>,
    /// In the inner frame.
    pub in_inner: Vector3<f64>,
}

/// Why there is no pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RegistrationError {
    /// Fewer than [`PAIRS_MIN`] pairs.
    TooFew {
        /// How many there are.
        found: usize,
    },
    /// A coordinate is NaN, infinite or beyond [`COORDINATE_MAX`].
    Coordinate {
        /// The pair (0 is the first).
        pair: usize,
    },
    /// In one of the frames all points are in one place.
    Coincident {
        /// Their root mean square distance from the centroid (m).
        spread: f64,
    },
    /// The points lie on a line: nothing holds the turn about it.
    Collinear {
        /// The line's direction in the outer frame.
        axis_in_outer: Vector3<f64>,
        /// What holds that turn (m): root mean square distance of the points from the line.
        lever: f64,
    },
    /// The points are not on a line, yet several turns fit equally well: the pairs do not belong together, or one set
    /// is the mirror image of the other and round.
    Ambiguous {
        /// An axis in the outer frame about which any turn fits.
        axis_in_outer: Vector3<f64>,
    },
}

/// A frame found from pairs of points, and how well they hold it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// The inner frame in the outer one.
    pub outer_from_inner: Pose,
    /// How many pairs there were.
    pub count: usize,
    /// Root mean square of the pairs' distances after the fit (m).
    pub residual_rms: f64,
    /// The largest of them (m).
    pub residual_max: f64,
    /// The pair (0 is the first) that has it.
    pub residual_max_pair: usize,
    /// The root mean square distance that the best mirror image would leave (m). Clearly less than `residual_rms`: one
    /// set of points is left-handed, or points are swapped. For points in a plane both are equal.
    pub mirrored_rms: f64,
    /// The axes about which the pairs hold a turn worst, next and best: columns, unit vectors in the outer frame,
    /// right-handed.
    pub axes_in_outer: Matrix3<f64>,
    /// Root mean square distance of the points from each of these axes through the centroid (m): noise of σ in every
    /// coordinate of a pair turns the frame about it by σ/(lever·√count) rad, one standard deviation.
    pub levers: Vector3<f64>,
    /// Mean of the points in the inner frame (m): where the translation is held best.
    pub centroid_in_inner: Vector3<f64>,
}

/// The pose of the inner frame that brings the pairs together in the sense of least squares, all with the same weight.
/// Work is proportional to the count of pairs, plus a constant.
///
/// # Errors
/// [`RegistrationError`] when the pairs do not determine a pose.
pub fn register(pairs: &[PointPair]) -> Result<Registration, RegistrationError> {
    let count = pairs.len();
    if count < PAIRS_MIN {
        return Err(RegistrationError::TooFew { found: count });
    }
    let inside = |point: &Vector3<f64>| point.iter().all(|value| libm::fabs(*value) <= COORDINATE_MAX);
    if let Some(pair) = pairs.iter().position(|pair| !(inside(&pair.in_outer) && inside(&pair.in_inner))) {
        return Err(RegistrationError::Coordinate { pair });
    }
    let n = count as f64;
    let (mut outer, mut inner) = (Vector3::zeros(), Vector3::zeros());
    for pair in pairs {
        outer += pair.in_outer;
        inner += pair.in_inner;
    }
    let (outer, inner) = (outer / n, inner / n);
    let (mut moment, mut spread_outer, mut spread_inner) = (Matrix3::zeros(), 0.0, 0.0);
    for pair in pairs {
        let (q, p) = (pair.in_outer - outer, pair.in_inner - inner);
        moment += q * p.transpose();
        spread_outer += q.norm_squared();
        spread_inner += p.norm_squared();
    }
    let (spread_outer, spread_inner) = (libm::sqrt(spread_outer / n), libm::sqrt(spread_inner / n));
    let spread = spread_outer.min(spread_inner);
    if spread < SPREAD_MIN {
        return Err(RegistrationError::Coincident { spread });
    }
    let scale = spread_outer * spread_inner;
    let fit = Fit::new(&(moment / (n * scale)), scale)?;
    let mut registration = Registration {
        outer_from_inner: Pose { rotation: fit.rotation, translation: outer - fit.rotation * inner },
        count,
        residual_rms: 0.0,
        residual_max: 0.0,
        residual_max_pair: 0,
        mirrored_rms: 0.0,
        axes_in_outer: fit.axes,
        levers: fit.levers,
        centroid_in_inner: inner,
    };
    let (mut sum, mut sum_mirrored) = (0.0, 0.0);
    for (index, pair) in pairs.iter().enumerate() {
        let squared = registration.residual(pair).norm_squared();
        sum += squared;
        if squared > registration.residual_max {
            (registration.residual_max, registration.residual_max_pair) = (squared, index);
        }
        sum_mirrored += (pair.in_outer - outer - fit.mirror * (pair.in_inner - inner)).norm_squared();
    }
    registration.residual_rms = libm::sqrt(sum / n);
    registration.residual_max = libm::sqrt(registration.residual_max);
    registration.mirrored_rms = libm::sqrt(sum_mirrored / n);
    Ok(registration)
}

impl Registration {
    /// What is left of a pair (m, in the outer frame): its point there, less its point in the inner frame put in place.
    pub fn residual(&self, pair: &PointPair) -> Vector3<f64> {
        pair.in_outer - self.outer_from_inner.transform_point(&pair.in_inner)
    }

    /// The noise that the residuals show (m): standard deviation of one coordinate of a pair, unbiased in its square.
    /// Six of the 3·count coordinates went into the pose.
    pub fn sigma(&self) -> f64 {
        let n = self.count as f64;
        self.residual_rms * libm::sqrt(n / (3.0 * n - 6.0))
    }

    /// Covariance of the pose, to first order, when every coordinate of every pair (the outer point less the inner one
    /// put in place) has independent noise of the standard deviation `sigma` (m). Rows and columns: translation (m),
    /// then the rotation vector (rad) of the turn left to do, both in the outer frame: R_true = exp(φ)·R, t_true = t +
    /// τ.
    ///
    /// The centroid's place and the turn about it are independent; the inner origin's place adds the turn's lever.
    pub fn covariance(&self, sigma: f64) -> Matrix6<f64> {
        let n = self.count as f64;
        let variance = sigma * sigma;
        let weights = self.levers.map(|lever| variance / (n * lever * lever));
        let rotation = self.axes_in_outer * Matrix3::from_diagonal(&weights) * self.axes_in_outer.transpose();
        // τ = τ_centroid − φ × (R·centroid)
        let lever = (self.outer_from_inner.rotation * self.centroid_in_inner).cross_matrix();
        let cross = lever * rotation;
        let translation = Matrix3::from_diagonal_element(variance / n) + cross * lever.transpose();
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&translation);
        covariance.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
        covariance
    }
}

/// What the pairs' moment matrix says.
struct Fit {
    rotation: Matrix3<f64>,
    /// The best orthogonal matrix of the other handedness.
    mirror: Matrix3<f64>,
    axes: Matrix3<f64>,
    levers: Vector3<f64>,
}

impl Fit {
    /// `moment` is Σ q·pᵀ divided by count and `scale`, the product of both spreads, so that no singular value is above
    /// 1.
    fn new(moment: &Matrix3<f64>, scale: f64) -> Result<Self, RegistrationError> {
        let [first, second, third] = decompose(moment);
        let least = LEVER_SHARE_MIN * LEVER_SHARE_MIN;
        let (sigma1, sigma2) = (first.image.norm(), second.image.norm());
        if sigma1 <= least {
            return Err(RegistrationError::Ambiguous { axis_in_outer: Vector3::x() });
        }
        let u1 = first.image / sigma1;
        if sigma2 <= least {
            return Err(RegistrationError::Collinear { axis_in_outer: u1, lever: libm::sqrt(sigma2 * scale) });
        }
        let square = second.image - u1 * u1.dot(&second.image);
        let u2 = square / square.norm();
        let u3 = u1.cross(&u2);
        let (v1, v2) = (first.source, second.source);
        let v3 = v1.cross(&v2);
        // Signed: negative where the best orthogonal matrix would be a mirror image.
        let sigma3 = u3.dot(&third.image) * v3.dot(&third.source);
        if sigma2 + sigma3 <= least {
            return Err(RegistrationError::Ambiguous { axis_in_outer: u1 });
        }
        let levers =
            Vector3::new(sigma2 + sigma3, sigma1 + sigma3, sigma1 + sigma2).map(|held| libm::sqrt(held * scale));
        let plane = u1 * v1.transpose() + u2 * v2.transpose();
        let third = u3 * v3.transpose();
        Ok(Self { rotation: plane + third, mirror: plane - third, axes: Matrix3::from_columns(&[u1, u2, u3]), levers })
    }
}

/// A right singular vector, and what the matrix makes of it: the left one times the singular value.
#[derive(Clone, Copy)]
struct Column {
    source: Vector3<f64>,
    image: Vector3<f64>,
}

/// Singular value decomposition, largest value first, by one-sided Jacobi rotations (Hestenes, "Inversion of matrices
/// by biorthogonalization and related results", J. SIAM 6(1), 1958): pairs of columns are turned until their images are
/// square to each other. The count of sweeps is fixed, so is the time it takes.
fn decompose(matrix: &Matrix3<f64>) -> [Column; 3] {
    let column = |source: Vector3<f64>| Column { source, image: matrix * source };
    let (mut a, mut b, mut c) = (column(Vector3::x()), column(Vector3::y()), column(Vector3::z()));
    for _ in 0..SWEEPS {
        make_square(&mut a, &mut b);
        make_square(&mut a, &mut c);
        make_square(&mut b, &mut c);
    }
    order(&mut a, &mut b);
    order(&mut b, &mut c);
    order(&mut a, &mut b);
    [a, b, c]
}

/// Turns two columns in their plane, by at most an eighth of a turn, so that their images are square to each other.
fn make_square(a: &mut Column, b: &mut Column) {
    let product = a.image.dot(&b.image);
    if product == 0.0 {
        return;
    }
    let zeta = (b.image.norm_squared() - a.image.norm_squared()) / (2.0 * product);
    let root = libm::fabs(zeta) + libm::hypot(1.0, zeta);
    let tangent = if zeta < 0.0 { -1.0 / root } else { 1.0 / root };
    let cosine = 1.0 / libm::sqrt(1.0 + tangent * tangent);
    let sine = cosine * tangent;
    let turned = |a: Vector3<f64>, b: Vector3<f64>| (a * cosine - b * sine, a * sine + b * cosine);
    (a.image, b.image) = turned(a.image, b.image);
    (a.source, b.source) = turned(a.source, b.source);
}

fn order(large: &mut Column, small: &mut Column) {
    if large.image.norm_squared() < small.image.norm_squared() {
        core::mem::swap(large, small);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SplitMix64, as a number in [-1, 1).
    fn number(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// How far (relative to the largest singular value) the columns are from a decomposition of the matrix.
    fn miss(matrix: &Matrix3<f64>, columns: &[Column; 3]) -> f64 {
        let sources = Matrix3::from_columns(&[columns[0].source, columns[1].source, columns[2].source]);
        let images = Matrix3::from_columns(&[columns[0].image, columns[1].image, columns[2].image]);
        let largest = columns[0].image.norm();
        let orthonormal = (sources.transpose() * sources - Matrix3::identity()).amax();
        let mapped = (matrix * sources - images).amax() / largest;
        let mut miss = orthonormal.max(mapped);
        for (j, k) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b) = (columns[j].image, columns[k].image);
            assert!(a.norm() >= b.norm());
            // As the angle to a right one, where the shorter column is more than rounding.
            if b.norm() > 1e-13 * largest {
                miss = miss.max((a.dot(&b) / (a.norm() * b.norm())).abs() * (b.norm() / largest));
            }
        }
        miss
    }

    #[test]
    fn the_decomposition_has_converged_whatever_the_matrix() {
        let mut state = 7;
        let mut worst = 0.0_f64;
        for case in 0..200_000 {
            let mut matrix = Matrix3::from_fn(|_, _| number(&mut state));
            let grade = [1.0, 1e-2, 1e-4, 1e-8, 0.0][case % 5];
            match case / 5 % 4 {
                0 => {}
                1 => matrix.set_column(2, &(matrix.column(0) + matrix.column(1) + matrix.column(2) * grade)),
                2 => matrix.set_row(1, &(matrix.row(0) * -2.0 + matrix.row(1) * grade)),
                // Singular values nearly alike: the turn is hardly determined.
                _ => matrix = matrix * (1e-9 * grade) + Matrix3::identity(),
            }
            worst = worst.max(miss(&matrix, &decompose(&matrix)));
        }
        assert!(worst < 4e-15, "{worst:e}");
        let zero = decompose(&Matrix3::zeros());
        assert!(zero.iter().all(|column| column.image == Vector3::zeros()));
    }
}
