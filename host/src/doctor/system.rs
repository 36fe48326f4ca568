//! Scheduling, limits, processors and clocks.

use super::{Finding, Machine, Verdict, processors};

/// Where processors stand in `/sys`.
const CPU: &str = "/sys/devices/system/cpu";

/// Wake-up from an idle state that takes longer costs a millisecond's loop a tenth of its time (µs).
const IDLE_LATENCY_MAX_US: u64 = 100;

/// Whether the kernel preempts everything. Kernels with the patch say so in a file of their own; those since 6.12, which have it
/// built in, in their version alone (`uname -v`, the part of `/proc/version` behind the first "#").
pub(super) fn preemption(machine: &Machine) -> Finding {
    let what = "kernel";
    let Some(version) = machine.read("/proc/version") else { return Finding::unknown(what, "/proc/version") };
    let release = version.split_whitespace().nth(2).unwrap_or("of unknown release").to_owned();
    let built = version.split_once('#').is_some_and(|(_, built)| built.contains("PREEMPT_RT"));
    if built || machine.read("/sys/kernel/realtime").as_deref() == Some("1") {
        return Finding::good(what, format!("{release}, PREEMPT_RT"));
    }
    let model = ["PREEMPT_DYNAMIC", "PREEMPT"].into_iter().find(|model| version.contains(model));
    Finding::new(
        what,
        format!("{release}, {}, not PREEMPT_RT", model.unwrap_or("no preemption")),
        Verdict::Bad,
        "boot a PREEMPT_RT kernel (Debian: apt-get install linux-image-rt-amd64): without it no bound on lateness is known",
    )
}

/// Whether the kernel takes the processor away from a real-time process.
pub(super) fn realtime_share(machine: &Machine) -> Finding {
    let (what, path) = ("real-time throttling", "/proc/sys/kernel/sched_rt_runtime_us");
    match machine.read(path).and_then(|text| text.parse::<i64>().ok()) {
        None => Finding::unknown(what, path),
        Some(-1) => Finding::good(what, "off"),
        Some(runtime) => {
            Finding::good(what, format!("after {runtime} µs of a second; the loop waits far more than the rest"))
        }
    }
}

/// Whether this user may run at the priority.
pub(super) fn priority(machine: &Machine, wanted: u8) -> Finding {
    let what = "SCHED_FIFO priority";
    if may(machine, 23) == Some(true) {
        return Finding::good(what, format!("{wanted}, by CAP_SYS_NICE"));
    }
    match limit(machine, "Max realtime priority") {
        None => Finding::unknown(what, "/proc/self/limits"),
        Some(most) if most >= u64::from(wanted) => Finding::good(what, format!("{wanted}, limit {most}")),
        Some(most) => Finding::new(
            what,
            format!("limit {most}, wanted {wanted}"),
            Verdict::Bad,
            format!(
                "add `USER - rtprio {wanted}` to /etc/security/limits.conf and log in again, or setcap cap_sys_nice+ep screed screed-rt"
            ),
        ),
    }
}

/// Whether this user may lock the memory of the process.
pub(super) fn locked_memory(machine: &Machine) -> Finding {
    let what = "locked memory";
    if may(machine, 14) == Some(true) {
        return Finding::good(what, "without limit, by CAP_IPC_LOCK");
    }
    const NEEDED: u64 = 128 << 20;
    match limit(machine, "Max locked memory") {
        None => Finding::unknown(what, "/proc/self/limits"),
        Some(u64::MAX) => Finding::good(what, "without limit"),
        Some(most) if most >= NEEDED => Finding::good(what, format!("limit {} MiB", most >> 20)),
        Some(most) => Finding::new(
            what,
            format!("limit {} KiB", most >> 10),
            Verdict::Bad,
            "add `USER - memlock unlimited` to /etc/security/limits.conf and log in again, or setcap cap_ipc_lock+ep screed screed-rt",
        ),
    }
}

/// Whether there is the processor that the cell names.
pub(super) fn processor(machine: &Machine, wanted: Option<usize>) -> Finding {
    let (what, online) = ("processor", machine.online());
    let count = online.len();
    match wanted {
        Some(cpu) if online.contains(&cpu) => Finding::good(what, format!("{cpu} of {count}")),
        Some(cpu) => Finding::new(
            what,
            format!("{cpu} is not among the {count} that are on"),
            Verdict::Bad,
            "name one that is, in [realtime] cpu of the cell file",
        ),
        None => Finding::new(
            what,
            format!("any of {count}"),
            Verdict::Poor,
            "isolate one and name it in [realtime] cpu of the cell file",
        ),
    }
}

/// Whether the loop has its processor for itself.
pub(super) fn isolation(machine: &Machine, wanted: Option<usize>) -> Finding {
    let what = "isolated processors";
    let list = machine.read(&format!("{CPU}/isolated")).unwrap_or_default();
    let isolated = processors(&list);
    let fix = "add isolcpus=managed_irq,domain,N nohz_full=N rcu_nocbs=N to the kernel's command line";
    match wanted {
        Some(cpu) if isolated.contains(&cpu) => Finding::good(what, list),
        _ if isolated.is_empty() => Finding::new(what, "none", Verdict::Poor, fix),
        Some(cpu) => Finding::new(what, format!("{list}, not {cpu}"), Verdict::Poor, fix),
        None => Finding::new(
            what,
            list,
            Verdict::Poor,
            "name one of them in [realtime] cpu of the cell file: nothing else runs there",
        ),
    }
}

/// Whether the processors keep their speed.
pub(super) fn governor(machine: &Machine, wanted: Option<usize>) -> Finding {
    let what = "frequency governor";
    let path = |cpu: usize| format!("{CPU}/cpu{cpu}/cpufreq/scaling_governor");
    let mut governors: Vec<String> = concerned(machine, wanted).filter_map(|cpu| machine.read(&path(cpu))).collect();
    governors.sort();
    governors.dedup();
    match governors.as_slice() {
        [] => Finding::good(what, "none: the frequency is not scaled by this system"),
        [one] if one == "performance" => Finding::good(what, one),
        _ => Finding::new(
            what,
            governors.join(", "),
            Verdict::Poor,
            "cpupower frequency-set -g performance, at every start",
        ),
    }
}

/// Whether a processor sleeps so deeply that it wakes late.
pub(super) fn idle_states(machine: &Machine, wanted: Option<usize>) -> Finding {
    let what = "idle states";
    let mut slow: Vec<String> = Vec::new();
    for cpu in concerned(machine, wanted) {
        let folder = format!("{CPU}/cpu{cpu}/cpuidle");
        for state in machine.names(&folder) {
            let value = |name: &str| machine.read(&format!("{folder}/{state}/{name}"));
            let latency = value("latency").and_then(|text| text.parse().ok()).unwrap_or(0);
            if latency > IDLE_LATENCY_MAX_US && value("disable").as_deref() != Some("1") {
                slow.push(format!("{} ({latency} µs)", value("name").unwrap_or(state)));
            }
        }
    }
    slow.sort();
    slow.dedup();
    let held = std::fs::OpenOptions::new().write(true).open(machine.path("/dev/cpu_dma_latency")).is_ok();
    if slow.is_empty() {
        return Finding::good(what, format!("none that takes more than {IDLE_LATENCY_MAX_US} µs to wake"));
    }
    let slow = slow.join(", ");
    if held {
        return Finding::good(what, format!("{slow}, kept out by /dev/cpu_dma_latency while screed-rt runs"));
    }
    let remedy = "let this user write /dev/cpu_dma_latency (a udev rule), or boot with processor.max_cstate=1";
    Finding::new(what, slow, Verdict::Poor, remedy)
}

/// Whether time is read from the processor itself.
pub(super) fn clock_source(machine: &Machine) -> Finding {
    let (what, path) = ("clock source", "/sys/devices/system/clocksource/clocksource0/current_clocksource");
    match machine.read(path) {
        None => Finding::unknown(what, path),
        Some(name) if ["tsc", "arch_sys_counter"].contains(&name.as_str()) => Finding::good(what, name),
        Some(name) => Finding::new(
            what,
            name,
            Verdict::Poor,
            "boot with tsc=reliable if the processor's counter is constant: each look at this clock takes microseconds",
        ),
    }
}

/// Whether somebody else may take the whole machine away.
pub(super) fn virtual_machine(machine: &Machine) -> Finding {
    let (what, path) = ("virtual machine", "/proc/cpuinfo");
    let Some(text) = machine.read(path) else { return Finding::unknown(what, path) };
    let flags = text.lines().find(|line| line.starts_with("flags")).unwrap_or_default();
    if flags.split_whitespace().any(|flag| flag == "hypervisor") {
        let remedy = "run on the machine itself: its host can stop this one for a hundred milliseconds, and no setting here helps";
        return Finding::new(what, "yes", Verdict::Bad, remedy);
    }
    Finding::good(what, "no")
}

/// The processor that the loop runs on, or all where it may run on any.
fn concerned(machine: &Machine, wanted: Option<usize>) -> impl Iterator<Item = usize> {
    machine.online().into_iter().filter(move |cpu| wanted.is_none_or(|wanted| wanted == *cpu))
}

/// Whether this process has a capability, by its number (capabilities(7)).
fn may(machine: &Machine, capability: u32) -> Option<bool> {
    let status = machine.read("/proc/self/status")?;
    let set = status.lines().find_map(|line| line.strip_prefix("CapEff:"))?;
    Some(u64::from_str_radix(set.trim(), 16).ok()? >> capability & 1 == 1)
}

/// The soft limit of that name; the largest number where there is none.
fn limit(machine: &Machine, name: &str) -> Option<u64> {
    let limits = machine.read("/proc/self/limits")?;
    let rest = limits.lines().find_map(|line| line.strip_prefix(name))?;
    match rest.split_whitespace().next()? {
        "unlimited" => Some(u64::MAX),
        number => number.parse().ok(),
    }
}
