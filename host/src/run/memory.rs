//! What the real-time process takes from memory once its loop runs: nothing. This counts it.

use serde::Serialize;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, which counts for the thread that asks. The programs install it.
pub struct Counting;

// SAFETY: every call goes to the system's allocator unchanged; counting touches a thread-local without destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// What a thread has taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Memory {
    /// Allocations, where the program installed [`Counting`].
    pub allocations: u64,
    /// Page faults that needed no disk.
    pub faults_minor: u64,
    /// Page faults that did.
    pub faults_major: u64,
}

impl Memory {
    /// Of this thread, until now.
    pub fn now() -> Self {
        // SAFETY: an all-zero rusage is valid; it outlives the call.
        let usage = unsafe {
            let mut usage: libc::rusage = std::mem::zeroed();
            libc::getrusage(libc::RUSAGE_THREAD, &raw mut usage);
            usage
        };
        let count = |value: libc::c_long| u64::try_from(value).unwrap_or(0);
        Self {
            allocations: ALLOCATIONS.get(),
            faults_minor: count(usage.ru_minflt),
            faults_major: count(usage.ru_majflt),
        }
    }

    /// What was taken since `before`.
    pub const fn since(&self, before: &Self) -> Self {
        Self {
            allocations: self.allocations.saturating_sub(before.allocations),
            faults_minor: self.faults_minor.saturating_sub(before.faults_minor),
            faults_major: self.faults_major.saturating_sub(before.faults_major),
        }
    }

    /// This and `more`.
    pub const fn plus(&self, more: &Self) -> Self {
        Self {
            allocations: self.allocations + more.allocations,
            faults_minor: self.faults_minor + more.faults_minor,
            faults_major: self.faults_major + more.faults_major,
        }
    }
}

/// What a loop must not do, to show that it is counted: allocates once, and touches a page that it has not.
pub fn take_some() {
    drop(std::hint::black_box(Box::new(1_u64)));
    const PAGE: usize = 1 << 16;
    // SAFETY: a fresh mapping of this function's own, written inside its bounds only, unlocked and dropped so that it has to be
    // given anew, and unmapped before it returns.
    unsafe {
        let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
        let page = libc::mmap(std::ptr::null_mut(), PAGE, libc::PROT_READ | libc::PROT_WRITE, flags, -1, 0);
        if page == libc::MAP_FAILED {
            return;
        }
        libc::munlock(page, PAGE);
        libc::madvise(page, PAGE, libc::MADV_DONTNEED);
        page.cast::<u8>().write_volatile(1);
        libc::munmap(page, PAGE);
    }
}
