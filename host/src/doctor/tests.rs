//! A made-up machine's files, one thing after the other put wrong.

use super::*;
use std::fs;
use tempfile::TempDir;

/// A machine that leaves nothing to wish for, its loop bound to processor 3.
const GOOD: &[(&str, &str)] = &[
    ("proc/version", "Linux version 6.12.0-rt-amd64 (x@y) #1 SMP PREEMPT_RT Debian 6.12\n"),
    ("proc/sys/kernel/sched_rt_runtime_us", "-1\n"),
    ("proc/self/status", "Name:\tscreed\nCapEff:\t0000000000000000\n"),
    (
        "proc/self/limits",
        "Limit                     Soft Limit           Hard Limit           Units\n\
         Max locked memory         unlimited            unlimited            bytes\n\
         Max realtime priority     95                   95\n",
    ),
    ("sys/devices/system/cpu/online", "0-3\n"),
    ("sys/devices/system/cpu/isolated", "2-3\n"),
    ("sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "performance\n"),
    ("sys/devices/system/cpu/cpu3/cpuidle/state0/name", "POLL\n"),
    ("sys/devices/system/cpu/cpu3/cpuidle/state0/latency", "0\n"),
    ("sys/devices/system/cpu/cpu3/cpuidle/state1/name", "C6\n"),
    ("sys/devices/system/cpu/cpu3/cpuidle/state1/latency", "133\n"),
    ("sys/devices/system/cpu/cpu3/cpuidle/state1/disable", "1\n"),
    ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
    ("proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu tsc constant_tsc\n"),
    ("sys/class/net/eth0/device/msi_irqs/41", "msi\n"),
    ("proc/irq/41/effective_affinity_list", "0\n"),
    ("proc/1/comm", "systemd\n"),
];

/// What is found on the good machine with these files otherwise.
fn diagnosis(cpu: Option<usize>, changes: &[(&str, &str)]) -> Diagnosis {
    let root = TempDir::new().unwrap();
    for (path, text) in GOOD.iter().chain(changes) {
        let path = root.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    Diagnosis::of(root.path(), &Realtime { cpu, ..Realtime::default() })
}

#[test]
fn a_machine_as_it_should_be_has_no_finding_that_is_not_good() {
    let found = diagnosis(Some(3), &[]);
    assert!(found.findings.iter().all(|f| f.verdict == Verdict::Good && f.remedy.is_empty()), "{found}");
    assert!(found.can_hold);
}

#[test]
fn each_thing_put_wrong_is_found_alone_and_with_its_remedy() {
    let limits =
        |locked: &str, priority: &str| format!("Max locked memory {locked} x\nMax realtime priority {priority} x\n");
    let (low, short) = (limits("unlimited", "0"), limits("8388608", "95"));
    for (what, verdict, path, text) in [
        ("kernel", Verdict::Bad, "proc/version", "Linux version 6.12.0 (x@y) #1 SMP PREEMPT_DYNAMIC Debian 6.12"),
        ("SCHED_FIFO priority", Verdict::Bad, "proc/self/limits", low.as_str()),
        ("locked memory", Verdict::Bad, "proc/self/limits", short.as_str()),
        ("processor", Verdict::Bad, "sys/devices/system/cpu/online", "0-2"),
        ("isolated processors", Verdict::Poor, "sys/devices/system/cpu/isolated", "1-2"),
        ("isolated processors", Verdict::Poor, "sys/devices/system/cpu/isolated", ""),
        ("frequency governor", Verdict::Poor, "sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "powersave"),
        ("idle states", Verdict::Poor, "sys/devices/system/cpu/cpu3/cpuidle/state1/disable", "0"),
        ("clock source", Verdict::Poor, "sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet"),
        ("virtual machine", Verdict::Bad, "proc/cpuinfo", "flags : fpu hypervisor"),
        ("network interrupts", Verdict::Poor, "proc/irq/41/effective_affinity_list", "2-3"),
        ("irqbalance", Verdict::Poor, "proc/77/comm", "irqbalance\n"),
    ] {
        let found = diagnosis(Some(3), &[(path, text)]);
        let wrong: Vec<_> = found.findings.iter().filter(|f| f.verdict != Verdict::Good).collect();
        assert!(wrong.len() == 1 && wrong[0].what == what && wrong[0].verdict == verdict, "{what}: {found}");
        assert!(!wrong[0].remedy.is_empty() && found.findings[0] == *wrong[0], "the worst comes first, with a remedy");
        assert_eq!(found.can_hold, verdict != Verdict::Bad);
    }
}

#[test]
fn a_kernel_is_real_time_by_its_version_or_by_its_file() {
    let mainline = "Linux version 6.12.57+deb13-rt-amd64 (x@y) (gcc 14) #1 SMP PREEMPT_RT Debian 6.12.57-1";
    let patched = "Linux version 6.1.0-18-rt-amd64 (x@y) (gcc 12) #1 SMP Debian 6.1.76-1";
    // A name that somebody chose tells nothing.
    let named = "Linux version 6.12.0-PREEMPT_RT (PREEMPT_RT@y) (gcc 14) #1 SMP PREEMPT_DYNAMIC";
    for (version, file, realtime) in [
        (mainline, None, true),
        (mainline, Some("1\n"), true),
        (patched, Some("1\n"), true),
        (patched, None, false),
        (patched, Some("0\n"), false),
        (named, None, false),
        (named, Some("0\n"), false),
    ] {
        let changes: Vec<_> =
            [("proc/version", version)].into_iter().chain(file.map(|text| ("sys/kernel/realtime", text))).collect();
        let found = diagnosis(Some(3), &changes);
        let kernel = found.findings.iter().find(|finding| finding.what == "kernel").unwrap();
        let verdict = if realtime { Verdict::Good } else { Verdict::Bad };
        assert_eq!(kernel.verdict, verdict, "{version}, {file:?}: {}", kernel.found);
        assert_eq!(kernel.found.ends_with("not PREEMPT_RT"), !realtime, "{}", kernel.found);
    }
}

#[test]
fn capabilities_stand_for_limits_and_an_open_latency_file_for_shallow_sleep() {
    let none = "Max locked memory 0 0 bytes\nMax realtime priority 0 0\n";
    let may = "CapEff:\t0000000000804000\n";
    assert!(diagnosis(Some(3), &[("proc/self/limits", none), ("proc/self/status", may)]).can_hold);
    let deep = ("sys/devices/system/cpu/cpu3/cpuidle/state1/disable", "0");
    let found = diagnosis(Some(3), &[deep, ("dev/cpu_dma_latency", "")]);
    assert!(found.findings.iter().all(|f| f.verdict == Verdict::Good), "{found}");
}

#[test]
fn what_the_system_does_not_tell_is_said_and_a_loop_without_a_processor_is_poor() {
    let found = diagnosis(None, &[]);
    let poor: Vec<_> = found.findings.iter().filter(|f| f.verdict == Verdict::Poor).map(|f| f.what).collect();
    assert_eq!(poor, ["processor", "isolated processors", "network interrupts"]);
    let root = TempDir::new().unwrap();
    let found = Diagnosis::of(root.path(), &Realtime::default());
    let unknown = found.findings.iter().filter(|f| f.verdict == Verdict::Unknown).count();
    assert_eq!(unknown, 6, "{found}");
}

#[test]
fn lists_of_processors_are_read_as_the_kernel_writes_them() {
    assert_eq!(processors("0,2-3,7"), [0, 2, 3, 7]);
    assert!(processors("").is_empty() && processors("3-1,x,-").is_empty());
    assert_eq!(processors("0-18446744073709551615").len(), 8192);
}
