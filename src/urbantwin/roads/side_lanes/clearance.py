"""Clearance beside roads: where a road can be widened."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.model import LaneModel, ModelRoad
from urbantwin.roads.model.curve import aside

__all__ = ["Clearance", "cells_between", "footprint"]

#: Spacing of the cross sections that are looked at, metres.
STEP_M = 2.0
#: Smaller overlaps are tolerated, square metres per metre of road.
GRAZE_M = 0.1


class Clearance:
    """What stands on the ground: roads, junctions and obstacles such as buildings."""

    def __init__(self, model: LaneModel, obstacles: Sequence[shapely.Polygon] = ()) -> None:
        """Take in all roads of a model.

        Args:
            model: the lane model.
            obstacles: areas that no road may grow into, site frame; those that roads overlap
                already are left out where they do.
        """
        shapes: list[shapely.Geometry] = []
        self._owner: list[int] = []
        self._level: list[int | None] = []
        self.footprints = {r.id: footprint(r) for r in model.roads if r.junction < 0}
        for road in model.roads:
            if road.junction < 0:
                shapes.append(self.footprints[road.id])
                self._owner.append(road.id)
                self._level.append(road.level)
        for junction in model.junctions:
            if len(junction.outline) > 2:
                shapes.append(shapely.make_valid(shapely.Polygon(junction.outline)))
                self._owner.append(-1)
                self._level.append(junction.level)
        shapes += obstacles
        self._owner += [-1] * len(obstacles)
        self._level += [0] * len(obstacles)
        self._shapes = shapes
        self._tree = shapely.STRtree(shapes)
        self._grown: list[tuple[int, int, shapely.Geometry]] = []

    def free(
        self, road: ModelRoad, side: int, first: float, last: float, width: float
    ) -> list[tuple[float, float]]:
        """Return where a road can grow on one side, as stations from and to.

        Args:
            road: the road.
            side: 1 to the left, -1 to the right.
            first: where to begin.
            last: where to end.
            width: how much wider it is to become, metres.
        """
        s = np.linspace(first, last, max(2, int((last - first) / STEP_M) + 2))
        edge = outer_border(road, side, s)
        cells = cells_between(road, s, edge, edge + side * width)
        blocked = np.zeros(len(cells), bool)
        cell, other = self._tree.query(cells, predicate="intersects")
        for k, j in zip(cell.tolist(), other.tolist(), strict=True):
            if self._owner[j] != road.id and self._level[j] == road.level:
                blocked[k] |= _overlaps(cells[k], self._shapes[j])
        for owner, level, shape in self._grown:
            if owner != road.id and level == road.level:
                for k in np.flatnonzero(shapely.intersects(cells, shape) & ~blocked):
                    blocked[k] |= _overlaps(cells[k], shape)
        runs = []
        start: float | None = None
        for k in range(len(cells)):
            if not blocked[k] and start is None:
                start = float(s[k])
            if blocked[k] and start is not None:
                runs.append((start, float(s[k])))
                start = None
        if start is not None:
            runs.append((start, last))
        return runs

    def grow(self, road: ModelRoad, side: int, first: float, last: float, width: float) -> None:
        """Keep free what a road grows into."""
        s = np.linspace(first, last, max(2, int((last - first) / STEP_M) + 2))
        edge = outer_border(road, side, s)
        band = cells_between(road, s, edge, edge + side * width)
        self._grown.append((road.id, road.level, shapely.union_all(band)))


def outer_border(road: ModelRoad, side: int, s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the offset t (N,) of a road's border on one side at stations (N,)."""
    t = np.asarray(road.offset.at(s), np.float64)
    starts = np.array([section.s for section in road.sections])
    which = np.maximum(np.searchsorted(starts, s + 1e-9, side="right") - 1, 0)
    for k, section in enumerate(road.sections):
        lanes = [lane for lane in section.lanes if lane.id * side > 0]
        here = which == k
        if lanes and here.any():
            outermost = max(lanes, key=lambda lane: abs(lane.id))
            t[here] = road.border(section, outermost, s[here], outer=True)
    return t


def footprint(road: ModelRoad) -> shapely.Geometry:
    """Return the area of all lanes of a road in plan."""
    s = np.linspace(0.0, road.length, max(2, int(road.length / STEP_M) + 2))
    pose = road.curve.at(s)
    left, right = (aside(pose, outer_border(road, side, s)) for side in (1, -1))
    return shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]])))


def cells_between(
    road: ModelRoad, s: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]
) -> NDArray[np.object_]:
    """Return the cells in plan (N - 1,) between two borders (N,) at stations (N,)."""
    pose = road.curve.at(s)
    inner, outer = aside(pose, a), aside(pose, b)
    rings = np.stack([inner[:-1], inner[1:], outer[1:], outer[:-1], inner[:-1]], axis=1)
    return np.asarray(shapely.make_valid(shapely.polygons(rings)))


def _overlaps(cell: shapely.Geometry, shape: shapely.Geometry) -> bool:
    return bool(shapely.intersection(cell, shape).area > GRAZE_M * STEP_M)
