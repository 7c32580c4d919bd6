"""Where poles may stand: clear of everything that is driven on."""

from __future__ import annotations

from collections import defaultdict
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_difference, area_union
from urbantwin.roads.network import CARRIAGEWAY_KINDS, Lane, RoadNetwork
from urbantwin.roads.signals.approach import Frame

__all__ = ["CLEARANCE_M", "FreeGround"]

#: Distance of a pole's middle from the carriageway's edge (MUTCD 2009, 4D.16 and 2A.19: 0.6 m).
CLEARANCE_M = 0.6
DRIVEN = (*CARRIAGEWAY_KINDS, "connection", "crossing")


class FreeGround:
    """Tells free places by their distance from lanes, without joining these to one area."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        lanes: dict[int, list[Lane]] = defaultdict(list)
        for lane in network.lanes:
            if lane.kind in DRIVEN:
                lanes[lane.level].append(lane)
        self._lanes = {level: _Lanes(found) for level, found in lanes.items()}

    @cached_property
    def _cores(self) -> dict[int, tuple[shapely.STRtree, list[shapely.Geometry]]]:
        """Junctions less the corners where people wait, by level."""
        corners: dict[str, list[shapely.Geometry]] = defaultdict(list)
        for lane in self._network.lanes:
            if lane.kind == "walkingarea":
                corners[lane.junction].append(lane.polygon)
        found: dict[int, list[shapely.Geometry]] = defaultdict(list)
        for junction in self._network.junctions:
            if not junction.polygon.is_empty:
                core = area_difference(junction.polygon, area_union(corners[junction.id]))
                found[junction.level].append(core)
        return {level: (shapely.STRtree(areas), areas) for level, areas in found.items()}

    def free(self, xy: NDArray[np.float64], level: int) -> NDArray[np.bool_]:
        """Return which of points (N, 2) are free on a level."""
        points = shapely.points(xy)
        taken = np.zeros(len(xy), bool)
        if level in self._lanes:
            taken |= self._lanes[level].near(points)
        if level in self._cores:
            tree, _ = self._cores[level]
            hit, _ = tree.query(points, predicate="dwithin", distance=CLEARANCE_M - 0.05)
            taken[hit] = True
        return np.asarray(~taken)

    def nearest(
        self, frame: Frame, u: NDArray[np.float64], v: NDArray[np.float64], level: int
    ) -> NDArray[np.float64] | None:
        """Return the free u, v of a frame that is nearest to the first of some u and of some v.

        Args:
            frame: where u and v are measured.
            u: ahead, away from the first.
            v: to the left, away from the first.
            level: of the roads.
        """
        first = self.free(frame.place(u[0], v), level)
        if first[: max(1, len(v) // 4)].any():
            return np.array([u[0], v[np.argmax(first)]])
        grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        free = self.free(frame.place(grid[:, 0], grid[:, 1]), level)
        # A step along the street costs a little more than one away from it.
        cost = np.abs(grid[:, 1] - v[0]) + 1.01 * np.abs(grid[:, 0] - u[0])
        return np.asarray(grid[np.argmin(np.where(free, cost, np.inf))]) if free.any() else None


class _Lanes:
    """The middles of lanes with half their widths, to be asked for what lies near."""

    def __init__(self, lanes: list[Lane]) -> None:
        counts = [len(lane.centre) for lane in lanes]
        owner = np.repeat(np.arange(len(lanes)), counts)
        xy = np.concatenate([lane.centre[:, :2] for lane in lanes])
        self.lines = shapely.linestrings(xy, indices=owner)
        self.half = np.array([max(lane.width, *lane.widths, 0.0) / 2 for lane in lanes])
        self.reach = float(self.half.max()) + CLEARANCE_M
        self.tree = shapely.STRtree(self.lines)

    def near(self, points: NDArray[np.object_]) -> NDArray[np.bool_]:
        """Return which points lie on a lane or too near to one."""
        k, j = self.tree.query(points, predicate="dwithin", distance=self.reach)
        close = shapely.distance(points[k], self.lines[j]) < self.half[j] + CLEARANCE_M - 0.05
        taken = np.zeros(len(points), bool)
        taken[k[close]] = True
        return taken
