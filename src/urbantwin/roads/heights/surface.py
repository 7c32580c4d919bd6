"""The road surface: streets by their profiles, blended continuously over junctions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from urbantwin.roads.heights.junction_mouth import Mouths, levels_at_ends, mouths_of
from urbantwin.roads.heights.stations import Stations, stations_of
from urbantwin.roads.model import LaneModel, ModelRoad

__all__ = ["Base", "RoadSurface"]

#: Heights (N,) at points (N, 2) of a level, metres.
Base = Callable[[NDArray[np.float64], int], NDArray[np.float64]]
#: Influence of a street's end into a junction, and of its side sideways, metres.
REACH_M, SIDE_REACH_M = 14.0, 6.0
#: Corrections above this mean another surface: there is a wall between a ramp and the street beside
#: or under it, metres.
WALL_M = 2.0
#: Weight of the ground between streets: that of a street's end about 4 m away.
GROUND_WEIGHT = 0.03
#: Spacing of samples along streets, metres.
STEP_M = 1.0
#: Maximum number of ends, and of side samples, considered around a point.
ENDS, SIDES = 12, 6
#: Tolerance of borders, metres.
TOUCH_M = 0.005


@dataclass(frozen=True)
class _Level:
    """Search structures of one level."""

    streets: tuple[ModelRoad, ...]
    stations: Stations
    footprints: shapely.STRtree
    ways: shapely.STRtree
    mouths: Mouths
    mouth_tree: cKDTree
    widest: float
    sides: NDArray[np.float64]
    side_offset: NDArray[np.float64]
    side_tree: cKDTree


class RoadSurface:
    """Height of the road surface anywhere, on each level.

    On a street it is exactly that of the street's profiles. Beside and between streets it is the
    base with a correction that makes it continuous in height and slope with each street that ends
    or runs there. Corrections are weighted by inverse squared distance to the ends of streets
    within a limited range (Shepard 1968; Franke & Nielson, "Smooth interpolation of large sets of
    scattered data", 1980); the surfaces of streets extend straight out of their ends. Overlapping
    streets are blended.

    Args:
        model: the lanes, with their heights.
        base: height between the streets.
        stations: stations of the model's streets and then its connecting roads, about a metre
            apart, if already known.
    """

    def __init__(self, model: LaneModel, base: Base, stations: Stations | None = None) -> None:
        self._base = base
        streets = [road for road in model.roads if road.junction < 0]
        connecting = [road for road in model.roads if road.junction >= 0]
        all_stations = stations or stations_of([*streets, *connecting], STEP_M)
        stations = all_stations.pick(streets, range(len(streets)))
        through = all_stations.pick(
            connecting, range(len(streets), len(streets) + len(connecting))
        ).areas()
        ends = levels_at_ends(streets, {j.id: j.level for j in model.junctions})
        #: The ends of all streets, and (id of a street, ``start`` or ``end``) -> index of one.
        self.mouths = mouths_of(streets, stations, ends)
        self.mouth_of = {
            (road.id, contact): side * len(streets) + k
            for side, contact in enumerate(("start", "end"))
            for k, road in enumerate(streets)
        }
        self._levels = {}
        for level in sorted({*self.mouths.level.tolist(), *(road.level for road in streets)}):
            street_index = [k for k, road in enumerate(streets) if road.level == level]
            level_stations = stations.pick([streets[k] for k in street_index], street_index)
            connecting_tree = shapely.STRtree(
                [a for a, w in zip(through, connecting, strict=True) if w.level == level]
            )
            self._levels[level] = self._level(
                level_stations, self.mouths.of(level), connecting_tree, level
            )

    def height(self, xy: ArrayLike, level: int = 0) -> NDArray[np.float64]:
        """Return heights (N,) of the carriageway's surface at points (N, 2) of a level, metres."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        z = np.asarray(self._base(points, level), np.float64).copy()
        layer = self._levels.get(level)
        if layer is None or not len(points):
            return z
        on, heights = self._on_streets(layer, points)
        rest = np.ones(len(points), bool)
        rest[on] = False
        z[rest] += self._correction(layer, points[rest], z[rest])
        z[on] = heights
        return z

    def on_streets(self, xy: ArrayLike, level: int = 0) -> NDArray[np.float64]:
        """Return 1 for points (N, 2) on a street of a level, else 0."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        on_street = np.zeros(len(points))
        if level in self._levels:
            on_street[self._on_streets(self._levels[level], points)[0]] = 1.0
        return on_street

    def ridges(self, level: int = 0) -> list[shapely.LineString]:
        """Return the ridges of the surface: reference lines of crowned streets."""
        layer = self._levels.get(level)
        streets = layer.streets if layer else ()
        return [road.curve.line.simplify(0.003) for road in streets if not road.crown.is_zero]

    def _level(
        self, stations: Stations, mouths: Mouths, ways: shapely.STRtree, level: int
    ) -> _Level:
        middle = mouths.xy + ((mouths.right + mouths.left) / 2)[:, None] * np.column_stack(
            [-mouths.ahead[:, 1], mouths.ahead[:, 0]]
        )
        outer = np.column_stack([stations.outer_right, stations.outer_left])
        sides = stations.beside(outer).reshape(-1, 2)
        z = np.zeros(outer.shape)
        for k, road in enumerate(stations.roads):
            part = stations.of(k)
            s = np.repeat(stations.s[part], 2)
            z[part] = road.heights(s, outer[part].ravel()).reshape(-1, 2)
        # Where connecting roads cross a footway, its border has no influence.
        free = np.ones(len(sides), bool)
        free[ways.query(shapely.points(sides), "dwithin", distance=SIDE_REACH_M / 2)[0]] = False
        sides = sides[free]
        return _Level(
            stations.roads,
            stations,
            shapely.STRtree(stations.areas(outer=True, grown=0.05)),
            ways,
            mouths,
            cKDTree(middle),
            float((mouths.left - mouths.right).max(initial=0.0)),
            sides,
            z.ravel()[free] - self._base(sides, level),
            cKDTree(sides),
        )

    def _on_streets(
        self, known: _Level, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the indices of points on streets, and their heights."""
        point_index, street = _inside(known.footprints, points)
        order = np.argsort(street, kind="stable")
        point_index, street = point_index[order], street[order]
        bounds = np.searchsorted(street, np.arange(len(known.streets) + 1))
        total, weight = np.zeros(len(points)), np.zeros(len(points))
        paved = np.zeros(len(points), bool)
        rows = []
        for k, road in enumerate(known.streets):
            index = point_index[bounds[k] : bounds[k + 1]]
            if not len(index):
                continue
            part = known.stations.of(k)
            s, t = road.curve.locate(points[index])
            grid_s = known.stations.s[part]
            right, left, outer_right, outer_left = (
                np.interp(s, grid_s, side[part])
                for side in (
                    known.stations.right,
                    known.stations.left,
                    known.stations.outer_right,
                    known.stations.outer_left,
                )
            )
            along = np.minimum(s, road.length - s)
            margin = np.minimum(np.minimum(t - right, left - t), along)
            outer = np.minimum(np.minimum(t - outer_right, outer_left - t), along)
            z = road.heights(np.clip(s, 0.0, road.length), t)
            rows.append(np.column_stack([index, z, margin, outer]))
            paved[index[margin >= -TOUCH_M]] = True
        if rows:
            index, z, margin, outer = np.concatenate(rows).T
            index = index.astype(np.int64)
            inside = np.where(paved[index], margin, outer)
            # A connecting road that cuts a corner takes precedence over the footway there.
            bare = np.flatnonzero(~paved[index])
            cut = _inside(known.ways, points[index[bare]])[0]
            inside[bare[cut]] = -1.0
            share = np.where(inside >= -TOUCH_M, np.maximum(inside, 1e-4) ** 2, 0.0)
            np.add.at(total, index, share * z)
            np.add.at(weight, index, share)
        inside_index = np.flatnonzero(weight > 0.0)
        return inside_index, total[inside_index] / weight[inside_index]

    def _correction(
        self, known: _Level, points: NDArray[np.float64], base: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the correction of the base beside and between streets, metres."""
        if not len(points):
            return np.zeros(0)
        total, weight = np.zeros(len(points)), np.full(len(points), GROUND_WEIGHT)
        # Distance is to the whole end of the street, not its centre: its width is added to the
        # range.
        count = max(1, min(ENDS, len(known.mouths.out)))
        gap, nearest = known.mouth_tree.query(
            points, k=np.arange(1, count + 1), distance_upper_bound=REACH_M + known.widest
        )
        row, column = np.nonzero(np.isfinite(gap))
        if len(row):
            end = nearest[row, column]
            u, t = known.mouths.seen_from(end, points[row])
            distance = known.mouths.distance(end, u, t)
            share = _inverse_distance_weight(distance, REACH_M)
            offset = known.mouths.extended(end, u, t) - base[row]
            share = np.where(np.abs(offset) <= WALL_M, share, 0.0)
            total += np.bincount(row, share * offset, minlength=len(points))
            weight += np.bincount(row, share, minlength=len(points))
        count = max(1, min(SIDES, len(known.sides)))
        gap, nearest = known.side_tree.query(
            points, k=np.arange(1, count + 1), distance_upper_bound=SIDE_REACH_M
        )
        row, column = np.nonzero(np.isfinite(gap))
        offset = known.side_offset[nearest[row, column]]
        share = _inverse_distance_weight(gap[row, column], SIDE_REACH_M)
        share = np.where(np.abs(offset) <= WALL_M, share, 0.0)
        total += np.bincount(row, share * offset, minlength=len(points))
        weight += np.bincount(row, share, minlength=len(points))
        return np.asarray(total / weight)


def _inside(
    areas: shapely.STRtree, points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices of points (N, 2) and of the areas that contain them."""
    point_index, area = areas.query(shapely.points(points))
    # Prepared areas are faster than the tree's own predicate.
    shapely.prepare(areas.geometries)
    is_inside = shapely.intersects_xy(areas.geometries[area], points[point_index])
    return point_index[is_inside], area[is_inside]


def _inverse_distance_weight(distance: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Return weights that diverge at zero distance and are 0 from ``reach`` on."""
    clipped = np.maximum(distance, 1e-4)
    return np.asarray((np.maximum(reach - clipped, 0.0) / (reach * clipped)) ** 2)
