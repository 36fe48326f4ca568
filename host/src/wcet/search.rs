//! A search for the worst input: hill climbs over the bytes of courses, beside as many random courses, counted by the profiler.

use super::WcetError;
use super::counts::{self, Counted};
use screed_tape::vectors::climb::Climb;
use screed_tape::vectors::{ARMS, Class, Course};
use serde::Serialize;

/// Seed of the search.
const SEED: u64 = 61_126;

/// How far a search goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Arms that are searched, the first ones of the list.
    pub arms: usize,
    /// Rounds of the climb.
    pub rounds: usize,
    /// Courses tried for each arm and class in a round.
    pub tries: usize,
}

/// What the search found for one arm and class.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// The arm.
    pub arm: &'static str,
    /// The class.
    pub class: &'static str,
    /// The most of the committed courses.
    pub before: u64,
    /// The most of as many random courses more as the climb tried.
    pub random: u64,
    /// The most that the climb came to.
    pub climbed: u64,
    /// The most that the climb had come to after each round.
    pub rounds: Vec<u64>,
    /// The most of the random courses after each round.
    pub random_rounds: Vec<u64>,
    /// The course that took the most of all, and its tick.
    pub worst: String,
}

/// What the search did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Search {
    /// Courses that the climbs tried, and as many random ones.
    pub courses: usize,
    /// What was found.
    pub found: Vec<Found>,
}

/// The classes that are searched: those that cost anything.
fn classes() -> impl Iterator<Item = Class> {
    Class::ALL.into_iter().filter(|class| *class != Class::Answers)
}

/// Searches from what is known.
///
/// # Errors
/// As [`counts::count`].
pub fn search(known: &[Counted], effort: Effort, mut say: impl FnMut(&str)) -> Result<Search, WcetError> {
    let (mut climb, mut random) = (Climb::new(SEED), Climb::new(SEED + 1));
    known.iter().for_each(|counted| climb.take(&counted.course, &counted.call));
    let aims: Vec<(usize, Class)> =
        (0..effort.arms.min(ARMS.len())).flat_map(|arm| classes().map(move |class| (arm, class))).collect();
    let before: Vec<u64> = aims.iter().map(|(arm, class)| most(&climb, *arm, *class)).collect();
    let mut rounds = vec![(Vec::new(), Vec::new()); aims.len()];
    let mut tried = 0;
    for round in 0..effort.rounds {
        let mut courses: Vec<Course> = Vec::new();
        for (arm, class) in &aims {
            courses.extend((0..effort.tries).map(|_| climb.beside(*arm, *class)));
        }
        tried += courses.len();
        for counted in counts::count(&courses)? {
            climb.take(&counted.course, &counted.call);
        }
        let others: Vec<Course> = courses.iter().map(|course| random.any(course.arm())).collect();
        for counted in counts::count(&others)? {
            random.take(&counted.course, &counted.call);
        }
        for ((arm, class), (climbed, chance)) in aims.iter().zip(&mut rounds) {
            climbed.push(most(&climb, *arm, *class));
            chance.push(most(&random, *arm, *class));
        }
        say(&format!("search: round {} of {}, {tried} courses and as many random ones", round + 1, effort.rounds));
    }
    let worst = |(arm, class): &(usize, Class)| {
        let both = [climb.worst(*arm, *class), random.worst(*arm, *class)];
        both.into_iter().flatten().max_by_key(|worst| worst.count)
    };
    for (aim, before) in aims.iter().zip(&before) {
        if let Some(worst) = worst(aim).filter(|worst| worst.count > *before) {
            let (arm, class) = (ARMS[aim.0], aim.1.name());
            say(&format!("search: {arm}, {class}: {} instead of {before}, by {}", worst.count, worst.course));
        }
    }
    let found = aims.iter().zip(before).zip(rounds).map(|((aim, before), (rounds, random_rounds))| Found {
        arm: ARMS[aim.0],
        class: aim.1.name(),
        before,
        random: most(&random, aim.0, aim.1),
        climbed: most(&climb, aim.0, aim.1),
        rounds,
        random_rounds,
        worst: worst(aim).map_or(String::new(), |worst| format!("{} tick {}", worst.course, worst.tick)),
    });
    Ok(Search { courses: tried, found: found.collect() })
}

fn most(climb: &Climb, arm: usize, class: Class) -> u64 {
    climb.worst(arm, class).map_or(0, |worst| worst.count)
}
