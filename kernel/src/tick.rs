//! One cycle: [`Kernel::receive`] takes frames, [`Kernel::tick`] moves one period on, [`Kernel::poll_transmit`] gives answers.

use crate::clock::{PathClock, Played};
use crate::fault::Fault;
use crate::frame::{
    self, BatchPart, Configure, FaultReport, FrameError, FromKernel, Reader, Refusal, Status, ToKernel,
};
use crate::guard::{Differences, Limits, Violation, exceeds};
use crate::mode::{Event, Mode, StopCause};
use crate::ring::{Ring, RingError};
use crate::setpoint::Coder;
use crate::units::{JointPos, Tick};

/// Most bytes taken between two ticks; what is over waits with the caller.
pub const RECEIVE_MAX: usize = 2 * frame::WIRE_MAX;

/// Ticks between two regular [`Status`] messages.
pub const STATUS_INTERVAL: u64 = 16;

const OUTBOX: usize = 2048;

/// What the robot says at one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensors<const N: usize> {
    /// Actual joint positions (rad or m).
    pub actual: JointPos<N>,
    /// Whether the robot takes setpoints now: powered, no safety stop, its program running.
    pub ready: bool,
}

/// What is to happen at this cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command<const N: usize> {
    /// Joint targets (rad or m); `None` while the robot's position is not known: then nothing may be sent.
    pub joints: Option<JointPos<N>>,
    /// The setpoint they stand for, or were interpolated behind; 0 before the first.
    pub seq: u32,
    /// Extrusion rate (m³/s).
    pub flow: f64,
    /// Whether material is being laid.
    pub deposit: bool,
    /// Path clock rate, 0 to 1.
    pub rate: f64,
    /// Mode.
    pub mode: Mode,
}

/// The kernel of an N-joint arm with a ring of `CAP` setpoints.
#[derive(Clone, Debug)]
pub struct Kernel<const N: usize, const CAP: usize> {
    reader: Reader,
    budget: usize,
    state: State<N, CAP>,
}

#[derive(Clone, Debug)]
struct State<const N: usize, const CAP: usize> {
    config: Option<Config<N>>,
    mode: Mode,
    ring: Ring<N, CAP>,
    clock: PathClock<N>,
    /// What was put out last.
    output: Played<N>,
    /// Rate to play at.
    rate: f64,
    incoming: Option<Incoming<N>>,
    tick: Tick,
    epoch: u32,
    faults: u32,
    fault_tick: u64,
    frames_broken: u32,
    quit: bool,
    said: Option<Mode>,
    outbox: heapless::Vec<u8, OUTBOX>,
}

#[derive(Clone, Copy, Debug)]
struct Config<const N: usize> {
    limits: Limits<N>,
    period: f64,
    following_error_max: f64,
}

/// A batch whose last part has not come.
#[derive(Clone, Copy, Debug)]
struct Incoming<const N: usize> {
    batch: u32,
    coder: Coder<N>,
    differences: Differences<N>,
    flow: f64,
}

impl<const N: usize, const CAP: usize> Kernel<N, CAP> {
    /// Unconfigured, with an empty ring.
    pub fn new() -> Self {
        let nowhere = JointPos::ZERO;
        Self {
            reader: Reader::new(),
            budget: RECEIVE_MAX,
            state: State {
                config: None,
                mode: Mode::Unready,
                ring: Ring::new(),
                clock: PathClock::at_rest(nowhere, 0),
                output: Played { seq: 0, joints: nowhere, flow: 0.0, deposit: false },
                rate: 1.0,
                incoming: None,
                tick: Tick(0),
                epoch: 0,
                faults: 0,
                fault_tick: 0,
                frames_broken: 0,
                quit: false,
                said: None,
                outbox: heapless::Vec::new(),
            },
        }
    }

    /// Takes bytes from the host and obeys every frame that ends in them. Returns how many were taken: at most
    /// [`RECEIVE_MAX`] between two ticks.
    pub fn receive(&mut self, bytes: &[u8]) -> usize {
        let taken = bytes.len().min(self.budget);
        self.budget -= taken;
        for &byte in bytes.iter().take(taken) {
            match self.reader.push(byte) {
                None => {}
                Some(Ok(message)) => match frame::decode(message) {
                    Ok(message) => self.state.obey(&message),
                    Err(error) => self.state.broken(error),
                },
                Some(Err(error)) => self.state.broken(error),
            }
        }
        taken
    }

    /// Forgets a half-received frame: a new host speaks from here on.
    pub fn host_changed(&mut self) {
        self.reader = Reader::new();
        self.state.outbox.clear();
        self.state.drop_incoming();
    }

    /// The link to the robot is gone: where it is, is no longer known, and the ring is dropped.
    pub fn robot_lost(&mut self) {
        self.state.change(Event::Lost);
    }

    /// What [`ToKernel::Quit`] does: comes to rest, then [`Self::may_quit`].
    pub fn quit(&mut self) {
        self.state.obey(&ToKernel::Quit);
    }

    /// A fault found outside the kernel: stops on the path as for one of its own.
    pub fn raise(&mut self, fault: Fault) {
        self.state.change(Event::Fault(fault));
    }

    /// One cycle. Bounded work, no allocation, no panic.
    pub fn tick(&mut self, sensors: &Sensors<N>) -> Command<N> {
        self.budget = RECEIVE_MAX;
        let state = &mut self.state;
        state.tick.0 += 1;
        state.observe(sensors);
        state.play();
        state.report();
        state.command()
    }

    /// Copies answers for the host into `out`, returns how many bytes.
    pub fn poll_transmit(&mut self, out: &mut [u8]) -> usize {
        let outbox = &mut self.state.outbox;
        let count = outbox.len().min(out.len());
        if let (Some(out), Some(waiting)) = (out.get_mut(..count), outbox.get(..count)) {
            out.copy_from_slice(waiting);
        }
        outbox.copy_within(count.., 0);
        outbox.truncate(outbox.len() - count);
        count
    }

    /// Where the kernel stands.
    pub fn status(&self) -> Status {
        self.state.status()
    }

    /// Whether the host asked the process to end, and the arm is at rest.
    pub fn may_quit(&self) -> bool {
        self.state.quit && !matches!(self.state.mode, Mode::Moving | Mode::Stopping { .. })
    }
}

impl<const N: usize, const CAP: usize> Default for Kernel<N, CAP> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize, const CAP: usize> State<N, CAP> {
    /// Looks at the robot: is it where it should be, does it still take commands.
    fn observe(&mut self, sensors: &Sensors<N>) {
        let Some(config) = self.config else { return };
        if let Some(joint) = sensors.actual.0.iter().position(|q| !q.is_finite()) {
            self.change(Event::Fault(Fault::Sensor { joint: joint as u8 }));
            return;
        }
        match self.mode {
            Mode::Unready if sensors.ready => {
                self.output = Played { seq: 0, joints: sensors.actual, flow: 0.0, deposit: false };
                self.change(Event::Ready);
            }
            Mode::Holding if !sensors.ready => {
                self.change(Event::Lost);
            }
            Mode::Moving | Mode::Stopping { .. } => {
                let worst = sensors.actual.0.iter().zip(&self.output.joints.0).map(|(a, b)| libm::fabs(a - b));
                let worst = worst.enumerate().fold((0, 0.0), |far, near| if near.1 > far.1 { near } else { far });
                if !sensors.ready {
                    self.change(Event::Fault(Fault::RobotNotReady));
                } else if worst.1 > config.following_error_max {
                    let (joint, value) = (worst.0 as u8, worst.1);
                    self.change(Event::Fault(Fault::Following { joint, value, limit: config.following_error_max }));
                }
            }
            _ => {}
        }
    }

    /// Moves the path clock on and passes its output through the last gate.
    fn play(&mut self) {
        let (Some(config), Mode::Moving | Mode::Stopping { .. }) = (self.config, self.mode) else { return };
        let played = self.clock.advance(&mut self.ring, config.period, 1.0);
        match gate(&played.joints, &self.output.joints, &config) {
            Ok(()) => self.output = played,
            Err((joint, value, limit)) => {
                self.change(Event::Fault(Fault::Output { joint, value, limit }));
                self.output.flow = 0.0;
            }
        }
        if self.clock.is_played_out() && self.ring.is_empty() {
            self.change(Event::PlayedOut);
        } else if self.clock.is_stopped() {
            self.change(Event::AtRest);
        }
    }

    /// The only writer of the mode; what belongs to a change is done here.
    fn change(&mut self, event: Event) -> bool {
        let Some(next) = self.mode.next(event) else { return false };
        let before = core::mem::replace(&mut self.mode, next);
        if let Event::Fault(_) = event
            && before.fault().is_none()
        {
            self.faults = self.faults.saturating_add(1);
            self.fault_tick = self.tick.0;
        }
        match next {
            Mode::Unready => self.drop_ring(),
            Mode::Holding if matches!(event, Event::Ready) => {
                self.drop_ring();
                self.ring.restart();
                self.clock = PathClock::at_rest(self.output.joints, 0);
            }
            Mode::Holding if matches!(before, Mode::Stopping { cause: StopCause::Stop }) => self.drop_ring(),
            Mode::Holding if self.clock.is_played_out() && self.ring.is_empty() => self.stand(),
            Mode::Faulted { .. } => self.drop_ring(),
            Mode::Moving => {
                self.clock.set_target(self.rate);
                self.clock.start();
            }
            Mode::Stopping { .. } => {
                self.clock.set_target(0.0);
            }
            Mode::Holding => {}
        }
        if !matches!(next, Mode::Moving | Mode::Stopping { .. }) {
            self.output.flow = 0.0;
        }
        true
    }

    fn drop_ring(&mut self) {
        self.ring.clear();
        self.incoming = None;
        self.stand();
        self.epoch = self.epoch.wrapping_add(1);
    }

    fn stand(&mut self) {
        self.output.flow = 0.0;
        self.clock = PathClock::at_rest(self.output.joints, self.output.seq);
    }

    fn drop_incoming(&mut self) {
        self.ring.abandon();
        self.incoming = None;
    }

    fn obey(&mut self, message: &ToKernel) {
        match message {
            ToKernel::Hello => {
                self.drop_incoming();
                self.said = None;
            }
            ToKernel::Configure(configure) => self.answer(0, |state| state.configure(configure)),
            ToKernel::Batch(part) => self.batch(part),
            ToKernel::Rate(rate) => self.answer(0, |state| state.set_rate(*rate)),
            ToKernel::Resume { epoch } => self.answer(0, |state| {
                if *epoch != state.epoch {
                    return Err(Refusal::Stale);
                }
                if state.ring.is_empty() && state.clock.is_played_out() {
                    return Err(Refusal::Mode);
                }
                state.request(Event::Resume)
            }),
            ToKernel::Hold => self.answer(0, |state| state.request(Event::Hold)),
            ToKernel::Stop => self.answer(0, |state| state.request(Event::Stop)),
            ToKernel::Rearm { fault } => {
                self.answer(
                    0,
                    |state| {
                        if *fault != state.faults { Err(Refusal::Stale) } else { state.request(Event::Rearm) }
                    },
                )
            }
            ToKernel::Quit => {
                self.quit = true;
                self.change(Event::Stop);
            }
        }
    }

    fn request(&mut self, event: Event) -> Result<(), Refusal> {
        if self.change(event) { Ok(()) } else { Err(Refusal::Mode) }
    }

    fn answer(&mut self, batch: u32, act: impl FnOnce(&mut Self) -> Result<(), Refusal>) {
        if let Err(reason) = act(self) {
            self.say(&FromKernel::Refused { batch, reason });
        }
    }

    fn set_rate(&mut self, rate: f64) -> Result<(), Refusal> {
        if !(0.0..=1.0).contains(&rate) {
            return Err(Refusal::Rate);
        }
        self.rate = rate;
        if self.mode == Mode::Moving {
            self.clock.set_target(rate);
        }
        Ok(())
    }

    fn configure(&mut self, configure: &Configure) -> Result<(), Refusal> {
        let holding = self.mode == Mode::Holding && self.ring.is_empty();
        if !holding && self.mode != Mode::Unready {
            return Err(Refusal::Mode);
        }
        let limits = configure.limits::<N>().ok_or(Refusal::Configuration)?;
        let positive = |values: &[f64; N]| values.iter().all(|value| value.is_finite() && *value > 0.0);
        let ordered = limits.position_min.0.iter().zip(&limits.position_max.0).all(|(low, high)| low < high);
        let valid = ordered
            && positive(&limits.velocity_max.0)
            && positive(&limits.acceleration_max.0)
            && positive(&limits.jerk_max.0)
            && limits.position_min.is_finite()
            && limits.position_max.is_finite()
            && configure.following_error_max.is_finite()
            && configure.following_error_max > 0.0
            && configure.period_ns > 0;
        if !valid {
            return Err(Refusal::Configuration);
        }
        let period = configure.period_ns as f64 * 1e-9;
        self.config = Some(Config { limits, period, following_error_max: configure.following_error_max });
        self.change(Event::Lost);
        Ok(())
    }

    fn batch(&mut self, part: &BatchPart) {
        match self.take_part(part) {
            Ok(false) => {}
            Ok(true) => {
                self.say(&FromKernel::Accepted { batch: part.batch });
                // The credits have changed.
                self.said = None;
            }
            Err(reason) => {
                self.drop_incoming();
                self.say(&FromKernel::Refused { batch: part.batch, reason });
            }
        }
    }

    /// Decodes, checks and stages one part; true when the batch is committed.
    fn take_part(&mut self, part: &BatchPart) -> Result<bool, Refusal> {
        let Some(config) = self.config else { return Err(Refusal::Mode) };
        if matches!(self.mode, Mode::Unready | Mode::Faulted { .. } | Mode::Stopping { .. }) {
            return Err(Refusal::Mode);
        }
        if part.opens {
            self.drop_incoming();
            self.ring.stage(part.first_seq, part.after)?;
            let differences = self.differences_before(part.first_seq);
            self.incoming = Some(Incoming { batch: part.batch, coder: Coder::new(), differences, flow: 0.0 });
        }
        let Some(mut incoming) = self.incoming.filter(|incoming| incoming.batch == part.batch) else {
            return Err(Refusal::Sequence);
        };
        if self.ring.staged_next() != Some(part.first_seq) {
            return Err(Refusal::Sequence);
        }
        let mut seq = part.first_seq;
        let mut code = part.code;
        while !code.is_empty() {
            let (setpoint, used) = incoming.coder.decode(code).map_err(|_| Refusal::Code)?;
            code = code.get(used..).unwrap_or(&[]);
            let does_not_fit = |Violation { quantity, joint, value, limit }| Refusal::DoesNotFit {
                seq,
                quantity,
                joint,
                value,
                limit,
            };
            incoming.differences.push(&setpoint.joints, &config.limits, config.period).map_err(does_not_fit)?;
            if exceeds(0.0, setpoint.flow) {
                return Err(Refusal::Code);
            }
            incoming.flow = setpoint.flow;
            self.ring.push(&setpoint)?;
            seq = seq.saturating_add(1);
        }
        if part.commits {
            self.check_rest(&incoming, &config, seq)?;
            self.ring.commit()?;
            self.incoming = None;
        } else {
            self.incoming = Some(incoming);
        }
        Ok(part.commits)
    }

    /// A batch ends at rest: two equal setpoints, nothing flows, and standing there on breaks no limit.
    fn check_rest(&self, incoming: &Incoming<N>, config: &Config<N>, seq: u32) -> Result<(), Refusal> {
        if !incoming.differences.is_at_rest() || incoming.flow != 0.0 {
            return Err(Refusal::NotAtRest);
        }
        let mut differences = incoming.differences;
        let last = *differences.newest();
        for _ in 0..3 {
            let Violation { quantity, joint, value, limit } =
                match differences.push(&last, &config.limits, config.period) {
                    Ok(()) => continue,
                    Err(violation) => violation,
                };
            return Err(Refusal::DoesNotFit { seq, quantity, joint, value, limit });
        }
        Ok(())
    }

    /// The three samples before the one with sequence number `first_seq`: from the ring as far as they wait there, from what
    /// the clock has taken as far as they do not.
    fn differences_before(&self, first_seq: u32) -> Differences<N> {
        let taken = self.clock.newest_three();
        let consumed = self.ring.consumed();
        let [a, b, c] = [1_u32, 2, 3].map(|back| {
            let seq = first_seq.saturating_sub(back);
            match self.ring.get(seq) {
                Some(setpoint) => setpoint.joints,
                None => taken.get(consumed.saturating_sub(seq) as usize).copied().unwrap_or(self.output.joints),
            }
        });
        Differences::after(a, b, c)
    }

    fn broken(&mut self, _: FrameError) {
        self.frames_broken = self.frames_broken.saturating_add(1);
    }

    /// A status on every change of mode and regularly.
    fn report(&mut self) {
        if self.said != Some(self.mode) || self.tick.0.is_multiple_of(STATUS_INTERVAL) {
            self.said = Some(self.mode);
            self.say(&FromKernel::Status(self.status()));
        }
    }

    fn say(&mut self, message: &FromKernel) {
        let mut bytes = [0; 512];
        // With nobody reading, the outbox is full and the answer is dropped: a host that comes asks for the status.
        if let Ok(used) = frame::encode(message, &mut bytes) {
            let _ = self.outbox.extend_from_slice(bytes.get(..used).unwrap_or(&[]));
        }
    }

    fn status(&self) -> Status {
        let report = |fault| FaultReport { number: self.faults, fault, tick: self.fault_tick };
        Status {
            tick: self.tick.0,
            epoch: self.epoch,
            mode: self.mode.code(),
            fault: self.mode.fault().map(report),
            consumed: self.ring.consumed(),
            end_seq: self.ring.end_seq(),
            credits: self.ring.credits(),
            rate: self.clock.rate(),
            frames_broken: self.frames_broken,
        }
    }

    fn command(&self) -> Command<N> {
        let known = self.mode != Mode::Unready;
        let Played { seq, joints, flow, deposit } = self.output;
        let rate = if matches!(self.mode, Mode::Moving | Mode::Stopping { .. }) { self.clock.rate() } else { 0.0 };
        Command { joints: known.then_some(joints), seq, flow, deposit, rate, mode: self.mode }
    }
}

impl From<RingError> for Refusal {
    fn from(error: RingError) -> Self {
        match error {
            RingError::Full => Self::Full,
            RingError::TooLate => Self::TooLate,
            RingError::Sequence => Self::Sequence,
        }
    }
}

/// The last gate: finite, inside the positions, no step beyond the speed limit.
fn gate<const N: usize>(next: &JointPos<N>, last: &JointPos<N>, config: &Config<N>) -> Result<(), (u8, f64, f64)> {
    let limits = &config.limits;
    for (joint, (&q, &before)) in next.0.iter().zip(&last.0).enumerate() {
        let at = |values: &[f64; N]| values.get(joint).copied().unwrap_or(0.0);
        let speed = libm::fabs(q - before) / config.period;
        if exceeds(at(&limits.position_min.0), q) {
            return Err((joint as u8, q, at(&limits.position_min.0)));
        }
        if exceeds(q, at(&limits.position_max.0)) {
            return Err((joint as u8, q, at(&limits.position_max.0)));
        }
        // Interpolation between samples may pass a chord's speed by the acceleration within one period.
        let allowed = at(&limits.velocity_max.0) + at(&limits.acceleration_max.0) * config.period;
        if exceeds(speed, allowed) {
            return Err((joint as u8, speed, allowed));
        }
    }
    Ok(())
}
