//! Seeded joint vectors.

use super::description::Link;
use screed_kernel::arm::{Arm, JointKind};
use std::f64::consts::PI;

/// SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014): the same numbers for the same
/// seed everywhere.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Numbers that follow from `seed`.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64)
    }

    /// Joints within the limits; one without limits within a turn either way.
    pub fn joints<const N: usize>(&mut self, arm: &Arm<N>) -> [f64; N] {
        std::array::from_fn(|joint| {
            let revolute = arm.joints[joint].kind == JointKind::Revolute;
            self.within(arm.position_min.0[joint], arm.position_max.0[joint], revolute)
        })
    }

    /// Likewise for an arm whose joints are counted at run time.
    pub fn positions(&mut self, links: &[Link]) -> Vec<f64> {
        let one = |link: &Link| self.within(link.position_min, link.position_max, link.is_revolute());
        links.iter().map(one).collect()
    }

    fn within(&mut self, low: f64, high: f64, revolute: bool) -> f64 {
        let turn = if revolute { PI } else { 1.0 };
        self.between(if low.is_finite() { low } else { -turn }, if high.is_finite() { high } else { turn })
    }
}
