//! The fixtures against figures computed elsewhere, and what bad models are answered.

use super::*;
use crate::plan::path::Point;
use screed_fixtures::{PATH_LENGTH, QuarterCircle, quarter_circle};

/// The larger model of this project, written with IfcOpenShell. Its figures are analytic, from its author.
fn large() -> String {
    std::fs::read_to_string(screed_fixtures::data("FIM_fixture_IFC4.ifc")).expect("the fixture is in the repository")
}

fn small() -> String {
    quarter_circle(&QuarterCircle { layers: 2, ..QuarterCircle::default() })
}

fn parsed(text: &str) -> FimModel {
    parse("model.ifc", text.as_bytes()).unwrap_or_else(|error| panic!("{error}"))
}

fn refused(text: &str) -> ModelError {
    parse("model.ifc", text.as_bytes()).expect_err("must be refused")
}

/// The text with one passage replaced, which must occur.
fn with(text: &str, old: &str, new: &str) -> String {
    assert!(text.contains(old), "the model has no '{old}'");
    text.replacen(old, new, 1)
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected} within {tolerance:e}");
}

#[test]
fn the_large_model_has_its_analytic_lengths_and_its_place_in_the_world() {
    let model = parsed(&large());
    assert_eq!(model.schema, "IFC4");
    assert_eq!(model.name, "Printed quarter-circle wall");
    assert_eq!(model.wall_guid, "2jvMlMWvz2CPeqfu3J0tQ9");
    assert_eq!(model.layers.len(), 5);
    for (index, layer) in model.layers.iter().enumerate() {
        assert_eq!((layer.index, layer.segments.len()), (index, 5 - 1 + 24 + 1));
        close(layer.length(), 8.983187172, 1e-9);
        close(layer.segments.last().expect("segments").length(), 0.0896155419, 1e-9);
        close(layer.segments[0].start().z, 0.015 * (index + 1) as f64, 1e-12);
    }
    let (mut low, mut high) = (Point::new(9e9, 9e9, 9e9), Point::new(-9e9, -9e9, -9e9));
    // The published box is without the tail, which IfcOpenShell cannot evaluate and which dips 2.3 mm below it.
    for segment in &model.layers[0].segments[..29] {
        for step in 0..=200 {
            let point = model.site_from_part.transform_point(&segment.eval(f64::from(step) / 200.0).coords);
            (low, high) = (Point::from(low.coords.inf(&point)), Point::from(high.coords.sup(&point)));
        }
    }
    for (found, expected) in low.iter().chain(high.iter()).zip([9.96, 0.66, 0.015, 11.4353, 1.28, 0.015]) {
        close(*found, expected, 1e-4);
    }
}

#[test]
fn the_generated_model_is_the_published_print() {
    let model = parsed(&quarter_circle(&QuarterCircle::default()));
    assert_eq!(model.layers.len(), 10);
    for layer in &model.layers {
        assert_eq!(layer.segments.len(), 1 + 1 + 19 + 2 + 1);
        close(layer.length(), PATH_LENGTH, 1e-9);
        for (before, after) in layer.segments.iter().zip(&layer.segments[1..]) {
            close((after.start() - before.end()).norm(), 0.0, 1e-11);
        }
        let expected = Process {
            layer_time: 70.0,
            acceleration_max: 0.25,
            velocity_max: Some(0.25),
            nozzle_diameter: Some(0.02),
            layer_height: 0.015,
            filament_width: 0.024,
            extrusion_rate: layer.process.extrusion_rate,
        };
        assert_eq!(layer.process, expected);
        close(layer.process.extrusion_rate.expect("declared"), 4.015 / 70.0 * 0.024 * 0.015, 1e-10);
    }
    // Contours and zigzag by hand: π/2·(0.55 + 0.65) + 19·√(0.1² + 4·0.55·0.65·sin²(π/76)).
    let of = |range: std::ops::Range<usize>| model.layers[0].segments[range].iter().map(Segment::length).sum::<f64>();
    close(of(1..2) + of(21..23), 1.884_955_592_153_876, 1e-11);
    close(of(2..21), 19.0 * (0.01 + 4.0 * 0.55 * 0.65 * (std::f64::consts::PI / 76.0).sin().powi(2)).sqrt(), 1e-11);
    // The turned circle, its seam and SameSense .F. lead where the path goes on: (0.65, 0) at the tail's start.
    close((model.layers[9].segments[22].end() - Point::new(0.65, 0.0, 0.15)).norm(), 0.0, 1e-11);
    close((model.layers[0].segments[0].tangent_at(0.0) - nalgebra::Vector3::x()).norm(), 0.0, 1e-12);
}
