//! Whole jobs, judged on their setpoints alone: forward kinematics and differences over samples.

mod refusals;

use super::path::Segment;
use super::*;
use crate::model::fim::{Layer, Process};
use core::f64::consts::FRAC_PI_2;
use nalgebra::Vector3;
use screed_kernel::pose::Pose;

/// splitmix64: the same numbers on every machine.
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * (((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64)
    }
}

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

pub fn attempt(model: &FimModel, cell: &Cell) -> Result<Plan, PlanError> {
    Plan::new(model, cell, &Options::default(), &cell.robot.start)
}

pub fn plan(model: &FimModel, cell: &Cell) -> Plan {
    attempt(model, cell).unwrap()
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
    // Where a line meets an arc without a corner, the acceleration across the path steps with the curvature; the jerk limit
    // is one along the path, so that it is judged where five points lie on one straight line.
    for (i, window) in points.windows(5).enumerate().filter(|(i, _)| setpoints[i + 1].kind != MoveKind::Approach) {
        let along = window[4] - window[0];
        if along.norm() > 1e-7 && window.iter().all(|p| (p - window[0]).cross(&along).norm() < 1e-9 * along.norm()) {
            let jerk = (window[3] - window[2] * 3.0 + window[1] * 3.0 - window[0]).norm() / (dt * dt * dt);
            // Joints on their grid, 1e-11 m at the tool, differenced three times.
            let rounding = 8e-11 / (dt * dt * dt);
            assert!(jerk <= cell.limits.path_jerk_max * 1.001 + rounding, "{what}, {i}: {jerk} m/s³");
        }
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
        // A second or more of path, and no batch without a stop.
        assert!(
            tail.len() >= 2 && (ahead.len() >= plan.rate() as usize || ahead[ahead.len() - 1].seq == plan.last_seq())
        );
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

/// A path within 0.12 m of the middle of the demo's wall: lines and arcs, with corners and without.
fn wandering(random: &mut Random, index: usize) -> Layer {
    let z = 0.015 * (index as f64 + 1.0);
    let middle = Point::new(0.45, 0.45, z);
    let (mut at, mut heading) = (middle, random.between(-3.0, 3.0));
    let mut segments: Vec<Segment> = Vec::new();
    while segments.len() < 12 {
        // A corner, none, or one too slight to see, on both sides of what counts as one.
        let turn = match random.between(0.0, 4.0) as usize {
            0 | 1 => random.between(-3.0, 3.0),
            2 => 10f64.powf(random.between(-8.0, -4.0)),
            _ => 0.0,
        };
        let direction = Vector3::new((heading + turn).cos(), (heading + turn).sin(), 0.0);
        let (segment, swept) = if random.between(0.0, 1.0) < 0.5 {
            (Segment::line(at, at + direction * 10f64.powf(random.between(-3.0, -0.8))).unwrap(), 0.0)
        } else {
            let (radius, sweep) = (random.between(0.01, 0.2), random.between(-3.0, 3.0));
            let left = Vector3::new(-direction.y, direction.x, 0.0) * f64::signum(sweep);
            let frame = (-left, direction * f64::signum(sweep));
            (Segment::arc(at + left * radius, frame.0, frame.1, radius, 0.0, sweep).unwrap(), sweep)
        };
        if (0..=10).all(|i| (segment.eval(f64::from(i) / 10.0) - middle).norm() < 0.12) {
            at = segment.end();
            heading += turn + swept;
            segments.push(segment);
        } else {
            // Away from the rim: a corner, if the path goes on from here.
            heading = random.between(-3.0, 3.0);
        }
    }
    Layer { segments, ..layer(index, 1e-3) }
}

#[test]
fn random_paths_keep_the_limits_in_every_batch() {
    let cell = Cell::demo(125).unwrap();
    let mut random = Random(20);
    for case in 0..40 {
        let mut model = wall(0);
        model.layers.push(wandering(&mut random, 0));
        let Err(PlanError::LayerTimeTooShort { shortest, .. }) = attempt(&model, &cell) else { panic!("case {case}") };
        model.layers[0].process.layer_time = shortest * random.between(1.000_001, 3.0);
        let path = assert_batches(&plan(&model, &cell), &cell);
        assert_motion(&cell, &padded(&path), &format!("case {case}"));
        let mut contour = contour::Contour::new(&model.layers[0].segments);
        for setpoint in path.iter().filter(|setpoint| setpoint.deposit) {
            let off = contour.distance(&tool(&cell, setpoint).into());
            assert!(off < 1e-9, "case {case}: contour {off:e}");
        }
    }
}

/// Every unit's own geometry, by iteration, keeps the contour as the nominal one does by its closed form; the nominal joints on
/// the unit would be a millimetre off.
#[test]
fn a_calibrated_unit_keeps_the_contour() {
    let path = screed_fixtures::data("kinematics/calibration_ur10e_dh_delta_1.json");
    let file: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let lists = ["theta", "a", "d", "alpha"].map(|key| format!("delta_{key} = {}\n", file["dh_delta"][key]));
    let folder = tempfile::tempdir().unwrap();
    let unit = folder.path().join("unit.conf");
    std::fs::write(&unit, format!("[mounting]\n{}", lists.concat())).unwrap();
    let (model, nominal) = (wall(1), Cell::demo(125).unwrap());
    let mut cell = nominal.clone();
    cell.robot.arm = crate::robot::calibration::load(&unit, &nominal.robot.arm).unwrap().arm;
    let path = assert_batches(&plan(&model, &cell), &cell);
    let worst = |cell: &Cell| {
        let mut contour = contour::Contour::new(&model.layers[0].segments);
        let deposits = path.iter().filter(|setpoint| setpoint.deposit);
        deposits.map(|setpoint| contour.distance(&tool(cell, setpoint).into())).fold(0.0, f64::max)
    };
    assert!(worst(&cell) < 1e-9, "{:e}", worst(&cell));
    assert!(worst(&nominal) > 2e-4, "{:e}", worst(&nominal));
}

#[test]
fn a_brake_that_runs_into_a_curve_keeps_the_whole_acceleration() {
    // Laps of straights and half circles without a corner, at one speed: 0.13 m/s takes 0.17 m/s² in the curves, so that a
    // brake which begins on a straight with 0.25 m/s² must not reach a curve.
    let cell = Cell::demo(125).unwrap();
    let z = 0.015;
    let (left, right) = (Point::new(0.35, 0.45, z), Point::new(0.55, 0.45, z));
    let r = Vector3::new(0.0, 0.1, 0.0);
    let half =
        |center, x: Vector3<f64>| Segment::arc(center, x, Vector3::z().cross(&x), 0.1, 0.0, core::f64::consts::PI);
    let lap = [
        Segment::line(left - r, right - r).unwrap(),
        half(right, -Vector3::y()).unwrap(),
        Segment::line(right + r, left + r).unwrap(),
        half(left, Vector3::y()).unwrap(),
    ];
    let mut model = wall(1);
    model.layers[0].segments = lap.iter().cycle().take(40).cloned().collect();
    model.layers[0].process.layer_time = 10.0 * (0.4 + 0.2 * core::f64::consts::PI) / 0.13;
    let plan = plan(&model, &cell);
    assert_eq!(plan.moves()[2].profile.rest_count(), 1);
    let path = assert_batches(&plan, &cell);
    assert_motion(&cell, &padded(&path), "laps");
}

#[test]
fn the_same_plan_gives_the_same_bits() {
    let (model, cell) = (wall(1), Cell::demo(125).unwrap());
    let (first, second) = (plan(&model, &cell), plan(&model, &cell));
    assert!(first.batches().map(Result::unwrap).eq(second.batches().map(Result::unwrap)));
    for setpoint in assert_batches(&first, &cell) {
        let grid = setpoint.joints.0.map(|joint| joint * (1u64 << 36) as f64);
        assert!(grid.iter().all(|joint| joint.fract() == 0.0));
    }
}

#[test]
fn a_job_can_start_at_a_layer_and_run_dry() {
    let (model, cell) = (wall(3), Cell::demo(125).unwrap());
    let options = Options { from_layer: 1, layers: Some(1), dry: true };
    let plan = Plan::new(&model, &cell, &options, &cell.robot.start).unwrap();
    let path = assert_batches(&plan, &cell);
    assert!(path.iter().all(|setpoint| setpoint.layer == 1 && setpoint.flow == 0.0));
    assert_eq!(path.iter().filter(|setpoint| setpoint.deposit).count(), 8750);
    let kinds: Vec<_> = plan.moves().iter().map(|step| step.kind).collect();
    assert_eq!(kinds, [MoveKind::Approach, MoveKind::Lower, MoveKind::Deposit, MoveKind::Lift]);
    assert_eq!(plan.move_of(1).unwrap().kind, MoveKind::Approach);
    assert_eq!(plan.move_of(plan.last_seq()).unwrap().kind, MoveKind::Lift);
    assert!(plan.move_of(plan.last_seq() + 1).is_none());
    // From where the job would begin, there is nothing to approach.
    let there = Plan::new(&model, &cell, &options, &plan.approach().to).unwrap();
    assert_eq!(there.moves()[0].kind, MoveKind::Lower);
    assert_eq!(there.approach().duration, 0.0);
}

#[test]
fn both_models_of_the_project_are_planned_each_layer_in_its_time() {
    let generated = screed_fixtures::quarter_circle(&screed_fixtures::QuarterCircle::default());
    let larger = std::fs::read(screed_fixtures::data("FIM_fixture_IFC4.ifc")).unwrap();
    let larger_cell = crate::config::load(&screed_fixtures::data("../cells/fim_fixture.toml")).unwrap();
    let jobs = [(generated.into_bytes(), Cell::demo(125).unwrap()), (larger, larger_cell)];
    for (rate, (text, mut cell)) in jobs.into_iter().flat_map(|job| [(125, job.clone()), (500, job)]) {
        let mut model = crate::model::fim::parse("model.ifc", &text).unwrap();
        model.layers.truncate(2);
        cell.link.rate_hz = rate;
        let path = assert_batches(&plan(&model, &cell), &cell);
        for layer in 0..2 {
            let count = path.iter().filter(|setpoint| setpoint.deposit && setpoint.layer == layer).count();
            assert_eq!(count, 70 * cell.link.rate_hz as usize);
        }
        assert_motion(&cell, &padded(&path), &cell.name);
    }
}
