//! The committed figures: the most instructions of each arm and class, on this processor's family and on a Cortex-M7; stack; coverage.
//! `.ci/wcet` counts again and compares; a report shows them beside its own.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The file, as it was when the program was built.
const FILE: &str = include_str!("figures.toml");

/// One line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// How many vectors.
    pub vectors: u64,
    /// The fewest instructions.
    pub min: u64,
    /// The most.
    pub max: u64,
    /// Which vector: number of the course and tick.
    pub worst: String,
    /// Why it is what it is.
    pub reason: String,
}

/// A bound or a measured depth of the stack.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StackFigure {
    /// By the call graph (bytes).
    pub bound: u64,
    /// Functions on the deepest way.
    pub path: Vec<String>,
    /// Functions that were looked at.
    pub functions: u64,
    /// Why it is what it is.
    pub reason: String,
}

/// Branch coverage of what a tick runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coverage {
    /// The command that prints it.
    pub command: String,
    /// Both sides of branches that were taken, and all.
    pub branches: [u64; 2],
    /// Lines that were run, and all.
    pub lines: [u64; 2],
    /// File by file, where not all branches were taken: taken and all.
    pub short: BTreeMap<String, [u64; 2]>,
}

/// Figures of one processor, by arm and class.
pub type ByArm = BTreeMap<String, BTreeMap<String, Figure>>;

/// All of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figures {
    /// The compiler they hold for.
    pub rustc: String,
    /// x86-64, by the profiler.
    pub x86_64: ByArm,
    /// Cortex-M7, by the emulator's timer.
    pub cortex_m7: ByArm,
    /// Painted stack on the Cortex-M7 (bytes), by class.
    pub cortex_m7_painted: BTreeMap<String, u64>,
    /// Bounds by processor and root.
    pub stack: BTreeMap<String, BTreeMap<String, StackFigure>>,
    /// What the vectors cover.
    pub coverage: Coverage,
}

impl Figures {
    /// Those of this build.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn committed() -> Result<Self, String> {
        toml::from_str(FILE).map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use screed_tape::vectors::{ARMS, Class};

    #[test]
    fn the_file_has_every_arm_and_class_and_a_reason_for_each() {
        let figures = Figures::committed().unwrap();
        for by_arm in [&figures.x86_64, &figures.cortex_m7] {
            for arm in ARMS {
                for class in Class::ALL {
                    let figure = &by_arm[arm][class.name()];
                    assert!(
                        figure.min > 0 && figure.min <= figure.max && !figure.reason.is_empty(),
                        "{arm}: {figure:?}"
                    );
                }
            }
            let ticks = by_arm
                .values()
                .flatten()
                .filter(|(class, _)| Class::ALL.iter().any(|c| c.is_tick() && c.name() == *class));
            assert!(ticks.map(|(_, figure)| figure.vectors).sum::<u64>() >= 10_000);
        }
    }
}
