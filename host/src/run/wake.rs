//! A loop that the timer paces: how late it wakes, alone and beside cyclictest.

use crate::latency::Histogram;
use std::io::{self, Error};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Latencies that are told apart (µs): a tenth of a second, the longest stall that a virtual machine's host is known for.
pub const BINS: usize = 100_000;

/// How the loop is paced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    /// Time between wake-ups.
    pub period: Duration,
    /// How long a slice lasts.
    pub length: Duration,
}

/// A slice of the loop: wakes at each point of the grid, and notes how late. Points that are past by then are left out, so that
/// one stall is not counted as many.
///
/// # Errors
/// The system's, when it does not let the loop sleep.
pub fn ours(pace: &Pace) -> io::Result<(Histogram, u64)> {
    let mut histogram = Histogram::new(BINS);
    let mut missed = 0;
    let period = pace.period.as_nanos() as u64;
    let mut due = now()? + period;
    let end = due + pace.length.as_nanos() as u64;
    while due < end {
        sleep_until(due)?;
        let late = now()?.saturating_sub(due);
        histogram.add(u32::try_from(late / 1000).unwrap_or(u32::MAX));
        let passed = late / period;
        missed += passed;
        due += period * (1 + passed);
    }
    Ok((histogram, missed))
}

/// A slice of cyclictest (rt-tests) with the same period, on the same processor and at the same priority.
///
/// # Errors
/// A program that is not installed, fails, or prints something else than its histogram.
pub fn cyclictest(pace: &Pace, priority: u8, cpu: usize) -> io::Result<Histogram> {
    let (period, loops) = (pace.period.as_micros(), pace.length.as_nanos() / pace.period.as_nanos().max(1));
    let arguments = format!("--quiet --mlockall --threads=1 --interval={period} --loops={loops} --histogram={BINS}");
    let mut command = Command::new("cyclictest");
    command.args(arguments.split(' ')).arg(format!("--priority={priority}")).arg(format!("--affinity={cpu}"));
    let output = command.stdin(Stdio::null()).output().map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => Error::other("cyclictest is not installed (apt-get install rt-tests)"),
        _ => error,
    })?;
    let said = String::from_utf8_lossy(&output.stdout);
    match histogram_of(&said) {
        Some(histogram) if output.status.success() => Ok(histogram),
        _ => Err(Error::other(format!("cyclictest failed: {}", String::from_utf8_lossy(&output.stderr).trim()))),
    }
}

/// The histogram that cyclictest prints: a line `000123 000045` a microsecond, and comments, of which one tells what lay beyond
/// and one the largest.
fn histogram_of(said: &str) -> Option<Histogram> {
    let mut histogram = Histogram::new(BINS);
    for line in said.lines().filter(|line| !line.starts_with('#') && !line.trim().is_empty()) {
        let mut words = line.split_whitespace();
        histogram.add_many(words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    }
    let comment = |name: &str| said.lines().find_map(|line| line.strip_prefix(name)?.trim().parse::<u64>().ok());
    let beyond = comment("# Histogram Overflows:")?;
    let largest = comment("# Max Latencies:")?;
    histogram.add_many(u32::try_from(largest).unwrap_or(u32::MAX).max(BINS as u32), beyond);
    (histogram.total() > 0).then_some(histogram)
}

/// Nanoseconds of the monotonic clock.
///
/// # Errors
/// The system's.
pub fn now() -> io::Result<u64> {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the structure outlives the call.
    if unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut time) } != 0 {
        return Err(Error::last_os_error());
    }
    Ok(time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64)
}

/// Sleeps to a point of time, not for a while: what is late does not add up.
///
/// # Errors
/// The system's.
pub fn sleep_until(at: u64) -> io::Result<()> {
    let time = libc::timespec { tv_sec: (at / 1_000_000_000) as _, tv_nsec: (at % 1_000_000_000) as _ };
    loop {
        // SAFETY: the structure outlives the call; nothing is written.
        let code = unsafe {
            libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &raw const time, std::ptr::null_mut())
        };
        match code {
            0 => return Ok(()),
            libc::EINTR => {}
            code => return Err(Error::from_raw_os_error(code)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cyclictest_prints_is_read() {
        let said = "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n000019 000003\n000020 000001\n\
                    # Total: 000000006\n# Min Latencies: 00019\n# Avg Latencies: 00047\n# Max Latencies: 120820\n\
                    # Histogram Overflows: 00002\n# Histogram Overflow at cycle number:\n# Thread 0: 00000 00001\n";
        let histogram = histogram_of(said).unwrap();
        assert_eq!((histogram.total(), histogram.max_us(), histogram.quantile_us(0.5)), (6, 120_820, Some(19)));
        for broken in ["", "000019 x\n", "# Histogram Overflows: 0\n# Max Latencies: 1\n", "000019 000003\n"] {
            assert_eq!(histogram_of(broken), None, "{broken:?}");
        }
    }

    #[test]
    fn each_point_of_the_grid_is_counted_or_missed() {
        let pace = Pace { period: Duration::from_millis(1), length: Duration::from_millis(100) };
        let (histogram, missed) = ours(&pace).unwrap();
        assert!((histogram.total() + missed) >= 100, "{missed}");
        assert!(histogram.total() <= 100);
    }
}
