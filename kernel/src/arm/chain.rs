//! The product of a chain's links, for one joint vector or for several side by side: what is done to all of them alike,
//! compilers make vectors of.

use super::{Arm, Dh, Joint, JointKind};
use crate::pose::Pose;
use crate::units::JointPos;
use nalgebra::{Matrix3, Vector3};

/// A vector for each of L frames: of each coordinate all L.
type Vectors<const L: usize> = [[f64; L]; 3];

/// L frames in the base frame: their axes, and their origins (m).
#[derive(Clone, Copy)]
pub(crate) struct Frames<const L: usize> {
    x: Vectors<L>,
    y: Vectors<L>,
    pub(super) z: Vectors<L>,
    pub(super) origin: Vectors<L>,
}

/// What turns and shifts a link: sine and cosine of its θ, and its d (m).
pub(super) struct Link<const L: usize> {
    pub(super) sin: [f64; L],
    pub(super) cos: [f64; L],
    pub(super) d: [f64; L],
}

impl<const L: usize> Frames<L> {
    /// All at one pose.
    #[inline(always)]
    pub(super) fn at(pose: &Pose) -> Self {
        let ([x, y, z], [origin]) = (pose.rotation.data.0, pose.translation.data.0);
        let all = |vector: [f64; 3]| vector.map(|coordinate| [coordinate; L]);
        Self { x: all(x), y: all(y), z: all(z), origin: all(origin) }
    }

    /// From the frames before a link to those after it. No inlining: where the frames stay in memory, compilers see how
    /// their coordinates lie.
    #[inline(never)]
    pub(super) fn step(&mut self, row: &Dh, link: &Link<L>) {
        let (sa, ca) = (row.sin_alpha, row.cos_alpha);
        add(&mut self.origin, &self.z, &link.d);
        for (x, y) in self.x.iter_mut().zip(&mut self.y) {
            for k in 0..L {
                let (sin, cos) = (link.sin[k], link.cos[k]);
                (x[k], y[k]) = (x[k] * cos + y[k] * sin, y[k] * cos - x[k] * sin);
            }
        }
        // Tables have many zeros; a row's are the same for all frames.
        if row.a != 0.0 {
            add(&mut self.origin, &self.x, &[row.a; L]);
        }
        if sa == 0.0 && ca == 1.0 {
            return;
        }
        for (y, z) in self.y.iter_mut().zip(&mut self.z) {
            for k in 0..L {
                (y[k], z[k]) =
                    if ca == 0.0 { (z[k] * sa, -y[k] * sa) } else { (y[k] * ca + z[k] * sa, z[k] * ca - y[k] * sa) };
            }
        }
    }

    /// From the frames to others that lie in them all alike.
    fn then(&mut self, pose: &Pose) {
        let ([x, y, z], [origin]) = (pose.rotation.data.0, pose.translation.data.0);
        let turned = |[a, b, c]: [f64; 3]| {
            let mut sum = [[0.0; L]; 3];
            for (((sum, x), y), z) in sum.iter_mut().zip(&self.x).zip(&self.y).zip(&self.z) {
                for k in 0..L {
                    sum[k] = x[k] * a + y[k] * b + z[k] * c;
                }
            }
            sum
        };
        let mut origin = turned(origin);
        add(&mut origin, &self.origin, &[1.0; L]);
        *self = Self { x: turned(x), y: turned(y), z: turned(z), origin };
    }

    /// Of the frame farthest from a pose, the square of its distance (m²), and that of the one turned farthest from it, the
    /// sum of the squares of the differences of its axes. What is not a number is farthest.
    pub(crate) fn farthest(&self, pose: &Pose) -> (f64, f64) {
        let ([x, y, z], [origin]) = (pose.rotation.data.0, pose.translation.data.0);
        let squares = |of: &Vectors<L>, to: [f64; 3], sum: &mut [f64; L]| {
            for (of, to) in of.iter().zip(to) {
                for k in 0..L {
                    sum[k] += (of[k] - to) * (of[k] - to);
                }
            }
        };
        let (mut away, mut turned) = ([0.0; L], [0.0; L]);
        squares(&self.origin, origin, &mut away);
        squares(&self.x, x, &mut turned);
        squares(&self.y, y, &mut turned);
        squares(&self.z, z, &mut turned);
        let larger = |a: f64, b: &f64| if *b > a || b.is_nan() { *b } else { a };
        let most = |squares: [f64; L]| squares.iter().fold(0.0, larger);
        (most(away), most(turned))
    }
}

impl Frames<1> {
    #[inline(always)]
    pub(super) fn pose(&self) -> Pose {
        let one = |[[x], [y], [z]]: Vectors<1>| Vector3::new(x, y, z);
        Pose {
            rotation: Matrix3::from_columns(&[one(self.x), one(self.y), one(self.z)]),
            translation: one(self.origin),
        }
    }
}

impl<const N: usize> Arm<N> {
    /// The flange for each of some joint vectors.
    pub(crate) fn flanges<const L: usize>(&self, joints: [&JointPos<N>; L]) -> Frames<L> {
        let mut frames = Frames::at(&self.base_from_zero());
        for (index, row, joint) in self.rows() {
            frames.step(row, &link(index, row, joint, joints));
        }
        self.end_at_flange(&mut frames);
        frames
    }

    /// From the last frames of the table to the flange.
    pub(super) fn end_at_flange<const L: usize>(&self, frames: &mut Frames<L>) {
        if let Some(last_from_flange) = &self.last_from_flange {
            frames.then(last_from_flange);
        }
    }
}

/// What turns and shifts a link with the joints where they are. Branches of an inverse have many angles in common, or
/// opposite: their sines are not looked up twice.
#[inline(always)]
pub(super) fn link<const N: usize, const L: usize>(
    index: usize,
    row: &Dh,
    joint: &Joint,
    joints: [&JointPos<N>; L],
) -> Link<L> {
    let of = |joint: usize| joints.map(|joints| joints.0.get(joint).copied().unwrap_or(0.0));
    let mut variable = of(index);
    if let Some(coupling) = joint.coupling {
        for (variable, coupled) in variable.iter_mut().zip(of(coupling.joint)) {
            *variable += coupling.factor * coupled;
        }
    }
    let (theta, d) = match joint.kind {
        JointKind::Revolute => (variable.map(|variable| row.theta + variable), [row.d; L]),
        JointKind::Prismatic => ([row.theta; L], variable.map(|variable| row.d + variable)),
    };
    let mut link = Link { sin: [0.0; L], cos: [1.0; L], d };
    let (mut last, mut sine, mut cosine) = (f64::NAN, 0.0, 1.0);
    for (k, theta) in (0..L).zip(theta) {
        if theta == -last {
            sine = -sine;
        } else if theta != last {
            (sine, cosine) = libm::sincos(theta);
        }
        (link.sin[k], link.cos[k], last) = (sine, cosine, theta);
    }
    link
}

/// Adds other vectors, each times its own factor.
#[inline(always)]
fn add<const L: usize>(to: &mut Vectors<L>, others: &Vectors<L>, factors: &[f64; L]) {
    for (to, other) in to.iter_mut().zip(others) {
        for k in 0..L {
            to[k] += other[k] * factors[k];
        }
    }
}
