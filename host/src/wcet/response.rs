//! From the instant at which a cycle is due to the instant at which its answer is on the wire: wake-up, cycle, input and output, paced
//! by the timer, with a real loopback connection under it.

use super::WcetError;
use super::cycle::{self, Print};
use super::times::{Condition, Summary};
use crate::config::Cell;
use crate::run::wake::{now, sleep_until};
use serde::Serialize;
use statrs::distribution::{Beta, ContinuousCDF};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};

/// The simulated surroundings need so long before the next cycle (ns); a cycle that would be due earlier is not begun.
const ROOM_NS: u64 = 200_000;

/// What cycles of one period came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Response {
    /// From one due instant to the next (ns).
    pub period_ns: u64,
    /// From due to awake.
    pub wake_up: Summary,
    /// The cycle itself, from the telegram's bytes to the answer's.
    pub cycle: Summary,
    /// Reading the telegram from its socket and writing the answer to it.
    pub input_output: Summary,
    /// From due to the answer written.
    pub response: Summary,
    /// Cycles, every one: the stall rule leaves none out here.
    pub cycles: usize,
    /// Answers later than a period after they were due.
    pub misses: usize,
    /// Cycles that fell due while a late one still ran, and were passed over: they are not among `cycles`.
    pub passed_over: u64,
    /// The probability of a miss is below this with 95 % confidence, were cycles independent.
    pub miss_probability_at_most: f64,
}

/// The four parts of a cycle (ns).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parts {
    /// From due to awake.
    pub wake_up: u64,
    /// The cycle.
    pub cycle: u64,
    /// Input and output.
    pub input_output: u64,
    /// From due to the answer written.
    pub response: u64,
}

/// Runs so many cycles of the demo's print, each when it is due.
///
/// # Errors
/// [`WcetError`] where the print or the connection fails.
pub fn measure(period_ns: u64, cycles: usize) -> Result<Vec<Parts>, WcetError> {
    let socket = WcetError::Loopback;
    let cell = Cell::demo(500).map_err(|error| WcetError::Print(error.to_string()))?;
    let model = cycle::model(3)?;
    let mut print = Print::new(&cell, &model)?;
    let (mut ours, mut robots) = connection().map_err(socket)?;
    let mut parts = Vec::with_capacity(cycles);
    let mut buffer = [0; 4096];
    let mut due = now().map_err(socket)? + period_ns;
    while parts.len() < cycles {
        print.before()?;
        let sent = print.exchange.robot_in.get().len();
        robots.write_all(print.exchange.robot_in.get()).map_err(socket)?;
        while now().map_err(socket)? + ROOM_NS > due {
            due += period_ns;
        }
        sleep_until(due).map_err(socket)?;
        let awake = now().map_err(socket)?;
        let telegram = buffer.get_mut(..sent).unwrap_or(&mut []);
        if sent > 0 {
            ours.read_exact(telegram).map_err(socket)?;
        }
        let read = now().map_err(socket)?;
        print.cycle()?;
        let done = now().map_err(socket)?;
        let answer = print.exchange.robot_out.get();
        if !answer.is_empty() {
            ours.write_all(answer).map_err(socket)?;
        }
        let written = now().map_err(socket)?;
        parts.push(Parts {
            wake_up: awake.saturating_sub(due),
            cycle: done - read,
            input_output: (read - awake) + (written - done),
            response: written.saturating_sub(due),
        });
        due += period_ns;
        let answered = answer.len();
        if answered > 0 {
            robots.read_exact(buffer.get_mut(..answered).unwrap_or(&mut [])).map_err(socket)?;
        }
        print.after()?;
    }
    Ok(parts)
}

impl Response {
    /// Of cycles with a period; none of none.
    pub fn of(period_ns: u64, parts: &[Parts]) -> Option<Self> {
        let summary = |what: &str, part: fn(&Parts) -> u64| Summary::of(what, Condition::Warm, parts.iter().map(part));
        let misses = parts.iter().filter(|parts| parts.response > period_ns).count();
        Some(Self {
            period_ns,
            wake_up: summary("wake-up", |parts| parts.wake_up)?,
            cycle: summary("cycle", |parts| parts.cycle)?,
            input_output: summary("input and output", |parts| parts.input_output)?,
            response: summary("response", |parts| parts.response)?,
            cycles: parts.len(),
            misses,
            passed_over: parts.iter().map(|parts| parts.response.div_ceil(period_ns).saturating_sub(1)).sum(),
            miss_probability_at_most: at_most(misses, parts.len()),
        })
    }
}

/// The upper end of the one-sided 95 % interval for a probability of which `found` of `count` were seen (Clopper and Pearson,
/// Biometrika 26, 1934): 1 − 0.05^(1/n), about 3/n, for none.
pub fn at_most(found: usize, count: usize) -> f64 {
    if found >= count {
        return 1.0;
    }
    if found == 0 {
        return 1.0 - 0.05_f64.powf(1.0 / count as f64);
    }
    Beta::new(found as f64 + 1.0, (count - found) as f64).map_or(1.0, |law| law.inverse_cdf(0.95))
}

fn connection() -> std::io::Result<(TcpStream, TcpStream)> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let ours = TcpStream::connect(listener.local_addr()?)?;
    let (robots, _) = listener.accept()?;
    ours.set_nodelay(true)?;
    robots.set_nodelay(true)?;
    Ok((ours, robots))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_that_of_clopper_and_pearson() {
        // R: binom.test(k, n, alternative = "less")$conf.int, and the rule of three.
        assert!((at_most(0, 1000) - 3.0 / 1000.0).abs() < 1e-5);
        for (found, count, bound) in [(0, 10, 0.258_865_6), (1, 10, 0.394_163_3), (2, 100, 0.061_619_2)] {
            assert!((at_most(found, count) - bound).abs() < 1e-5, "{found} of {count}: {}", at_most(found, count));
        }
        assert_eq!(at_most(3, 3), 1.0);
    }

    #[test]
    fn misses_are_counted_exactly_whatever_the_stall_rule_says() {
        let part = |response| Parts { wake_up: 1, cycle: 1, input_output: 1, response };
        let parts: Vec<Parts> = [999_999, 1_000_000, 1_000_001, 90_000_000].map(part).to_vec();
        let response = Response::of(1_000_000, &parts).unwrap();
        assert_eq!((response.cycles, response.misses, response.passed_over), (4, 2, 90));
        assert_eq!(response.response.stalls, 2);
    }
}
