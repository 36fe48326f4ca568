//! What a plant is made of, and the ranges that random ones are drawn from (docs/plant.md shows them as a table).

use super::random::Random;
use nalgebra::Vector3;
use screed_kernel::arm::Arm;
use screed_kernel::arms::comau::NJ130;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

/// Which arm the plant is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A Comau NJ130 that hangs from a crane.
    Nj130,
    /// A UR10e on a platform, driven by servoj.
    Ur10e,
}

/// From where to where a parameter is drawn, evenly, for each kind of arm (SI).
#[derive(Clone, Copy, Debug)]
pub struct Range {
    /// What it is.
    pub name: &'static str,
    /// Of the figures.
    pub unit: &'static str,
    /// Lowest and highest for [`Kind::Nj130`].
    pub nj130: [f64; 2],
    /// Lowest and highest for [`Kind::Ur10e`].
    pub ur10e: [f64; 2],
}

macro_rules! ranges {
    ($($name:ident: $text:literal, $unit:literal, $nj130:expr, $ur10e:expr;)*) => {
        $(const $name: Range = Range { name: $text, unit: $unit, nj130: $nj130, ur10e: $ur10e };)*
        /// All of them.
        pub const RANGES: &[Range] = &[$($name),*];
    };
}

ranges! {
    GAIN: "drive gain K", "1/s²", [2500.0, 6400.0], [210.0, 390.0];
    LOOK_AHEAD: "drive look-ahead L", "s", [0.02, 0.035], [0.07, 0.13];
    SPREAD: "a joint's K and L over the arm's", "1", [0.95, 1.05], [1.0, 1.0];
    DEAD_TIME: "dead time of a command", "s", [0.001, 0.015], [0.001, 0.015];
    ELASTIC_FREQUENCY: "joint elasticity, natural frequency", "Hz", [8.0, 15.0], [10.0, 20.0];
    ELASTIC_DAMPING: "joint elasticity, damping ratio", "1", [0.03, 0.1], [0.03, 0.1];
    COMPLIANCE: "compliance of joints 1 to 3, three times as much from 4 on", "rad/(N·m)", [3e-7, 1e-6], [1e-5, 3e-5];
    PLAY: "backlash of a joint, full width", "rad", [0.0, 6e-5], [0.0, 6e-5];
    PAYLOAD: "mass at the flange", "kg", [20.0, 60.0], [2.0, 6.0];
    ENCODER_NOISE: "encoder noise, standard deviation", "rad", [2e-6, 1e-5], [5e-6, 2e-5];
    ENCODER_QUANTUM: "encoder quantum", "rad", [6e-6, 6e-6], [1e-5, 1e-5];
    RATE_NOISE: "joint rate noise, standard deviation", "rad/s", [5e-4, 2e-3], [5e-4, 2e-3];
    BASE_FREQUENCY: "base, natural frequency of each translation", "Hz", [1.5, 4.0], [2.0, 5.0];
    BASE_TILT_FREQUENCY: "base, natural frequency of each rotation", "Hz", [2.5, 6.0], [3.0, 8.0];
    BASE_DAMPING: "base, damping ratio", "1", [0.02, 0.1], [0.02, 0.1];
    BASE_MASS: "base, mass", "kg", [2000.0, 5000.0], [300.0, 800.0];
    BASE_GYRATION: "base, radius of gyration", "m", [0.8, 1.5], [0.5, 1.0];
    REACTION_MASS: "moved mass, as if at the flange", "kg", [100.0, 250.0], [8.0, 16.0];
    DRIFT_SPEED: "base drift, speed in a random direction", "m/s", [0.003, 0.003], [0.003, 0.003];
    DRIFT_TIME: "base drift, time to another direction", "s", [2.0, 6.0], [2.0, 6.0];
    DRIFT_RADIUS: "base drift, turns back beyond", "m", [0.01, 0.03], [0.01, 0.03];
    TURN_SPEED: "base turning, rate about a random axis", "rad/s", [0.0, 1e-4], [0.0, 1e-4];
    STEP_INTERVAL: "base steps, mean time between", "s", [15.0, 60.0], [15.0, 60.0];
    STEP_SIZE: "base steps, size in a random direction", "m", [1e-4, 1e-3], [1e-4, 1e-3];
    DISTANCE: "tracker to base", "m", [3.0, 10.0], [2.0, 6.0];
    LATENCY: "tracker latency", "s", [0.001, 0.004], [0.001, 0.004];
    MISSING: "share of poses lost one by one", "1", [0.0, 0.05], [0.0, 0.05];
    BREAK_INTERVAL: "beam breaks, mean time between", "s", [10.0, 60.0], [10.0, 60.0];
    BREAK_LENGTH: "beam break, length", "s", [0.02, 0.5], [0.02, 0.5];
    RELOCK: "time to lock on again", "s", [0.2, 2.0], [0.2, 2.0];
}

/// A joint from command to link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointParams {
    /// K of q̈ = K·(r − q − L·q̇) (1/s²).
    pub gain: f64,
    /// L of it (s): how far a ramp is ahead of the joint.
    pub look_ahead: f64,
    /// Natural frequency of the link on the drive (rad/s).
    pub elastic_frequency: f64,
    /// Damping ratio of it.
    pub elastic_damping: f64,
    /// Turn of the link by a moment (rad/(N·m)).
    pub compliance: f64,
    /// Full width of the backlash between drive and link (rad).
    pub play: f64,
}

/// What the base stands on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseParams {
    /// Natural frequencies along x, y, z and about them (rad/s).
    pub frequency: [f64; 6],
    /// Damping ratio of all.
    pub damping: f64,
    /// kg
    pub mass: f64,
    /// Radius of gyration (m).
    pub gyration: f64,
    /// Mass at the flange that the arm's acceleration moves (kg).
    pub reaction_mass: f64,
    /// Drift (m/s) in a random direction.
    pub drift_speed: f64,
    /// Time to another direction (s).
    pub drift_time: f64,
    /// Drift heads back beyond this (m).
    pub drift_radius: f64,
    /// Drift of rotation (rad/s) about a random axis; it heads back beyond 1 mrad.
    pub turn_speed: f64,
    /// Mean time between steps (s); infinite for none.
    pub step_interval: f64,
    /// Size of a step (m).
    pub step_size: f64,
}

/// The tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerParams {
    /// Factor on the noise by the published accuracy; 1 is published, 0 none.
    pub noise: f64,
    /// From a pose to its arrival (s).
    pub latency: f64,
    /// Share of poses lost one by one.
    pub missing: f64,
    /// Mean time between beam breaks (s); infinite for none.
    pub break_interval: f64,
    /// Shortest and longest break (s).
    pub break_length: [f64; 2],
    /// Shortest and longest time to lock on again after it (s).
    pub relock: [f64; 2],
}

/// A plant.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// Kinematics, exactly those of the catalogue.
    pub arm: &'static Arm<6>,
    /// Where the joints are at first.
    pub start: JointPos<6>,
    /// Control period (ns), a multiple of [`super::SUBSTEP_NS`].
    pub period_ns: u64,
    /// From a command to the drives (ns), a multiple of [`super::SUBSTEP_NS`].
    pub dead_time_ns: u64,
    /// Joint by joint.
    pub joints: [JointParams; 6],
    /// Mass at the flange, whose weight bends the joints (kg).
    pub payload: f64,
    /// Standard deviation of an encoder (rad), before its quantum.
    pub encoder_noise: f64,
    /// Quantum of an encoder (rad); 0 for none.
    pub encoder_quantum: f64,
    /// Standard deviation of a measured joint rate (rad/s).
    pub rate_noise: f64,
    /// What the base stands on.
    pub base: BaseParams,
    /// The tracker.
    pub tracker: TrackerParams,
    /// Where the base is when nothing has moved it. The tracker's z axis points up; it is the world.
    pub tracker_from_nominal: Pose,
    /// Where the target is mounted.
    pub flange_from_target: Pose,
    /// The tool's tip.
    pub flange_from_tcp: Pose,
}

impl Params {
    /// Drawn from [`RANGES`].
    pub fn random(kind: Kind, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let random = &mut random;
        let mut draw = |range: Range| {
            let [low, high] = match kind {
                Kind::Nj130 => range.nj130,
                Kind::Ur10e => range.ur10e,
            };
            random.between(low, high)
        };
        let (gain, look_ahead) = (draw(GAIN), draw(LOOK_AHEAD));
        let dead_time = draw(DEAD_TIME);
        let joints = [1.0, 1.0, 1.0, 3.0, 3.0, 3.0].map(|softer| JointParams {
            gain: gain * draw(SPREAD),
            look_ahead: look_ahead * draw(SPREAD),
            elastic_frequency: std::f64::consts::TAU * draw(ELASTIC_FREQUENCY),
            elastic_damping: draw(ELASTIC_DAMPING),
            compliance: softer * draw(COMPLIANCE),
            play: draw(PLAY),
        });
        let payload = draw(PAYLOAD);
        let (encoder_noise, encoder_quantum, rate_noise) =
            (draw(ENCODER_NOISE), draw(ENCODER_QUANTUM), draw(RATE_NOISE));
        let frequency = [
            BASE_FREQUENCY,
            BASE_FREQUENCY,
            BASE_FREQUENCY,
            BASE_TILT_FREQUENCY,
            BASE_TILT_FREQUENCY,
            BASE_TILT_FREQUENCY,
        ];
        let base = BaseParams {
            frequency: frequency.map(|range| std::f64::consts::TAU * draw(range)),
            damping: draw(BASE_DAMPING),
            mass: draw(BASE_MASS),
            gyration: draw(BASE_GYRATION),
            reaction_mass: draw(REACTION_MASS),
            drift_speed: draw(DRIFT_SPEED),
            drift_time: draw(DRIFT_TIME),
            drift_radius: draw(DRIFT_RADIUS),
            turn_speed: draw(TURN_SPEED),
            step_interval: draw(STEP_INTERVAL),
            step_size: draw(STEP_SIZE),
        };
        let distance = draw(DISTANCE);
        let [break_length, relock] = [BREAK_LENGTH, RELOCK].map(|range| match kind {
            Kind::Nj130 => range.nj130,
            Kind::Ur10e => range.ur10e,
        });
        let tracker = TrackerParams {
            noise: 1.0,
            latency: draw(LATENCY),
            missing: draw(MISSING),
            break_interval: draw(BREAK_INTERVAL),
            break_length,
            relock,
        };
        let substep = super::SUBSTEP_NS;
        let (heading, yaw) = (random.between(-3.0, 3.0), random.between(-3.0, 3.0));
        let (sin, cos) = libm::sincos(heading);
        // The flange's z axis points out of a UR's, and into an NJ130's.
        let (arm, centre, height, roll, out): (_, [f64; 6], _, _, _) = match kind {
            Kind::Nj130 => (&NJ130, [0.0, 0.2, -1.8, 0.3, 0.9, 0.2], 3.5, std::f64::consts::PI, -1.0),
            Kind::Ur10e => (&UR10E, [0.0, -1.2, 1.4, -0.8, 1.2, 0.0], 0.3, 0.0, 1.0),
        };
        Self {
            arm,
            start: JointPos(centre.map(|q| q + random.between(-0.2, 0.2))),
            period_ns: 2_000_000,
            dead_time_ns: (libm::round(dead_time * 1e9 / substep as f64) as u64) * substep,
            joints,
            payload,
            encoder_noise,
            encoder_quantum,
            rate_noise,
            base,
            tracker,
            tracker_from_nominal: Pose::from_roll_pitch_yaw(
                Vector3::new(distance * cos, distance * sin, height - 1.2),
                roll,
                0.0,
                yaw,
            ),
            flange_from_target: Pose::from_roll_pitch_yaw(Vector3::new(0.12, 0.05, 0.08 * out), 0.4, -0.3, 1.0),
            flange_from_tcp: Pose::from_roll_pitch_yaw(Vector3::new(0.02, 0.0, 0.25 * out), 0.0, 0.0, 0.0),
        }
    }
}
