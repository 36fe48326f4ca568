//! Plays the tape on a Cortex-M7 with double precision, says the hash, and counts the instructions of every tick.
//!
//! Runs in QEMU: `.ci/same_bits` builds and starts it. With `-icount shift=6` an instruction takes 64 ns of virtual time, so
//! the 25 MHz SysTick makes 1.6 steps an instruction and counts instructions exactly.
#![no_std]
#![no_main]

mod ending;

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{Peripherals, SYST};
use cortex_m_rt::entry;
use cortex_m_semihosting::debug::EXIT_SUCCESS;
use cortex_m_semihosting::hprintln;
use ending::{end, fail};
use screed_tape::{EXPECTED, SEED, TICKS, Tape, cell};

/// SysTick counts down from here and wraps; no tick may take as long.
const RELOAD: u32 = 0x00ff_ffff;

#[entry]
fn main() -> ! {
    let Some(mut peripherals) = Peripherals::take() else { fail("the peripherals are taken") };
    start_counter(&mut peripherals.SYST);
    let mut kernel = cell::kernel();
    let mut tape = Tape::new(SEED);
    let mut counts = Counts::new();
    for tick in 0..TICKS {
        let (now, sensors) = tape.before(&mut kernel);
        let before = SYST::get_current();
        let command = tape.tick(&mut kernel, now, &sensors);
        counts.take(tick, before.wrapping_sub(SYST::get_current()) & RELOAD);
        tape.after(&mut kernel, &command);
    }
    let outcome = tape.outcome();
    let hash = outcome.hash.0;
    hprintln!("{}\nhash {:#018x}", outcome.seen, hash);
    hprintln!(
        "instructions of tick: mean {}, worst {} in tick {}",
        counts.sum / TICKS * 5 / 8,
        u64::from(counts.worst) * 5 / 8,
        counts.worst_tick
    );
    if hash != EXPECTED {
        fail("the bits are others than expected");
    }
    end(EXIT_SUCCESS)
}

/// SysTick's steps over the calls of tick.
struct Counts {
    sum: u64,
    worst: u32,
    worst_tick: u64,
}

impl Counts {
    const fn new() -> Self {
        Self { sum: 0, worst: 0, worst_tick: 0 }
    }

    fn take(&mut self, tick: u64, steps: u32) {
        self.sum += u64::from(steps);
        if steps > self.worst {
            (self.worst, self.worst_tick) = (steps, tick);
        }
    }
}

fn start_counter(counter: &mut SYST) {
    counter.set_clock_source(SystClkSource::Core);
    counter.set_reload(RELOAD);
    counter.clear_current();
    counter.enable_counter();
}
