//! The RTDE client lives in the real-time process: after it is made it must not allocate.

use screed::link::rtde::file;
use screed::link::rtde::program::{Program, WatchdogAction};
use screed::link::rtde::wire::Protocol;
use screed::link::rtde::{Event, RtdeClient};
use screed::sim::ur::robot::Generation;
use screed::sim::ur::{Controller, Options};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, which counts for the thread that asks.
struct Counting;

// SAFETY: everything is passed on to the system's allocator; counting touches a thread-local without destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs `work` and adds what it allocates to `total`.
fn counted<T>(total: &mut u64, work: impl FnOnce() -> T) -> T {
    let before = ALLOCATIONS.get();
    let result = work();
    *total += ALLOCATIONS.get() - before;
    result
}

const RECIPES: &str = r#"<rtde_config>
  <recipe key="state"><field name="target_qd" type="VECTOR6D"/><field name="joint_mode" type="VECTOR6INT32"/></recipe>
  <recipe key="watchdog"><field name="input_int_register_24" type="INT32"/></recipe>
</rtde_config>"#;

#[test]
fn negotiation_operation_and_failure_allocate_nothing() {
    for protocol in [Protocol::Two, Protocol::One] {
        run(protocol, if protocol == Protocol::Two { 500 } else { 125 });
    }
}

fn run(protocol: Protocol, rate_hz: u32) {
    let start_q = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);
    let watchdog_action = WatchdogAction::Stop;
    let (lookahead, gain, watchdog) = (0.1, 300.0, 0.1);
    let program = Program { rate_hz, register_offset: 24, lookahead, gain, watchdog, watchdog_action };
    let options = Options {
        start_q,
        flange_from_tcp: Pose::identity(),
        register_offset: 24,
        program: program.text().expect("legal"),
        autoplay: true,
        generation: Generation::ESeries,
        powered: true,
    };
    let mut controller = Controller::new(&UR10E, options).expect("legal");
    controller.limit_protocol(protocol);
    let connection = controller.connect();
    let file = file::parse("recipes.xml", RECIPES).expect("sound");
    let mut client = RtdeClient::beside(Some(&file), &UR10E, rate_hz, 24, 100_000_000).expect("legal");
    let mut allocations = 0;
    let mut control = 0;
    counted(&mut control, || drop(std::hint::black_box(Box::new(1_u64))));
    assert_eq!(control, 1, "the count does not count");

    let mut bytes = [0; 4096];
    let mut now = Nanos(0);
    let mut states = 0_u32;
    for _ in 0..1000 {
        now = now.plus(2_000_000);
        let count = counted(&mut allocations, || client.poll_transmit(now, &mut bytes));
        controller.handle_bytes(connection, &bytes[..count]);
        controller.step();
        let count = controller.poll_transmit(connection, &mut bytes);
        counted(&mut allocations, || {
            client.handle_bytes(now, &bytes[..count]).expect("sound bytes");
            client.handle_timeout(now).expect("a robot that talks");
            while let Some(event) = client.poll_event() {
                if let Event::State { state, .. } = event {
                    states += 1;
                    client.send_setpoint(states, &state.actual_q).expect("running");
                }
            }
        });
    }
    assert!(states > 900 * rate_hz / 500, "{states} states");
    assert_eq!(client.extra().count(), 2);
    counted(&mut allocations, || client.handle_bytes(now, b"\x00\x03Z").expect_err("an unknown package"));
    counted(&mut allocations, || client.restart());
    assert!(counted(&mut allocations, || client.poll_transmit(now, &mut bytes)) > 0);
    assert_eq!(allocations, 0);
}
