//! Contour error: how far the tool is from the curves it should be on, whenever it is there.

use super::path::{Point, Segment};

/// Distances to the segments of one layer. The segment nearest to the last point is tried first, and one whose bounding
/// ball is farther away than the best distance so far is passed over: the result is that of trying all.
#[derive(Clone, Debug)]
pub struct Contour {
    balls: Vec<Ball>,
    /// The segment nearest to the last point.
    last: usize,
}

/// A segment within a ball about its middle: no point of a curve is farther from there than half its length.
#[derive(Clone, Debug)]
struct Ball {
    segment: Segment,
    center: Point,
    radius: f64,
}

impl Contour {
    /// Of one layer's segments.
    pub fn new(segments: &[Segment]) -> Self {
        let ball = |segment: &Segment| Ball {
            center: segment.eval(0.5),
            radius: 0.5 * segment.length(),
            segment: segment.clone(),
        };
        Self { balls: segments.iter().map(ball).collect(), last: 0 }
    }

    /// Distance (m) from a point in the part frame to the nearest point of the curves, to 1e-9 m; infinite without curves.
    pub fn distance(&mut self, point: &Point) -> f64 {
        let mut best = self.balls.get(self.last).map_or(f64::INFINITY, |ball| ball.segment.distance_to(point));
        for (index, ball) in self.balls.iter().enumerate() {
            if index != self.last && (point - ball.center).norm() - ball.radius < best {
                let distance = ball.segment.distance_to(point);
                if distance < best {
                    (best, self.last) = (distance, index);
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::tests::layer;
    use nalgebra::Vector3;

    #[test]
    fn the_distance_is_that_of_trying_every_segment() {
        let segments = layer(0, 70.0).segments;
        let mut contour = Contour::new(&segments);
        let mut angle: f64 = 0.0;
        for (index, segment) in segments.iter().enumerate() {
            for i in 0..50 {
                // Beside the path, near and far, in ever new directions; and now and then somewhere else.
                angle += 2.4;
                let radius = 10.0_f64.powf(f64::from(i % 10) - 10.0);
                let beside = Vector3::new(angle.cos(), angle.sin(), (0.7 * angle).cos()) * radius;
                let on = if i % 7 == 0 { &segments[(3 * index) % segments.len()] } else { segment };
                let point = on.eval(f64::from(i) / 49.0) + beside;
                let nearest = segments.iter().map(|segment| segment.distance_to(&point)).fold(f64::INFINITY, f64::min);
                assert_eq!(contour.distance(&point), nearest);
                assert!(nearest <= beside.norm() + 1e-12);
            }
        }
        assert_eq!(Contour::new(&[]).distance(&Point::origin()), f64::INFINITY);
    }
}
