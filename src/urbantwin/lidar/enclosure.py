"""Whether a point is inside something solid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import semantic_id

__all__ = ["enclosing"]


def enclosing(point: NDArray[np.float64], mesh: LabelledMesh) -> str | None:
    """Return what encloses a point, in words, or ``None``: it is in the open."""
    if _is_enclosed(point, mesh.select(mesh.semantic == semantic_id("building"))):
        return "a building"
    return None


def _is_enclosed(point: NDArray[np.float64], buildings: LabelledMesh) -> bool:
    """Return whether any building encloses a point.

    By the winding number of each building around the point: the solid angles of its triangles
    (Van Oosterom and Strackee 1983, IEEE Trans. Biomed. Eng. 30(2), eq. 8) add up to 4 pi inside
    and 0 outside. A building without a floor covers more than 2 pi of every point inside, and
    less than 2 pi of every point outside, so half a turn is the exact border for it too.
    """
    a, b, c = np.moveaxis(buildings.triangles() - point, 1, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=1)
    scale = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    solid_angle = 2 * np.arctan2(volume, scale)
    _, building = np.unique(buildings.part, return_inverse=True)
    total = np.bincount(building, solid_angle)
    return bool((np.abs(total) > 2 * np.pi).any())
