//! Geometry of a layer: curve segments in the part frame, in metres, evaluable by exact arc length.

mod spline;

pub use spline::Spline;

use core::f64::consts::TAU;
use nalgebra::{Point3, Vector3};
use screed_kernel::pose::Pose;

/// A point in the part frame (m).
pub type Point = Point3<f64>;

/// Shorter curves (m) have no direction that the numbers of a file could carry.
pub const LENGTH_MIN: f64 = 1e-9;
/// An angle (rad) between two tangents from which on the tool has to stop in between. Below it the velocity still turns,
/// but at 0.25 m/s and 500 Hz only by as much as an acceleration of 1.25e-4 m/s² makes in one sample: rounding.
pub const TANGENT_BREAK: f64 = 1e-6;
/// How far a unit axis may be from unit length, and two square axes from square.
const AXIS_TOLERANCE: f64 = 1e-9;

/// Why a segment cannot be made from these numbers.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PathError {
    /// A coordinate, angle or length is NaN or infinite.
    #[error("{what} is not a finite number; correct it in the model")]
    NotFinite {
        /// Which number.
        what: &'static str,
    },
    /// The segment goes nowhere.
    #[error("a segment of {length:e} m has no direction; remove it from the model (the shortest is {LENGTH_MIN:e} m)")]
    ZeroLength {
        /// Its length (m).
        length: f64,
    },
    /// The axes of an arc's plane are not unit vectors square to each other.
    #[error(
        "the axes of an arc's plane are not unit vectors square to each other (off by {off:e}); correct its placement"
    )]
    Axes {
        /// The largest deviation.
        off: f64,
    },
    /// An arc's radius is zero or negative.
    #[error("an arc's radius is {radius} m; it must be positive")]
    Radius {
        /// The radius given (m).
        radius: f64,
    },
    /// An arc turns by more than a full circle.
    #[error("an arc sweeps {sweep} rad; it must turn by at most a full circle (2π)")]
    Sweep {
        /// The sweep given (rad).
        sweep: f64,
    },
    /// A spline's degree is outside what is supported.
    #[error("a B-spline of degree {degree}; supported are 1 to {}", spline::DEGREE_MAX)]
    Degree {
        /// The degree given.
        degree: usize,
    },
    /// Too few control points for the degree.
    #[error("a B-spline of degree {degree} with {found} control points; it needs at least {}", degree + 1)]
    ControlPoints {
        /// The degree given.
        degree: usize,
        /// How many control points were given.
        found: usize,
    },
    /// The number of knots does not fit.
    #[error("a B-spline with {found} knots (multiplicities counted); its degree and control points need {expected}")]
    Knots {
        /// Control points + degree + 1.
        expected: usize,
        /// How many were given.
        found: usize,
    },
    /// A knot is smaller than the one before it.
    #[error("knot {index} of a B-spline is smaller than the knot before it; knots must not decrease")]
    KnotOrder {
        /// Index into the expanded knots.
        index: usize,
    },
    /// A knot occurs so often that the curve falls apart there.
    #[error(
        "knot {knot} occurs more than {degree} times inside a B-spline of degree {degree}: the curve has a gap there"
    )]
    KnotMultiplicity {
        /// The knot's value.
        knot: f64,
        /// The degree of the spline.
        degree: usize,
    },
    /// The number of weights does not fit.
    #[error("a rational B-spline with {found} weights for {expected} control points; give one a point")]
    Weights {
        /// How many control points there are.
        expected: usize,
        /// How many weights were given.
        found: usize,
    },
    /// A weight is zero or negative.
    #[error("weight {index} of a rational B-spline is {weight}; weights must be positive")]
    Weight {
        /// Index of the weight.
        index: usize,
        /// Its value.
        weight: f64,
    },
    /// The curve stands still at a parameter, so that it has no tangent there.
    #[error(
        "a B-spline has a cusp, or coinciding control points, near knot {parameter}: no tangent; split the curve there"
    )]
    Cusp {
        /// The parameter, in the units of the knots.
        parameter: f64,
    },
}

/// One curve of a layer, run through from its start to its end.
#[derive(Clone, Debug, PartialEq)]
pub enum Segment {
    /// A straight line.
    Line(Line),
    /// A circular arc, up to a full circle.
    Arc(Arc),
    /// A B-spline, rational or not.
    Spline(Spline),
}

/// A straight line between two points.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    start: Point,
    direction: Vector3<f64>,
    length: f64,
}

/// A circular arc: center + radius·(cos θ·x_axis + sin θ·y_axis), θ from start_angle over sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Arc {
    center: Point,
    x_axis: Vector3<f64>,
    y_axis: Vector3<f64>,
    radius: f64,
    start_angle: f64,
    sweep: f64,
}

/// A part of a segment without a tangent break inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothPart {
    /// Arc length where it begins, from the segment's start (m).
    pub start: f64,
    /// Arc length where it ends, from the segment's start (m).
    pub end: f64,
    /// Its greatest curvature (1/m).
    pub curvature_max: f64,
}

impl Segment {
    /// The straight line from `start` to `end`.
    ///
    /// # Errors
    /// When a coordinate is not finite or the points coincide.
    pub fn line(start: Point, end: Point) -> Result<Self, PathError> {
        let along = end - start;
        let length = along.norm();
        finite(&[length, start.x, start.y, start.z], "a coordinate of a line")?;
        long_enough(length)?;
        Ok(Self::Line(Line { start, direction: along / length, length }))
    }

    /// The arc about `center` in the plane of `x_axis` and `y_axis` (unit, square to each other; their order gives the
    /// positive sense), from `start_angle` over the signed `sweep` (rad, at most a full circle either way).
    ///
    /// # Errors
    /// When a number is not finite, the axes are not unit and square, the radius is not positive, the sweep is more than
    /// a full circle, or the arc has no length.
    pub fn arc(
        center: Point,
        x_axis: Vector3<f64>,
        y_axis: Vector3<f64>,
        radius: f64,
        start_angle: f64,
        sweep: f64,
    ) -> Result<Self, PathError> {
        finite(center.coords.as_slice(), "the centre of an arc")?;
        finite(&[x_axis.norm(), y_axis.norm()], "an axis of an arc")?;
        finite(&[radius, start_angle, sweep], "the radius or an angle of an arc")?;
        let off = (x_axis.norm() - 1.0).abs().max((y_axis.norm() - 1.0).abs()).max(x_axis.dot(&y_axis).abs());
        if off > AXIS_TOLERANCE {
            return Err(PathError::Axes { off });
        }
        if radius <= 0.0 {
            return Err(PathError::Radius { radius });
        }
        // A full circle that came from degrees may be over by the last bit.
        if sweep.abs() > TAU * (1.0 + 1e-15) {
            return Err(PathError::Sweep { sweep });
        }
        finite(&[radius * sweep], "the length of an arc")?;
        long_enough(radius * sweep.abs())?;
        Ok(Self::Arc(Arc { center, x_axis, y_axis, radius, start_angle, sweep }))
    }

    /// The B-spline of `degree` over its whole parameter range, `knots[degree] ..= knots[control_points.len()]`; rational
    /// when `weights` are given. Knots come with their multiplicities expanded.
    ///
    /// # Errors
    /// When a number is not finite, counts do not fit, knots decrease, a weight is not positive, or the curve has a gap,
    /// a cusp or no length.
    pub fn spline(
        degree: usize,
        control_points: Vec<Point>,
        knots: Vec<f64>,
        weights: Option<Vec<f64>>,
    ) -> Result<Self, PathError> {
        Spline::new(degree, &control_points, &knots, weights.as_deref()).map(Self::Spline)
    }

    /// Arc length (m): exact for lines and arcs, to 1e-12 of itself for splines.
    pub fn length(&self) -> f64 {
        match self {
            Self::Line(line) => line.length,
            Self::Arc(arc) => arc.radius * arc.sweep.abs(),
            Self::Spline(spline) => spline.length(),
        }
    }

    /// The point at arc length `s` from the start (m); beyond an end, that end.
    pub fn point_at(&self, s: f64) -> Point {
        let s = s.clamp(0.0, self.length());
        match self {
            Self::Line(line) => line.start + line.direction * s,
            Self::Arc(arc) => arc.center + arc.outward(s) * arc.radius,
            Self::Spline(spline) => spline.point_at(s),
        }
    }

    /// The point at the fraction `t` of the arc length, t in [0, 1].
    pub fn eval(&self, t: f64) -> Point {
        self.point_at(t * self.length())
    }

    /// The unit tangent at arc length `s` from the start (m), in the sense of travel; beyond an end, that end's.
    pub fn tangent_at(&self, s: f64) -> Vector3<f64> {
        let s = s.clamp(0.0, self.length());
        match self {
            Self::Line(line) => line.direction,
            Self::Arc(arc) => {
                let (sin, cos) = libm::sincos(arc.angle(s));
                (arc.y_axis * cos - arc.x_axis * sin) * arc.sweep.signum()
            }
            Self::Spline(spline) => spline.tangent_at(s),
        }
    }

    /// The greatest curvature (1/m). For splines an upper bound, 0.1 % above the greatest curvature found by search; kinks
    /// (see [`Segment::smooth_parts`]) not counted.
    pub fn curvature_max(&self) -> f64 {
        self.smooth_parts().iter().fold(0.0, |max, part| part.curvature_max.max(max))
    }

    /// The parts between tangent breaks: one for lines and arcs; a spline may have kinks where a knot is as multiple as
    /// its degree (a spline of degree 1 is a polyline).
    pub fn smooth_parts(&self) -> Vec<SmoothPart> {
        let whole = |curvature_max| vec![SmoothPart { start: 0.0, end: self.length(), curvature_max }];
        match self {
            Self::Line(_) => whole(0.0),
            Self::Arc(arc) => whole(1.0 / arc.radius),
            Self::Spline(spline) => spline.smooth_parts().to_vec(),
        }
    }

    /// Where the segment begins.
    pub fn start(&self) -> Point {
        self.point_at(0.0)
    }

    /// Where the segment ends.
    pub fn end(&self) -> Point {
        self.point_at(self.length())
    }

    /// The same curve run through the other way.
    pub fn reversed(&self) -> Self {
        match self {
            Self::Line(line) => Self::Line(Line { start: self.end(), direction: -line.direction, length: line.length }),
            Self::Arc(arc) => {
                Self::Arc(Arc { start_angle: arc.start_angle + arc.sweep, sweep: -arc.sweep, ..arc.clone() })
            }
            Self::Spline(spline) => Self::Spline(spline.reversed()),
        }
    }

    /// The same curve in the outer frame.
    pub fn transformed(&self, outer_from_inner: &Pose) -> Self {
        let point = |point: &Point| Point::from(outer_from_inner.transform_point(&point.coords));
        let turn = |vector: &Vector3<f64>| outer_from_inner.rotation * vector;
        match self {
            Self::Line(line) => {
                Self::Line(Line { start: point(&line.start), direction: turn(&line.direction), length: line.length })
            }
            Self::Arc(arc) => Self::Arc(Arc {
                center: point(&arc.center),
                x_axis: turn(&arc.x_axis),
                y_axis: turn(&arc.y_axis),
                ..arc.clone()
            }),
            Self::Spline(spline) => Self::Spline(spline.transformed(outer_from_inner)),
        }
    }

    /// Distance (m) from a point to the nearest point of the curve.
    pub fn distance_to(&self, point: &Point) -> f64 {
        match self {
            Self::Line(line) => {
                let along = (point - line.start).dot(&line.direction).clamp(0.0, line.length);
                (point - (line.start + line.direction * along)).norm()
            }
            Self::Arc(arc) => arc.distance_to(point),
            Self::Spline(spline) => spline.distance_to(point),
        }
    }
}

impl Arc {
    fn angle(&self, s: f64) -> f64 {
        self.start_angle + self.sweep.signum() * (s / self.radius)
    }

    fn outward(&self, s: f64) -> Vector3<f64> {
        let (sin, cos) = libm::sincos(self.angle(s));
        self.x_axis * cos + self.y_axis * sin
    }

    fn distance_to(&self, point: &Point) -> f64 {
        let from_center = point - self.center;
        let (x, y) = (from_center.dot(&self.x_axis), from_center.dot(&self.y_axis));
        // How far the point's direction lies behind the start, in the sense of travel.
        let past_start = (libm::atan2(y, x) - self.start_angle) * self.sweep.signum();
        if past_start.rem_euclid(TAU) <= self.sweep.abs() {
            let out_of_plane = from_center - self.x_axis * x - self.y_axis * y;
            return libm::hypot(libm::hypot(x, y) - self.radius, out_of_plane.norm());
        }
        let end = |s| (point - (self.center + self.outward(s) * self.radius)).norm();
        end(0.0).min(end(self.radius * self.sweep.abs()))
    }
}

/// The angle between two unit vectors (rad), accurate also where it is tiny.
pub fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    libm::atan2(a.cross(b).norm(), a.dot(b))
}

fn finite(numbers: &[f64], what: &'static str) -> Result<(), PathError> {
    if numbers.iter().all(|number| number.is_finite()) { Ok(()) } else { Err(PathError::NotFinite { what }) }
}

fn long_enough(length: f64) -> Result<(), PathError> {
    if length < LENGTH_MIN { Err(PathError::ZeroLength { length }) } else { Ok(()) }
}

#[cfg(test)]
mod tests;
