//! How deep the tick's stack gets, by painting: each tick runs on a stack of its own thread that was filled with a pattern before, and
//! what is no longer the pattern has been used.

use super::WcetError;
use screed_tape::vectors::{Class, Course, Edge};
use std::io::Error;
use std::path::Path;

/// What is painted below the frame that calls (bytes).
const PAINTED: usize = 256 << 10;

/// What nothing writes by chance.
const PAINT: u8 = 0xa5;

/// The deepest call of each class of these courses (bytes), in the order of [`Class::ALL`]: from the frame that calls a measured
/// function down to the lowest byte that it or anything below it has written.
///
/// # Errors
/// [`WcetError`] where the system gives no stack.
pub fn high_water(courses: &[Course]) -> Result<[usize; Class::ALL.len()], WcetError> {
    let mut deepest = [0; Class::ALL.len()];
    let courses = courses.to_vec();
    // Above what is painted the courses themselves need room.
    let thread = std::thread::Builder::new().stack_size(16 << 20).spawn(move || {
        for course in &courses {
            let mut depth = 0;
            let mut meter = |edge: Edge| match edge {
                Edge::Before => {
                    depth = paint();
                    0
                }
                Edge::After => unpainted(depth) as u64,
            };
            course.run(&mut meter, &mut |call| {
                let deepest = &mut deepest[call.class as usize];
                *deepest = (*deepest).max(call.count as usize);
            });
        }
        deepest
    });
    let path = Path::new("a stack to paint");
    let thread = thread.map_err(|error| WcetError::file(path, &error))?;
    thread.join().map_err(|_| WcetError::file(path, &Error::other("the courses did not come to their end")))
}

/// Paints the stack below this frame; returns the address down to which it did, from where [`unpainted`] looks.
#[inline(never)]
fn paint() -> usize {
    let here = 0_u8;
    // The system's own call frames lie within these bytes of a local.
    let top = (&raw const here as usize) - 512;
    let bottom = top - PAINTED;
    for at in bottom..top {
        // SAFETY: the thread's stack is far larger, and nothing below this frame is in use; the pointer is only written through.
        unsafe { (at as *mut u8).write_volatile(PAINT) };
    }
    bottom
}

/// Bytes between the caller's frame and the lowest one that is no longer painted.
#[inline(never)]
fn unpainted(bottom: usize) -> usize {
    let here = 0_u8;
    let top = &raw const here as usize;
    let mut at = bottom;
    // SAFETY: as in `paint`; reads only.
    while at < top && unsafe { (at as *const u8).read_volatile() } == PAINT {
        at += 1;
    }
    top - at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[inline(never)]
    fn deep(bytes: usize) -> u8 {
        let mut room = [0_u8; 4096];
        room[bytes % 4096] = 1;
        if bytes > 4096 {
            std::hint::black_box(&mut room)[0] ^ deep(bytes - 4096)
        } else {
            std::hint::black_box(room)[7]
        }
    }

    #[test]
    fn what_was_used_is_seen() {
        for kilobytes in [8, 40, 64] {
            let bottom = paint();
            std::hint::black_box(deep(kilobytes << 10));
            let used = unpainted(bottom);
            let least = kilobytes << 10;
            // A frame holds more than its room, by what the compiler copies.
            assert!((least..3 * least + 16_384).contains(&used), "{kilobytes} KiB: {used}");
        }
        let bottom = paint();
        assert!(unpainted(bottom) < 1024);
    }

    #[test]
    fn ticks_use_some_stack_and_not_all_that_is_painted() {
        let courses: Vec<Course> = (0..8).map(Course::of).collect();
        let deepest = high_water(&courses).unwrap();
        let tick = deepest.iter().max().copied().unwrap();
        assert!((1024..PAINTED / 2).contains(&tick), "{deepest:?}");
    }
}
