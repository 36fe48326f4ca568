//! The kernel through its three functions: bytes in, ticks, bytes out.

mod common;

use common::{ARM, PLAN, configure, sweep};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::fault::Fault;
use screed_kernel::frame::{Configure, FromKernel, ModeCode, Refusal, ToKernel, Unsound};
use screed_kernel::guard::{Plane, Quantity};
use screed_kernel::ramp::{Ramp, RampLimits};
use screed_kernel::setpoint::{Setpoint, joint_on_grid};
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::{JointPos, Nanos};

const PERIOD_NS: u64 = 2_000_000;
const PERIOD: f64 = 0.002;
const CORRECTION: CorrectionLimits = CorrectionLimits { size_max: 0.02, velocity_max: 0.1, acceleration_max: 1.0 };

type Bench = common::Bench<2048>;

fn bench() -> Bench {
    Bench::new(configure(&PLAN, PERIOD_NS, PERIOD_NS, CORRECTION))
}

/// In motion, at `ticks` ticks of a long sweep.
fn moving(ticks: u32) -> Bench {
    let mut bench = bench();
    assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 1000)), None);
    bench.resume();
    for _ in 0..ticks {
        bench.tick();
    }
    assert_eq!(bench.status().mode, ModeCode::Moving);
    bench
}

/// Ticks until the kernel is at rest, and returns what it put out.
fn until_rest(bench: &mut Bench) -> Vec<Command<2>> {
    let mut commands = Vec::new();
    while matches!(bench.status().mode, ModeCode::Moving | ModeCode::Stopping) {
        commands.push(bench.tick());
        assert!(commands.len() < 3000, "never at rest");
    }
    commands
}

fn fault(bench: &Bench) -> Fault {
    bench.status().fault.unwrap().fault
}

#[test]
fn a_batch_is_played_sample_by_sample_and_ends_holding() {
    for ticks in [1, 2, 4] {
        let mut bench = Bench::new(configure(&PLAN, 8_000_000, 8_000_000 / ticks, CORRECTION));
        let motion = sweep(0.1, 0.6, 500);
        assert_eq!(bench.batch(1, None, &motion), None);
        assert_eq!(bench.status().mode, ModeCode::Holding, "nothing moves before a person says so");
        bench.resume();
        let mut heard = Vec::new();
        for command in until_rest(&mut bench) {
            if command.seq > heard.len() as u32 {
                heard.push(command.joints.unwrap());
            }
        }
        assert_eq!(heard, motion.iter().map(|s| s.joints).collect::<Vec<_>>(), "{ticks} ticks a sample");
        assert_eq!((bench.status().mode, bench.status().consumed), (ModeCode::Holding, 502));
    }
}

#[test]
fn replacing_after_a_setpoint_joins_smoothly_or_is_refused() {
    let mut bench = bench();
    let long = sweep(0.1, 0.8, 1000);
    // The first batch stops short: the same path, slowed to rest from sample 300 on by a tail of its own.
    let tail: Vec<_> = (0..400)
        .map(|k| {
            let u = (f64::from(k) / 380.0).min(1.0);
            let time = 300.0 + 380.0 * (u - u * u * u + 0.5 * u * u * u * u);
            let (whole, part) = (time.floor() as usize, time.fract());
            let blend = |j: usize| long[whole].joints.0[j] * (1.0 - part) + long[whole + 1].joints.0[j] * part;
            Setpoint { joints: JointPos([blend(0), blend(1)].map(joint_on_grid)), flow: 0.0, deposit: false }
        })
        .collect();
    let first: Vec<_> = long[..300].iter().copied().chain(tail).collect();
    assert_eq!(bench.batch(1, None, &first), None);
    bench.resume();
    for _ in 0..200 {
        bench.tick();
    }
    // One sample left out: a step at the seam.
    let step = bench.batch(301, Some(300), &long[301..]);
    assert!(matches!(step, Some(Refusal::DoesNotFit { seq: 301, quantity: Quantity::Acceleration, .. })), "{step:?}");
    assert_eq!(bench.batch(302, Some(300), &long[300..]), Some(Refusal::Sequence));
    assert_eq!(bench.batch(151, Some(150), &long[150..]), Some(Refusal::TooLate));
    assert_eq!(bench.batch(301, Some(300), &long[300..]), None);
    let last = until_rest(&mut bench).pop().unwrap();
    assert_eq!((last.joints, last.seq), (Some(long[1001].joints), 1002));
}

#[test]
fn a_batch_that_breaks_a_limit_or_does_not_end_at_rest_is_refused_whole() {
    let mut bench = bench();
    let motion = sweep(0.1, 0.6, 500);
    assert_eq!(bench.batch(1, None, &motion[..400]), Some(Refusal::NotAtRest));
    assert_eq!(bench.batch(1, None, &motion[..501]), Some(Refusal::NotAtRest), "two equal samples are not three");
    let fast = bench.batch(1, None, &sweep(0.1, 0.6, 100));
    assert!(
        matches!(fast, Some(Refusal::DoesNotFit { quantity: Quantity::Jerk | Quantity::Acceleration, .. })),
        "{fast:?}"
    );
    let mut flowing = motion.clone();
    flowing.last_mut().unwrap().flow = 1e-6;
    assert_eq!(bench.batch(1, None, &flowing), Some(Refusal::NotAtRest));
    assert_eq!((bench.status().end_seq, bench.status().credits), (0, 2048));
    assert_eq!(bench.batch(1, None, &motion), None);
}

#[test]
fn hold_rests_within_a_second_on_the_path_and_resume_plays_on() {
    let mut bench = moving(400);
    bench.say(&ToKernel::Hold);
    let ticks = until_rest(&mut bench).len();
    assert!(ticks as f64 * PERIOD < 0.93, "{ticks}");
    let held = bench.tick().joints.unwrap();
    assert!((held.0[1] - held.0[0] - 0.1).abs() < 1e-9, "both joints stand at the same place of the path");
    bench.say(&ToKernel::Resume { epoch: bench.status().epoch + 1 });
    assert_eq!(bench.status().mode, ModeCode::Holding, "a command that speaks of another ring");
    bench.resume();
    until_rest(&mut bench);
    assert_eq!(bench.sensors.actual, sweep(0.1, 0.6, 1000).last().unwrap().joints);
}

#[test]
fn a_stop_in_motion_rests_drops_the_ring_and_a_new_batch_starts_from_there() {
    let mut bench = moving(400);
    let epoch = bench.status().epoch;
    bench.say(&ToKernel::Stop);
    assert_eq!(bench.batch(500, Some(499), &sweep(0.3, 0.5, 500)), Some(Refusal::Mode), "there will be no ring");
    let rest = until_rest(&mut bench).pop().unwrap().joints.unwrap();
    let status = bench.status();
    assert_eq!((status.mode, status.end_seq, status.epoch), (ModeCode::Holding, status.consumed, epoch + 1));
    assert_eq!(bench.batch(status.consumed + 1, None, &sweep(rest.0[0], 0.1, 500)), None);
    bench.resume();
    until_rest(&mut bench);
    assert_eq!(bench.sensors.actual, JointPos([0.1, 0.2].map(joint_on_grid)));
    bench.say(&ToKernel::Quit);
    assert!(bench.kernel.may_quit());
    let mut bench = moving(400);
    bench.say(&ToKernel::Quit);
    assert!(!bench.kernel.may_quit());
    until_rest(&mut bench);
    assert!(bench.kernel.may_quit());
}

#[test]
fn a_hold_still_takes_batches_and_a_stop_drops_the_ring_also_at_rest() {
    let mut bench = moving(400);
    bench.say(&ToKernel::Hold);
    bench.tick();
    let end = bench.status().end_seq;
    assert_eq!(bench.batch(end + 1, None, &sweep(0.6, 0.8, 500)), None);
    until_rest(&mut bench);
    assert_eq!(bench.status().end_seq, end + 502);
    let epoch = bench.status().epoch;
    bench.say(&ToKernel::Stop);
    let status = bench.status();
    assert_eq!((status.mode, status.end_seq, status.epoch), (ModeCode::Holding, status.consumed, epoch + 1));
    bench.say(&ToKernel::Configure(configure(&PLAN, PERIOD_NS, PERIOD_NS, CORRECTION)));
    assert_eq!(bench.refusal(), None);
}

#[test]
fn a_resume_is_obeyed_once_however_late_or_often_it_comes() {
    let mut bench = bench();
    let decided = bench.status().epoch;
    assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 1000)), None);
    // Overtaken by a hold.
    bench.say(&ToKernel::Hold);
    bench.say(&ToKernel::Resume { epoch: decided });
    assert_eq!((bench.status().mode, bench.refusal()), (ModeCode::Holding, Some(Refusal::Stale)));
    // Delivered twice, the second time behind a hold, and behind the end of what there was to play.
    let decided = bench.status().epoch;
    bench.say(&ToKernel::Resume { epoch: decided });
    assert_eq!((bench.status().mode, bench.refusal()), (ModeCode::Moving, None));
    bench.say(&ToKernel::Hold);
    until_rest(&mut bench);
    bench.say(&ToKernel::Resume { epoch: decided });
    assert_eq!((bench.status().mode, bench.refusal()), (ModeCode::Holding, Some(Refusal::Stale)));
    let decided = bench.status().epoch;
    bench.say(&ToKernel::Resume { epoch: decided });
    until_rest(&mut bench);
    let end = bench.status().end_seq;
    assert_eq!(bench.batch(end + 1, None, &sweep(0.6, 0.1, 1000)), None);
    bench.say(&ToKernel::Resume { epoch: decided });
    assert_eq!((bench.status().mode, bench.refusal()), (ModeCode::Holding, Some(Refusal::Stale)));
}

#[test]
fn an_arm_that_does_not_follow_is_a_fault_and_only_a_fresh_command_leads_on() {
    let mut bench = moving(10);
    let stuck = bench.sensors.actual;
    for _ in 0..1000 {
        bench.tick();
        bench.sensors.actual = stuck;
    }
    let report = bench.status().fault.unwrap();
    assert!(matches!(report.fault, Fault::Following { limit: 0.05, .. }));
    assert_eq!(bench.status().mode, ModeCode::Faulted);
    bench.say(&ToKernel::Rearm { fault: report.number + 1 });
    assert_eq!((bench.status().mode, bench.refusal()), (ModeCode::Faulted, Some(Refusal::Stale)));
    bench.resume();
    assert_eq!((bench.status().mode, bench.refusal()), (ModeCode::Faulted, Some(Refusal::Mode)));
    bench.kernel.robot_lost(Fault::Link);
    assert_eq!(
        (bench.status().mode, bench.tick().joints),
        (ModeCode::Faulted, None),
        "a lost link leads out of no fault"
    );
    bench.say(&ToKernel::Rearm { fault: report.number });
    let command = bench.tick();
    assert_eq!((bench.status().mode, command.joints), (ModeCode::Holding, Some(stuck)));
    assert_eq!(bench.status().end_seq, 0, "the ring is gone");
}

#[test]
fn each_finding_of_a_tick_is_its_own_fault_and_a_stop_on_the_path() {
    type Disturb = fn(&mut Bench);
    type Expected = fn(Fault) -> bool;
    let found: [(Disturb, Expected); 6] = [
        (|b| b.sensors.actual.0[0] += 0.06, |f| matches!(f, Fault::Following { joint: 0, limit: 0.05, .. })),
        (|b| b.sensors.actual.0[1] = f64::NAN, |f| f == Fault::Sensor { joint: 1 }),
        (|b| b.sensors.estimate = Some(JointPos([0.0, f64::INFINITY])), |f| f == Fault::Sensor { joint: 1 }),
        (|b| b.sensors.ready = false, |f| f == Fault::RobotNotReady),
        (|b| b.kernel.raise(Fault::Extruder), |f| f == Fault::Extruder),
        (
            |b| b.sensors.estimate = Some(JointPos(b.sensors.actual.0.map(|q| q + 0.045))),
            |f| matches!(f, Fault::Deviation { joint: 0 | 1, limit: 0.04, .. }),
        ),
    ];
    for (disturb, expected) in found {
        let mut bench = moving(400);
        let at = bench.status().tick;
        disturb(&mut bench);
        let first = bench.tick();
        assert!(expected(first.mode.fault().unwrap()), "{:?}", first.mode);
        assert_eq!(bench.faults, [bench.status().fault.unwrap()], "told at once");
        bench.sensors.estimate = None;
        if !bench.sensors.actual.is_finite() {
            bench.sensors.actual = first.joints.unwrap();
        }
        let commands = until_rest(&mut bench);
        assert!(commands.len() > 100, "a stop on the path takes its time");
        for command in &commands {
            let Some(JointPos([a, b])) = command.joints else { panic!() };
            assert!((b - a - 0.1).abs() < 1e-9, "left the path");
        }
        let report = bench.status().fault.unwrap();
        assert!(expected(report.fault), "{report:?}");
        assert!(report.number == 1 && report.tick - at <= 1);
        assert_eq!(bench.faults, [report], "and once");
        assert_eq!(bench.status().mode, ModeCode::Faulted);
    }
}

#[test]
fn a_lost_link_is_a_fault_at_once_and_nothing_is_put_out_until_a_person_has_re_armed() {
    type Before = fn() -> Bench;
    let modes: [(Before, ModeCode); 4] = [
        (bench, ModeCode::Holding),
        (|| moving(400), ModeCode::Moving),
        (|| said(moving(400), &ToKernel::Hold), ModeCode::Stopping),
        (|| said(moving(400), &ToKernel::Stop), ModeCode::Stopping),
    ];
    for (before, mode) in modes {
        let mut bench = before();
        assert_eq!(bench.status().mode, mode);
        bench.kernel.robot_lost(Fault::Link);
        bench.listen();
        let report = bench.status().fault.unwrap();
        assert_eq!((bench.status().mode, report.fault), (ModeCode::Faulted, Fault::Link));
        assert_eq!(bench.faults, [report], "told before any tick, and once");
        assert!(matches!(bench.answers.last(), Some(FromKernel::Status(status)) if status.fault == Some(report)));
        // In the place of ticks: it hears the host, says what changes, counts no epoch, raises nothing new.
        let epoch = bench.status().epoch;
        for _ in 0..3 {
            let taken = bench.kernel.receive(&[0; 2000]);
            assert!(taken > 1000, "{taken}");
            bench.kernel.robot_lost(Fault::Link);
            bench.listen();
        }
        assert_eq!((bench.status().epoch, bench.faults.len()), (epoch, 1));
        // The link is back, and the arm somewhere else.
        bench.sensors.actual = JointPos([1.0, 1.0]);
        for _ in 0..100 {
            assert_eq!(bench.tick().joints, None);
        }
        bench.resume();
        assert_eq!((bench.refusal(), bench.tick().joints), (Some(Refusal::Mode), None));
        bench.say(&ToKernel::Rearm { fault: report.number });
        for _ in 0..100 {
            assert_eq!(bench.tick().joints, Some(JointPos([1.0, 1.0])), "it holds where it is");
        }
        bench.resume();
        assert_eq!(
            (bench.refusal(), bench.status().mode),
            (Some(Refusal::Mode), ModeCode::Holding),
            "the ring is gone"
        );
    }
    // A person may leave the fault before the link is back; then there is none that a lost link could be.
    let mut bench = moving(400);
    bench.kernel.robot_lost(Fault::Link);
    let report = bench.status().fault.unwrap();
    bench.say(&ToKernel::Rearm { fault: report.number });
    bench.kernel.robot_lost(Fault::Link);
    assert_eq!((bench.status().mode, bench.status().fault), (ModeCode::Unready, None));
}

fn said(mut bench: Bench, message: &ToKernel) -> Bench {
    bench.say(message);
    bench.tick();
    bench
}

#[test]
fn a_robot_that_is_not_ready_is_sent_nothing() {
    let mut bench = bench();
    bench.sensors.ready = false;
    assert_eq!(bench.tick().joints, None);
    // Faulted, and then someone moves the arm: what was sent last is no place to go back to.
    let mut bench = moving(400);
    bench.kernel.raise(Fault::Extruder);
    until_rest(&mut bench);
    assert!(bench.tick().joints.is_some());
    bench.sensors.ready = false;
    assert_eq!(bench.tick().joints, None);
    bench.sensors.ready = true;
    bench.sensors.actual = JointPos([1.0, 1.0]);
    assert_eq!(bench.tick().joints, None);
    bench.say(&ToKernel::Rearm { fault: 1 });
    assert_eq!(bench.tick().joints, Some(JointPos([1.0, 1.0])));
}

#[test]
fn a_correction_is_added_and_a_bad_one_is_ramped_out_with_a_fault() {
    let mut bench = moving(300);
    let mut offset = 0.0;
    for k in 1..=100 {
        // 0.8 rad/s² up to 0.08 rad/s, then steady.
        offset += 0.8 * PERIOD * PERIOD * f64::from(k.min(50));
        bench.sensors.correction = Some(JointPos([offset, 0.0]));
        let command = bench.tick();
        let JointPos([a, b]) = command.joints.unwrap();
        assert!((a - offset - (b - 0.1)).abs() < 1e-9 && command.correction == JointPos([offset, 0.0]));
    }
    bench.sensors.correction = Some(JointPos([offset + 0.001, 0.0]));
    let first = bench.tick();
    let found = first.mode.fault();
    assert!(
        matches!(found, Some(Fault::Correction { quantity: Quantity::Velocity, joint: 0, limit: 0.1, .. })),
        "{found:?}"
    );
    let commands = until_rest(&mut bench);
    let mut last = [first.correction.0[0], offset];
    for command in &commands {
        let now = command.correction.0[0];
        let (v, a) = ((now - last[0]) / PERIOD, (now - 2.0 * last[0] + last[1]) / (PERIOD * PERIOD));
        assert!(v.abs() <= 0.1 * 1.000_001 && a.abs() <= 1.000_001, "{v} {a}");
        last = [now, last[0]];
    }
    assert_eq!((bench.status().mode, last[0]), (ModeCode::Faulted, 0.0));
    // Without a fault, one that ends is ramped out too, also at rest.
    let mut bench = self::bench();
    bench.sensors.correction = Some(JointPos([3e-6, 0.0]));
    bench.tick();
    bench.sensors.correction = None;
    for _ in 0..100 {
        bench.tick();
    }
    assert_eq!((bench.tick().correction, bench.status().fault), (JointPos::ZERO, None));
}

#[test]
fn an_output_that_fails_the_gate_is_not_sent_and_the_last_good_one_is_held() {
    // A correction may go beyond a position limit that the path keeps only by itself: the sum is what the gate sees.
    let mut configure = configure(&PLAN, PERIOD_NS, PERIOD_NS, CORRECTION);
    configure.position_max = [0.11, 3.0].into_iter().collect();
    configure.position_min = [-3.0, -3.0].into_iter().collect();
    let mut bench = Bench::new(configure);
    let (mut offset, mut good) = (0.0, JointPos::ZERO);
    let mut ticks = 0;
    while bench.status().fault.is_none() {
        offset += 0.8 * PERIOD * PERIOD * f64::from((ticks + 1).min(50));
        ticks += 1;
        bench.sensors.correction = Some(JointPos([offset, 0.0]));
        let command = bench.tick();
        if bench.status().fault.is_none() {
            good = command.joints.unwrap();
        } else {
            assert_eq!(command.joints, Some(good));
        }
        assert!(ticks < 1000);
    }
    let expected = |f| matches!(f, Fault::Output { quantity: Quantity::Position, joint: 0, limit: 0.11, .. });
    assert!(expected(fault(&bench)), "{:?}", fault(&bench));
    assert!(good.0[0] > 0.1 && good.0[0] <= 0.11);
    for _ in 0..10 {
        assert_eq!((bench.tick().joints, bench.status().mode), (Some(good), ModeCode::Faulted));
    }
}

#[test]
fn the_tool_is_kept_inside_the_workspace_before_a_batch_is_taken() {
    // Two links of 0.5 m at (q, q + 0.1), the tool 0.1 m further: it moves towards y as q grows.
    let y = |q: f64| 0.5 * q.sin() + 0.6 * (2.0 * q + 0.1).sin();
    let planes = |offset| [Plane { normal_in_base: [0.0, 1.0, 0.0], offset }].into_iter().collect();
    let base = configure(&PLAN, PERIOD_NS, PERIOD_NS, CORRECTION);
    let mut bench = Bench::new(Configure { workspace: planes(y(0.6) + 1e-6), ..base.clone() });
    assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 500)), None);
    let mut bench = Bench::new(Configure { workspace: planes(y(0.6) - 1e-6), ..base });
    let refused = bench.batch(1, None, &sweep(0.1, 0.6, 500));
    assert!(
        matches!(refused, Some(Refusal::DoesNotFit { quantity: Quantity::Workspace, joint: 0, .. })),
        "{refused:?}"
    );
}

#[test]
fn a_correction_that_would_take_the_tool_out_of_the_workspace_is_a_fault_before_it_does() {
    let y = |q: &JointPos<2>| 0.5 * q.0[0].sin() + 0.6 * (q.0[0] + q.0[1]).sin();
    let start = y(&bench().tick().joints.unwrap());
    let plane = Plane { normal_in_base: [0.0, 1.0, 0.0], offset: start + 5e-4 };
    let workspace = [plane].into_iter().collect();
    let mut bench = Bench::new(Configure { workspace, ..configure(&PLAN, PERIOD_NS, PERIOD_NS, CORRECTION) });
    bench.tick();
    let mut wanted = Ramp::at(0.0);
    let limits = RampLimits { slope_max: CORRECTION.velocity_max, curvature_max: CORRECTION.acceleration_max };
    let mut farthest = 0.0_f64;
    for _ in 0..5000 {
        wanted.step(CORRECTION.size_max, &limits, PERIOD);
        bench.sensors.correction = Some(JointPos([0.999 * wanted.value; 2]));
        farthest = farthest.max(y(&bench.tick().joints.unwrap()));
    }
    let Some(Fault::Correction { quantity: Quantity::Workspace, joint: 0, value, limit }) =
        bench.status().fault.map(|report| report.fault)
    else {
        panic!("{:?}", bench.status().fault)
    };
    assert!(value > limit && limit == plane.offset && value < limit + 1e-4);
    // Braking takes its way; then the arm is back on the path, inside.
    let brake = CORRECTION.velocity_max.powi(2) / CORRECTION.acceleration_max;
    assert!(farthest <= limit + 1.1 * 1.7 * brake, "{farthest} {limit}");
    assert_eq!((bench.status().mode, y(&bench.tick().joints.unwrap())), (ModeCode::Faulted, start));
}

#[test]
fn a_late_tick_advances_the_path_by_one_period_and_the_lost_time_is_reported() {
    let (mut late, mut punctual) = (moving(100), moving(100));
    late.now = late.now.plus(5 * PERIOD_NS);
    for _ in 0..100 {
        assert_eq!(late.tick(), punctual.tick());
    }
    let (late, punctual) = (late.status(), punctual.status());
    assert_eq!((late.ticks_late, late.time_lost_ns), (1, 5 * PERIOD_NS));
    assert_eq!((punctual.ticks_late, punctual.time_lost_ns), (0, 0));
}

#[test]
fn a_configuration_that_cannot_be_is_refused_with_what_is_wrong() {
    let good = || configure(&PLAN, 8_000_000, PERIOD_NS, CORRECTION);
    let with = |change: fn(&mut Configure)| {
        let mut bench = bench();
        let mut configure = good();
        change(&mut configure);
        bench.say(&ToKernel::Configure(configure));
        bench.refusal()
    };
    let unsound = |what| Some(Refusal::Configuration(what));
    assert_eq!(with(|_| ()), None);
    assert_eq!(with(|c| c.tick_period_ns = 3_000_000), unsound(Unsound::Periods));
    assert_eq!(with(|c| c.tick_period_ns = 0), unsound(Unsound::Periods));
    assert_eq!(with(|c| c.tick_period_ns = 16_000_000), unsound(Unsound::Periods));
    assert_eq!(with(|c| _ = c.position_min.pop()), unsound(Unsound::Joints));
    assert_eq!(with(|c| _ = c.output.jerk_max.push(1.0)), unsound(Unsound::Joints));
    assert_eq!(with(|c| c.position_min[1] = 2.99), unsound(Unsound::Positions));
    assert_eq!(with(|c| c.position_max[1] = 3.01), unsound(Unsound::Positions));
    assert_eq!(with(|c| c.plan.jerk_max[0] = 0.0), unsound(Unsound::Motion));
    assert_eq!(with(|c| c.plan.velocity_max[0] = 3.01), unsound(Unsound::Motion));
    assert_eq!(with(|c| c.following_error_max = f64::NAN), unsound(Unsound::Errors));
    assert_eq!(with(|c| c.deviation_max = -0.1), unsound(Unsound::Errors));
    assert_eq!(with(|c| c.correction.size_max = 0.0), unsound(Unsound::Correction));
    assert_eq!(with(|c| c.flange_from_tcp[4] = f64::INFINITY), unsound(Unsound::Tool));
    assert_eq!(with(|c| c.flange_from_tcp[0] = f64::NAN), unsound(Unsound::Tool));
    assert_eq!(with(|c| c.flange_from_tcp[0] = -1024.0), None);
    assert_eq!(with(|c| c.flange_from_tcp[0] = -1e308), unsound(Unsound::Tool), "a plane would refuse it with NaN");
    let plane = Plane { normal_in_base: [1.0, 0.1, 0.0], offset: 1.0 };
    assert_eq!(
        {
            let mut bench = bench();
            bench.say(&ToKernel::Configure(Configure { workspace: [plane].into_iter().collect(), ..good() }));
            bench.refusal()
        },
        unsound(Unsound::Workspace)
    );
    for (change, quantity) in [
        ((|c| c.output.velocity_max[1] *= 0.999) as fn(&mut Configure), Quantity::Velocity),
        (|c| c.output.acceleration_max[1] *= 0.999, Quantity::Acceleration),
        (|c| c.output.jerk_max[1] *= 0.999, Quantity::Jerk),
    ] {
        let refusal = with(change);
        let Some(Refusal::NoRoom { quantity: found, joint: 1, value, limit }) = refusal else { panic!("{refusal:?}") };
        assert!(found == quantity && (value / limit - 0.999).abs() < 1e-9);
    }
    // Holding with a ring, or in motion, is no time to change limits.
    let mut bench = moving(10);
    bench.say(&ToKernel::Configure(good()));
    assert_eq!(bench.refusal(), Some(Refusal::Mode));
}

#[test]
fn the_budget_between_ticks_bounds_what_is_taken_and_a_tick_renews_it() {
    let mut kernel = Kernel::<2, 64>::new(&ARM);
    let bytes = [1; 5000];
    assert_eq!(kernel.receive(&bytes), screed_kernel::tick::RECEIVE_MAX);
    assert_eq!(kernel.receive(&bytes), 0);
    kernel.tick(Nanos(1), &Sensors::robot(JointPos::ZERO, false));
    assert_eq!(kernel.receive(&bytes), screed_kernel::tick::RECEIVE_MAX);
}
