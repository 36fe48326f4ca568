//! How well an arm can move in every direction where it stands.

use crate::arm::Jacobian;
use core::array;

/// Sweeps of the Jacobi method at most. It converges quadratically: matrices of this size take about seven.
pub const SWEEPS_MAX: usize = 30;
/// Cosine of the angle between two rows from which they count as square to each other: the rounding of a dot product.
const SQUARE: f64 = 1e-15;

/// What the singular values of a Jacobian say. They mix m and rad, so they compare poses of one arm, not arms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dexterity {
    /// Yoshikawa's measure, "Manipulability of Robotic Mechanisms" (IJRR 4(2), 1985): √det(J·Jᵀ), the product of the
    /// singular values; with fewer than six joints √det(Jᵀ·J). Zero at a singularity.
    pub manipulability: f64,
    /// Smallest singular value: the distance to the nearest Jacobian that is singular.
    pub singular_value_min: f64,
    /// Largest singular value.
    pub singular_value_max: f64,
}

impl Dexterity {
    /// Of a Jacobian; not a number where it holds one.
    ///
    /// The singular values come by one-sided Jacobi rotations (Hestenes, "Inversion of Matrices by Biorthogonalization",
    /// 1958), which keeps small ones accurate; the determinant of J·Jᵀ would lose half the digits near a singularity.
    pub fn of<const N: usize>(jacobian: &Jacobian<N>) -> Self {
        let columns = jacobian.data.0;
        if N < 6 {
            Self::of_rows(columns)
        } else {
            let row = |row: usize| columns.map(|column| column.get(row).copied().unwrap_or(f64::NAN));
            Self::of_rows::<6, N>(array::from_fn(row))
        }
    }

    /// Largest over smallest singular value; infinite at a singularity.
    pub fn condition(&self) -> f64 {
        self.singular_value_max / self.singular_value_min
    }

    fn of_rows<const R: usize, const C: usize>(mut rows: [[f64; C]; R]) -> Self {
        for _ in 0..SWEEPS_MAX {
            if !sweep(&mut rows) {
                break;
            }
        }
        let mut found = Self { manipulability: 1.0, singular_value_min: f64::INFINITY, singular_value_max: 0.0 };
        for row in &rows {
            let value = libm::sqrt(dot(row, row));
            found.manipulability *= value;
            // Written so that what is not a number stays in sight.
            found.singular_value_min = if value >= found.singular_value_min { found.singular_value_min } else { value };
            found.singular_value_max = if value <= found.singular_value_max { found.singular_value_max } else { value };
        }
        found
    }
}

/// Turns each pair of rows in their plane until they are square to each other; whether any needed it.
fn sweep<const R: usize, const C: usize>(rows: &mut [[f64; C]; R]) -> bool {
    let mut turned = false;
    let mut rest = rows.as_mut_slice();
    for _ in 0..R {
        let Some((first, others)) = rest.split_first_mut() else { break };
        for other in others.iter_mut() {
            turned |= make_square(first, other);
        }
        rest = others;
    }
    turned
}

/// The rotation after Rutishauser ("The Jacobi Method for Real Symmetric Matrices", 1966): the smaller of the two angles.
fn make_square<const C: usize>(p: &mut [f64; C], q: &mut [f64; C]) -> bool {
    let (pp, qq, pq) = (dot(p, p), dot(q, q), dot(p, q));
    let skewed = libm::fabs(pq) > SQUARE * libm::sqrt(pp) * libm::sqrt(qq);
    if !skewed {
        return false;
    }
    let cotangent = (qq - pp) / (2.0 * pq);
    let sign = if cotangent < 0.0 { -1.0 } else { 1.0 };
    let tangent = sign / (libm::fabs(cotangent) + libm::sqrt(1.0 + cotangent * cotangent));
    let cos = 1.0 / libm::sqrt(1.0 + tangent * tangent);
    let sin = cos * tangent;
    for (p, q) in p.iter_mut().zip(q) {
        (*p, *q) = (cos * *p - sin * *q, sin * *p + cos * *q);
    }
    true
}

fn dot<const C: usize>(a: &[f64; C], b: &[f64; C]) -> f64 {
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        sum += a * b;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arms::ur::UR10E;
    use crate::units::JointPos;

    /// Against singular values by another method, of matrices without structure.
    fn agrees_with_nalgebra<const N: usize>() {
        for k in 0..200 {
            let jacobian = Jacobian::<N>::from_fn(|r, c| libm::sin(((k * 54 + r * 9 + c) % 1009).pow(2) as f64));
            let found = Dexterity::of(&jacobian);
            let gram = jacobian * jacobian.transpose();
            let mut values: [f64; 6] = gram.symmetric_eigenvalues().map(|value| libm::sqrt(value.max(0.0))).into();
            values.sort_unstable_by(|a, b| b.total_cmp(a));
            let values = &values[..N.min(6)];
            let product: f64 = values.iter().product();
            assert!((found.manipulability - product).abs() < 1e-7 * (1.0 + product), "{found:?} {values:?}");
            assert!((found.singular_value_max - values[0]).abs() < 1e-12, "{found:?} {values:?}");
            assert!((found.singular_value_min - values[values.len() - 1]).abs() < 1e-6, "{found:?} {values:?}");
        }
    }

    #[test]
    fn singular_values_are_those_of_another_method() {
        agrees_with_nalgebra::<3>();
        agrees_with_nalgebra::<6>();
        agrees_with_nalgebra::<9>();
    }

    /// A UR's determinant has the factors sin θ₃ and sin θ₅: with one of them small, the measure is proportional to it.
    #[test]
    fn near_a_singularity_the_measure_falls_as_the_sine_does() {
        for joint in [2, 4] {
            let at = |angle: f64| {
                let mut joints = JointPos([0.3, -1.1, 1.3, -0.4, 0.9, 0.2]);
                joints.0[joint] = angle;
                Dexterity::of(&UR10E.jacobian(&joints).1).manipulability
            };
            let scale = at(1e-4) / 1e-4;
            for (angle, tolerance) in [(1e-6, 1e-3), (1e-9, 1e-3), (1e-12, 1e-2)] {
                let ratio = at(angle) / (scale * angle);
                assert!((ratio - 1.0).abs() < tolerance, "joint {joint} at {angle}: {ratio}");
            }
            assert!(at(0.0) < 1e-15);
        }
    }

    #[test]
    fn what_is_no_number_is_not_hidden() {
        let mut jacobian = Jacobian::<6>::identity();
        assert_eq!(Dexterity::of(&jacobian).condition(), 1.0);
        jacobian[(2, 3)] = f64::NAN;
        let found = Dexterity::of(&jacobian);
        assert!(found.manipulability.is_nan());
        assert!(Dexterity::of(&Jacobian::<6>::zeros()).condition().is_nan());
        jacobian[(2, 3)] = 0.0;
        jacobian[(5, 5)] = 0.0;
        assert_eq!(Dexterity::of(&jacobian).condition(), f64::INFINITY);
    }
}
