//! One newtype per meaning where equal shapes could be swapped. SI throughout: m, s, rad, and for a prismatic joint m
//! where a revolute one has rad.

use serde::{Deserialize, Serialize};

/// A point in time: nanoseconds since an origin that the caller keeps (the kernel has no clock).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Nanos(pub u64);

impl Nanos {
    /// This instant plus `nanoseconds`; stays at the end of time instead of wrapping (584 years).
    pub const fn plus(self, nanoseconds: u64) -> Self {
        Self(self.0.saturating_add(nanoseconds))
    }

    /// Nanoseconds from `earlier` to this instant, 0 when `earlier` is later.
    pub const fn since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

/// Count of kernel ticks since start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Tick(pub u64);

macro_rules! joint_vector {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name<const N: usize>(pub [f64; N]);

        impl<const N: usize> $name<N> {
            /// All joints zero.
            pub const ZERO: Self = Self([0.0; N]);

            /// Whether no component is NaN or infinite.
            pub fn is_finite(&self) -> bool {
                // Zero times a number is zero, and times anything else NaN.
                self.0.iter().fold(0.0, |sum, value| sum + 0.0 * value) == 0.0
            }
        }
    };
}

joint_vector!(
    /// Joint positions (rad, m).
    JointPos
);
joint_vector!(
    /// Joint velocities (rad/s, m/s).
    JointVel
);
joint_vector!(
    /// Joint accelerations (rad/s², m/s²).
    JointAcc
);
joint_vector!(
    /// Joint jerks (rad/s³, m/s³).
    JointJerk
);
