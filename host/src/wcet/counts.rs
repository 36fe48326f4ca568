//! Instructions of each measured call, counted exactly: this program runs its courses once more under
//! `valgrind --tool=callgrind`, which counts inside the measured functions only and writes a sum after each call of one.
//!
//! A processor's own counters would do the same faster; a virtual machine has none. What is counted is every instruction of the call
//! that a user program can see, the C library's included, whose variants are pinned to the plain ones.

use super::WcetError;
use screed_tape::vectors::{Call, Course, Edge};
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};

/// The module whose functions are measured, as the profiler names it.
const MEASURED: &str = "screed_tape::vectors::measured::";

/// Which variants of its functions the C library may choose is the processor's matter; the same on each, so that counts can be
/// compared.
const PLAIN_LIBRARY: &str = "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX2,-AVX,-ERMS,-FSRM,-BMI2";

/// Functions that are counted as part of the one that calls them. A sum lists every function on its own, and the profiler works for
/// longest on these lists; the sums stay the same, a fifth of the time is left.
const NOT_LISTED: [&str; 16] = [
    "screed_kernel*",
    "<screed_kernel*",
    "screed::run*",
    "<screed::run*",
    "screed::link*",
    "<screed::link*",
    "*nalgebra*",
    "*heapless*",
    "*postcard*",
    "*serde_core*",
    "*libm*",
    "*core::*",
    "*alloc::*",
    "mem*",
    "__mem*",
    "*malloc*",
];

/// A call with its course.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counted {
    /// The course.
    pub course: Course,
    /// The call; its count is in instructions.
    pub call: Call,
}

/// Runs courses and nothing else: what the profiler looks at.
pub fn play(courses: &[Course]) {
    for course in courses {
        std::hint::black_box(course.run(&mut |_: Edge| 0, &mut |call| {
            std::hint::black_box(call);
        }));
    }
}

/// Instructions of every measured call of these courses, in order.
///
/// # Errors
/// [`WcetError`] when valgrind is not installed, fails or saw other calls than there were.
pub fn count(courses: &[Course]) -> Result<Vec<Counted>, WcetError> {
    let mut counted = Vec::new();
    for course in courses {
        course.run(&mut |_: Edge| 0, &mut |call| counted.push(Counted { course: *course, call: *call }));
    }
    let folder =
        tempfile::tempdir().map_err(|error| WcetError::file(Path::new("a folder for the profiler"), &error))?;
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    let shares: Vec<&[Course]> = courses.chunks(courses.len().div_ceil(workers).max(1)).collect();
    let sums: Result<Vec<Vec<u64>>, WcetError> = std::thread::scope(|scope| {
        let started: Vec<_> = shares
            .iter()
            .enumerate()
            .map(|(k, share)| {
                let (list, file) =
                    (folder.path().join(format!("courses{k}")), folder.path().join(format!("counts{k}")));
                scope.spawn(move || {
                    write_list(&list, share)?;
                    profile(
                        MEASURED,
                        &["receive", "plain", "closed", "transmit"],
                        &["--play", &list.to_string_lossy()],
                        &file,
                    )
                })
            })
            .collect();
        let join = |thread: std::thread::ScopedJoinHandle<'_, _>| {
            thread.join().unwrap_or_else(|_| Err(WcetError::Valgrind("was not waited for".to_owned())))
        };
        started.into_iter().map(join).collect()
    });
    let sums = sums?.concat();
    if sums.len() != counted.len() {
        return Err(WcetError::Calls { expected: counted.len(), found: sums.len() });
    }
    for (counted, sum) in counted.iter_mut().zip(sums) {
        counted.call.count = sum;
    }
    Ok(counted)
}

/// Instructions of so many cycles of the demo's print, in order.
///
/// # Errors
/// As [`count`].
pub fn count_cycles(cycles: usize) -> Result<Vec<u64>, WcetError> {
    let folder =
        tempfile::tempdir().map_err(|error| WcetError::file(Path::new("a folder for the profiler"), &error))?;
    let file = folder.path().join("counts");
    let sums = profile("screed::wcet::cycle::measured::", &["cycle"], &["--play-cycles", &cycles.to_string()], &file)?;
    if sums.len() != cycles {
        return Err(WcetError::Calls { expected: cycles, found: sums.len() });
    }
    Ok(sums)
}

/// Runs this program under the profiler: the sums of each call of these functions of a module.
fn profile(module: &str, functions: &[&str], play: &[&str], file: &Path) -> Result<Vec<u64>, WcetError> {
    let program = std::env::current_exe().map_err(|error| WcetError::file(Path::new("/proc/self/exe"), &error))?;
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--combine-dumps=yes", "--collect-atstart=no", "--dump-line=no"])
        .arg("--read-inline-info=no")
        .arg(format!("--toggle-collect={module}*"))
        .args(functions.iter().map(|name| format!("--dump-after={module}{name}*")))
        .args(NOT_LISTED.map(|names| format!("--fn-skip={names}")))
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(program)
        .arg("wcet")
        .args(play)
        .env("GLIBC_TUNABLES", PLAIN_LIBRARY)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .output()
        .map_err(|error| WcetError::Valgrind(format!("does not start: {error}")))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let last = said.lines().last().unwrap_or("").to_owned();
        return Err(WcetError::Valgrind(format!("{}: {last}", output.status)));
    }
    let reader = BufReader::new(File::open(file).map_err(|error| WcetError::file(file, &error))?);
    let mut sums = Vec::new();
    for line in reader.lines() {
        let line = line.map_err(|error| WcetError::file(file, &error))?;
        if let Some(sum) = line.strip_prefix("summary: ") {
            sums.push(sum.trim().parse().map_err(|_| WcetError::Valgrind(format!("wrote the sum {sum}")))?);
        }
    }
    // What ran behind the last measured call: the end of the program.
    sums.pop();
    Ok(sums)
}

fn write_list(path: &Path, courses: &[Course]) -> Result<(), WcetError> {
    let text: String = courses.iter().map(|course| format!("{course}\n")).collect();
    File::create(path)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .map_err(|error| WcetError::file(path, &error))
}

/// A list of courses from a file, one a line, two hexadecimal digits a byte.
///
/// # Errors
/// [`WcetError::File`], [`WcetError::Course`].
pub fn read_list(path: &Path) -> Result<Vec<Course>, WcetError> {
    let text = fs::read_to_string(path).map_err(|error| WcetError::file(path, &error))?;
    text.lines().map(|line| Course::named(line).ok_or_else(|| WcetError::Course(line.to_owned()))).collect()
}
