//! Frames: their bytes, what a bad line does to them, and what a hostile one can make the kernel do.

mod common;

use common::fuzz::{TO_KERNEL, crc, envelope, fuzz, golden, golden_1_1, read};
use common::{Bench, PLAN, both, configure, sweep};
use screed_kernel::control::Bound;
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::fault::{Fault, Unreached};
use screed_kernel::frame::{
    self, BaseRecord, BatchPart, CODE_MAX, Configure, CycleRecord, Cycles, FRAME_MAX, FaultReport, FrameError,
    FromKernel, JOINTS_MAX, LoopRecord, ModeCode, Pace, Refusal, Status, ToKernel, Unsound, VERSION, WIRE_MAX,
};
use screed_kernel::guard::{PLANES_MAX, Plane, Quantity};
use screed_kernel::setpoint::{Coder, Setpoint, flow_on_grid, joint_on_grid};
use screed_kernel::units::JointPos;

/// Lines of the golden file, and the CRC-32 of all their bytes in a row.
const FROZEN_LINES: usize = 59;
const FROZEN: u32 = 0xef16_3c0b;

/// The same of what version 1.1 appends.
const FROZEN_LINES_1_1: usize = 23;
const FROZEN_1_1: u32 = 0x2f9f_1de6;

const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.02, velocity_max: 0.1, acceleration_max: 1.0 };

fn wire<M: serde::Serialize>(message: &M) -> Vec<u8> {
    let mut out = [0; WIRE_MAX];
    let used = frame::encode(message, &mut out).unwrap();
    out[..used].to_vec()
}

fn golden_configure() -> Configure {
    let plane = Plane { normal_in_base: [0.0, 0.0, -1.0], offset: 0.25 };
    Configure { workspace: [plane].into_iter().collect(), ..configure(&PLAN, 8_000_000, 2_000_000, CORRECTION) }
}

/// The setpoints of the golden batch: three on a line, the last of them laid down, three at rest.
fn golden_setpoints() -> Vec<Setpoint<2>> {
    let at = |k: f64, flow, deposit| Setpoint {
        joints: JointPos([joint_on_grid(0.1 + 0.001 * k), joint_on_grid(-0.2)]),
        flow: flow_on_grid(flow),
        deposit,
    };
    vec![
        at(0.0, 0.0, false),
        at(1.0, 0.0, false),
        at(2.0, 2e-5, true),
        at(2.0, 0.0, false),
        at(2.0, 0.0, false),
        at(2.0, 0.0, false),
    ]
}

fn code<const N: usize>(setpoints: &[Setpoint<N>]) -> Vec<u8> {
    let (mut coder, mut code, mut used) = (Coder::new(), vec![0; CODE_MAX], 0);
    for setpoint in setpoints {
        used += coder.encode(setpoint, &mut code[used..]).unwrap();
    }
    code.truncate(used);
    code
}

/// Every message to the kernel, by name.
fn to_kernel(code: &[u8]) -> Vec<(&'static str, ToKernel<'_>)> {
    let batch = BatchPart { batch: 300, first_seq: 70_000, opens: true, commits: true, after: Some(69_999), code };
    vec![
        ("hello", ToKernel::Hello),
        ("configure", ToKernel::Configure(golden_configure())),
        ("batch", ToKernel::Batch(batch)),
        ("batch-middle", ToKernel::Batch(BatchPart { opens: false, commits: false, after: None, code: &[], ..batch })),
        ("rate", ToKernel::Rate(0.5)),
        ("hold", ToKernel::Hold),
        ("resume", ToKernel::Resume { epoch: 3 }),
        ("stop", ToKernel::Stop),
        ("rearm", ToKernel::Rearm { fault: 2 }),
        ("quit", ToKernel::Quit),
    ]
}

const STATUS: Status = Status {
    tick: 123_456,
    epoch: 3,
    mode: ModeCode::Moving,
    fault: None,
    consumed: 70_010,
    end_seq: 70_500,
    credits: 3000,
    rate: 0.75,
    frames_broken: 1,
    frames_unknown: 2,
    ticks_late: 3,
    time_lost_ns: 4_000_000,
};

/// Every message of 1.0 from the kernel, and in them every refusal, fault and mode.
fn from_kernel() -> Vec<(String, FromKernel)> {
    let cycle = CycleRecord {
        tick: 123_456,
        received_ns: 1_000_000,
        ticked_ns: 1_004_000,
        sent_ns: 1_010_000,
        robot_time: 17.008,
        missed: 1,
        seq: 70_010,
        mode: ModeCode::Moving,
        deposit: true,
        rate: 1.0,
        flow: 2e-5,
        commanded: both(0.1),
        actual: both(0.099),
    };
    let note = |text: &str| heapless::String::try_from(text).unwrap();
    let mut messages = vec![
        ("accepted".into(), FromKernel::Accepted { batch: 300 }),
        ("cycle".into(), FromKernel::Cycle(cycle)),
        ("process".into(), FromKernel::Process { realtime: false, note: note("no SCHED_FIFO") }),
        ("alarm".into(), FromKernel::Alarm { fatal: true, note: note("the robot is silent") }),
    ];
    messages.extend(modes());
    messages.extend(faults_1_0().map(|(code, report)| {
        let status = Status { mode: ModeCode::Faulted, fault: Some(report), ..STATUS };
        (format!("status-{code}"), FromKernel::Status(status))
    }));
    messages.extend(refusals());
    messages.extend(faults_1_0().map(|(code, report)| (format!("fault-{code}"), FromKernel::Fault(report))));
    messages
}

fn modes() -> impl Iterator<Item = (String, FromKernel)> {
    let modes = [ModeCode::Unready, ModeCode::Holding, ModeCode::Moving, ModeCode::Stopping, ModeCode::Faulted];
    modes
        .into_iter()
        .map(|mode| (format!("status-{mode:?}").to_lowercase(), FromKernel::Status(Status { mode, ..STATUS })))
}

fn faults_1_0() -> impl Iterator<Item = (String, FaultReport)> {
    let (joint, value, limit) = (1, 0.25, 0.125);
    let faults = [
        Fault::Following { joint, value, limit },
        Fault::Sensor { joint },
        Fault::RobotNotReady,
        Fault::Output { quantity: Quantity::Velocity, joint, value, limit },
        Fault::Extruder,
        Fault::Deviation { joint, value, limit },
        Fault::Correction { quantity: Quantity::Acceleration, joint, value, limit },
    ];
    faults.into_iter().map(|fault| (fault.code().to_lowercase(), FaultReport { number: 2, fault, tick: 123_000 }))
}

/// What version 1.1 appends: every fault, every reason in one, a record of the loop with and without a tracker, a path.
fn since_1_1() -> Vec<(String, FromKernel)> {
    let (joint, value, limit) = (1, 0.25, 0.125);
    let reasons =
        [Unreached::Reach, Unreached::Orientation, Unreached::Limit, Unreached::Singular, Unreached::Unsolved];
    let bounds = [Bound::Shift, Bound::Turn, Bound::Speed];
    let faults: Vec<Fault> = bounds
        .map(|bound| Fault::Saturated { bound, value, limit })
        .into_iter()
        .chain(reasons.map(|reason| Fault::Unreachable { reason, value }))
        .chain([
            Fault::Base { axis: 4, value, limit },
            Fault::Drive { joint, value, limit },
            Fault::Lead { joint, value, limit },
            Fault::Tracker { value, limit },
            Fault::Overrun { missed: 34, limit: 10 },
            Fault::Link,
        ])
        .collect();
    let mut codes: Vec<_> = faults.iter().map(Fault::code).collect();
    codes.dedup();
    assert_eq!(codes.len() + faults_1_0().count(), Fault::KINDS.len());
    let base = BaseRecord {
        age: Some(0.004),
        displacement: [1e-3, -2e-3, 3e-3, 1e-4, 0.0, -2e-4],
        behind: [1e-5, 2e-6],
        nis: Some(5.25),
        taken: 70_000,
        refused: 12,
        gated: 3,
        late: 2,
        deferred: 1,
    };
    let record = LoopRecord {
        tick: 123_456,
        base: Some(base),
        closed: true,
        waits: false,
        saturated: true,
        moved: [2.5e-3, 1e-3],
        held: [1e-4, 0.0],
        behind: 5e-4,
        lag: both(0.1),
        inverse_gain: both(0.005),
    };
    let lost = BaseRecord { age: None, nis: None, ..base };
    let reports = (0..).zip(faults).map(|(number, fault): (u32, _)| {
        let report = FaultReport { number: 2, fault, tick: 123_000 };
        (format!("fault-{}-{number}", fault.code().to_lowercase()), FromKernel::Fault(report))
    });
    let status = FaultReport { number: 2, fault: Fault::Tracker { value, limit }, tick: 123_000 };
    let status = Status { mode: ModeCode::Faulted, fault: Some(status), ..STATUS };
    let nine = (1..=JOINTS_MAX).map(|joint| 0.01 * joint as f64).collect::<frame::JointValues>();
    let widest = LoopRecord { lag: nine.clone(), inverse_gain: nine.clone(), ..record.clone() };
    let pace = Pace {
        tick: 123_456,
        readable_ns: 999_000,
        overruns: 12,
        slots_missed: 345,
        level: 1,
        level_max: 6,
        writes_blocked: 2,
        segments_resent: 3,
        allocations: 4,
        faults_minor: 5,
        faults_major: 6,
    };
    let cycles = Cycles { tick: 123_456, sent: 123_000, doubled: 3, skipped: 2, stalled: 345 };
    let mut messages: Vec<_> = reports.collect();
    messages.extend([
        ("status-k13".to_owned(), FromKernel::Status(status)),
        ("loop".to_owned(), FromKernel::Loop(record.clone())),
        ("loop-lost".to_owned(), FromKernel::Loop(LoopRecord { base: Some(lost), waits: true, ..record.clone() })),
        ("loop-lead-only".to_owned(), FromKernel::Loop(LoopRecord { base: None, closed: false, ..record })),
        ("loop-9-joints".to_owned(), FromKernel::Loop(widest)),
        ("path".to_owned(), FromKernel::Path { tick: 123_456, joints: both(0.1) }),
        ("path-9-joints".to_owned(), FromKernel::Path { tick: 123_456, joints: nine }),
        ("pace".to_owned(), FromKernel::Pace(pace)),
        ("cycles".to_owned(), FromKernel::Cycles(cycles)),
    ]);
    messages
}

fn refusals() -> impl Iterator<Item = (String, FromKernel)> {
    let found = |quantity| Refusal::DoesNotFit { seq: 70_011, quantity, joint: 1, value: 2.5, limit: 2.0 };
    let reasons = [
        Refusal::Mode,
        Refusal::Configuration(Unsound::Joints),
        Refusal::Configuration(Unsound::Periods),
        Refusal::Configuration(Unsound::Positions),
        Refusal::Configuration(Unsound::Motion),
        Refusal::Configuration(Unsound::Errors),
        Refusal::Configuration(Unsound::Correction),
        Refusal::Configuration(Unsound::Tool),
        Refusal::Configuration(Unsound::Workspace),
        Refusal::NoRoom { quantity: Quantity::Jerk, joint: 1, value: 100.0, limit: 200.0 },
        Refusal::Full,
        Refusal::TooLate,
        Refusal::Sequence,
        Refusal::Code,
        found(Quantity::Finite),
        found(Quantity::Position),
        found(Quantity::Velocity),
        found(Quantity::Acceleration),
        found(Quantity::Jerk),
        found(Quantity::Workspace),
        Refusal::NotAtRest,
        Refusal::Rate,
        Refusal::Stale,
    ];
    let numbered = (0..).zip(reasons);
    numbered.map(|(number, reason): (u32, _)| (format!("refused-{number}"), FromKernel::Refused { batch: 300, reason }))
}

/// Batches for arms with the fewest and the most joints, every joint with steps of its own, and a configuration for most.
fn other_arms(code: &[Vec<u8>; 2]) -> Vec<(&'static str, ToKernel<'_>)> {
    let part = BatchPart { batch: 1, first_seq: 1, opens: true, commits: true, after: None, code: &[] };
    let all = |value: f64| (1..=JOINTS_MAX).map(|joint| value * joint as f64).collect::<frame::JointValues>();
    let motion = frame::MotionLimits { velocity_max: all(0.5), acceleration_max: all(5.0), jerk_max: all(500.0) };
    let configure = Configure {
        position_min: all(-2.0),
        position_max: all(2.0),
        plan: motion.clone(),
        output: motion,
        ..golden_configure()
    };
    let [three, nine] = code;
    vec![
        ("batch-3-joints", ToKernel::Batch(BatchPart { code: three, ..part })),
        ("batch-9-joints", ToKernel::Batch(BatchPart { code: nine, ..part })),
        ("configure-9-joints", ToKernel::Configure(configure)),
    ]
}

/// Setpoints that use every part of the code: keys, lines, parabolas, both signs, flow.
fn wide_setpoints<const N: usize>() -> Vec<Setpoint<N>> {
    let joint =
        |k: usize, j: usize| joint_on_grid((j as f64 - 4.0) * 0.3 + 0.002 * (k * k) as f64 * (1.0 - 0.4 * j as f64));
    let setpoint = |k: usize| Setpoint {
        joints: JointPos(std::array::from_fn(|j| joint(k, j))),
        flow: flow_on_grid(1e-6 * (5 - k) as f64),
        deposit: k.is_multiple_of(2),
    };
    (0..6).map(setpoint).collect()
}

fn wide_code() -> [Vec<u8>; 2] {
    [code(&wide_setpoints::<3>()), code(&wide_setpoints::<9>())]
}

fn comes_back<const N: usize>(code: &[u8], setpoints: &[Setpoint<N>]) {
    let (mut coder, mut rest) = (Coder::<N>::new(), code);
    for expected in setpoints {
        let (setpoint, used) = coder.decode(rest).unwrap();
        assert_eq!(setpoint, *expected);
        rest = &rest[used..];
    }
    assert!(rest.is_empty());
}

/// A golden line is what the message is encoded to by another envelope than the kernel's own, and is read back by it.
fn agrees<'a, M>(version: u8, name: &str, message: &M, golden: &(String, Vec<u8>), plain: &'a [u8])
where
    M: serde::Serialize + serde::Deserialize<'a> + PartialEq + std::fmt::Debug,
{
    let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let mut body = vec![0; FRAME_MAX];
    let body = postcard::to_slice(message, &mut body).unwrap();
    let line = |name: &str, bytes: &[u8]| format!("{name}: {}", hex(bytes));
    assert_eq!(line(&golden.0, &golden.1), line(name, &envelope(version, body)));
    assert_eq!(hex(&wire(message)), hex(&envelope(VERSION, body)));
    assert_eq!(frame::decode::<M>(plain).as_ref(), Ok(message));
}

#[test]
fn every_message_is_encoded_to_and_decoded_from_the_committed_bytes() {
    let golden = golden();
    let plain: Vec<Vec<u8>> = golden.iter().map(|(_, bytes)| read(bytes).remove(0).unwrap()).collect();
    let mut lines = golden.iter().zip(&plain);
    let (narrow, wide) = (code(&golden_setpoints()), wide_code());
    let (to_kernel, from_kernel) = (to_kernel(&narrow), from_kernel());
    assert_eq!(to_kernel.len(), TO_KERNEL);
    for (name, message) in &to_kernel {
        let (golden, plain) = lines.next().unwrap();
        agrees(0x10, name, message, golden, plain);
    }
    for (name, message) in &from_kernel {
        let (golden, plain) = lines.next().unwrap();
        agrees(0x10, name, message, golden, plain);
    }
    for (name, message) in &other_arms(&wide) {
        let (golden, plain) = lines.next().unwrap();
        agrees(0x10, name, message, golden, plain);
    }
    assert_eq!(lines.next(), None, "a golden line without a message");
    comes_back(&narrow, &golden_setpoints());
    comes_back(&wide[0], &wide_setpoints::<3>());
    comes_back(&wide[1], &wide_setpoints::<9>());
}

#[test]
fn what_1_1_appends_is_encoded_to_and_decoded_from_the_committed_bytes_and_frozen() {
    let (golden, messages) = (golden_1_1(), since_1_1());
    assert_eq!(golden.len(), messages.len());
    for (golden, (name, message)) in golden.iter().zip(&messages) {
        let plain = read(&golden.1).remove(0).unwrap();
        agrees(0x11, name, message, golden, &plain);
        assert!(golden.1.len() <= 512, "{name}");
    }
    let bytes: Vec<u8> = golden.iter().flat_map(|(_, bytes)| bytes.iter().copied()).collect();
    assert_eq!((golden.len(), crc(&bytes)), (FROZEN_LINES_1_1, FROZEN_1_1));
}

/// Whoever changes the format finds this test: bytes of version 1.0 stay as they are, and stay readable. What a later minor
/// version appends gets a file of its own.
#[test]
fn the_frames_of_version_1_0_are_frozen() {
    assert_eq!(VERSION >> 4, 1, "another major version reads none of these frames");
    let lines = golden();
    let bytes: Vec<u8> = lines.iter().flat_map(|(_, bytes)| bytes.iter().copied()).collect();
    assert_eq!((lines.len(), crc(&bytes)), (FROZEN_LINES, FROZEN));
    for (index, (name, bytes)) in lines.iter().enumerate() {
        let plain = read(bytes).remove(0).unwrap();
        let to = index < TO_KERNEL || name.ends_with("joints");
        let known =
            if to { frame::decode::<ToKernel>(&plain).err() } else { frame::decode::<FromKernel>(&plain).err() };
        assert_eq!(known, None, "{name}");
        // The version stands behind the first COBS code.
        assert_eq!(bytes[1], 0x10, "{name}");
    }
}

#[test]
fn the_longest_messages_fit_one_frame() {
    let joints: frame::JointValues = [1.0; JOINTS_MAX].into_iter().collect();
    let motion = frame::MotionLimits {
        velocity_max: joints.clone(),
        acceleration_max: joints.clone(),
        jerk_max: joints.clone(),
    };
    let configure = Configure {
        sample_period_ns: u64::MAX,
        tick_period_ns: u64::MAX,
        position_min: joints.clone(),
        position_max: joints.clone(),
        plan: motion.clone(),
        output: motion,
        workspace: [Plane { normal_in_base: [1.0; 3], offset: 1.0 }; PLANES_MAX].into_iter().collect(),
        ..golden_configure()
    };
    assert!(wire(&ToKernel::Configure(configure)).len() <= WIRE_MAX);
    let code = [0xff; CODE_MAX];
    let part = BatchPart {
        batch: u32::MAX,
        first_seq: u32::MAX,
        opens: true,
        commits: true,
        after: Some(u32::MAX),
        code: &code,
    };
    assert!(wire(&ToKernel::Batch(part)).len() <= WIRE_MAX);
    let note = heapless::String::try_from("x".repeat(frame::NOTE_MAX).as_str()).unwrap();
    assert!(wire(&FromKernel::Alarm { fatal: true, note }).len() < FRAME_MAX);
    assert_eq!(
        frame::encode(&ToKernel::Batch(BatchPart { code: &[0; FRAME_MAX], ..part }), &mut [0; WIRE_MAX]),
        Err(FrameError::TooLong)
    );
    assert_eq!(frame::encode(&ToKernel::Hello, &mut [0; 7]), Err(FrameError::TooLong));
}

#[test]
fn every_length_of_payload_comes_back() {
    let payload: Vec<u8> = (0..CODE_MAX).map(|k| (k * 7 % 256) as u8).collect();
    for len in (0..600).chain([CODE_MAX]) {
        for flat in [None, Some(0_u8), Some(1)] {
            let code: Vec<u8> = payload[..len].iter().map(|&b| flat.unwrap_or(b)).collect();
            let part = BatchPart { batch: 7, first_seq: 9, opens: true, commits: false, after: Some(8), code: &code };
            let bytes = wire(&ToKernel::Batch(part));
            assert_eq!(bytes.iter().position(|&b| b == 0), Some(bytes.len() - 1));
            let plain = read(&bytes).remove(0).unwrap();
            assert_eq!(frame::decode::<ToKernel>(&plain), Ok(ToKernel::Batch(part)));
        }
    }
}

#[test]
fn a_flipped_bit_or_a_lost_byte_is_noticed_and_the_next_frame_is_read() {
    let good = wire(&ToKernel::Resume { epoch: 3 });
    for at in 0..good.len() {
        for bit in 0..9 {
            let mut bad = good.clone();
            if bit == 8 {
                bad.remove(at);
            } else {
                bad[at] ^= 1 << bit;
            }
            bad.push(0);
            bad.extend(&good);
            let whole: Vec<_> = read(&bad).into_iter().flatten().collect();
            for plain in &whole {
                assert_eq!(frame::decode::<ToKernel>(plain), Ok(ToKernel::Resume { epoch: 3 }));
            }
            // Losing only the final zero loses nothing: another zero follows.
            let expected = if at == good.len() - 1 && bit == 8 { 2 } else { 1 };
            assert_eq!(whole.len(), expected, "byte {at}, bit {bit}");
        }
    }
}

#[test]
fn a_later_minor_version_is_read_and_its_new_messages_are_counted_and_stop_nothing() {
    let hold = envelope(VERSION + 3, &[4]);
    assert_eq!(frame::decode::<ToKernel>(&read(&hold).remove(0).unwrap()), Ok(ToKernel::Hold));
    // Variant 9 and a refusal of number 200 do not exist; neither do bytes behind a message.
    for body in [&[9][..], &[200, 1], &[4, 0]] {
        assert_eq!(
            frame::decode::<ToKernel>(&read(&envelope(VERSION, body)).remove(0).unwrap()),
            Err(FrameError::Message)
        );
    }
    assert_eq!(read(&envelope(VERSION + 0x10, &[4])), [Err(FrameError::Version(VERSION + 0x10))]);
    let mut bench = Bench::<1024>::new(configure(&PLAN, 2_000_000, 2_000_000, CORRECTION));
    assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 500)), None);
    bench.resume();
    for _ in 0..100 {
        bench.tick();
    }
    bench.send(&envelope(VERSION + 1, &[9, 1, 2, 3]));
    bench.send(&envelope(VERSION + 0x10, &[4]));
    let status = bench.status();
    assert_eq!((status.frames_unknown, status.frames_broken, status.mode), (1, 1, ModeCode::Moving));
}

#[test]
fn a_hundred_thousand_fuzzed_inputs_do_no_harm() {
    assert_eq!(fuzz(1, 100_000).corrupt, 0);
}
