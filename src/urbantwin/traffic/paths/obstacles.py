"""Static obstacles of actors in plan: walls, posts, furniture of the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import semantic_classes
from urbantwin.traffic.paths.box_plan import PlanBoxes

__all__ = ["Blocks", "Obstacles", "Outlines"]

#: Size of the cells that the search for near shapes begins with, metres.
_CELL_M = 1.0


class Outlines:
    """Shapes in plan, with cached distances to the nearest by cell.

    Args:
        shapes: S shapes, site frame.
    """

    def __init__(self, shapes: ArrayLike) -> None:
        self._tree = shapely.STRtree(shapes)
        self._cells, self._away = np.zeros(0, np.int64), np.zeros(0)

    def near(self, xy: NDArray[np.float64], reach: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the rows (R,) of points (N, 2) that may be nearer to a shape than ``reach`` (N,).

        Distances are computed by cell, so that neighbouring rows share the cost.
        """
        if not len(xy) or not len(self._tree):
            return np.zeros(0, np.int64)
        key = np.round(xy / _CELL_M).astype(np.int64) @ np.array([1 << 32, 1])
        cells, which = np.unique(key, return_inverse=True)
        return np.flatnonzero(self._away_from(cells)[which] - _CELL_M <= reach)

    def beside(
        self, boxes: PlanBoxes, within_m: float = 0.0
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows (P,) of boxes near shapes, and the indices of these shapes (P,).

        Args:
            boxes: N boxes.
            within_m: growth of the boxes on each side, metres.
        """
        rows_nearby = self.near(boxes.xy, np.hypot(*boxes.half.T) + within_m)
        wide = replace(boxes, half=boxes.half + within_m).take(rows_nearby)
        row, shape = self._tree.query(wide.polygons, predicate="intersects")
        return rows_nearby[row], shape

    def _away_from(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the distances from the centres of sorted cells (C,) to the nearest shape."""
        new = np.setdiff1d(cells, self._cells, assume_unique=True)
        if len(new):
            y = (new + (1 << 31)) % (1 << 32) - (1 << 31)
            middle = np.column_stack([(new - y) >> 32, y]) * _CELL_M
            (cell, _), distance_m = self._tree.query_nearest(
                shapely.points(middle), return_distance=True, all_matches=False
            )
            away = np.full(len(new), np.inf)
            away[cell] = distance_m
            insert_at = np.searchsorted(self._cells, new)
            self._cells = np.insert(self._cells, insert_at, new)
            self._away = np.insert(self._away, insert_at, away)
        return self._away[np.searchsorted(self._cells, cells)]


#: Classes that are solid for actors; leaves are not.
_SOLID_CLASSES = (
    "building",
    "fence",
    "other-structure",
    "trunk",
    "pole",
    "traffic-sign",
    "other-object",
)
#: Height above the ground up to which curbs, steps and plinths are no obstacles, metres.
_KNEE_HEIGHT_M = 0.45
#: Height of the lower end from which an obstacle is above people's heads, and above all vehicles (4
#: m: Council Directive 96/53/EC), metres.
HEAD_M, TALL_M = 2.0, 4.0
#: Size in plan below which an object is one obstacle, metres.
_SMALL_OBJECT_M = 1.5


@dataclass(frozen=True, eq=False)
class Blocks:
    """Obstacles at every step.

    Attributes:
        boxes: B boxes in plan.
        begins: (B,) height of the lower end above the ground, metres.
    """

    boxes: PlanBoxes
    begins: NDArray[np.float64]

    def with_cars(self, cars: PlanBoxes) -> Blocks:
        """Return these with further obstacles that begin at the ground."""
        return Blocks(
            PlanBoxes.joined([self.boxes, cars]),
            np.concatenate([self.begins, np.zeros(len(cars.yaw))]),
        )

    @cached_property
    def low(self) -> PlanBoxes:
        """Obstacles that pedestrians cannot walk under."""
        return self.boxes.take(np.flatnonzero(self.begins < HEAD_M))

    @cached_property
    def _outlines(self) -> Outlines:
        return Outlines(self.boxes.polygons)

    def beside(
        self, boxes: PlanBoxes, height: NDArray[np.float64], within_m: float
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return rows (P,) of boxes with heights (N,) near obstacles, and their indices (P,)."""
        row, block = self._outlines.beside(boxes, within_m)
        below = np.flatnonzero(self.begins[block] < height[row])
        return row[below], block[below]


class Obstacles:
    """The solid triangles of a scene, as outlines in plan.

    Args:
        scene: the static world, site frame.
    """

    def __init__(self, scene: LabelledMesh) -> None:
        self._name = {semantic_classes()[name].id: name for name in _SOLID_CLASSES}
        solid = np.flatnonzero(np.isin(scene.semantic, list(self._name)))
        corners = scene.vertices[scene.faces[solid]]
        self._low, self._high = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
        self._semantic, self._part = scene.semantic[solid], scene.part[solid]
        self._corners = corners
        # A vertical triangle is a line in plan: its longest side.
        ring = shapely.linestrings(corners[:, [0, 1, 2, 0], :2])
        flat = np.abs(_doubled_area(corners)) < 1e-6
        shape = np.empty(len(solid), object)
        shape[flat] = shapely.convex_hull(ring[flat])
        shape[~flat] = shapely.polygons(corners[~flat, :, :2])
        self.shapes: NDArray[np.object_] = shape
        self._outlines = Outlines(shape)

    def beside(
        self, boxes: PlanBoxes, z: NDArray[np.float64], height: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """Return pairs (P, 2) of a box and a shape that overlaps it between knee and head.

        Args:
            boxes: N boxes in plan.
            z: (N,) height of the ground below them, metres.
            height: (N,) metres.
        """
        row, shape = self._outlines.beside(boxes)
        level = (self._high[shape] > z[row] + _KNEE_HEIGHT_M) & (
            self._low[shape] < z[row] + height[row]
        )
        return np.column_stack([row[level], shape[level]])

    def met(
        self, boxes: PlanBoxes, z: NDArray[np.float64], height: NDArray[np.float64]
    ) -> list[str]:
        """Return the class of an obstacle that each box overlaps; an empty text if none."""
        names = [""] * len(z)
        for row, shape in self.beside(boxes, z, height).tolist():
            names[row] = self._name[int(self._semantic[shape])]
        return names

    def blocks(self, height: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Blocks:
        """Return the obstacles above knee height, as boxes in plan.

        Small objects (a post, a bench) are one box; of walls each triangle is one.

        Args:
            height: returns the height (N,) of the ground under points (N, 2).
        """
        middle = self._corners.mean(axis=1)
        ground = height(middle[:, :2])
        rows = np.flatnonzero(
            (self._high > ground + _KNEE_HEIGHT_M) & (self._low < ground + TALL_M)
        )
        begins = self._low[rows] - ground[rows]
        # Parts above heads are separate from what they hang from.
        key = np.column_stack([self._semantic[rows], self._part[rows], begins >= HEAD_M])
        _, group = np.unique(key, axis=0, return_inverse=True)
        plan = self._corners[rows, :, :2]
        order = np.argsort(group, kind="stable")
        starts = np.flatnonzero(np.diff(group[order], prepend=-1))
        parts = np.split(plan[order], starts[1:]) if len(rows) else []
        whole = _least_boxes(parts)
        small = np.asarray((whole.half < _SMALL_OBJECT_M / 2).all(axis=1), np.bool_)
        least_begins = np.full(len(parts), np.inf)
        np.minimum.at(least_begins, group, begins)
        own = plan[~small[group]]
        side = np.roll(own, -1, axis=1) - own
        longest = np.linalg.norm(side, axis=2).argmax(axis=1)
        along = side[np.arange(len(own)), longest]
        yaw = np.arctan2(along[:, 1], along[:, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        turned = np.stack(
            [
                own[..., 0] * c[:, None] + own[..., 1] * s[:, None],
                own[..., 1] * c[:, None] - own[..., 0] * s[:, None],
            ],
            axis=-1,
        )
        least, most = turned.min(axis=1), turned.max(axis=1)
        u, v = ((least + most) / 2).T
        xy = np.concatenate([whole.xy[small], np.column_stack([c * u - s * v, s * u + c * v])])
        half = np.concatenate([whole.half[small], (most - least) / 2])
        yaw = np.concatenate([whole.yaw[small], yaw])
        begins = np.concatenate([least_begins[small], begins[~small[group]]])
        keys = np.round(np.column_stack([xy, half, yaw % np.pi, begins >= HEAD_M]), 2)
        _, rows = np.unique(keys, axis=0, return_index=True)
        none = np.zeros(len(rows), np.int64)
        return Blocks(PlanBoxes(none, xy[rows], yaw[rows], half[rows]), begins[rows])


def _least_boxes(parts: Sequence[NDArray[np.float64]]) -> PlanBoxes:
    """Return the smallest box in plan around each part (F, 3, 2)."""
    boxes = np.zeros((len(parts), 5))
    for number, part in enumerate(parts):
        around = shapely.oriented_envelope(shapely.MultiPoint(part.reshape(-1, 2)))
        corners = shapely.get_coordinates(around)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        side, across = np.diff(np.resize(corners, (3, 2)), axis=0)  # a line gives two equal sides
        across = across if len(corners) > 2 else np.zeros(2)
        yaw = np.arctan2(side[1], side[0])
        boxes[number] = *middle, yaw, np.hypot(*side) / 2, np.hypot(*across) / 2
    none = np.zeros(len(parts), np.int64)
    return PlanBoxes(none, boxes[:, :2], boxes[:, 2], boxes[:, 3:])


def _doubled_area(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the signed area in plan (F,) of triangles (F, 3, 3)."""
    first, second = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
