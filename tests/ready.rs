//! What keeps the robot from taking setpoints is told with cause and action, and a setpoint that it could not follow is not sent: in
//! virtual time, with the simulated controller. States that it cannot be brought to are in `host/src/link/rtde/ready.rs`.

mod common;

use screed::config::Cell;
use screed::model::fim::{self, FimModel};
use screed::plan::Options as PlanOptions;
use screed::run::demo::program;
use screed::run::job::JobError;
use screed::run::session::{Session, SessionError, Step, Wishes};
use screed::run::virtual_time::{VirtualError, World};
use screed::sim::extruder::{Extruder, TIME_CONSTANT};
use screed::sim::ur::{Controller, Options};
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::arm::Rating;
use screed_kernel::fault::Fault;
use screed_kernel::frame::ModeCode;
use screed_kernel::guard::Quantity;
use screed_kernel::units::JointVel;

fn model() -> FimModel {
    fim::parse("demo", quarter_circle(&QuarterCircle::default()).as_bytes()).unwrap()
}

fn world(cell: &Cell, robot: &Cell) -> World {
    let controller = Controller::new(&robot.robot.arm, Options::of(robot, program(robot).unwrap())).unwrap();
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).unwrap();
    World::new(cell, controller, extruder, None).unwrap()
}

fn session<'a>(cell: &'a Cell, model: &'a FimModel) -> Session<'a> {
    let plan = PlanOptions { from_layer: 0, layers: Some(1), dry: false };
    Session::new(cell, model, Wishes { plan, ..Wishes::default() }, None)
}

/// Plays on until a cycle, or the failure before it; gives the alarms too.
fn play(world: &mut World, session: &mut Session<'_>, until: u64) -> (Option<VirtualError>, Vec<String>) {
    let mut alarms = Vec::new();
    while world.controller().last_cycle().cycle < until {
        let step = world.step(session);
        alarms.extend(session.job().take_alarms());
        match step {
            Ok(Step::Confirm) => session.confirm(),
            Ok(_) => {}
            Err(error) => return (Some(error), alarms),
        }
    }
    (None, alarms)
}

#[test]
fn the_first_setpoint_on_the_wire_is_where_the_joints_are_at_both_rates_and_offsets() {
    let model = model();
    for rate_hz in [125, 500] {
        for offset in [0, 24] {
            let mut cell = Cell::demo(rate_hz).unwrap();
            cell.link.register_offset = offset;
            // Nowhere that anything could have by default.
            cell.robot.start.0 = cell.robot.start.0.map(|q| q + 0.0123);
            let (mut world, mut session) = (world(&cell, &cell), session(&cell, &model));
            while world.controller().last_cycle().packages == 0 {
                // It is asked for confirmation by then, and gets none.
                world.step(&mut session).unwrap();
            }
            let cycle = world.controller().last_cycle();
            assert_eq!((cycle.seq, cycle.registers, cycle.actual_q), (1, cell.robot.start.0, cell.robot.start));
        }
    }
}

#[test]
fn what_stops_the_robot_in_a_print_is_told_at_once_and_then_the_fault() {
    type Disturb = fn(&mut Controller);
    let found: [(Disturb, &str, &str); 4] = [
        (
            |robot| robot.press_emergency_stop(),
            "the robot's emergency stop is pressed",
            "screed robot power-on and screed robot brake-release",
        ),
        (|robot| robot.power_off(), "the robot has no power", "screed robot power-on, then screed robot brake-release"),
        (|robot| robot.stop(), "no program is playing on the robot", "screed robot play --upload"),
        (
            |robot| robot.pause().unwrap(),
            "setpoints did come: a popup waits on the teach pendant",
            "screed robot stop, screed robot close-popup, then print with --upload and --from-layer",
        ),
    ];
    let (cell, model) = (Cell::demo(500).unwrap(), model());
    for (disturb, cause, action) in found {
        let (mut world, mut session) = (world(&cell, &cell), session(&cell, &model));
        let (failed, _) = play(&mut world, &mut session, 2000);
        assert!(failed.is_none() && world.core().status().mode == ModeCode::Moving);
        disturb(world.pendant());
        let (failed, alarms) = play(&mut world, &mut session, 2010);
        assert!(failed.is_none(), "it comes to rest first");
        assert!(alarms.iter().any(|text| text.contains(cause) && text.contains(action)), "{alarms:?}");
        assert!(alarms.iter().any(|text| text.starts_with("K3")), "{alarms:?}");
        let (failed, _) = play(&mut world, &mut session, 3000);
        let fault = |error: &VirtualError| match error {
            VirtualError::Session(SessionError::Job(JobError::Fault(report))) => Some(report.fault),
            _ => None,
        };
        assert_eq!(failed.as_ref().and_then(fault), Some(Fault::RobotNotReady), "{failed:?}");
    }
}

#[test]
fn a_robot_that_is_not_ready_at_the_start_is_asked_after_three_seconds() {
    type Disturb = fn(&mut Controller);
    let found: [(Disturb, &str); 3] = [
        (|robot| robot.press_emergency_stop(), "emergency stop is pressed"),
        (|robot| robot.power_off(), "the robot has no power"),
        (|robot| robot.stop(), "no program is playing on the robot"),
    ];
    let (cell, model) = (Cell::demo(500).unwrap(), model());
    for (disturb, cause) in found {
        let (mut world, mut session) = (world(&cell, &cell), session(&cell, &model));
        disturb(world.pendant());
        let (failed, alarms) = play(&mut world, &mut session, 1480);
        // What the controller says by itself is told at once.
        let quiet = alarms.iter().all(|text| text.starts_with("the controller says"));
        assert!(failed.is_none() && quiet, "{failed:?} {alarms:?}");
        let (failed, _) = play(&mut world, &mut session, 1600);
        let text = failed.expect("nothing would ever move").to_string();
        assert!(text.contains(cause) && text.contains(':'), "{text}");
    }
}

#[test]
fn a_step_that_the_arm_cannot_make_is_refused_before_the_wire_and_a_fault_after_which_nothing_is_sent() {
    let (planned, model) = (Cell::demo(500).unwrap(), model());
    // The link is told of an arm without a data sheet, whose cell gives less than what is planned; so is nobody else.
    let mut slow = planned.clone();
    slow.robot.arm.velocity_max = Rating::Unknown;
    slow.robot.joint_velocity_max = JointVel([0.05; 6]);
    let (mut world, mut session) = (world(&slow, &planned), session(&planned, &model));
    let (mut before, mut fastest) = (None, 0.0_f64);
    let failed = loop {
        let step = world.step(&mut session);
        let cycle = world.controller().last_cycle();
        if cycle.packages > 0 {
            let step = before
                .replace(cycle.registers)
                .map(|before: [f64; 6]| (0..6).map(|j| (cycle.registers[j] - before[j]).abs()).fold(0.0, f64::max));
            fastest = fastest.max(step.unwrap_or(0.0) * 500.0);
        }
        match step {
            Ok(Step::Confirm) => session.confirm(),
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    let VirtualError::Session(SessionError::Job(JobError::Fault(report))) = &failed else { panic!("{failed:?}") };
    assert!(
        matches!(report.fault, Fault::Output { quantity: Quantity::Velocity, value, limit, .. }
            if value.abs() > limit && (limit - 0.0525).abs() < 1e-5),
        "{report:?}"
    );
    assert!(session.job().take_alarms().iter().any(|text| text.contains("it was not sent")));
    assert!(fastest > 0.045 && fastest <= 0.0525 + 1e-6, "{fastest} rad/s were sent");
    // The link is up, and the robot stops by its own watchdog: nothing is sent any more.
    let mut packages = 0;
    for _ in 0..1000 {
        world.step_machines().unwrap();
        packages += world.controller().last_cycle().packages;
    }
    assert!(!world.core().is_disconnected());
    assert_eq!((packages, world.controller().runtime_state().code()), (0, 1));
    assert_eq!(world.core().status().mode, ModeCode::Faulted);
}
