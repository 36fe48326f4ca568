//! Runs the courses of the worst case on a Cortex-M7 with double precision: for each arm and class the fewest and the most instructions
//! of a call, and how deep the stack gets. With the argument `search ROUNDS SEED ARMS` (`.ci/wcet search`) it looks for worse courses
//! instead: hill climbs from the committed ones, and as many random courses.
//!
//! Runs in QEMU: `.ci/wcet` builds and starts it. With `-icount shift=6` an instruction takes 64 ns of virtual time, so a 25 MHz
//! timer makes 1.6 steps an instruction and counts instructions exactly, those few that read it included. SysTick wraps after ten
//! million instructions, which some calls exceed; the board's 32-bit timer does not.
#![no_std]
#![no_main]

mod ending;

use cortex_m_rt::entry;
use cortex_m_semihosting::debug::EXIT_SUCCESS;
use cortex_m_semihosting::{hprintln, syscall1};
use ending::end;
use screed_tape::vectors::climb::Climb;
use screed_tape::vectors::{ARMS, COURSES, Call, Class, Course, Edge, RANDOM_COURSES};

/// The first timer of the board (CMSDK APB timer): control, value that counts down, value to begin again with.
const CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
const VALUE: *mut u32 = 0x4000_0004 as *mut u32;
const RELOAD: *mut u32 = 0x4000_0008 as *mut u32;

/// What is painted below a call (bytes), and what lies between a local and the place where it begins.
const PAINTED: usize = 128 << 10;
const BESIDE: usize = 256;
const PAINT: u32 = 0xa5a5_a5a5;

/// What calls of one arm and class came to.
#[derive(Clone, Copy)]
struct Seen {
    vectors: u32,
    min: u64,
    max: u64,
    course: u32,
    tick: u32,
}

const NONE: Seen = Seen { vectors: 0, min: u64::MAX, max: 0, course: 0, tick: 0 };

#[entry]
fn main() -> ! {
    start_timer();
    let mut line = [0; 128];
    let mut words = arguments(&mut line).split_ascii_whitespace().skip_while(|word| *word != "search").skip(1);
    if let Some(rounds) = words.next().and_then(|word| word.parse().ok()) {
        let seed = words.next().and_then(|word| word.parse().ok()).unwrap_or(0);
        search(rounds, seed, words.next().unwrap_or("01234567"));
        end(EXIT_SUCCESS)
    }
    let mut seen = [[NONE; Class::ALL.len()]; ARMS.len()];
    for index in 0..COURSES {
        count(&Course::of(index), &mut |call| take(&mut seen, index, call));
    }
    for (arm, classes) in ARMS.iter().zip(&seen) {
        for (class, seen) in Class::ALL.iter().zip(classes) {
            let Seen { vectors, min, max, course, tick } = seen;
            hprintln!("figure|{}|{}|{}|{}|{}|course {} tick {}", arm, class.name(), vectors, min, max, course, tick);
        }
    }
    let mut deepest = [0; Class::ALL.len()];
    // Painting takes longer than the calls: the first six of each arm, which have every class, and those that a search found.
    let random = ARMS.len() as u32 * RANDOM_COURSES;
    for index in (0..6 * ARMS.len() as u32).chain(random..COURSES) {
        let mut bottom = 0;
        let mut meter = |edge: Edge| match edge {
            Edge::Before => {
                bottom = paint();
                0
            }
            Edge::After => unpainted(bottom) as u64,
        };
        Course::of(index).run(&mut meter, &mut |call| {
            if let Some(deepest) = deepest.get_mut(call.class as usize) {
                *deepest = u64::max(*deepest, call.count);
            }
        });
    }
    for (class, bytes) in Class::ALL.iter().zip(deepest) {
        hprintln!("painted|{}|{}", class.name(), bytes);
    }
    end(EXIT_SUCCESS)
}

/// Runs a course; counts are instructions.
fn count(course: &Course, sink: &mut impl FnMut(&Call)) {
    course.run(&mut |_: Edge| u64::from(timer()), &mut |call| {
        // The timer counts down and wraps.
        let steps = 0_u32.wrapping_sub(call.count as u32);
        sink(&Call { count: u64::from(steps) * 5 / 8, ..*call });
    });
}

fn take(seen: &mut [[Seen; Class::ALL.len()]; ARMS.len()], course: u32, call: &Call) {
    let Some(seen) = seen.get_mut(call.arm).and_then(|classes| classes.get_mut(call.class as usize)) else { return };
    seen.vectors += 1;
    seen.min = u64::min(seen.min, call.count);
    if call.count > seen.max {
        (seen.max, seen.course, seen.tick) = (call.count, course, call.tick);
    }
}

/// Looks for worse courses of these arms, each a digit; every one that is worse is a line `worse|arm|class|instructions|course|tick`.
fn search(rounds: u32, seed: u64, arms: &str) {
    let arms = || arms.bytes().map(|digit| usize::from(digit.wrapping_sub(b'0'))).filter(|arm| *arm < ARMS.len());
    let mut climb = Climb::new(seed);
    for course in (0..COURSES).map(Course::of).filter(|course| arms().any(|arm| arm == course.arm())) {
        count(&course, &mut |call| climb.take(&course, call));
    }
    for round in 0..rounds {
        for arm in arms() {
            for class in Class::ALL {
                for course in [climb.beside(arm, class), climb.any(arm)] {
                    count(&course, &mut |call| {
                        if climb.worst(call.arm, call.class).is_none_or(|worst| call.count > worst.count) {
                            climb.take(&course, call);
                            told(call, &course);
                        }
                    });
                }
            }
        }
        hprintln!("round|{}", round + 1);
    }
}

fn told(call: &Call, course: &Course) {
    let arm = ARMS.get(call.arm).unwrap_or(&"");
    hprintln!("worse|{}|{}|{}|{}|{}", arm, call.class.name(), call.count, course, call.tick);
}

/// What the emulator was given as arguments.
fn arguments(line: &mut [u8; 128]) -> &str {
    let mut block = [line.as_mut_ptr() as usize, line.len()];
    // SAFETY: the emulator writes at most as many bytes as the block says to where it says, and the length into the block.
    let refused = unsafe { syscall1!(GET_CMDLINE, block.as_mut_ptr()) };
    let length = if refused == 0 { block[1] } else { 0 };
    line.get(..length).and_then(|bytes| core::str::from_utf8(bytes).ok()).unwrap_or("").trim_end_matches('\0')
}

fn start_timer() {
    // SAFETY: the board's timer is there, nothing else uses it, and its registers may be written in this order.
    unsafe {
        RELOAD.write_volatile(u32::MAX);
        VALUE.write_volatile(u32::MAX);
        CONTROL.write_volatile(1);
    }
}

fn timer() -> u32 {
    // SAFETY: the board's timer is there; reading changes nothing.
    unsafe { VALUE.read_volatile() }
}

/// Paints the stack below this frame; returns the address down to which it did.
#[inline(never)]
fn paint() -> usize {
    let here = 0_u32;
    let top = (&raw const here as usize) - BESIDE;
    let bottom = top - PAINTED;
    for at in (bottom..top).step_by(4) {
        // SAFETY: the stack has megabytes below this frame, and no interrupt uses them.
        unsafe { (at as *mut u32).write_volatile(PAINT) };
    }
    bottom
}

/// Bytes between this frame and the lowest one that is no longer painted.
#[inline(never)]
fn unpainted(bottom: usize) -> usize {
    let here = 0_u32;
    let top = &raw const here as usize;
    let mut at = bottom;
    // SAFETY: as in `paint`; reads only.
    while at < top && unsafe { (at as *const u32).read_volatile() } == PAINT {
        at += 4;
    }
    top - at
}
