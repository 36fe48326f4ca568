//! What interrupts the loop's processor.

use super::{Finding, Machine, Verdict, processors};

/// Whether network devices interrupt the processor that the loop runs on.
pub(super) fn network(machine: &Machine, wanted: Option<usize>) -> Finding {
    let what = "network interrupts";
    let mut there = Vec::new();
    let mut seen = 0;
    for device in machine.names("/sys/class/net") {
        for number in of_device(machine, &device) {
            let folder = format!("/proc/irq/{number}");
            let affinity = |name: &str| machine.read(&format!("{folder}/{name}")).filter(|list| !list.is_empty());
            let Some(list) = affinity("effective_affinity_list").or_else(|| affinity("smp_affinity_list")) else {
                continue;
            };
            seen += 1;
            if wanted.is_some_and(|cpu| processors(&list).contains(&cpu)) {
                there.push(format!("{number} of {device}"));
            }
        }
    }
    match (wanted, there.as_slice()) {
        (_, []) if seen == 0 => Finding::good(what, "none: no network device of its own interrupts"),
        (None, _) => Finding::new(
            what,
            format!("{seen}, on any processor"),
            Verdict::Poor,
            "bind the loop ([realtime] cpu) and keep them off that processor: echo N > /proc/irq/IRQ/smp_affinity_list",
        ),
        (Some(_), []) => Finding::good(what, format!("{seen}, all on other processors")),
        (Some(cpu), _) => Finding::new(
            what,
            format!("on processor {cpu}: {}", there.join(", ")),
            Verdict::Poor,
            "write another processor into /proc/irq/IRQ/smp_affinity_list of each, at every start",
        ),
    }
}

/// Whether a program moves interrupts about.
pub(super) fn balancer(machine: &Machine) -> Finding {
    let what = "irqbalance";
    let numbers = machine.names("/proc").into_iter().filter(|name| name.bytes().all(|byte| byte.is_ascii_digit()));
    let runs =
        numbers.into_iter().any(|pid| machine.read(&format!("/proc/{pid}/comm")).as_deref() == Some("irqbalance"));
    if runs {
        let remedy = "systemctl disable --now irqbalance, or ban the loop's processor (IRQBALANCE_BANNED_CPULIST)";
        return Finding::new(what, "runs: it may move an interrupt to the loop's processor", Verdict::Poor, remedy);
    }
    Finding::good(what, "does not run")
}

/// The interrupts of a network device: its own, or those of the bus device that carries it.
fn of_device(machine: &Machine, device: &str) -> Vec<String> {
    let own = format!("/sys/class/net/{device}/device");
    // A virtual device's folder lies inside that of its bus device.
    let carrier = machine.path(&own).canonicalize().ok().and_then(|path| Some(path.parent()?.join("msi_irqs")));
    let mut numbers = machine.names(&format!("{own}/msi_irqs"));
    if numbers.is_empty() {
        let entries = carrier.and_then(|path| std::fs::read_dir(path).ok()).into_iter().flatten().flatten();
        numbers = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        numbers.sort();
    }
    numbers
}
