"""Footprints of objects in plan: buildings, plants."""

from __future__ import annotations

import numpy as np
import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import semantic_id

__all__ = ["footprints"]

#: Minimum z component of the normal of faces that cover the ground.
UP = 0.05
#: Corners closer than this to a line between others are left out, metres.
SIMPLER_M = 0.1
#: An object that fills this share of its hull is drawn as its hull.
ROUND = 0.55


def footprints(mesh: LabelledMesh, kind: str, *, hull: bool = False) -> dict[int, shapely.Geometry]:
    """Return the area in plan of every object of a semantic class by its ``part``.

    Args:
        mesh: the static scene, site frame, metres.
        kind: a semantic class.
        hull: whether the hull may be used for round objects, such as the crowns of trees: it is a
            hundred times faster.
    """
    of_kind = mesh.select(mesh.semantic == semantic_id(kind))
    up = of_kind.select(of_kind.normals()[:, 2] > UP)
    order = np.argsort(up.part, kind="stable")
    parts, starts = np.unique(up.part[order], return_index=True)
    corners = up.triangles()[order][:, :, :2]
    found = {}
    for part, group in zip(parts, np.split(corners, starts[1:]), strict=True) if len(parts) else ():
        if hull:
            around = shapely.convex_hull(shapely.MultiPoint(group.reshape(-1, 2)))
            a, b = group[:, 1] - group[:, 0], group[:, 2] - group[:, 0]
            covered = float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2)
            if covered > ROUND * around.area:
                found[int(part)] = around
                continue
        # A tenth of a millimetre closes the seams that rounding leaves between triangles.
        closed = shapely.buffer(shapely.polygons(group), 1e-4, join_style="mitre")
        found[int(part)] = shapely.simplify(shapely.union_all(closed), SIMPLER_M)
    return found
