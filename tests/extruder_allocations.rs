//! The extruder's line lives in the real-time process: after it has been made, it must not allocate.

use screed::link::extruder::ExtruderLine;
use screed::link::extruder::wire::{Answer, DeviceFault};
use screed_kernel::units::Nanos;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn the_extruder_s_line_allocates_nothing() {
    let before = ALLOCATIONS.get();
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(ALLOCATIONS.get() - before, 1, "the counter counts");

    let mut line = ExtruderLine::new(1e-4, 300_000_000).expect("a sound maximum");
    let before = ALLOCATIONS.get();
    for cycle in 0..5000u64 {
        let now = Nanos(cycle * 2_000_000);
        let flow = if cycle % 500 == 499 { f64::NAN } else { 1e-8 * (cycle % 100) as f64 };
        let refused = line.set_flow(flow).is_err();
        assert_eq!(refused, flow.is_nan());
        let mut out = [0; 64];
        line.poll_transmit(now, &mut out);
        let fault = if cycle % 700 == 0 { DeviceFault::Watchdog } else { DeviceFault::None };
        let answer = Answer { seq: line.status().sent, flow_nl_s: 5, fault }.encode();
        let _ = line.handle_bytes(now, answer.bytes());
        let _ = line.handle_bytes(now, b"damaged\n");
        let _ = (line.poll_timeout(), line.handle_timeout(now));
    }
    assert_eq!(ALLOCATIONS.get() - before, 0);
    assert!(line.status().sent > 300 && line.status().damaged_lines == 5000, "{:?}", line.status());
}
