//! Acts in real time: those with a time from the command line, and those that come as lines while the server runs.

use super::SimError;
use crate::sim::ur::act::{Act, Fault};
use crate::sim::ur::shorten;
use std::io::{self, BufRead, Write};
use std::sync::mpsc::{Receiver, channel};

/// Lines on the standard error output, and how long each is (bytes): together less than a pipe holds that nobody reads, for a
/// full one would stop the clock.
const SAID_MAX: u32 = 200;
const SAID_LEN: usize = 240;

/// What is still to be done.
pub(super) struct Orders {
    /// With the cycle they are due in, the next one last.
    faults: Vec<(u64, Fault)>,
    lines: Option<Receiver<String>>,
    json: bool,
    /// Lines said so far.
    said: u32,
}

impl Orders {
    /// Faults at their times, and lines from the standard input where `control` says so.
    pub(super) fn new(faults: &[Fault], cycles_per_second: u32, control: bool, json: bool) -> Self {
        let due = |fault: &Fault| (fault.at * f64::from(cycles_per_second)).round() as u64;
        let mut faults: Vec<_> = faults.iter().map(|fault| (due(fault), fault.clone())).collect();
        // Stable: those of the same time in their order, once the list is read from its end.
        faults.reverse();
        faults.sort_by_key(|(due, _)| std::cmp::Reverse(*due));
        let lines = control.then(|| {
            let (sender, receiver) = channel();
            // Ends with the input, or with the process.
            std::thread::spawn(move || {
                let mut lines = io::stdin().lock().lines();
                while let Some(Ok(line)) = lines.next() {
                    if sender.send(line).is_err() {
                        break;
                    }
                }
            });
            receiver
        });
        Self { faults, lines, json, said: 0 }
    }

    /// The next act to be done in this cycle, if any, and how it was written; a line that is none is told.
    pub(super) fn next(&mut self, cycle: u64) -> Result<Option<(Act, String)>, SimError> {
        if let Some((_, fault)) = self.faults.pop_if(|(due, _)| *due <= cycle) {
            return Ok(Some((fault.act, fault.text)));
        }
        while let Some(line) = self.lines.as_ref().and_then(|lines| lines.try_recv().ok()) {
            if line.trim().is_empty() {
                continue;
            }
            match line.parse() {
                Ok(act) => return Ok(Some((act, line.trim().to_owned()))),
                Err(told) => self.say(&format!("{line}: {told}"), "error", &told)?,
            }
        }
        Ok(None)
    }

    /// Says what was done, and when, in control cycles since the server's start.
    pub(super) fn report(&self, cycle: u64, act: &str, done: bool) -> Result<(), SimError> {
        if self.json {
            return say(&serde_json::json!({"cycle": cycle, "act": act, "done": done}).to_string());
        }
        say(&format!("cycle {cycle}: {act} {}", if done { "done" } else { "refused in this state" }))
    }

    /// Says, on the standard error output, why a program stopped or was refused. The standard output answers who asked.
    pub(super) fn announce(&mut self, cycle: u64, told: &str) {
        self.said = self.said.saturating_add(1);
        let told = match self.said {
            ..SAID_MAX => shorten(told, SAID_LEN),
            SAID_MAX => "more is told to the clients only",
            _ => return,
        };
        let line = if self.json {
            serde_json::json!({"cycle": cycle, "told": told}).to_string()
        } else {
            format!("cycle {cycle}: {told}")
        };
        // Nobody may be listening; the log and the clients have it too.
        let _ = writeln!(io::stderr(), "{line}");
    }

    fn say(&self, sentence: &str, key: &str, value: &str) -> Result<(), SimError> {
        if self.json { say(&serde_json::json!({ key: value }).to_string()) } else { say(sentence) }
    }
}

/// One line, at once; whoever started this process may be waiting for it.
pub(super) fn say(line: &str) -> Result<(), SimError> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).map_err(|source| SimError::Output { source })
}
