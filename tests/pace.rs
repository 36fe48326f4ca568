//! The loop's pace in virtual time: stalls, other clocks, hosts that are lost. The robot's received bytes are the judge.

mod common;

use common::{Random, assert_on_path, demo_limits, judge, planned_path};
use screed::config::{Cell, Pacing};
use screed::model::fim::{self, FimModel};
use screed::plan::Options as PlanOptions;
use screed::run::demo::program;
use screed::run::job::{JobError, Outcome};
use screed::run::session::{Session, SessionError, Step, Wishes};
use screed::run::virtual_time::{Stalled, VirtualError, World};
use screed::sim::extruder::{Extruder, TIME_CONSTANT};
use screed::sim::ur::{Controller, Options};
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, FromKernel, ModeCode, Reader, Refusal, Status, ToKernel, WIRE_MAX};

fn model() -> FimModel {
    let text = quarter_circle(&QuarterCircle::default());
    fim::parse("demo", text.as_bytes()).unwrap()
}

fn world(cell: &Cell) -> World {
    let options = Options::of(cell, program(cell).unwrap());
    let controller = Controller::new(&cell.robot.arm, options).unwrap();
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).unwrap();
    World::new(cell, controller, extruder, None).unwrap()
}

fn layers(count: usize) -> Wishes {
    Wishes {
        plan: PlanOptions { from_layer: 0, layers: Some(count), dry: false },
        stop_after: None,
        first_layer_rate: None,
    }
}

/// The distinct setpoints that the robot received: one a package, none lost, in order.
#[derive(Clone, Default)]
struct Judge {
    seq: i32,
    setpoints: Vec<[f64; 6]>,
}

impl Judge {
    fn look(&mut self, world: &World) {
        let cycle = world.controller().last_cycle();
        if cycle.packages > 0 {
            assert_eq!((cycle.packages, cycle.seq), (1, self.seq + 1), "a setpoint was doubled or lost");
            self.seq = cycle.seq;
            self.setpoints.push(cycle.registers);
        }
    }
}

/// Prints; `disturb` is asked before each cycle of the robot.
fn print(
    world: &mut World,
    session: &mut Session<'_>,
    judge: &mut Judge,
    mut disturb: impl FnMut(&mut World, &mut Session<'_>),
) -> Result<(), VirtualError> {
    loop {
        disturb(world, session);
        let step = world.step(session);
        judge.look(world);
        match step? {
            Step::Running => {}
            Step::Confirm => session.confirm(),
            Step::Rearm(_) => panic!("a fresh kernel stands in no fault"),
            Step::Ended(Outcome::Complete) => return Ok(()),
            Step::Ended(Outcome::Stopped) => panic!("nobody asked to stop"),
        }
    }
}

#[test]
fn a_thousand_stalls_of_one_three_and_twenty_periods_are_counted_exactly_and_leave_the_path_as_it_is() {
    let (cell, model, path) = (Cell::demo(500).unwrap(), model(), planned_path(500));
    for stalled in [Stalled::BeforeReading, Stalled::BeforeAnswering] {
        let (mut world, mut session) = (world(&cell), Session::new(&cell, &model, layers(1), None));
        let mut judged = Judge::default();
        let mut random = Random::new(4);
        let (mut injected, mut slots, mut in_motion) = (0, 0, 0);
        let mut wait = 2000_i32;
        print(&mut world, &mut session, &mut judged, |world, session| {
            if world.is_stalled() {
                return;
            }
            wait -= 1;
            if wait > 0 || injected == 1000 {
                return;
            }
            let periods = [1, 3, 20][(random.bits() % 3) as usize];
            world.stall(stalled, periods);
            injected += 1;
            slots += u64::from(periods);
            in_motion += u64::from(session.job().status().is_some_and(|status| status.mode == ModeCode::Moving));
            // Good cycles between: the counter leaks.
            wait = 3 + (random.bits() % 20) as i32;
        })
        .unwrap();
        let figures = &session.job().account().figures;
        assert_eq!((injected, figures.overruns, figures.slots_missed), (1000, 1000, slots), "{stalled:?}");
        assert_eq!(figures.overrun_counter_max, 1, "{stalled:?}");
        assert!(in_motion > 900, "{in_motion} of the stalls in motion");
        // Each missed slot in motion is a setpoint that the robot had once more; none of the path is left out.
        assert!(figures.doubled > slots * 9 / 10 && figures.doubled <= slots, "{} of {slots}", figures.doubled);
        assert_eq!((figures.skipped, figures.unrecorded), (0, 0));
        judge(&judged.setpoints, 0.002, &demo_limits());
        assert_on_path(&judged.setpoints, &path, 0, 1e-6);
    }
}

#[test]
fn overruns_without_good_cycles_between_stop_the_arm_on_its_path_at_the_limit() {
    let (model, path) = (model(), planned_path(500));
    for limit in [1, 10, 60] {
        let mut cell = Cell::demo(500).unwrap();
        cell.realtime.overruns_max = limit;
        let (mut world, mut session) = (world(&cell), Session::new(&cell, &model, layers(1), None));
        let mut judged = Judge::default();
        let result = print(&mut world, &mut session, &mut judged, |world, _| {
            if world.seconds() > 20.0 && !world.is_stalled() && world.core().pace().overruns < u64::from(limit) {
                world.stall(Stalled::BeforeReading, 2);
            }
        });
        let Err(VirtualError::Session(SessionError::Job(JobError::Fault(report)))) = result else {
            panic!("{result:?}")
        };
        assert_eq!(report.fault, Fault::Overrun { missed: 2 * limit, limit });
        let figures = &session.job().account().figures;
        assert_eq!((figures.overruns, figures.slots_missed), (u64::from(limit), 2 * u64::from(limit)));
        assert_eq!(figures.overrun_counter_max, limit);
        let message = JobError::Fault(report).to_string();
        assert!(message.contains("K14") && message.contains("came late again and again"), "{message}");
        judge(&judged.setpoints, 0.002, &demo_limits());
        assert_on_path(&judged.setpoints, &path, 0, 1e-6);
        let cycles_before_rest = judged.setpoints.len();
        for _ in 0..1000 {
            world.step_machines().unwrap();
            judged.look(&world);
        }
        let rest = &judged.setpoints[cycles_before_rest..];
        assert!(rest.iter().all(|q| *q == rest[0]), "it rests until a person has left the fault");
    }
}

#[test]
fn with_the_robots_clock_a_hundred_millionths_off_no_setpoint_is_doubled_or_skipped() {
    let (cell, model) = (Cell::demo(500).unwrap(), model());
    for ppm in [-100, 100] {
        let (mut world, mut session) = (world(&cell), Session::new(&cell, &model, layers(3), None));
        world.set_robot_clock(ppm);
        let mut judged = Judge::default();
        print(&mut world, &mut session, &mut judged, |_, _| {}).unwrap();
        let planned = u64::from(session.plan().unwrap().last_seq());
        let figures = &session.job().account().figures;
        assert!(figures.cycles >= 100_000, "{}", figures.cycles);
        assert_eq!((figures.sent, figures.doubled, figures.skipped, figures.overruns), (planned, 0, 0, 0), "{ppm}");
        assert_eq!((figures.stalls, figures.slots_missed), (0, 0));
        judge(&judged.setpoints, 0.002, &demo_limits());
    }
}

#[test]
fn by_the_timers_clock_the_path_is_played_whatever_the_robots_clock_does() {
    let model = model();
    let path = planned_path(125);
    let mut cell = Cell::demo(125).unwrap();
    cell.realtime.pacing = Pacing::Timer;
    for (ppm, stalls) in [(0, 0), (-100, 0), (100, 0), (100, 300)] {
        let (mut world, mut session) = (world(&cell), Session::new(&cell, &model, layers(1), None));
        world.set_robot_clock(ppm);
        let mut judged = Judge::default();
        let mut random = Random::new(5);
        let (mut injected, mut wait) = (0, 1000);
        print(&mut world, &mut session, &mut judged, |world, _| {
            wait -= i32::from(!world.is_stalled());
            if wait <= 0 && injected < stalls {
                // Two telegrams and more go by: at least one point of the grid does.
                world.stall(Stalled::BeforeReading, 2 + (random.bits() % 7) as u32);
                injected += 1;
                wait = 12 + (random.bits() % 50) as i32;
            }
        })
        .unwrap();
        let planned = u64::from(session.plan().unwrap().last_seq());
        let figures = &session.job().account().figures;
        assert_eq!((figures.sent, figures.skipped, figures.overruns), (planned, 0, stalls), "{ppm}");
        assert!((figures.slots_missed == 0) == (stalls == 0), "{}", figures.slots_missed);
        judge(&judged.setpoints, 0.008, &demo_limits());
        assert_on_path(&judged.setpoints, &path, 0, 3e-6);
    }
}

/// What a host says in each cycle of a whole print.
fn script(cell: &Cell, model: &FimModel) -> Vec<Vec<u8>> {
    let (mut world, mut session) = (world(cell), Session::new(cell, model, layers(1), None));
    let mut said = Vec::new();
    loop {
        world.step_machines().unwrap();
        session.handle_bytes(&world.to_host()).unwrap();
        match session.step(world.seconds()).unwrap() {
            Step::Confirm => session.confirm(),
            Step::Ended(_) => return said,
            _ => {}
        }
        let out = session.poll_transmit().unwrap();
        let taken = world.from_host(out);
        said.push(out.drain(..taken).collect());
    }
}

/// What the kernel answered.
fn answers(bytes: &[u8]) -> (Option<Status>, Vec<Refusal>) {
    let (mut reader, mut status, mut refusals) = (Reader::new(), None, Vec::new());
    for frame in bytes.iter().filter_map(|&byte| reader.push(byte).map(|frame| frame.map(<[u8]>::to_vec))) {
        match frame::decode::<FromKernel>(&frame.unwrap()).unwrap() {
            FromKernel::Status(told) => status = Some(told),
            FromKernel::Refused { reason, .. } => refusals.push(reason),
            _ => {}
        }
    }
    (status, refusals)
}

fn say(world: &mut World, message: &ToKernel) {
    // A zero first: what was said last may have broken off in a frame.
    let mut bytes = [0; WIRE_MAX + 1];
    let used = 1 + frame::encode(message, &mut bytes[1..]).unwrap();
    assert_eq!(world.from_host(&bytes[..used]), used);
}

/// How many batches of these bytes replace what follows a setpoint that the arm has already left behind.
fn too_late(bytes: &[u8], consumed: u32) -> usize {
    let mut reader = Reader::new();
    let is_late = |frame: &[u8]| match frame::decode::<ToKernel>(frame) {
        Ok(ToKernel::Batch(part)) => part.opens && part.after.is_some_and(|after| after < consumed),
        _ => false,
    };
    bytes.iter().filter(|byte| matches!(reader.push(**byte), Some(Ok(frame)) if is_late(frame))).count()
}

/// After the host is lost: what it had said late comes in after `late` cycles, if at all. Judges all that the robot receives,
/// sees that every batch that came too late was refused, and gives how many those were.
fn lose_host(mut world: World, mut judged: Judge, late: Option<(usize, Vec<u8>)>, path: &[[f64; 3]]) -> usize {
    let before = judged.setpoints.len().saturating_sub(4);
    let epoch = world.core().status().epoch;
    let (mut heard, mut behind) = (Vec::new(), late.unwrap_or_default());
    let (mut cycle, mut still, mut behind_the_arm) = (0, 0, 0);
    while still < 100 || cycle <= behind.0 || !behind.1.is_empty() {
        world.step_machines().unwrap();
        judged.look(&world);
        heard.extend(world.to_host());
        if cycle == behind.0 {
            behind_the_arm = too_late(&behind.1, world.core().status().consumed);
        }
        if cycle >= behind.0 {
            let taken = world.from_host(&behind.1);
            behind.1.drain(..taken);
        }
        let rests = world.core().status().mode == ModeCode::Holding;
        still = if rests { still + 1 } else { 0 };
        cycle += 1;
        assert!(cycle < 30_000, "it does not come to rest");
    }
    // Resumed by what was said before, it stands; by a person who knows where it is, nothing is left to play.
    for cycle in 0..120 {
        if cycle == 20 {
            say(&mut world, &ToKernel::Resume { epoch });
        }
        world.step_machines().unwrap();
        judged.look(&world);
        heard.extend(world.to_host());
    }
    let (status, refusals) = answers(&heard);
    let status = status.unwrap();
    assert_eq!((status.mode, status.fault), (ModeCode::Holding, None));
    // The last is the resume's.
    assert!(matches!(refusals.last(), Some(Refusal::Stale | Refusal::Mode)), "{refusals:?}");
    assert!(refusals.len() > behind_the_arm, "{behind_the_arm} batches came too late: {refusals:?}");
    let setpoints = &judged.setpoints[before..];
    let rest = &setpoints[setpoints.len() - 20..];
    assert!(rest.iter().all(|q| *q == rest[0]), "it rests");
    let last = world.controller().last_cycle();
    assert!(
        last.actual_q.0.iter().zip(&last.registers).all(|(a, b)| (a - b).abs() < 1e-3),
        "the arm came to rest there"
    );
    judge(setpoints, 0.008, &demo_limits());
    // Where on the path it was: what was received before, less the wait for the plan.
    let moved = judged.setpoints.iter().position(|q| *q != judged.setpoints[0]).unwrap_or(before);
    assert_on_path(setpoints, path, before.saturating_sub(moved + 10), 3e-6);
    behind_the_arm
}

#[test]
fn hosts_killed_or_stopped_at_a_thousand_instants_leave_the_arm_at_rest_on_its_path() {
    let (cell, model, path) = (Cell::demo(125).unwrap(), model(), planned_path(125));
    let said = script(&cell, &model);
    let mut random = Random::new(6);
    let mut instants: Vec<usize> =
        (0..1000).map(|_| 100 + (random.bits() % (said.len() as u64 - 200)) as usize).collect();
    instants.sort_unstable();
    let mut world = world(&cell);
    let mut judged = Judge::default();
    let mut next = instants.iter().enumerate().peekable();
    let mut late_hosts = 0;
    for (cycle, bytes) in said.iter().enumerate() {
        world.step_machines().unwrap();
        judged.look(&world);
        drop(world.to_host());
        while let Some((number, _)) = next.next_if(|(_, instant)| **instant == cycle) {
            // Every second one goes on after up to ten seconds, with all that it would have said meanwhile.
            let late = (number % 2 == 1).then(|| {
                let silent = 100 + (random.bits() % 5000) as usize;
                let until = (cycle + silent).min(said.len());
                (silent, said[cycle..until].concat())
            });
            late_hosts += usize::from(lose_host(world.clone(), judged.clone(), late, &path) > 0);
        }
        assert_eq!(world.from_host(bytes), bytes.len());
    }
    assert!(next.next().is_none());
    // The seed's, of 500 that went on.
    assert_eq!(late_hosts, 250, "hosts whose batches came too late");
}
