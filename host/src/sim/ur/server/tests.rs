//! Over real sockets, in real time.

use super::*;
use crate::link::rtde::program::{Program, WatchdogAction};
use crate::link::rtde::{Event, RtdeClient};
use crate::sim::ur::robot::Generation;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};
use std::io::{Read, Write};
use std::net::TcpStream;

fn options(record: Option<PathBuf>) -> ServeOptions {
    let watchdog_action = WatchdogAction::Stop;
    let (lookahead, gain, watchdog) = (0.1, 300.0, 0.5);
    let program = Program { rate_hz: 500, register_offset: 24, lookahead, gain, watchdog, watchdog_action };
    ServeOptions {
        arm: UR10E,
        controller: Options {
            start_q: JointPos([0.0, -1.0, 1.0, -1.5, -1.5, 0.0]),
            flange_from_tcp: Pose::identity(),
            register_offset: 24,
            program: program.text().expect("legal"),
            autoplay: true,
            generation: Generation::ESeries,
            powered: true,
        },
        host: [127, 0, 0, 1].into(),
        port: 0,
        allow_remote: false,
        record,
        exit_when_idle: Some(Duration::from_millis(200)),
        json: false,
        fieldbus: Fieldbus::Off,
        faults: Vec::new(),
        control: false,
        stop: || false,
    }
}

/// Runs the client over a real socket until it has `wanted` states; their timestamps.
fn timestamps(address: SocketAddr, wanted: usize) -> Vec<f64> {
    let mut stream = TcpStream::connect(address).expect("a server");
    stream.set_read_timeout(Some(Duration::from_millis(20))).expect("a socket");
    let origin = Instant::now();
    let mut client = RtdeClient::new(&UR10E, 500, 24, 2_000_000_000).expect("legal");
    let (mut stamps, mut bytes) = (Vec::new(), [0; 4096]);
    while stamps.len() < wanted {
        let now = Nanos(origin.elapsed().as_nanos() as u64);
        let count = client.poll_transmit(now, &mut bytes);
        stream.write_all(&bytes[..count]).expect("a connection");
        if let Ok(count) = stream.read(&mut bytes) {
            client.handle_bytes(now, &bytes[..count]).expect("sound bytes");
        }
        client.handle_timeout(now).expect("a robot that talks");
        while let Some(event) = client.poll_event() {
            if let Event::State { state, skipped } = event {
                stamps.push(state.timestamp);
                stamps.extend((0..skipped).map(|_| f64::NAN));
                client.send_setpoint(stamps.len() as u32, &state.actual_q).expect("running");
            }
        }
    }
    stamps
}

#[test]
fn over_a_socket_stamps_are_exact_cycles_and_the_record_has_each() {
    let folder = std::env::temp_dir().join(format!("screed-server-test-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join("record.csv");
    let mut server = Server::bind(&options(Some(path.clone()))).expect("a free port");
    let address = server.address();
    let client = std::thread::spawn(move || timestamps(address, 250));
    let summary = server.run(|| false).expect("a record");
    let stamps = client.join().expect("the client");
    for pair in stamps.windows(2).filter(|pair| pair.iter().all(|stamp| stamp.is_finite())) {
        let cycles = (pair[1] - pair[0]) * 500.0;
        assert!((cycles - cycles.round()).abs() < 1e-9 && cycles > 0.5, "{pair:?}");
    }
    let text = std::fs::read_to_string(&path).expect("the record");
    assert_eq!(text.lines().count() as u64, summary.cycles + 1);
    let packages: u32 = text.lines().skip(1).filter_map(|row| row.split(',').nth(2)?.parse::<u32>().ok()).sum();
    assert!(packages > 200, "{packages} setpoints in the record");
    let columns = text.lines().map(|row| row.split(',').count());
    assert!(columns.into_iter().all(|count| count == 4 + 6 + 6 + 2));
    std::fs::remove_dir_all(folder).expect("cleaning up");
}

#[test]
fn a_port_in_use_and_an_open_address_are_refused() {
    let first = Server::bind(&options(None)).expect("a free port");
    let mut second = options(None);
    second.port = first.address().port();
    assert!(matches!(Server::bind(&second), Err(SimError::AddressInUse { .. })));
    let mut open = options(None);
    open.host = [0, 0, 0, 0].into();
    assert!(matches!(Server::bind(&open), Err(SimError::NotLoopback { .. })));
    let mut broken = options(None);
    broken.controller.program.push_str("hello()\n");
    assert!(matches!(Server::bind(&broken), Err(SimError::Program { .. })));
}
