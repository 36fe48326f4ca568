//! The inputs, the same for every program: seeded, in a file, with a hash.

use screed_kernel::arm::Arm;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use std::fs;
use std::io;
use std::path::Path;

/// How far each joint of a seed is from the joints sought, at most (rad): a control cycle of 10 ms at full speed.
const SEED_DISTANCE: f64 = 0.02;

/// 24 numbers, as they lie in the file.
const BYTES: usize = 24 * 8;

/// Joints, the pose they give, and a seed near them.
pub struct Record {
    /// What reaches the pose (rad).
    pub joints: JointPos<6>,
    /// Each joint at most [`SEED_DISTANCE`] away (rad).
    pub seed: JointPos<6>,
    /// The flange in the base frame, for these joints.
    pub base_from_flange: Pose,
}

/// `count` records with joints evenly spread over ±180°, or over the limits where these are narrower.
pub fn random(arm: &Arm<6>, count: usize, seed: u64) -> Vec<Record> {
    let mut random = SplitMix(seed);
    let limits: [(f64, f64); 6] = std::array::from_fn(|joint| {
        let half_turn = std::f64::consts::PI;
        (arm.position_min.0[joint].max(-half_turn), arm.position_max.0[joint].min(half_turn))
    });
    (0..count)
        .map(|_| {
            let joints = JointPos(limits.map(|(low, high)| low + (high - low) * random.unit()));
            let seed = JointPos(joints.0.map(|joint| joint + SEED_DISTANCE * (2.0 * random.unit() - 1.0)));
            Record { joints, seed, base_from_flange: arm.forward(&joints) }
        })
        .collect()
}

/// Writes them for the workers; the hash (FNV-1a, 64 bits) is over every byte.
pub fn write(path: &Path, records: &[Record]) -> io::Result<u64> {
    let mut bytes = Vec::with_capacity(records.len() * BYTES);
    for Record { joints, seed, base_from_flange: pose } in records {
        let rows = (0..3).flat_map(|row| {
            let [x, y, z] = [0, 1, 2].map(|column| pose.rotation[(row, column)]);
            [x, y, z, pose.translation[row]]
        });
        for number in joints.0.into_iter().chain(seed.0).chain(rows) {
            bytes.extend(number.to_le_bytes());
        }
    }
    fs::write(path, &bytes)?;
    Ok(bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3)))
}

/// Reads what [`write()`] wrote.
pub fn read(path: &Path) -> io::Result<Vec<Record>> {
    let bytes = fs::read(path)?;
    let (records, rest) = bytes.as_chunks::<BYTES>();
    if !rest.is_empty() {
        return Err(io::Error::other(format!("{}: {} bytes too many", path.display(), rest.len())));
    }
    Ok(records.iter().map(decode).collect())
}

fn decode(bytes: &[u8; BYTES]) -> Record {
    let number = |index: usize| {
        let mut eight = [0; 8];
        eight.copy_from_slice(&bytes[8 * index..8 * index + 8]);
        f64::from_le_bytes(eight)
    };
    let mut base_from_flange = Pose::identity();
    for row in 0..3 {
        for column in 0..3 {
            base_from_flange.rotation[(row, column)] = number(12 + 4 * row + column);
        }
        base_from_flange.translation[row] = number(15 + 4 * row);
    }
    let joints = JointPos(std::array::from_fn(number));
    Record { joints, seed: JointPos(std::array::from_fn(|joint| number(6 + joint))), base_from_flange }
}

/// Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014).
struct SplitMix(u64);

impl SplitMix {
    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
