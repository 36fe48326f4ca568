//! What cannot be run is refused with the place, the figure and a remedy, before anything moves.

use super::*;
use crate::config::Bound;
use crate::plan::error::JointQuantity;
use screed_kernel::guard::Plane;

fn demo() -> (FimModel, Cell) {
    (wall(2), Cell::demo(125).unwrap())
}

#[test]
fn layers_that_are_not_there() {
    let (model, cell) = demo();
    let options = Options { from_layer: 2, ..Options::default() };
    let refused = Plan::new(&model, &cell, &options, &cell.robot.start).unwrap_err();
    assert_eq!(refused, PlanError::NoSuchLayers { from_layer: 2, count: 0, layers: 2 });
    let none = Options { layers: Some(0), ..Options::default() };
    assert!(matches!(Plan::new(&model, &cell, &none, &cell.robot.start), Err(PlanError::NoSuchLayers { .. })));
    assert!(matches!(attempt(&wall(0), &cell), Err(PlanError::NoSuchLayers { layers: 0, .. })));
}

#[test]
fn a_layer_time_that_the_limits_do_not_allow_names_the_shortest() {
    let (mut model, cell) = demo();
    model.layers[1].process.layer_time = 20.0;
    let Err(PlanError::LayerTimeTooShort { layer, wanted, shortest }) = attempt(&model, &cell) else { panic!() };
    assert_eq!((layer.as_str(), wanted), ("Layer 001", 20.0));
    // 4.4 m and 22 corners at 0.25 m/s and 0.25 m/s²: no less than 1 s a corner and a second for a quarter metre.
    assert!((30.0..60.0).contains(&shortest), "{shortest}");
    model.layers[1].process.layer_time = shortest * (1.0 + 1e-9);
    assert!(attempt(&model, &cell).is_ok());
    model.layers[1].process.layer_time = shortest * (1.0 - 1e-6);
    assert!(attempt(&model, &cell).is_err());
}

#[test]
fn process_values_that_are_no_positive_numbers() {
    let (model, cell) = demo();
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        for i in 0..5 {
            let mut model = model.clone();
            let process = &mut model.layers[1].process;
            *[
                &mut process.layer_time,
                &mut process.acceleration_max,
                &mut process.layer_height,
                &mut process.filament_width,
                process.velocity_max.insert(0.1),
            ][i] = bad;
            assert!(matches!(attempt(&model, &cell), Err(PlanError::Process { layer, .. }) if layer == "Layer 001"));
        }
    }
}

#[test]
fn paths_with_holes_and_layers_without_paths() {
    let (mut model, cell) = demo();
    model.layers[0].segments.remove(5);
    assert!(matches!(attempt(&model, &cell), Err(PlanError::Gap { segment: 5, gap, .. }) if gap > 0.05));
    model.layers[0].segments.clear();
    assert_eq!(attempt(&model, &cell), Err(PlanError::EmptyLayer { layer: "Layer 000".to_owned() }));
}

#[test]
fn points_out_of_reach_are_named_with_layer_segment_and_place() {
    let (model, mut cell) = demo();
    // A little too far: the first segments are in reach, a later one is not.
    let mut seen = false;
    for step in 0..40 {
        cell.part.base_from_part.translation.x = 0.3 + 0.02 * f64::from(step);
        match attempt(&model, &cell) {
            Err(error @ PlanError::OutOfReach { .. }) => {
                let text = error.to_string();
                assert!(text.contains("mm in the part frame") && text.contains("part.xyz_mm"), "{text}");
                seen |= text.contains("deposit of layer \"Layer 000\", segment ");
            }
            Err(PlanError::JointLimit { .. }) | Ok(_) => {}
            Err(other) => panic!("{other}"),
        }
    }
    assert!(seen);
    assert!(matches!(attempt(&model, &cell), Err(PlanError::OutOfReach { .. })), "1.08 m ahead");
}

#[test]
fn a_place_beyond_the_workspace_is_named_with_its_bound() {
    let (model, mut cell) = demo();
    let bound = |offset| Bound { key: "z_min_mm", plane: Plane { normal_in_base: [0.0, 0.0, -1.0], offset } };
    // The nozzle goes down to the first layer, 15 mm above the part's frame.
    let lowest = cell.part.base_from_part.translation.z + model.layers[0].process.layer_height;
    cell.workspace = vec![bound(-lowest + 1e-3)];
    assert!(attempt(&model, &cell).is_ok());
    cell.workspace = vec![bound(-lowest - 1e-3)];
    let Err(error @ PlanError::Workspace { .. }) = attempt(&model, &cell) else { panic!() };
    assert!(error.to_string().contains("beyond workspace.z_min_mm"), "{error}");
    // A limit that the kernel would refuse is an error of the cell, before there is a plan.
    cell.workspace[0].plane.normal_in_base = [0.0, 0.0, -2.0];
    assert!(matches!(attempt(&model, &cell), Err(PlanError::Refused(_))));
}

#[test]
fn joints_that_would_be_too_fast_are_named_with_their_limit() {
    for quantity in [JointQuantity::Velocity, JointQuantity::Acceleration, JointQuantity::Jerk] {
        let (model, mut cell) = demo();
        let robot = &mut cell.robot;
        // The approach scales with its joints' limits; the straight moves do not, they are refused.
        let limit = match quantity {
            JointQuantity::Velocity => &mut robot.joint_velocity_max.0[1],
            JointQuantity::Acceleration => &mut robot.joint_acceleration_max.0[1],
            JointQuantity::Jerk => &mut robot.joint_jerk_max.0[1],
        };
        *limit *= 0.02;
        let low = *limit;
        let Err(PlanError::JointLimit { place, joint: 1, quantity: named, found, limit }) = attempt(&model, &cell)
        else {
            panic!("{quantity:?}")
        };
        assert_eq!((named, limit), (quantity, low));
        assert!(found.abs() > limit && place.kind != MoveKind::Approach);
    }
}

#[test]
fn a_flow_beyond_the_extruder_and_a_start_beyond_the_joints() {
    let (model, mut cell) = demo();
    cell.extruder.flow_max = 2e-5;
    let Err(PlanError::FlowTooHigh { flow, flow_max, .. }) = attempt(&model, &cell) else { panic!() };
    assert!(flow > flow_max && flow < 5e-5, "{flow}");
    for (joint, position) in [(2, f64::NAN), (4, 7.0)] {
        let (model, cell) = demo();
        let mut start = cell.robot.start;
        start.0[joint] = position;
        let refused = Plan::new(&model, &cell, &Options::default(), &start);
        assert!(matches!(refused, Err(PlanError::Start { joint: named, .. }) if named == joint));
    }
}

#[test]
fn where_the_nearest_branch_does_not_do_another_is_taken() {
    let (model, mut cell) = demo();
    let usual = plan(&model, &cell).approach().to;
    // The elbow may not be where the nearest branch has it.
    cell.robot.arm.position_min.0[2] = usual.0[2] + 0.5;
    cell.robot.start.0[2] = usual.0[2] + 1.5;
    let other = plan(&model, &cell);
    assert!((other.approach().to.0[2] - usual.0[2]).abs() > 0.5);
    assert_motion(&cell, &padded(&assert_batches(&other, &cell)), "another branch");
}

#[test]
fn a_stop_that_takes_longer_than_the_ring_holds() {
    let (mut model, mut cell) = (wall(1), Cell::demo(500).unwrap());
    model.layers[0].process.acceleration_max = 0.005;
    model.layers[0].process.layer_time = 1.0;
    let Err(PlanError::LayerTimeTooShort { shortest, .. }) = attempt(&model, &cell) else { panic!() };
    model.layers[0].process.layer_time = 1.001 * shortest;
    let Err(PlanError::StopTooLong { kind, needed, room, .. }) = attempt(&model, &cell) else { panic!() };
    assert_eq!((kind, room), (MoveKind::Deposit, 8.192));
    assert!(needed > room);
    cell.link.rate_hz = 125;
    assert!(attempt(&model, &cell).is_ok());
}
