//! What host and kernel say to each other. Frozen at version 1.0: later versions append variants and change none; what 1.1
//! appends is told at its place.

use crate::correction::CorrectionLimits;
use crate::fault::Fault;
use crate::guard::{Motion, PLANES_MAX, Plane, Quantity};
use crate::units::{JointAcc, JointJerk, JointPos, JointVel};
use serde::{Deserialize, Serialize};

/// Most joints a message can speak of.
pub const JOINTS_MAX: usize = 9;

/// Room for setpoint code in one [`ToKernel::Batch`]: what is left of [`super::FRAME_MAX`] by its other fields at their
/// longest.
pub const CODE_MAX: usize = super::FRAME_MAX - 32;

/// Longest text in a message (bytes).
pub const NOTE_MAX: usize = 480;

/// One value a joint.
pub type JointValues = heapless::Vec<f64, JOINTS_MAX>;

/// What the host says.
// The large variant comes once a job, and without an allocator it cannot be boxed.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToKernel<'a> {
    /// Asks for a [`Status`]; drops a batch that was left half sent.
    Hello,
    /// Sets limits and periods. Refused unless the kernel is unconfigured or holding with nothing left to play.
    Configure(Configure),
    /// Part of a batch of setpoints.
    Batch(#[serde(borrow)] BatchPart<'a>),
    /// Path clock rate to play at, 0 to 1.
    Rate(f64),
    /// Comes to rest on the path; the ring stays.
    Hold,
    /// Plays on (or begins). A person's command: refused unless `epoch` is the kernel's, so that it speaks of this ring, and
    /// of no moment before the last hold or resume.
    Resume {
        /// Epoch from the last [`Status`].
        epoch: u32,
    },
    /// Comes to rest on the path, then drops the ring.
    Stop,
    /// Leaves a fault. A person's command: refused unless `fault` is the present fault's number.
    Rearm {
        /// Number from [`Status`].
        fault: u32,
    },
    /// Ends the real-time process, which first comes to rest.
    Quit,
}

/// A batch comes in parts small enough for one frame each; the last part commits it, and it is taken whole or not at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BatchPart<'a> {
    /// Number of the batch, chosen by the host, repeated in the answer.
    pub batch: u32,
    /// Sequence number of this part's first setpoint.
    pub first_seq: u32,
    /// The first part opens the batch.
    pub opens: bool,
    /// The last part commits it.
    pub commits: bool,
    /// In the first part: the batch replaces what follows this setpoint. Without it follows the ring's end.
    pub after: Option<u32>,
    /// Setpoints by [`crate::setpoint::Coder`], whole ones only.
    pub code: &'a [u8],
}

/// Limits and periods; SI units, one value a joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Configure {
    /// Period of setpoints (ns): a whole multiple, up to 100, of the tick period.
    pub sample_period_ns: u64,
    /// Period of ticks (ns), 0.1 ms to 100 ms.
    pub tick_period_ns: u64,
    /// Lowest positions (rad or m), none below the arm's.
    pub position_min: JointValues,
    /// Highest positions (rad or m), none above the arm's.
    pub position_max: JointValues,
    /// What setpoints may ask for; speeds none above the arm's.
    pub plan: MotionLimits,
    /// What may leave the kernel: at least [`crate::guard::output_least`] of `plan`.
    pub output: MotionLimits,
    /// Farthest that any joint's actual position may be from its target (rad or m).
    pub following_error_max: f64,
    /// Farthest that any joint's estimated position may be from its target (rad or m).
    pub deviation_max: f64,
    /// What corrections may be.
    pub correction: CorrectionLimits,
    /// The tool centre point in the flange frame: translation (m), rotation vector (rad).
    pub flange_from_tcp: [f64; 6],
    /// Planes that flange and tool centre point must not pass.
    pub workspace: heapless::Vec<Plane, PLANES_MAX>,
}

/// How joints may move.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionLimits {
    /// Highest speeds (rad/s or m/s).
    pub velocity_max: JointValues,
    /// Highest accelerations (rad/s² or m/s²).
    pub acceleration_max: JointValues,
    /// Highest jerks (rad/s³ or m/s³).
    pub jerk_max: JointValues,
}

impl MotionLimits {
    /// The limits for an arm of N joints, if every list has N values.
    pub fn motion<const N: usize>(&self) -> Option<Motion<N>> {
        Some(Motion {
            velocity_max: JointVel(joints(&self.velocity_max)?),
            acceleration_max: JointAcc(joints(&self.acceleration_max)?),
            jerk_max: JointJerk(joints(&self.jerk_max)?),
        })
    }
}

impl<const N: usize> From<&Motion<N>> for MotionLimits {
    /// N must not be above [`JOINTS_MAX`]; what is beyond is left out, and no kernel takes such a list.
    fn from(motion: &Motion<N>) -> Self {
        let list = |values: &[f64; N]| values.iter().copied().take(JOINTS_MAX).collect();
        Self {
            velocity_max: list(&motion.velocity_max.0),
            acceleration_max: list(&motion.acceleration_max.0),
            jerk_max: list(&motion.jerk_max.0),
        }
    }
}

impl Configure {
    /// Lowest and highest positions of an arm of N joints, if both lists have N values.
    pub fn positions<const N: usize>(&self) -> Option<[JointPos<N>; 2]> {
        Some([JointPos(joints(&self.position_min)?), JointPos(joints(&self.position_max)?)])
    }
}

fn joints<const N: usize>(values: &JointValues) -> Option<[f64; N]> {
    values.as_slice().try_into().ok()
}

/// What the kernel's process says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromKernel {
    /// Where the kernel stands: on [`ToKernel::Hello`], on every change of mode, and regularly.
    Status(Status),
    /// The batch is in the ring.
    Accepted {
        /// Its number.
        batch: u32,
    },
    /// The message was not obeyed; nothing changed.
    Refused {
        /// Number of the batch, or 0 for any other message.
        batch: u32,
        /// Why.
        reason: Refusal,
    },
    /// One cycle, as it was.
    Cycle(CycleRecord),
    /// To a host that has just attached: what kind of process it speaks to.
    Process {
        /// Whether the process has the scheduling and the locked memory that the cell file asks for.
        realtime: bool,
        /// What was refused, in words for a person; empty when nothing was.
        note: heapless::String<NOTE_MAX>,
    },
    /// Something failed outside the kernel: the link to the robot or to the extruder.
    Alarm {
        /// Whether the process ends.
        fatal: bool,
        /// Cause and action, in words for a person.
        note: heapless::String<NOTE_MAX>,
    },
    /// The kernel begins to stop by itself: said once, at the tick that found it. Every [`Status`] repeats it until a person
    /// has left the fault, so that nothing is lost with this frame.
    Fault(FaultReport),
    /// What the loop around the kernel came to; since 1.1. Said every [`crate::tick::STATUS_INTERVAL`] ticks, and when it begins or
    /// ends to feed back, to trust the base or to wait.
    Loop(LoopRecord),
    /// The path of the [`CycleRecord`] that follows, in a process with a loop: what is commanded there is led and corrected. Since 1.1.
    Path {
        /// Tick.
        tick: u64,
        /// Joints of the path (rad or m).
        joints: JointValues,
    },
    /// How the process has kept pace, before the [`CycleRecord`] of the same tick. Since version 1.1.
    Pace(Pace),
    /// What became of the robot's cycles, before the [`CycleRecord`] of the same tick. Since version 1.1.
    Cycles(Cycles),
}

/// Why a message was not obeyed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal {
    /// The message does not fit the present mode.
    Mode,
    /// A part of the configuration cannot be.
    Configuration(Unsound),
    /// The configuration's output limits are below what plan limits, path clock and corrections can add up to.
    NoRoom {
        /// Which limit.
        quantity: Quantity,
        /// Joint, 0 for the first.
        joint: u8,
        /// Limit given (SI).
        value: f64,
        /// Least limit that does (SI).
        limit: f64,
    },
    /// No room in the ring: wait for credits.
    Full,
    /// The setpoint to replace after has been consumed.
    TooLate,
    /// Sequence numbers do not continue what the ring holds, or a part is missing.
    Sequence,
    /// The code of a setpoint is broken.
    Code,
    /// A setpoint breaks a limit; the batch was refused whole.
    DoesNotFit {
        /// Its sequence number.
        seq: u32,
        /// Which limit.
        quantity: Quantity,
        /// Joint, 0 for the first; for [`Quantity::Workspace`] the plane.
        joint: u8,
        /// Value found (SI).
        value: f64,
        /// Value allowed (SI).
        limit: f64,
    },
    /// The batch does not end at rest: its last three setpoints differ, or material still flows.
    NotAtRest,
    /// The rate is not in 0 to 1.
    Rate,
    /// The epoch or fault number is not the present one: look at the status and decide again.
    Stale,
}

/// What is wrong with a [`Configure`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Unsound {
    /// A list has not one value a joint.
    Joints,
    /// The periods are out of range, or the tick period is no part of the sample period.
    Periods,
    /// Positions are not finite, not in order, or beyond the arm's; or nothing is left between them.
    Positions,
    /// A limit of motion is not positive and finite, or a plan speed is above the arm's.
    Motion,
    /// A largest error is not positive and finite.
    Errors,
    /// Limits of corrections are neither all positive nor all zero.
    Correction,
    /// A part of the tool's pose is not finite or beyond 1,024 m or rad.
    Tool,
    /// A plane's normal is no unit vector, or its offset is not finite.
    Workspace,
}

/// Mode without its data, as it crosses the wire and stands in the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum ModeCode {
    /// No configuration, or the robot's position is not known: nothing is put out.
    Unready = 0,
    /// At rest.
    Holding = 1,
    /// Playing the ring.
    Moving = 2,
    /// Coming to rest on the path.
    Stopping = 3,
    /// At rest after a fault.
    Faulted = 4,
}

/// Where the kernel stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Ticks since start.
    pub tick: u64,
    /// Counts what a person has to decide anew after: configurations, dropped rings, and every hold and resume obeyed.
    pub epoch: u32,
    /// Mode.
    pub mode: ModeCode,
    /// Present fault, if any.
    pub fault: Option<FaultReport>,
    /// Setpoint consumed last; what follows it can be replaced.
    pub consumed: u32,
    /// Last setpoint held.
    pub end_seq: u32,
    /// Setpoints the ring can take.
    pub credits: u32,
    /// Path clock rate.
    pub rate: f64,
    /// Frames dropped as broken since start.
    pub frames_broken: u32,
    /// Whole frames since start whose message is not known here: from a host of a later version.
    pub frames_unknown: u32,
    /// Ticks since start that began more than half a period late.
    pub ticks_late: u32,
    /// Time lost by them (ns): the path clock advances one period a tick.
    pub time_lost_ns: u64,
}

/// A fault as it crosses the wire; the words are in [`crate::fault`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultReport {
    /// Counts faults from 1: what [`ToKernel::Rearm`] must name.
    pub number: u32,
    /// What happened.
    pub fault: Fault,
    /// At which tick.
    pub tick: u64,
}

impl FaultReport {
    /// The same for a reader of this minor version: [`Fault::told_to`].
    pub const fn told_to(self, minor: u8) -> Self {
        Self { fault: self.fault.told_to(minor), ..self }
    }
}

/// What the loop around the kernel came to at a tick.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoopRecord {
    /// Tick.
    pub tick: u64,
    /// What is known of the base, where there is a tracker.
    pub base: Option<BaseRecord>,
    /// Whether the feedback acts.
    pub closed: bool,
    /// Whether the path waits for its correction.
    pub waits: bool,
    /// Whether what was wanted has been held back, by the bounds at the tool or at the joints: then the feedback waits too.
    pub saturated: bool,
    /// By how much base and feedback shift the tool (m) and turn it (rad).
    pub moved: [f64; 2],
    /// How far shift (m) and turn (rad) stay behind what was wanted, for the bounds at the tool.
    pub held: [f64; 2],
    /// By how much a joint stays behind what was wanted, for the limits of corrections (rad or m), the most of all joints.
    pub behind: f64,
    /// L of each drive as it is used (s).
    pub lag: JointValues,
    /// 1/K of each drive as it is used (s²).
    pub inverse_gain: JointValues,
}

/// What is known of the base at a tick.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BaseRecord {
    /// How old the last pose is that was believed (s); none while the base is not trusted.
    pub age: Option<f64>,
    /// The correction for it: displacement of the pivot (m, m, m) and rotation vector (rad, rad, rad) in the nominal base frame.
    pub displacement: [f64; 6],
    /// How far that is behind the estimate (m, rad).
    pub behind: [f64; 2],
    /// Normalised innovation squared of the pose that was judged last, taken or gated; none before the first.
    pub nis: Option<f64>,
    /// Since start: poses that the base's estimate took in.
    pub taken: u32,
    /// Poses that it did not.
    pub refused: u32,
    /// Measurements that the filter of the joints gated; a step that was replayed counts again.
    pub gated: u32,
    /// Measurements that came too late for it.
    pub late: u32,
    /// Measurements whose instant had not come when they did.
    pub deferred: u32,
}

/// One cycle of the real-time process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CycleRecord {
    /// Tick.
    pub tick: u64,
    /// The robot's telegram was read (ns, monotonic clock).
    pub received_ns: u64,
    /// The tick was over (ns).
    pub ticked_ns: u64,
    /// The answer was written (ns).
    pub sent_ns: u64,
    /// The robot's own time stamp (s).
    pub robot_time: f64,
    /// Robot cycles that went by since the record before without an answer of their own.
    pub missed: u32,
    /// Setpoint commanded; 0 before the first.
    pub seq: u32,
    /// Mode.
    pub mode: ModeCode,
    /// Whether material is being laid.
    pub deposit: bool,
    /// Path clock rate.
    pub rate: f64,
    /// Flow commanded (m³/s).
    pub flow: f64,
    /// Joints commanded (rad or m).
    pub commanded: JointValues,
    /// Joints as the robot says they are (rad or m).
    pub actual: JointValues,
}

/// How the process around the kernel has kept pace since it started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pace {
    /// Tick.
    pub tick: u64,
    /// The robot's telegram lay ready to be read, or the timer's slot began (ns, the clock of [`CycleRecord`]).
    pub readable_ns: u64,
    /// Overruns: runs of missed slots. However long a stall is, it is one.
    pub overruns: u64,
    /// Slots missed in them: cycles of the robot, or of the timer, that went by without an answer of their own.
    pub slots_missed: u64,
    /// The leaky counter: one more for an overrun, one less for a good cycle.
    pub level: u32,
    /// The most it has been.
    pub level_max: u32,
    /// Writes to the robot that its line did not take whole at once.
    pub writes_blocked: u64,
    /// Segments that TCP sent to the robot again.
    pub segments_resent: u64,
    /// Memory allocations of the process since its loop began.
    pub allocations: u64,
    /// Page faults since then that needed no disk.
    pub faults_minor: u64,
    /// Page faults since then that did.
    pub faults_major: u64,
}

/// What became of the robot's cycles, counted by its time stamps, since the process started. Counted are those from the first
/// that shows a setpoint's arrival on, for as long as setpoints are sent. Each is one of the four.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cycles {
    /// Tick.
    pub tick: u64,
    /// Cycles in which a new setpoint had arrived, as the robot's echo of its number shows.
    pub sent: u64,
    /// Cycles in which none had, though each telegram had been answered: the robot had the setpoint before once more.
    pub doubled: u64,
    /// Cycles of which no telegram came: a gap in the time stamps.
    pub skipped: u64,
    /// Cycles in which none had arrived because this machine was late: the slots that it missed.
    pub stalled: u64,
}
