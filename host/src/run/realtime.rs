//! Asks the system for what a hard-timed loop needs, and says what was refused.

use crate::config::Realtime;
use std::io::Error;

/// What must still fit under the limit of locked memory (bytes): more than the process allocates before its first cycle.
const ROOM_TO_GROW: usize = 32 << 20;

/// What the process got.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scheduling {
    /// Whether everything asked for was granted.
    pub realtime: bool,
    /// What was refused and how to allow it; empty when nothing was.
    pub note: String,
}

/// Fixed-priority scheduling (SCHED_FIFO), memory locked, bound to a processor if the cell names one.
pub fn enter(wanted: &Realtime) -> Scheduling {
    let mut refused = Vec::new();
    if let Some(cpu) = wanted.cpu
        && let Err(error) = bind(cpu)
    {
        refused
            .push(format!("binding to processor {cpu} was refused ({error}): name one that exists in [realtime] cpu"));
    }
    if let Err(error) = lock_memory() {
        refused.push(format!("locking memory was refused ({error}): raise memlock in limits.conf"));
    }
    let parameter = libc::sched_param { sched_priority: i32::from(wanted.priority) };
    // SAFETY: the parameter outlives the call; 0 means this process.
    if unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) } != 0 {
        refused.push(format!(
            "SCHED_FIFO priority {} was refused ({}): raise rtprio in limits.conf or grant CAP_SYS_NICE",
            wanted.priority,
            Error::last_os_error()
        ));
    }
    Scheduling { realtime: refused.is_empty(), note: refused.join("; ") }
}

/// Locks what the process has and will have. Under a limit that leaves no room to grow nothing is locked: memory that cannot
/// be locked later is memory that cannot be allocated, and the process would end in the middle of a print.
fn lock_memory() -> Result<(), Error> {
    // SAFETY: no pointers; locks this process's own pages.
    if unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } != 0 {
        return Err(Error::last_os_error());
    }
    let (protection, flags) = (libc::PROT_READ | libc::PROT_WRITE, libc::MAP_PRIVATE | libc::MAP_ANONYMOUS);
    // SAFETY: a new mapping, at a place that the system chooses.
    let room = unsafe { libc::mmap(std::ptr::null_mut(), ROOM_TO_GROW, protection, flags, -1, 0) };
    if room == libc::MAP_FAILED {
        let error = Error::last_os_error();
        // SAFETY: no pointers.
        unsafe { libc::munlockall() };
        return Err(error);
    }
    // SAFETY: the mapping just made, which nothing refers to.
    unsafe { libc::munmap(room, ROOM_TO_GROW) };
    Ok(())
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
