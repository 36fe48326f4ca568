//! A tick of the kernel's filter, prediction, pose and joint rates, beside dense filters: the same estimate first, then time
//! and instructions. `.ci/filter_peers` builds the workers and starts this.

mod dense;
#[path = "../../../kernel/tests/common/literal.rs"]
#[allow(dead_code)] // The tests use the rest.
mod literal;
mod operations;
pub mod tape;
pub mod work;

use crate::child::{Job, Outcome};
use crate::race::{self, Pair};
use std::path::Path;

/// Ticks of the tape.
const TICKS: usize = 1000;

/// The folders of the workers, by what their compilers were told of the processor; valgrind does not know all that the last uses.
const BUILDS: [&str; 3] = ["x86-64", "x86-64-v3", "native"];
const COUNTED: usize = 2;

/// Numbers of an estimate: θ, θ̇, θ̈ and P.
const STATE: usize = 18;
const WIDTH: usize = STATE + STATE * STATE;

/// A peer, how far its estimate may be from ours at the end in standard deviations, and how many times faster ours is
/// meant to be.
struct Peer {
    title: &'static str,
    program: &'static str,
    item: &'static str,
    apart: f64,
    goal: Option<f64>,
}

/// Twelve rows are the kernel's own filter. Thirteen are another linearisation of the same measurements: quaternions that are
/// subtracted, and nothing for what the pose bends away from its tangent.
const PEERS: [Peer; 5] = [
    Peer { title: "nalgebra, 12 rows", program: "screed-peers", item: "filter-dense", apart: 1e-6, goal: Some(8.0) },
    Peer { title: "nalgebra, 13 rows", program: "screed-peers", item: "filter-literal", apart: 0.1, goal: Some(8.0) },
    Peer { title: "Eigen, 12 rows", program: "eigen-ekf", item: "12", apart: 1e-6, goal: Some(5.0) },
    Peer { title: "Eigen, 13 rows", program: "eigen-ekf", item: "13", apart: 0.1, goal: Some(5.0) },
    Peer { title: "a whole replay a tick", program: "screed-peers", item: "filter-replay", apart: 1e-6, goal: None },
];

/// Compares estimates, then time and instructions, of the workers in the folders of `workers`.
///
/// # Errors
/// Estimates that differ, or a worker that fails.
pub fn side_by_side(workers: &Path) -> Outcome<()> {
    let folder = tempfile::tempdir()?;
    let inputs = folder.path().join("tape");
    let hash = tape::write(&inputs, &tape::random(TICKS, 2))?;
    println!("{TICKS} ticks of a pose and joint rates (seed 2); inputs {hash:016x}");
    println!("the same estimate at the end, in standard deviations");
    let mut pairs = Vec::new();
    for build in BUILDS {
        pairs.extend(PEERS.iter().map(|peer| peer.pair(&workers.join(build), &inputs)));
    }
    for (peer, pair) in PEERS.iter().cycle().zip(&pairs) {
        let [state, covariance] = compare(pair)?;
        let (worst, kind) = (state.max(covariance), pair.ours.program.parent().and_then(Path::file_name));
        println!(
            "    {:<10} {:<22} state {state:.1e}, covariance {covariance:.1e}; at most {:.0e}",
            kind.unwrap_or_default().display(),
            peer.title,
            peer.apart
        );
        if worst.is_nan() || worst > peer.apart {
            return Err(format!("{}: {worst:e} apart", peer.title).into());
        }
    }
    let times = pairs.iter().map(race::time).collect::<Outcome<Vec<_>>>()?;
    let counts = pairs[..COUNTED * PEERS.len()].iter().map(|pair| counted(pair, folder.path())).collect::<Vec<_>>();
    let necessary = operations::necessary();
    println!("\nwhat a tick has to compute (docs/estimation.md): {necessary}");
    println!("\na tick; ns of processor time, median");
    println!(
        "    {:<10} {:<22} {:>8} {:>7} {:>10} {:>7} {:>8} {:<13} {:>12} {:>5} {:>18}",
        "",
        "",
        "ours ns",
        "instr.",
        "theirs ns",
        "instr.",
        "ratio",
        "(quartiles)",
        "instructions",
        "goal",
        "ours / necessary"
    );
    for (index, (peer, timed)) in PEERS.iter().cycle().zip(&times).enumerate() {
        let [low, median, high] = timed.ratio;
        let counts = counts.get(index).copied().flatten();
        let count = |which: usize| counts.map_or("-".to_owned(), |counts| format!("{:.0}", counts[which]));
        let of_counts =
            |value: &dyn Fn([f64; 2]) -> f64| counts.map_or("-".to_owned(), |counts| format!("{:.2}", value(counts)));
        println!(
            "    {:<10} {:<22} {:>8.0} {:>7} {:>10.0} {:>7} {median:>8.2} {:<13} {:>12} {:>5} {:>18}",
            BUILDS[index / PEERS.len()],
            peer.title,
            timed.ours,
            count(0),
            timed.theirs,
            count(1),
            format!("({low:.1}-{high:.1})"),
            of_counts(&|[ours, theirs]| theirs / ours),
            peer.goal.map_or(String::new(), |goal| goal.to_string()),
            of_counts(&|[ours, _]| ours / necessary.operations()),
        );
    }
    println!("a whole replay: {} ticks, each of a prediction, a pose and rates", work::DEPTH);
    Ok(())
}

impl Peer {
    fn pair(&self, workers: &Path, inputs: &Path) -> Pair {
        let job =
            |program, item| Job { program: workers.join(program), item, arm: "ur10e", inputs: inputs.to_path_buf() };
        Pair { ours: job("screed-peers", "filter-block"), theirs: job(self.program, self.item), inputs: TICKS }
    }
}

/// Instructions a tick of ours and theirs, unless valgrind meets one that it does not know.
fn counted(pair: &Pair, folder: &Path) -> Option<[f64; 2]> {
    match race::count(std::slice::from_ref(pair), folder) {
        Ok(counts) => counts.first().copied(),
        Err(error) => {
            println!("not counted: {error}");
            None
        }
    }
}

/// How far apart both end: of states the largest difference over our standard deviation, of covariances over two of them.
fn compare(pair: &Pair) -> Outcome<[f64; 2]> {
    let estimate = |job: &Job| -> Outcome<Vec<f64>> {
        let mut worker = job.start()?;
        worker.show()?;
        worker.answer(WIDTH)?.pop().ok_or_else(|| "no estimate".into())
    };
    let (ours, theirs) = (estimate(&pair.ours)?, estimate(&pair.theirs)?);
    let deviation = |i: usize| ours[STATE + i * STATE + i].sqrt();
    let mut apart = [0.0; 2];
    for i in 0..STATE {
        let state = (ours[i] - theirs[i]).abs() / deviation(i);
        apart[0] = larger(apart[0], state);
        for j in 0..STATE {
            let at = STATE + i * STATE + j;
            apart[1] = larger(apart[1], (ours[at] - theirs[at]).abs() / (deviation(i) * deviation(j)));
        }
    }
    Ok(apart)
}

/// The larger one; NaN stays.
fn larger(a: f64, b: f64) -> f64 {
    if a >= b { a } else { b }
}
