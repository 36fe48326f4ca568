//! Judges what a board put out: plays the bytes that reached it, tick for tick as it took them, to the kernel of this machine, and
//! compares every command bit for bit: `replay BYTES DRIVES [WAYPOINTS]`.
//!
//! BYTES is what came over the line to the board, DRIVES what it put out (`Board::put_out`). Then says of the path's first
//! WAYPOINTS setpoints whether each was put out, with the fingerprint that `screed print` gives, and whether the arm rests.

use screed_firmware::{FollowingDrives, RING, START};
use screed_kernel::arms::ur::UR10E;
use screed_kernel::frame::ModeCode;
use screed_kernel::tick::{Kernel, Sensors};
use screed_kernel::units::Nanos;
use std::error::Error;
use std::fs;

/// What a board puts out in a tick, as bytes: heard, begun, mode, seq, flow, joints.
const RECORD: usize = 2 + 8 + 1 + 4 + 7 * 8;

struct Put {
    heard: usize,
    begun: Nanos,
    mode: u8,
    seq: u32,
    /// Flow and joints; joints that are NaN were none.
    values: [u64; 7],
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [bytes, drives, rest @ ..] = arguments.as_slice() else {
        return Err("usage: replay BYTES DRIVES [WAYPOINTS]".into());
    };
    let waypoints = rest.first().map_or(Ok(u32::MAX), |text| text.parse())?;
    let (bytes, drives) = (fs::read(bytes)?, fs::read(drives)?);
    let mut path = Path::default();
    let mut kernel = Box::new(Kernel::<6, RING>::new(&UR10E));
    let mut arm = FollowingDrives(START);
    let (mut waiting, mut last) = (bytes.as_slice(), None);
    let mut ticks = 0;
    for record in drives.chunks_exact(RECORD) {
        let put = read(record).ok_or("a record is too short")?;
        ticks += 1;
        let (heard, left) = waiting.split_at_checked(put.heard).ok_or("it heard more than was sent to it")?;
        waiting = left;
        kernel.receive(heard);
        let command = kernel.tick(put.begun, &Sensors::robot(arm.0, true));
        let joints = command.joints.map_or([f64::NAN; 6], |joints| joints.0);
        let mut values = [command.flow.to_bits(); 7];
        values.iter_mut().skip(1).zip(joints).for_each(|(value, joint)| *value = joint.to_bits());
        if (put.mode, put.seq, put.values) != (command.mode.code() as u8, command.seq, values) {
            return Err(format!("tick {ticks}: the board put out something else than this kernel: {command:?}").into());
        }
        arm.follow(&command);
        path.take(&put, waypoints);
        last = Some(put);
    }
    let last = last.ok_or("it put nothing out")?;
    let rests = [ModeCode::Unready, ModeCode::Holding, ModeCode::Faulted].iter().any(|mode| *mode as u8 == last.mode);
    let status = kernel.status();
    println!(
        "{{\"ticks\": {ticks}, \"bytes\": {}, \"waypoints\": {}, \"skipped\": {}, \"hash\": \"{:016x}\", \"rests\": {rests}, \
         \"last_seq\": {}, \"end_seq\": {}, \"frames_broken\": {}, \"ticks_late\": {}}}",
        bytes.len() - waiting.len(),
        path.count,
        path.skipped,
        path.hash,
        last.seq,
        status.end_seq,
        status.frames_broken,
        status.ticks_late,
    );
    Ok(())
}

fn read(record: &[u8]) -> Option<Put> {
    let (heard, record) = record.split_first_chunk()?;
    let (begun, record) = record.split_first_chunk()?;
    let ([mode], record) = record.split_first_chunk()?;
    let (seq, record) = record.split_first_chunk()?;
    let mut values = [0; 7];
    for (value, bytes) in values.iter_mut().zip(record.chunks_exact(8)) {
        *value = u64::from_le_bytes(bytes.try_into().ok()?);
    }
    Some(Put {
        heard: u16::from_le_bytes(*heard).into(),
        begun: Nanos(u64::from_le_bytes(*begun)),
        mode: *mode,
        seq: u32::from_le_bytes(*seq),
        values,
    })
}

/// The setpoints put out, each once: how many, how many were left out, and their FNV-1a fingerprint (sequence number, joints,
/// flow), as `screed` takes it of the path.
struct Path {
    count: u32,
    skipped: u32,
    last: u32,
    hash: u64,
}

impl Default for Path {
    fn default() -> Self {
        Self { count: 0, skipped: 0, last: 0, hash: 0xcbf2_9ce4_8422_2325 }
    }
}

impl Path {
    fn take(&mut self, put: &Put, waypoints: u32) {
        if put.seq <= self.last || put.seq > waypoints {
            return;
        }
        self.count += 1;
        self.skipped += put.seq - self.last - 1;
        self.last = put.seq;
        let [flow, joints @ ..] = put.values;
        let words = joints.into_iter().chain([flow]).flat_map(u64::to_le_bytes);
        for byte in put.seq.to_le_bytes().into_iter().chain(words) {
            self.hash = (self.hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}
