use super::*;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{BaseRecord, LoopRecord};

/// What a job that hears these messages has to say to a person.
fn alarms(job: &mut Job, messages: &[FromKernel]) -> Vec<String> {
    let mut bytes = Vec::new();
    for message in messages {
        let mut out = [0; WIRE_MAX];
        let used = frame::encode(message, &mut out).unwrap_or_else(|error| panic!("{error:?}"));
        bytes.extend(&out[..used]);
    }
    job.handle_bytes(&bytes, &mut |_, _, _| {}).unwrap_or_else(|error| panic!("{error}"));
    job.take_alarms()
}

fn job() -> Job {
    let cell = Cell::demo(125).unwrap_or_else(|error| panic!("{error}"));
    Job::new(&cell, Account::new(&cell, &[]))
}

fn told(waits: bool, age: Option<f64>) -> FromKernel {
    told_of(waits, age, [0.0; 2])
}

/// What is held is the tool's, in m and rad.
fn told_of(waits: bool, age: Option<f64>, held: [f64; 2]) -> FromKernel {
    let base = BaseRecord {
        age,
        displacement: [0.0; 6],
        behind: [0.0; 2],
        nis: None,
        taken: 0,
        refused: 0,
        gated: 0,
        late: 0,
        deferred: 0,
    };
    let values = |value: f64| [value; 6].into_iter().collect();
    FromKernel::Loop(LoopRecord {
        tick: 1,
        base: Some(base),
        closed: false,
        waits,
        saturated: false,
        moved: [0.0; 2],
        held,
        behind: 1e-4,
        lag: values(0.1),
        inverse_gain: values(0.004),
    })
}

#[test]
fn a_path_that_waits_is_told_once_each_time_and_for_what() {
    let mut job = job();
    assert!(alarms(&mut job, &[told(false, Some(0.0)), told(false, None)]).is_empty());
    let lost = alarms(&mut job, &[told(true, None), told(true, None), told(true, Some(0.0))]);
    assert!(lost.len() == 1 && lost[0].contains("waits for the tracker"), "{lost:?}");
    // The last pose is old, and nothing is behind: it stops in time.
    let lost = alarms(&mut job, &[told(false, Some(0.0)), told(true, Some(1.1)), told(true, None)]);
    assert!(lost.len() == 1 && lost[0].contains("waits for the tracker"), "{lost:?}");
    let behind = alarms(&mut job, &[told(false, Some(0.0)), told_of(true, Some(0.0), [0.0, 2e-3])]);
    assert!(behind.len() == 1 && behind[0].contains("a correction that is behind"), "{behind:?}");
    let lead = job.account().figures.lead.unwrap_or_default();
    assert_eq!((lead.lag_s, lead.inverse_gain_s2, lead.behind_max_rad), ([0.1; 2], [0.004; 2], 1e-4));
}

#[test]
fn a_fault_of_the_loop_is_told_with_what_to_do_and_messages_of_a_later_version_are_counted() {
    let mut job = job();
    let fault = Fault::Tracker { value: 2.002, limit: 2.0 };
    let told = alarms(&mut job, &[FromKernel::Fault(FaultReport { number: 1, fault, tick: 9 })]);
    assert!(told.len() == 1 && told[0].starts_with("K13: ") && told[0].contains("re-arm"), "{told:?}");
    // Message 9 does not exist: its number is the second byte of the plain frame, and its CRC is right.
    let mut out = [0; 64];
    let used = frame::encode(&(9_u8, 1_u8), &mut out).unwrap_or_else(|error| panic!("{error:?}"));
    assert!(job.handle_bytes(&out[..used], &mut |_, _, _| {}).is_ok());
    assert_eq!(job.unknown(), 1);
}
