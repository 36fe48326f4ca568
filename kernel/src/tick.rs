//! One cycle: [`Kernel::receive`] takes frames, [`Kernel::tick`] moves one period on, [`Kernel::poll_transmit`] gives answers.

mod exchange;
mod obey;

pub use exchange::{Command, Corrected, Reference, Sensors};

use crate::arm::Arm;
use crate::clock::{PathClock, Played};
use crate::config::Config;
use crate::correction::{Correction, CorrectionLimits};
use crate::fault::Fault;
use crate::frame::{self, FaultReport, FrameError, FromKernel, LoopRecord, Reader, Status, ToKernel};
use crate::guard::{Differences, Periods, Violation, exceeds};
use crate::mode::{Event, Mode, StopCause};
use crate::ring::Ring;
use crate::units::{JointAcc, JointPos, JointVel, Nanos, Tick};
use obey::Incoming;

/// Most bytes taken between two ticks; what is over waits with the caller. One longest frame: the setpoints that can be
/// decoded and judged between two ticks are then those of two frames at most, one of them begun before, and still
/// forty times what is played.
pub const RECEIVE_MAX: usize = frame::WIRE_MAX;

/// Ticks between two regular [`Status`] messages.
pub const STATUS_INTERVAL: u64 = 16;

/// Most bytes of answers that wait for [`Kernel::poll_transmit`]: a buffer of this size gets whole frames only.
pub const TRANSMIT_MAX: usize = 2048;

/// The kernel of an N-joint arm with a ring of `CAP` setpoints.
#[derive(Clone, Debug)]
pub struct Kernel<const N: usize, const CAP: usize> {
    reader: Reader,
    budget: usize,
    state: State<N, CAP>,
}

#[derive(Clone, Debug)]
struct State<const N: usize, const CAP: usize> {
    arm: Arm<N>,
    config: Option<Config<N>>,
    mode: Mode,
    ring: Ring<N, CAP>,
    clock: PathClock<N>,
    /// What the clock put out last.
    path: Played<N>,
    correction: Correction<N>,
    /// What was sent last: path and correction.
    output: JointPos<N>,
    /// Whether the robot has been taking what was sent ever since it said where it is.
    known: bool,
    /// Of what was sent.
    gate: Differences<N>,
    /// Rate to play at.
    rate: f64,
    /// Whether the path waits for its correction.
    waits: bool,
    /// Minor version that the host speaks.
    minor: u8,
    incoming: Option<Incoming<N>>,
    tick: Tick,
    ticked: Option<Nanos>,
    ticks_late: u32,
    time_lost_ns: u64,
    epoch: u32,
    faults: u32,
    fault_tick: u64,
    frames_broken: u32,
    frames_unknown: u32,
    quit: bool,
    said: Option<Mode>,
    outbox: heapless::Vec<u8, TRANSMIT_MAX>,
}

impl<const N: usize, const CAP: usize> Kernel<N, CAP> {
    /// Unconfigured, with an empty ring.
    pub const fn new(arm: &Arm<N>) -> Self {
        let nowhere = JointPos::ZERO;
        Self {
            reader: Reader::new(),
            budget: RECEIVE_MAX,
            state: State {
                arm: *arm,
                config: None,
                mode: Mode::Unready,
                ring: Ring::new(),
                clock: PathClock::at_rest(nowhere, 0),
                path: Played { seq: 0, joints: nowhere, flow: 0.0, deposit: false },
                correction: Correction::none(),
                output: nowhere,
                known: false,
                gate: Differences::at_rest(nowhere),
                rate: 1.0,
                waits: false,
                minor: frame::MINOR,
                incoming: None,
                tick: Tick(0),
                ticked: None,
                ticks_late: 0,
                time_lost_ns: 0,
                epoch: 0,
                faults: 0,
                fault_tick: 0,
                frames_broken: 0,
                frames_unknown: 0,
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
            let Some(frame) = self.reader.push(byte) else { continue };
            let whole = frame.is_ok();
            match frame.and_then(frame::decode) {
                Ok(message) => self.state.obey(&message),
                Err(FrameError::Message) => self.state.frames_unknown = self.state.frames_unknown.saturating_add(1),
                Err(_) => self.state.frames_broken = self.state.frames_broken.saturating_add(1),
            }
            if whole {
                self.state.minor = self.reader.minor();
            }
        }
        taken
    }

    /// Forgets a half-received frame: a new host speaks from here on.
    pub fn host_changed(&mut self) {
        self.reader = Reader::new();
        self.state.minor = frame::MINOR;
        self.state.outbox.clear();
        self.state.drop_incoming();
    }

    /// The robot can be told nothing more, for `fault`: where it is, is no longer known, the ring is dropped, nothing is put out
    /// until a person has re-armed. Unready before, the kernel stays so: there was nothing to stop. Called again and again it
    /// takes the place of the ticks for as long as there is no robot to pace them: the host is heard and told.
    pub fn robot_lost(&mut self, fault: Fault) {
        self.budget = RECEIVE_MAX;
        let state = &mut self.state;
        if !matches!(state.mode, Mode::Unready | Mode::Faulted { .. }) {
            state.change(Event::Fault(fault));
            state.change(Event::Lost);
        }
        state.known = false;
        state.report();
    }

    /// What [`ToKernel::Quit`] does: comes to rest, then [`Self::may_quit`].
    pub fn quit(&mut self) {
        self.state.obey(&ToKernel::Quit);
    }

    /// A fault found outside the kernel: stops on the path as for one of its own. While the kernel is unready nothing is put
    /// out and nothing happens: whoever raises it keeps [`Sensors::ready`] false for as long as it lasts.
    pub fn raise(&mut self, fault: Fault) {
        self.state.change(Event::Fault(fault));
    }

    /// One cycle, begun at `now` on a monotonic clock. Bounded work, no allocation, no panic.
    pub fn tick(&mut self, now: Nanos, sensors: &Sensors<N>) -> Command<N> {
        self.tick_corrected(now, sensors, |_| Ok(Corrected { joints: sensors.correction, waits: false }))
    }

    /// The same, the correction being found by `correct` from what the path asks for at this tick ([`Sensors::correction`] says
    /// nothing then). `None` takes the correction under way out, and so does a fault, which stops as one of the kernel's own. It
    /// is not asked while the kernel is unready or faulted, nor while it stops for a fault. [`Corrected::waits`] counts while it moves.
    pub fn tick_corrected(
        &mut self,
        now: Nanos,
        sensors: &Sensors<N>,
        correct: impl FnOnce(&Reference<N>) -> Result<Corrected<N>, Fault>,
    ) -> Command<N> {
        self.budget = RECEIVE_MAX;
        let state = &mut self.state;
        state.tick.0 = state.tick.0.saturating_add(1);
        state.keep_time(now);
        state.observe(sensors);
        state.play(correct);
        state.settle();
        state.report();
        state.command()
    }

    /// Ticks since start.
    pub(crate) const fn ticks(&self) -> u64 {
        self.state.tick.0
    }

    /// What the loop around this kernel has to say; a host of 1.0 would not know it.
    pub(crate) fn say_loop(&mut self, record: LoopRecord) {
        if self.state.minor > 0 {
            self.state.say(&FromKernel::Loop(record));
        }
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

    /// What the kernel is doing.
    pub const fn mode(&self) -> &Mode {
        &self.state.mode
    }

    /// Where the kernel stands.
    pub fn status(&self) -> Status {
        self.state.status()
    }

    /// Time between ticks that the configuration asks for (ns): for a caller whose own clock paces the loop. `None` before the
    /// first.
    pub fn tick_period_ns(&self) -> Option<u64> {
        self.state.config.as_ref().map(|config| config.tick_period_ns)
    }

    /// Whether the host asked the process to end, and the arm is at rest.
    pub fn may_quit(&self) -> bool {
        self.state.quit && !matches!(self.state.mode, Mode::Moving | Mode::Stopping { .. })
    }
}

impl<const N: usize, const CAP: usize> State<N, CAP> {
    /// Counts a late tick. The path advances by one period all the same: what is lost is reported, not made up for.
    fn keep_time(&mut self, now: Nanos) {
        if let (Some(before), Some(config)) = (self.ticked.replace(now), &self.config) {
            let late = now.since(before).saturating_sub(config.tick_period_ns);
            if late > config.tick_period_ns / 2 {
                self.ticks_late = self.ticks_late.saturating_add(1);
                self.time_lost_ns = self.time_lost_ns.saturating_add(late);
            }
        }
    }

    /// Looks at the robot: is it where it should be, does it still take commands.
    fn observe(&mut self, sensors: &Sensors<N>) {
        let Some(config) = &self.config else { return };
        let (following, deviation) = (config.following_error_max, config.deviation_max);
        let far = farthest(&sensors.actual, &self.output);
        // Someone may move it now, or it stands by itself: what was sent last is no place to go back to.
        self.known &= match self.mode {
            Mode::Faulted { .. } => sensors.ready,
            Mode::Stopping { cause: StopCause::Fault(_) } => {
                sensors.ready || (sensors.actual.is_finite() && !exceeds(far.1, following))
            }
            _ => true,
        };
        let not_finite = |joints: &JointPos<N>| joints.0.iter().position(|q| !q.is_finite());
        let not_finite = not_finite(&sensors.actual).or_else(|| sensors.estimate.as_ref().and_then(not_finite));
        if let Some(joint) = not_finite {
            self.change(Event::Fault(Fault::Sensor { joint: joint as u8 }));
            return;
        }
        let estimated = sensors.estimate.map(|estimate| farthest(&estimate, &self.output));
        match self.mode {
            Mode::Unready if sensors.ready => {
                self.path = Played { seq: 0, joints: sensors.actual, flow: 0.0, deposit: false };
                self.output = sensors.actual;
                self.change(Event::Ready);
            }
            Mode::Holding if !sensors.ready => {
                self.change(Event::Lost);
            }
            Mode::Moving | Mode::Stopping { .. } if !sensors.ready => {
                self.change(Event::Fault(Fault::RobotNotReady));
            }
            Mode::Holding | Mode::Moving | Mode::Stopping { .. } => {
                if let (joint, value) = far
                    && exceeds(value, following)
                {
                    self.change(Event::Fault(Fault::Following { joint, value, limit: following }));
                } else if let Some((joint, value)) = estimated
                    && exceeds(value, deviation)
                {
                    self.change(Event::Fault(Fault::Deviation { joint, value, limit: deviation }));
                }
            }
            Mode::Unready | Mode::Faulted { .. } => {}
        }
    }

    /// Moves the path clock on, corrects what it gives, and passes that through the last gate.
    fn play(&mut self, correct: impl FnOnce(&Reference<N>) -> Result<Corrected<N>, Fault>) {
        let Some(config) = self.config.as_ref() else { return };
        let (output, periods, limits) = (config.output, config.periods, config.correction);
        if matches!(self.mode, Mode::Unready | Mode::Faulted { .. }) {
            return;
        }
        let plays = matches!(self.mode, Mode::Moving | Mode::Stopping { .. });
        if plays {
            self.path = self.clock.advance(&mut self.ring, periods.tick, periods.tick / periods.sample);
        }
        let before = self.correction;
        let wanted = match self.mode.fault() {
            None => correct(&self.reference(periods, limits, plays)),
            Some(_) => Ok(Corrected { joints: None, waits: false }),
        };
        self.waits = wanted.is_ok_and(|wanted| wanted.waits);
        if self.mode == Mode::Moving {
            self.clock.set_target(self.target());
        }
        let followed = wanted.and_then(|wanted| {
            let Some(wanted) = wanted.joints else { return Ok(false) };
            let followed = self.correction.follow(&wanted, &limits, periods.tick);
            let inside = followed.and_then(|()| self.correction.check(&self.path.joints, &config.workspace, &self.arm));
            let fault =
                |Violation { quantity, joint, value, limit }| Fault::Correction { quantity, joint, value, limit };
            inside.map(|()| true).map_err(fault)
        });
        if followed.is_err() {
            self.correction = before;
        }
        if !matches!(followed, Ok(true)) {
            self.correction.ramp_out(&limits, periods.tick);
        }
        if let Err(fault) = followed {
            self.change(Event::Fault(fault));
        }
        let joints = self.correction.applied_to(&self.path.joints);
        // What is already there needs no leave to stay: an arm that was found outside its limits may stand.
        if joints == self.output && self.gate.is_at_rest() {
            return;
        }
        match self.gate.push(&joints, &output, periods.tick) {
            Ok(()) => self.output = joints,
            Err(violation) => self.hold(violation),
        }
    }

    /// In line, so that it costs nothing where nobody asks for it.
    #[inline(always)]
    fn reference(&self, periods: Periods, limits: CorrectionLimits, plays: bool) -> Reference<N> {
        let (velocity, acceleration) =
            if plays { self.clock.motion(periods.sample) } else { (JointVel::ZERO, JointAcc::ZERO) };
        let Played { joints, deposit, .. } = self.path;
        let period = periods.tick;
        Reference { joints, velocity, acceleration, deposit, plays, correction: self.correction, limits, period }
    }

    /// The rate that the path clock goes to while the path is played.
    const fn target(&self) -> f64 {
        if self.waits { 0.0 } else { self.rate }
    }

    /// Holds the last good output: there is nothing better left to do.
    fn hold(&mut self, Violation { quantity, joint, value, limit }: Violation) {
        self.change(Event::Fault(Fault::Output { quantity, joint, value, limit }));
        self.path.joints = self.output;
        self.correction = Correction::none();
        self.gate = Differences::at_rest(self.output);
        self.stand();
    }

    /// Notices that everything has come to rest.
    fn settle(&mut self) {
        if !matches!(self.mode, Mode::Moving | Mode::Stopping { .. }) {
            return;
        }
        let stopped = self.clock.is_stopped();
        let played_out = self.is_played_out();
        let corrected = self.mode.fault().is_some() && !self.correction.is_none();
        if (stopped || played_out) && !corrected {
            self.change(if played_out { Event::PlayedOut } else { Event::AtRest });
        }
    }

    /// Whether nothing is left to play, in the ring or of what the clock has taken from it.
    fn is_played_out(&self) -> bool {
        self.ring.is_empty() && self.clock.is_played_out()
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
            if let Some(report) = self.fault() {
                self.say(&FromKernel::Fault(report.told_to(self.minor)));
            }
        }
        if matches!(event, Event::Hold | Event::Resume) {
            self.next_epoch();
        }
        match next {
            Mode::Unready => {
                self.correction = Correction::none();
                self.known = false;
                self.drop_ring();
            }
            Mode::Holding if matches!(event, Event::Ready) => {
                self.begin();
                self.known = true;
            }
            Mode::Holding if matches!(event, Event::Stop) => self.drop_ring(),
            Mode::Holding if matches!(before, Mode::Stopping { cause: StopCause::Stop }) => self.drop_ring(),
            Mode::Holding if self.is_played_out() => self.stand(),
            Mode::Faulted { .. } => self.drop_ring(),
            Mode::Moving => {
                self.clock.set_target(self.target());
            }
            Mode::Stopping { .. } => {
                self.clock.set_target(0.0);
            }
            Mode::Holding => {}
        }
        if !matches!(next, Mode::Moving | Mode::Stopping { .. }) {
            self.path.flow = 0.0;
        }
        true
    }

    /// An empty ring whose next setpoint is number 1, at rest where the output is.
    fn begin(&mut self) {
        self.path.seq = 0;
        self.drop_ring();
        self.ring.restart();
        self.gate = Differences::at_rest(self.output);
    }

    fn drop_ring(&mut self) {
        self.ring.clear();
        self.incoming = None;
        self.stand();
        self.next_epoch();
    }

    /// A resume that was decided before this has nothing more to say, however late or often the line delivers it.
    fn next_epoch(&mut self) {
        self.epoch = self.epoch.wrapping_add(1);
    }

    fn stand(&mut self) {
        self.path.flow = 0.0;
        self.clock = PathClock::at_rest(self.path.joints, self.path.seq);
    }

    fn drop_incoming(&mut self) {
        self.ring.abandon();
        self.incoming = None;
    }

    /// A status on every change of mode and regularly.
    fn report(&mut self) {
        if self.said != Some(self.mode) || self.tick.0.is_multiple_of(STATUS_INTERVAL) {
            self.said = Some(self.mode);
            let status = self.status();
            let fault = status.fault.map(|report| report.told_to(self.minor));
            self.say(&FromKernel::Status(Status { fault, ..status }));
        }
    }

    fn fault(&self) -> Option<FaultReport> {
        self.mode.fault().map(|fault| FaultReport { number: self.faults, fault, tick: self.fault_tick })
    }

    fn say(&mut self, message: &FromKernel) {
        let mut bytes = [0; 512];
        // With nobody reading, the outbox is full and the answer is dropped: a host that comes asks for the status.
        if let Ok(used) = frame::encode(message, &mut bytes)
            && used <= TRANSMIT_MAX.saturating_sub(self.outbox.len())
        {
            for &byte in bytes.iter().take(used) {
                let _ = self.outbox.push(byte);
            }
        }
    }

    fn status(&self) -> Status {
        Status {
            tick: self.tick.0,
            epoch: self.epoch,
            mode: self.mode.code(),
            fault: self.fault(),
            consumed: self.ring.consumed(),
            end_seq: self.ring.end_seq(),
            credits: self.ring.credits(),
            rate: self.clock.rate(),
            frames_broken: self.frames_broken,
            frames_unknown: self.frames_unknown,
            ticks_late: self.ticks_late,
            time_lost_ns: self.time_lost_ns,
        }
    }

    fn command(&self) -> Command<N> {
        let Played { seq, flow, deposit, .. } = self.path;
        let rate = if matches!(self.mode, Mode::Moving | Mode::Stopping { .. }) { self.clock.rate() } else { 0.0 };
        let (joints, correction) = (self.known.then_some(self.output), self.correction.offsets());
        Command { joints, path: self.path.joints, seq, flow, deposit, rate, correction, mode: self.mode }
    }
}

/// The joint in which two positions differ most, and by how much (rad or m).
fn farthest<const N: usize>(a: &JointPos<N>, b: &JointPos<N>) -> (u8, f64) {
    let distances = a.0.iter().zip(&b.0).map(|(a, b)| libm::fabs(a - b));
    (0_u8..).zip(distances).fold((0, 0.0), |far, near| if near.1 > far.1 { near } else { far })
}
