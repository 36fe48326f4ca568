//! A damped oscillator, solved exactly.

use super::SUBSTEP;

/// ẍ = −ω²·x − 2ζω·ẋ + f.
#[derive(Clone, Debug)]
pub(super) struct Mode {
    pub value: f64,
    pub rate: f64,
    /// What a substep makes of value and rate: exp(A·h), A = [0, 1; −ω², −2ζω].
    transition: [[f64; 2]; 2],
    stiffness: f64,
}

impl Mode {
    /// At rest there; frequency ω in rad/s, any damping ratio ζ of 0 or more.
    pub fn at(frequency: f64, damping: f64, value: f64) -> Self {
        let stiffness = frequency * frequency;
        let a = [[0.0, SUBSTEP], [-stiffness * SUBSTEP, -2.0 * damping * frequency * SUBSTEP]];
        // The series of the exponential; its terms fall by |A·h|/n, and |A·h| is below 1 for all that is slower than 500 Hz.
        let (mut transition, mut term) = ([[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 1.0]]);
        for n in 1..=20 {
            let [[p, q], [r, s]] = term;
            let times = |x: f64, y: f64| [x * a[0][0] + y * a[1][0], x * a[0][1] + y * a[1][1]];
            term = [times(p, q), times(r, s)].map(|row| row.map(|value| value / f64::from(n)));
            for (sum, row) in transition.iter_mut().zip(&term) {
                for (sum, value) in sum.iter_mut().zip(row) {
                    *sum += value;
                }
            }
        }
        Self { value, rate: 0.0, transition, stiffness }
    }

    /// One substep with f constant: beside f/ω², where it would rest, the motion is free.
    pub fn step(&mut self, force: f64) {
        let rest = force / self.stiffness;
        let (x, v) = (self.value - rest, self.rate);
        let [[p, q], [r, s]] = self.transition;
        (self.value, self.rate) = (rest + p * x + q * v, r * x + s * v);
    }
}
