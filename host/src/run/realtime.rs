//! Asks the system for what a hard-timed loop needs, and says what was refused.

use crate::config::Realtime;
use std::fs::{File, OpenOptions};
use std::io::{Error, Write};

/// How much of the heap is locked and touched before the first cycle (bytes): more than the process allocates until then. It
/// must fit under the limit of locked memory.
const HEAP: usize = 32 << 20;

/// How much of the stack is touched before the first cycle (bytes): several times what a cycle needs.
const STACK: usize = 256 << 10;

/// What the process got.
#[derive(Debug)]
pub struct Scheduling {
    /// Whether scheduling, memory and processor were granted as asked for.
    pub realtime: bool,
    /// What was refused and how to allow it; empty when nothing was.
    pub note: String,
    /// Processors stay awake for as long as this file is open.
    _awake: Option<File>,
}

/// What would be refused, asked for on a thread of its own and given back: this one, and what it starts, is scheduled as before.
/// What stays is the heap, grown.
pub fn refused(wanted: &Realtime) -> Option<String> {
    let wanted = *wanted;
    let probe =
        std::thread::spawn(move || bound(&wanted).into_iter().chain(scheduled(&wanted)).collect::<Vec<String>>());
    let mut refused = probe.join().unwrap_or_else(|_| vec!["the system could not be asked".to_owned()]);
    refused.extend(locked());
    // SAFETY: no pointers.
    unsafe { libc::munlockall() };
    (!refused.is_empty()).then(|| refused.join("; "))
}

/// Bound to a processor if the cell names one, memory locked and touched, processors kept from sleeping deeply,
/// fixed-priority scheduling (SCHED_FIFO). To be called before anything large is allocated.
pub fn enter(wanted: &Realtime) -> Scheduling {
    let mut refused: Vec<String> = bound(wanted).into_iter().chain(locked()).collect();
    touch_stack();
    refused.extend(scheduled(wanted));
    let realtime = refused.is_empty();
    let awake = stay_awake();
    if let Err(error) = &awake {
        refused.push(format!(
            "processors may sleep deeply and wake late, /dev/cpu_dma_latency was refused ({error}): let this user write it"
        ));
    }
    Scheduling { realtime, note: refused.join("; "), _awake: awake.ok() }
}

/// Binds this thread if the cell names a processor; what was refused.
fn bound(wanted: &Realtime) -> Option<String> {
    let cpu = wanted.cpu?;
    let error = bind(cpu).err()?;
    Some(format!("binding to processor {cpu} was refused ({error}): name one that exists in [realtime] cpu"))
}

/// Locks memory; what was refused.
fn locked() -> Option<String> {
    let error = lock_memory().err()?;
    Some(format!("locking memory was refused ({error}): raise memlock in limits.conf or grant CAP_IPC_LOCK"))
}

/// Schedules this thread; what was refused.
fn scheduled(wanted: &Realtime) -> Option<String> {
    let (priority, error) = (wanted.priority, schedule(wanted.priority).err()?);
    Some(format!(
        "SCHED_FIFO priority {priority} was refused ({error}): raise rtprio in limits.conf or grant CAP_SYS_NICE"
    ))
}

/// Locks what the process has and will have, and lets the heap grow once, now: it is never given back, and large pieces come
/// from it too. Under a limit that leaves no room for that nothing is locked, since what could not be locked later could not be
/// allocated either, and the process would end in the middle of a print.
fn lock_memory() -> Result<(), Error> {
    // SAFETY: no pointers; sets how this process's own allocator gets and returns memory.
    let set = unsafe { libc::mallopt(libc::M_TRIM_THRESHOLD, -1) & libc::mallopt(libc::M_MMAP_MAX, 0) };
    if set == 0 {
        return Err(Error::other("the allocator keeps to its own ways"));
    }
    // SAFETY: no pointers; locks this process's own pages.
    if unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } != 0 {
        return Err(Error::last_os_error());
    }
    let mut heap = Vec::new();
    if heap.try_reserve_exact(HEAP).is_err() {
        // SAFETY: no pointers.
        unsafe { libc::munlockall() };
        return Err(Error::other(format!("the limit leaves no room for {} MiB more", HEAP >> 20)));
    }
    heap.resize(HEAP, 1_u8);
    std::hint::black_box(&mut heap);
    Ok(())
}

/// Uses the stack that a cycle may need, so that none of its pages is first used then.
#[inline(never)]
fn touch_stack() {
    std::hint::black_box(&mut [1_u8; STACK]);
}

fn schedule(priority: u8) -> Result<(), Error> {
    let parameter = libc::sched_param { sched_priority: i32::from(priority) };
    // What this process starts is scheduled as usual.
    let policy = libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK;
    // SAFETY: the parameter outlives the call; 0 means this process.
    let result = unsafe { libc::sched_setscheduler(0, policy, &raw const parameter) };
    if result == 0 { Ok(()) } else { Err(Error::last_os_error()) }
}

/// Asks for a wake-up latency of 0 µs; the system keeps to it while the file is open (kernel documentation, "PM Quality of
/// Service").
fn stay_awake() -> Result<File, Error> {
    let mut file = OpenOptions::new().write(true).open("/dev/cpu_dma_latency")?;
    file.write_all(&0_i32.to_ne_bytes())?;
    Ok(file)
}

fn bind(cpu: usize) -> Result<(), Error> {
    if cpu >= 8 * size_of::<libc::cpu_set_t>() {
        return Err(Error::from_raw_os_error(libc::EINVAL));
    }
    // SAFETY: an all-zero cpu_set_t is the empty set; `cpu` is inside it; the set outlives the call.
    let result = unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        libc::CPU_SET(cpu, &mut set);
        libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const set)
    };
    if result == 0 { Ok(()) } else { Err(Error::last_os_error()) }
}
