"""The layers' curves of a FIM model, read from its entities with IfcOpenShell and measured with numpy.

Arcs, lines, polylines and B-splines; units, placements, senses and trims as ISO 16739 has them. Metres, in the frame of
the wall. Anything else is refused. (IfcOpenShell's own conversion gives chords, and nothing where one curve is a spline.)
"""

import math

import ifcopenshell
import ifcopenshell.util.placement
import ifcopenshell.util.unit
import numpy as np

JOINT_GAP = 1e-5  # m: segments that are farther apart do not meet


class Line:
    def __init__(self, start, end):
        self.start, self.end = np.asarray(start, float), np.asarray(end, float)
        self.length = float(np.linalg.norm(self.end - self.start))

    def reversed(self):
        return Line(self.end, self.start)

    def project(self, points):
        """Of each point the arc length of the nearest point of the curve, and the distance to it."""
        along = (self.end - self.start) / self.length
        s = np.clip((points - self.start) @ along, 0.0, self.length)
        return s, np.linalg.norm(points - (self.start + s[:, None] * along), axis=1)


class Arc:
    """From angle `first`, through `sweep` (signed), in the plane of the unit vectors x and y."""

    def __init__(self, center, x, y, radius, first, sweep):
        self.center, self.x, self.y, self.radius = center, x, y, radius
        self.first, self.sweep = first, sweep
        self.length = radius * abs(sweep)
        self.start, self.end = self.at(np.array([0.0, abs(sweep)]))

    def at(self, turned):
        angle = (self.first + math.copysign(1.0, self.sweep) * turned)[:, None]
        return self.center + self.radius * (np.cos(angle) * self.x + np.sin(angle) * self.y)

    def reversed(self):
        return Arc(self.center, self.x, self.y, self.radius, self.first + self.sweep, -self.sweep)

    def project(self, points):
        local = points - self.center
        angle = np.arctan2(local @ self.y, local @ self.x)
        turned = np.mod((angle - self.first) * math.copysign(1.0, self.sweep), 2 * math.pi)
        sweep = abs(self.sweep)
        # Outside the arc the nearer end is nearest.
        nearer = np.where(turned - sweep < 2 * math.pi - turned, sweep, 0.0)
        turned = np.where(turned <= sweep, turned, nearer)
        return self.radius * turned, np.linalg.norm(points - self.at(turned), axis=1)


class Spline:
    """A B-spline without weights; knots with their multiplicities written out."""

    STEPS = 4000

    def __init__(self, degree, points, knots):
        self.degree, self.points, self.knots = degree, np.asarray(points, float), np.asarray(knots, float)
        if len(self.knots) != len(self.points) + degree + 1:
            raise ValueError(f"{len(self.knots)} knots for {len(self.points)} points of degree {degree}")
        self.low, self.high = self.knots[degree], self.knots[-degree - 1]
        # The grid holds every knot, so that the curve is smooth between its values.
        grid = np.linspace(self.low, self.high, self.STEPS + 1)
        inner = self.knots[(self.knots >= self.low) & (self.knots <= self.high)]
        self.grid = np.unique(np.concatenate([grid, inner]))
        nodes, weights = np.polynomial.legendre.leggauss(6)
        half = np.diff(self.grid)[:, None] / 2
        inside = (self.grid[:-1, None] + half * (1 + nodes)).ravel()
        speed = np.linalg.norm(self.derivative(inside), axis=1).reshape(-1, len(nodes))
        self.table = np.concatenate([[0.0], np.cumsum((speed * weights * half).sum(axis=1))])
        self.length = float(self.table[-1])
        self.start, self.end = self.at(np.array([self.low, self.high]))

    def basis(self, degree, knots, u):
        """Values of all basis functions (Cox, de Boor), a row for each u."""
        last = np.nonzero(knots < knots[-1])[0][-1]
        span = np.clip(np.searchsorted(knots, u, side="right") - 1, 0, last)
        values = np.zeros((len(u), len(knots) - 1))
        values[np.arange(len(u)), span] = 1.0
        for p in range(1, degree + 1):
            raised = np.zeros((len(u), values.shape[1] - 1))
            for i in range(values.shape[1] - 1):
                if knots[i + p] > knots[i]:
                    raised[:, i] += (u - knots[i]) / (knots[i + p] - knots[i]) * values[:, i]
                if knots[i + p + 1] > knots[i + 1]:
                    raised[:, i] += (knots[i + p + 1] - u) / (knots[i + p + 1] - knots[i + 1]) * values[:, i + 1]
            values = raised
        return values

    def at(self, u):
        return self.basis(self.degree, self.knots, u) @ self.points

    def derivative(self, u):
        p, knots = self.degree, self.knots
        steps = np.diff(self.points, axis=0)
        factor = p / (knots[p + 1 : -1] - knots[1 : -p - 1])
        return self.basis(p - 1, knots[1:-1], u) @ (steps * factor[:, None])

    def reversed(self):
        return Spline(self.degree, self.points[::-1], (self.knots[0] + self.knots[-1]) - self.knots[::-1])

    def project(self, points):
        # Far points need no exact answer: they get the distance of the middle, which is wrong by half the length at most.
        s = np.zeros(len(points))
        middle = self.at(np.array([(self.low + self.high) / 2]))[0]
        distance = np.linalg.norm(points - middle, axis=1)
        near = np.nonzero(distance <= self.length + 0.01)[0]
        values = self.at(self.grid)
        for part in np.array_split(near, max(1, len(near) // 500)):
            wanted = points[part]
            gap = ((wanted[:, None, :] - values[None, :, :]) ** 2).sum(axis=2)
            u = self.grid[np.argmin(gap, axis=1)]
            for _ in range(20):  # Gauss-Newton on the distance
                slope = self.derivative(u)
                step = ((wanted - self.at(u)) * slope).sum(axis=1) / (slope * slope).sum(axis=1)
                u = np.clip(u + step, self.low, self.high)
            s[part] = self.length_to(u)
            distance[part] = np.linalg.norm(wanted - self.at(u), axis=1)
        return s, distance

    def length_to(self, u):
        """Arc length up to u: the table's, and the rest by the trapezium of the speeds."""
        index = np.clip(np.searchsorted(self.grid, u, side="right") - 1, 0, len(self.grid) - 2)
        base = self.grid[index]
        ends = np.linalg.norm(self.derivative(base), axis=1) + np.linalg.norm(self.derivative(u), axis=1)
        return self.table[index] + ends / 2 * (u - base)


class Path:
    """Segments in a row."""

    def __init__(self, segments):
        self.segments = segments
        for number, (before, after) in enumerate(zip(segments, segments[1:])):
            gap = np.linalg.norm(before.end - after.start)
            if gap > JOINT_GAP:
                raise ValueError(f"segments {number} and {number + 1} are {gap:.3e} m apart")
        self.starts = np.cumsum([0.0] + [segment.length for segment in segments])
        self.length = float(self.starts[-1])
        self.start, self.end = segments[0].start, segments[-1].end

    def follow(self, points, tolerance):
        """Arc length and distance of points that run along the path: from each, only the same segment and the next can be
        reached. The first point belongs to the first segment."""
        found = [segment.project(points) for segment in self.segments]
        arc_length = np.stack([s + start for (s, _), start in zip(found, self.starts)])
        distance = np.stack([d for _, d in found])
        chosen, at = np.zeros(len(points), int), 0
        for i in range(len(points)):
            # A segment may be passed between two points.
            while at + 1 < len(self.segments) and distance[at + 1, i] < distance[at, i]:
                at += 1
                if distance[at, i] <= tolerance:
                    break
            chosen[i] = at
        index = np.arange(len(points))
        return arc_length[chosen, index], distance[chosen, index], chosen


def axes(placement, scale):
    """Origin (m), x and y of an IfcAxis2Placement."""
    matrix = ifcopenshell.util.placement.get_axis2placement(placement)
    return matrix[:3, 3] * scale, matrix[:3, 0], matrix[:3, 1]


class Reader:
    """The curves of one file."""

    def __init__(self, path):
        self.file = ifcopenshell.open(str(path))
        self.length = ifcopenshell.util.unit.calculate_unit_scale(self.file)
        self.angle = ifcopenshell.util.unit.calculate_unit_scale(self.file, "PLANEANGLEUNIT")

    def point(self, point):
        coordinates = list(point.Coordinates) + [0.0] * (3 - len(point.Coordinates))
        return np.array(coordinates) * self.length

    def layers(self):
        """A path for each layer, from the bottom, in the wall's frame."""
        walls = [wall for wall in self.file.by_type("IfcWall") if wall.IsDecomposedBy]
        if len(walls) != 1:
            raise ValueError(f"{len(walls)} walls with parts")
        parts = [part for relation in walls[0].IsDecomposedBy for part in relation.RelatedObjects]
        world_from_wall = self.placement(walls[0])
        layers = []
        for part in parts:
            wall_from_part = np.linalg.inv(world_from_wall) @ self.placement(part)
            axis = [r for r in part.Representation.Representations if r.RepresentationIdentifier == "Axis"]
            if len(axis) != 1 or len(axis[0].Items) != 1:
                raise ValueError(f"{part}: no single curve")
            self.outer = wall_from_part
            layers.append((wall_from_part[2, 3], Path(self.curve(axis[0].Items[0]))))
        return [path for _, path in sorted(layers, key=lambda layer: layer[0])]

    def placement(self, product):
        matrix = np.array(ifcopenshell.util.placement.get_local_placement(product.ObjectPlacement), float)
        matrix[:3, 3] *= self.length
        return matrix

    def moved(self, point):
        return self.outer[:3, :3] @ point + self.outer[:3, 3]

    def curve(self, curve):
        """Its segments."""
        if curve.is_a("IfcCompositeCurve"):
            segments = []
            for segment in curve.Segments:
                parts = self.curve(segment.ParentCurve)
                segments += parts if segment.SameSense else [part.reversed() for part in reversed(parts)]
            return segments
        if curve.is_a("IfcPolyline"):
            points = [self.moved(self.point(point)) for point in curve.Points]
            return [Line(start, end) for start, end in zip(points, points[1:])]
        if curve.is_a() == "IfcBSplineCurveWithKnots":
            points = [self.moved(self.point(point)) for point in curve.ControlPointsList]
            return [Spline(curve.Degree, points, np.repeat(curve.Knots, curve.KnotMultiplicities))]
        if curve.is_a("IfcTrimmedCurve") and curve.BasisCurve.is_a("IfcCircle"):
            return [self.arc(curve)]
        if curve.is_a("IfcTrimmedCurve") and curve.BasisCurve.is_a("IfcLine"):
            return [self.line(curve)]
        raise ValueError(f"{curve}: not a curve that this reader knows")

    def trim(self, curve, side):
        """The point (m) or the parameter that decides; the other is None."""
        values = getattr(curve, side)
        points = [self.point(value) for value in values if value.is_a("IfcCartesianPoint")]
        parameters = [value.wrappedValue for value in values if value.is_a("IfcParameterValue")]
        if points and (curve.MasterRepresentation == "CARTESIAN" or not parameters):
            return points[0], None
        return None, parameters[0]

    def line(self, curve):
        start = self.point(curve.BasisCurve.Pnt)
        along = np.array(curve.BasisCurve.Dir.Orientation.DirectionRatios, float)
        along = along / np.linalg.norm(along) * curve.BasisCurve.Dir.Magnitude * self.length
        ends = []
        for side in ("Trim1", "Trim2"):
            point, parameter = self.trim(curve, side)
            ends.append(self.moved(start + parameter * along if point is None else point))
        # The trims give the direction of a line; SenseAgreement must say the same.
        forward = (ends[1] - ends[0]) @ (self.outer[:3, :3] @ along) > 0
        if forward != curve.SenseAgreement:
            raise ValueError(f"{curve}: trims and sense contradict each other")
        return Line(*ends)

    def arc(self, curve):
        circle = curve.BasisCurve
        center, x, y = axes(circle.Position, self.length)
        angles = []
        for side in ("Trim1", "Trim2"):
            point, parameter = self.trim(curve, side)
            if point is None:
                angles.append(parameter * self.angle)
            else:
                angles.append(math.atan2((point - center) @ y, (point - center) @ x))
        first, last = angles
        turn = (last - first if curve.SenseAgreement else first - last) % (2 * math.pi)
        turn = turn or 2 * math.pi
        rotation = self.outer[:3, :3]
        sweep = turn if curve.SenseAgreement else -turn
        return Arc(self.moved(center), rotation @ x, rotation @ y, circle.Radius * self.length, first, sweep)
