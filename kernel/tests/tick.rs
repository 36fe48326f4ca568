//! The kernel through its three functions: bytes in, ticks, bytes out.

use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, BatchPart, Configure, FromKernel, ModeCode, Reader, Refusal, Status, ToKernel};
use screed_kernel::guard::Quantity;
use screed_kernel::setpoint::{Coder, Setpoint, joint_on_grid};
use screed_kernel::tick::{Command, Kernel, Sensors};
use screed_kernel::units::JointPos;

const PERIOD: f64 = 0.002;

struct Bench {
    kernel: Kernel<2, 2048>,
    reader: Reader,
    answers: Vec<FromKernel>,
    actual: JointPos<2>,
    ready: bool,
    batches: u32,
}

impl Bench {
    /// Configured and holding at (0.1, 0.2).
    fn new() -> Self {
        let mut bench = Self {
            kernel: Kernel::new(),
            reader: Reader::new(),
            answers: Vec::new(),
            actual: JointPos([0.1, 0.2].map(joint_on_grid)),
            ready: true,
            batches: 0,
        };
        let both = |value: f64| [value; 2].into_iter().collect();
        bench.say(&ToKernel::Configure(Configure {
            period_ns: 2_000_000,
            position_min: both(-3.0),
            position_max: both(3.0),
            velocity_max: both(2.0),
            acceleration_max: both(20.0),
            jerk_max: both(2000.0),
            following_error_max: 0.05,
        }));
        bench.tick();
        assert_eq!(bench.status().mode, ModeCode::Holding);
        bench
    }

    fn say(&mut self, message: &ToKernel) {
        let mut out = [0; frame::WIRE_MAX];
        let used = frame::encode(message, &mut out).unwrap();
        let mut taken = self.kernel.receive(&out[..used]);
        while taken < used {
            self.tick();
            taken += self.kernel.receive(&out[taken..used]);
        }
        self.listen();
    }

    fn listen(&mut self) {
        let mut out = [0; 4096];
        let used = self.kernel.poll_transmit(&mut out);
        for &byte in &out[..used] {
            if let Some(message) = self.reader.push(byte) {
                self.answers.push(frame::decode(message.unwrap()).unwrap());
            }
        }
    }

    fn tick(&mut self) -> Command<2> {
        let command = self.kernel.tick(&Sensors { actual: self.actual, ready: self.ready });
        if let Some(joints) = command.joints {
            self.actual = joints;
        }
        self.listen();
        command
    }

    fn status(&self) -> Status {
        self.kernel.status()
    }

    /// Sends setpoints as one batch in parts of 40 and returns the answer to it.
    fn batch(&mut self, first_seq: u32, after: Option<u32>, setpoints: &[Setpoint<2>]) -> Option<Refusal> {
        self.batches += 1;
        let batch = self.batches;
        let mut coder = Coder::new();
        let parts = setpoints.chunks(40).count();
        for (k, part) in setpoints.chunks(40).enumerate() {
            let mut code = vec![0; 40 * part.len()];
            let mut used = 0;
            for setpoint in part {
                used += coder.encode(setpoint, &mut code[used..]).unwrap();
            }
            self.say(&ToKernel::Batch(BatchPart {
                batch,
                first_seq: first_seq + 40 * k as u32,
                opens: k == 0,
                commits: k + 1 == parts,
                after: after.filter(|_| k == 0),
                code: &code[..used],
            }));
        }
        self.answers.iter().find_map(|answer| match answer {
            FromKernel::Accepted { batch: b } if *b == batch => Some(None),
            FromKernel::Refused { batch: b, reason } if *b == batch => Some(Some(*reason)),
            _ => None,
        })?
    }

    fn resume(&mut self) {
        let epoch = self.status().epoch;
        self.say(&ToKernel::Resume { epoch });
    }
}

/// A smooth move from a to b in n samples (minimum jerk), then still.
fn sweep(a: f64, b: f64, n: usize) -> Vec<Setpoint<2>> {
    let at = |k: usize| {
        let t = (k as f64 / n as f64).min(1.0);
        a + (b - a) * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
    };
    (1..=n + 2)
        .map(|k| Setpoint { joints: JointPos([at(k), at(k) + 0.1].map(joint_on_grid)), flow: 0.0, deposit: false })
        .collect()
}

#[test]
fn a_batch_is_played_sample_by_sample_and_ends_holding() {
    let mut bench = Bench::new();
    let motion = sweep(0.1, 0.6, 500);
    assert_eq!(bench.batch(1, None, &motion), None);
    assert_eq!(bench.status().mode, ModeCode::Holding, "nothing moves before a person says so");
    bench.resume();
    let mut heard = Vec::new();
    for _ in 0..600 {
        let command = bench.tick();
        if command.seq > heard.len() as u32 {
            heard.push(command.joints.unwrap());
        }
    }
    assert_eq!(heard, motion.iter().map(|s| s.joints).collect::<Vec<_>>());
    assert_eq!((bench.status().mode, bench.status().consumed), (ModeCode::Holding, 502));
}

#[test]
fn replacing_after_a_setpoint_joins_smoothly_or_is_refused() {
    let mut bench = Bench::new();
    let long = sweep(0.1, 0.8, 1000);
    // The first batch stops short: the same path, slowed to rest from sample 300 on by a tail of its own.
    let tail: Vec<_> = (0..400)
        .map(|k| {
            let u = (f64::from(k) / 380.0).min(1.0);
            let time = 300.0 + 380.0 * (u - u * u * u + 0.5 * u * u * u * u);
            let (whole, part) = (time.floor() as usize, time.fract());
            let blend = |j: usize| long[whole].joints.0[j] * (1.0 - part) + long[whole + 1].joints.0[j] * part;
            Setpoint { joints: JointPos([blend(0), blend(1)].map(joint_on_grid)), flow: 0.0, deposit: false }
        })
        .collect();
    let first: Vec<_> = long[..300].iter().copied().chain(tail).collect();
    assert_eq!(bench.batch(1, None, &first), None);
    bench.resume();
    for _ in 0..200 {
        bench.tick();
    }
    // One sample left out: a step at the seam.
    let step = bench.batch(301, Some(300), &long[301..]);
    assert!(matches!(step, Some(Refusal::DoesNotFit { seq: 301, quantity: Quantity::Acceleration, .. })), "{step:?}");
    assert_eq!(bench.batch(302, Some(300), &long[300..]), Some(Refusal::Sequence));
    assert_eq!(bench.batch(151, Some(150), &long[150..]), Some(Refusal::TooLate));
    assert_eq!(bench.batch(301, Some(300), &long[300..]), None);
    let mut last = bench.tick();
    for _ in 0..900 {
        last = bench.tick();
    }
    assert_eq!((last.joints, last.seq), (Some(long[1001].joints), 1002));
}

#[test]
fn a_batch_that_breaks_a_limit_or_does_not_end_at_rest_is_refused_whole() {
    let mut bench = Bench::new();
    let motion = sweep(0.1, 0.6, 500);
    assert_eq!(bench.batch(1, None, &motion[..400]), Some(Refusal::NotAtRest));
    let fast = bench.batch(1, None, &sweep(0.1, 0.6, 100));
    assert!(
        matches!(fast, Some(Refusal::DoesNotFit { quantity: Quantity::Jerk | Quantity::Acceleration, .. })),
        "{fast:?}"
    );
    let mut flowing = motion.clone();
    flowing.last_mut().unwrap().flow = 1e-6;
    assert_eq!(bench.batch(1, None, &flowing), Some(Refusal::NotAtRest));
    assert_eq!((bench.status().end_seq, bench.status().credits), (0, 2048));
    assert_eq!(bench.batch(1, None, &motion), None);
}

#[test]
fn hold_rests_within_a_second_on_the_path_and_resume_plays_on() {
    let mut bench = Bench::new();
    let motion = sweep(0.1, 0.6, 1000);
    assert_eq!(bench.batch(1, None, &motion), None);
    bench.resume();
    for _ in 0..400 {
        bench.tick();
    }
    bench.say(&ToKernel::Hold);
    let mut ticks = 0;
    while bench.status().mode == ModeCode::Stopping {
        bench.tick();
        ticks += 1;
    }
    assert!(f64::from(ticks) * PERIOD < 1.0, "{ticks}");
    let held = bench.tick().joints.unwrap();
    assert!((held.0[1] - held.0[0] - 0.1).abs() < 1e-9, "both joints stand at the same place of the path");
    bench.say(&ToKernel::Resume { epoch: bench.status().epoch + 1 });
    assert_eq!(bench.status().mode, ModeCode::Holding, "a command that speaks of another ring");
    bench.resume();
    for _ in 0..1500 {
        bench.tick();
    }
    assert_eq!(bench.actual, motion.last().unwrap().joints);
}

#[test]
fn an_arm_that_does_not_follow_is_a_fault_and_only_a_fresh_command_leads_on() {
    let mut bench = Bench::new();
    assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 500)), None);
    bench.resume();
    let stuck = bench.actual;
    for _ in 0..1000 {
        bench.tick();
        bench.actual = stuck;
    }
    let report = bench.status().fault.unwrap();
    assert!(matches!(report.fault, Fault::Following { limit: 0.05, .. }));
    assert_eq!(bench.status().mode, ModeCode::Faulted);
    bench.say(&ToKernel::Rearm { fault: report.number + 1 });
    assert_eq!(bench.status().mode, ModeCode::Faulted);
    bench.say(&ToKernel::Rearm { fault: report.number });
    let command = bench.tick();
    assert_eq!((bench.status().mode, command.joints), (ModeCode::Holding, Some(stuck)));
    assert_eq!(bench.status().end_seq, 0, "the ring is gone");
}

#[test]
fn a_robot_that_is_not_ready_is_sent_nothing_and_stops_a_motion() {
    let mut bench = Bench::new();
    assert_eq!(bench.batch(1, None, &sweep(0.1, 0.6, 500)), None);
    bench.resume();
    for _ in 0..200 {
        bench.tick();
    }
    bench.ready = false;
    for _ in 0..600 {
        bench.tick();
    }
    assert_eq!(bench.status().fault.map(|report| report.fault), Some(Fault::RobotNotReady));
    let mut idle = Bench::new();
    idle.ready = false;
    assert_eq!(idle.tick().joints, None);
}
