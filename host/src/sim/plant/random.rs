//! Seeded numbers, the same on every machine.

use nalgebra::Vector3;

/// Even numbers from SplitMix64 of the tape, normal ones from those.
#[derive(Clone, Debug)]
pub(super) struct Random(screed_tape::random::Random);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(screed_tape::random::Random(seed))
    }

    /// Even in between.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0.between(low, high)
    }

    /// Normal, mean 0 and standard deviation 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.between(0.0, 1.0)));
        radius * libm::cos(self.between(0.0, std::f64::consts::TAU))
    }

    /// Three normal numbers.
    pub fn normals(&mut self, deviation: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| deviation * self.normal())
    }

    /// Of length 1, in any direction alike.
    pub fn direction(&mut self) -> Vector3<f64> {
        self.normals(1.0).normalize()
    }

    /// Time to the next of events that come with this mean interval, each whenever it will (exponential).
    pub fn wait(&mut self, mean: f64) -> f64 {
        -mean * libm::log(1.0 - self.between(0.0, 1.0))
    }
}
