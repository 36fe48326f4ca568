//! What the kernel's tests share: seeded numbers, a small arm, and a kernel with a host's two ends of the line.
#![allow(dead_code)] // Each test takes what it needs.

pub mod base;
pub mod dense;
pub mod estimation;
pub mod fuzz;
pub mod inverse;
pub mod literal;
pub mod motion;
pub mod plant;
pub mod program;
pub mod rival;
pub mod wrist;

use screed_kernel::arm::{Arm, Dh, Joint, Rating};
use screed_kernel::correction::CorrectionLimits;
use screed_kernel::frame::{
    self, BatchPart, Configure, FaultReport, FromKernel, JointValues, ModeCode, MotionLimits, Reader, Refusal, Status,
    ToKernel,
};
use screed_kernel::guard::{Motion, Periods, output_least};
use screed_kernel::setpoint::{Coder, Setpoint, joint_on_grid};
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::{JointAcc, JointJerk, JointPos, JointVel, Nanos};

/// SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014).
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, bound: u64) -> u64 {
        self.bits() % bound
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

const LINK: Dh = Dh { theta: 0.0, d: 0.0, a: 0.5, sin_alpha: 0.0, cos_alpha: 1.0 };

/// Two links of half a metre in a plane.
pub const ARM: Arm<2> = Arm {
    name: "planar",
    base_from_zero: None,
    dh: [LINK, LINK],
    joints: [Joint::REVOLUTE; 2],
    last_from_flange: None,
    position_min: JointPos([-3.0; 2]),
    position_max: JointPos([3.0; 2]),
    velocity_max: Rating::Known(JointVel([3.0; 2])),
    acceleration_max: Rating::Unknown,
};

/// The same value for every joint.
pub fn both(value: f64) -> JointValues {
    [value; 2].into_iter().collect()
}

/// What plans may ask of the small arm.
pub const PLAN: Motion<2> = Motion {
    velocity_max: JointVel([2.0; 2]),
    acceleration_max: JointAcc([20.0; 2]),
    jerk_max: JointJerk([2000.0; 2]),
};

/// A configuration with just enough room for outputs.
pub fn configure(plan: &Motion<2>, sample_ns: u64, tick_ns: u64, correction: CorrectionLimits) -> Configure {
    let periods = Periods { sample: sample_ns as f64 * 1e-9, tick: tick_ns as f64 * 1e-9 };
    Configure {
        sample_period_ns: sample_ns,
        tick_period_ns: tick_ns,
        position_min: both(-3.0),
        position_max: both(3.0),
        plan: MotionLimits::from(plan),
        output: MotionLimits::from(&output_least(plan, periods, &correction)),
        following_error_max: 0.05,
        deviation_max: 0.04,
        correction,
        flange_from_tcp: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
        workspace: heapless::Vec::new(),
    }
}

/// A kernel, and what is at both ends of its line.
#[derive(Clone)]
pub struct Bench<const CAP: usize> {
    pub kernel: Box<Kernel<2, CAP>>,
    pub reader: Reader,
    pub answers: Vec<FromKernel>,
    /// Every fault as it was told.
    pub faults: Vec<FaultReport>,
    pub sensors: Sensors<2>,
    pub now: Nanos,
    pub tick_ns: u64,
    pub batches: u32,
}

impl<const CAP: usize> Bench<CAP> {
    /// Configured and holding at (0.1, 0.2).
    pub fn new(configure: Configure) -> Self {
        let at = JointPos([0.1, 0.2].map(joint_on_grid));
        let mut bench = Self {
            kernel: Box::new(Kernel::new(&ARM)),
            reader: Reader::new(),
            answers: Vec::new(),
            faults: Vec::new(),
            sensors: Sensors::robot(at, true),
            now: Nanos(0),
            tick_ns: configure.tick_period_ns,
            batches: 0,
        };
        bench.say(&ToKernel::Configure(configure));
        assert_eq!(bench.answers, []);
        bench.tick();
        assert_eq!(bench.status().mode, ModeCode::Holding);
        bench
    }

    pub fn say(&mut self, message: &ToKernel) {
        let mut out = [0; frame::WIRE_MAX];
        let used = frame::encode(message, &mut out).unwrap();
        self.send(&out[..used]);
    }

    pub fn send(&mut self, bytes: &[u8]) {
        let mut taken = self.kernel.receive(bytes);
        while taken < bytes.len() {
            self.tick();
            taken += self.kernel.receive(&bytes[taken..]);
        }
        self.listen();
    }

    pub fn listen(&mut self) {
        let mut out = [0; 4096];
        let used = self.kernel.poll_transmit(&mut out);
        for &byte in &out[..used] {
            if let Some(message) = self.reader.push(byte) {
                match frame::decode(message.unwrap()).unwrap() {
                    FromKernel::Fault(report) => self.faults.push(report),
                    answer => self.answers.push(answer),
                }
            }
        }
    }

    /// One tick on time; the robot then is where it was told to be.
    pub fn tick(&mut self) -> Command<2> {
        self.now = self.now.plus(self.tick_ns);
        let command = self.kernel.tick(self.now, &self.sensors);
        if let Some(joints) = command.joints {
            self.sensors.actual = joints;
        }
        self.listen();
        command
    }

    pub fn status(&self) -> Status {
        self.kernel.status()
    }

    /// Setpoints as the frames of one batch, in parts of 40.
    pub fn frames(&mut self, first_seq: u32, after: Option<u32>, setpoints: &[Setpoint<2>]) -> Vec<Vec<u8>> {
        self.batches += 1;
        let batch = self.batches;
        let mut coder = Coder::new();
        let parts = setpoints.chunks(40).count();
        let frames = setpoints.chunks(40).enumerate().map(|(k, part)| {
            let mut code = [0; frame::CODE_MAX];
            let mut used = 0;
            for setpoint in part {
                used += coder.encode(setpoint, &mut code[used..]).unwrap();
            }
            let mut out = [0; frame::WIRE_MAX];
            let part = BatchPart {
                batch,
                first_seq: first_seq + 40 * k as u32,
                opens: k == 0,
                commits: k + 1 == parts,
                after: after.filter(|_| k == 0),
                code: &code[..used],
            };
            let used = frame::encode(&ToKernel::Batch(part), &mut out).unwrap();
            out[..used].to_vec()
        });
        frames.collect()
    }

    /// The answer to the batch sent last: taken, or why its first bad part was refused (those behind are refused again).
    pub fn answer(&self) -> Option<Result<(), Refusal>> {
        let taken = self.answers.contains(&FromKernel::Accepted { batch: self.batches });
        let refused = self.answers.iter().find_map(|answer| match answer {
            FromKernel::Refused { batch, reason } if *batch == self.batches => Some(Err(*reason)),
            _ => None,
        });
        if taken { Some(Ok(())) } else { refused }
    }

    /// Sends setpoints as one batch and returns the answer to it.
    pub fn batch(&mut self, first_seq: u32, after: Option<u32>, setpoints: &[Setpoint<2>]) -> Option<Refusal> {
        for frame in self.frames(first_seq, after, setpoints) {
            self.send(&frame);
        }
        self.answer().expect("an answer").err()
    }

    pub fn resume(&mut self) {
        let epoch = self.status().epoch;
        self.say(&ToKernel::Resume { epoch });
    }

    /// The refusal of the message said last, if it was refused.
    pub fn refusal(&mut self) -> Option<Refusal> {
        let refusal = self.answers.iter().rev().find_map(|answer| match answer {
            FromKernel::Refused { batch: 0, reason } => Some(*reason),
            _ => None,
        });
        self.answers.clear();
        refusal
    }
}

/// A smooth move from a to b in n samples (minimum jerk), then still.
pub fn sweep(a: f64, b: f64, n: usize) -> Vec<Setpoint<2>> {
    let at = |k: usize| {
        let t = (k as f64 / n as f64).min(1.0);
        a + (b - a) * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
    };
    (1..=n + 2)
        .map(|k| Setpoint { joints: JointPos([at(k), at(k) + 0.1].map(joint_on_grid)), flow: 0.0, deposit: false })
        .collect()
}
