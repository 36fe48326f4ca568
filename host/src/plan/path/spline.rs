//! B-splines by arc length. The knot spans become Bézier pieces by blossoming (Ramshaw, "Blossoms are polar forms", 1989),
//! in homogeneous coordinates (w·x, w·y, w·z, w); the arc length is integrated once, piece by piece, and inverted by
//! Newton's method.

use super::{PathError, Point, SmoothPart, TANGENT_BREAK, angle_between, finite, long_enough};
use nalgebra::{Vector3, Vector4};
use screed_kernel::pose::Pose;

/// The highest degree supported; evaluation works in a buffer of this size.
pub const DEGREE_MAX: usize = 15;
/// Gauss–Legendre rule of ten points on [-1, 1] (Abramowitz and Stegun, table 25.4): positive abscissas and weights.
const GAUSS: [(f64, f64); 5] = [
    (0.148_874_338_981_631_22, 0.295_524_224_714_752_87),
    (0.433_395_394_129_247_2, 0.269_266_719_309_996_35),
    (0.679_409_568_299_024_4, 0.219_086_362_515_982_04),
    (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
    (0.973_906_528_517_171_7, 0.066_671_344_308_688_14),
];
/// Halves of an interval agree with the whole to this fraction: then each half is right to about 2⁻²⁰ of it.
const HALVES_AGREE: f64 = 1e-11;
/// Deeper halving means that the speed is not smooth: a cusp.
const DEPTH_MAX: u32 = 40;
/// A speed below this fraction of the mean is a standstill.
const STANDSTILL: f64 = 1e-9;
/// Samples per interval in which the curvature's and the distance's extremes are looked for.
const SAMPLES: usize = 16;

/// A B-spline curve, kept as Bézier pieces and a table of arc length.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    pieces: Vec<Bezier>,
    cells: Vec<Cell>,
    smooth_parts: Vec<SmoothPart>,
    length: f64,
}

/// One polynomial piece in homogeneous coordinates, parameter u in [0, 1].
#[derive(Clone, Debug, PartialEq)]
struct Bezier {
    points: Vec<Vector4<f64>>,
    /// Its range in the knots' parameter, for messages.
    knots: [f64; 2],
}

/// An interval of one piece that is short enough for the ten-point rule.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    piece: usize,
    u: [f64; 2],
    /// Arc length from the curve's start at both ends (m).
    s: [f64; 2],
    /// du/ds at both ends (1/m).
    slope: [f64; 2],
}

/// Point, first and second derivative by u.
struct Derivatives {
    point: Point,
    first: Vector3<f64>,
    second: Vector3<f64>,
}

impl Spline {
    pub(super) fn new(
        degree: usize,
        control_points: &[Point],
        knots: &[f64],
        weights: Option<&[f64]>,
    ) -> Result<Self, PathError> {
        check(degree, control_points, knots, weights)?;
        let weight = |index: usize| weights.and_then(|weights| weights.get(index)).copied().unwrap_or(1.0);
        let homogeneous: Vec<_> = control_points
            .iter()
            .enumerate()
            .map(|(index, point)| (point.coords * weight(index)).push(weight(index)))
            .collect();
        let mut pieces = Vec::new();
        // The knots around span k are knots[k + 1 - degree ..= k + degree].
        for (points, around) in homogeneous.windows(degree + 1).zip(knots[1..].windows(2 * degree)) {
            let (low, high) = (around[degree - 1], around[degree]);
            if low < high {
                pieces.push(Bezier {
                    points: (0..=degree).map(|ones| blossom(points, around, degree, low, high, ones)).collect(),
                    knots: [low, high],
                });
            }
        }
        Self::from_pieces(pieces)
    }

    fn from_pieces(pieces: Vec<Bezier>) -> Result<Self, PathError> {
        let mut cells = Vec::new();
        let mut length = 0.0;
        for (index, piece) in pieces.iter().enumerate() {
            let extent = piece.polygon_length();
            long_enough(extent).map_err(|_| PathError::Cusp { parameter: piece.knots[0] })?;
            for [from, to] in piece.smooth_intervals(extent)? {
                let start = length;
                length += piece.arc_length(from, to);
                let slope = [from, to].map(|u| 1.0 / piece.speed(u));
                cells.push(Cell { piece: index, u: [from, to], s: [start, length], slope });
            }
        }
        finite(&[length], "the length of a B-spline")?;
        long_enough(length)?;
        let mut spline = Self { pieces, cells, smooth_parts: Vec::new(), length };
        spline.smooth_parts = spline.find_smooth_parts();
        Ok(spline)
    }

    pub(super) fn length(&self) -> f64 {
        self.length
    }

    pub(super) fn smooth_parts(&self) -> &[SmoothPart] {
        &self.smooth_parts
    }

    pub(super) fn point_at(&self, s: f64) -> Point {
        let (piece, u) = self.locate(s);
        piece.derivatives(u).point
    }

    pub(super) fn tangent_at(&self, s: f64) -> Vector3<f64> {
        let (piece, u) = self.locate(s);
        piece.tangent(u)
    }

    pub(super) fn reversed(&self) -> Self {
        let pieces = self.pieces.iter().rev().map(Bezier::reversed).collect::<Vec<_>>();
        let from_end = |[a, b]: [f64; 2]| [self.length - b, self.length - a];
        let cells = self.cells.iter().rev().map(|cell| Cell {
            piece: self.pieces.len() - 1 - cell.piece,
            u: [1.0 - cell.u[1], 1.0 - cell.u[0]],
            s: from_end(cell.s),
            slope: [cell.slope[1], cell.slope[0]],
        });
        let parts = self.smooth_parts.iter().rev().map(|part| {
            let [start, end] = from_end([part.start, part.end]);
            SmoothPart { start, end, ..*part }
        });
        Self { pieces, cells: cells.collect(), smooth_parts: parts.collect(), length: self.length }
    }

    pub(super) fn transformed(&self, outer_from_inner: &Pose) -> Self {
        let mut spline = self.clone();
        for point in spline.pieces.iter_mut().flat_map(|piece| piece.points.iter_mut()) {
            let moved = outer_from_inner.rotation * point.xyz() + outer_from_inner.translation * point.w;
            *point = moved.push(point.w);
        }
        spline
    }

    /// The nearest point lies in a cell whose middle is nearer than half its length and the best distance so far; there
    /// each minimum among the samples is closed in on by halving.
    pub(super) fn distance_to(&self, point: &Point) -> f64 {
        let mut best = f64::INFINITY;
        for cell in &self.cells {
            let Some(piece) = self.pieces.get(cell.piece) else { continue };
            let middle = piece.derivatives(0.5 * (cell.u[0] + cell.u[1])).point;
            // Every point of the cell is at most its whole length away from any other.
            if (point - middle).norm() - (cell.s[1] - cell.s[0]) < best {
                best = best.min(piece.distance_to(point, cell.u));
            }
        }
        best
    }

    /// The piece and its parameter at arc length s.
    fn locate(&self, s: f64) -> (&Bezier, f64) {
        let index = self.cells.partition_point(|cell| cell.s[1] < s).min(self.cells.len() - 1);
        let cell = &self.cells[index];
        let piece = &self.pieces[cell.piece];
        (piece, cell.parameter(piece, s))
    }

    fn find_smooth_parts(&self) -> Vec<SmoothPart> {
        let mut parts: Vec<SmoothPart> = Vec::new();
        let mut before: Option<(usize, Vector3<f64>)> = None;
        for cell in &self.cells {
            let Some(piece) = self.pieces.get(cell.piece) else { continue };
            let curvature_max = piece.curvature_max(cell.u);
            let kink = before.is_some_and(|(index, tangent)| {
                index != cell.piece && angle_between(&tangent, &piece.tangent(0.0)) > TANGENT_BREAK
            });
            match parts.last_mut() {
                Some(part) if !kink => {
                    part.end = cell.s[1];
                    part.curvature_max = part.curvature_max.max(curvature_max);
                }
                _ => parts.push(SmoothPart { start: cell.s[0], end: cell.s[1], curvature_max }),
            }
            before = Some((cell.piece, piece.tangent(1.0)));
        }
        parts
    }
}

impl Cell {
    /// The parameter u at arc length s from the curve's start: Newton's method on the ten-point rule, from the cubic that
    /// has the right value and slope at both ends.
    fn parameter(&self, piece: &Bezier, s: f64) -> f64 {
        let [u0, u1] = self.u;
        let width = self.s[1] - self.s[0];
        let x = (s - self.s[0]) / width;
        let (m0, m1) = (self.slope[0] * width, self.slope[1] * width);
        let rise = u1 - u0;
        let mut u = u0 + x * (m0 + x * ((3.0 * rise - 2.0 * m0 - m1) + x * (m0 + m1 - 2.0 * rise)));
        for _ in 0..8 {
            u = u.clamp(u0, u1);
            let step = (piece.arc_length(u0, u) - (s - self.s[0])) / piece.speed(u);
            u -= step;
            if step.abs() <= 1e-12 * rise {
                break;
            }
        }
        u.clamp(u0, u1)
    }
}

impl Bezier {
    /// de Casteljau's scheme down to the last three, two and one points; the quotient rule for the weight.
    fn derivatives(&self, u: f64) -> Derivatives {
        let degree = self.points.len() - 1;
        let mut b = [Vector4::zeros(); DEGREE_MAX + 1];
        b[..=degree].copy_from_slice(&self.points);
        for last in (2..degree).rev() {
            for i in 0..=last {
                b[i] += (b[i + 1] - b[i]) * u;
            }
        }
        let n = degree as f64;
        let second = if degree < 2 { Vector4::zeros() } else { (b[2] - b[1] * 2.0 + b[0]) * (n * (n - 1.0)) };
        if degree >= 2 {
            b[0] += (b[1] - b[0]) * u;
            b[1] += (b[2] - b[1]) * u;
        }
        let first = (b[1] - b[0]) * n;
        let value = b[0] + (b[1] - b[0]) * u;
        let point = value.xyz() / value.w;
        let first_by_u = (first.xyz() - point * first.w) / value.w;
        let second_by_u = (second.xyz() - first_by_u * (2.0 * first.w) - point * second.w) / value.w;
        Derivatives { point: Point::from(point), first: first_by_u, second: second_by_u }
    }

    fn speed(&self, u: f64) -> f64 {
        self.derivatives(u).first.norm()
    }

    fn tangent(&self, u: f64) -> Vector3<f64> {
        self.derivatives(u).first.normalize()
    }

    /// κ = |C′ × C″| / |C′|³.
    fn curvature(&self, u: f64) -> f64 {
        let Derivatives { first, second, .. } = self.derivatives(u);
        first.cross(&second).norm() / first.norm().powi(3)
    }

    fn arc_length(&self, from: f64, to: f64) -> f64 {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let sum = |(x, weight): &(f64, f64)| weight * (self.speed(middle - half * x) + self.speed(middle + half * x));
        half * GAUSS.iter().map(sum).sum::<f64>()
    }

    fn polygon_length(&self) -> f64 {
        let at = |point: &Vector4<f64>| point.xyz() / point.w;
        self.points.windows(2).map(|pair| (at(&pair[1]) - at(&pair[0])).norm()).sum()
    }

    /// Splits [0, 1] until the ten-point rule is exact on each interval.
    fn smooth_intervals(&self, extent: f64) -> Result<Vec<[f64; 2]>, PathError> {
        let cusp = |u: f64| PathError::Cusp { parameter: self.knots[0] + u * (self.knots[1] - self.knots[0]) };
        let mut done = Vec::new();
        let mut open = vec![([0.0, 1.0], 0)];
        while let Some(([from, to], depth)) = open.pop() {
            if let Some(u) = [from, to].into_iter().find(|&u| self.speed(u) <= STANDSTILL * extent) {
                return Err(cusp(u));
            }
            let middle = 0.5 * (from + to);
            let whole = self.arc_length(from, to);
            let halves = self.arc_length(from, middle) + self.arc_length(middle, to);
            if (whole - halves).abs() <= HALVES_AGREE * halves {
                done.extend([[from, middle], [middle, to]]);
            } else if depth == DEPTH_MAX || !halves.is_finite() {
                return Err(cusp(middle));
            } else {
                open.extend([([middle, to], depth + 1), ([from, middle], depth + 1)]);
            }
        }
        Ok(done)
    }

    /// The greatest curvature on an interval, found among samples and closed in on by thirds, plus 0.1 %.
    fn curvature_max(&self, [from, to]: [f64; 2]) -> f64 {
        let step = (to - from) / SAMPLES as f64;
        let at = |i: usize| self.curvature(from + step * i as f64);
        let best = (0..=SAMPLES).fold((0, at(0)), |best, i| if at(i) > best.1 { (i, at(i)) } else { best });
        let mut low = from + step * best.0.saturating_sub(1) as f64;
        let mut high = from + step * (best.0 + 1).min(SAMPLES) as f64;
        for _ in 0..40 {
            let third = (high - low) / 3.0;
            if self.curvature(low + third) < self.curvature(high - third) {
                low += third;
            } else {
                high -= third;
            }
        }
        1.001 * best.1.max(self.curvature(0.5 * (low + high)))
    }

    fn distance_to(&self, point: &Point, [from, to]: [f64; 2]) -> f64 {
        let step = (to - from) / SAMPLES as f64;
        let parameter = |i: usize| from + step * i as f64;
        let distances: [f64; SAMPLES + 1] =
            core::array::from_fn(|i| (point - self.derivatives(parameter(i)).point).norm());
        let mut best = f64::INFINITY;
        for (i, &distance) in distances.iter().enumerate() {
            best = best.min(distance);
            let (before, after) = (i.saturating_sub(1), (i + 1).min(SAMPLES));
            if distance <= distances[before] && distance <= distances[after] {
                best = best.min(self.nearest_between(point, parameter(before), parameter(after)));
            }
        }
        best
    }

    /// Halves [low, high] about the place where the curve stops approaching the point.
    fn nearest_between(&self, point: &Point, mut low: f64, mut high: f64) -> f64 {
        for _ in 0..48 {
            let middle = 0.5 * (low + high);
            let Derivatives { point: on_curve, first, .. } = self.derivatives(middle);
            if (on_curve - point).dot(&first) < 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        (point - self.derivatives(0.5 * (low + high)).point).norm()
    }

    fn reversed(&self) -> Self {
        Self { points: self.points.iter().rev().copied().collect(), knots: [self.knots[1], self.knots[0]] }
    }
}

/// The polar form of one span at `degree − ones` times `low` and `ones` times `high`: the Bézier point number `ones`.
/// `around` are the 2·degree knots around the span.
fn blossom(points: &[Vector4<f64>], around: &[f64], degree: usize, low: f64, high: f64, ones: usize) -> Vector4<f64> {
    let mut d = points.to_vec();
    for round in 1..=degree {
        let argument = if round <= ones { high } else { low };
        for i in 0..=(degree - round) {
            let (left, right) = (around[i + round - 1], around[i + degree]);
            d[i] = d[i] + (d[i + 1] - d[i]) * ((argument - left) / (right - left));
        }
    }
    d[0]
}

fn check(degree: usize, points: &[Point], knots: &[f64], weights: Option<&[f64]>) -> Result<(), PathError> {
    if !(1..=DEGREE_MAX).contains(&degree) {
        return Err(PathError::Degree { degree });
    }
    if points.len() <= degree {
        return Err(PathError::ControlPoints { degree, found: points.len() });
    }
    let expected = points.len() + degree + 1;
    if knots.len() != expected {
        return Err(PathError::Knots { expected, found: knots.len() });
    }
    if let Some(weights) = weights {
        if weights.len() != points.len() {
            return Err(PathError::Weights { expected: points.len(), found: weights.len() });
        }
        finite(weights, "a weight of a B-spline")?;
        if let Some((index, &weight)) = weights.iter().enumerate().find(|(_, weight)| **weight <= 0.0) {
            return Err(PathError::Weight { index, weight });
        }
    }
    for point in points {
        finite(point.coords.as_slice(), "a control point of a B-spline")?;
    }
    finite(knots, "a knot of a B-spline")?;
    if let Some(index) = knots.windows(2).position(|pair| pair[1] < pair[0]) {
        return Err(PathError::KnotOrder { index: index + 1 });
    }
    // degree + 1 equal knots inside the parameter range part the curve; the range itself must not be empty.
    let (first, last) = (knots[degree], knots[points.len()]);
    if first >= last {
        return Err(PathError::ZeroLength { length: 0.0 });
    }
    let parting = knots.windows(degree + 1).find(|run| run[0] == run[degree] && run[0] > first && run[0] < last);
    match parting {
        Some(run) => Err(PathError::KnotMultiplicity { knot: run[0], degree }),
        None => Ok(()),
    }
}
