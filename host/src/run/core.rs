//! What `screed-rt` does in a cycle, without sockets and clocks: robot, host and extruder bytes in, bytes for all three out.
//! The timed process and virtual time both drive this one machine.

mod depth;
mod outage;
pub mod readiness;
mod to_host;

use crate::config::kernel::{CellLoopError, DEPTH};
use crate::config::{Cell, Pacing};
use crate::link::cycles::Counts;
use crate::link::extruder::{ExtruderError, ExtruderLine};
use crate::link::{Event, LinkError, RobotLink, Telegram};
use crate::run::memory::Memory;
use crate::run::overruns::Overruns;
use depth::Depth;
use outage::Link;
use readiness::{Obstacle, Readiness};
use screed_kernel::closed_loop::ClosedLoop;
use screed_kernel::control::Report;
use screed_kernel::estimator::{POSES_MAX, Robot, TrackerPose};
use screed_kernel::fault::Fault;
use screed_kernel::frame::{self, CycleRecord, Cycles, FromKernel, NOTE_MAX, Pace, Status};
use screed_kernel::tick::{Command, Kernel, Sensors, TRANSMIT_MAX};
use screed_kernel::units::Nanos;
use to_host::{ToHost, shorten};

/// Setpoints the ring holds: 8 s at 500 Hz.
pub const RING: usize = 4096;

/// Why there is no such machine for a cell.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CoreError {
    /// The link.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The extruder's line.
    #[error(transparent)]
    Extruder(#[from] ExtruderError),
    /// The loop.
    #[error("the lead cannot be: {0:?}; correct [lead] and [link] in the cell file")]
    Lead(CellLoopError),
    /// A tracker without a link.
    #[error(
        "the cell has a tracker, and Screed has no link to one yet: nothing would be corrected by it; take [tracker], [shift], \
         [estimator] and the [control] sections out of the cell file to print with the lead alone"
    )]
    Tracker,
}

/// What the process around it has met with since it started, for the account.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Writes to the robot that its line did not take whole at once.
    pub writes_blocked: u64,
    /// Segments that TCP sent to the robot again.
    pub segments_resent: u64,
    /// What was taken from memory since the loop began.
    pub memory: Memory,
}

/// A slot in which the robot is to be answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// When it began: what the robot sent lay ready, or the timer's point was due.
    pub began: Nanos,
    /// Points of the timer's grid that passed before it; 0 where the robot paces.
    pub missed: u32,
    /// Whether the line to the robot has taken all that was sent before.
    pub line_free: bool,
}

/// The real-time process as a state machine.
#[derive(Clone)]
pub struct Core {
    kernel: Box<Kernel<6, RING>>,
    /// Where the cell wants the servo's lag compensated.
    lead: Option<Box<ClosedLoop<6, DEPTH>>>,
    /// What the tracker has said since the last cycle.
    poses: heapless::Vec<TrackerPose, POSES_MAX>,
    /// What was commanded last, and what the loop says of it.
    command: Option<(Command<6>, Report)>,
    robot: RobotLink,
    link: Link,
    extruder: ExtruderLine,
    host: ToHost,
    /// The present cycle, until its answer is sent.
    record: Option<CycleRecord>,
    /// Counts packages to the robot: its program takes a setpoint whenever this changes.
    package: u32,
    /// How many answers are on their way when a telegram comes.
    depth: Depth,
    /// Whose telegrams or points the slots are.
    pacing: Pacing,
    /// What the robot said last, and whether it is new.
    heard: Option<Telegram>,
    fresh: bool,
    /// Slots since the last cycle that went without an answer, and those of them for which this machine is not to blame.
    missed: u32,
    excused: u32,
    /// Whether the last answer left less than a period after its slot's beginning.
    prompt: bool,
    period_ns: u64,
    overruns: Overruns,
    usage: Usage,
    /// When the present cycle's slot began.
    began: Nanos,
    realtime: bool,
    note: heapless::String<NOTE_MAX>,
    extruder_failed: bool,
    readiness: Readiness,
}

impl Core {
    /// Ready to negotiate with the robot. `realtime` and `note` say what scheduling the process got.
    ///
    /// # Errors
    /// [`CoreError`] when the cell's link or extruder line cannot be, and for a cell with a tracker.
    pub fn new(cell: &Cell, realtime: bool, note: &str) -> Result<Self, CoreError> {
        match cell.tracked {
            Some(_) => Err(CoreError::Tracker),
            None => Self::tracked(cell, realtime, note),
        }
    }

    /// The same for whoever has a tracker's poses to give it: [`Self::on_tracker`].
    ///
    /// # Errors
    /// [`CoreError`] when the cell's link, extruder line or loop cannot be.
    pub fn tracked(cell: &Cell, realtime: bool, note: &str) -> Result<Self, CoreError> {
        let timeout_ns = (cell.link.timeout * 1e9) as u64;
        Ok(Self {
            kernel: Box::new(Kernel::new(&cell.robot.arm)),
            lead: cell.closed_loop().map_err(CoreError::Lead)?.map(Box::new),
            poses: heapless::Vec::new(),
            command: None,
            robot: RobotLink::new(cell)?,
            link: Link::default(),
            extruder: ExtruderLine::new(cell.extruder.flow_max, timeout_ns)?,
            host: ToHost::new(),
            record: None,
            package: 0,
            depth: Depth::default(),
            pacing: cell.realtime.pacing,
            heard: None,
            fresh: false,
            missed: 0,
            excused: 0,
            prompt: false,
            period_ns: 1_000_000_000 / u64::from(cell.link.rate_hz),
            overruns: Overruns::new(cell.realtime.overruns_max),
            usage: Usage::default(),
            began: Nanos(0),
            realtime,
            note: shorten(note),
            extruder_failed: false,
            readiness: Readiness::default(),
        })
    }

    /// Bytes from the robot, as many times as there are some; [`Self::answer`] is to follow.
    ///
    /// # Errors
    /// [`LinkError`]: the link is down. The host has been told and nothing more is sent to the robot; what comes on the old
    /// connection is no longer heard. See [`Self::may_reconnect`].
    pub fn on_robot(&mut self, now: Nanos, bytes: &[u8]) -> Result<(), LinkError> {
        if self.link.is_down() {
            return Ok(());
        }
        let result = self.robot.handle_bytes(now, bytes);
        while let Some(event) = self.robot.poll_event() {
            match event {
                Event::Running => self.link_is_up(now),
                Event::Telegram { telegram, skipped } if result.is_ok() => {
                    // By the timer's clock nothing is missed here; and before the first cycle nothing is.
                    if self.pacing == Pacing::Robot && self.command.is_some() {
                        self.missed += skipped + u32::from(self.fresh);
                    }
                    (self.heard, self.fresh) = (Some(telegram), true);
                }
                Event::Telegram { .. } => {}
                Event::Text(text) => self.host.alarm(false, &format_args!("the controller says: {text}")),
            }
        }
        self.check(now, result)
    }

    /// The cycle of a slot, if it is one to answer in. Where the robot paces, that is one with a new state, the newest of all
    /// that [`Self::on_robot`] took; else each, once the robot has said where it is.
    ///
    /// # Errors
    /// As [`Self::on_robot`].
    pub fn answer(&mut self, now: Nanos, slot: Slot) -> Result<(), LinkError> {
        let fresh = std::mem::take(&mut self.fresh);
        let Some(heard) = self.heard else { return Ok(()) };
        let late = match self.pacing {
            Pacing::Robot if !fresh => return Ok(()),
            // This process was late with the answer before, and the robot made this telegram without it. Another answer now
            // could overwrite that one in the robot's registers: a waypoint would be lost.
            Pacing::Robot => {
                heard.arrived.is_some_and(|arrived| self.depth.is_deeper(self.package.wrapping_sub(arrived)))
            }
            // States come by the robot's clock, which is none here.
            Pacing::Timer => {
                self.missed = self.missed.saturating_add(slot.missed);
                false
            }
        };
        // Nor is anything sent behind what the line has not taken: it would come late, and in a bunch.
        if late || !slot.line_free {
            // An answer that left in time and has not arrived, or a line that takes nothing: not this machine was late.
            self.excused += u32::from(!slot.line_free || (self.prompt && self.missed == 0));
            self.missed += 1;
            return Ok(());
        }
        self.began = slot.began;
        let result = self.cycle(now, &heard);
        self.check(now, result)
    }

    /// The robot closed the connection, or it broke.
    ///
    /// # Errors
    /// As [`Self::on_robot`].
    pub fn on_robot_closed(&mut self, now: Nanos) -> Result<(), LinkError> {
        if self.link.is_down() {
            return Ok(());
        }
        let error = self.robot.handle_closed();
        self.check(now, Err(error))
    }

    /// Time has passed: notices a silent robot and a silent extruder. Without a robot the host is heard and told here.
    ///
    /// # Errors
    /// As [`Self::on_robot`].
    pub fn on_time(&mut self, now: Nanos) -> Result<(), LinkError> {
        let extruder = self.extruder.handle_timeout(now);
        self.check_extruder(extruder);
        self.stand_in(now);
        if self.link.is_down() {
            return Ok(());
        }
        let robot = self.robot.handle_timeout(now);
        self.check(now, robot)
    }

    /// When [`Self::on_time`] wants to be called.
    pub fn deadline(&self) -> Option<Nanos> {
        let robot = self.robot.poll_timeout().filter(|_| !self.link.is_down());
        [robot, self.link.next_beat(), self.extruder.poll_timeout()].into_iter().flatten().min()
    }

    /// Bytes from the host; returns how many were taken. The rest waits for the next cycle.
    pub fn on_host(&mut self, bytes: &[u8]) -> usize {
        self.kernel.receive(bytes)
    }

    /// A host has attached: what it hears begins with a whole frame.
    pub fn on_host_attached(&mut self) {
        self.host.clear();
        self.kernel.host_changed();
        self.readiness.begin();
        self.host.say(&FromKernel::Process { realtime: self.realtime, note: self.note.clone() });
        self.tell_outage();
    }

    /// Bytes from the extruder.
    pub fn on_extruder(&mut self, now: Nanos, bytes: &[u8]) {
        let result = self.extruder.handle_bytes(now, bytes);
        self.check_extruder(result);
    }

    /// A pose of the tracker, for the next cycle. Where there are [`POSES_MAX`] already, gives the oldest, which is left out, as the
    /// estimator would.
    #[must_use = "a pose that is left out is to be told"]
    pub fn on_tracker(&mut self, pose: TrackerPose) -> Option<TrackerPose> {
        let oldest = self.poses.is_full().then(|| self.poses.remove(0));
        let _ = self.poses.push(pose);
        oldest
    }

    /// Bytes for the robot; call until it gives 0.
    pub fn to_robot(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        if self.link.is_down() {
            return 0;
        }
        self.robot.poll_transmit(now, out)
    }

    /// Bytes for the extruder.
    pub fn to_extruder(&mut self, now: Nanos, out: &mut [u8]) -> usize {
        self.extruder.poll_transmit(now, out)
    }

    /// Bytes for the host: what waits, and how to say that some of it is on the wire.
    pub fn to_host(&mut self) -> &[u8] {
        self.host.waiting()
    }

    /// `count` bytes of [`Self::to_host`] are on the wire.
    pub fn sent_to_host(&mut self, count: usize) {
        self.host.sent(count);
    }

    /// Closes the cycle begun by [`Self::on_robot`], if there was one: when it had ticked, when its answer was sent.
    pub fn finish_cycle(&mut self, ticked: Nanos, sent: Nanos) {
        self.hear_kernel();
        if let Some(record) = self.record.take() {
            self.prompt = sent.since(self.began) < self.period_ns;
            self.host.say(&FromKernel::Pace(self.pace()));
            let cycles = self.cycles();
            self.host.say(&FromKernel::Cycles(cycles));
            let mut out = [0; 1024];
            // Both or none: a record whose path is missing would be taken for the path itself.
            let path = self.lead.is_some().then_some(self.command).flatten();
            let mut used = path.map_or(0, |(command, _)| {
                let joints = command.path.0.iter().copied().collect();
                frame::encode(&FromKernel::Path { tick: record.tick, joints }, &mut out).unwrap_or(0)
            });
            let cycle = FromKernel::Cycle(CycleRecord { ticked_ns: ticked.0, sent_ns: sent.0, ..record });
            used += out.get_mut(used..).and_then(|rest| frame::encode(&cycle, rest).ok()).unwrap_or(0);
            self.host.queue(out.get(..used).unwrap_or(&[]));
        }
    }

    /// What the kernel has to say waits for the host: all of it, as what is dropped when the host is busy are whole frames.
    fn hear_kernel(&mut self) {
        let mut out = [0; TRANSMIT_MAX];
        let used = self.kernel.poll_transmit(&mut out);
        self.host.queue(out.get(..used).unwrap_or(&[]));
    }

    /// What the process around this met with: told to the host with every cycle.
    pub const fn account(&mut self, usage: Usage) {
        self.usage = usage;
    }

    /// How the pace has been kept.
    pub fn pace(&self) -> Pace {
        let (overruns, Usage { writes_blocked, segments_resent, memory }) = (&self.overruns, self.usage);
        let Memory { allocations, faults_minor, faults_major } = memory;
        Pace {
            tick: self.ticks(),
            readable_ns: self.began.0,
            overruns: overruns.count(),
            slots_missed: overruns.slots(),
            level: overruns.level(),
            level_max: overruns.level_max(),
            writes_blocked,
            segments_resent,
            allocations,
            faults_minor,
            faults_major,
        }
    }

    /// What became of the robot's cycles.
    pub fn cycles(&mut self) -> Cycles {
        let Counts { sent, doubled, skipped, stalled } = *self.robot.cycles().counts();
        Cycles { tick: self.ticks(), sent, doubled, skipped, stalled }
    }

    /// What was commanded in the last cycle, and what the loop says of it.
    pub const fn last_command(&self) -> Option<&(Command<6>, Report)> {
        self.command.as_ref()
    }

    /// Where the kernel stands.
    pub fn status(&self) -> Status {
        self.kernel.status()
    }

    /// Cycles so far in which the kernel ticked.
    pub fn ticks(&self) -> u64 {
        self.kernel.status().tick
    }

    /// The loop, where the cell wants one.
    pub fn lead(&self) -> Option<&ClosedLoop<6, DEPTH>> {
        self.lead.as_deref()
    }

    /// Whether the host asked the process to end and the arm is at rest.
    pub fn may_quit(&self) -> bool {
        self.kernel.may_quit()
    }

    /// Comes to rest and then lets the process end: what the host's `Quit` does.
    pub fn quit(&mut self) {
        self.kernel.quit();
    }

    /// Somebody else than the host ends the process: tells the host, and comes to rest.
    pub fn quit_by_signal(&mut self) {
        self.host.alarm(true, &"screed-rt was told to end by a signal: the arm comes to rest on its path");
        self.quit();
    }

    /// Whether the extruder has confirmed that it is told to stand still.
    pub fn extruder_stands(&self) -> bool {
        let status = self.extruder.status();
        status.commanded == 0.0 && status.acknowledged == status.sent
    }

    /// Tells the extruder to stop; the bytes are in [`Self::to_extruder`].
    pub fn stop_extruder(&mut self) {
        // Zero is a flow that every extruder takes.
        let _ = self.extruder.set_flow(0.0);
    }

    fn cycle(&mut self, now: Nanos, heard: &Telegram) -> Result<(), LinkError> {
        let (missed, excused) = (std::mem::take(&mut self.missed), std::mem::take(&mut self.excused));
        if let Some(fault) = self.overruns.cycle(missed) {
            self.kernel.raise(fault);
        }
        self.robot.cycles().answered(missed.saturating_sub(excused));
        let extruder = (!self.extruder.status().ready).then_some(Obstacle::Extruder);
        let obstacle = heard.not_ready.map(Obstacle::Robot).or(extruder);
        let ready = obstacle.is_none();
        if let Some(why) = self.readiness.watch(now, obstacle) {
            self.host.alarm(false, &why);
        }
        let (mut command, report) = match &mut self.lead {
            Some(lead) => {
                let robot = Robot { actual: heard.joints, rates: None, ready };
                let (command, report) = lead.tick(&mut self.kernel, now, &robot, &self.poses);
                (command, report.control)
            }
            None => (self.kernel.tick(now, &Sensors::robot(heard.joints, ready)), Report::default()),
        };
        self.poses.clear();
        self.send(&mut command)?;
        self.command = Some((command, report));
        let flow = self.extruder.set_flow(if self.extruder_failed { 0.0 } else { command.flow });
        self.check_extruder(flow);
        let list = |joints: &[f64; 6]| joints.iter().copied().collect();
        self.record = Some(CycleRecord {
            tick: self.kernel.status().tick,
            received_ns: now.0,
            ticked_ns: 0,
            sent_ns: 0,
            robot_time: heard.time,
            missed,
            seq: command.seq,
            mode: command.mode.code(),
            deposit: command.deposit,
            rate: command.rate,
            flow: command.flow,
            commanded: command.joints.map(|joints| list(&joints.0)).unwrap_or_default(),
            actual: list(&heard.joints.0),
        });
        Ok(())
    }

    /// Queues what is commanded. What the link refuses is not sent, and no longer commanded: it is a fault, and the arm stays with
    /// what it was sent before, until its own watchdog stops it.
    fn send(&mut self, command: &mut Command<6>) -> Result<(), LinkError> {
        let Some(joints) = command.joints else {
            self.robot.cycles().pause();
            return Ok(());
        };
        let package = self.package.wrapping_add(1);
        let Err(error) = self.robot.send_setpoint(package, &joints) else {
            self.package = package;
            return Ok(());
        };
        let Some(fault) = error.refused() else { return Err(error) };
        self.host.alarm(false, &error);
        self.lose_robot(fault);
        (command.joints, command.flow) = (None, 0.0);
        Ok(())
    }

    fn check_extruder(&mut self, result: Result<(), ExtruderError>) {
        if let Err(error) = result
            && !self.extruder_failed
        {
            self.extruder_failed = true;
            self.kernel.raise(Fault::Extruder);
            self.host.alarm(false, &error);
        }
    }
}
