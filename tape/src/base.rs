//! A base that jumps, drifts and is lost sight of under the arm of the tape: what the kernel makes of it.

use crate::cell::ARM;
use crate::hash::Fnv;
use crate::motion::JOINTS;
use crate::random::Random;
use nalgebra::Vector3;
use screed_kernel::base::history::History;
use screed_kernel::base::swing::Swing;
use screed_kernel::base::{Base, BaseConfig, BaseLimits, Displacement, Drift, Measurement, Trust, Verdict};
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};

/// From tick to tick (ns).
const TICK_NS: u64 = 8_000_000;

/// Standard deviations of the tracker (m, rad) and of a joint (rad).
const DEVIATIONS: [f64; 3] = [25e-6, 1.7e-4, 3e-5];

/// The base, its truth, and what became of measurements.
#[derive(Clone, Debug)]
pub struct Shifting {
    random: Random,
    config: BaseConfig,
    /// None only if the configuration were refused.
    base: Option<Base>,
    history: History<JOINTS, 4>,
    now: Nanos,
    truth: Displacement,
    rate: Vector3<f64>,
    dark: u32,
    /// Taken, gated, acquiring, acquired, refused, ticks in excess, ticks without trust.
    pub met: [u64; 7],
}

impl Shifting {
    pub fn new(seed: u64) -> Self {
        let config = config(TICK_NS, 0.5);
        Self {
            random: Random(seed),
            config,
            base: Base::new(&config).ok(),
            history: History::new(),
            now: Nanos(0),
            truth: Displacement::zero(),
            rate: Vector3::zeros(),
            dark: 0,
            met: [0; 7],
        }
    }

    /// One tick with the arm there; all that comes out is hashed.
    pub fn step(&mut self, joints: &JointPos<JOINTS>, hash: &mut Fnv) {
        self.now = self.now.plus(TICK_NS);
        self.truth.translation += self.rate * self.config.period;
        match self.random.below(300) {
            0 => self.truth.translation = self.any(0.02),
            1 => self.truth.rotation = self.any(0.006),
            2 => self.rate = self.any(0.003),
            3 => self.dark = self.random.below(150),
            4..10 => self.base.iter_mut().for_each(Base::clear),
            _ => self.dark = self.dark.saturating_sub(1),
        }
        hash.integer(u64::from(self.history.push(self.now, joints).is_ok()));
        if self.dark == 0 {
            self.look(hash);
        }
        let Some(base) = &mut self.base else { return };
        let result = base.tick(self.now);
        let output = base.output();
        for pose in [output.nominal_from_base, base.tracker_from_base(self.now)] {
            pose.rotation.iter().chain(pose.translation.iter()).for_each(|number| hash.number(*number));
        }
        output.behind.iter().for_each(|number| hash.number(*number));
        self.count(5, result.is_err());
        self.count(6, output.trust == Trust::Ended);
        hash.number(result.map_or_else(|excess| excess.value, |_| 0.0));
    }

    /// A pose from up to a tick ago; now and then one that lies, or one again.
    fn look(&mut self, hash: &mut Fnv) {
        let late = u64::from(self.random.below(TICK_NS as u32 + 500_000));
        let at = Nanos(self.now.0.saturating_sub(late));
        let Ok(joints) = self.history.at(at) else { return };
        let [place, turn, joint] = DEVIATIONS;
        let base = self.config.tracker_from_nominal * self.truth.pose(&self.config.pivot);
        let truth = base * ARM.forward(&joints) * self.config.flange_from_target;
        let off = Pose::from_rotation_vector(Vector3::zeros(), self.any(1.5 * turn));
        let lie = if self.random.once_in(40) { self.any(1.0) } else { self.any(1.5 * place) };
        let measurement = Measurement {
            at,
            tracker_from_target: Pose { rotation: off.rotation * truth.rotation, translation: truth.translation + lie },
            position_deviation: place,
            rotation_deviation: turn,
            joints,
            joint_deviation: JointPos([joint; JOINTS]),
        };
        let Some(base) = &mut self.base else { return };
        let (kind, number) = match base.measure(&ARM, &measurement) {
            Ok(Verdict::Taken { nis }) => (0, nis),
            Ok(Verdict::Gated { nis, agreeing, .. }) => (1, nis + f64::from(agreeing)),
            Ok(Verdict::Acquiring { agreeing }) => (2, f64::from(agreeing)),
            Ok(Verdict::Acquired) => (3, 0.0),
            Err(_) => (4, 0.0),
        };
        hash.integer(kind as u64);
        hash.number(number);
        if let Some(estimate) = base.estimate() {
            let rows = estimate.covariance().rows.as_flattened().as_flattened().as_flattened();
            rows.iter().for_each(|number| hash.number(*number));
        }
        self.count(kind, true);
    }

    /// Each component anywhere from −`size` to `size`.
    fn any(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.random.between(-size, size))
    }

    fn count(&mut self, which: usize, happened: bool) {
        if let Some(count) = self.met.get_mut(which) {
            *count += u64::from(happened);
        }
    }
}

/// Where the tape's tracker, base and target are, and how its base may move; with ticks so far apart, and so long without a pose.
pub fn config(tick_ns: u64, hold: f64) -> BaseConfig {
    let limits = BaseLimits {
        translation_max: 0.02,
        velocity_max: 0.02,
        acceleration_max: 0.2,
        rotation_max: 0.01,
        turn_rate_max: 0.01,
        turn_acceleration_max: 0.1,
    };
    BaseConfig {
        tracker_from_nominal: Pose::from_roll_pitch_yaw(Vector3::new(3.0, -1.0, 0.5), 0.2, -0.1, 2.5),
        flange_from_target: Pose::from_roll_pitch_yaw(Vector3::new(0.05, 0.02, 0.1), 0.3, 0.0, 1.0),
        pivot: Vector3::new(0.7, -0.2, 0.4),
        drift: Drift { speed: 3e-3, turn_rate: 2e-4, time: 2.0 },
        swing: Swing::NONE,
        hold,
        agreeing: 5,
        limits,
        period: tick_ns as f64 * 1e-9,
    }
}
