//! A worker as its parent sees it.

use std::error::Error;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// What can fail, with a message that says what to do.
pub type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Which program does which work.
pub struct Job {
    /// The worker's executable.
    pub program: PathBuf,
    /// What it is to do.
    pub item: &'static str,
    /// For which arm.
    pub arm: &'static str,
    /// The file of inputs.
    pub inputs: PathBuf,
}

/// A worker that waits for orders.
pub struct Worker {
    name: String,
    child: Child,
    orders: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Job {
    /// Starts the worker.
    pub fn start(&self) -> Outcome<Worker> {
        let name = format!("{} {}", self.program.display(), self.item);
        let mut child = Command::new(&self.program)
            .arg(self.item)
            .arg(self.arm)
            .arg(&self.inputs)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("{name}: {error}"))?;
        let (orders, answers) = (child.stdin.take().ok_or("no pipe")?, child.stdout.take().ok_or("no pipe")?);
        Ok(Worker { name, child, orders, answers: BufReader::new(answers) })
    }

    /// Instructions for one input on average, setting up left out: what a second pass adds, by valgrind's callgrind.
    pub fn instructions(&self, inputs: usize, scratch: &Path) -> Outcome<f64> {
        let [one, two] = [1, 2].map(|passes| self.count(passes, scratch));
        Ok((two? - one?) as f64 / inputs as f64)
    }

    fn count(&self, passes: u32, scratch: &Path) -> Outcome<i64> {
        let status = Command::new("valgrind")
            .arg("--tool=callgrind")
            .arg(format!("--callgrind-out-file={}", scratch.display()))
            .arg(&self.program)
            .arg(self.item)
            .arg(self.arm)
            .arg(&self.inputs)
            .arg(passes.to_string())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .map_err(|error| format!("valgrind does not start: {error}; install it (apt-get install valgrind)"))?;
        if !status.success() {
            return Err(format!("valgrind {} {}: {status}", self.program.display(), self.item).into());
        }
        let text = fs::read_to_string(scratch)?;
        let total = text.lines().find_map(|line| line.strip_prefix("summary: ")).ok_or("valgrind wrote no summary")?;
        Ok(total.trim().parse()?)
    }
}

impl Worker {
    /// Nanoseconds that so many passes over its inputs take.
    pub fn run(&mut self, passes: u64) -> Outcome<f64> {
        self.order(&format!("run {passes}\n"))?;
        let mut line = String::new();
        self.answers.read_line(&mut line)?;
        line.trim().parse().map_err(|_| format!("{}: answered {line:?}", self.name).into())
    }

    /// Asks for all its results; [`Self::answer`] then gives them, one input after the other.
    pub fn show(&mut self) -> Outcome<()> {
        self.order("show\n")
    }

    /// The results for the next input, of `width` numbers each.
    pub fn answer(&mut self, width: usize) -> Outcome<Vec<Vec<f64>>> {
        let count = self.number()?;
        if !(0.0..=64.0).contains(&count) {
            return Err(format!("{}: {count} results for one input", self.name).into());
        }
        (0..count as usize).map(|_| (0..width).map(|_| self.number()).collect()).collect()
    }

    fn number(&mut self) -> Outcome<f64> {
        let mut bytes = [0; 8];
        self.answers.read_exact(&mut bytes).map_err(|error| format!("{}: {error}", self.name))?;
        Ok(f64::from_le_bytes(bytes))
    }

    fn order(&mut self, order: &str) -> Outcome<()> {
        self.orders.write_all(order.as_bytes()).map_err(|error| format!("{}: {error}", self.name).into())
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // It may be in the middle of an answer that nobody wants any more.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
