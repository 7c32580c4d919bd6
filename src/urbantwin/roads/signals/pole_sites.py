"""Free places for poles, clear of all carriageways."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import area_difference, area_union
from urbantwin.roads.network import CARRIAGEWAY_KINDS, Junction, Lane, RoadNetwork
from urbantwin.roads.signals.approach import Frame

__all__ = ["CLEARANCE_M", "FreeGround"]

#: Distance of a pole's centre from the carriageway (MUTCD 2009, 4D.16 and 2A.19: 0.6 m), metres.
CLEARANCE_M = 0.6
#: Number of places in the first batch; later batches double.
FEW = 16
DRIVEN = (*CARRIAGEWAY_KINDS, "connection", "crossing")


class FreeGround:
    """Search for free places by distance from lanes, without a union of all lanes."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        lanes: dict[int, list[Lane]] = defaultdict(list)
        for lane in network.lanes:
            if lane.kind in DRIVEN:
                lanes[lane.level].append(lane)
        self._lanes = {level: _near_lanes(level_lanes) for level, level_lanes in lanes.items()}
        junctions: dict[int, list[Junction]] = defaultdict(list)
        for junction in network.junctions:
            if not junction.polygon.is_empty:
                junctions[junction.level].append(junction)
        self._junctions = {
            level: (_Shapes([junction.polygon for junction in group], CLEARANCE_M - 0.05), group)
            for level, group in junctions.items()
        }
        self._cores: dict[str, shapely.Geometry] = {}

    @cached_property
    def _corners(self) -> dict[str, list[shapely.Geometry]]:
        """Walking areas by junction."""
        areas: dict[str, list[shapely.Geometry]] = defaultdict(list)
        for lane in self._network.lanes:
            if lane.kind == "walkingarea":
                areas[lane.junction].append(lane.polygon)
        return areas

    def _core(self, junction: Junction) -> shapely.Geometry:
        """Return the area of a junction without its walking areas."""
        if junction.id not in self._cores:
            corners = area_union(self._corners[junction.id])
            self._cores[junction.id] = area_difference(junction.polygon, corners)
            shapely.prepare(self._cores[junction.id])
        return self._cores[junction.id]

    def free(self, xy: NDArray[np.float64], level: int) -> NDArray[np.bool_]:
        """Return the mask of points (N, 2) that are free on a level."""
        points = shapely.points(xy)
        blocked = np.zeros(len(xy), bool)
        if level in self._lanes:
            blocked[self._lanes[level].pairs(points)[0]] = True
        if level in self._junctions:
            near_junctions, junctions = self._junctions[level]
            k, j = near_junctions.pairs(points)
            for number in np.unique(j[~blocked[k]]).tolist():
                rows = k[j == number]
                core = self._core(junctions[number])
                blocked[rows] |= shapely.dwithin(core, points[rows], CLEARANCE_M - 0.05)
        return np.asarray(~blocked)

    def cheapest(
        self, xy: NDArray[np.float64], cost: NDArray[np.float64], level: int
    ) -> int | None:
        """Return the index of the cheapest free point of (N, 2); ``None`` if none is free."""
        order = np.argsort(cost, kind="stable")
        for part in np.split(order, FEW * np.array([1, 3, 7, 15])):
            free = self.free(xy[part], level)
            if free.any():
                return int(part[np.argmax(free)])
        return None

    def nearest(
        self, frame: Frame, u: NDArray[np.float64], v: NDArray[np.float64], level: int
    ) -> NDArray[np.float64] | None:
        """Return the free u, v nearest to the first u and v; ``None`` if none is free.

        Args:
            frame: frame of u and v.
            u: candidates ahead, in order of increasing distance from the first.
            v: candidates to the left, in order of increasing distance from the first.
            level: level of the roads.
        """
        first = self.free(frame.place(u[0], v), level)
        if first[: max(1, len(v) // 4)].any():
            return np.array([u[0], v[np.argmax(first)]])
        grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        # Distance along the street costs slightly more than distance away from it.
        cost = np.abs(grid[:, 1] - v[0]) + 1.01 * np.abs(grid[:, 0] - u[0])
        index = self.cheapest(frame.place(grid[:, 0], grid[:, 1]), cost, level)
        return None if index is None else np.asarray(grid[index])


def _near_lanes(lanes: Sequence[Lane]) -> _Shapes:
    """Return the centre lines of lanes, with half their width and a pole's clearance as reach."""
    owner = np.repeat(np.arange(len(lanes)), [len(lane.centre) for lane in lanes])
    lines = shapely.linestrings(
        np.concatenate([lane.centre[:, :2] for lane in lanes]), indices=owner
    )
    half = np.array([max(lane.width, *lane.widths, 0.0) / 2 for lane in lanes])
    return _Shapes(lines, half + CLEARANCE_M - 0.05)


class _Shapes:
    """Shapes, each with a distance within which points are near it."""

    def __init__(self, shapes: Sequence[shapely.Geometry], reach: ArrayLike) -> None:
        self.shapes = np.asarray(shapes, object)
        self.reach = np.broadcast_to(np.asarray(reach, np.float64), len(shapes))
        low_x, low_y, high_x, high_y = shapely.bounds(shapes).T
        more = self.reach + 0.01
        boxes = shapely.box(low_x - more, low_y - more, high_x + more, high_y + more)
        self.tree = shapely.STRtree(boxes)
        shapely.prepare(self.shapes)

    def pairs(self, points: NDArray[np.object_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return pairs of indices of points and of shapes near them."""
        k, j = self.tree.query(points)
        close = shapely.dwithin(self.shapes[j], points[k], self.reach[j])
        return k[close], j[close]
