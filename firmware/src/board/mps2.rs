//! What is this board's own: clock, bytes, output. The board is Arm's MPS2 with the AN500 image (Cortex-M7 at 25 MHz), as QEMU
//! has it; registers from Arm's Application Note 500 and the Cortex-M System Design Kit's manual (APB UART, APB timer).

use core::cell::RefCell;
use core::ptr::with_exposed_provenance_mut as at;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::interrupt::{self, InterruptNumber, Mutex};
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{NVIC, Peripherals, SYST};
use cortex_m_rt::exception;
use heapless::Deque;
use screed_kernel::tick::Command;
use screed_kernel::units::Nanos;

/// Registers of 32 bits that follow each other.
#[derive(Clone, Copy)]
struct Registers(usize);
const TIMER: Registers = Registers(0x4000_0000);
const HOST: Registers = Registers(0x4000_4000);
const DRIVES: Registers = Registers(0x4000_5000);
const DATA: usize = 0;
const STATE: usize = 1;
const CONTROL: usize = 2;
const CLEAR: usize = 3;
const DIVIDER: usize = 4;
const TX_FULL: u32 = 1;
const RX_FULL: u32 = 2;

impl Registers {
    fn read(self, index: usize) -> u32 {
        // SAFETY: only addresses of this board's registers, in whole words.
        unsafe { at::<u32>(self.0 + 4 * index).read_volatile() }
    }

    fn write(self, index: usize, value: u32) {
        // SAFETY: as above; none of them lets the hardware touch memory.
        unsafe { at::<u32>(self.0 + 4 * index).write_volatile(value) }
    }
}

// ------------------------------------------------------------------------------------------------------------------ clock

/// Nanoseconds of a step of either timer: 25 MHz.
const STEP_NS: u64 = 40;

/// Periods that have begun.
static PERIODS: AtomicU32 = AtomicU32::new(0);

#[exception]
fn SysTick() {
    PERIODS.store(PERIODS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

/// The board.
pub struct Board {
    pace: SYST,
    period_ns: u64,
    periods: u32,
    steps: u32,
    now_ns: u64,
}

impl Board {
    /// Sets clock and lines up; once.
    pub fn take() -> Option<Self> {
        let Peripherals { SYST: mut pace, .. } = Peripherals::take()?;
        pace.set_clock_source(SystClkSource::Core);
        pace.enable_interrupt();
        // Counts down from the top, freely.
        TIMER.write(2, u32::MAX);
        TIMER.write(1, u32::MAX);
        TIMER.write(0, 1);
        // 921,600 baud, to half a per cent: in a tick of 8 ms fewer bytes than the kernel takes.
        HOST.write(DIVIDER, 27);
        DRIVES.write(DIVIDER, 27);
        // Sends; for the host also receives, and interrupts for both.
        DRIVES.write(CONTROL, 0b0001);
        HOST.write(CONTROL, 0b1111);
        for interrupt in [Interrupt(0), Interrupt(1)] {
            // SAFETY: its handler is there, and what it shares stands in a mutex.
            unsafe { NVIC::unmask(interrupt) };
        }
        Some(Self { pace, period_ns: 0, periods: 0, steps: 0, now_ns: 0 })
    }

    /// Sleeps until the next period begins; how many went by before it. A late cycle does not shift the grid.
    pub fn wait(&mut self, period_ns: u64) -> u32 {
        if period_ns != self.period_ns {
            self.period_ns = period_ns;
            // A tick is at most 0.1 s, SysTick counts to 0.67 s.
            self.pace.set_reload((period_ns / STEP_NS) as u32 - 1);
            self.pace.clear_current();
            self.pace.enable_counter();
        }
        while PERIODS.load(Ordering::Relaxed) == self.periods {
            interrupt::free(|_| {
                // An interrupt that waits ends the sleep, so that none is slept through.
                if PERIODS.load(Ordering::Relaxed) == self.periods {
                    cortex_m::asm::wfi();
                }
            });
        }
        let passed = PERIODS.load(Ordering::Relaxed).wrapping_sub(self.periods);
        self.periods = self.periods.wrapping_add(passed);
        passed - 1
    }

    /// Time since start, monotonic. To be asked at least every two minutes.
    pub fn now(&mut self) -> Nanos {
        let steps = u32::MAX - TIMER.read(1);
        self.now_ns += STEP_NS * u64::from(steps.wrapping_sub(self.steps));
        self.steps = steps;
        Nanos(self.now_ns)
    }
}

// ------------------------------------------------------------------------------------------------------------------ bytes

/// What waits between the host's line and the loop. What has no room stays in the UART; the byte after it is then lost, the CRC
/// of its frame finds that, and the host says it again.
struct Line {
    heard: Deque<u8, 2048>,
    to_say: Deque<u8, 4096>,
}

static LINE: Mutex<RefCell<Line>> = Mutex::new(RefCell::new(Line { heard: Deque::new(), to_say: Deque::new() }));

impl Line {
    fn serve(&mut self) {
        HOST.write(CLEAR, 0b11);
        while !self.heard.is_full() && HOST.read(STATE) & RX_FULL != 0 {
            let _ = self.heard.push_back(HOST.read(DATA) as u8);
        }
        while HOST.read(STATE) & TX_FULL == 0
            && let Some(byte) = self.to_say.pop_front()
        {
            HOST.write(DATA, byte.into());
        }
    }
}

/// The host's UART interrupts: 0 has received, 1 has sent.
#[derive(Clone, Copy)]
struct Interrupt(u16);

// SAFETY: both numbers are this board's.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self.0
    }
}

#[exception]
unsafe fn DefaultHandler(_: i16) {
    interrupt::free(|section| LINE.borrow(section).borrow_mut().serve());
}

impl Board {
    /// Takes bytes that the host sent; how many.
    pub fn hear(&mut self, bytes: &mut [u8]) -> usize {
        interrupt::free(|section| {
            let line = &mut *LINE.borrow(section).borrow_mut();
            let mut count = 0;
            for (slot, byte) in bytes.iter_mut().zip(core::iter::from_fn(|| line.heard.pop_front())) {
                (*slot, count) = (byte, count + 1);
            }
            // There is room again.
            line.serve();
            count
        })
    }

    /// Sends frames to the host, all of them or, when the line is behind, none: the host sees by the ticks what it has missed.
    pub fn say(&mut self, frames: &[u8]) {
        interrupt::free(|section| {
            let line = &mut *LINE.borrow(section).borrow_mut();
            if frames.len() <= line.to_say.capacity() - line.to_say.len() {
                line.to_say.extend(frames.iter().copied());
            }
            line.serve();
        });
    }
}

// ----------------------------------------------------------------------------------------------------------------- output

impl Board {
    /// Puts a command out, here on a second line: when it was found, from how many bytes of the host, and what it says. Whether
    /// the drives took it.
    pub fn put_out(&mut self, begun: Nanos, heard: usize, command: &Command<6>) -> bool {
        let joints = command.joints.map_or([f64::NAN; 6], |joints| joints.0);
        let bytes = (heard as u16).to_le_bytes().into_iter().chain(begun.0.to_le_bytes());
        let bytes = bytes.chain([command.mode.code() as u8]).chain(command.seq.to_le_bytes());
        let values = [command.flow].into_iter().chain(joints);
        bytes.chain(values.flat_map(f64::to_le_bytes)).all(|byte| {
            let room = DRIVES.read(STATE) & TX_FULL == 0;
            DRIVES.write(DATA, byte.into());
            room
        })
    }
}
