//! Over real sockets, in real time.

use super::*;
use crate::link::rtde::program::{Program, WatchdogAction};
use crate::link::rtde::wire::Protocol;
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
        rtde_protocol: Protocol::Two,
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

/// A client that knows a recipe's setup and the stamp at a data package's start, and nothing else.
struct Raw {
    stream: TcpStream,
    buffer: Vec<u8>,
}

impl Raw {
    fn connect(address: SocketAddr, names: &str) -> std::io::Result<Self> {
        let mut stream = TcpStream::connect(address)?;
        let package = |kind: u8, payload: &[u8]| {
            let mut bytes = ((payload.len() + 3) as u16).to_be_bytes().to_vec();
            bytes.push(kind);
            bytes.extend(payload);
            bytes
        };
        let mut setup = 500_f64.to_be_bytes().to_vec();
        setup.extend(names.bytes());
        for bytes in [package(b'V', &[0, 2]), package(b'O', &setup), package(b'S', &[])] {
            stream.write_all(&bytes)?;
        }
        Ok(Self { stream, buffer: Vec::new() })
    }

    /// The stamp of the next data package.
    fn stamp(&mut self) -> std::io::Result<f64> {
        loop {
            while let [high, low, kind, ..] = *self.buffer {
                let size = usize::from(u16::from_be_bytes([high, low]));
                if self.buffer.len() < size {
                    break;
                }
                let package: Vec<u8> = self.buffer.drain(..size).collect();
                if kind == b'U' {
                    return Ok(f64::from_be_bytes(package[4..12].try_into().expect("a stamp")));
                }
            }
            let mut bytes = [0; 4096];
            match self.stream.read(&mut bytes)? {
                0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
                count => self.buffer.extend(&bytes[..count]),
            }
        }
    }
}

/// Runs the server with these faults until the client is through.
fn with_server<T: Send + 'static>(faults: &[&str], client: impl FnOnce(SocketAddr) -> T + Send + 'static) -> T {
    let faults = faults.iter().map(|text| text.parse().expect("a fault")).collect();
    let mut server =
        Server::bind(&ServeOptions { faults, exit_when_idle: None, ..options(None) }).expect("a free port");
    let address = server.address();
    let client = std::thread::spawn(move || client(address));
    server.run(|| client.is_finished()).expect("no record");
    client.join().expect("the client")
}

#[test]
fn silence_reset_and_restart_come_at_their_times_over_a_socket() {
    with_server(&["restart=0.4@2", "reset@1.2", "silence=0.3@0.5"], |address| {
        let mut raw = Raw::connect(address, "timestamp").expect("a server");
        let (mut stamps, ended) = (Vec::new(), loop_until_error(&mut raw));
        stamps.extend(ended.0);
        let gaps: Vec<f64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap| *gap > 0.0021).collect();
        assert!(gaps.len() == 1 && (gaps[0] - 0.302).abs() < 1e-9, "{gaps:?}");
        assert_eq!(ended.1, std::io::ErrorKind::ConnectionReset);

        let mut raw = Raw::connect(address, "timestamp").expect("a server");
        let (seen, ended) = loop_until_error(&mut raw);
        assert!(!seen.is_empty() && seen[0] > 41.0);
        assert_eq!(ended, std::io::ErrorKind::UnexpectedEof);
        // Nobody listens for a while.
        let refused = Raw::connect(address, "timestamp").err().map(|error| error.kind());
        assert_eq!(refused, Some(std::io::ErrorKind::ConnectionRefused));
        let mut raw = loop {
            match Raw::connect(address, "timestamp") {
                Ok(raw) => break raw,
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        assert!(raw.stamp().expect("a package") < 1.0, "time begins anew");
    });
}

/// The stamps until the connection ends, and how.
fn loop_until_error(raw: &mut Raw) -> (Vec<f64>, std::io::ErrorKind) {
    let mut stamps = Vec::new();
    loop {
        match raw.stamp() {
            Ok(stamp) => stamps.push(stamp),
            Err(error) => return (stamps, error.kind()),
        }
    }
}

/// In real time, for it is the system's own buffers that fill first.
#[test]
fn a_client_that_does_not_read_is_cut_and_nobody_else_misses_a_package() {
    with_server(&[], |address| {
        let vectors = ["actual_q", "target_q", "actual_qd", "actual_TCP_pose", "actual_TCP_speed"].repeat(5).join(",");
        let mut deaf = Raw::connect(address, &format!("timestamp,{vectors}")).expect("a server");
        let mut good = Raw::connect(address, "timestamp,actual_q").expect("a server");
        let mut before = good.stamp().expect("a package");
        // 14 s: ten that the controller waits, and what the system buffers.
        for _ in 0..7000 {
            let stamp = good.stamp().expect("a package");
            assert!((stamp - before - 0.002).abs() < 1e-9, "{before} and {stamp}");
            before = stamp;
        }
        let (stamps, _) = loop_until_error(&mut deaf);
        // What the system had buffered; it was cut long before the good one stopped reading.
        let newest = stamps.last().expect("what was buffered");
        assert!(before - newest > 9.0, "{newest} and {before}");
        good.stamp().expect("still there");
    });
}
