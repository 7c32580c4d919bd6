"""What stands in the way of actors: walls, posts, furniture of the static scene, in plan."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import semantic_classes
from urbantwin.traffic.box_plan import PlanBoxes

__all__ = ["Obstacles"]

#: Classes that nobody passes through; leaves give way.
_SOLID = ("building", "fence", "other-structure", "trunk", "pole", "traffic-sign", "other-object")
#: Curbs, steps and plinths up to the knee are stepped over or driven on, metres above the ground.
_KNEE_M = 0.45


class Obstacles:
    """The solid triangles of a scene, as their outlines in plan.

    Args:
        scene: the static world, site frame.
    """

    def __init__(self, scene: LabelledMesh) -> None:
        self._name = {semantic_classes()[name].id: name for name in _SOLID}
        solid = np.flatnonzero(np.isin(scene.semantic, list(self._name)))
        corners = scene.vertices[scene.faces[solid]]
        self._low, self._high = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
        self._semantic = scene.semantic[solid]
        # An upright triangle is a line in plan: along its longest side.
        ring = shapely.linestrings(corners[:, [0, 1, 2, 0], :2])
        flat = np.abs(_doubled_area(corners)) < 1e-6
        shape = np.empty(len(solid), object)
        shape[flat] = shapely.convex_hull(ring[flat])
        shape[~flat] = shapely.polygons(corners[~flat, :, :2])
        self.shapes: NDArray[np.object_] = shape
        self._tree = shapely.STRtree(shape)

    def beside(
        self, boxes: PlanBoxes, z: NDArray[np.float64], height: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """Return pairs (P, 2) of a box and a shape that meets it between knee and head.

        Args:
            boxes: N in plan.
            z: (N,) of the ground that they stand on.
            height: (N,) metres.
        """
        row, shape = self._tree.query(boxes.polygons, predicate="intersects")
        level = (self._high[shape] > z[row] + _KNEE_M) & (self._low[shape] < z[row] + height[row])
        return np.column_stack([row[level], shape[level]])

    def met(
        self, boxes: PlanBoxes, z: NDArray[np.float64], height: NDArray[np.float64]
    ) -> list[str]:
        """Return what each box meets, the name of its class; nothing: an empty text."""
        found = [""] * len(z)
        for row, shape in self.beside(boxes, z, height).tolist():
            found[row] = self._name[int(self._semantic[shape])]
        return found


def _doubled_area(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the signed area in plan (F,) of triangles (F, 3, 3)."""
    one, other = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
