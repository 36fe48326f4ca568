//! Cases that a host, a robot and a line can bring about together, and that no single one of them would.

mod common;

use common::{PLAN, Random, configure, sweep};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, FromKernel, ModeCode, Refusal, Status, ToKernel, WIRE_MAX};
use screed_kernel::setpoint::joint_on_grid;
use screed_kernel::tick::{RECEIVE_MAX, STATUS_INTERVAL};
use screed_kernel::units::JointPos;

const PERIOD_NS: u64 = 2_000_000;

type Bench = common::Bench<2048>;

fn bench() -> Bench {
    Bench::new(configure(&PLAN, PERIOD_NS, PERIOD_NS, CorrectionLimits::NONE))
}

/// In motion, at `ticks` ticks of a long sweep.
fn moving(ticks: u32) -> Bench {
    let mut bench = bench();
    assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 1000)), None);
    bench.resume();
    for _ in 0..ticks {
        bench.tick();
    }
    bench
}

/// One tick after which the arm has not moved.
fn tick_blocked(bench: &mut Bench) -> Option<JointPos<2>> {
    let at = bench.sensors.actual;
    let joints = bench.tick().joints;
    bench.sensors.actual = at;
    joints
}

#[test]
fn an_arm_that_was_moved_after_a_fault_is_sent_nothing_also_when_a_sensor_is_broken() {
    let mut bench = moving(400);
    bench.kernel.raise(Fault::Extruder);
    while bench.status().mode != ModeCode::Faulted {
        bench.tick();
    }
    bench.sensors.estimate = Some(JointPos([f64::NAN; 2]));
    bench.sensors.ready = false;
    assert_eq!(bench.tick().joints, None);
    bench.sensors.ready = true;
    bench.sensors.actual = JointPos([1.0, 1.0]);
    assert_eq!(bench.tick().joints, None, "what was sent last is no place to go back to");
}

#[test]
fn an_arm_that_stood_still_by_itself_does_not_jump_after_the_path_when_it_is_ready_again() {
    let mut bench = moving(400);
    bench.sensors.ready = false;
    let stood = bench.sensors.actual;
    let (mut target, mut ticks) = (stood, 0);
    while (target.0[0] - stood.0[0]).abs() < 0.06 {
        target = tick_blocked(&mut bench).unwrap_or(JointPos([9.0; 2]));
        ticks += 1;
        assert!(ticks < 400);
    }
    assert_eq!(bench.status().mode, ModeCode::Stopping);
    bench.sensors.ready = true;
    assert_eq!((tick_blocked(&mut bench), bench.sensors.actual), (None, stood));
    // An arm that goes on following is brought to rest on the path, whatever its controller says of itself.
    let mut bench = moving(400);
    bench.sensors.ready = false;
    for _ in 0..50 {
        assert!(bench.tick().joints.is_some());
    }
    bench.sensors.ready = true;
    while bench.status().mode == ModeCode::Stopping {
        assert!(bench.tick().joints.is_some());
    }
    assert_eq!((bench.status().mode, bench.status().fault.unwrap().fault), (ModeCode::Faulted, Fault::RobotNotReady));
}

#[test]
fn a_part_of_another_batch_is_refused_and_the_one_under_way_is_not_harmed() {
    let mut bench = bench();
    let stale = bench.frames(1, None, &sweep(0.1, 0.3, 500));
    let frames = bench.frames(1, None, &sweep(0.1, 0.6, 500));
    for (number, frame) in frames.iter().enumerate() {
        bench.send(frame);
        if number == 3 {
            bench.send(&stale[5]);
            let refused = FromKernel::Refused { batch: 1, reason: Refusal::Sequence };
            assert!(bench.answers.contains(&refused), "{:?}", bench.answers);
        }
    }
    assert_eq!((bench.answer(), bench.status().end_seq), (Some(Ok(())), 502));
    // A part of its own that is lost does harm it, and a new one takes the place of one that was left half sent.
    let frames = bench.frames(503, None, &sweep(0.6, 0.1, 500));
    frames.iter().enumerate().filter(|(number, _)| *number != 4).for_each(|(_, frame)| bench.send(frame));
    assert_eq!((bench.answer(), bench.status().end_seq), (Some(Err(Refusal::Sequence)), 502));
    let half = bench.frames(503, None, &sweep(0.6, 0.1, 500));
    bench.send(&half[0]);
    assert_eq!(bench.batch(503, None, &sweep(0.6, 0.2, 600)), None);
    assert_eq!(joint_on_grid(0.2), {
        bench.resume();
        while bench.status().mode == ModeCode::Moving {
            bench.tick();
        }
        bench.sensors.actual.0[0]
    });
}

#[test]
fn a_fault_that_had_no_room_among_the_answers_is_in_the_next_status() {
    let mut bench = moving(100);
    let mut stale = [0; WIRE_MAX];
    let used = frame::encode(&ToKernel::Rearm { fault: 9 }, &mut stale).unwrap();
    let refused = stale[..used].repeat(RECEIVE_MAX / used);
    // Nobody reads.
    let sensors = bench.sensors;
    for _ in 0..10 {
        bench.kernel.receive(&refused);
        bench.kernel.tick(bench.now, &sensors);
    }
    bench.kernel.raise(Fault::Extruder);
    bench.listen();
    assert_eq!(bench.faults, [], "the answers that waited were in its way");
    bench.answers.clear();
    for _ in 0..STATUS_INTERVAL {
        bench.tick();
    }
    let told = |answer: &FromKernel| matches!(answer, FromKernel::Status(Status { fault: Some(_), .. }));
    assert!(bench.answers.iter().any(told), "{:?}", bench.answers);
}

#[test]
fn a_configuration_sent_twice_counts_twice_and_one_in_motion_changes_nothing() {
    let mut bench = bench();
    let epoch = bench.status().epoch;
    let good = configure(&PLAN, PERIOD_NS, PERIOD_NS, CorrectionLimits::NONE);
    let slow = configure(&PLAN, 8_000_000, PERIOD_NS, CorrectionLimits::NONE);
    bench.say(&ToKernel::Configure(good.clone()));
    bench.say(&ToKernel::Configure(good));
    assert_eq!((bench.refusal(), bench.status().epoch), (None, epoch + 2));
    assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 1000)), None);
    bench.say(&ToKernel::Configure(slow.clone()));
    assert_eq!(bench.refusal(), Some(Refusal::Mode), "setpoints wait for the periods they were planned with");
    bench.resume();
    let mut at = 0;
    while at < 500 {
        let command = bench.tick();
        if command.seq == at + 1 {
            at = command.seq;
        }
        assert_eq!(command.seq, at, "a tick a sample, as configured");
        bench.say(&ToKernel::Configure(slow.clone()));
        assert_eq!(bench.refusal(), Some(Refusal::Mode));
    }
}

#[test]
fn after_any_noise_the_next_frame_is_obeyed() {
    let mut random = Random(11);
    for length in [1, 253, 254, 255, 1023, 1024, 1029, 1030, 1031, 1285, 5000, 100_000] {
        for flat in [None, Some(1), Some(254), Some(255)] {
            let mut bench = bench();
            let noise: Vec<u8> = (0..length).map(|_| flat.unwrap_or(1 + random.below(255) as u8)).collect();
            bench.send(&noise);
            bench.send(&[0]);
            assert_eq!((bench.status().frames_broken, bench.status().frames_unknown), (1, 0), "{length} bytes");
            assert_eq!(bench.batch(1, None, &sweep(0.1, 0.2, 500)), None);
        }
    }
}

#[test]
fn a_resume_that_is_taken_back_before_the_next_tick_moves_nothing() {
    type TakeBack = fn(&mut Bench);
    let found: [(TakeBack, ModeCode); 4] = [
        (|b| b.say(&ToKernel::Hold), ModeCode::Holding),
        (|b| b.say(&ToKernel::Stop), ModeCode::Holding),
        (|b| b.kernel.raise(Fault::Extruder), ModeCode::Faulted),
        (|b| b.sensors.ready = false, ModeCode::Faulted),
    ];
    for (take_back, mode) in found {
        let mut bench = bench();
        assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 1000)), None);
        let stood = bench.sensors.actual;
        bench.resume();
        take_back(&mut bench);
        let command = bench.tick();
        assert_eq!((command.joints.unwrap_or(stood), command.mode.code()), (stood, mode));
        assert_eq!(bench.status().consumed, 0);
    }
}

#[test]
fn a_configuration_waits_for_what_the_clock_has_taken_from_an_empty_ring() {
    let slow = || configure(&PLAN, 8_000_000, PERIOD_NS, CorrectionLimits::NONE);
    let mut bench = Bench::new(slow());
    let motion = sweep(0.1, 0.6, 300);
    assert_eq!(bench.batch(1, None, &motion), None);
    bench.resume();
    bench.say(&ToKernel::Rate(0.2));
    while bench.status().consumed < 302 {
        bench.tick();
        if bench.status().consumed == 298 {
            bench.say(&ToKernel::Rate(0.02));
        }
    }
    bench.say(&ToKernel::Hold);
    while bench.status().mode != ModeCode::Holding {
        bench.tick();
    }
    let (status, end) = (bench.status(), motion.last().unwrap().joints);
    assert!(
        status.consumed == status.end_seq && bench.sensors.actual != end,
        "the ring is empty before the path's end"
    );
    bench.say(&ToKernel::Configure(slow()));
    assert_eq!((bench.refusal(), bench.status().epoch), (Some(Refusal::Mode), status.epoch));
    bench.resume();
    while bench.status().mode != ModeCode::Holding {
        bench.tick();
    }
    assert_eq!(bench.sensors.actual, end);
    bench.say(&ToKernel::Configure(slow()));
    assert_eq!(bench.refusal(), None);
}
