//! Any serial chain of joints as a standard DH table: what a URDF and a calibration file describe, in the kernel's form.
//!
//! Each joint's axis is a line in the base frame. Frame i of the table has its z along the axis of joint i + 1 and its x along the
//! common normal from the axis before (Spong, Hutchinson, Vidyasagar, "Robot Modeling and Control", 3.2.2); the frames before
//! the first axis and behind the last one are free, and what remains there are the table's base and flange poses.
//!
//! The table is exact but for rounding. Where two axes are nearly parallel their common normal is far away, so that d is large
//! (hundreds of metres for a calibrated UR) and rounding weighs that much more; below [`PARALLEL`] they count as parallel.
//! What this costs is measured against the chain itself, see [`Chain::table_error`].

use super::Description;
use super::description::Link;
use nalgebra::{Matrix3, Unit, Vector3};
use screed_kernel::arm::{Dh, JointKind};
use screed_kernel::pose::Pose;

/// Sine of the angle between two axes below which they count as parallel: where the error of taking them so (this times a
/// metre) is that of the rounding of a normal that is a metre divided by this away.
pub const PARALLEL: f64 = 1.5e-8;
/// What rounding leaves of a zero (m, or no unit): a few units in the last place of a metre.
const ROUNDING: f64 = 4e-15;

/// A joint of a chain.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Its frame, at position zero, in the frame of the joint before it (which moves with that one), or in the base.
    pub previous_from_joint: Pose,
    /// The line it turns about or the direction it slides in, through its frame's origin, in its frame.
    pub axis: Unit<Vector3<f64>>,
    /// Joint, limits and ratings; the table's row is filled in by the conversion.
    pub link: Link,
}

/// Joints one behind the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// From the base outwards.
    pub steps: Vec<Step>,
    /// The flange in the last joint's frame.
    pub last_from_flange: Pose,
}

/// A line in the base frame.
#[derive(Clone, Copy)]
struct Line {
    point: Vector3<f64>,
    direction: Vector3<f64>,
}

impl Chain {
    /// The flange in the base frame, by the chain's own transforms; coupled joints as the table has them.
    pub fn forward(&self, joints: &[f64]) -> Pose {
        let mut base_from_last = Pose::identity();
        for (step, own) in self.steps.iter().zip(joints) {
            let coupled = step.link.joint.coupling.and_then(|c| Some(c.factor * joints.get(c.joint)?));
            base_from_last = base_from_last * step.previous_from_joint * step.moved(own + coupled.unwrap_or(0.0));
        }
        base_from_last * self.last_from_flange
    }

    /// The same arm as a DH table.
    pub fn table(&self, name: &str, origin: &str) -> Description {
        let (lines, base_from_flange) = self.at_zero();
        let first = lines.first().copied().unwrap_or(Line { point: Vector3::zeros(), direction: Vector3::z() });
        let base_from_zero = first_frame(&first);
        let mut frame = base_from_zero;
        let mut links = Vec::new();
        for (index, step) in self.steps.iter().enumerate() {
            let dh = match lines.get(index + 1) {
                Some(next) => row(&frame, next, None),
                None => row(&frame, &line_of_z(&base_from_flange), Some(&base_from_flange)),
            };
            // The frame as the table has it, so that the next row makes up for this one's rounding.
            frame = frame * transform(&dh);
            links.push(Link { dh, ..step.link.clone() });
        }
        let rest = frame.inverse() * base_from_flange;
        let unless_identity = |pose: Pose| (!is_identity(&pose)).then_some(pose);
        Description {
            name: name.to_owned(),
            origin: origin.to_owned(),
            base_from_zero: unless_identity(base_from_zero),
            links,
            last_from_flange: unless_identity(rest),
            notes: Vec::new(),
        }
    }

    /// How far a table's flange is from the chain's, at most, over joint vectors from `joints` (m; a turn counts with one
    /// metre a radian).
    pub fn table_error(&self, forward: impl Fn(&[f64]) -> Pose, joints: impl Iterator<Item = Vec<f64>>) -> f64 {
        let apart = |joints: Vec<f64>| {
            let (chain, table) = (self.forward(&joints), forward(&joints));
            let turn = (chain.rotation.transpose() * table.rotation - Matrix3::identity()).norm();
            (chain.translation - table.translation).norm().max(turn)
        };
        joints.map(apart).fold(0.0, f64::max)
    }

    /// The axes with all joints at zero, and the flange.
    fn at_zero(&self) -> (Vec<Line>, Pose) {
        let mut base_from_joint = Pose::identity();
        let mut lines = Vec::new();
        for step in &self.steps {
            base_from_joint = base_from_joint * step.previous_from_joint;
            let direction = base_from_joint.rotation * *step.axis;
            lines.push(Line { point: base_from_joint.translation, direction });
        }
        (lines, base_from_joint * self.last_from_flange)
    }
}

impl Step {
    fn moved(&self, position: f64) -> Pose {
        match self.link.joint.kind {
            JointKind::Revolute => Pose::from_rotation_vector(Vector3::zeros(), *self.axis * position),
            JointKind::Prismatic => Pose { translation: *self.axis * position, ..Pose::identity() },
        }
    }
}

/// Frame 0: the base itself where the first axis is its z, else on the axis at the point nearest to the base's origin, turned
/// as little as possible.
fn first_frame(axis: &Line) -> Pose {
    let z = axis.direction;
    let foot = axis.point - z * axis.point.dot(&z);
    let tilt = Vector3::z().cross(&z).norm();
    if tilt < ROUNDING && z.z > 0.0 && foot.norm() < ROUNDING {
        return Pose::identity();
    }
    let candidate = if z.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let x = (candidate - z * candidate.dot(&z)).normalize();
    Pose { rotation: Matrix3::from_columns(&[x, z.cross(&x), z]), translation: foot }
}

fn line_of_z(pose: &Pose) -> Line {
    Line { point: pose.translation, direction: pose.rotation.column(2).into() }
}

/// The row that takes `frame` to one whose z lies on `next`; `goal` is a frame on that line which the new one should meet where
/// it is free to.
fn row(frame: &Pose, next: &Line, goal: Option<&Pose>) -> Dh {
    let [x, y, z] = [0, 1, 2].map(|column| -> Vector3<f64> { frame.rotation.column(column).into() });
    let direction = next.direction.normalize();
    let between = next.point - frame.translation;
    let normal = z.cross(&direction);
    let sine = normal.norm();
    let cosine = z.dot(&direction);
    let (normal, sine, d, a) = if sine >= PARALLEL {
        let mut normal = normal / sine;
        let mut sine = sine;
        // Of the two directions the one that turns the table's x less.
        if normal.dot(&x) < 0.0 {
            (normal, sine) = (-normal, -sine);
        }
        // Square to z up to rounding only: what is left of z in it would weigh as much as d is long.
        let normal = (normal - z * normal.dot(&z)).normalize();
        // The point of our axis nearest to the other one.
        let d = between.cross(&direction).dot(&z.cross(&direction)) / (sine * sine);
        (normal, sine, d, between.dot(&normal))
    } else {
        let d = goal.map_or(0.0, |goal| (goal.translation - frame.translation).dot(&z));
        let across = between - z * between.dot(&z);
        let distance = across.norm();
        let goal_x = goal.map(|goal| -> Vector3<f64> { goal.rotation.column(0).into() });
        // Axes on one line: x stays, or is the goal's.
        let normal = if distance > ROUNDING { across / distance } else { goal_x.unwrap_or(x) };
        let normal = (normal - z * normal.dot(&z)).normalize();
        let normal = if distance > ROUNDING && normal.dot(&x) < 0.0 { -normal } else { normal };
        (normal, 0.0, d, across.dot(&normal))
    };
    let length = sine.hypot(cosine);
    let clean = |value: f64| if value.abs() < ROUNDING { 0.0 } else { value };
    let (sin_alpha, cos_alpha) = (clean(sine / length), clean(cosine / length));
    let exact = |value: f64, other: f64| if other == 0.0 { value.signum() } else { value };
    Dh {
        theta: clean(normal.dot(&y).atan2(normal.dot(&x))),
        d: clean(d),
        a: clean(a),
        sin_alpha: exact(sin_alpha, cos_alpha),
        cos_alpha: exact(cos_alpha, sin_alpha),
    }
}

/// A row at position zero.
fn transform(dh: &Dh) -> Pose {
    let (s, c) = dh.theta.sin_cos();
    let (sa, ca) = (dh.sin_alpha, dh.cos_alpha);
    Pose {
        rotation: Matrix3::new(c, -s * ca, s * sa, s, c * ca, -c * sa, 0.0, sa, ca),
        translation: Vector3::new(dh.a * c, dh.a * s, dh.d),
    }
}

fn is_identity(pose: &Pose) -> bool {
    (pose.rotation - Matrix3::identity()).amax() < ROUNDING && pose.translation.amax() < ROUNDING
}

#[cfg(test)]
mod tests {
    use super::*;
    use screed_kernel::arm::{Coupling, Joint};
    use screed_kernel::arms::ur::UR10E;
    use screed_kernel::units::JointPos;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn link(joint: Joint) -> Link {
        let dh = Dh { theta: 0.0, d: 0.0, a: 0.0, sin_alpha: 0.0, cos_alpha: 1.0 };
        let (velocity_max, acceleration_max) = (None, None);
        let name = String::new();
        Link { name, dh, joint, position_min: -PI, position_max: PI, velocity_max, acceleration_max }
    }

    /// Numbers in [-1, 1] without a pattern, by index.
    fn noise(index: usize) -> f64 {
        let mut bits = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn joints(count: usize, seed: usize) -> impl Iterator<Item = Vec<f64>> {
        (0..200).map(move |k| (0..count).map(|j| 3.0 * noise(seed + 10 * k + j)).collect())
    }

    fn worst<const N: usize>(chain: &Chain) -> f64 {
        let arm = chain.table("chain", "a test").arm::<N>("chain").unwrap();
        chain.table_error(|q| arm.forward(&JointPos(q.try_into().unwrap())), joints(N, 77))
    }

    /// Crooked in every way, with a sliding joint and a coupled one.
    fn crooked(count: usize, seed: usize) -> Chain {
        let pose = |k: usize| {
            let n = |i: usize| noise(seed + 1000 + 10 * k + i);
            Pose::from_roll_pitch_yaw(Vector3::new(n(0), n(1), n(2)), 3.0 * n(3), 1.5 * n(4), 3.0 * n(5))
        };
        let step = |k: usize| {
            let mut joint = if (k + seed) % 4 == 1 { Joint::PRISMATIC } else { Joint::REVOLUTE };
            joint.coupling = (k == 2).then(|| Coupling { joint: k - 1, factor: noise(seed) });
            let axis = Vector3::from_fn(|i, _| noise(seed + 500 + 3 * k + i));
            Step { previous_from_joint: pose(k), axis: Unit::new_normalize(axis), link: link(joint) }
        };
        Chain { steps: (0..count).map(step).collect(), last_from_flange: pose(count) }
    }

    #[test]
    fn any_chain_becomes_a_table() {
        for seed in (0..50).map(|k| 100_000 * k) {
            assert!(worst::<3>(&crooked(3, seed)) < 1e-11, "{seed}");
            assert!(worst::<6>(&crooked(6, seed)) < 1e-11, "{seed}");
            assert!(worst::<9>(&crooked(9, seed)) < 1e-11, "{seed}");
        }
    }

    /// The chain of the maker's description with exact right angles: shift, then turn, before each joint.
    fn ur10e() -> Chain {
        let shifts = [
            ([0.0, 0.0, 0.1807], [0.0; 3]),
            ([0.0; 3], [FRAC_PI_2, 0.0, 0.0]),
            ([-0.6127, 0.0, 0.0], [0.0; 3]),
            ([-0.57155, 0.0, 0.17415], [0.0; 3]),
            ([0.0, -0.11985, 0.0], [FRAC_PI_2, 0.0, 0.0]),
            ([0.0, 0.11655, 0.0], [FRAC_PI_2, PI, PI]),
        ];
        let step = |([x, y, z], [roll, pitch, yaw]): ([f64; 3], [f64; 3])| Step {
            previous_from_joint: Pose::from_roll_pitch_yaw(Vector3::new(x, y, z), roll, pitch, yaw),
            axis: Vector3::z_axis(),
            link: link(Joint::REVOLUTE),
        };
        Chain { steps: shifts.map(step).into(), last_from_flange: Pose::identity() }
    }

    #[test]
    fn a_description_of_a_ur_gives_its_published_table() {
        let chain = ur10e();
        let table = chain.table("ur10e", "a test");
        assert!((table.base_from_zero, table.last_from_flange) == (None, None), "{table:?}");
        for (link, dh) in table.links.iter().zip(&UR10E.dh) {
            let (found, expected) = (link.dh, dh);
            assert_eq!((found.sin_alpha, found.cos_alpha), (expected.sin_alpha, expected.cos_alpha));
            for (found, expected) in [(found.theta, expected.theta), (found.d, expected.d), (found.a, expected.a)] {
                assert!((found - expected).abs() < 1e-15, "{found} {expected}");
            }
        }
        assert!(worst::<6>(&chain) < 1e-14);
    }

    /// Both sides of the limit below which axes count as parallel: the error stays within what the doc comment says.
    #[test]
    fn nearly_parallel_axes_cost_no_more_than_stated() {
        for (tilt, allowed) in
            [(1e-2, 1e-12), (1e-4, 1e-11), (1e-6, 1e-9), (1.6e-8, 1e-7), (1.4e-8, 1e-7), (1e-10, 1e-9), (1e-13, 1e-12)]
        {
            for step in 1..4 {
                let mut chain = ur10e();
                let previous_from_joint = &mut chain.steps[step].previous_from_joint;
                let tilted = Pose::from_roll_pitch_yaw(Vector3::zeros(), 0.0, tilt, 0.0);
                *previous_from_joint = *previous_from_joint * tilted;
                let error = worst::<6>(&chain);
                assert!(error < allowed, "tilt {tilt} before joint {step}: {error:e}");
            }
        }
    }
}
