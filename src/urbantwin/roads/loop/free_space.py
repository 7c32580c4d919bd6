"""Free space for outer roads beyond the region's border."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.loop.dubins import Pose2, dubins_path

__all__ = ["FreeSpace", "Points", "band", "dubins_points", "unit"]

#: Maximum turn between two points of a drawn curve, radians; the deviation from an arc of 11 m
#: radius is then 2 cm.
STEP = math.radians(7.0)
#: Clearance between two roads round the region, metres.
RING_GAP_M = 6.0
#: Clearance between the straight way out of a street and the centre line of other streets, metres.
WAY_OUT_ROOM_M = 3.0
#: Cost of overlaps with other roads and with buildings in the twin, per square metre, relative to
#: buildings outside the twin.
ROAD_COST, STANDING_COST = 5.0, 20.0
#: Length beyond any region, metres.
FAR_M = 5000.0

Points = NDArray[np.float64]


def unit(heading: float) -> Points:
    """Return the unit vector (2,) of a heading."""
    return np.array([math.cos(heading), math.sin(heading)])


def band(line: Points, half: float) -> shapely.Polygon:
    """Return the area within ``half`` metres on both sides of a line (N, 2)."""
    return shapely.LineString(line).buffer(half, cap_style="flat")


def dubins_points(start: Pose2, end: Pose2, radius: float, turn: str | None = None) -> Points:
    """Return points (N, 2) of the Dubins path between two poses, including both ends."""
    curve = dubins_path(start, end, radius=radius, turn=turn)
    stations = [0.0]
    for piece, begin in zip(curve.pieces, curve.starts, strict=False):
        steps = max(1, math.ceil(abs(piece.curvature) * piece.length / STEP))
        stations += [float(begin) + piece.length * k / steps for k in range(1, steps + 1)]
    points = curve.at(stations)[:, :2]
    is_distinct = np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.05
    return np.asarray(points[np.concatenate([[True], is_distinct])])


class FreeSpace:
    """Streets of the region by number, buildings, and occupied areas outside.

    Args:
        roads: (N, 2) points of each street.
        half_widths: half-widths of the streets, metres.
        buildings: areas of buildings.
        standing: areas of buildings in the twin, which reach into the region.
        region: area to avoid for roads round it, also where the map has no street up to its border.
    """

    def __init__(
        self,
        roads: Sequence[Points],
        half_widths: Sequence[float],
        buildings: Sequence[shapely.Geometry] = (),
        standing: Sequence[shapely.Geometry] = (),
        region: shapely.Geometry | None = None,
    ) -> None:
        self._buildings = shapely.STRtree(list(buildings))
        self._standing = shapely.STRtree(list(standing))
        lines = [shapely.LineString(points) for points in roads]
        self._streets = shapely.buffer(lines, half_widths, quad_segs=16)
        self._tree = shapely.STRtree(self._streets)
        self._lines = shapely.STRtree(shapely.buffer(lines, WAY_OUT_ROOM_M, cap_style="flat"))
        self._taken: list[shapely.Geometry] = []
        self._reserved: list[shapely.Geometry] = []
        inside = shapely.union_all([*self._streets, region or shapely.Polygon()])
        self.hull = _counter_clockwise(shapely.convex_hull(inside))

    def take(self, area: shapely.Geometry) -> None:
        """Mark an area as occupied."""
        self._taken.append(area)

    def reserve(self, area: shapely.Geometry) -> None:
        """Reserve an area for a later road."""
        self._reserved.append(area)

    def cost(self, area: shapely.Geometry, *streets: int, enough: float = math.inf) -> float:
        """Return the cost of an area: its overlap with others than some streets, square metres.

        Roads count `ROAD_COST` times, buildings in the twin `STANDING_COST` times.

        Args:
            area: the area.
            streets: numbers of the streets to ignore.
            enough: a cost above this may be returned incomplete.
        """
        cost = STANDING_COST * self.walls_on(area)
        if cost > enough:
            return cost
        hits = sorted(set(self._tree.query(area, predicate="intersects").tolist()) - set(streets))
        roads = [*(self._streets[k] for k in hits), *self._taken, *self._reserved]
        cost += ROAD_COST * _area_on(area, roads)
        if cost > enough:
            return cost
        built = sorted(self._buildings.query(area, predicate="intersects").tolist())
        return cost + _area_on(area, [self._buildings.geometries[k] for k in built])

    def walls_on(self, area: shapely.Geometry) -> float:
        """Return the overlap of an area with buildings in the twin, square metres."""
        hits = sorted(self._standing.query(area, predicate="intersects").tolist())
        return _area_on(area, [self._standing.geometries[k] for k in hits])

    def leads_out(self, street: int, point: Points, heading: float) -> bool:
        """Return whether the straight continuation of a street's end avoids all other streets."""
        ahead = unit(heading)
        ray = shapely.LineString([point + ahead * 3.0, point + ahead * FAR_M])
        return not set(self._lines.query(ray, predicate="intersects").tolist()) - {street}

    def place(self, point: Points, heading: float) -> float:
        """Return where a ray leaves the hull of all streets, metres along its border."""
        return _leaves(self.hull.exterior, point, heading)

    def ring(self, half_width: float) -> shapely.LinearRing:
        """Return a line round everything, counter-clockwise, with room for a road on it."""
        built = self._standing.geometries
        hull = shapely.convex_hull(shapely.union_all([self.hull, *self._taken, *built]))
        return _counter_clockwise(hull.buffer(RING_GAP_M + half_width)).exterior


def _area_on(area: shapely.Geometry, others: Sequence[shapely.Geometry]) -> float:
    """Return the overlap of an area with others, square metres."""
    shapely.prepare(area)
    overlaps = [area.intersection(other) for other in others if area.intersects(other)]
    return float(shapely.union_all(overlaps).area)


def _leaves(border: shapely.LinearRing, point: Points, heading: float) -> float:
    ray = shapely.LineString([point, point + unit(heading) * FAR_M])
    meet = shapely.get_coordinates(shapely.intersection(ray, border))
    farthest = meet[np.linalg.norm(meet - point, axis=1).argmax()] if len(meet) else point
    return float(border.project(shapely.Point(farthest)))


def _counter_clockwise(area: shapely.Polygon) -> shapely.Polygon:
    return shapely.geometry.polygon.orient(area)
