//! The account of a print: every waypoint, every cycle, and three errors kept apart.

use crate::config::Cell;
use crate::latency::{Histogram, Summary};
use crate::model::fim::Layer;
use crate::plan::contour::Contour;
use crate::plan::stream::Setpoint as Planned;
use crate::run::memory::Memory;
use nalgebra::Point3;
use screed_kernel::arm::Arm;
use screed_kernel::frame::{CycleRecord, Cycles, LoopRecord, ModeCode, Pace};
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;
use serde::Serialize;
use std::collections::VecDeque;

/// Largest and root-mean-square value of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    max: f64,
    squares: f64,
    count: u64,
}

impl Spread {
    fn push(&mut self, value: f64) {
        self.max = self.max.max(value);
        self.squares += value * value;
        self.count += 1;
    }

    /// The largest value; `None` before the first.
    pub fn max(&self) -> Option<f64> {
        (self.count > 0).then_some(self.max)
    }

    /// Root mean square; `None` before the first.
    pub fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares / self.count as f64).sqrt())
    }
}

impl Serialize for Spread {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Shown {
            max_m: Option<f64>,
            rms_m: Option<f64>,
            samples: u64,
        }
        Shown { max_m: self.max(), rms_m: self.rms(), samples: self.count }.serialize(serializer)
    }
}

/// Latencies from a telegram that lies ready to its answer that are told apart (µs): a cycle at 125 Hz and some more.
const WIRE_BINS: usize = 20_000;

/// FNV-1a, 64 bit (Fowler, Noll, Vo): a fingerprint, not a seal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Fnv(u64);

impl Fnv {
    const fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    fn push(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

/// The fingerprint of some bytes.
pub fn fingerprint(bytes: &[u8]) -> u64 {
    let mut hash = Fnv::new();
    hash.push(bytes);
    hash.0
}

/// What has happened so far.
pub struct Account {
    arm: Arm<6>,
    part_from_base: Pose,
    flange_from_tcp: Pose,
    period_ns: u64,
    contours: Vec<Contour>,
    /// Path setpoints in the ring or on the way there, in order.
    expected: VecDeque<Planned>,
    hash: Fnv,
    /// How the pace had been kept when this began, and has been since.
    pace_before: Option<Pace>,
    pace: Option<Pace>,
    /// What became of the robot's cycles: until the present tick, and with the robot's time (s) before the path was played.
    cycles: Option<Cycles>,
    cycles_before: Option<(Cycles, f64)>,
    wire: Histogram,
    /// Tick and receipt (ns) of the cycle before, whether something was commanded in it or not.
    before: Option<(u64, u64)>,
    last: Option<Last>,
    /// Where the path was at which tick, when what was commanded then is something else.
    path: Option<(u64, JointPos<6>)>,
    /// Figures for the final table.
    pub figures: Figures,
}

/// What was commanded last.
#[derive(Clone, Copy)]
struct Last {
    seq: u32,
    path: JointPos<6>,
}

/// The figures of the final table. Lengths in metres, times in seconds.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// Robot cycles seen.
    pub cycles: u64,
    /// Waypoints (setpoints of the path) sent.
    pub sent: u64,
    /// Robot cycles in motion that went by without a new setpoint: the robot had the one before twice.
    pub doubled: u64,
    /// Waypoints of the path that were never sent, though later ones were.
    pub skipped: u64,
    /// Cycles whose record did not reach this host: it was too busy to read. What was sent in them is not in the figures.
    pub unrecorded: u64,
    /// Cycles that the machine began late by more than half a period.
    pub stalls: u64,
    /// The longest such delay (s).
    pub stall_max_s: f64,
    /// Overruns of the real-time process: runs of missed slots. One stall is one, however long.
    pub overruns: u64,
    /// Slots missed in them: robot cycles without an answer of their own.
    pub slots_missed: u64,
    /// The robot's cycles since the path began to be played, each one told; nothing from a board or a process of version 1.0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot_cycles: Option<RobotCycles>,
    /// The most that the leaky counter of overruns has been since the process started.
    pub overrun_counter_max: u32,
    /// Writes to the robot that its line did not take whole at once.
    pub writes_blocked: u64,
    /// Segments that TCP sent to the robot again.
    pub segments_resent: u64,
    /// What the real-time process has taken from memory since its loop began; nothing is looked at in virtual time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory: Option<Memory>,
    /// From a robot's telegram that lies ready to its answer on the wire; nothing in virtual time, where nothing takes any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor_to_wire: Option<Summary>,
    /// Commanded path against the model's curves, at the setpoints and half-way between. Where what is sent leads the path, the path
    /// is meant, and not what is sent.
    pub commanded_contour: Spread,
    /// Actual position against that path at equal stamps: what the robot's servo lags, and what a lead leaves of it.
    pub following: Spread,
    /// Actual path against the model's curves.
    pub actual_contour: Spread,
    /// Volume extruded (m³), from the flow commanded.
    pub volume_m3: f64,
    /// What the lead came to, where there is one.
    pub lead: Option<Led>,
}

/// What became of the robot's cycles (docs/rtde.md).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RobotCycles {
    /// Cycles between the first and the last state, by the robot's time stamps.
    pub by_timestamps: u64,
    /// With a new setpoint, as the robot's echo shows.
    pub sent: u64,
    /// Without, though this machine answered in time: the robot had the one before once more.
    pub doubled: u64,
    /// Of which no state came.
    pub skipped: u64,
    /// Without a new setpoint because this machine missed a slot.
    pub stalled: u64,
}

impl RobotCycles {
    /// Cycles by the time stamps that are none of the four: the robot was not sent anything in them. Negative would be a defect.
    pub fn unaccounted(&self) -> i64 {
        let told = self.sent + self.doubled + self.skipped + self.stalled;
        self.by_timestamps as i64 - told as i64
    }
}

/// What a lead came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Led {
    /// Least and greatest lag of the drives as they were used last (s).
    pub lag_s: [f64; 2],
    /// Least and greatest 1/K of them (s²).
    pub inverse_gain_s2: [f64; 2],
    /// How far a joint's lead stayed behind at most, for its limits (rad), of what was told.
    pub behind_max_rad: f64,
}

impl Account {
    /// Nothing has happened. `layers` are the model's, in the part frame, indexed as the plan's setpoints index them.
    pub fn new(cell: &Cell, layers: &[Layer]) -> Self {
        Self {
            arm: cell.robot.arm,
            part_from_base: cell.part.base_from_part.inverse(),
            flange_from_tcp: cell.tool.flange_from_tcp,
            period_ns: 1_000_000_000 / u64::from(cell.link.rate_hz),
            contours: layers.iter().map(|layer| Contour::new(&layer.segments)).collect(),
            expected: VecDeque::new(),
            hash: Fnv::new(),
            pace_before: None,
            pace: None,
            cycles: None,
            cycles_before: None,
            wire: Histogram::new(WIRE_BINS),
            before: None,
            last: None,
            path: None,
            figures: Figures::default(),
        }
    }

    /// Path setpoints that are on their way to the ring.
    pub fn expect(&mut self, path: &[Planned]) {
        self.expected.extend(path);
    }

    /// Fingerprint over sequence number, joints and flow of the path's setpoints as they were played, in order, each once; without
    /// a lead they are what was commanded.
    pub fn hash(&self) -> u64 {
        self.hash.0
    }

    /// The tool centre point in the part frame (m).
    pub fn tcp_in_part(&self, joints: &JointPos<6>) -> Point3<f64> {
        Point3::from((self.part_from_base * self.arm.forward(joints) * self.flange_from_tcp).translation)
    }

    /// Where the path is at a tick, in a process whose commands are led and corrected: said before the cycle itself.
    pub fn on_path(&mut self, tick: u64, joints: &[f64]) {
        self.path = <[f64; 6]>::try_from(joints).ok().map(|joints| (tick, JointPos(joints)));
    }

    /// What the loop in the process came to.
    pub fn on_loop(&mut self, record: &LoopRecord) {
        let span = |values: &[f64]| {
            values
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &value| [low.min(value), high.max(value)])
        };
        let before = self.figures.lead.map_or(0.0, |lead| lead.behind_max_rad);
        self.figures.lead = Some(Led {
            lag_s: span(&record.lag),
            inverse_gain_s2: span(&record.inverse_gain),
            behind_max_rad: before.max(record.behind),
        });
    }

    /// Takes into account how the pace has been kept.
    pub fn observe_pace(&mut self, pace: &Pace) {
        let before = *self.pace_before.get_or_insert(*pace);
        self.pace = Some(*pace);
        let figures = &mut self.figures;
        figures.overruns = pace.overruns.saturating_sub(before.overruns);
        figures.slots_missed = pace.slots_missed.saturating_sub(before.slots_missed);
        figures.overrun_counter_max = pace.level_max;
        figures.writes_blocked = pace.writes_blocked.saturating_sub(before.writes_blocked);
        figures.segments_resent = pace.segments_resent.saturating_sub(before.segments_resent);
        let Pace { allocations, faults_minor, faults_major, .. } = *pace;
        figures.memory = Some(Memory { allocations, faults_minor, faults_major });
    }

    /// Takes into account what had become of the robot's cycles at a tick; said before its record.
    pub const fn observe_cycles(&mut self, cycles: &Cycles) {
        self.cycles = Some(*cycles);
    }

    /// How the pace had been kept when the process spoke of it last.
    pub const fn pace(&self) -> Option<Pace> {
        self.pace
    }

    /// From telegrams that lie ready to their answers on the wire.
    pub fn sensor_to_wire(&self) -> Option<Summary> {
        Summary::of(&self.wire, self.figures.slots_missed)
    }

    /// The robot's cycles since the path began to be played, told apart by the process; their number is that of the time stamps.
    fn count_robot_cycles(&mut self, record: &CycleRecord, moving: bool) {
        let Some(now) = self.cycles.filter(|cycles| cycles.tick == record.tick && cycles.sent > 0) else { return };
        if self.figures.robot_cycles.is_none() && !moving {
            self.cycles_before = Some((now, record.robot_time));
            return;
        }
        let (before, since) = *self.cycles_before.get_or_insert((now, record.robot_time));
        self.figures.robot_cycles = Some(RobotCycles {
            by_timestamps: ((record.robot_time - since) * 1e9 / self.period_ns as f64).round() as u64,
            sent: now.sent.saturating_sub(before.sent),
            doubled: now.doubled.saturating_sub(before.doubled),
            skipped: now.skipped.saturating_sub(before.skipped),
            stalled: now.stalled.saturating_sub(before.stalled),
        });
    }

    /// Takes one cycle into account; returns the path setpoint that was newly commanded in it, if one was.
    pub fn observe(&mut self, record: &CycleRecord) -> Option<Planned> {
        let figures = &mut self.figures;
        figures.cycles += 1;
        let mut unrecorded = 0;
        if let Some((tick, received_ns)) = self.before.replace((record.tick, record.received_ns)) {
            unrecorded = record.tick.saturating_sub(tick + 1);
            figures.unrecorded += unrecorded;
            let late = record.received_ns.saturating_sub(received_ns + (unrecorded + 1) * self.period_ns);
            if late > self.period_ns / 2 {
                figures.stalls += 1;
                figures.stall_max_s = figures.stall_max_s.max(late as f64 * 1e-9);
            }
        }
        if let Some(pace) = self.pace.filter(|pace| pace.tick == record.tick) {
            let latency_us = record.sent_ns.saturating_sub(pace.readable_ns) / 1000;
            self.wire.add(u32::try_from(latency_us).unwrap_or(u32::MAX));
        }
        let moving = matches!(record.mode, ModeCode::Moving | ModeCode::Stopping);
        if moving {
            figures.doubled += u64::from(record.missed);
        }
        figures.volume_m3 += record.flow * self.period_ns as f64 * 1e-9;
        self.count_robot_cycles(record, moving);
        let commanded = JointPos(<[f64; 6]>::try_from(record.commanded.as_slice()).ok()?);
        let path = self.path.take().filter(|(tick, _)| *tick == record.tick).map_or(commanded, |(_, path)| path);
        let actual = JointPos(<[f64; 6]>::try_from(record.actual.as_slice()).ok()?);
        let last = self.last.replace(Last { seq: record.seq, path });
        let fresh = moving && last.is_none_or(|last| last.seq != record.seq);
        let planned = if fresh { self.take_expected(record, &path, unrecorded) } else { None };
        let layer = planned.filter(|planned| planned.deposit).map(|planned| planned.layer);
        if let Some(layer) = layer {
            self.measure(layer, &path, last.map(|last| last.path), &actual);
        }
        planned
    }

    /// The planned setpoint that was commanded; those before it that were not seen were skipped, but for as many as cycles
    /// went unrecorded.
    fn take_expected(&mut self, record: &CycleRecord, path: &JointPos<6>, mut unrecorded: u64) -> Option<Planned> {
        while self.expected.front().is_some_and(|planned| planned.seq < record.seq) {
            self.expected.pop_front();
            match unrecorded.checked_sub(1) {
                Some(left) => unrecorded = left,
                None => self.figures.skipped += 1,
            }
        }
        let planned = self.expected.pop_front_if(|planned| planned.seq == record.seq)?;
        self.figures.sent += 1;
        self.hash.push(&record.seq.to_le_bytes());
        path.0.iter().for_each(|q| self.hash.push(&q.to_bits().to_le_bytes()));
        self.hash.push(&record.flow.to_bits().to_le_bytes());
        Some(planned)
    }

    fn measure(&mut self, layer: usize, path: &JointPos<6>, before: Option<JointPos<6>>, actual: &JointPos<6>) {
        let (path_tcp, actual_tcp) = (self.tcp_in_part(path), self.tcp_in_part(actual));
        let between = before.map(|before| {
            let halfway = std::array::from_fn(|j| 0.5 * (before.0[j] + path.0[j]));
            self.tcp_in_part(&JointPos(halfway))
        });
        let Some(contour) = self.contours.get_mut(layer) else { return };
        let figures = &mut self.figures;
        figures.commanded_contour.push(contour.distance(&path_tcp));
        if let Some(between) = between {
            figures.commanded_contour.push(contour.distance(&between));
        }
        figures.following.push((path_tcp - actual_tcp).norm());
        figures.actual_contour.push(contour.distance(&actual_tcp));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use screed_kernel::frame::JointValues;

    /// A robot that is not ready for a while is commanded nothing, and each of those cycles is recorded all the same.
    #[test]
    fn cycles_in_which_nothing_is_commanded_are_no_gap() {
        let cell = Cell::demo(125).unwrap();
        let mut account = Account::new(&cell, &[]);
        let start: JointValues = cell.robot.start.0.into_iter().collect();
        for tick in 0..400_u64 {
            // Not ready from 100 to 249; then cycles 300 to 309 are lost.
            if (300..310).contains(&tick) {
                continue;
            }
            account.observe(&CycleRecord {
                tick,
                received_ns: tick * 8_000_000,
                ticked_ns: 0,
                sent_ns: 0,
                robot_time: tick as f64 * 0.008,
                missed: 0,
                seq: 0,
                mode: ModeCode::Unready,
                deposit: false,
                rate: 0.0,
                flow: 0.0,
                commanded: if (100..250).contains(&tick) { JointValues::new() } else { start.clone() },
                actual: start.clone(),
            });
        }
        let figures = &account.figures;
        assert_eq!((figures.cycles, figures.unrecorded, figures.stalls), (390, 10, 0));
    }
}
