//! Measurements that come late and out of order.

mod common;

use common::Random;
use common::dense::{matrix, stack};
use common::plant::{N, Plant, TRACKER};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::EkfError;
use screed_kernel::ekf::replay::{Measurement, OfferError, Replay, STEP_MEASUREMENTS_MAX, Stamped, WAITING_MAX};
use screed_kernel::units::{JointJerk, JointPos, JointVel, Nanos};

const DEPTH: usize = 24;
const TICK_NS: u64 = 1_000_000;
/// Ticks that a measurement may be late: 20 ms.
const LATE_MAX: u64 = 20;

type Filter = Box<Replay<N, DEPTH>>;

/// A tick's jerk, and measurements with the tick in which each arrives.
struct Tape {
    start: Filter,
    jerks: Vec<JointJerk<N>>,
    measurements: Vec<(u64, Stamped<N>)>,
}

/// Poses at odd times inside the ticks, rates and encoders at the ticks; late by up to [`LATE_MAX`] ticks when arriving.
fn tape(seed: u64, ticks: u64) -> Tape {
    let mut plant = Plant::new(seed, TRACKER, 1e-3);
    let start = Box::new(Replay::new(plant.filter(), Nanos(0)));
    let mut random = Random(seed ^ 7);
    let (mut jerks, mut measurements) = (Vec::new(), Vec::new());
    for tick in 1..=ticks {
        // The plant moves in two parts, and is measured in between.
        let part = random.below(TICK_NS - 2) + 1;
        let before = plant.clone();
        let jerk = plant.step();
        let mut between = before;
        between.truth = between.truth.after(part as f64 * 1e-9, &jerk);
        let at = Nanos((tick - 1) * TICK_NS + part);
        let arrives = |random: &mut Random| tick + if random.below(3) == 0 { random.below(LATE_MAX) } else { 0 };
        measurements.push((arrives(&mut random), Stamped { at, measurement: Measurement::Pose(between.pose()) }));
        let at = Nanos(tick * TICK_NS);
        let (measured, deviation) = plant.rates();
        measurements
            .push((arrives(&mut random), Stamped { at, measurement: Measurement::Rates { measured, deviation } }));
        let (measured, deviation) = plant.encoders();
        let encoders = Measurement::Encoders { measured, deviation };
        measurements.push((arrives(&mut random), Stamped { at, measurement: encoders }));
        jerks.push(jerk);
    }
    Tape { start, jerks, measurements }
}

/// Plays it, each measurement when `arrival` says. Returns the filter and how many steps were done again.
fn play(tape: &Tape, arrival: impl Fn(&(u64, Stamped<N>)) -> u64) -> (Filter, usize) {
    let mut filter = tape.start.clone();
    let mut replayed = 0;
    for (tick, jerk) in (1..).zip(&tape.jerks) {
        let mut offered: Vec<_> = tape.measurements.iter().filter(|one| arrival(one) == tick).collect();
        // In no order.
        offered.reverse();
        for (_, stamped) in offered {
            filter.offer(stamped).unwrap();
        }
        let report = filter.tick(&UR10E, Nanos(tick * TICK_NS), jerk).unwrap();
        assert_eq!((report.too_old, report.crowded, report.deferred, report.error), (0, 0, 0, None), "tick {tick}");
        replayed += report.replayed;
    }
    (filter, replayed)
}

#[test]
fn late_measurements_give_what_those_in_order_give() {
    let ticks = 1000;
    for seed in 0..4 {
        let tape = tape(seed, ticks);
        let in_order = |(_, stamped): &(u64, Stamped<N>)| stamped.at.0.div_ceil(TICK_NS);
        let (straight, none) = play(&tape, in_order);
        // What has not arrived by the last tick is offered then.
        let (late, replayed) = play(&tape, |(arrives, _)| (*arrives).min(ticks));
        assert_eq!(none, 0);
        assert!(replayed > 5 * ticks as usize, "{replayed}");
        let apart = stack(straight.ekf().state()) - stack(late.ekf().state());
        assert!(apart.amax() <= 1e-9, "{:e}", apart.amax());
        assert!((matrix(straight.ekf()) - matrix(late.ekf())).amax() <= 1e-9);
        // And it is a filter that follows.
        let mut plain = *tape.start.ekf();
        for (tick, jerk) in (1..).zip(&tape.jerks) {
            let mut of_tick: Vec<_> = tape.measurements.iter().filter(|one| in_order(one) == tick).collect();
            of_tick.sort_by_key(|(_, stamped)| stamped.at);
            let mut at = (tick - 1) * TICK_NS;
            for (_, stamped) in of_tick {
                if stamped.at.0 > at {
                    plain.predict((stamped.at.0 - at) as f64 * 1e-9, jerk).unwrap();
                }
                plain.measure(&UR10E, &stamped.measurement).unwrap();
                at = stamped.at.0;
            }
        }
        assert_eq!(&plain, straight.ekf());
    }
}

#[test]
fn what_cannot_be_taken_in_is_counted() {
    let tape = tape(9, 60);
    let mut filter = tape.start.clone();
    let rates = |at| Stamped {
        at: Nanos(at),
        measurement: Measurement::Rates { measured: JointVel::ZERO, deviation: JointVel([1.0; N]) },
    };
    for tick in 1..=40 {
        filter.tick(&UR10E, Nanos(tick * TICK_NS), &JointJerk::ZERO).unwrap();
    }
    // The oldest step that is remembered at the next tick begins 23 ticks before this one.
    let oldest = (41 - DEPTH as u64) * TICK_NS;
    for at in [oldest, oldest + 1, 41 * TICK_NS + 1, 42 * TICK_NS] {
        filter.offer(&rates(at)).unwrap();
    }
    let report = filter.tick(&UR10E, Nanos(41 * TICK_NS), &JointJerk::ZERO).unwrap();
    assert_eq!((report.too_old, report.sorted, report.deferred, report.replayed), (1, 1, 2, DEPTH - 1));
    let report = filter.tick(&UR10E, Nanos(42 * TICK_NS), &JointJerk::ZERO).unwrap();
    assert_eq!((report.sorted, report.deferred, report.replayed), (2, 0, 0));
    for k in 0..WAITING_MAX as u64 {
        filter.offer(&rates(43 * TICK_NS - k)).unwrap();
    }
    assert_eq!(filter.offer(&rates(43 * TICK_NS)), Err(OfferError::Full));
    let report = filter.tick(&UR10E, Nanos(43 * TICK_NS), &JointJerk::ZERO).unwrap();
    assert_eq!((report.sorted, report.crowded), (STEP_MEASUREMENTS_MAX, WAITING_MAX - STEP_MEASUREMENTS_MAX));
}

/// A line that says a thing twice, at once or ticks later, tells no more than one that says it once: nothing changes, not a bit.
#[test]
fn what_is_said_twice_counts_once() {
    let tape = tape(11, 200);
    let in_order = |(_, stamped): &(u64, Stamped<N>)| stamped.at.0.div_ceil(TICK_NS);
    let (once, _) = play(&tape, in_order);
    let mut twice = tape.start.clone();
    let mut repeated = 0;
    for (tick, jerk) in (1..).zip(&tape.jerks) {
        for one in &tape.measurements {
            if in_order(one) == tick {
                twice.offer(&one.1).unwrap();
                twice.offer(&one.1).unwrap();
            } else if in_order(one) + 5 == tick {
                twice.offer(&one.1).unwrap();
            }
        }
        let report = twice.tick(&UR10E, Nanos(tick * TICK_NS), jerk).unwrap();
        assert_eq!((report.sorted, report.replayed, report.crowded, report.too_old), (3, 0, 0, 0));
        repeated += report.repeated;
    }
    assert_eq!(repeated, 3 * 200 + 3 * 195);
    assert_eq!(once.ekf(), twice.ekf());
}

#[test]
fn input_without_sense_is_named() {
    let mut filter = tape(9, 1).start;
    let before = *filter.ekf();
    for (now, dt) in [(0, 0.0), (11_000_000_000, 11.0)] {
        assert_eq!(filter.tick(&UR10E, Nanos(now), &JointJerk::ZERO), Err(EkfError::Step { dt }));
    }
    assert_eq!(filter.tick(&UR10E, Nanos(1), &JointJerk([f64::NAN; N])), Err(EkfError::NotFinite));
    assert_eq!(*filter.ekf(), before);
    let nan = Measurement::Encoders { measured: JointPos([f64::NAN; N]), deviation: JointPos([1.0; N]) };
    filter.offer(&Stamped { at: Nanos(TICK_NS), measurement: nan }).unwrap();
    let report = filter.tick(&UR10E, Nanos(TICK_NS), &JointJerk::ZERO).unwrap();
    assert_eq!((report.sorted, report.error), (1, Some(EkfError::NotFinite)));
}

#[test]
fn a_state_ahead_is_where_the_command_will_find_the_arm() {
    let tape = tape(3, 300);
    let (filter, _) = play(&tape, |(_, stamped)| stamped.at.0.div_ceil(TICK_NS));
    let jerk = JointJerk([0.3; N]);
    let (ahead, mut ekf) = (filter.ahead(0.004, &jerk), *filter.ekf());
    ekf.predict(0.004, &jerk).unwrap();
    assert_eq!(ahead, *ekf.state());
}
