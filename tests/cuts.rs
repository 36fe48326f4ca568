//! The link to the robot is cut at a hundred seeded instants of a print, in four ways, in virtual time, where everything is exact.
//! The robot's own record is the judge; a robot whose watchdog does nothing is found out.

mod common;

use common::{Random, program_with};
use screed::config::Cell;
use screed::link::rtde::program::WatchdogAction;
use screed::link::rtde::wire::Protocol;
use screed::model::fim::{self, FimModel};
use screed::plan::Options as PlanOptions;
use screed::run::demo::program;
use screed::run::job::{JobError, Outcome};
use screed::run::memory::Counting;
use screed::run::session::{Session, SessionError, Step, Wishes};
use screed::run::virtual_time::{Cut, VirtualError, World};
use screed::sim::extruder::{Extruder, TIME_CONSTANT};
use screed::sim::ur::robot::Generation;
use screed::sim::ur::{Controller, Options, RuntimeState};
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, FaultReport, FromKernel, ModeCode, Reader, Refusal, ToKernel, WIRE_MAX};
use screed_kernel::units::JointPos;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const CUTS: [Cut; 4] = [Cut::Reset, Cut::Silence, Cut::HalfPackage, Cut::ControllerGone];
const INSTANTS: usize = 100;
/// The robot's cycles a second, and nanoseconds of one.
const RATE: u32 = 500;
const CYCLE_NS: u64 = 2_000_000;

fn model() -> FimModel {
    let text = quarter_circle(&QuarterCircle::default());
    fim::parse("demo", text.as_bytes()).unwrap()
}

/// As delivered: watchdog and time-out of 100 ms, not the demo's.
fn cell() -> Cell {
    let mut cell = Cell::demo(RATE).unwrap();
    (cell.link.timeout, cell.link.watchdog) = (0.1, 0.1);
    cell
}

fn world(cell: &Cell, program: String) -> World {
    let controller = Controller::new(&cell.robot.arm, Options::of(cell, program)).unwrap();
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).unwrap();
    World::new(cell, controller, extruder, None).unwrap()
}

fn session<'a>(cell: &'a Cell, model: &'a FimModel) -> Session<'a> {
    let plan = PlanOptions { from_layer: 0, layers: Some(1), dry: false };
    Session::new(cell, model, Wishes { plan, ..Wishes::default() }, None)
}

/// A host that only listens and says single messages; what it hears is kept with the time.
#[derive(Default)]
struct Host {
    reader: Reader,
    heard: Vec<(u64, FromKernel)>,
}

impl Host {
    fn listen(&mut self, world: &mut World) {
        let now = world.now().0;
        for byte in world.to_host() {
            if let Some(frame) = self.reader.push(byte) {
                self.heard.push((now, frame::decode(frame.unwrap()).unwrap()));
            }
        }
    }

    fn say(&mut self, world: &mut World, message: &ToKernel) {
        // The zero ends what the host of before left half said.
        let mut bytes = [0; 1 + WIRE_MAX];
        let used = 1 + frame::encode(message, &mut bytes[1..]).unwrap();
        assert_eq!(world.from_host(&bytes[..used]), used);
    }

    fn fault(&self) -> Option<(u64, FaultReport)> {
        self.heard.iter().find_map(|(at, message)| match message {
            FromKernel::Fault(report) => Some((*at, *report)),
            _ => None,
        })
    }

    fn alarms(&self) -> impl Iterator<Item = (u64, &str)> {
        self.heard.iter().filter_map(|(at, message)| match message {
            FromKernel::Alarm { note, .. } => Some((*at, note.as_str())),
            _ => None,
        })
    }
}

/// What the robot did in a cycle.
#[derive(Clone, Copy)]
struct Row {
    packages: u32,
    q: JointPos<6>,
    playing: bool,
}

/// Cuts the line of a world in the midst of a print, and sees what follows for so many cycles; reports of the link are no errors.
fn cut(world: &mut World, host: &mut Host, kind: Cut, cycles: u32) -> Vec<Row> {
    world.cut(kind);
    (0..cycles).map(|_| step(world, host)).collect()
}

fn step(world: &mut World, host: &mut Host) -> Row {
    let _ = world.step_machines();
    host.listen(world);
    let cycle = world.controller().last_cycle();
    let playing = cycle.runtime_state == RuntimeState::Playing;
    Row { packages: cycle.packages, q: cycle.actual_q, playing }
}

/// The speed of each joint in each cycle (rad a cycle), from the second row on.
fn speeds(rows: &[Row]) -> Vec<[f64; 6]> {
    rows.windows(2).map(|w| std::array::from_fn(|j| (w[1].q.0[j] - w[0].q.0[j]).abs())).collect()
}

/// Judges what the robot did after the last package that reached it: within the watchdog and one cycle its program has ended, from
/// there on no joint gets faster, and it stands within the time that braking takes (15 rad/s² from 180 °/s: 0.21 s).
fn judge_stop(rows: &[Row], watchdog_s: f64) -> Result<usize, String> {
    let last = rows.iter().rposition(|row| row.packages > 0).map_or(0, |last| last + 1);
    let limit = (watchdog_s * f64::from(RATE)).round() as usize + 1;
    let end = rows.iter().position(|row| !row.playing).ok_or("its program goes on")?;
    if end >= last + limit {
        return Err(format!("its program ended {} cycles after the last package", end + 1 - last));
    }
    let speeds = speeds(&rows[end.saturating_sub(1)..]);
    if let Some(k) = speeds.windows(2).position(|w| (0..6).any(|j| w[1][j] > w[0][j] + 1e-12)) {
        return Err(format!("{k} cycles after its end a joint became faster"));
    }
    let rest = speeds.iter().position(|speed| *speed == [0.0; 6]).ok_or("it never stands")?;
    if rest > 105 { Err(format!("it took {rest} cycles to stand")) } else { Ok(end + 1 - last) }
}

/// The print, and its worlds at the instants, as they were before the cut.
fn printed(cell: &Cell, program: String, instants: &mut [u64]) -> Vec<World> {
    let model = model();
    instants.sort_unstable();
    let (mut world, mut session) = (world(cell, program), session(cell, &model));
    let mut worlds = Vec::new();
    let mut cycle = 0;
    while worlds.len() < instants.len() {
        if instants[worlds.len()] == cycle {
            worlds.push(world.clone());
            continue;
        }
        cycle += 1;
        if world.step(&mut session).unwrap() == Step::Confirm {
            session.confirm();
        }
    }
    worlds
}

/// Seeded instants of the first layer: 1 to 12 s after the start, the approach and the layer.
fn instants(count: usize) -> Vec<u64> {
    let mut random = Random::new(7);
    (0..count).map(|_| random.between(1.0, 12.0) * f64::from(RATE)).map(|cycle| cycle as u64).collect()
}

/// The robot is made ready by a person, as after a stop: its program is started again at the teach pendant.
fn play_again(world: &mut World, cell: &Cell, kind: Cut) {
    if kind == Cut::ControllerGone {
        let mut options = Options::of(cell, program(cell).unwrap());
        options.start_q = world.controller().last_cycle().actual_q;
        world.restart_controller(Controller::new(&cell.robot.arm, options).unwrap());
    } else {
        world.pendant().play().unwrap();
    }
}

#[test]
fn a_hundred_cuts_of_each_kind_stop_the_robot_are_told_in_time_and_nothing_moves_until_a_person_has_re_armed() {
    let cell = cell();
    let worlds = printed(&cell, program(&cell).unwrap(), &mut instants(INSTANTS));
    let mut moving = 0;
    for (number, before) in worlds.iter().enumerate() {
        for kind in CUTS {
            let what = format!("{kind:?} at instant {number}, {:.3} s", before.seconds());
            let (mut world, mut host) = (before.clone(), Host::default());
            // Frames of before belong to the host of before.
            world.to_host();
            let began = world.now().0;
            let rows = cut(&mut world, &mut host, kind, 400);
            moving += u32::from(speeds(&rows)[0] != [0.0; 6]);
            judge_stop(&rows, cell.link.watchdog).unwrap_or_else(|wrong| panic!("{what}: {wrong}"));

            // Told once: at once, or when the time-out is over, to the cycle. The last state had come a cycle before the cut.
            let (told, report) = host.fault().unwrap_or_else(|| panic!("{what}: no fault"));
            assert_eq!(report.fault, Fault::Link, "{what}");
            let (alarm_at, alarm) = host.alarms().next().unwrap();
            let (due, words) = match kind {
                Cut::Reset | Cut::ControllerGone => (began + CYCLE_NS, "closed the connection"),
                Cut::Silence => (began + 100_000_000, "nothing from the robot for 100 ms"),
                Cut::HalfPackage => (began + 100_000_000, "the rest not within 100 ms"),
            };
            assert_eq!((told, alarm_at), (due, due), "{what}: {alarm}");
            assert!(alarm.contains(words), "{what}: {alarm}");
            assert_eq!(host.alarms().count(), 1, "{what}");
            hold_until_re_armed(&mut world, &mut host, &cell, kind, &what);
        }
    }
    assert!(moving as usize > 3 * INSTANTS, "{moving} cuts of a robot in motion");
}

#[test]
fn a_link_that_fails_and_comes_back_takes_nothing_from_memory() {
    let cell = cell();
    let mut worlds = printed(&cell, program(&cell).unwrap(), &mut [2500]);
    let world = &mut worlds[0];
    world.count_memory();
    for kind in CUTS {
        world.cut(kind);
        for _ in 0..200 {
            let _ = world.step_machines();
            world.to_host();
        }
        play_again(world, &cell, kind);
        world.reconnect();
        world.drop_old_connections();
        for _ in 0..100 {
            world.step_machines().unwrap();
            world.to_host();
        }
        assert!(!world.core().is_disconnected());
    }
    assert_eq!(world.memory().unwrap().allocations, 0);
    world.take_memory();
    assert_eq!(world.memory().unwrap().allocations, 1, "the count counts");
}

/// The link comes back; the robot is made ready; a person re-arms. Nothing moves, not even for a `Resume`.
fn hold_until_re_armed(world: &mut World, host: &mut Host, cell: &Cell, kind: Cut, what: &str) {
    let rest = world.controller().last_cycle().actual_q;
    play_again(world, cell, kind);
    let packages = |rows: &[Row]| rows.iter().map(|row| row.packages).sum::<u32>();
    let still = |rows: &[Row], what: &str| assert!(rows.iter().all(|row| row.q == rest), "{what}: it moved");
    let run =
        |world: &mut World, host: &mut Host, cycles: u32| (0..cycles).map(|_| step(world, host)).collect::<Vec<_>>();

    world.reconnect();
    let rows = run(world, host, 50);
    if matches!(kind, Cut::Silence | Cut::HalfPackage) {
        // The robot still holds the connection that failed, and with it the registers.
        assert!(world.core().is_disconnected(), "{what}");
        let (_, last) = host.alarms().last().unwrap();
        assert!(last.contains("in use") && last.contains("still holds"), "{what}: {last}");
        world.drop_old_connections();
        world.reconnect();
    }
    still(&rows, what);
    let rows = run(world, host, 200);
    assert!(!world.core().is_disconnected(), "{what}");
    assert!(host.alarms().last().unwrap().1.contains("the link to the robot is back after"), "{what}");
    assert_eq!(packages(&rows), 0, "{what}: something was sent before a person had re-armed");
    still(&rows, what);

    // Whoever resumes without re-arming is refused, and a `Resume` of before the cut too.
    let status = world.core().status();
    let (_, report) = host.fault().unwrap();
    assert_eq!((status.mode, status.fault, status.end_seq == status.consumed), (ModeCode::Faulted, Some(report), true));
    host.say(world, &ToKernel::Resume { epoch: status.epoch });
    let rows = run(world, host, 20);
    let refused = |host: &Host, reason| {
        matches!(host.heard.iter().rev().find_map(|(_, message)| match message {
        FromKernel::Refused { reason, .. } => Some(*reason),
        _ => None,
    }), Some(found) if found == reason)
    };
    assert!(refused(host, Refusal::Mode) && packages(&rows) == 0, "{what}");

    // Re-armed it holds where it is: the first setpoint, and every one, is where the joints are.
    host.say(world, &ToKernel::Rearm { fault: report.number });
    let rows = run(world, host, 200);
    assert!(packages(&rows) > 190, "{what}: {}", packages(&rows));
    assert_eq!(world.core().status().mode, ModeCode::Holding, "{what}");
    assert_eq!(world.controller().last_cycle().registers, rest.0, "{what}");
    still(&rows, what);
    host.say(world, &ToKernel::Resume { epoch: world.core().status().epoch });
    still(&run(world, host, 100), what);
    assert!(refused(host, Refusal::Mode), "{what}: there is no ring to resume");
}

#[test]
fn another_controller_where_the_robot_was_is_told_once_and_tried_again_and_nothing_moves() {
    let cell = cell();
    let mut worlds = printed(&cell, program(&cell).unwrap(), &mut [2500]);
    let (world, mut host) = (&mut worlds[0], Host::default());
    world.to_host();
    cut(world, &mut host, Cut::ControllerGone, 400);
    let rest = world.controller().last_cycle().actual_q;
    let controller = |generation| {
        let options = Options { start_q: rest, generation, ..Options::of(&cell, program(&cell).unwrap()) };
        Controller::new(&cell.robot.arm, options).unwrap()
    };
    let mut updated = controller(Generation::ESeries);
    updated.limit_protocol(Protocol::One);
    let others = [
        (controller(Generation::Cb3), "(software 3.15.8.1) serves at most 125 Hz"),
        (updated, "its protocol 1 cannot be asked for a rate"),
    ];
    for (other, why) in others {
        world.restart_controller(other);
        let before = host.alarms().count();
        for attempt in 0..3 {
            world.reconnect();
            if attempt > 0 {
                world.drop_old_connections();
            }
            let rows: Vec<_> = (0..150).map(|_| step(world, &mut host)).collect();
            assert!(
                world.core().is_disconnected() && rows.iter().all(|row| row.packages == 0 && row.q == rest),
                "{why}"
            );
        }
        let told: Vec<_> = host.alarms().skip(before).map(|(_, text)| text).collect();
        let [told] = told[..] else { panic!("{told:?}") };
        assert!(told.starts_with("not the robot that was there") && told.contains("another controller"), "{told}");
        assert!(told.contains("nothing moves") && told.contains("tried again") && told.contains(why), "{told}");
    }
    // The right one is back.
    world.restart_controller(controller(Generation::ESeries));
    world.reconnect();
    let rows: Vec<_> = (0..150).map(|_| step(world, &mut host)).collect();
    assert!(!world.core().is_disconnected() && rows.iter().all(|row| row.packages == 0 && row.q == rest));
    assert_eq!(world.core().status().mode, ModeCode::Faulted);
}

#[test]
fn a_robot_whose_watchdog_does_nothing_or_comes_late_is_found_out() {
    let cell = cell();
    let ignoring = program_with(&cell, WatchdogAction::Ignore, cell.link.watchdog);
    let late = program_with(&cell, WatchdogAction::Stop, cell.link.watchdog + 0.004);
    let pausing = program_with(&cell, WatchdogAction::Pause, cell.link.watchdog);
    for (program, found) in
        [(ignoring, Some("goes on")), (late, Some("cycles after the last package")), (pausing, None)]
    {
        for world in &mut printed(&cell, program.clone(), &mut instants(5)) {
            let rows = cut(world, &mut Host::default(), Cut::Silence, 400);
            match (judge_stop(&rows, cell.link.watchdog), found) {
                (Err(wrong), Some(found)) => assert!(wrong.contains(found), "{wrong}"),
                (Ok(_), None) => {}
                other => panic!("{other:?}"),
            }
        }
    }
}

#[test]
fn after_a_cut_a_new_host_re_arms_and_prints_again_and_a_second_cut_is_as_the_first() {
    let (cell, model) = (cell(), model());
    let mut worlds = printed(&cell, program(&cell).unwrap(), &mut [2500]);
    let world = &mut worlds[0];
    for kind in [Cut::Reset, Cut::ControllerGone] {
        cut(world, &mut Host::default(), kind, 400);
        play_again(world, &cell, kind);
        world.reconnect();
        // It attaches, is shown the fault, and a person leaves it.
        let mut session = session(&cell, &model);
        let mut asked = 0;
        for _ in 0..2500 {
            match world.step(&mut session).unwrap() {
                Step::Rearm(report) => {
                    assert_eq!(report.fault, Fault::Link);
                    asked += 1;
                    session.job().rearm();
                }
                Step::Confirm => session.confirm(),
                Step::Running => {}
                Step::Ended(Outcome::Complete | Outcome::Stopped) => panic!("too early"),
            }
        }
        assert!(asked == 1 && world.core().status().mode == ModeCode::Moving, "{asked}");
        // The host of a print that is cut ends with the cause.
        world.cut(kind);
        let _ = world.step_machines();
        let error = session.handle_bytes(&world.to_host()).unwrap_err();
        assert!(
            matches!(&error, SessionError::Job(JobError::Link(why)) if why.contains("closed the connection")),
            "{error:?}"
        );
    }
}

#[test]
fn a_host_that_waits_for_a_robot_whose_link_is_down_is_told_and_ends() {
    let (cell, model) = (cell(), model());
    let mut worlds = printed(&cell, program(&cell).unwrap(), &mut [2500]);
    let (world, mut host) = (&mut worlds[0], Host::default());
    world.to_host();
    cut(world, &mut host, Cut::Silence, 100);
    let (_, report) = host.fault().unwrap();
    // A person re-arms before the link is back; then a print begins.
    host.say(world, &ToKernel::Rearm { fault: report.number });
    for _ in 0..20 {
        step(world, &mut host);
    }
    assert_eq!(world.core().status().mode, ModeCode::Unready);
    let (mut session, began) = (session(&cell, &model), world.seconds());
    let error = loop {
        match world.step(&mut session) {
            Ok(Step::Running) => assert!(world.seconds() < began + 5.0, "it waits for ever"),
            Ok(other) => panic!("{other:?}"),
            Err(error) => break error,
        }
    };
    let VirtualError::Session(SessionError::Job(JobError::Link(why))) = error else { panic!("{error:?}") };
    assert!(why.contains("the link to the robot is down: nothing from the robot for 100 ms"), "{why}");
}

#[test]
fn a_link_that_never_ran_is_not_made_anew() {
    let cell = cell();
    let mut world = world(&cell, program(&cell).unwrap());
    world.cut(Cut::Silence);
    let error = (0..510).find_map(|_| world.step_machines().err()).unwrap();
    assert!(error.to_string().contains("nothing from the robot for 1000 ms while agreeing on the protocol"), "{error}");
    assert!(!world.core().may_reconnect());
    let mut host = Host::default();
    host.listen(&mut world);
    assert!(host.heard.iter().any(|(_, message)| matches!(message, FromKernel::Alarm { fatal: true, .. })));
    let _: VirtualError = error.into();
}
