//! What is compared, and the table of it.

use crate::check::{self, Agreement};
use crate::child::{Job, Outcome};
use crate::race::{self, Pair, Timed};
use crate::record::{self, Record};
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur::UR10E;
use std::path::Path;

/// Inputs on which both must agree, and those that are timed.
const CHECKED: usize = 100_000;
const TIMED: usize = 1_000;

/// The folders of the workers, by what their compilers were told of the processor: nothing (x86-64), or x86-64-v3.
const BUILDS: [&str; 2] = ["x86-64", "x86-64-v3"];

/// How the answers of two programs are compared.
enum Sameness {
    /// Sets of branches.
    Branches,
    /// One branch, near a seed.
    Nearest,
    /// So many numbers.
    Numbers(usize),
}

/// A line of the table: what ours does, and the peer that does the same work.
struct Line {
    what: &'static str,
    arm: &'static Arm<6>,
    ours: &'static str,
    program: &'static str,
    theirs: &'static str,
    sameness: Sameness,
    builds: &'static [&'static str],
    /// How many times faster ours is meant to be.
    goal: f64,
}

const LINES: [Line; 6] = [
    Line {
        what: "inverse, all branches, each verified",
        arm: &UR10E,
        ours: "all-verified",
        program: "ur-analytic-ik",
        theirs: "all",
        sameness: Sameness::Branches,
        builds: &BUILDS,
        goal: 8.0,
    },
    Line {
        what: "inverse, all branches, none verified",
        arm: &UR10E,
        ours: "all",
        program: "ur-analytic-ik-unverified",
        theirs: "all",
        sameness: Sameness::Branches,
        builds: &BUILDS,
        goal: 8.0,
    },
    Line {
        what: "inverse, nearest branch, verified",
        arm: &UR10E,
        ours: "nearest-verified",
        program: "ur-analytic-ik",
        theirs: "nearest",
        sameness: Sameness::Nearest,
        builds: &BUILDS,
        goal: 30.0,
    },
    Line {
        what: "inverse, nearest branch, not verified",
        arm: &UR10E,
        ours: "nearest",
        program: "ur-analytic-ik-unverified",
        theirs: "nearest",
        sameness: Sameness::Nearest,
        builds: &BUILDS,
        goal: 30.0,
    },
    Line {
        what: "forward, with Jacobian",
        arm: &UR10E,
        ours: "jacobian",
        program: "kdl",
        theirs: "jacobian",
        sameness: Sameness::Numbers(48),
        builds: &BUILDS,
        goal: 20.0,
    },
    Line {
        what: "forward, with Jacobian",
        arm: &UR10E,
        ours: "jacobian",
        program: "kdl-debian",
        theirs: "jacobian",
        sameness: Sameness::Numbers(48),
        builds: &["x86-64"],
        goal: 20.0,
    },
];

/// Compares answers, then time and instructions, of the workers in the folders of `workers`.
///
/// # Errors
/// Answers that differ, or a worker that fails.
pub fn side_by_side(workers: &Path) -> Outcome<()> {
    let folder = tempfile::tempdir()?;
    println!("the same answers at {CHECKED} random poses (seed 1)");
    for line in &LINES {
        let records = record::random(line.arm, CHECKED, 1);
        let inputs = folder.path().join("checked");
        let hash = record::write(&inputs, &records)?;
        println!("  {}; inputs {hash:016x}", line.title());
        for build in line.builds {
            let found = line.compare(&line.pair(&workers.join(build), &inputs, CHECKED), &records);
            let found = found.map_err(|error| format!("{}, {build}: {error}", line.title()))?;
            println!(
                "    {build:<10} {} the same, differing by {:.1e} at most; {} not the same, next to a singularity",
                found.common, found.worst, found.not_common
            );
        }
    }

    let mut pairs = Vec::new();
    for line in &LINES {
        let inputs = folder.path().join(line.arm.name);
        record::write(&inputs, &record::random(line.arm, TIMED, 2))?;
        pairs.extend(line.builds.iter().map(|build| line.pair(&workers.join(build), &inputs, TIMED)));
    }
    let times = pairs.iter().map(race::time).collect::<Outcome<Vec<Timed>>>()?;
    let counts = race::count(&pairs, folder.path())?;

    println!("\none input, of {TIMED} random poses (seed 2)");
    println!("    {:<10} {:>16} {:>18} {:>34}", "", "ours", "theirs", "theirs / ours");
    println!(
        "    {:<10} {:>8} {:>7} {:>10} {:>7} {:>9} {:<13} {:>12} {:>6}",
        "", "ns", "instr.", "ns", "instr.", "time", "(quartiles)", "instructions", "goal"
    );
    let mut rows = times.iter().zip(&counts);
    for line in &LINES {
        println!("  {}", line.title());
        for (build, (time, [ours, theirs])) in line.builds.iter().zip(&mut rows) {
            let [low, median, high] = time.ratio;
            let quartiles = format!("({low:.1}-{high:.1})");
            println!(
                "    {build:<10} {:>8.0} {ours:>7.0} {:>10.0} {theirs:>7.0} {median:>9.1} {quartiles:<13} {:>12.1} {:>6}",
                time.ours,
                time.theirs,
                theirs / ours,
                line.goal
            );
        }
    }
    Ok(())
}

impl Line {
    fn title(&self) -> String {
        format!("{}: {}; {}", self.arm.name, self.what, self.program)
    }

    fn pair(&self, workers: &Path, inputs: &Path, count: usize) -> Pair {
        let job = |program: &str, item: &'static str| Job {
            program: workers.join(program),
            item,
            arm: self.arm.name,
            inputs: inputs.to_path_buf(),
        };
        Pair { ours: job("screed-peers", self.ours), theirs: job(self.program, self.theirs), inputs: count }
    }

    fn compare(&self, pair: &Pair, records: &[Record]) -> Outcome<Agreement> {
        match self.sameness {
            Sameness::Branches => check::branches(&pair.ours, &pair.theirs, records.len()),
            Sameness::Nearest => check::nearest(&pair.ours, &pair.theirs, records),
            Sameness::Numbers(width) => check::numbers(&pair.ours, &pair.theirs, records.len(), width),
        }
    }
}
