//! Where one move leads: curves joined end to end in the part frame, or a straight line in joint space.

use super::path::{Point, Segment, TANGENT_BREAK, angle_between};
use super::profile::Stretch;
use nalgebra::Vector3;
use screed_kernel::units::JointPos;

/// The widest gap (m) between consecutive segments that rounding in a file may leave.
pub const GAP_MAX: f64 = 5e-6;
/// The widest gap as a share of the segment after it: closing it changes the speed there by no more than this.
const GAP_SHARE_MAX: f64 = 1e-4;

/// Where one move leads.
#[derive(Clone, Debug, PartialEq)]
pub enum Route {
    /// Along curves.
    Curves(Curves),
    /// Straight in joint space; its arc length is the share of the way, 0 to 1.
    Joints {
        /// The joints at 0.
        from: JointPos<6>,
        /// The joints at 1.
        to: JointPos<6>,
    },
}

/// Segments run through one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    pieces: Vec<Piece>,
    length: f64,
}

/// One segment of a route.
#[derive(Clone, Debug, PartialEq)]
struct Piece {
    segment: Segment,
    length: f64,
    /// Arc length of the route where it begins (m).
    start: f64,
    /// From its own start to the end of the piece before it: the route begins there and fades to the segment itself at
    /// its end, so that the gaps that rounding leaves in files are no steps. At most [`GAP_MAX`] long.
    gap: Vector3<f64>,
}

/// Two consecutive segments do not meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// The segment after the gap, from 0.
    pub segment: usize,
    /// The distance (m).
    pub gap: f64,
}

impl Curves {
    /// Joins segments.
    ///
    /// # Errors
    /// [`Gap`] when two of them do not meet.
    pub fn new(segments: &[Segment]) -> Result<Self, Gap> {
        let mut pieces: Vec<Piece> = Vec::with_capacity(segments.len());
        let mut length = 0.0;
        for (index, segment) in segments.iter().enumerate() {
            let own = segment.length();
            let gap = pieces.last().map_or(Vector3::zeros(), |before| before.segment.end() - segment.start());
            if gap.norm() > GAP_MAX.min(GAP_SHARE_MAX * own) {
                return Err(Gap { segment: index, gap: gap.norm() });
            }
            pieces.push(Piece { segment: segment.clone(), length: own, start: length, gap });
            length += own;
        }
        Ok(Self { pieces, length })
    }

    /// Arc length of the whole route (m).
    pub fn length(&self) -> f64 {
        self.length
    }

    /// The point at arc length `s` (m) and the index of its segment.
    pub fn point_at(&self, s: f64) -> (Point, usize) {
        let index = self.pieces.partition_point(|piece| piece.start <= s).saturating_sub(1);
        self.pieces.get(index).map_or((Point::origin(), 0), |piece| (piece.point_at(s - piece.start), index))
    }

    /// The index of the segment nearest to a point.
    pub fn nearest_segment(&self, point: &Point) -> usize {
        let distances = self.pieces.iter().map(|piece| piece.segment.distance_to(point)).enumerate();
        distances.fold((0, f64::INFINITY), |best, at| if at.1 < best.1 { at } else { best }).0
    }

    /// The stretches that a profile is made for, one a smooth part of a segment.
    pub fn stretches(&self) -> Vec<Stretch> {
        let mut stretches: Vec<Stretch> = Vec::with_capacity(self.pieces.len());
        let mut before: Option<Vector3<f64>> = None;
        for piece in &self.pieces {
            let breaks = before.is_some_and(|before| angle_between(&before, &piece.tangent_at(0.0)) > TANGENT_BREAK);
            if let Some(last) = stretches.last_mut() {
                last.rest_after = breaks;
            }
            // Inside a segment, parts end where the tangent breaks.
            stretches.extend(piece.segment.smooth_parts().iter().map(|part| Stretch {
                length: part.end - part.start,
                curvature_max: part.curvature_max,
                rest_after: true,
            }));
            before = Some(piece.tangent_at(piece.length));
        }
        stretches
    }
}

impl Piece {
    fn point_at(&self, s: f64) -> Point {
        self.segment.point_at(s) + self.gap * (1.0 - s / self.length).clamp(0.0, 1.0)
    }

    fn tangent_at(&self, s: f64) -> Vector3<f64> {
        (self.segment.tangent_at(s) - self.gap / self.length).normalize()
    }
}

impl Route {
    /// The share of the way in joint space.
    pub fn joints_between(from: &JointPos<6>, to: &JointPos<6>, share: f64) -> JointPos<6> {
        JointPos(core::array::from_fn(|joint| from.0[joint] + (to.0[joint] - from.0[joint]) * share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    fn line(x0: f64, y0: f64, x1: f64, y1: f64) -> Segment {
        Segment::line(Point::new(x0, y0, 0.0), Point::new(x1, y1, 0.0)).unwrap()
    }

    #[test]
    fn the_tool_rests_at_corners_and_only_there() {
        // A line into a tangent arc, then a corner, then two lines in one direction.
        let arc =
            Segment::arc(Point::new(1.0, 0.5, 0.0), Vector3::x(), Vector3::y(), 0.5, -FRAC_PI_2, FRAC_PI_2).unwrap();
        let curves =
            Curves::new(&[line(0.0, 0.0, 1.0, 0.0), arc, line(1.5, 0.5, 1.0, 0.5), line(1.0, 0.5, 0.2, 0.5)]).unwrap();
        let rests: Vec<_> = curves.stretches().iter().map(|stretch| stretch.rest_after).collect();
        assert_eq!(rests, [false, true, false, true]);
        let corner = [(1.5, 0.5), (1.0, 0.5), (1.0, 0.2)].map(|(x, y)| Point::new(x, y, 0.0)).to_vec();
        let polyline = Segment::spline(1, corner, vec![0.0, 0.0, 1.0, 2.0, 2.0], None).unwrap();
        let rests: Vec<_> =
            Curves::new(&[polyline, line(1.0, 0.2, 1.0, 0.0), line(1.0, 0.0, 0.5, 0.0)]).unwrap().stretches();
        assert_eq!(rests.iter().map(|stretch| stretch.rest_after).collect::<Vec<_>>(), [true, false, true, true]);
        assert!((curves.length() - (1.0 + 0.25 * core::f64::consts::PI + 0.5 + 0.8)).abs() < 1e-15);
        assert_eq!(curves.point_at(1.0 + 1e-9).1, 1);
    }

    #[test]
    fn a_gap_from_rounding_is_closed_without_a_step_and_a_wide_one_is_refused() {
        let gap = 4e-6;
        let curves = Curves::new(&[line(0.0, 0.0, 1.0, 0.0), line(1.0, gap, 2.0, gap)]).unwrap();
        let (before, after) = (curves.point_at(1.0 - 1e-12).0, curves.point_at(1.0 + 1e-12).0);
        assert!((after - before).norm() < 1e-11);
        assert!((curves.point_at(2.0).0 - Point::new(2.0, gap, 0.0)).norm() < 1e-15);
        // Closing it bends the path by 4 µrad: more than a tangent may break without a rest.
        assert!(curves.stretches()[0].rest_after);
        let refused = Curves::new(&[line(0.0, 0.0, 1.0, 0.0), line(1.0, 2e-5, 2.0, 0.0)]).unwrap_err();
        assert!(refused.segment == 1 && (refused.gap - 2e-5).abs() < 1e-15);
        assert!(Curves::new(&[line(0.0, 0.0, 1.0, 0.0), line(1.0, 4e-6, 1.01, 4e-6)]).is_err());
    }
}
