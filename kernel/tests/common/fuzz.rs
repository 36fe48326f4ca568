//! Frames from a line that nobody can trust.

use super::{ARM, Random};
use screed_kernel::frame::{self, FrameError, Reader, ToKernel, VERSION};
use screed_kernel::tick::{Kernel, Sensors};
use screed_kernel::units::{JointPos, Nanos};

/// So many of the golden frames, the first, go to the kernel.
pub const TO_KERNEL: usize = 10;

/// The plain bytes of every whole frame in some bytes, or what was wrong with it.
pub fn read(bytes: &[u8]) -> Vec<Result<Vec<u8>, FrameError>> {
    let mut reader = Reader::new();
    bytes.iter().filter_map(|&byte| reader.push(byte).map(|frame| frame.map(<[u8]>::to_vec))).collect()
}

/// The committed bytes of version 1.0: `name: hex`, one a line.
pub fn golden() -> Vec<(String, Vec<u8>)> {
    lines(include_str!("../../golden/frames-1.0.txt"))
}

/// The committed bytes of what version 1.1 appended.
pub fn golden_1_1() -> Vec<(String, Vec<u8>)> {
    lines(include_str!("../../golden/frames-1.1.txt"))
}

fn lines(text: &str) -> Vec<(String, Vec<u8>)> {
    let line = |line: &str| {
        let (name, hex) = line.split_once(": ").unwrap();
        let byte = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
        (name.to_owned(), (0..hex.len()).step_by(2).map(byte).collect())
    };
    text.lines().filter(|line| !line.starts_with('#')).map(line).collect()
}

/// CRC-32 bit by bit.
pub fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
    })
}

/// A frame with any version and body, its CRC right, and COBS by its definition.
pub fn envelope(version: u8, body: &[u8]) -> Vec<u8> {
    let mut plain = vec![version];
    plain.extend(body);
    plain.extend(crc(&plain).to_le_bytes());
    plain.push(0);
    let mut out = Vec::new();
    for run in plain.split_inclusive(|&byte| byte == 0) {
        let mut data = &run[..run.len() - 1];
        while data.len() >= 254 {
            out.push(255);
            out.extend(&data[..254]);
            data = &data[254..];
        }
        out.push(data.len() as u8 + 1);
        out.extend(data);
    }
    out.push(0);
    out
}

/// What a fuzzed line did.
#[derive(Default)]
pub struct Fuzzed {
    /// Frames that came out of a spoilt line, whole, and are not what was sent.
    pub corrupt: u64,
    /// Whole frames with a message that is known.
    pub obeyed: u64,
    /// Frames that were broken.
    pub broken: u64,
}

/// Puts inputs of three kinds through reader, decoder and kernel: spoilt frames, garbage, and whole frames with any body.
pub fn fuzz(seed: u64, inputs: u64) -> Fuzzed {
    let mut random = Random(seed);
    let frames: Vec<Vec<u8>> = golden().into_iter().map(|(_, frame)| frame).take(TO_KERNEL).collect();
    let plain: Vec<Vec<u8>> = frames.iter().map(|frame| read(frame).remove(0).unwrap()).collect();
    let mut kernel = Box::new(Kernel::<2, 64>::new(&ARM));
    let mut reader = Reader::new();
    let mut done = Fuzzed::default();
    let mut bytes = Vec::new();
    for input in 0..inputs {
        bytes.clear();
        let of = random.below(frames.len() as u64) as usize;
        let kind = random.below(4);
        match kind {
            0 => bytes.extend((0..random.below(64)).map(|_| random.bits() as u8)),
            1 => {
                let mut body = plain[of].clone();
                for _ in 0..=random.below(3) {
                    let at = random.below(body.len() as u64) as usize;
                    body[at] = random.bits() as u8;
                }
                body.truncate(1 + random.below(2 * body.len() as u64) as usize);
                bytes = envelope(VERSION, &body);
            }
            _ => {
                bytes.extend(&frames[of]);
                for _ in 0..=random.below(4) {
                    let at = random.below(bytes.len() as u64) as usize;
                    match random.below(3) {
                        0 => bytes[at] ^= 1 << random.below(8),
                        1 => _ = bytes.remove(at),
                        _ => bytes.insert(at, random.bits() as u8),
                    }
                    if bytes.is_empty() {
                        break;
                    }
                }
                bytes.push(0);
            }
        }
        for &byte in &bytes {
            match reader.push(byte) {
                Some(Ok(message)) => {
                    done.obeyed += u64::from(frame::decode::<ToKernel>(message).is_ok());
                    done.corrupt += u64::from(kind != 1 && !plain.iter().any(|plain| plain == message));
                }
                Some(Err(_)) => done.broken += 1,
                None => {}
            }
        }
        let mut rest = bytes.as_slice();
        while !rest.is_empty() {
            let taken = kernel.receive(rest);
            rest = &rest[taken..];
            if taken == 0 || input % 8 == 0 {
                let at = kernel.status().tick as f64;
                kernel.tick(Nanos(input), &Sensors::robot(JointPos([at.sin(), 0.2]), input % 64 < 60));
                kernel.poll_transmit(&mut [0; 2048]);
            }
        }
    }
    assert!(done.obeyed > inputs / 40 && done.broken > inputs / 4, "{} obeyed, {} broken", done.obeyed, done.broken);
    done
}
