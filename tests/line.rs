//! The TCP line to the robot against peers that read and write as no robot should: byte by byte, late, or not at all.

use screed::config::Cell;
use screed::run::core::{Core, Slot};
use screed::run::demo::program;
use screed::run::line::{Heard, RobotLine};
use screed::sim::extruder::{Extruder, TIME_CONSTANT};
use screed::sim::ur::{ClientId, Controller, Options};
use screed_kernel::frame::{self, ToKernel, WIRE_MAX};
use screed_kernel::units::Nanos;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::fd::AsRawFd;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

fn controller(cell: &Cell) -> (Controller, ClientId) {
    let options = Options::of(cell, program(cell).unwrap());
    let mut controller = Controller::new(&cell.robot.arm, options).unwrap();
    let client = controller.connect();
    (controller, client)
}

/// A process that is configured, and its extruder: once the robot is ready it is sent where it is, in every cycle.
fn process(cell: &Cell) -> (Core, Extruder) {
    let mut core = Core::new(cell, true, "").unwrap();
    let mut bytes = [0; WIRE_MAX];
    let used = frame::encode(&ToKernel::Configure(cell.configure()), &mut bytes).unwrap();
    assert_eq!(core.on_host(&bytes[..used]), used);
    (core, Extruder::new(cell.extruder.flow_max, TIME_CONSTANT).unwrap())
}

/// Bytes of a telegram of the robot (docs/rtde.md).
const TELEGRAM: f64 = 224.0;

/// `cycles` of the robot have gone by, or a part of one.
fn exchange_extruder(core: &mut Core, extruder: &mut Extruder, now: Nanos, cycles: f64) {
    let mut bytes = [0; 512];
    let count = core.to_extruder(now, &mut bytes);
    extruder.handle_bytes(&bytes[..count]);
    extruder.step(0.002 * cycles);
    let count = extruder.poll_transmit(&mut bytes);
    core.on_extruder(now, &bytes[..count]);
}

fn connected() -> (RobotLine, TcpStream) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    (RobotLine::new(stream).unwrap(), listener.accept().unwrap().0)
}

/// The least buffer that the system has.
fn narrow(descriptor: i32, option: i32) {
    let least: libc::c_int = 1;
    // SAFETY: the option's value outlives the call and its size is given.
    let set = unsafe {
        let size = size_of::<libc::c_int>() as libc::socklen_t;
        libc::setsockopt(descriptor, libc::SOL_SOCKET, option, (&raw const least).cast(), size)
    };
    assert_eq!(set, 0);
}

/// The controller behind a wire that carries each byte by itself, both ways. Its next telegram comes when the last has been
/// read, as `heard` counts: a machine that is slow with single bytes is not to answer what lies in its buffers.
fn byte_by_byte(cell: &Cell, mut wire: TcpStream, cycles: usize, heard: &AtomicUsize) -> (u32, bool) {
    let (mut controller, client) = controller(cell);
    wire.set_nodelay(true).unwrap();
    wire.set_nonblocking(true).unwrap();
    let (mut bytes, mut byte) = ([0; 4096], [0]);
    let (mut packages, mut said) = (0, 0);
    for _ in 0..cycles {
        let until = Instant::now() + Duration::from_millis(2);
        while Instant::now() < until || heard.load(Ordering::Relaxed) < said {
            match wire.read(&mut byte) {
                Ok(1) => controller.handle_bytes(client, &byte),
                _ => thread::yield_now(),
            }
        }
        controller.step();
        packages += controller.last_cycle().packages;
        let count = controller.poll_transmit(client, &mut bytes);
        wire.set_nonblocking(false).unwrap();
        for byte in &bytes[..count] {
            wire.write_all(&[*byte]).unwrap();
        }
        said += count;
        wire.set_nonblocking(true).unwrap();
    }
    assert_eq!(i64::from(controller.last_cycle().seq), i64::from(packages), "a package was lost, or sent twice");
    (packages, controller.is_connected(client))
}

#[test]
fn a_peer_that_reads_and_writes_one_byte_at_a_time_gets_whole_packages_each_once() {
    let mut cell = Cell::demo(500).unwrap();
    // How fast this machine carries single bytes is not the matter.
    (cell.link.timeout, cell.link.watchdog) = (10.0, 10.0);
    cell.realtime.overruns_max = 1_000_000;
    let (mut line, wire) = connected();
    let heard_in_all = AtomicUsize::new(0);
    let start = Instant::now();
    let now = || Nanos(start.elapsed().as_nanos() as u64);
    thread::scope(|scope| {
        let peer = scope.spawn(|| byte_by_byte(&cell, wire, 700, &heard_in_all));
        let (mut core, mut extruder) = process(&cell);
        // Less than a telegram: each comes in parts, whatever the system makes of single bytes.
        let mut bytes = [0; 61];
        let mut stamped = 0_u32;
        while !peer.is_finished() {
            line.send(|out| core.to_robot(now(), out)).unwrap();
            let heard = line.read(&mut bytes);
            if let Heard::Bytes { count, age } = heard {
                stamped += u32::from(age.is_some());
                core.on_robot(now(), &bytes[..count]).unwrap();
                let slot = Slot { began: heard.ready_at(now()), missed: 0, line_free: line.is_free() };
                core.answer(now(), slot).unwrap();
                core.finish_cycle(now(), now());
                // By the wire's time, not by how many pieces it came in.
                exchange_extruder(&mut core, &mut extruder, now(), count as f64 / TELEGRAM);
                heard_in_all.fetch_add(count, Ordering::Relaxed);
            } else {
                thread::yield_now();
            }
        }
        let (packages, connected) = peer.join().unwrap();
        assert!(connected && packages > 50, "{packages} packages");
        assert!(core.ticks() > 50, "{} ticks", core.ticks());
        assert!(stamped > 50, "{stamped} stamped");
    });
}

#[test]
fn what_the_line_does_not_take_is_counted_and_goes_out_later_each_byte_once() {
    let (mut line, mut wire) = connected();
    narrow(line.descriptor(), libc::SO_SNDBUF);
    narrow(wire.as_raw_fd(), libc::SO_RCVBUF);
    let package = |number: u32| {
        let mut package = [0xa5; 56];
        package[..4].copy_from_slice(&number.to_be_bytes());
        package
    };
    // Nobody reads: sooner or later the line takes no more, and nothing waits for it.
    let mut offered = 0_u32;
    let offer = |line: &mut RobotLine, offered: &mut u32, more: u32| {
        let until = *offered + more;
        line.send(|out| {
            if *offered == until {
                return 0;
            }
            *offered += 1;
            out[..56].copy_from_slice(&package(*offered));
            56
        })
        .unwrap();
    };
    while line.is_free() {
        offer(&mut line, &mut offered, 1);
        assert!(offered < 1_000_000, "it takes everything");
    }
    let held = offered;
    assert!(line.blocked() >= 1 && held > 1);
    for _ in 0..100 {
        offer(&mut line, &mut offered, 1);
    }
    assert_eq!(offered, held, "nothing more is asked for while something waits");
    assert!(line.blocked() >= 101);
    // A peer that reads a little now and then.
    let mut received = Vec::new();
    let mut bytes = [0; 37];
    while offered < held + 500 || !line.is_free() {
        let count = wire.read(&mut bytes).unwrap();
        received.extend_from_slice(&bytes[..count]);
        let more = u32::from(offered < held + 500);
        offer(&mut line, &mut offered, more);
    }
    drop(line);
    wire.read_to_end(&mut received).unwrap();
    let expected: Vec<u8> = (1..=offered).flat_map(package).collect();
    assert!(received == expected, "{} bytes of {}", received.len(), expected.len());
}

#[test]
fn a_line_that_is_not_free_or_gone_is_told() {
    let (mut line, wire) = connected();
    assert_eq!((line.read(&mut [0; 16]), line.resent()), (Heard::Nothing, 0));
    drop(wire);
    let until = Instant::now() + Duration::from_secs(5);
    while line.read(&mut [0; 16]) != Heard::Closed {
        assert!(Instant::now() < until, "the end of the connection is noticed");
    }
    let broken = (0..1000).any(|_| {
        let mut once = true;
        line.send(|_| if std::mem::take(&mut once) { 56 } else { 0 }).is_err()
    });
    assert!(broken);
}

#[test]
fn a_slot_for_which_the_line_is_not_free_is_missed_and_nothing_is_queued_behind() {
    let cell = Cell::demo(500).unwrap();
    let (mut controller, client) = controller(&cell);
    let (mut core, mut extruder) = process(&cell);
    let mut bytes = [0; 4096];
    let mut now = Nanos(0);
    let (mut busy, mut sent) = (0_u64, 0_u64);
    for cycle in 0..1000_u64 {
        now = now.plus(2_000_000);
        controller.step();
        let count = controller.poll_transmit(client, &mut bytes);
        core.on_robot(now, &bytes[..count]).unwrap();
        let line_free = !(500..520).contains(&cycle) && cycle != 700;
        busy += u64::from(!line_free);
        let before = core.ticks();
        core.answer(now, Slot { began: now, missed: 0, line_free }).unwrap();
        assert!(line_free || core.ticks() == before, "cycle {cycle}");
        core.finish_cycle(now, now);
        let count = core.to_robot(now, &mut bytes);
        assert!(line_free || count == 0, "cycle {cycle}: {count} bytes");
        sent += u64::from(count == 56);
        controller.handle_bytes(client, &bytes[..count]);
        exchange_extruder(&mut core, &mut extruder, now, 1.0);
    }
    let pace = core.pace();
    assert!(sent > 900 && sent < 1000 - busy, "{sent} setpoints");
    assert_eq!((pace.overruns, pace.slots_missed, pace.level_max), (2, busy, 1));
}
