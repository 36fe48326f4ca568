//! IFC curves as path segments, in the curve's own frame, in metres.
//!
//! Senses compose: an `IfcTrimmedCurve` with SenseAgreement `.F.` inside an `IfcCompositeCurveSegment` with SameSense `.F.`
//! runs forward. `MasterRepresentation` decides between a trim's point and its parameter where it has both; parameters count
//! where it is `.UNSPECIFIED.`. Angles are in the file's plane angle unit, a line's parameter counts its vector's magnitudes.
//!
//! **Gaps.** Consecutive segments may miss each other by the Precision of the representation context, in metres, but
//! never by more than 5e-6 m, half of what the tool's path may not be off by; where the context gives no Precision, by 1e-6 m.
//! Precisions below 1e-9 m count as that, the rounding of the arithmetic. The same tolerance says how far a trimming
//! point may lie off its curve.

mod trim;

use super::placement::{axis_placement, coordinates, point};
use super::units::Units;
use crate::model::error::ModelError;
use crate::model::p21::{Record, Value};
use crate::plan::path::{Point, Segment};
use core::f64::consts::TAU;

/// Composite curves of composite curves, trimmed curves of trimmed curves: deeper is a circle.
const DEPTH_MAX: usize = 32;
/// A thousand times what a long layer has; a bound for files whose references multiply.
const SEGMENTS_MAX: usize = 1_000_000;

/// What can be printed, for messages.
const SUPPORTED: &str = "IfcTrimmedCurve of IfcCircle or IfcLine, IfcPolyline, IfcBSplineCurveWithKnots, \
                         IfcRationalBSplineCurveWithKnots, IfcIndexedPolyCurve or IfcCompositeCurve";

/// A segment and the entity it comes from.
#[derive(Clone, Debug)]
pub struct Piece {
    /// The geometry.
    pub segment: Segment,
    /// Number of the curve entity.
    pub entity: u64,
}

/// Reads curves of one file.
#[derive(Debug)]
pub struct Curves<'u, 'f> {
    /// The project's units.
    pub units: &'u Units<'f>,
    /// Largest distance (m) between a segment's end and the next one's start.
    pub gap_max: f64,
    /// Whose curve it is, for messages.
    pub owner: &'u str,
    /// Segments read so far.
    count: usize,
}

impl<'u, 'f> Curves<'u, 'f> {
    /// A reader for the curves of `owner`, whose context has this precision (m).
    pub fn new(units: &'u Units<'f>, precision: Option<f64>, owner: &'u str) -> Self {
        Self { units, gap_max: precision.unwrap_or(1e-6).clamp(1e-9, 5e-6), owner, count: 0 }
    }

    /// The curve's segments in order, each starting where the one before it ends.
    pub fn read(&mut self, curve: &Record<'f>) -> Result<Vec<Piece>, ModelError> {
        self.curve(curve, 0)
    }

    fn curve(&mut self, curve: &Record<'f>, depth: usize) -> Result<Vec<Piece>, ModelError> {
        if depth >= DEPTH_MAX {
            return Err(ModelError::TooDeep { entity: curve.entity(), limit: DEPTH_MAX });
        }
        let segments = match curve.keyword {
            "IFCCOMPOSITECURVE" | "IFC2DCOMPOSITECURVE" => return self.composite(curve, depth),
            "IFCPOLYLINE" => self.polyline(curve)?,
            "IFCINDEXEDPOLYCURVE" => self.indexed(curve)?,
            "IFCTRIMMEDCURVE" => vec![self.trimmed(curve, depth)?.segment(curve)?],
            "IFCCIRCLE" => vec![trim::Span::full_circle(self.circle(curve)?).segment(curve)?],
            "IFCBSPLINECURVEWITHKNOTS" => vec![self.spline(curve, None)?],
            "IFCRATIONALBSPLINECURVEWITHKNOTS" => {
                let weights = curve.reals(8, "WeightsData")?;
                vec![self.spline(curve, Some(weights))?]
            }
            _ => return Err(self.unsupported(curve, SUPPORTED)),
        };
        self.count += segments.len();
        if self.count > SEGMENTS_MAX {
            return Err(ModelError::TooLarge { entity: curve.entity(), limit: SEGMENTS_MAX });
        }
        Ok(segments.into_iter().map(|segment| Piece { segment, entity: curve.id() }).collect())
    }

    fn unsupported(&self, curve: &Record<'_>, instead: &'static str) -> ModelError {
        ModelError::Unsupported {
            entity: curve.entity(),
            what: "segment",
            of: format!(" in '{}'", self.owner),
            instead,
        }
    }

    fn composite(&mut self, curve: &Record<'f>, depth: usize) -> Result<Vec<Piece>, ModelError> {
        let mut pieces: Vec<Piece> = Vec::new();
        for id in curve.references(0, "Segments")? {
            let segment = curve.open(id)?;
            if !["IFCCOMPOSITECURVESEGMENT", "IFCREPARAMETRISEDCOMPOSITECURVESEGMENT"].contains(&segment.keyword) {
                return Err(self.unsupported(&segment, "IfcCompositeCurveSegment"));
            }
            let same_sense = segment.flag(1, "SameSense")?;
            let mut parent = self.curve(&segment.follow(2, "ParentCurve")?, depth + 1)?;
            if !same_sense {
                parent.reverse();
                for piece in &mut parent {
                    piece.segment = piece.segment.reversed();
                }
            }
            if let (Some(previous), Some(next)) = (pieces.last(), parent.first()) {
                self.meet(curve, previous, next)?;
            }
            pieces.append(&mut parent);
        }
        if pieces.is_empty() {
            return Err(curve.wrong("Segments", "at least one segment", "none"));
        }
        Ok(pieces)
    }

    fn meet(&self, curve: &Record<'f>, previous: &Piece, next: &Piece) -> Result<(), ModelError> {
        let gap = (next.segment.start() - previous.segment.end()).norm();
        if gap <= self.gap_max {
            return Ok(());
        }
        let previous = curve.open(previous.entity)?.entity();
        Err(ModelError::Gap {
            next: curve.open(next.entity)?.entity(),
            previous: previous.id,
            previous_line: previous.place.line,
            previous_keyword: previous.keyword,
            gap_mm: gap * 1e3,
            allowed_mm: self.gap_max * 1e3,
        })
    }

    fn polyline(&self, curve: &Record<'f>) -> Result<Vec<Segment>, ModelError> {
        let mut points = Vec::new();
        for id in curve.references(0, "Points")? {
            points.push(point(&curve.open(id)?, self.units.length)?);
        }
        if points.len() < 2 {
            return Err(curve.wrong("Points", "at least 2 points", points.len().to_string()));
        }
        points.iter().zip(points.iter().skip(1)).map(|(start, end)| line(curve, *start, *end)).collect()
    }

    fn indexed(&self, curve: &Record<'f>) -> Result<Vec<Segment>, ModelError> {
        let list = curve.follow(0, "Points")?;
        let mut points = Vec::new();
        for item in list.list(0, "CoordList")? {
            let Value::List(numbers) = item else {
                return Err(list.wrong_value("CoordList", "a list of coordinates", item));
            };
            let numbers: Vec<f64> =
                numbers.iter().map(|number| list.as_real(number, "CoordList")).collect::<Result<_, _>>()?;
            let point = coordinates(&list, &numbers, "CoordList")?;
            points.push(Point::from(point.coords * self.units.length));
        }
        let Some(segments) = curve.given(1, "Segments")? else {
            return points.iter().zip(points.iter().skip(1)).map(|(start, end)| line(curve, *start, *end)).collect();
        };
        let Value::List(segments) = segments else {
            return Err(curve.wrong_value("Segments", "a list of IfcLineIndex and IfcArcIndex", segments));
        };
        let mut out: Vec<Segment> = Vec::new();
        for segment in segments {
            let (kind, corners) = index_of(curve, segment, &points)?;
            match (kind, corners.as_slice()) {
                ("IFCARCINDEX", [start, middle, end]) => out.push(arc_through(curve, start, middle, end)?),
                ("IFCLINEINDEX", [_, _, ..]) => {
                    for (start, end) in corners.iter().zip(corners.iter().skip(1)) {
                        out.push(line(curve, *start, *end)?);
                    }
                }
                _ => return Err(curve.wrong_value("Segments", "IfcLineIndex of 2 or more, IfcArcIndex of 3", segment)),
            }
        }
        if let Some(at) =
            out.iter().zip(out.iter().skip(1)).position(|(a, b)| (b.start() - a.end()).norm() > self.gap_max)
        {
            return Err(curve.impossible(format!("segment {} does not start where the one before it ends", at + 2)));
        }
        if out.is_empty() {
            return Err(curve.wrong("Segments", "at least one segment", "none"));
        }
        Ok(out)
    }

    fn spline(&self, curve: &Record<'f>, weights: Option<Vec<f64>>) -> Result<Segment, ModelError> {
        let degree = curve.count(0, "Degree")?;
        let mut points = Vec::new();
        for id in curve.references(1, "ControlPointsList")? {
            points.push(point(&curve.open(id)?, self.units.length)?);
        }
        let multiplicities = curve.counts(5, "KnotMultiplicities")?;
        let values = curve.reals(6, "Knots")?;
        if multiplicities.len() != values.len() {
            let found = format!("{} multiplicities for {} knots", multiplicities.len(), values.len());
            return Err(curve.wrong("KnotMultiplicities", "one a knot", found));
        }
        if let Some(multiplicity) = multiplicities.iter().find(|multiplicity| !(1..=degree + 1).contains(*multiplicity))
        {
            let expected = format!("multiplicities from 1 to degree + 1 = {}", degree + 1);
            return Err(curve.wrong("KnotMultiplicities", expected, multiplicity.to_string()));
        }
        let knots = values.iter().zip(&multiplicities).flat_map(|(knot, count)| std::iter::repeat_n(*knot, *count));
        Segment::spline(degree, points, knots.collect(), weights).map_err(|error| curve.impossible(error.to_string()))
    }

    fn circle(&self, curve: &Record<'f>) -> Result<trim::Circle, ModelError> {
        let pose = axis_placement(&curve.follow(0, "Position")?, self.units.length)?;
        let radius = curve.real(1, "Radius")? * self.units.length;
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(curve.wrong("Radius", "a positive length", radius.to_string()));
        }
        Ok(trim::Circle {
            center: Point::from(pose.translation),
            x: pose.rotation.column(0).into(),
            y: pose.rotation.column(1).into(),
            radius,
        })
    }
}

fn line(curve: &Record<'_>, start: Point, end: Point) -> Result<Segment, ModelError> {
    Segment::line(start, end).map_err(|error| curve.impossible(error.to_string()))
}

/// Type and corners of an `IfcLineIndex` or `IfcArcIndex`; indices count from 1.
fn index_of<'v>(
    curve: &Record<'_>,
    segment: &Value<'v>,
    points: &[Point],
) -> Result<(&'v str, Vec<Point>), ModelError> {
    let wrong = || curve.wrong_value("Segments", "IfcLineIndex or IfcArcIndex with indices of points", segment);
    let Value::Typed(kind, values) = segment else { return Err(wrong()) };
    let [Value::List(indices)] = values.as_slice() else { return Err(wrong()) };
    let corner = |index: &Value<'_>| {
        let index = curve.as_count(index, "Segments")?;
        index.checked_sub(1).and_then(|index| points.get(index)).copied().ok_or_else(wrong)
    };
    Ok((kind, indices.iter().map(corner).collect::<Result<_, _>>()?))
}

/// The arc from `start` through `middle` to `end`: the circle around the triangle they span.
fn arc_through(curve: &Record<'_>, start: &Point, middle: &Point, end: &Point) -> Result<Segment, ModelError> {
    let (b, c) = (middle - start, end - start);
    let normal = b.cross(&c);
    // The centre as seen from `start`, with a = start at the origin: Wikipedia, Circumcircle, "in higher dimensions".
    let to_center = (b * c.norm_squared() - c * b.norm_squared()).cross(&normal) / (-2.0 * normal.norm_squared());
    let radius = to_center.norm();
    let unit_normal = normal.try_normalize(1e-12 * b.norm() * c.norm());
    let (Some(z), true) = (unit_normal, radius.is_finite() && radius > 0.0) else {
        return Err(curve.impossible("the three points of an arc lie on one line or coincide; write a line instead"));
    };
    let center = start + to_center;
    let x = -to_center / radius;
    let y = z.cross(&x);
    let sweep = (end - center).dot(&y).atan2((end - center).dot(&x)).rem_euclid(TAU);
    Segment::arc(center, x, y, radius, 0.0, sweep).map_err(|error| curve.impossible(error.to_string()))
}

#[cfg(test)]
mod tests;
