//! Trimmed lines and circles, and trimmed curves of these.

use super::{Curves, DEPTH_MAX, Point, Record, SUPPORTED, Segment, Value};
use crate::model::error::ModelError;
use crate::model::ifc::placement::{direction, point};
use core::f64::consts::TAU;
use nalgebra::Vector3;

/// Trims closer than this (rad) mean a full circle: 360° written with 12 digits of π comes within it, the shortest arc that
/// can be printed does not.
const FULL_CIRCLE: f64 = 1e-9;
/// How far, relative to its length, a trim may lie outside the trimmed curve that it trims.
const OUTSIDE: f64 = 1e-9;

/// A circle with the axes that its angle counts from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    pub(super) center: Point,
    pub(super) x: Vector3<f64>,
    pub(super) y: Vector3<f64>,
    pub(super) radius: f64,
}

/// What is trimmed in the end.
#[derive(Clone, Copy, Debug)]
enum Basis {
    /// A point and the way (m) that one unit of parameter leads.
    Line {
        origin: Point,
        step: Vector3<f64>,
    },
    Circle(Circle),
}

/// A stretch of a basis, by its parameter (rad for a circle), run through from `from` to `to`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    basis: Basis,
    from: f64,
    to: f64,
}

/// One end of a trimmed curve, as the file gives it.
enum Trim {
    Parameter(f64),
    Point(Point),
}

impl Span {
    pub(super) fn full_circle(circle: Circle) -> Self {
        Self { basis: Basis::Circle(circle), from: 0.0, to: TAU }
    }

    pub(super) fn segment(&self, curve: &Record<'_>) -> Result<Segment, ModelError> {
        match &self.basis {
            Basis::Line { origin, step } => Segment::line(origin + step * self.from, origin + step * self.to),
            Basis::Circle(circle) => {
                Segment::arc(circle.center, circle.x, circle.y, circle.radius, self.from, self.to - self.from)
            }
        }
        .map_err(|error| curve.impossible(error.to_string()))
    }
}

impl<'f> Curves<'_, 'f> {
    pub(super) fn trimmed(&self, curve: &Record<'f>, depth: usize) -> Result<Span, ModelError> {
        if depth >= DEPTH_MAX {
            return Err(ModelError::TooDeep { entity: curve.entity(), limit: DEPTH_MAX });
        }
        let forward = curve.flag(3, "SenseAgreement")?;
        let basis_curve = curve.follow(0, "BasisCurve")?;
        let basis = match basis_curve.keyword {
            "IFCLINE" => self.line_basis(&basis_curve)?,
            "IFCCIRCLE" => Basis::Circle(self.circle(&basis_curve)?),
            "IFCTRIMMEDCURVE" => {
                let inner = self.trimmed(&basis_curve, depth + 1)?;
                return self.trimmed_again(curve, &inner, forward);
            }
            _ => return Err(self.unsupported(&basis_curve, SUPPORTED)),
        };
        let first = self.basis_parameter(curve, &basis, self.trim(curve, 1, "Trim1")?, "Trim1")?;
        let second = self.basis_parameter(curve, &basis, self.trim(curve, 2, "Trim2")?, "Trim2")?;
        let (from, to) = match &basis {
            // Where the flag and the order of the trims contradict each other, which the standard forbids and its own sample
            // files do, the flag decides the direction; a gap to the neighbours shows whether that was meant.
            Basis::Line { .. } if forward => (first.min(second), first.max(second)),
            Basis::Line { .. } => (first.max(second), first.min(second)),
            Basis::Circle(_) => (first, first + sweep(second - first, forward)),
        };
        Ok(Span { basis, from, to })
    }

    /// A trimmed curve's parameter counts from 0 at its first end (ISO 10303-42, trimmed_curve).
    fn trimmed_again(&self, curve: &Record<'f>, inner: &Span, forward: bool) -> Result<Span, ModelError> {
        let length = (inner.to - inner.from).abs();
        let sign = (inner.to - inner.from).signum();
        let along = |trim: Trim, attribute: &'static str| {
            let s = match trim {
                Trim::Parameter(parameter) => self.in_parameter_unit(&inner.basis, parameter),
                Trim::Point(_) => {
                    let s = (self.basis_parameter(curve, &inner.basis, trim, attribute)? - inner.from) * sign;
                    match inner.basis {
                        Basis::Circle(_) if s < -OUTSIDE * length => s.rem_euclid(TAU),
                        _ => s,
                    }
                }
            };
            if s < -OUTSIDE * length || s > length * (1.0 + OUTSIDE) {
                let expected = format!("a place on the trimmed curve #{}, from 0 to {length}", basis_number(curve)?);
                return Err(curve.wrong(attribute, expected, s.to_string()));
            }
            Ok(s)
        };
        let first = along(self.trim(curve, 1, "Trim1")?, "Trim1")?;
        let second = along(self.trim(curve, 2, "Trim2")?, "Trim2")?;
        let (from, to) =
            if forward { (first.min(second), first.max(second)) } else { (first.max(second), first.min(second)) };
        Ok(Span { basis: inner.basis, from: inner.from + sign * from, to: inner.from + sign * to })
    }

    fn line_basis(&self, curve: &Record<'f>) -> Result<Basis, ModelError> {
        let origin = point(&curve.follow(0, "Pnt")?, self.units.length)?;
        let vector = curve.follow(1, "Dir")?;
        let magnitude = vector.real(1, "Magnitude")? * self.units.length;
        if !(magnitude > 0.0 && magnitude.is_finite()) {
            return Err(vector.wrong("Magnitude", "a positive length", magnitude.to_string()));
        }
        Ok(Basis::Line { origin, step: direction(&vector.follow(0, "Orientation")?)? * magnitude })
    }

    fn in_parameter_unit(&self, basis: &Basis, parameter: f64) -> f64 {
        match basis {
            Basis::Line { .. } => parameter,
            Basis::Circle(_) => parameter * self.units.angle,
        }
    }

    /// The end that MasterRepresentation prefers, or the one that is there.
    fn trim(&self, curve: &Record<'f>, index: usize, attribute: &'static str) -> Result<Trim, ModelError> {
        let (mut parameter, mut place) = (None, None);
        for value in curve.list(index, attribute)? {
            match value {
                Value::Typed("IFCPARAMETERVALUE", values) if values.len() == 1 => {
                    parameter = Some(curve.as_real(&values[0], attribute)?);
                }
                Value::Ref(id) => place = Some(point(&curve.open(*id)?, self.units.length)?),
                other => return Err(curve.wrong_value(attribute, "IFCPARAMETERVALUE or a point", other)),
            }
        }
        let points_count = match curve.enumeration(4, "MasterRepresentation")? {
            "CARTESIAN" => true,
            "PARAMETER" | "UNSPECIFIED" => false,
            other => {
                return Err(curve.wrong("MasterRepresentation", ".CARTESIAN., .PARAMETER. or .UNSPECIFIED.", other));
            }
        };
        match (parameter, place) {
            (_, Some(place)) if points_count => Ok(Trim::Point(place)),
            (Some(parameter), _) => Ok(Trim::Parameter(parameter)),
            (None, Some(place)) => Ok(Trim::Point(place)),
            (None, None) => Err(curve.wrong(attribute, "IFCPARAMETERVALUE or a point", "neither")),
        }
    }

    /// The basis's parameter of a trim; a point must lie on the basis.
    fn basis_parameter(
        &self,
        curve: &Record<'f>,
        basis: &Basis,
        trim: Trim,
        attribute: &'static str,
    ) -> Result<f64, ModelError> {
        let place = match trim {
            Trim::Parameter(parameter) => return Ok(self.in_parameter_unit(basis, parameter)),
            Trim::Point(place) => place,
        };
        let (parameter, nearest) = match basis {
            Basis::Line { origin, step } => {
                let parameter = (place - origin).dot(step) / step.norm_squared();
                (parameter, origin + step * parameter)
            }
            Basis::Circle(circle) => {
                let offset = place - circle.center;
                let angle = offset.dot(&circle.y).atan2(offset.dot(&circle.x));
                (angle, circle.center + (circle.x * angle.cos() + circle.y * angle.sin()) * circle.radius)
            }
        };
        let off = (place - nearest).norm();
        if off > self.gap_max {
            return Err(curve.impossible(format!(
                "the point of {attribute} lies {:.6} mm off the curve #{} that it trims, allowed are {:.6} mm; correct it",
                off * 1e3,
                basis_number(curve)?,
                self.gap_max * 1e3
            )));
        }
        Ok(parameter)
    }
}

fn basis_number(curve: &Record<'_>) -> Result<u64, ModelError> {
    curve.reference(0, "BasisCurve")
}

/// The signed angle of an arc whose ends differ by `difference` (rad): forward counter-clockwise, else clockwise, past the
/// seam where it must; ends that coincide mean a full circle.
fn sweep(difference: f64, forward: bool) -> f64 {
    let sign = if forward { 1.0 } else { -1.0 };
    let turn = (sign * difference).rem_euclid(TAU);
    if turn.min(TAU - turn) < FULL_CIRCLE { sign * TAU } else { sign * turn }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    #[test]
    fn arcs_turn_the_way_their_sense_says_across_the_seam_and_all_around() {
        for (from_deg, to_deg, forward, expected_deg) in [
            (0.0, 90.0, true, 90.0),
            (90.0, 0.0, false, -90.0),
            (90.0, 0.0, true, 270.0),
            (0.0, 90.0, false, -270.0),
            (315.0, 135.0, true, 180.0),
            (15.0, 330.0, false, -45.0),
            (0.0, 360.0, true, 360.0),
            (30.0, 30.0, false, -360.0),
            (0.0, 370.0, true, 10.0),
            (0.0, 1e-5, true, 1e-5),
        ] {
            let difference: f64 = f64::to_radians(to_deg) - f64::to_radians(from_deg);
            let found = sweep(difference, forward) * 180.0 / PI;
            assert!((found - expected_deg).abs() < 1e-9, "{from_deg}..{to_deg} {forward}: {found}");
        }
        // 360° by a degree of 12 digits
        assert_eq!(sweep(360.0 * 0.0174532925199, true), TAU);
    }
}
