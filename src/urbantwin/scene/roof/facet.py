"""Roof facets: pieces of a roof in plan, each with its plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import Polygon

__all__ = ["Facet", "Plane", "half_plane", "half_planes", "profiled"]

#: (a, b, c): the height of a plane at (x, y) is a x + b y + c.
Plane = tuple[float, float, float]
#: Facets smaller than this, square metres, are left to their neighbours.
SPECK_M2 = 1e-4


@dataclass(frozen=True)
class Facet:
    """A piece of a roof: its area in plan, and its plane."""

    area: Polygon
    plane: Plane

    def height(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return the plane's heights (N,) at points (N, 2)."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        a, b, c = self.plane
        return np.asarray(points[:, 0] * a + points[:, 1] * b + c)

    def placed(self, scale: float, offset: float) -> Facet:
        """Return the facet with its heights multiplied and lifted."""
        a, b, c = self.plane
        return Facet(self.area, (a * scale, b * scale, c * scale + offset))

    def top(self) -> float:
        """Return the maximum height of the facet."""
        return float(self.height(shapely.get_coordinates(self.area)).max())


def half_plane(a: float, b: float, c: float, reach: float, near: ArrayLike) -> Polygon:
    """Return ``half_planes`` of one line."""
    return half_planes(np.array([[a, b, c]]), reach, near)[0]


def half_planes(lines: NDArray[np.float64], reach: float, near: ArrayLike) -> NDArray[np.object_]:
    """Return squares (N,) of side 2 ``reach`` on the side of lines where a x + b y + c > 0.

    Args:
        lines: (N, 3) a, b, c; (a, b) of any length above 0.
        reach: metres; a square covers everything within ``reach`` of ``near`` on its side.
        near: a point (2,).
    """
    length = np.hypot(lines[:, 0], lines[:, 1])[:, None]
    normal = lines[:, :2] / length
    point = np.asarray(near, np.float64)
    away = normal @ point + lines[:, 2] / length[:, 0]
    foot = point - normal * away[:, None]
    along = np.column_stack([-normal[:, 1], normal[:, 0]]) * reach
    side = normal * (2 * reach + np.abs(away))[:, None]
    corners = [foot - along, foot - along + side, foot + along + side, foot + along]
    return np.asarray(shapely.polygons(np.stack(corners, axis=1)), dtype=object)


def profiled(facets: Sequence[Facet], profile: Sequence[tuple[float, float]]) -> list[Facet]:
    """Bend a roof of heights 0..1: cut it along levels and map the heights between them.

    Args:
        facets: a roof whose heights range from 0 to 1.
        profile: (height of the roof, mapped height), the first ascending from 0 to 1.
    """
    if len(profile) == 2:
        (_, low), (_, high) = profile
        return [facet.placed(high - low, low) for facet in facets]
    bent = []
    for facet in facets:
        a, b, c = facet.plane
        heights = facet.height(shapely.get_coordinates(facet.area))
        reach = 2 * float(facet.area.length)
        near = shapely.get_coordinates(facet.area.centroid)[0]
        for (low, new_low), (high, new_high) in pairwise(profile):
            if heights.max() < low + 1e-9 or heights.min() > high - 1e-9:
                continue
            piece = facet.area
            if heights.min() < low and low > 0:
                piece = shapely.intersection(piece, half_plane(a, b, c - low, reach, near))
            if heights.max() > high and high < 1:
                piece = shapely.intersection(piece, half_plane(-a, -b, high - c, reach, near))
            scale = (new_high - new_low) / (high - low)
            plane = (a * scale, b * scale, (c - low) * scale + new_low)
            bent += [
                Facet(part, plane)
                for part in shapely.get_parts(piece)
                if isinstance(part, Polygon) and part.area > SPECK_M2
            ]
    return bent
