//! Points, directions and nested placements, in metres.

use crate::model::error::ModelError;
use crate::model::p21::Record;
use crate::plan::path::Point;
use nalgebra::{Matrix3, Vector3};
use screed_kernel::pose::Pose;

/// Site, building, storey, wall, layer: real chains have five to ten links. Longer is a circle.
const DEPTH_MAX: usize = 64;

/// A cartesian point; one of two coordinates lies at z = 0. `length` is the metres in a length unit.
pub fn point(record: &Record<'_>, length: f64) -> Result<Point, ModelError> {
    if record.keyword != "IFCCARTESIANPOINT" {
        return Err(record.wrong("type", "IFCCARTESIANPOINT", record.keyword));
    }
    coordinates(record, &record.reals(0, "Coordinates")?, "Coordinates").map(|point| Point::from(point.coords * length))
}

/// Two or three numbers as a point.
pub fn coordinates(record: &Record<'_>, numbers: &[f64], attribute: &'static str) -> Result<Point, ModelError> {
    match *numbers {
        [x, y] => Ok(Point::new(x, y, 0.0)),
        [x, y, z] => Ok(Point::new(x, y, z)),
        _ => Err(record.wrong(attribute, "2 or 3 coordinates", numbers.len().to_string())),
    }
}

/// A direction as a unit vector.
pub fn direction(record: &Record<'_>) -> Result<Vector3<f64>, ModelError> {
    if record.keyword != "IFCDIRECTION" {
        return Err(record.wrong("type", "IFCDIRECTION", record.keyword));
    }
    let ratios = coordinates(record, &record.reals(0, "DirectionRatios")?, "DirectionRatios")?.coords;
    // Divided by the largest first, so that no square overflows or vanishes.
    let largest = ratios.amax();
    match (ratios / largest).try_normalize(0.0) {
        Some(unit) if largest > 0.0 && unit.iter().all(|value| value.is_finite()) => Ok(unit),
        _ => Err(record.wrong("DirectionRatios", "a direction", "all zero")),
    }
}

/// The pose that an `IfcAxis2Placement3D` or `…2D` gives, axes completed as the schema's functions `IfcBuildAxes`,
/// `IfcFirstProjAxis` and `IfcBuild2Axes` say.
pub fn axis_placement(record: &Record<'_>, length: f64) -> Result<Pose, ModelError> {
    let axis = |index, name| record.follow_if_given(index, name)?.map(|given| direction(&given)).transpose();
    let (z, reference) = match record.keyword {
        "IFCAXIS2PLACEMENT3D" => (axis(1, "Axis")?.unwrap_or_else(Vector3::z), axis(2, "RefDirection")?),
        "IFCAXIS2PLACEMENT2D" => (Vector3::z(), axis(1, "RefDirection")?),
        _ => return Err(unsupported(record, "IfcAxis2Placement3D")),
    };
    let location = point(&record.follow(0, "Location")?, length)?;
    let reference = reference.unwrap_or_else(|| if z == Vector3::x() { Vector3::y() } else { Vector3::x() });
    // Parallel to within a nanoradian, the projection has no digits left.
    let x = (reference - z * reference.dot(&z))
        .try_normalize(1e-9)
        .ok_or_else(|| record.wrong("RefDirection", "a direction across Axis", "one along it"))?;
    Ok(Pose { rotation: Matrix3::from_columns(&[x, z.cross(&x), z]), translation: location.coords })
}

/// Where an object placement lies in the world (the site).
pub fn world_from_local(record: &Record<'_>, length: f64) -> Result<Pose, ModelError> {
    Ok(walk(record, None, length)?.0)
}

/// Where an object placement lies in the frame of the placement numbered `outer`, which lies in the world at
/// `world_from_outer`. Where the chain passes through `outer`, world coordinates and their rounding are left out.
pub fn outer_from_local(
    record: &Record<'_>,
    outer: Option<u64>,
    world_from_outer: &Pose,
    length: f64,
) -> Result<Pose, ModelError> {
    match walk(record, outer, length)? {
        (outer_from_local, true) => Ok(outer_from_local),
        (world_from_local, false) => Ok(world_from_outer.inverse() * world_from_local),
    }
}

/// Up the chain to `stop` (true) or to the world (false).
fn walk(record: &Record<'_>, stop: Option<u64>, length: f64) -> Result<(Pose, bool), ModelError> {
    let mut pose = Pose::identity();
    let mut link = record.open(record.id())?;
    for _ in 0..DEPTH_MAX {
        if stop == Some(link.id()) {
            return Ok((pose, true));
        }
        if link.keyword != "IFCLOCALPLACEMENT" {
            return Err(unsupported(&link, "IfcLocalPlacement"));
        }
        pose = axis_placement(&link.follow(1, "RelativePlacement")?, length)? * pose;
        match link.follow_if_given(0, "PlacementRelTo")? {
            Some(outer) => link = outer,
            None => return Ok((pose, false)),
        }
    }
    Err(ModelError::TooDeep { entity: link.entity(), limit: DEPTH_MAX })
}

fn unsupported(record: &Record<'_>, instead: &'static str) -> ModelError {
    ModelError::Unsupported { entity: record.entity(), what: "placement", of: String::new(), instead }
}
