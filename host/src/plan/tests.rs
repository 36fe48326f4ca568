//! Whole jobs, judged on their setpoints alone: forward kinematics and differences over samples.

use super::path::Segment;
use super::*;
use crate::model::fim::{Layer, Process};
use core::f64::consts::FRAC_PI_2;
use nalgebra::Vector3;
use screed_kernel::pose::Pose;

/// A quarter-circular wall with zigzag, a spline to begin with, and a hook joined without a corner to end with.
pub fn layer(index: usize, layer_time: f64) -> Layer {
    let z = 0.015 * (index as f64 + 1.0);
    let at = |radius: f64, angle: f64| Point::new(radius * angle.cos(), radius * angle.sin(), z);
    let arc = |radius, start, sweep| {
        Segment::arc(Point::new(0.0, 0.0, z), Vector3::x(), Vector3::y(), radius, start, sweep).unwrap()
    };
    let (inner, outer) = (0.55, 0.65);
    let lead_in = [(0.50, -0.05), (0.56, -0.08), (0.62, -0.03), (0.60, 0.01), (0.65, 0.0)];
    let lead_in = lead_in.map(|(x, y)| Point::new(x, y, z)).to_vec();
    let knots = vec![0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0];
    let mut segments = vec![
        Segment::spline(3, lead_in, knots, None).unwrap(),
        arc(outer, 0.0, FRAC_PI_2),
        Segment::line(at(outer, FRAC_PI_2), at(inner, FRAC_PI_2)).unwrap(),
        arc(inner, FRAC_PI_2, -FRAC_PI_2),
    ];
    let mut from = at(inner, 0.0);
    for leg in 1..=19 {
        let to = at(if leg % 2 == 1 { outer } else { inner }, FRAC_PI_2 * f64::from(leg) / 19.0);
        segments.push(Segment::line(from, to).unwrap());
        from = to;
    }
    // Out of the last leg a half circle of 30 mm, tangent to it.
    let along = segments[segments.len() - 1].tangent_at(0.0);
    let across = Vector3::new(-along.y, along.x, 0.0);
    segments.push(Segment::arc(from + across * 0.03, -across, along, 0.03, 0.0, core::f64::consts::PI).unwrap());
    let process = Process {
        layer_time,
        acceleration_max: 0.25,
        velocity_max: None,
        nozzle_diameter: None,
        layer_height: 0.015,
        filament_width: 0.024,
        extrusion_rate: None,
    };
    Layer { index, name: format!("Layer {index:03}"), guid: String::new(), entity: 0, segments, process }
}

pub fn wall(layers: usize) -> FimModel {
    FimModel {
        schema: "IFC4".to_owned(),
        name: "wall".to_owned(),
        wall_guid: String::new(),
        site_from_part: Pose::identity(),
        layers: (0..layers).map(|index| layer(index, 70.0)).collect(),
    }
}

pub fn plan(model: &FimModel, cell: &Cell) -> Plan {
    Plan::new(model, cell, &Options::default(), &cell.robot.start).unwrap()
}

/// What the checker knows of one setpoint: the tool centre point by forward kinematics, in the part frame.
fn tool(cell: &Cell, setpoint: &Setpoint) -> Vector3<f64> {
    let tcp = cell.robot.arm.forward(&setpoint.joints) * cell.tool.flange_from_tcp;
    (cell.part.base_from_part.inverse() * tcp).translation
}

/// Every difference over samples within limits; `setpoints` begin and end at rest.
fn assert_motion(cell: &Cell, setpoints: &[Setpoint], what: &str) {
    let dt = 1.0 / f64::from(cell.link.rate_hz);
    let points: Vec<_> = setpoints.iter().map(|setpoint| tool(cell, setpoint)).collect();
    for (i, window) in points.windows(3).enumerate() {
        let kind = setpoints[i + 1].kind;
        let limit = if kind == MoveKind::Deposit { 0.25 } else { cell.travel.acceleration_max };
        let acceleration = (window[2] - window[1] * 2.0 + window[0]) / (dt * dt);
        assert!(acceleration.norm() <= limit * 1.001, "{what}, {i}, {kind}: {} m/s²", acceleration.norm());
        let speed = (window[1] - window[0]).norm() / dt;
        let limit = if kind == MoveKind::Deposit { 0.25 } else { cell.travel.velocity_max };
        assert!(speed <= limit * 1.001, "{what}, {i}, {kind}: {speed} m/s");
    }
    for joint in 0..6 {
        let q: Vec<_> = setpoints.iter().map(|setpoint| setpoint.joints.0[joint]).collect();
        let robot = &cell.robot;
        assert!(q.windows(2).all(|q| (q[1] - q[0]).abs() <= robot.joint_velocity_max.0[joint] * dt), "{what}");
        let second = |q: &[f64]| (q[2] - 2.0 * q[1] + q[0]).abs() / (dt * dt);
        assert!(q.windows(3).all(|q| second(q) <= robot.joint_acceleration_max.0[joint] * 1.001), "{what}");
    }
    // At rest at the end: the last differences vanish.
    let tail = &setpoints[setpoints.len() - 2..];
    assert_eq!(tail[0].joints, tail[1].joints, "{what}");
    assert_eq!(tail[1].flow, 0.0, "{what}");
}

/// Plays the batches as a ring does, asserting how they join, and gives the path.
fn assert_batches(plan: &Plan, cell: &Cell) -> Vec<Setpoint> {
    let mut path: Vec<Setpoint> = Vec::new();
    for batch in plan.batches() {
        let batch = batch.unwrap();
        assert_eq!(batch.after, path.last().map(|setpoint| setpoint.seq));
        for (i, setpoint) in batch.setpoints.iter().enumerate() {
            assert_eq!(setpoint.seq as usize, path.len() + i + 1, "consecutive");
        }
        let (ahead, tail) = batch.setpoints.split_at(batch.path_len);
        assert!(tail.len() >= 2 && !ahead.is_empty());
        path.extend(ahead);
        // The tail as it would be played, from far enough back that differences at the join count.
        let mut played = path[path.len().saturating_sub(4)..].to_vec();
        played.extend(tail);
        assert_motion(cell, &played, "tail");
    }
    assert_eq!(path.last().unwrap().seq, plan.last_seq());
    path
}

/// A path and one more sample at rest at its end.
fn padded(path: &[Setpoint]) -> Vec<Setpoint> {
    path.iter().chain(path.last()).copied().collect()
}

#[test]
fn every_setpoint_of_a_job_keeps_the_limits_at_both_rates() {
    let model = wall(2);
    for rate in [125, 500] {
        let cell = Cell::demo(rate).unwrap();
        let plan = plan(&model, &cell);
        let path = assert_batches(&plan, &cell);
        assert_eq!(path[0].joints, on_grid(&cell.robot.start));
        assert_motion(&cell, &padded(&path), "path");
        for (index, layer) in model.layers.iter().enumerate() {
            let deposit: Vec<_> = path.iter().filter(|s| s.kind == MoveKind::Deposit && s.layer == index).collect();
            assert_eq!(deposit.len(), 70 * rate as usize, "the layer takes its time, to the sample");
            let bead = 0.015 * 0.024;
            let mut before = layer.segments[0].start().coords;
            let (mut length, mut volume) = (0.0, 0.0);
            for setpoint in &deposit {
                let point = tool(&cell, setpoint);
                let off = layer.segments.iter().map(|segment| segment.distance_to(&point.into()));
                let off = off.fold(f64::INFINITY, f64::min);
                assert!(off < 1e-9, "contour {off:e}");
                length += (point - before).norm();
                volume += setpoint.flow / f64::from(rate);
                before = point;
            }
            // Speed times bead is the flow, so that the sums agree but for the chords.
            let total: f64 = layer.segments.iter().map(Segment::length).sum();
            assert!((volume / (bead * total) - 1.0).abs() < 1e-4, "volume {volume}");
            assert!(length <= total && length > total * 0.999, "length {length} of {total}");
            assert!((before - layer.segments[layer.segments.len() - 1].end().coords).norm() < 1e-9);
        }
        assert!(path.iter().all(|s| s.kind == MoveKind::Deposit || (s.flow == 0.0 && !s.deposit)));
    }
}

/// `cargo test --release -p screed --lib setpoints_a_second -- --ignored --nocapture`
#[test]
#[ignore = "a measurement, not a test"]
fn setpoints_a_second() {
    let (model, cell) = (wall(10), Cell::demo(500).unwrap());
    let began = std::time::Instant::now();
    let plan = plan(&model, &cell);
    let planned = began.elapsed().as_secs_f64();
    let began = std::time::Instant::now();
    let made: usize = plan.batches().map(|batch| batch.unwrap().setpoints.len()).sum();
    let streamed = began.elapsed().as_secs_f64();
    println!("{} setpoints planned and verified in {planned:.2} s", plan.last_seq());
    println!("{made} with tails in {streamed:.2} s: {:.0} a second", made as f64 / streamed);
    println!("greatest batch {:?}", plan.batch_max());
}

#[test]
fn both_models_of_the_project_are_planned_each_layer_in_its_time() {
    let generated = screed_fixtures::quarter_circle(&screed_fixtures::QuarterCircle::default());
    let larger = std::fs::read(screed_fixtures::data("FIM_fixture_IFC4.ifc")).unwrap();
    let larger_cell = crate::config::load(&screed_fixtures::data("../cells/fim_fixture.toml")).unwrap();
    for (text, cell) in [(generated.into_bytes(), Cell::demo(125).unwrap()), (larger, larger_cell)] {
        let mut model = crate::model::fim::parse("model.ifc", &text).unwrap();
        model.layers.truncate(2);
        let path = assert_batches(&plan(&model, &cell), &cell);
        for layer in 0..2 {
            let count = path.iter().filter(|setpoint| setpoint.deposit && setpoint.layer == layer).count();
            assert_eq!(count, 70 * cell.link.rate_hz as usize);
        }
        assert_motion(&cell, &padded(&path), &cell.name);
    }
}
