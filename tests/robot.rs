//! The robot's controller from the host's side, over true sockets: looked at, powered, given its program; servers that are none.

mod common;

use common::robot::{Sender, bad, refused, serve};
use screed::config::Cell;
use screed::failure::{Exit, Failure};
use screed::link::dashboard::{ProgramState, RobotMode, Safety};
use screed::link::rtde::program::ProgramState as ProgramPhase;
use screed::run::controller::acts::{Act, act};
use screed::run::controller::check;
use screed::run::controller::{DashboardLine, Place, program, view};
use screed::run::demo;
use screed::sim::ur::robot::Generation;
use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::thread;
use std::time::Duration;

#[test]
fn a_robot_of_either_generation_is_powered_given_its_program_and_found_ready() {
    for (generation, rate, offset) in
        [(Generation::ESeries, 500, 0), (Generation::ESeries, 125, 24), (Generation::Cb3, 125, 24)]
    {
        let mut cell = Cell::demo(rate).unwrap();
        cell.link.register_offset = offset;
        if generation == Generation::Cb3 {
            (cell.robot.model, cell.robot.arm) = ("ur10".to_owned(), screed_kernel::arms::ur::UR10);
        }
        let place = serve(&cell, |options| options.generation = generation);
        let text = demo::program(&cell).unwrap();
        assert_eq!(bad(&cell, &place), ["robot", "program"]);
        let mut line = DashboardLine::connect(&place).unwrap();
        refused(act(&mut line, Act::Play), Exit::Link, &["Failed to execute: play", "POWER_OFF", "power-on"]);
        refused(program::upload(&place, offset, &text), Exit::Link, &["not ready", "has no power"]);
        assert_eq!(act(&mut line, Act::PowerOn).unwrap().mode, RobotMode::Idle);
        assert_eq!(act(&mut line, Act::BrakeRelease).unwrap().mode, RobotMode::Running);
        assert_eq!(bad(&cell, &place), ["program"]);
        program::upload(&place, offset, &text).unwrap();
        assert_eq!(bad(&cell, &place), [""; 0]);
        // A program that runs is not replaced.
        refused(program::upload(&place, offset, &text), Exit::Link, &["a program runs", "screed robot stop"]);
        assert_eq!(act(&mut line, Act::Stop).unwrap().program, ProgramState::Stopped);
        // The installed one is Screed's too.
        assert_eq!(act(&mut line, Act::Play).unwrap().program, ProgramState::Playing);
        assert_eq!(bad(&cell, &place), [""; 0]);
        assert_eq!(act(&mut line, Act::PowerOff).unwrap().mode, RobotMode::PowerOff);
    }
}

#[test]
fn only_screeds_own_program_passes_for_it_and_how_far_it_is_is_told() {
    let mut cell = Cell::demo(125).unwrap();
    cell.link.watchdog = 2.0;
    let place = serve(&cell, |options| (options.powered, options.autoplay) = (true, true));
    let program = || {
        let view = view::view(&place, 0).unwrap();
        check::playing(&view)
    };
    thread::sleep(Duration::from_millis(200));
    assert_eq!(program(), Some(ProgramPhase::Waiting));
    let sender = Sender::new(&place, cell.robot.start.0);
    thread::sleep(Duration::from_millis(200));
    assert_eq!(program(), Some(ProgramPhase::Following));
    drop(sender);
    let mut line = DashboardLine::connect(&place).unwrap();
    act(&mut line, Act::Stop).unwrap();
    assert_eq!(program(), None);
    // The register still says that Screed's follows, while another program plays.
    let mut primary = TcpStream::connect((place.host.as_str(), place.primary)).unwrap();
    primary.write_all(b"def other():\n  while True:\n    sync()\n  end\nend\n").unwrap();
    thread::sleep(Duration::from_millis(300));
    let view = view::view(&place, 0).unwrap();
    assert_eq!((view.state.runtime_state, view.state.program_state), (2, 2));
    assert_eq!((check::playing(&view), bad(&cell, &place)), (None, vec!["program"]));
}

#[test]
fn a_program_that_the_controller_does_not_take_is_told_as_such() {
    let cell = Cell::demo(125).unwrap();
    let place = serve(&cell, |options| options.powered = true);
    let ours = demo::program(&cell).unwrap();
    let upload = |text: &str| program::upload(&place, 0, text);
    // It does not load.
    refused(upload(&ours.replace("servoj(", "servoi(")), Exit::Link, &["did not take the program", "no program plays"]);
    // It runs and is another.
    let other = "def other():\n  while True:\n    sync()\n  end\nend\n";
    refused(upload(other), Exit::Link, &["did not take the program", "output registers are not Screed's"]);
    assert_eq!(bad(&cell, &place), ["program"]);
    let mut line = DashboardLine::connect(&place).unwrap();
    act(&mut line, Act::Stop).unwrap();
    // Its registers are others.
    let mut shifted = cell.clone();
    shifted.link.register_offset = 24;
    refused(upload(&demo::program(&shifted).unwrap()), Exit::Link, &["output registers are not Screed's"]);
    act(&mut line, Act::Stop).unwrap();
    upload(&ours).unwrap();
}

#[test]
fn stops_and_popups_are_found_and_left_by_a_person() {
    let cell = Cell::demo(125).unwrap();
    let stop = "def stop():\n  popup(\"look\", blocking=True)\n  protective_stop()\nend\n";
    let place = serve(&cell, |options| {
        (options.powered, options.autoplay, options.program) = (true, true, stop.to_owned());
    });
    thread::sleep(Duration::from_millis(200));
    assert_eq!(bad(&cell, &place), ["program"]);
    let mut line = DashboardLine::connect(&place).unwrap();
    assert!(
        Act::ClosePopup.warning(&view::standing(&mut line).unwrap()).is_some(),
        "closing it lets the program go on"
    );
    act(&mut line, Act::ClosePopup).unwrap();
    thread::sleep(Duration::from_millis(200));
    assert_eq!(bad(&cell, &place), ["safety"]);
    refused(act(&mut line, Act::Unlock), Exit::SafetyStop, &["until 5s", "PROTECTIVE_STOP", "wait five seconds"]);
    refused(act(&mut line, Act::Play), Exit::SafetyStop, &["PROTECTIVE_STOP", "screed robot unlock"]);
    refused(program::upload(&place, 0, &demo::program(&cell).unwrap()), Exit::Link, &["a program runs"]);
    thread::sleep(Duration::from_secs(5));
    assert_eq!(act(&mut line, Act::Unlock).unwrap().safety, Safety::Normal);
    // Nothing goes on by itself.
    assert_eq!(view::standing(&mut line).unwrap().program, ProgramState::Paused);
    assert_eq!(bad(&cell, &place), ["program"]);
}

#[test]
fn another_robot_than_the_cells_is_found() {
    let cell = Cell::demo(125).unwrap();
    let mut other = cell.clone();
    other.robot.model = "ur5e".to_owned();
    other.robot.arm = screed_kernel::arms::ur::UR5E;
    let place = serve(&other, |options| (options.powered, options.autoplay) = (true, true));
    thread::sleep(Duration::from_millis(200));
    assert_eq!(bad(&cell, &place), ["robot model", "kinematics", "tool pose"]);
    assert_eq!(bad(&other, &place), [""; 0]);
    // Where ports are not as on a robot, the cell names them.
    let mut forwarded = other.clone();
    forwarded.link.port = place.rtde;
    (forwarded.link.dashboard_port, forwarded.link.primary_port) = (Some(place.dashboard), Some(place.primary));
    assert_eq!(Place::of(&forwarded).unwrap(), place);
    let mut named = other.clone();
    named.robot.serial = Some("1".to_owned());
    assert_eq!(bad(&named, &place), ["serial number"]);
}

/// What one answers who listens: to the first line of a client, or at once.
fn stranger(answer: &'static [u8], ends: bool) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        let mut kept: Vec<TcpStream> = Vec::new();
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let _ = stream.write_all(answer);
            if !ends {
                kept.push(stream);
            }
        }
    });
    port
}

#[test]
fn servers_that_are_no_controller_are_told_apart_and_waited_for_in_vain_only_so_long() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let at = |port| Place { host: "127.0.0.1".to_owned(), dashboard: port, primary: port, rtde: port };
    let standing = |port| {
        let mut line = DashboardLine::connect(&at(port)).map_err(Failure::from)?;
        line.set_patience(Duration::from_millis(300));
        view::standing(&mut line).map_err(Failure::from)
    };
    refused(standing(free), Exit::Link, &["does not answer"]);
    refused(standing(stranger(b"", false)), Exit::Link, &["says nothing"]);
    refused(standing(stranger(b"", true)), Exit::Link, &["closed the connection"]);
    refused(standing(stranger(b"220 mail\n", false)), Exit::Link, &["no dashboard", "220 mail"]);
    let hello = b"Connected: Universal Robots Dashboard Server\nNormal\n";
    refused(standing(stranger(hello, false)), Exit::Link, &["Normal"]);
    let kinematics = |port| view::kinematics(&at(port)).map_err(Failure::from);
    refused(
        kinematics(stranger(b"HTTP/1.1 400 Bad Request\r\n", false)),
        Exit::Link,
        &["bytes on the primary interface"],
    );
    refused(kinematics(stranger(b"", true)), Exit::Link, &["closed the connection"]);
    // A dashboard that is one, and an RTDE that is none.
    let place = serve(&Cell::demo(125).unwrap(), |_| {});
    let look = |rtde| view::view(&Place { rtde, ..place.clone() }, 0).map_err(Failure::from);
    refused(look(stranger(b"\x00\x05V\x00", false)), Exit::Link, &["RTDE", "check address and port"]);
    refused(look(stranger(b"\x00\x04V\x00\x00\x04V\x00", false)), Exit::Link, &["protocols 2 and 1"]);
    refused(look(stranger(b"", true)), Exit::Link, &["closed the connection"]);
    refused(look(free), Exit::Link, &["does not answer"]);
}
