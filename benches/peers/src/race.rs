//! Time and instructions, ours beside theirs.

use crate::child::{Job, Outcome, Worker};
use std::path::Path;
use std::sync::Mutex;
use std::thread;

/// How long a slice lasts at least, about (ns). The two take turns, so that whatever slows the machine for a while slows
/// both; and slices are short, so that many are not interrupted.
const SLICE: f64 = 2e6;

/// Slices of each.
const ROUNDS: usize = 101;

/// Two programs that do the same work on the same inputs.
pub struct Pair {
    /// Ours.
    pub ours: Job,
    /// The peer's.
    pub theirs: Job,
    /// Inputs in the file that both have.
    pub inputs: usize,
}

/// Processor time for one input.
pub struct Timed {
    /// Ours: the median over all slices (ns).
    pub ours: f64,
    /// Theirs.
    pub theirs: f64,
    /// Theirs over ours, slice by slice: lower quartile, median, upper quartile.
    pub ratio: [f64; 3],
}

/// Runs both in turns and takes the time.
///
/// # Errors
/// A worker that does not start or does not answer.
pub fn time(pair: &Pair) -> Outcome<Timed> {
    let (mut ours, mut theirs) = (Runner::start(&pair.ours, pair.inputs)?, Runner::start(&pair.theirs, pair.inputs)?);
    let (mut ours_ns, mut theirs_ns, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for round in 0..ROUNDS {
        let (a, b) = if round % 2 == 0 {
            let first = ours.slice()?;
            (first, theirs.slice()?)
        } else {
            let first = theirs.slice()?;
            (ours.slice()?, first)
        };
        ours_ns.push(a);
        theirs_ns.push(b);
        ratios.push(b / a);
    }
    let [_, ours, _] = quartiles(ours_ns);
    let [_, theirs, _] = quartiles(theirs_ns);
    Ok(Timed { ours, theirs, ratio: quartiles(ratios) })
}

/// Instructions for one input, ours and theirs, of each pair. Counting disturbs nobody, so all processors do it.
///
/// # Errors
/// A worker or valgrind that fails.
pub fn count(pairs: &[Pair], folder: &Path) -> Outcome<Vec<[f64; 2]>> {
    let jobs: Vec<(&Job, usize)> = pairs.iter().flat_map(|p| [(&p.ours, p.inputs), (&p.theirs, p.inputs)]).collect();
    let next = Mutex::new(jobs.iter().enumerate());
    let mut counts = vec![0.0; jobs.len()];
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let counted = thread::scope(|scope| {
        let counters: Vec<_> = (0..threads)
            .map(|thread| {
                let (next, scratch) = (&next, folder.join(format!("callgrind-{thread}")));
                scope.spawn(move || {
                    let mut counted = Vec::new();
                    loop {
                        let Some((index, (job, inputs))) = next.lock().map_err(|_| "a counter died")?.next() else {
                            return Ok(counted);
                        };
                        counted.push((index, job.instructions(*inputs, &scratch)?));
                    }
                })
            })
            .collect();
        counters.into_iter().map(|counter| counter.join().unwrap_or_else(|_| Err("a counter died".into()))).collect()
    });
    let counted: Outcome<Vec<Vec<(usize, f64)>>> = counted;
    for (index, count) in counted?.into_iter().flatten() {
        counts[index] = count;
    }
    Ok(counts.as_chunks().0.to_vec())
}

/// A worker with as many passes a slice as it needs.
struct Runner {
    worker: Worker,
    passes: u64,
    inputs: usize,
}

impl Runner {
    fn start(job: &Job, inputs: usize) -> Outcome<Self> {
        let mut worker = job.start()?;
        worker.run(1)?;
        let passes = (SLICE / worker.run(1)?.max(1.0)).ceil().clamp(1.0, 1e9) as u64;
        Ok(Self { worker, passes, inputs })
    }

    fn slice(&mut self) -> Outcome<f64> {
        Ok(self.worker.run(self.passes)? / (self.passes as f64 * self.inputs as f64))
    }
}

fn quartiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [1, 2, 3].map(|quarter| values[quarter * (values.len() - 1) / 4])
}
