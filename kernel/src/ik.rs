//! Inverse kinematics: every joint vector that puts the flange where it is wanted.

pub mod ur;

use crate::units::JointPos;

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum IkError {
    /// The pose has a component that is NaN or infinite.
    NotFinite,
    /// The pose lies outside what the arm can reach; by how much, in metres, the nearest branch misses it.
    OutOfReach {
        /// Distance missing (m).
        by: f64,
    },
    /// The pose can be reached, but no branch lies inside the joint limits.
    Limit {
        /// The joint (0 is the first) that the branch nearest to the seed needs beyond its limit.
        joint: usize,
        /// Where that joint would have to be (rad).
        position: f64,
    },
}

/// At most eight branches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branches<const N: usize> {
    joints: [JointPos<N>; 8],
    len: usize,
}

impl<const N: usize> Branches<N> {
    const fn empty() -> Self {
        Self { joints: [JointPos::ZERO; 8], len: 0 }
    }

    fn push(&mut self, joints: JointPos<N>) {
        if let Some(slot) = self.joints.get_mut(self.len) {
            *slot = joints;
            self.len = self.len.wrapping_add(1);
        }
    }

    /// The branches found, in no promised order.
    pub fn as_slice(&self) -> &[JointPos<N>] {
        self.joints.get(..self.len).unwrap_or(&[])
    }
}
