//! The filters that are written in Rust, each over a whole tape.

use super::dense::Dense;
use super::literal::Literal;
use super::tape::{DENSITY, DT, N, RATE_DEVIATION, Tape};
use nalgebra::{SMatrix, SVector};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::ekf::replay::{Measurement, Replay, Stamped};
use screed_kernel::ekf::{Ekf, EkfError};
use screed_kernel::units::{JointJerk, JointPos, JointVel, Nanos};

/// Ticks that the replay remembers: 23 ms.
pub const DEPTH: usize = 24;
/// A tick.
const TICK_NS: u64 = 1_000_000;

/// What is left at the end of a tape: θ, θ̇, θ̈, and P.
pub type End = (SVector<f64, 18>, SMatrix<f64, 18, 18>);

/// Ours.
pub fn block(tape: &Tape) -> Ekf<N> {
    let mut ekf = begin(tape);
    for (pose, rates) in &tape.ticks {
        let done = ekf
            .predict(DT, &JointJerk::ZERO)
            .and_then(|()| ekf.pose(&UR10E, pose))
            .and_then(|verdict| if verdict.is_taken() { Ok(()) } else { Err(EkfError::Unsound) })
            .and_then(|()| ekf.rates(rates, &JointVel([RATE_DEVIATION; N])));
        assert!(done.is_ok_and(|verdict| verdict.is_taken()), "{done:?}");
    }
    ekf
}

/// Ours with a whole replay in each tick: encoders of the oldest tick that is remembered arrive (they say next to nothing), and
/// all ticks since are done again, each with its pose and rates.
pub fn replay(tape: &Tape) -> Ekf<N> {
    let mut replay: Box<Replay<N, DEPTH>> = Box::new(Replay::new(begin(tape), Nanos(0)));
    let vague = Measurement::Encoders { measured: tape.start.position, deviation: JointPos([1e6; N]) };
    for (tick, (pose, rates)) in (1..).zip(&tape.ticks) {
        let now = Nanos(tick * TICK_NS);
        let rates = Measurement::Rates { measured: *rates, deviation: JointVel([RATE_DEVIATION; N]) };
        let late = tick.checked_sub(DEPTH as u64 - 1).filter(|late| *late > 0);
        let late = late.map(|late| Stamped { at: Nanos(late * TICK_NS), measurement: vague });
        let own = [Measurement::Pose(*pose), rates].map(|measurement| Some(Stamped { at: now, measurement }));
        for stamped in own.iter().chain([&late]).flatten() {
            assert_eq!(replay.offer(stamped), Ok(()));
        }
        let report = replay.tick(&UR10E, now, &JointJerk::ZERO);
        let expected = if late.is_some() { DEPTH - 1 } else { 0 };
        assert!(report.is_ok_and(|report| report.replayed == expected && report.error.is_none()), "{report:?}");
    }
    *replay.ekf()
}

/// The same filter, dense.
pub fn dense(tape: &Tape) -> End {
    let mut dense = Dense::new(&tape.start, &tape.deviation);
    for (pose, rates) in &tape.ticks {
        dense.tick(pose, rates);
    }
    (dense.x, dense.p)
}

/// The paper's, one line mended, dense.
pub fn literal(tape: &Tape) -> End {
    let mut literal = Literal::new(&tape.start, &tape.deviation, DENSITY, DT);
    for (pose, rates) in &tape.ticks {
        literal.tick(&UR10E, pose, rates, RATE_DEVIATION, true);
    }
    (literal.x, literal.p)
}

fn begin(tape: &Tape) -> Ekf<N> {
    Ekf::new(tape.start, &tape.deviation, &[DENSITY; N]).expect("a sound start")
}

/// One result: θ, θ̇, θ̈, then P row by row.
pub fn show((x, p): &End, numbers: &mut Vec<f64>) {
    numbers.push(1.0);
    numbers.extend(x.iter().chain(p.iter()));
}

/// The same of ours.
pub fn show_block(ekf: &Ekf<N>, numbers: &mut Vec<f64>) {
    let state = ekf.state();
    let x = SVector::from_iterator(state.position.0.into_iter().chain(state.velocity.0).chain(state.acceleration.0));
    let p = SMatrix::from_fn(|row, column| ekf.covariance().get(row, column).unwrap_or(f64::NAN));
    show(&(x, p), numbers);
}
