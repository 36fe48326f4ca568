//! What makes a processor slow on purpose.

use super::WcetError;
use super::times::Condition;
use std::io::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// How much of the stack above a measured call holds what it works on: kernel, loop, inputs (bytes).
const WORKED_ON: usize = 768 << 10;

/// A line of a cache (bytes): no processor that this runs on has shorter ones.
const LINE: usize = 64;

/// What a co-runner writes (bytes): more than a processor has of second-level cache.
const WRITTEN: usize = 64 << 20;

/// Branches that are run to fill a predictor.
#[cfg(target_arch = "x86_64")]
const BRANCHES: usize = 16_384;

/// Puts caches and predictors into a bad state.
pub struct Disturber {
    condition: Condition,
    /// Whether what a call works on lies on the heap too.
    heap: bool,
    #[cfg(target_arch = "x86_64")]
    branches: Option<Branches>,
}

impl Disturber {
    /// For a condition, and calls whose data lies on the stack, or on the heap too.
    ///
    /// # Errors
    /// [`WcetError`] where the system does not say what is mapped, or gives no memory for code.
    pub fn new(condition: Condition, heap: bool) -> Result<Self, WcetError> {
        if heap {
            // What the allocator gave back to the system between looking and flushing would be gone: it gives nothing back from here on.
            // SAFETY: no pointers; sets how this process's own allocator gets and returns memory.
            let set = unsafe { libc::mallopt(libc::M_TRIM_THRESHOLD, -1) & libc::mallopt(libc::M_MMAP_MAX, 0) };
            if set == 0 {
                return Err(WcetError::file(std::path::Path::new("the allocator"), &Error::other("takes no settings")));
            }
        }
        mapped(heap)?;
        Ok(Self {
            condition,
            heap,
            #[cfg(target_arch = "x86_64")]
            branches: if condition == Condition::ColdBranches { Some(Branches::new()?) } else { None },
        })
    }

    /// Just before a call whose data lies on the caller's stack, above this frame.
    #[inline(never)]
    pub fn disturb(&mut self) {
        if !matches!(self.condition, Condition::Cold | Condition::ColdBranches) {
            return;
        }
        let here = 0_u8;
        flush(&raw const here as usize, WORKED_ON);
        // What is mapped changes as memory is taken and given back; that it can be read was seen in `new`.
        mapped(self.heap).unwrap_or_default().into_iter().for_each(|(first, length)| flush(first, length));
        #[cfg(target_arch = "x86_64")]
        if let Some(branches) = &self.branches {
            branches.run();
        }
    }
}

/// Puts a range of mapped memory out of every cache.
#[cfg(target_arch = "x86_64")]
fn flush(first: usize, length: usize) {
    for line in (first..first + length).step_by(LINE) {
        // SAFETY: the instruction changes no memory; the caller's ranges are mapped, code or a stack whose upper part is as large.
        unsafe { core::arch::x86_64::_mm_clflush(line as *const u8) };
    }
    // SAFETY: waits, no more.
    unsafe { core::arch::x86_64::_mm_mfence() };
}

/// Other processors do not let a program do that: what is read instead takes the place of what was there.
#[cfg(not(target_arch = "x86_64"))]
fn flush(_: usize, _: usize) {
    let other = vec![1_u8; 32 << 20];
    std::hint::black_box(other.iter().step_by(LINE).map(|byte| u64::from(*byte)).sum::<u64>());
}

/// This program's code, and its heap and other memory without a file if that is asked for: first addresses and lengths.
fn mapped(heap: bool) -> Result<Vec<(usize, usize)>, WcetError> {
    let path = std::path::Path::new("/proc/self/maps");
    let maps = std::fs::read_to_string(path).map_err(|error| WcetError::file(path, &error))?;
    let here = mapped as fn(bool) -> Result<Vec<(usize, usize)>, WcetError> as usize;
    let ranges = maps.lines().filter_map(|line| {
        let mut words = line.split_whitespace();
        let (low, high) = words.next()?.split_once('-')?;
        let (low, high) = (usize::from_str_radix(low, 16).ok()?, usize::from_str_radix(high, 16).ok()?);
        let (rights, name) = (words.next()?, words.nth(3));
        let data = heap && rights.starts_with("rw") && matches!(name, None | Some("[heap]"));
        (data || (low..high).contains(&here)).then_some((low, high - low))
    });
    let ranges: Vec<_> = ranges.collect();
    if ranges.is_empty() {
        return Err(WcetError::file(path, &Error::other("does not tell where this program's code is")));
    }
    Ok(ranges)
}

/// Code that is nothing but branches, every other one taken, each at an address of its own.
#[cfg(target_arch = "x86_64")]
struct Branches {
    memory: *mut libc::c_void,
    length: usize,
}

#[cfg(target_arch = "x86_64")]
impl Branches {
    fn new() -> Result<Self, WcetError> {
        // cmp eax, eax sets "equal"; then je +0 (taken) and jne +0 (not taken) in turns; ret.
        let mut code: Vec<u8> = vec![0x39, 0xc0];
        (0..BRANCHES).for_each(|branch| code.extend([if branch % 2 == 0 { 0x74 } else { 0x75 }, 0x00]));
        code.push(0xc3);
        let length = code.len();
        let refused = || WcetError::file(std::path::Path::new("memory for code"), &Error::last_os_error());
        let (write, run) = (libc::PROT_READ | libc::PROT_WRITE, libc::PROT_READ | libc::PROT_EXEC);
        // SAFETY: new memory of this process alone; written within its length, then made executable; unmapped once, on drop.
        unsafe {
            let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
            let memory = libc::mmap(std::ptr::null_mut(), length, write, flags, -1, 0);
            if memory == libc::MAP_FAILED {
                return Err(refused());
            }
            let branches = Self { memory, length };
            std::ptr::copy_nonoverlapping(code.as_ptr(), memory.cast(), length);
            if libc::mprotect(memory, length, run) != 0 {
                return Err(refused());
            }
            Ok(branches)
        }
    }

    fn run(&self) {
        // SAFETY: the memory holds the code above, which touches flags alone and returns.
        unsafe { std::mem::transmute::<*mut libc::c_void, extern "C" fn()>(self.memory)() };
    }
}

#[cfg(target_arch = "x86_64")]
impl Drop for Branches {
    fn drop(&mut self) {
        // SAFETY: mapped in `new`, and nothing refers to it any more.
        unsafe { libc::munmap(self.memory, self.length) };
    }
}

/// A thread on another processor that writes memory for as long as it lives.
pub struct CoRunner {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl CoRunner {
    /// Starts it on a processor other than `cpu`.
    ///
    /// # Errors
    /// [`WcetError`] where there is only one.
    pub fn start(cpu: Option<usize>) -> Result<Self, WcetError> {
        let count = std::thread::available_parallelism().map_or(1, usize::from);
        let path = std::path::Path::new("another processor");
        if count < 2 {
            return Err(WcetError::file(path, &Error::other("there is only one")));
        }
        let other = if cpu == Some(0) { 1 } else { 0 };
        let ends = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&ends);
        let thread = std::thread::Builder::new().spawn(move || {
            // Where it may not be bound, it runs where the system puts it, which is not here while this thread is busy.
            let _ = bind(other);
            let mut memory = vec![0_u8; WRITTEN];
            let mut value = 0_u8;
            while !told.load(Ordering::Relaxed) {
                value = value.wrapping_add(1);
                memory.iter_mut().step_by(LINE).for_each(|byte| *byte = value);
                std::hint::black_box(&mut memory);
            }
        });
        let thread = thread.map_err(|error| WcetError::file(path, &error))?;
        Ok(Self { ends, thread: Some(thread) })
    }
}

impl Drop for CoRunner {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Binds the calling thread to a processor.
///
/// # Errors
/// The system's.
pub fn bind(cpu: usize) -> Result<(), Error> {
    // SAFETY: the set is plain data, and the calls stay inside it: a number beyond it is refused by the system.
    unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        if cpu >= libc::CPU_SETSIZE as usize {
            return Err(Error::from_raw_os_error(libc::EINVAL));
        }
        libc::CPU_SET(cpu, &mut set);
        match libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const set) {
            0 => Ok(()),
            _ => Err(Error::last_os_error()),
        }
    }
}
