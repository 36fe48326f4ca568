//! A search for the worst course: hill climbs over its bytes, one for each arm and class, from the worst that is known.

use super::{ARMS, Call, Class, Course};
use crate::random::Random;

/// The worst call of an arm and class that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Worst {
    /// The course.
    pub course: Course,
    /// Its tick.
    pub tick: u32,
    /// How much it took.
    pub count: u64,
}

/// What is known of every arm and class.
#[derive(Clone, Debug)]
pub struct Climb {
    random: Random,
    worst: [[Option<Worst>; Class::ALL.len()]; ARMS.len()],
}

impl Climb {
    /// Knowing nothing.
    pub const fn new(seed: u64) -> Self {
        Self { random: Random(seed), worst: [[None; Class::ALL.len()]; ARMS.len()] }
    }

    /// Takes in a call of a course.
    pub fn take(&mut self, course: &Course, call: &Call) {
        let slot = self.worst.get_mut(call.arm).and_then(|classes| classes.get_mut(call.class as usize));
        if let Some(slot) = slot
            && slot.is_none_or(|worst| call.count > worst.count)
        {
            *slot = Some(Worst { course: *course, tick: call.tick, count: call.count });
        }
    }

    /// The worst known.
    pub fn worst(&self, arm: usize, class: Class) -> Option<&Worst> {
        self.worst.get(arm)?.get(class as usize)?.as_ref()
    }

    /// A course beside the worst of that arm and class: one to four of its bytes are others, and now and then one byte is one more or
    /// less.
    pub fn beside(&mut self, arm: usize, class: Class) -> Course {
        let Some(worst) = self.worst(arm, class) else { return self.any(arm) };
        let mut course = worst.course;
        for _ in 0..=self.random.below(4) {
            let at = 1 + self.random.below(course.0.len() as u32 - 1) as usize;
            let any = self.random.below(256) as u8;
            let step = if self.random.once_in(2) { 1 } else { u8::MAX };
            let small = self.random.once_in(3);
            if let Some(byte) = course.0.get_mut(at) {
                *byte = if small { byte.wrapping_add(step) } else { any };
            }
        }
        course
    }

    /// A random course of that arm: what a search has to do better than.
    pub fn any(&mut self, arm: usize) -> Course {
        let mut course = Course::random(&mut self.random);
        course.set_arm(arm);
        course
    }
}
