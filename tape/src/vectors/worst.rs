//! Courses that a search has found to be worse than the random ones (`screed wcet --search`).

use super::Course;

/// The worst found of each arm and class of tick, without repetitions.
pub const WORST: [Course; 0] = [];
