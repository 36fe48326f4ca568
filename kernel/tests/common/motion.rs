//! What random programs ask the small arm to do, and who judges what it does.

use super::Random;
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::guard::Motion;
use screed_kernel::ramp::{Ramp, RampLimits};
use screed_kernel::setpoint::{JOINT_QUANTUM, Setpoint, flow_on_grid, joint_on_grid};
use screed_kernel::tick::Command;
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel};

pub const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.02, velocity_max: 0.05, acceleration_max: 0.5 };
/// One joint whose stops are felt most as acceleration, one whose jerks are.
pub const PLAN: Motion<2> = Motion {
    velocity_max: JointVel([1.5, 1.0]),
    acceleration_max: JointAcc([3.0, 12.0]),
    jerk_max: JointJerk([40.0, 400.0]),
};
/// Sample and tick periods (ns).
pub const PERIODS_NS: [(u64, u64); 12] = [
    (8_000_000, 8_000_000),
    (8_000_000, 4_000_000),
    (8_000_000, 2_000_000),
    (8_000_000, 1_000_000),
    (6_000_000, 2_000_000),
    (5_000_000, 1_000_000),
    (7_000_000, 1_000_000),
    (2_000_000, 2_000_000),
    (2_000_000, 1_000_000),
    (3_000_000, 1_000_000),
    (1_000_000, 1_000_000),
    (11_000_000, 1_000_000),
];
/// The joints' range (rad), such that motions come to its ends.
pub const POSITION_MAX: f64 = 1.3;

/// Judges outputs by their own differences, against the limits they were configured with. Shares no code with the guard.
#[derive(Clone)]
pub struct Judge {
    pub limits: Motion<2>,
    pub period: f64,
    pub last: Option<[[f64; 2]; 3]>,
    /// Largest share of each limit that was used: speed, acceleration, jerk.
    pub used: [f64; 3],
}

impl Judge {
    pub fn see(&mut self, command: &Command<2>) {
        let Some(JointPos(q)) = command.joints else {
            self.last = None;
            return;
        };
        let [a, b, c] = self.last.unwrap_or([q; 3]);
        let h = self.period;
        for j in 0..2 {
            assert!(q[j].is_finite() && q[j].abs() <= POSITION_MAX, "joint {j} at {}", q[j]);
            let differences = [
                ((q[j] - a[j]) / h, self.limits.velocity_max.0[j]),
                ((q[j] - 2.0 * a[j] + b[j]) / (h * h), self.limits.acceleration_max.0[j]),
                ((q[j] - 3.0 * a[j] + 3.0 * b[j] - c[j]) / (h * h * h), self.limits.jerk_max.0[j]),
            ];
            for (k, (value, limit)) in differences.into_iter().enumerate() {
                let rounding = 4.0 * JOINT_QUANTUM / h.powi(k as i32 + 1);
                assert!(value.abs() <= limit + rounding, "joint {j}, difference {}: {value} above {limit}", k + 1);
                self.used[k] = self.used[k].max((value.abs() - rounding) / limit);
            }
        }
        self.last = Some([q, a, b]);
    }
}

/// Motion along which a batch can be left at any sample: speeds that go to random targets as fast as the limits allow.
#[derive(Clone, Copy)]
pub struct Source {
    pub q: [f64; 2],
    pub v: [Ramp; 2],
    pub flow: f64,
}

impl Source {
    pub fn at_rest(q: [f64; 2]) -> Self {
        Self { q, v: [Ramp::at(0.0); 2], flow: 0.0 }
    }

    fn step(&mut self, targets: [f64; 2], flow: f64, period: f64) -> Setpoint<2> {
        for (j, target) in targets.into_iter().enumerate() {
            let (slope_max, curvature_max) = (PLAN.acceleration_max.0[j], PLAN.jerk_max.0[j]);
            self.v[j].step(target, &RampLimits { slope_max, curvature_max }, period);
            self.q[j] += self.v[j].value * period;
        }
        self.flow = flow_on_grid(flow);
        Setpoint { joints: JointPos(self.q.map(joint_on_grid)), flow: self.flow, deposit: flow > 0.0 }
    }

    /// Speeds towards random places near the middle, often the highest.
    fn targets(&self, random: &mut Random) -> [f64; 2] {
        std::array::from_fn(|j| {
            let speed = PLAN.velocity_max.0[j] * [1.0, random.between(0.0, 1.0)][random.below(2) as usize];
            if self.q[j] > random.between(-1.0, 1.0) { -speed } else { speed }
        })
    }

    /// A random piece of motion and its stop tail, with the source as it was behind every sample.
    pub fn batch(mut self, random: &mut Random, period: f64) -> Vec<(Setpoint<2>, Self)> {
        let mut samples = Vec::new();
        for _ in 0..1 + random.below(4) {
            // Now and then every sample has its own targets: then every third difference has its own sign.
            let shaky = random.below(4) == 0;
            let flow = [0.0, 1e-5][random.below(2) as usize];
            let mut targets = self.targets(random);
            for _ in 0..1 + random.below(40) {
                if shaky {
                    targets = self.targets(random);
                }
                samples.push((self.step(targets, flow, period), self));
            }
        }
        while self.v != [Ramp::at(0.0); 2] || self.flow > 0.0 {
            samples.push((self.step([0.0; 2], 0.0, period), self));
        }
        for _ in 0..2 {
            samples.push((self.step([0.0; 2], 0.0, period), self));
        }
        samples
    }
}
