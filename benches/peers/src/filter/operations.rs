//! What a tick of the filter has to compute, counted; docs/estimation.md derives it.

use super::tape::N;
use std::fmt;
use std::ops::{Add, Mul};

/// Counts of arithmetic.
#[derive(Clone, Copy, Debug, Default)]
pub struct Operations {
    /// A product that is added to or taken from something: two operations where the processor does not fuse them.
    multiply_adds: usize,
    /// Other products.
    products: usize,
    /// Other sums and differences.
    sums: usize,
    divisions: usize,
    roots: usize,
}

/// Sine and cosine of one angle, a root aside: argument reduced (k·π/2 in two parts), two polynomials of degree 13 and 14.
const SINE_COSINE: Operations =
    Operations { multiply_adds: 3 + 5 + 5 + 2, products: 6, sums: 3, divisions: 0, roots: 0 };

impl Operations {
    const fn new(multiply_adds: usize, products: usize, sums: usize) -> Self {
        Self { multiply_adds, products, sums, divisions: 0, roots: 0 }
    }

    /// All, each as one.
    pub fn operations(&self) -> f64 {
        (2 * self.multiply_adds + self.products + self.sums + self.divisions + self.roots) as f64
    }
}

/// Of a prediction, a pose and joint rates, with every symmetric matrix computed once.
pub fn necessary() -> Operations {
    let pairs = N * (N + 1) / 2;
    let state = Operations::new(6 * N, 0, 0);
    let step = Operations::new(6 * N * N + 3 * pairs + 6 * N, 0, 3 * pairs);
    // A product of rotations, and a rotated vector.
    let (turn, point) = (Operations::new(18, 9, 0), Operations::new(6, 3, 0));
    // A link: five vectors that are sums of two products, one of them added to the place; a joint: two cross products and levers.
    let link = SINE_COSINE + Operations::new(3 * 6, 3 * 4, 0);
    let joint = (Operations::new(3, 3, 0) + Operations::new(0, 0, 3)) * 2;
    // To the base frame, on to the target, the difference, whether it is a rotation, and its rotation vector.
    let poses = (turn + point) * 2
        + turn
        + point
        + Operations::new(12, 6, 9)
        + Operations { roots: 1, divisions: 2, ..Operations::new(15, 6, 6) };
    let spread = Operations::new(6 * 3 * N * N + pairs_of(6) * N, 0, 0) + Operations::new(2, 4, 10);
    let rates = Operations::new(N, 0, N);
    state + step + (link + joint) * N + poses + spread + update(6) + rates + update(N)
}

/// Of an update by M numbers, given H·P and S.
fn update(rows: usize) -> Operations {
    let below = rows * (rows - 1) / 2;
    // Row k, k from 1, gives a multiple of itself to each row behind it.
    let factor: usize = (1..rows).map(|k| k * (rows - k)).sum();
    let factor = Operations { divisions: rows, ..Operations::new(factor, below, 0) };
    let innovation = Operations::new(below + rows, rows, 0);
    let separate = Operations::new(below * 3 * N, 0, 0);
    let state = Operations::new(rows * 3 * N, 0, 0);
    let covariance = Operations::new(rows * pairs_of(3 * N), rows * 3 * N, 0);
    factor + innovation + separate + state + covariance
}

/// Entries on and above the diagonal.
const fn pairs_of(count: usize) -> usize {
    count * (count + 1) / 2
}

impl Add for Operations {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            multiply_adds: self.multiply_adds + other.multiply_adds,
            products: self.products + other.products,
            sums: self.sums + other.sums,
            divisions: self.divisions + other.divisions,
            roots: self.roots + other.roots,
        }
    }
}

impl Mul<usize> for Operations {
    type Output = Self;

    fn mul(self, times: usize) -> Self {
        (0..times).fold(Self::default(), |sum, _| sum + self)
    }
}

impl fmt::Display for Operations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { multiply_adds, products, sums, divisions, roots } = self;
        write!(
            f,
            "{multiply_adds} multiply-adds, {products} products, {sums} sums, {divisions} divisions, {roots} root; {} operations",
            self.operations()
        )
    }
}
