//! Cases that a host, a robot and a line can bring about together, and that no single one of them would.

mod common;

use common::{PLAN, configure, sweep};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{FromKernel, ModeCode, Refusal};
use screed_kernel::setpoint::joint_on_grid;
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
