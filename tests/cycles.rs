//! The account of every cycle of the robot in a print, in virtual time: sent, doubled, skipped, stalled by the machine. What was done to
//! the line and to the process is known, and has to come out.

mod common;

use common::Random;
use screed::config::Cell;
use screed::model::fim;
use screed::plan::Options as PlanOptions;
use screed::run::account::RobotCycles;
use screed::run::demo::program;
use screed::run::job::Outcome;
use screed::run::session::{Session, Step, Wishes};
use screed::run::virtual_time::{Stalled, World};
use screed::sim::extruder::{Extruder, TIME_CONSTANT};
use screed::sim::ur::{Controller, Options};
use screed_fixtures::{QuarterCircle, quarter_circle};
use screed_kernel::frame::ModeCode;

/// What happens to a print between two cycles.
#[derive(Clone, Copy)]
enum Mishap {
    Stall(Stalled, u32),
    Skip(u32),
    Delay,
}

/// Prints a layer; a mishap of the list, drawn by lot, every hundred cycles or so. Gives the account, what it should be, and the
/// robot's cycles between the same two telegrams by its own count.
fn print(rate_hz: u32, mishaps: &[Mishap]) -> (RobotCycles, [u64; 3], u64) {
    let text = quarter_circle(&QuarterCircle::default());
    let model = fim::parse("demo", text.as_bytes()).unwrap();
    let mut cell = Cell::demo(rate_hz).unwrap();
    cell.realtime.overruns_max = 1000;
    let controller = Controller::new(&cell.robot.arm, Options::of(&cell, program(&cell).unwrap())).unwrap();
    let extruder = Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).unwrap();
    let mut world = World::new(&cell, controller, extruder, None).unwrap();
    let plan = PlanOptions { from_layer: 0, layers: Some(1), dry: false };
    let mut session = Session::new(&cell, &model, Wishes { plan, ..Wishes::default() }, None);
    let mut random = Random::new(u64::from(rate_hz));
    let (mut expected, mut first, mut last, mut next) = ([0; 3], None, 0, 0);
    let [doubled, skipped, stalled] = &mut expected;
    let telegrams = 500 / u64::from(rate_hz);
    loop {
        let cycle = world.controller().last_cycle().cycle;
        if world.core().status().mode == ModeCode::Moving && cycle >= next && !mishaps.is_empty() {
            // The first one long enough after the beginning, and none while another lasts.
            let due = next > 0;
            next = cycle + 100 + random.bits() % 50;
            match mishaps[(random.bits() % mishaps.len() as u64) as usize] {
                _ if !due => {}
                Mishap::Stall(how, periods) => {
                    world.stall(how, periods);
                    *stalled += u64::from(periods);
                }
                Mishap::Skip(cycles) => {
                    world.skip(cycles);
                    *skipped += u64::from(cycles);
                }
                Mishap::Delay => {
                    world.delay_answer();
                    *doubled += 1;
                }
            }
        }
        let step = world.step(&mut session).unwrap();
        let figures = &session.job().account().figures;
        if figures.robot_cycles.is_some() {
            let cycle = world.controller().last_cycle().cycle;
            // That of the first moving cycle is the first that counts.
            first.get_or_insert(cycle - telegrams);
            last = cycle;
        }
        match step {
            Step::Running => {}
            Step::Confirm => session.confirm(),
            Step::Ended(Outcome::Complete) => break,
            other => panic!("{other:?}"),
        }
    }
    (session.job().account().figures.robot_cycles.unwrap(), expected, (last - first.unwrap()) / telegrams)
}

#[test]
fn every_cycle_of_the_robot_is_sent_doubled_skipped_or_stalled_and_the_sum_is_the_time_by_its_stamps() {
    use Mishap::{Delay, Skip, Stall};
    let (reading, answering) = (Stalled::BeforeReading, Stalled::BeforeAnswering);
    let all =
        [Stall(reading, 2), Stall(reading, 20), Stall(answering, 1), Stall(answering, 7), Skip(1), Skip(5), Delay];
    for (mishaps, least) in [(&[][..], 0), (&[Delay], 30), (&[Skip(1), Skip(3)], 30), (&all[..4], 30), (&all, 30)] {
        let (cycles, expected, robots) = print(500, mishaps);
        assert_eq!([cycles.doubled, cycles.skipped, cycles.stalled], expected, "{cycles:?}");
        assert_eq!((cycles.unaccounted(), cycles.by_timestamps), (0, robots), "{cycles:?}");
        assert!(expected.iter().sum::<u64>() >= least && cycles.sent > 4000, "{cycles:?}");
    }
    let (cycles, expected, robots) = print(125, &[]);
    assert_eq!((cycles.by_timestamps, cycles.sent, expected), (robots, robots, [0; 3]), "{cycles:?}");
}
