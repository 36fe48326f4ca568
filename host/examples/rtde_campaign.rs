//! Fuzzed bytes on both ends of RTDE: the clients and the simulated controller, as many inputs on each.
//! `cargo run --release -p screed --example rtde_campaign -- [--inputs N] [--seed N]`; the default is 10,000,000 inputs on each end.
//!
//! An input is a stream of sound packages that was spoilt (bytes set, flipped, put in, taken out, repeated; sizes at their edges),
//! or random bytes, handed over in up to five parts. It must not panic, nor hang (a second thread looks), nor take memory without
//! bound: a client allocates nothing at all, what it wants to send has a bound, and so have the controller's memory and its answers.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::Random;
use screed::link::rtde::file;
use screed::link::rtde::reader::RtdeReader;
use screed::link::rtde::wire::Protocol;
use screed::link::rtde::{LinkError, Phase, RtdeClient};
use screed::sim::ur::robot::Generation;
use screed::sim::ur::{ClientId, Controller, Options};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::{JointPos, Nanos};
use std::alloc::{GlobalAlloc, Layout, System};
use std::mem::discriminant;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// The most that a client may want to send at once: every request of a negotiation, and some setpoints.
const CLIENT_OUT_MAX: usize = 2048;
/// The most that the controller may hold for one client: its backlog, and one package.
const SERVER_OUT_MAX: usize = 4 * 1024 * 1024 + 64 * 1024;
/// The most memory that the controller may take beside what it has without clients: eight of them with their backlogs and recipes.
const SERVER_MEMORY_MAX: usize = 64 << 20;
const CLIENTS: usize = 8;
/// No input takes longer than this.
const HANG: Duration = Duration::from_secs(30);
const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);
static CALLS: AtomicU64 = AtomicU64::new(0);
/// Inputs so far, for whoever looks whether they go on.
static INPUTS: AtomicU64 = AtomicU64::new(0);

/// The system's allocator, with an account.
struct Counting;

// SAFETY: everything is passed on to the system's allocator; the account is kept in atomics.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        PEAK.fetch_max(LIVE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// FNV-1a (Fowler, Noll, Vo) over all that comes out.
struct Hash(u64);

impl Hash {
    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

fn main() {
    let (mut inputs, mut seed) = (10_000_000, 1);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let number = words.next().and_then(|number| number.parse().ok());
        match (word.as_str(), number) {
            ("--inputs", Some(number)) => inputs = number,
            ("--seed", Some(number)) => seed = number,
            _ => return eprintln!("usage: rtde_campaign [--inputs N] [--seed N]"),
        }
    }
    std::thread::spawn(|| {
        loop {
            let before = INPUTS.load(Ordering::Relaxed);
            std::thread::sleep(HANG);
            if INPUTS.load(Ordering::Relaxed) == before {
                eprintln!("input {before} takes longer than {HANG:?}: it hangs");
                std::process::abort();
            }
        }
    });
    let began = Instant::now();
    let told = clients(inputs, seed);
    println!("clients: {inputs} inputs in {:.0} s, {told}", began.elapsed().as_secs_f64());
    let began = Instant::now();
    let told = controller(inputs, seed);
    println!("controller: {inputs} inputs in {:.0} s, {told}", began.elapsed().as_secs_f64());
}

/// Spoils a stream of sound packages; each has its beginning in it.
fn spoil(random: &mut Random, stream: &mut Vec<u8>) {
    const SIZES: [u16; 10] = [0, 1, 2, 3, 4, 5, 0x7fff, 0x8000, 0xfffe, 0xffff];
    for _ in 0..random.bits() % 4 {
        let place = random.bits() as usize % (stream.len() + 1);
        let end = (place + random.bits() as usize % 24).min(stream.len());
        let byte = random.bits() as u8;
        match random.bits() % 6 {
            0 => stream.iter_mut().skip(place).take(1).for_each(|at| *at = byte),
            1 => stream.iter_mut().skip(place).take(1).for_each(|at| *at ^= 1 << (byte & 7)),
            2 => stream.insert(place, byte),
            3 => _ = stream.drain(place..end),
            4 => stream.extend_from_within(place..end),
            _ => {
                let size = SIZES[usize::from(byte) % SIZES.len()].to_be_bytes();
                stream.iter_mut().skip(place).zip(size).for_each(|(at, byte)| *at = byte);
            }
        }
    }
}

/// One input: random bytes, or some of the sound packages in a row, as they are or spoilt. It begins with `next` or anywhere.
fn input(random: &mut Random, sound: &[Vec<u8>], next: usize, stream: &mut Vec<u8>) {
    stream.clear();
    let kind = random.bits() % 16;
    if kind == 0 {
        let count = random.bits() % 64;
        stream.extend((0..count).map(|_| random.bits() as u8));
        return;
    }
    let first = if kind < 12 { next } else { random.bits() as usize } % sound.len();
    let count = 1 + random.bits() as usize % 4;
    sound.iter().skip(first).take(count).for_each(|package| stream.extend(package));
    if kind.is_multiple_of(2) {
        spoil(random, stream);
    }
}

/// Hands a stream over in up to five parts.
fn parts<'a>(random: &mut Random, mut stream: &'a [u8]) -> impl Iterator<Item = &'a [u8]> + use<'a> {
    let cuts: [u64; 4] = std::array::from_fn(|_| random.bits());
    let count = random.bits() as usize % 5;
    let mut cuts = cuts.into_iter().take(count);
    let mut ended = false;
    std::iter::from_fn(move || {
        if ended {
            return None;
        }
        let cut = cuts.next().map(|cut| cut as usize % (stream.len() + 1));
        ended = cut.is_none();
        let (part, rest) = stream.split_at(cut.unwrap_or(stream.len()));
        stream = rest;
        Some(part)
    })
}

fn package(kind: u8, payload: &[u8]) -> Vec<u8> {
    [&((payload.len() + 3) as u16).to_be_bytes()[..], &[kind], payload].concat()
}

const RECIPES: &str = r#"<rtde_config><recipe key="out">
  <field name="timestamp" type="DOUBLE"/>
  <field name="joint_mode" type="VECTOR6INT32"/>
  <field name="output_bit_register_64" type="BOOL"/>
</recipe></rtde_config>"#;

/// A client in some phase.
#[derive(Clone)]
#[expect(clippy::large_enum_variant, reason = "nearly all are clients")]
enum Peer {
    Client(RtdeClient),
    Reader(RtdeReader),
}

impl Peer {
    fn take(&mut self, now: Nanos, bytes: &[u8], hash: &mut Hash) -> Result<(), LinkError> {
        match self {
            Self::Client(client) => client.handle_bytes(now, bytes),
            Self::Reader(reader) => reader.handle_bytes(now, bytes, |values| hash.add(values)),
        }
    }

    fn phase(&self) -> Phase {
        match self {
            Self::Client(client) => client.phase(),
            Self::Reader(reader) => reader.phase(),
        }
    }

    /// All that it has to tell and to send.
    fn drain(&mut self, now: Nanos, hash: &mut Hash) -> usize {
        let (mut sent, mut out) = (0, [0; 256]);
        let mut told = 0;
        loop {
            let count = match self {
                Self::Client(client) => {
                    while let Some(event) = client.poll_event() {
                        told += 1;
                        if let screed::link::rtde::Event::State { state, .. } = event {
                            hash.add(&state.timestamp.to_be_bytes());
                            let _ = client.send_setpoint(told, &state.actual_q);
                        }
                    }
                    client.poll_transmit(now, &mut out)
                }
                Self::Reader(reader) => {
                    while reader.poll_text().is_some() {
                        told += 1;
                    }
                    reader.poll_transmit(now, &mut out)
                }
            };
            hash.add(&out[..count]);
            sent += count;
            assert!(told < 8, "{told} events of one input");
            if count == 0 {
                return sent;
            }
        }
    }
}

/// Every kind of client in every phase of both protocols, each with the place of what comes next among the sound packages.
fn prepared() -> (Vec<(Peer, usize)>, Vec<Vec<u8>>) {
    let recipes = file::parse("recipes.xml", RECIPES).expect("sound");
    let (mut peers, mut sound) = (Vec::new(), Vec::new());
    for (kind, protocol) in (0..3).flat_map(|kind| [(kind, Protocol::Two), (kind, Protocol::One)]) {
        let mut controller = new_controller();
        controller.limit_protocol(protocol);
        let connection = controller.connect();
        let beside = (kind == 1).then_some(&recipes);
        let mut peer = match kind {
            2 => Peer::Reader(RtdeReader::new(&recipes, &recipes.recipes[0], 125, 100_000_000).expect("legal")),
            _ => Peer::Client(RtdeClient::beside(beside, &UR10E, 125, 0, 100_000_000).expect("legal")),
        };
        let mut hash = Hash(0);
        for _ in 0..200 {
            let mut out = [0; 4096];
            let asked = match &mut peer {
                Peer::Client(client) => client.poll_transmit(Nanos(0), &mut out),
                Peer::Reader(reader) => reader.poll_transmit(Nanos(0), &mut out),
            };
            if asked > 0 {
                peers.push((peer.clone(), sound.len()));
            }
            controller.handle_bytes(connection, &out[..asked]);
            controller.step();
            let count = controller.poll_transmit(connection, &mut out);
            if count > 0 {
                sound.push(out[..count].to_vec());
            }
            peer.take(Nanos(0), &out[..count], &mut hash).expect("a sound controller");
        }
        assert_eq!(peer.phase(), Phase::Running);
        peer.drain(Nanos(0), &mut hash);
        // What may follow: states, and texts of both protocols.
        let next = sound.len();
        for _ in 0..20 {
            controller.step();
            let mut out = [0; 4096];
            let count = controller.poll_transmit(connection, &mut out);
            if count > 0 {
                sound.push(out[..count].to_vec());
            }
        }
        sound.push(package(b'M', b"\x05error\x01x\x01"));
        sound.push(package(b'M', b"\x01error"));
        let mut paused = peer.clone();
        if let Peer::Reader(reader) = &mut paused {
            reader.pause().expect("running");
            peers.push((paused, next));
        }
        // As often as all others together: it is where a client spends its life.
        peers.extend((0..6).map(|_| (peer.clone(), next)));
    }
    sound.push(package(b'P', &[1]));
    (peers, sound)
}

fn clients(inputs: u64, seed: u64) -> String {
    let mut random = Random::new(seed);
    let (peers, sound) = prepared();
    let (mut hash, mut stream) = (Hash(0xcbf2_9ce4_8422_2325), Vec::with_capacity(1 << 16));
    let (mut failed, mut sent_max) = (0_u64, 0);
    for _ in 0..inputs {
        let (mut peer, next) = peers[random.bits() as usize % peers.len()].clone();
        input(&mut random, &sound, next, &mut stream);
        let calls = CALLS.load(Ordering::Relaxed);
        let mut result = Ok(());
        for part in parts(&mut random, &stream) {
            let now = Nanos(random.bits() >> 30);
            result = peer.take(now, part, &mut hash);
            sent_max = sent_max.max(peer.drain(now, &mut hash));
        }
        let silent = match &mut peer {
            Peer::Client(client) => client.handle_timeout(Nanos(random.bits() >> 30)),
            Peer::Reader(reader) => reader.handle_timeout(Nanos(random.bits() >> 30)),
        };
        assert_eq!(CALLS.load(Ordering::Relaxed), calls, "a client allocated");
        assert!(sent_max <= CLIENT_OUT_MAX, "{sent_max} bytes to send at once");
        if let Err(error) = result {
            failed += 1;
            // By its kind: a value that is no number differs from itself.
            let again = silent.err().as_ref().map(discriminant);
            assert_eq!(again, Some(discriminant(&error)), "a failed client stays failed");
            hash.add(format!("{:?}", discriminant(&error)).as_bytes());
        }
        INPUTS.fetch_add(1, Ordering::Relaxed);
    }
    format!("{failed} refused, at most {sent_max} bytes to send at once, no allocation; hash {:016x}", hash.0)
}

fn new_controller() -> Controller {
    let options = Options {
        start_q: START,
        flange_from_tcp: Pose::identity(),
        register_offset: 0,
        program: "def idle():\nend\n".to_owned(),
        autoplay: false,
        generation: Generation::ESeries,
        powered: true,
    };
    Controller::new(&UR10E, options).expect("legal")
}

/// What clients send: everything that is sound, and some that asks for much or for the impossible.
fn requests() -> Vec<Vec<u8>> {
    let setup = |rate: f64, names: &str| package(b'O', &[&rate.to_be_bytes()[..], names.as_bytes()].concat());
    let many = |name: &str, count: usize| vec![name; count].join(",");
    vec![
        package(b'V', &[0, 2]),
        package(b'v', &[]),
        setup(500.0, "timestamp,actual_q,runtime_state,output_bit_register_64"),
        package(b'I', b"input_double_register_0,input_int_register_0"),
        package(b'S', &[]),
        package(b'U', &[&[1][..], &[0; 12]].concat()),
        package(b'U', &[&[1][..], &0.5_f64.to_be_bytes(), &[0, 0, 0, 1]].concat()),
        package(b'P', &[]),
        package(b'M', b"\x05hello\x06client\x03"),
        package(b'V', &[0, 1]),
        package(b'O', b"timestamp,actual_TCP_pose,input_double_register_0"),
        package(b'I', b"speed_slider_mask,speed_slider_fraction,standard_digital_output_mask,standard_digital_output"),
        package(b'S', &[]),
        package(b'U', &[&[2, 0, 0, 0, 1][..], &0.5_f64.to_be_bytes(), &[255, 1]].concat()),
        setup(125.0, &many("target_q", 30)),
        setup(f64::NAN, "timestamp,nothing,"),
        package(b'I', many("input_bit_register_64", 40).as_bytes()),
        package(b'O', many("", 60).as_bytes()),
        package(b'R', b"v1.software.version"),
    ]
}

fn controller(inputs: u64, seed: u64) -> String {
    let mut random = Random::new(!seed);
    let sound = requests();
    let (mut hash, mut stream) = (Hash(0xcbf2_9ce4_8422_2325), Vec::with_capacity(1 << 16));
    let mut controller = new_controller();
    let mut clients: Vec<ClientId> = (0..CLIENTS).map(|_| controller.connect()).collect();
    let (mut cut, mut answered, mut held_max) = (0_u64, 0_u64, 0);
    let mut out = vec![0; SERVER_OUT_MAX + 1];
    let before = LIVE.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    for number in 0..inputs {
        let place = random.bits() as usize % CLIENTS;
        let client = clients[place];
        let next = random.bits() as usize;
        input(&mut random, &sound, next, &mut stream);
        parts(&mut random, &stream).for_each(|part| controller.handle_bytes(client, part));
        if number % 64 == 0 {
            controller.step();
        }
        // Some clients hardly read.
        let reads = random.bits() % 256 > 250 * u64::from(place == 0);
        if reads || !controller.is_connected(client) {
            let held = controller.poll_transmit(client, &mut out);
            assert!(held <= SERVER_OUT_MAX, "{held} bytes held for a client");
            held_max = held_max.max(held);
            answered += u64::from(held > 0);
            hash.add(&out[..held]);
        }
        let is_cut = !controller.is_connected(client);
        cut += u64::from(is_cut);
        // A connection that was told of a large package swallows what follows.
        if is_cut || random.bits().is_multiple_of(16) {
            controller.disconnect(client);
            clients[place] = controller.connect();
        }
        if number % 1024 == 0 {
            let taken = PEAK.load(Ordering::Relaxed).saturating_sub(before);
            assert!(taken <= SERVER_MEMORY_MAX, "{taken} bytes for {CLIENTS} clients");
        }
        INPUTS.fetch_add(1, Ordering::Relaxed);
    }
    let taken = PEAK.load(Ordering::Relaxed).saturating_sub(before) / 1024;
    format!(
        "{cut} connections cut, {answered} answered, at most {held_max} bytes held for one and {taken} KiB in all; hash {:016x}",
        hash.0
    )
}
