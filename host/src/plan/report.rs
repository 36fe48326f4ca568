//! What a plan amounts to: a row a layer, and totals; as a table, CSV or JSON.

use super::Plan;
use super::moves::{Move, MoveKind};
use super::profile::Limited;
use super::route::Route;
use serde::Serialize;

/// One layer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LayerReport {
    /// Position in the model's layers, from 0.
    pub layer: usize,
    /// The name in the model.
    pub name: String,
    /// Length of the path (m).
    pub length_m: f64,
    /// Time on the path (s): the layer time.
    pub time_s: f64,
    /// Speed sought everywhere (m/s).
    pub cruise_m_s: f64,
    /// Highest speed reached (m/s).
    pub velocity_max_m_s: f64,
    /// Acceleration limit kept (m/s²).
    pub acceleration_max_m_s2: f64,
    /// Softness of the speed ramps, 1 being the paper's tanh, 0 nearly constant acceleration.
    pub softness: f64,
    /// Volume laid down (m³).
    pub volume_m3: f64,
    /// Highest flow (m³/s).
    pub flow_max_m3_s: f64,
    /// How often the tool rests on the way, at corners.
    pub corners: usize,
    /// Stretches cruised at less because they curve.
    pub by_curvature: usize,
    /// Stretches too short for the cruise speed.
    pub by_length: usize,
    /// Time to get there from the layer before, or from the start, and off it when it is the last (s). No part of the
    /// layer time.
    pub between_s: f64,
}

/// A plan in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The layers, in the order printed.
    pub layers: Vec<LayerReport>,
    /// Length of all layers' paths (m).
    pub length_m: f64,
    /// Time on the paths (s).
    pub time_s: f64,
    /// Volume laid down (m³).
    pub volume_m3: f64,
    /// Time of the approach (s).
    pub approach_s: f64,
    /// Time between the layers (s), the approach included.
    pub between_s: f64,
    /// Setpoints a second.
    pub rate_hz: f64,
    /// Setpoints of the path.
    pub setpoints: u32,
}

impl Report {
    /// Of a plan.
    pub fn new(plan: &Plan) -> Self {
        let mut layers: Vec<LayerReport> = Vec::new();
        // Moves after a layer's path belong to that row only when it is the last.
        let mut between = 0.0;
        for step in plan.moves() {
            match (step.kind, &step.route) {
                (MoveKind::Deposit, Route::Curves(curves)) => {
                    layers.push(layer(plan, step, curves.length(), between));
                    between = 0.0;
                }
                _ => between += step.profile.duration(),
            }
        }
        if let Some(last) = layers.last_mut() {
            last.between_s += between;
        }
        let sum = |value: fn(&LayerReport) -> f64| layers.iter().map(value).sum();
        Self {
            length_m: sum(|layer| layer.length_m),
            time_s: sum(|layer| layer.time_s),
            volume_m3: sum(|layer| layer.volume_m3),
            between_s: sum(|layer| layer.between_s),
            approach_s: plan.approach().duration,
            rate_hz: plan.rate(),
            setpoints: plan.last_seq(),
            layers,
        }
    }

    /// A table for a terminal, in workshop units.
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<5} {:<24} {:>9} {:>9} {:>8} {:>9} {:>9} {:>10}  {}\n",
            "layer", "name", "length m", "time s", "mm/s", "litres", "mm³/s", "between s", "what binds"
        );
        for layer in &self.layers {
            text += &format!(
                "{:<5} {:<24} {:>9.4} {:>9.3} {:>8.2} {:>9.4} {:>9.0} {:>10.2}  {}\n",
                layer.layer,
                layer.name,
                layer.length_m,
                layer.time_s,
                layer.cruise_m_s * 1e3,
                layer.volume_m3 * 1e3,
                layer.flow_max_m3_s * 1e9,
                layer.between_s,
                layer.binding()
            );
        }
        text += &format!(
            "{:<5} {:<24} {:>9.4} {:>9.3} {:>8} {:>9.4} {:>9} {:>10.2}  {} setpoints at {} Hz, approach {:.2} s of the time between\n",
            "all",
            "",
            self.length_m,
            self.time_s,
            "",
            self.volume_m3 * 1e3,
            "",
            self.between_s,
            self.setpoints,
            self.rate_hz,
            self.approach_s
        );
        text
    }

    /// A row a layer under a row of names; SI units, which the names carry.
    pub fn csv(&self) -> String {
        let mut text =
            "layer,name,length_m,time_s,cruise_m_s,velocity_max_m_s,acceleration_max_m_s2,softness,volume_m3,\
                        flow_max_m3_s,corners,by_curvature,by_length,between_s\n"
                .to_owned();
        for l in &self.layers {
            text += &format!(
                "{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n",
                l.layer,
                quoted(&l.name),
                l.length_m,
                l.time_s,
                l.cruise_m_s,
                l.velocity_max_m_s,
                l.acceleration_max_m_s2,
                l.softness,
                l.volume_m3,
                l.flow_max_m3_s,
                l.corners,
                l.by_curvature,
                l.by_length,
                l.between_s
            );
        }
        text
    }

    /// The whole report as JSON, SI units in the names.
    ///
    /// # Errors
    /// Those of `serde_json`; none of the values can cause one.
    pub fn json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self)
    }
}

impl LayerReport {
    /// What keeps the layer from another speed, in words.
    pub fn binding(&self) -> String {
        let mut words = vec![if self.softness < 1.0 {
            format!("speed limit; ramps {:.0} % tanh", 100.0 * self.softness)
        } else {
            "layer time".to_owned()
        }];
        for (count, what) in
            [(self.corners, "corners"), (self.by_curvature, "slower in curves"), (self.by_length, "too short for it")]
        {
            if count > 0 {
                words.push(format!("{count} {what}"));
            }
        }
        words.join(", ")
    }
}

fn layer(plan: &Plan, step: &Move, length: f64, between: f64) -> LayerReport {
    let (profile, pace) = (&step.profile, step.profile.pace());
    let Limited { by_curvature, by_length } = profile.limited();
    LayerReport {
        layer: step.layer,
        name: plan.layer_name(step.layer).to_owned(),
        length_m: length,
        time_s: profile.duration(),
        cruise_m_s: pace.cruise,
        velocity_max_m_s: profile.velocity_max(),
        acceleration_max_m_s2: step.limits.acceleration_max,
        softness: pace.softness,
        volume_m3: step.bead * length,
        flow_max_m3_s: step.bead * profile.velocity_max(),
        corners: profile.rest_count().saturating_sub(1),
        by_curvature,
        by_length,
        between_s: between,
    }
}

/// A field of CSV: RFC 4180 wants quotes about commas, quotes and line ends.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Cell;
    use crate::plan::tests::{plan, wall};

    #[test]
    fn a_report_adds_up() {
        let (mut model, cell) = (wall(2), Cell::demo(125).unwrap());
        model.layers[1].name = "top, \"last\"".to_owned();
        let plan = plan(&model, &cell);
        let report = Report::new(&plan);
        assert_eq!(report.layers.len(), 2);
        let length: f64 = model.layers.iter().map(|layer| layer.length()).sum();
        assert!((report.length_m - length).abs() < 1e-12 && (report.time_s - 140.0).abs() < 1e-8);
        assert!((report.volume_m3 - 0.015 * 0.024 * length).abs() < 1e-15);
        let moves: f64 = plan.moves().iter().map(|step| step.profile.duration()).sum();
        assert!((report.between_s + report.time_s - moves).abs() < 1e-9);
        // 24 segments; the arc at the end goes on from the last leg without a corner.
        assert_eq!(report.layers[0].corners, 22);
        let csv = report.csv();
        let rows: Vec<_> = csv.lines().collect();
        assert_eq!(rows.len(), 3);
        assert_eq!(rows[0].split(',').count(), rows[1].split(',').count());
        assert!(rows[2].starts_with("1,\"top, \"\"last\"\"\","));
        let json: serde_json::Value = serde_json::from_str(&report.json().unwrap()).unwrap();
        assert_eq!(json["layers"][1]["name"], "top, \"last\"");
        assert_eq!(json["setpoints"], report.setpoints);
        assert!(report.table().contains("layer time, 22 corners"), "{}", report.table());
    }
}
