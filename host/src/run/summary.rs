//! The table at the end of a print, for people and as JSON.

use crate::config::Cell;
use crate::run::account::{Figures, Led, RobotCycles, Spread};
use crate::run::memory::Memory;
use crate::run::resend::LineFigures;
use serde::Serialize;
use std::fmt;

/// All that is told at the end.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The model's name.
    pub model: String,
    /// The cell's name.
    pub cell: String,
    /// The robot.
    pub robot: String,
    /// Setpoints a second.
    pub rate_hz: u32,
    /// "complete", "stopped" (after the time asked for), "interrupted" (Ctrl-C) or "failed".
    pub outcome: &'static str,
    /// "real time", "NON-RT" or "virtual time".
    pub scheduling: &'static str,
    /// Why not real time; empty otherwise.
    pub scheduling_note: String,
    /// First layer printed, and one past the last, as positions in the model.
    pub layers: (usize, usize),
    /// Length of the layers' curves (m).
    pub path_length_m: f64,
    /// Planned time on the layers (s).
    pub layer_time_s: f64,
    /// Planned time between layers, and of the approach (s).
    pub between_time_s: f64,
    /// Setpoints of the whole path.
    pub planned: u32,
    /// servoj's look-ahead (s), which causes the lag.
    pub servoj_lookahead_s: f64,
    /// The account.
    #[serde(flatten)]
    pub figures: Figures,
    /// Fingerprint over sequence number, joints and flow of the path's setpoints as commanded.
    pub hash: String,
    /// What happened on the serial line of a board, if the kernel is at the end of one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<LineFigures>,
    /// The log.
    pub log: Option<String>,
}

impl Summary {
    /// The part of the head that only the cell knows.
    pub fn of(cell: &Cell, model: &str) -> Self {
        Self {
            model: model.to_owned(),
            cell: cell.name.clone(),
            robot: cell.robot.model.clone(),
            rate_hz: cell.link.rate_hz,
            outcome: "",
            scheduling: "",
            scheduling_note: String::new(),
            layers: (0, 0),
            path_length_m: 0.0,
            layer_time_s: 0.0,
            between_time_s: 0.0,
            planned: 0,
            servoj_lookahead_s: cell.link.servoj_lookahead,
            figures: Figures::default(),
            hash: String::new(),
            line: None,
            log: None,
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { figures, .. } = self;
        let mut row = |name: &str, value: &str| writeln!(f, "  {name:<44} {value}");
        row("model", &format!("{}, layers {} to {}", self.model, self.layers.0, self.layers.1.saturating_sub(1)))?;
        row("robot", &format!("{} in cell {}, {} Hz", self.robot, self.cell, self.rate_hz))?;
        row("scheduling", self.scheduling)?;
        if !self.scheduling_note.is_empty() {
            row("", &self.scheduling_note)?;
        }
        row("outcome", self.outcome)?;
        row("planned path on the layers", &format!("{:.3} m in {:.2} s", self.path_length_m, self.layer_time_s))?;
        row("planned approach and between layers", &format!("{:.2} s", self.between_time_s))?;
        row("volume", &format!("{:.3} l", figures.volume_m3 * 1e3))?;
        row("waypoints planned / sent", &format!("{} / {}", self.planned, figures.sent))?;
        row("waypoints doubled / skipped", &format!("{} / {}", figures.doubled, figures.skipped))?;
        if figures.unrecorded > 0 {
            row("cycles this program failed to record", &figures.unrecorded.to_string())?;
        }
        let stalls = format!("{} of {}, longest {:.1} ms", figures.stalls, figures.cycles, figures.stall_max_s * 1e3);
        row("cycles this machine began late", &stalls)?;
        if let Some(cycles) = figures.robot_cycles {
            let RobotCycles { by_timestamps, sent, doubled, skipped, stalled } = cycles;
            let told = format!("{sent} / {doubled} / {skipped} / {stalled}");
            row("robot cycles sent/doubled/skipped/stalled", &format!("{told}, {by_timestamps} by its time stamps"))?;
            if cycles.unaccounted() != 0 {
                row("robot cycles in which nothing was sent", &cycles.unaccounted().to_string())?;
            }
        }
        let missed = format!("{} / {}", figures.overruns, figures.slots_missed);
        row("overruns / slots missed in them", &missed)?;
        row("overrun counter at most", &figures.overrun_counter_max.to_string())?;
        row("writes blocked / segments resent", &format!("{} / {}", figures.writes_blocked, figures.segments_resent))?;
        if let Some(Memory { allocations, faults_minor, faults_major }) = figures.memory {
            let taken = format!("{allocations} / {faults_minor} minor, {faults_major} major");
            row("allocations / page faults after the start", &taken)?;
        }
        if let Some(wire) = &figures.sensor_to_wire {
            let latency = format!("median {} µs, p99 {} µs, max {} µs", wire.median_us, wire.p99_us, wire.max_us);
            row("sensor in to wire out", &latency)?;
        }
        row("commanded path against the IFC curves", &spread(&figures.commanded_contour))?;
        let against = if figures.lead.is_some() { "path, led" } else { "commanded" };
        let lag = format!("actual against {against} (look-ahead {} s)", self.servoj_lookahead_s);
        row(&lag, &spread(&figures.following))?;
        if let Some(Led { lag_s: [least, most], inverse_gain_s2: [low, high], behind_max_rad }) = figures.lead {
            let drives = format!(
                "lag {:.1} to {:.1} ms, K {:.0} to {:.0} /s², behind {behind_max_rad:.1e} rad at most",
                least * 1e3,
                most * 1e3,
                1.0 / high,
                1.0 / low
            );
            row("drives as learnt", &drives)?;
        }
        row("actual path against the IFC curves", &spread(&figures.actual_contour))?;
        row("setpoint hash", &self.hash)?;
        if let Some(LineFigures { spoilt_from_kernel, spoilt_to_kernel, said_again }) = self.line {
            let spoilt = format!("{spoilt_to_kernel} / {spoilt_from_kernel}, {said_again} messages said again");
            row("frames spoilt on the line, there / back", &spoilt)?;
        }
        if let Some(log) = &self.log {
            row("log", log)?;
        }
        Ok(())
    }
}

/// Largest and root-mean-square value in the unit that suits them.
fn spread(spread: &Spread) -> String {
    match (spread.max(), spread.rms()) {
        (Some(max), Some(rms)) if max < 1e-4 => format!("max {:.4} µm, rms {:.4} µm", max * 1e6, rms * 1e6),
        (Some(max), Some(rms)) => format!("max {:.3} mm, rms {:.3} mm", max * 1e3, rms * 1e3),
        _ => "not measured".to_owned(),
    }
}
