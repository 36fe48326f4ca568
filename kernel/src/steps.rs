//! Counts, in tests, how often the loops over a host's bytes turn: the work for a byte is bounded, whoever sends it.

extern crate std;

use crate::arm::{Arm, Dh, Joint, Rating};
use crate::correction::CorrectionLimits;
use crate::frame::{self, BatchPart, CODE_MAX, Configure, FRAME_MAX, MotionLimits, ToKernel, WIRE_MAX};
use crate::guard::{Motion, Periods, output_least};
use crate::setpoint::{Coder, Setpoint};
use crate::tick::{Kernel, RECEIVE_MAX, Sensors};
use crate::units::{JointAcc, JointJerk, JointPos, JointVel, Nanos};
use std::cell::Cell;
use std::vec::Vec;

std::thread_local! {
    static STEPS: Cell<usize> = const { Cell::new(0) };
}

/// One turn of a loop.
pub(crate) fn count() {
    STEPS.set(STEPS.get() + 1);
}

/// Turns of a loop for one byte at most: one to unstuff it; and of a setpoint of 2 joints, which takes 4 bytes at least, one
/// for itself, four for its joints (decoded, judged), one for each of its numbers' bytes.
const STEPS_A_BYTE: usize = 3;

const LINK: Dh = Dh { theta: 0.0, d: 0.0, a: 0.5, sin_alpha: 0.0, cos_alpha: 1.0 };
const ARM: Arm<2> = Arm {
    name: "planar",
    base_from_zero: None,
    dh: [LINK; 2],
    joints: [Joint::REVOLUTE; 2],
    last_from_flange: None,
    position_min: JointPos([-3.0; 2]),
    position_max: JointPos([3.0; 2]),
    velocity_max: Rating::Known(JointVel([3.0; 2])),
    acceleration_max: Rating::Unknown,
};

fn wire(message: &ToKernel) -> Vec<u8> {
    let mut out = [0; WIRE_MAX];
    let used = frame::encode(message, &mut out).unwrap();
    out[..used].to_vec()
}

fn configure() -> Configure {
    let plan = Motion {
        velocity_max: JointVel([2.0; 2]),
        acceleration_max: JointAcc([20.0; 2]),
        jerk_max: JointJerk([2000.0; 2]),
    };
    let both = |value: f64| [value; 2].into_iter().collect();
    let periods = Periods { sample: 0.002, tick: 0.002 };
    Configure {
        sample_period_ns: 2_000_000,
        tick_period_ns: 2_000_000,
        position_min: both(-3.0),
        position_max: both(3.0),
        plan: MotionLimits::from(&plan),
        output: MotionLimits::from(&output_least(&plan, periods, &CorrectionLimits::NONE)),
        following_error_max: 0.1,
        deviation_max: 0.1,
        correction: CorrectionLimits::NONE,
        flange_from_tcp: [0.0; 6],
        workspace: heapless::Vec::new(),
    }
}

/// Setpoints at rest take the fewest bytes: as many of them as one frame holds, again and again.
fn densest(batch: u32, opens: bool, first_seq: u32) -> (Vec<u8>, u32) {
    let (mut coder, mut code, mut used, mut count) = (Coder::<2>::new(), [0; CODE_MAX], 0, 0);
    while let Ok(length) = coder.encode(&Setpoint::ZERO, &mut code[used..]) {
        (used, count) = (used + length, count + 1);
    }
    let part = BatchPart { batch, first_seq, opens, commits: false, after: None, code: &code[..used] };
    (wire(&ToKernel::Batch(part)), count)
}

#[test]
fn no_stream_of_bytes_takes_more_steps_than_three_a_byte() {
    let mut noise = 1_u64;
    let mut random = move || {
        noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (noise >> 56) as u8
    };
    let (dense, count) = densest(1, true, 1);
    assert!(count as usize >= CODE_MAX / 4);
    let (mut parts, mut next) = (Vec::new(), 1);
    for k in 0..40 {
        let (part, count) = densest(1, k == 0, next);
        parts.extend(part);
        next += count;
    }
    let streams: [Vec<u8>; 7] = [
        std::vec![0; 20_000],
        std::vec![1; 20_000],
        std::vec![255; 20_000],
        (0..20_000).map(|_| random()).collect(),
        wire(&ToKernel::Hello).repeat(2000),
        dense.repeat(20),
        parts,
    ];
    let mut most = 0.0_f64;
    for stream in streams {
        let mut kernel = std::boxed::Box::new(Kernel::<2, 16_384>::new(&ARM));
        kernel.receive(&wire(&ToKernel::Configure(configure())));
        kernel.tick(Nanos(0), &Sensors::robot(JointPos::ZERO, true));
        let mut rest = stream.as_slice();
        while !rest.is_empty() {
            STEPS.set(0);
            let taken = kernel.receive(rest);
            rest = &rest[taken..];
            let steps = STEPS.get();
            // A frame that began before this tick is decoded in it.
            assert!(taken <= RECEIVE_MAX && steps <= STEPS_A_BYTE * (taken + FRAME_MAX), "{steps} for {taken}");
            kernel.tick(Nanos(0), &Sensors::robot(JointPos::ZERO, true));
            kernel.poll_transmit(&mut [0; 2048]);
            most = most.max(steps as f64 / taken as f64);
        }
    }
    assert!(most > 2.5, "the densest stream does not come near the bound: {most}");
}
