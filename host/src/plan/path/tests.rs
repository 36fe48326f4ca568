//! Segments against closed forms, and against sums over so many chords that the rule cannot matter.

use super::*;
use core::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI};

/// xorshift64*: the same numbers on every machine.
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let bits = self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11;
        low + (high - low) * (bits as f64 / (1u64 << 53) as f64)
    }

    fn point(&mut self) -> Point {
        Point::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0))
    }
}

fn quarter(sweep: f64) -> Segment {
    Segment::arc(Point::new(1.0, 2.0, 3.0), Vector3::y(), -Vector3::x(), 0.6, 0.0, sweep).unwrap()
}

/// A clamped cubic with single interior knots.
fn random_cubic(random: &mut Random, rational: bool) -> Segment {
    let points: Vec<_> = (0..7).map(|i| Point::new(f64::from(i), 0.0, 0.0) + random.point().coords).collect();
    let mut knots = vec![0.0; 4];
    knots.extend([0.2, 0.5, 0.6].map(|knot| knot + random.between(0.0, 0.05)));
    knots.extend([1.0; 4]);
    let weights = rational.then(|| (0..7).map(|_| random.between(0.4, 2.5)).collect());
    Segment::spline(3, points, knots, weights).unwrap()
}

fn all_kinds() -> Vec<Segment> {
    let mut random = Random(7);
    vec![
        Segment::line(Point::new(0.0, 1.0, 2.0), Point::new(0.3, 1.4, 2.0)).unwrap(),
        quarter(FRAC_PI_2),
        quarter(-4.0),
        quarter(TAU),
        random_cubic(&mut random, false),
        random_cubic(&mut random, true),
    ]
}

/// Sum over chords, extrapolated to chord length zero (the error falls with the square of the chord).
fn chord_length(segment: &Segment, chords: usize) -> f64 {
    let sum = |n: usize| -> f64 {
        let points: Vec<_> = (0..=n).map(|i| segment.eval(i as f64 / n as f64)).collect();
        points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
    };
    (4.0 * sum(2 * chords) - sum(chords)) / 3.0
}

#[test]
fn an_arc_turns_from_the_x_axis_towards_the_y_axis() {
    let arc = quarter(FRAC_PI_2);
    assert!((arc.length() - 0.6 * FRAC_PI_2).abs() < 1e-15);
    assert!((arc.start() - Point::new(1.0, 2.6, 3.0)).norm() < 1e-15);
    assert!((arc.end() - Point::new(0.4, 2.0, 3.0)).norm() < 1e-15);
    assert!((arc.tangent_at(0.0) + Vector3::x()).norm() < 1e-15);
    assert!((quarter(-FRAC_PI_2).tangent_at(0.0) - Vector3::x()).norm() < 1e-15);
    assert!((arc.curvature_max() - 1.0 / 0.6).abs() < 1e-15);
}

#[test]
fn equal_steps_of_arc_length_are_equal_steps_along_the_curve() {
    for segment in all_kinds() {
        let length = segment.length();
        assert!((chord_length(&segment, 4000) / length - 1.0).abs() < 1e-11, "{segment:?}");
        for i in 1..400 {
            let (s, h) = (length * f64::from(i) / 400.0, length * 1e-5);
            let difference = (segment.point_at(s + h) - segment.point_at(s - h)) / (2.0 * h);
            assert!((difference - segment.tangent_at(s)).norm() < 1e-6, "at {s} of {segment:?}");
            assert!((segment.tangent_at(s).norm() - 1.0).abs() < 1e-14);
        }
    }
}

#[test]
fn a_parabola_has_its_textbook_length_and_curvature() {
    // y = x² over [0, 1] as a quadratic; length √5/2 + asinh(2)/4, curvature 2 at the vertex.
    let control = vec![Point::origin(), Point::new(0.5, 0.0, 0.0), Point::new(1.0, 1.0, 0.0)];
    let parabola = Segment::spline(2, control, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0], None).unwrap();
    let expected = 5.0_f64.sqrt() / 2.0 + 2.0_f64.asinh() / 4.0;
    assert!((parabola.length() / expected - 1.0).abs() < 1e-14, "{}", parabola.length() - expected);
    assert!((2.0..2.01).contains(&parabola.curvature_max()), "{}", parabola.curvature_max());
    let point = parabola.eval(0.37);
    assert!((point.y - point.x * point.x).abs() < 1e-15);
}

#[test]
fn a_rational_spline_is_the_circle_it_stands_for() {
    // Piegl and Tiller, "The NURBS Book", 7.3: 240° of a circle from two quadratic pieces with weight cos(60°).
    let (radius, half) = (0.25, 2.0 * FRAC_PI_3 / 2.0);
    let at = |angle: f64, r: f64| Point::new(r * angle.cos(), r * angle.sin(), 0.0);
    let points = vec![
        at(0.0, radius),
        at(half, radius / half.cos()),
        at(2.0 * half, radius),
        at(3.0 * half, radius / half.cos()),
        at(4.0 * half, radius),
    ];
    let knots = vec![0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0];
    let weights = vec![1.0, half.cos(), 1.0, half.cos(), 1.0];
    let spline = Segment::spline(2, points, knots, Some(weights)).unwrap();
    let arc = Segment::arc(Point::origin(), Vector3::x(), Vector3::y(), radius, 0.0, 4.0 * half).unwrap();
    assert!((spline.length() / arc.length() - 1.0).abs() < 1e-13);
    assert!((spline.curvature_max() * radius - 1.001).abs() < 1e-9);
    for i in 0..=1000 {
        let t = f64::from(i) / 1000.0;
        assert!((spline.eval(t) - arc.eval(t)).norm() < 1e-13, "at {t}");
        assert!((spline.tangent_at(t * spline.length()) - arc.tangent_at(t * arc.length())).norm() < 1e-12);
    }
    // The double knot joins two smooth pieces: no kink.
    assert_eq!(spline.smooth_parts().len(), 1);
}

#[test]
fn spline_points_agree_with_the_basis_function_recurrence() {
    // The sum of Cox–de Boor basis functions, written out: a second derivation of the same curve, unclamped knots too.
    fn basis(i: usize, p: usize, t: f64, knots: &[f64]) -> f64 {
        if p == 0 {
            return f64::from(u8::from(knots[i] <= t && t < knots[i + 1]));
        }
        let part = |a: f64, b: f64| if b == 0.0 { 0.0 } else { a / b };
        part(t - knots[i], knots[i + p] - knots[i]) * basis(i, p - 1, t, knots)
            + part(knots[i + p + 1] - t, knots[i + p + 1] - knots[i + 1]) * basis(i + 1, p - 1, t, knots)
    }
    let mut random = Random(42);
    for degree in 2..=6 {
        let points: Vec<_> = (0..9).map(|_| random.point()).collect();
        let mut knots: Vec<f64> = (0..9 + degree + 1).map(|i| i as f64 + random.between(0.0, 0.9)).collect();
        knots[degree + 2] = knots[degree + 3];
        let Ok(Segment::Spline(spline)) = Segment::spline(degree, points.clone(), knots.clone(), None) else {
            panic!("degree {degree}")
        };
        for i in 0..500 {
            let t = knots[degree] + (knots[9] - knots[degree]) * (f64::from(i) / 500.0);
            let expected: Vector3<f64> = (0..9).map(|i| points[i].coords * basis(i, degree, t, &knots)).sum();
            let distance = spline.distance_to(&Point::from(expected));
            assert!(distance < 1e-12, "degree {degree}, t = {t}: {distance:e}");
        }
    }
}

#[test]
fn curvature_of_a_spline_is_bounded_tightly() {
    let mut random = Random(1);
    for case in 0..40 {
        let Segment::Spline(spline) = random_cubic(&mut random, case % 2 == 0) else { panic!("a spline") };
        // Turning of the tangent over a short way, at many places.
        let (length, n) = (spline.length(), 40_000);
        let h = length / f64::from(n);
        let tangents: Vec<_> = (0..=n).map(|i| spline.tangent_at(f64::from(i) * h)).collect();
        let seen = tangents.windows(2).map(|pair| angle_between(&pair[0], &pair[1]) / h).fold(0.0, f64::max);
        let bound = Segment::Spline(spline).curvature_max();
        assert!(seen <= bound && bound <= 1.01 * seen, "case {case}: seen {seen}, bound {bound}");
    }
}

#[test]
fn a_spline_of_degree_one_is_a_polyline_with_kinks() {
    let points = [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (1.0, 3.0)].map(|(x, y)| Point::new(x, y, 0.0));
    let polyline = Segment::spline(1, points.to_vec(), vec![0.0, 0.0, 1.0, 2.0, 3.0, 3.0], None).unwrap();
    let parts = polyline.smooth_parts();
    assert_eq!(parts.len(), 2, "{parts:?}");
    assert!((parts[0].end - 1.0).abs() < 1e-15 && (parts[1].end - 4.0).abs() < 1e-15);
    assert_eq!(polyline.curvature_max(), 0.0);
    assert!((polyline.point_at(1.5) - Point::new(1.0, 0.5, 0.0)).norm() < 1e-15);
}

#[test]
fn reversed_and_transformed_curves_keep_their_shape() {
    let outer_from_inner = Pose::from_roll_pitch_yaw(Vector3::new(3.0, -2.0, 0.5), 0.4, -1.2, 2.1);
    for segment in all_kinds() {
        let (reversed, transformed) = (segment.reversed(), segment.transformed(&outer_from_inner));
        let length = segment.length();
        assert!((reversed.length() - length).abs() < 1e-15 && (transformed.length() - length).abs() < 1e-12);
        for i in 0..=200 {
            let s = length * f64::from(i) / 200.0;
            assert!((reversed.point_at(length - s) - segment.point_at(s)).norm() < 1e-12, "{segment:?}");
            assert!((reversed.tangent_at(length - s) + segment.tangent_at(s)).norm() < 1e-9);
            let moved = outer_from_inner.transform_point(&segment.point_at(s).coords);
            assert!((transformed.point_at(s).coords - moved).norm() < 1e-13);
            assert!((transformed.tangent_at(s) - outer_from_inner.rotation * segment.tangent_at(s)).norm() < 1e-12);
        }
        assert_eq!(reversed.smooth_parts().len(), segment.smooth_parts().len());
        assert!((reversed.reversed().eval(0.3) - segment.eval(0.3)).norm() < 1e-15);
    }
}

#[test]
fn distance_is_zero_on_the_curve_and_the_offset_beside_it() {
    let mut random = Random(3);
    for segment in all_kinds() {
        let offset_max = 0.2 / segment.curvature_max().max(1.0);
        for _ in 0..300 {
            let s = random.between(0.05, 0.95) * segment.length();
            assert!(segment.distance_to(&segment.point_at(s)) < 1e-12);
            // Square to the tangent, near the curve: the foot is the point started from.
            let (tangent, offset) = (segment.tangent_at(s), random.between(0.0, offset_max));
            let across = tangent.cross(&random.point().coords).normalize();
            let distance = segment.distance_to(&(segment.point_at(s) + across * offset));
            assert!((distance - offset).abs() < 1e-11, "{distance} for {offset}, {segment:?}");
        }
    }
}

#[test]
fn distance_from_anywhere_is_that_of_the_nearest_sample() {
    let mut random = Random(4);
    for segment in all_kinds() {
        let samples: Vec<_> = (0..=20_000).map(|i| segment.eval(f64::from(i) / 20_000.0)).collect();
        let step = segment.length() / 20_000.0;
        for _ in 0..60 {
            let point = segment.eval(random.between(0.0, 1.0)) + random.point().coords;
            let nearest = samples.iter().map(|sample| (point - sample).norm()).fold(f64::INFINITY, f64::min);
            let distance = segment.distance_to(&point);
            assert!(distance <= nearest + 1e-12 && nearest - distance <= step, "{distance} {nearest} {segment:?}");
        }
    }
    let arc = Segment::arc(Point::origin(), Vector3::x(), Vector3::y(), 0.5, 0.0, PI).unwrap();
    assert!((arc.distance_to(&Point::origin()) - 0.5).abs() < 1e-15);
    assert!((arc.distance_to(&Point::new(0.0, 0.0, 1.2)) - 1.3).abs() < 1e-15);
    assert!((arc.distance_to(&Point::new(0.0, -1.2, 0.0)) - 1.3).abs() < 1e-15, "the ends are nearest");
}

#[test]
fn impossible_segments_are_refused() {
    let (a, b) = (Point::origin(), Point::new(1.0, 0.0, 0.0));
    let arc = |x: Vector3<f64>, radius, sweep| Segment::arc(a, x, Vector3::y(), radius, 0.0, sweep);
    let spline =
        |degree, knots: &[f64], weights| Segment::spline(degree, vec![a, b, b + b.coords], knots.to_vec(), weights);
    assert_eq!(Segment::line(a, a), Err(PathError::ZeroLength { length: 0.0 }));
    assert!(matches!(Segment::line(a, Point::new(f64::NAN, 0.0, 0.0)), Err(PathError::NotFinite { .. })));
    assert!(matches!(Segment::line(a, Point::new(1e200, 0.0, 0.0)), Err(PathError::NotFinite { .. })));
    assert!(matches!(arc(Vector3::new(1.0, 1e-6, 0.0), 1.0, 1.0), Err(PathError::Axes { .. })));
    assert_eq!(arc(Vector3::x(), -1.0, 1.0), Err(PathError::Radius { radius: -1.0 }));
    assert_eq!(arc(Vector3::x(), 1.0, 7.0), Err(PathError::Sweep { sweep: 7.0 }));
    assert_eq!(arc(Vector3::x(), 1.0, 0.0), Err(PathError::ZeroLength { length: 0.0 }));
    assert!(matches!(arc(Vector3::x(), f64::INFINITY, 1.0), Err(PathError::NotFinite { .. })));
    let knots = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
    assert_eq!(spline(0, &knots, None), Err(PathError::Degree { degree: 0 }));
    assert_eq!(spline(3, &knots, None), Err(PathError::ControlPoints { degree: 3, found: 3 }));
    assert_eq!(spline(2, &knots[1..], None), Err(PathError::Knots { expected: 6, found: 5 }));
    assert_eq!(spline(2, &[0.0, 0.0, 0.0, 1.0, 0.5, 1.0], None), Err(PathError::KnotOrder { index: 4 }));
    assert_eq!(spline(2, &knots, Some(vec![1.0])), Err(PathError::Weights { expected: 3, found: 1 }));
    assert!(matches!(spline(2, &knots, Some(vec![1.0, 0.0, 1.0])), Err(PathError::Weight { index: 1, .. })));
    assert!(matches!(spline(2, &[0.0; 6], None), Err(PathError::ZeroLength { .. })));
    assert_eq!(
        spline(1, &[0.0, 1.0, 1.0, 2.0, 2.0], None),
        Ok(Segment::spline(1, vec![b, b + b.coords], vec![1.0, 1.0, 2.0, 2.0], None).unwrap()),
        "a control point outside the parameter range does not count"
    );
    let parted = Segment::spline(1, vec![a, b, b, a], vec![0.0, 0.0, 1.0, 1.0, 2.0, 2.0], None);
    assert_eq!(parted, Err(PathError::KnotMultiplicity { knot: 1.0, degree: 1 }));
    let there_and_back = Segment::spline(2, vec![a, b, a], knots.to_vec(), None);
    assert!(matches!(there_and_back, Err(PathError::Cusp { .. })), "{there_and_back:?}");
    let doubled = Segment::spline(2, vec![a, a, b], knots.to_vec(), None);
    assert!(matches!(doubled, Err(PathError::Cusp { .. })), "{doubled:?}");
}
