"""Radial roofs, which rise from the whole outline to one apex."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from urbantwin.scene.roof.facet import Facet

__all__ = ["apex_of", "radial"]

#: An apex nearer to the line of an edge than this would make a wall of the roof there, metres.
_LEAST_RUN_M = 0.3


def apex_of(footprint: Polygon) -> NDArray[np.float64] | None:
    """Return a point (2,) well within the lines of all edges, the centroid if it is."""
    if footprint.interiors:
        return None
    for point in (footprint.centroid, footprint.envelope.centroid):
        apex: NDArray[np.float64] = shapely.get_coordinates(point)[0]
        if _well_within(footprint, apex):
            return apex
    return None


def radial(
    footprint: Polygon, apex: NDArray[np.float64], profile: Sequence[tuple[float, float]]
) -> list[Facet]:
    """Return the facets from every edge up to the apex, heights 0..1.

    Args:
        footprint: its outline sees the apex.
        apex: (2,).
        profile: (share of the way from the outline to the apex, height).
    """
    xy = _ring(footprint)
    following = np.roll(xy, -1, axis=0)
    edge = following - xy
    inward = np.column_stack([-edge[:, 1], edge[:, 0]])
    slope = inward / ((apex - xy) * inward).sum(axis=1, keepdims=True)
    offset = -(slope * xy).sum(axis=1)
    facets = []
    for (way, low), (next_way, high) in pairwise(profile):
        near, far = (points + (apex - points) * way for points in (xy, following))
        inner = [points + (apex - points) * next_way for points in (xy, following)]
        scale = (high - low) / (next_way - way)
        for k in range(len(xy)):
            ring = [near[k], far[k], inner[1][k], inner[0][k]]
            plane = (
                float(slope[k, 0] * scale),
                float(slope[k, 1] * scale),
                float((offset[k] - way) * scale + low),
            )
            facets.append(Facet(Polygon(ring if next_way < 1 else ring[:3]), plane))
    return facets


def _ring(footprint: Polygon) -> NDArray[np.float64]:
    oriented = shapely.orient_polygons(footprint)
    return np.asarray(shapely.get_coordinates(oriented.exterior)[:-1])


def _well_within(footprint: Polygon, apex: NDArray[np.float64]) -> bool:
    a = _ring(footprint) - apex
    b = np.roll(a, -1, axis=0)
    twice_areas = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return bool((twice_areas > _LEAST_RUN_M * np.linalg.norm(b - a, axis=1)).all())
