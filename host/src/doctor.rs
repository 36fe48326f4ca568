//! Whether this machine can hold a hard-timed loop, read from what the kernel tells in `/proc` and `/sys`, and what to change.
//!
//! It finds the causes that are known to cost a loop its time (docs/realtime.md says why each matters); how late the loop really
//! wakes only a measurement tells.

mod interrupts;
mod system;

use crate::config::Realtime;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// How bad a finding is for the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// As it should be.
    Good,
    /// Costs time now and then; the loop runs.
    Poor,
    /// `screed-rt` would refuse to start, or no bound on its lateness can be given.
    Bad,
    /// The system does not tell.
    Unknown,
}

/// One thing looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub what: &'static str,
    /// What was found there.
    pub found: String,
    /// What that means.
    pub verdict: Verdict,
    /// What to do about it; empty where nothing has to be done.
    pub remedy: String,
}

impl Finding {
    fn good(what: &'static str, found: impl Into<String>) -> Self {
        Self { what, found: found.into(), verdict: Verdict::Good, remedy: String::new() }
    }

    fn new(what: &'static str, found: impl Into<String>, verdict: Verdict, remedy: impl Into<String>) -> Self {
        Self { what, found: found.into(), verdict, remedy: remedy.into() }
    }

    fn unknown(what: &'static str, path: &str) -> Self {
        Self::new(what, format!("{path} cannot be read"), Verdict::Unknown, "look at it by hand")
    }
}

/// What was found on a machine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Diagnosis {
    /// The processor that the loop is bound to, if the cell file names one.
    pub cpu: Option<usize>,
    /// The SCHED_FIFO priority wanted.
    pub priority: u8,
    /// Whether nothing bad was found: `screed-rt` will start, and nothing is known to keep it from being on time.
    pub can_hold: bool,
    /// All that was looked at, the worst first.
    pub findings: Vec<Finding>,
}

impl Diagnosis {
    /// Looks at the machine whose file system begins at `root` (`/`, but for tests).
    pub fn of(root: &Path, wanted: &Realtime) -> Self {
        let machine = Machine { root: root.to_owned() };
        let mut findings = vec![
            system::preemption(&machine),
            system::realtime_share(&machine),
            system::priority(&machine, wanted.priority),
            system::locked_memory(&machine),
            system::processor(&machine, wanted.cpu),
            system::isolation(&machine, wanted.cpu),
            system::governor(&machine, wanted.cpu),
            system::idle_states(&machine, wanted.cpu),
            system::clock_source(&machine),
            system::virtual_machine(&machine),
            interrupts::network(&machine, wanted.cpu),
            interrupts::balancer(&machine),
        ];
        findings.sort_by_key(|finding| match finding.verdict {
            Verdict::Bad => 0,
            Verdict::Poor => 1,
            Verdict::Unknown => 2,
            Verdict::Good => 3,
        });
        let can_hold = findings.iter().all(|finding| finding.verdict != Verdict::Bad);
        Self { cpu: wanted.cpu, priority: wanted.priority, can_hold, findings }
    }
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Finding { what, found, verdict, remedy } in &self.findings {
            let mark = match verdict {
                Verdict::Good => "good",
                Verdict::Poor => "POOR",
                Verdict::Bad => "BAD",
                Verdict::Unknown => "?",
            };
            writeln!(f, "  {mark:<5} {what:<22} {found}")?;
            if !remedy.is_empty() {
                writeln!(f, "        {:<22} -> {remedy}", "")?;
            }
        }
        let sum = match self.can_hold {
            true => "nothing here keeps a loop from being hard-timed; how late it wakes, a measurement tells",
            false => "no loop can be held here for certain: see what is BAD",
        };
        writeln!(f, "{sum}")
    }
}

/// A machine's `/proc` and `/sys`.
struct Machine {
    root: PathBuf,
}

impl Machine {
    fn path(&self, path: &str) -> PathBuf {
        self.root.join(path.trim_start_matches('/'))
    }

    /// The text of a file, without the white space around it.
    fn read(&self, path: &str) -> Option<String> {
        Some(std::fs::read_to_string(self.path(path)).ok()?.trim().to_owned())
    }

    /// The names in a folder, in order; none if there is no such folder.
    fn names(&self, path: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(path)).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort();
        names
    }

    /// The processors that are on.
    fn online(&self) -> Vec<usize> {
        self.read("/sys/devices/system/cpu/online").map(|list| processors(&list)).unwrap_or_default()
    }
}

/// The processors of a list as the kernel writes it: "0,2-3".
fn processors(list: &str) -> Vec<usize> {
    let ranges = list.split(',').filter_map(|range| {
        let (first, last) = range.trim().split_once('-').unwrap_or((range.trim(), range.trim()));
        Some(first.parse().ok()?..=last.parse().ok()?)
    });
    // No machine has more; a broken file must not fill the memory.
    ranges.flat_map(|range| range.take(8192)).collect()
}

#[cfg(test)]
mod tests;
