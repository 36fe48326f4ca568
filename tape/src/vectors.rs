//! Vectors for the worst case: short courses of a loop closed around a kernel, every call of which is measured.
//!
//! A [`Course`] follows from [`GENES`] bytes alone: which arm, from which posture through which singularity, what the tracker
//! says and when, what the host sends, what goes wrong. So it is the same wherever it runs, one can be named by its bytes, and
//! a search for a worse one changes bytes ([`climb`]). Whoever runs it counts or times each call: instructions under a
//! profiler, a timer's steps on bare metal, nanoseconds.

mod cell;
pub mod climb;
mod course;
mod traffic;
mod worst;

pub use cell::{ARMS, DEPTH, RING, TICK_NS};
pub use worst::WORST;

use crate::random::Random;

/// Bytes that a course follows from.
pub const GENES: usize = 28;

/// Seed of the random courses.
pub const SEED: u64 = 20_261_126;

/// Random courses of each arm.
pub const RANDOM_COURSES: u32 = 20;

/// Most poses of a tick that is no burst: a tracker twice as fast as the ticks.
pub const USUAL_POSES: usize = 2;

/// Courses in all: the random ones of every arm, and the worst that a search has found.
pub const COURSES: u32 = RANDOM_COURSES * ARMS.len() as u32 + WORST.len() as u32;

/// The three calls of a cycle, each in a frame of its own that a profiler finds by name.
pub mod measured {
    use super::{DEPTH, RING};
    use screed_kernel::closed_loop::{ClosedLoop, LoopReport};
    use screed_kernel::estimator::{Robot, TrackerPose};
    use screed_kernel::tick::{Command, Kernel, Sensors};
    use screed_kernel::units::Nanos;

    /// [`Kernel::receive`]
    #[inline(never)]
    pub fn receive<const N: usize>(kernel: &mut Kernel<N, RING>, bytes: &[u8]) -> usize {
        kernel.receive(bytes)
    }

    /// [`Kernel::tick`]: the kernel alone.
    #[inline(never)]
    pub fn plain<const N: usize>(kernel: &mut Kernel<N, RING>, now: Nanos, sensors: &Sensors<N>) -> Command<N> {
        kernel.tick(now, sensors)
    }

    /// [`ClosedLoop::tick`]: the kernel with the loop around it.
    #[inline(never)]
    pub fn closed<const N: usize>(
        around: &mut ClosedLoop<N, DEPTH>,
        kernel: &mut Kernel<N, RING>,
        now: Nanos,
        robot: &Robot<N>,
        poses: &[TrackerPose],
    ) -> (Command<N>, LoopReport<N>) {
        around.tick(kernel, now, robot, poses)
    }

    /// [`Kernel::poll_transmit`]
    #[inline(never)]
    pub fn transmit<const N: usize>(kernel: &mut Kernel<N, RING>, out: &mut [u8]) -> usize {
        kernel.poll_transmit(out)
    }
}

/// What a call was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// A tick of the kernel alone, no fault.
    Plain,
    /// A tick with the loop, but neither pose nor rates.
    Motion,
    /// The same with poses.
    Pose,
    /// The same with rates, with or without poses.
    Rates,
    /// The same with more poses than [`USUAL_POSES`]: of a tracker that is faster than twice the ticks, or after a gap.
    Burst,
    /// A tick in which the filter went back for a pose that came late.
    Replay,
    /// A tick in which a fault was found or stood, with at most as many poses as usual and no replay.
    Fault,
    /// Bytes of the host taken between two ticks.
    Frames,
    /// Answers copied out.
    Answers,
}

impl Class {
    /// Every class, in order.
    pub const ALL: [Self; 9] = [
        Self::Plain,
        Self::Motion,
        Self::Pose,
        Self::Rates,
        Self::Burst,
        Self::Replay,
        Self::Fault,
        Self::Frames,
        Self::Answers,
    ];

    /// Its name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plain => "kernel alone",
            Self::Motion => "motion only",
            Self::Pose => "+ pose",
            Self::Rates => "+ rates",
            Self::Burst => "+ burst of poses",
            Self::Replay => "+ replay",
            Self::Fault => "fault",
            Self::Frames => "frames in",
            Self::Answers => "answers out",
        }
    }

    /// Whether it is a tick.
    pub const fn is_tick(self) -> bool {
        !matches!(self, Self::Frames | Self::Answers)
    }
}

/// The two sides of a measured call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// Just before it.
    Before,
    /// Just after.
    After,
}

/// A call that was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Call {
    /// What it was.
    pub class: Class,
    /// Which arm, an index into [`ARMS`].
    pub arm: usize,
    /// The tick of the course, 0 for the first.
    pub tick: u32,
    /// By how much the meter went on.
    pub count: u64,
}

/// What a course follows from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Course(pub [u8; GENES]);

impl Course {
    /// One of the [`COURSES`] that are compared.
    pub fn of(index: u32) -> Self {
        let random = RANDOM_COURSES * ARMS.len() as u32;
        match index.checked_sub(random).and_then(|index| WORST.get(index as usize)) {
            Some(course) => *course,
            None => {
                let mut course = Self::random(&mut Random(SEED ^ (u64::from(index) << 32)));
                course.set_arm(index as usize % ARMS.len());
                // The first of an arm: the kernel alone, a loop without a tracker, a robot that does not follow.
                match (index as usize / ARMS.len(), &mut course.0) {
                    (kind @ (0 | 1), genes) => genes[14] = (genes[14] & 0xf0) | kind as u8,
                    (2, genes) => genes[21] = 1,
                    // A tracker that sends a burst in time, and a steady one.
                    (3, genes) => (genes[14], genes[15], genes[16], genes[17]) = (genes[14] | 15, 15, 0, 0),
                    (4, genes) => (genes[14], genes[15], genes[16], genes[17]) = (0x2f, 2, 0, 0),
                    _ => {}
                }
                course
            }
        }
    }

    /// The course of a name: two hexadecimal digits a byte.
    pub const fn named(name: &str) -> Option<Self> {
        let digits = name.as_bytes();
        if digits.len() != 2 * GENES {
            return None;
        }
        let mut genes = [0; GENES];
        let mut at = 0;
        while at < 2 * GENES {
            let digit = match digits[at] {
                digit @ b'0'..=b'9' => digit - b'0',
                digit @ b'a'..=b'f' => digit - b'a' + 10,
                _ => return None,
            };
            genes[at / 2] = genes[at / 2] << 4 | digit;
            at += 1;
        }
        Some(Self(genes))
    }

    /// A random course of one arm, by its number.
    pub fn of_arm(arm: usize, number: u32) -> Self {
        let mut course = Self::random(&mut Random(!SEED ^ (u64::from(number) << 32)));
        course.set_arm(arm);
        course
    }

    /// Any course.
    pub fn random(random: &mut Random) -> Self {
        Self(core::array::from_fn(|_| random.below(256) as u8))
    }

    /// Which arm, an index into [`ARMS`].
    pub const fn arm(&self) -> usize {
        self.0[0] as usize % ARMS.len()
    }

    /// The same with another arm.
    pub const fn set_arm(&mut self, arm: usize) {
        self.0[0] = arm as u8;
    }

    /// Runs it. `meter` is asked just before and just after each measured call, and `sink` told of each. Returns whether the path was
    /// played.
    pub fn run(&self, meter: &mut impl FnMut(Edge) -> u64, sink: &mut impl FnMut(&Call)) -> bool {
        course::run(self, meter, sink)
    }
}

/// Its name.
impl core::fmt::Display for Course {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::collections::BTreeMap;
    use std::{println, vec::Vec};

    #[test]
    fn the_courses_have_every_class_of_every_arm_and_ten_thousand_ticks() {
        let mut classes = BTreeMap::new();
        let mut played = 0;
        for index in 0..COURSES {
            let ran = Course::of(index).run(&mut |_| 0, &mut |call| {
                *classes.entry((call.arm, call.class)).or_insert(0) += 1;
            });
            played += u32::from(ran && index < RANDOM_COURSES * ARMS.len() as u32);
        }
        let ticks: u32 = classes.iter().filter(|((_, class), _)| class.is_tick()).map(|(_, count)| count).sum();
        println!("{COURSES} courses, {played} played, {ticks} ticks: {classes:?}");
        assert!(ticks >= 10_000, "{ticks}");
        let random = RANDOM_COURSES * ARMS.len() as u32;
        assert!(played * 10 >= random * 6, "{played} of {random} random courses play their path");
        for (arm, name) in ARMS.iter().enumerate() {
            for class in Class::ALL {
                assert!(classes.contains_key(&(arm, class)), "{name}: no {}", class.name());
            }
        }
    }

    #[test]
    fn a_name_leads_back_to_its_course() {
        for index in 0..COURSES {
            let course = Course::of(index);
            assert_eq!(Course::named(&std::format!("{course}")), Some(course));
        }
        let long = "0".repeat(2 * GENES + 2);
        let strange = "+1".repeat(GENES);
        for broken in ["", "00", "zz", &long, &strange] {
            assert_eq!(Course::named(broken), None, "{broken}");
        }
    }

    #[test]
    fn a_course_is_the_same_whenever_it_runs() {
        let trace = |course: &Course| {
            let mut calls = Vec::new();
            let mut count = 0;
            course.run(
                &mut |_| {
                    count += 1;
                    count
                },
                &mut |call| calls.push(*call),
            );
            calls
        };
        for index in [0, 7, 77] {
            let course = Course::of(index);
            assert_eq!(trace(&course), trace(&course));
        }
    }
}
