"""Where poles may stand: clear of everything that is driven on."""

from __future__ import annotations

from collections import defaultdict
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_difference, area_union
from urbantwin.roads.network import CARRIAGEWAY_KINDS, Junction, Lane, RoadNetwork
from urbantwin.roads.signals.approach import Frame

__all__ = ["CLEARANCE_M", "FreeGround"]

#: Distance of a pole's middle from the carriageway's edge (MUTCD 2009, 4D.16 and 2A.19: 0.6 m).
CLEARANCE_M = 0.6
#: So many places are looked at first; twice as many each time that none of them is free.
FEW = 16
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
        junctions: dict[int, list[Junction]] = defaultdict(list)
        for junction in network.junctions:
            if not junction.polygon.is_empty:
                junctions[junction.level].append(junction)
        self._junctions = {
            level: (shapely.STRtree([junction.polygon for junction in found]), found)
            for level, found in junctions.items()
        }
        self._cores: dict[str, shapely.Geometry] = {}

    @cached_property
    def _corners(self) -> dict[str, list[shapely.Geometry]]:
        """Where people wait, by junction."""
        found: dict[str, list[shapely.Geometry]] = defaultdict(list)
        for lane in self._network.lanes:
            if lane.kind == "walkingarea":
                found[lane.junction].append(lane.polygon)
        return found

    def _core(self, junction: Junction) -> shapely.Geometry:
        """Return a junction less the corners where people wait."""
        if junction.id not in self._cores:
            corners = area_union(self._corners[junction.id])
            self._cores[junction.id] = area_difference(junction.polygon, corners)
            shapely.prepare(self._cores[junction.id])
        return self._cores[junction.id]

    def free(self, xy: NDArray[np.float64], level: int) -> NDArray[np.bool_]:
        """Return which of points (N, 2) are free on a level."""
        points = shapely.points(xy)
        taken = np.zeros(len(xy), bool)
        if level in self._lanes:
            taken |= self._lanes[level].near(points)
        if level in self._junctions:
            tree, junctions = self._junctions[level]
            k, j = tree.query(points, predicate="dwithin", distance=CLEARANCE_M - 0.05)
            for number in np.unique(j[~taken[k]]).tolist():
                near = k[j == number]
                core = self._core(junctions[number])
                taken[near] |= shapely.dwithin(core, points[near], CLEARANCE_M - 0.05)
        return np.asarray(~taken)

    def cheapest(
        self, xy: NDArray[np.float64], cost: NDArray[np.float64], level: int
    ) -> int | None:
        """Return which of points (N, 2) is the free one of least cost (N,), if any is free."""
        order = np.argsort(cost, kind="stable")
        for part in np.split(order, FEW * np.array([1, 3, 7, 15])):
            free = self.free(xy[part], level)
            if free.any():
                return int(part[np.argmax(free)])
        return None

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
        # A step along the street costs a little more than one away from it.
        cost = np.abs(grid[:, 1] - v[0]) + 1.01 * np.abs(grid[:, 0] - u[0])
        found = self.cheapest(frame.place(grid[:, 0], grid[:, 1]), cost, level)
        return None if found is None else np.asarray(grid[found])


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
