"""Ridged roofs: one profile carried along a direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from urbantwin.scene.roof.facet import SPECK_M2, Facet, Plane, half_plane

__all__ = ["Axes", "axes_of", "half_hipped", "ridged"]

#: A profile: (place across the roof 0..1, height 0..1).
Profile = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Axes:
    """How a roof lies on its footprint.

    Attributes:
        down: unit vector (2,) across the ridge, the way the (main) slope faces.
        low, high: the footprint's extent along ``down``, metres.
        start, end: its extent along the ridge (``down`` turned left), metres.
    """

    down: NDArray[np.float64]
    low: float
    high: float
    start: float
    end: float

    @property
    def along(self) -> NDArray[np.float64]:
        """The ridge's unit vector."""
        return np.array([-self.down[1], self.down[0]])

    @property
    def span(self) -> float:
        """The width across the ridge, metres."""
        return self.high - self.low


def axes_of(footprint: Polygon, yaw: float) -> Axes:
    """Return the axes of a roof whose slope faces ``yaw``, rad counter-clockwise from east."""
    xy = shapely.get_coordinates(footprint)
    # Whole multiples of a right angle are met exactly, so that rectangles stay rectangles.
    down = np.array([round(math.cos(yaw), 12), round(math.sin(yaw), 12)])
    across, along = xy @ down, xy @ np.array([-down[1], down[0]])
    return Axes(
        down, float(across.min()), float(across.max()), float(along.min()), float(along.max())
    )


def ridged(footprint: Polygon, axes: Axes, profile: Profile) -> list[Facet]:
    """Return a profile's facets, heights 0..1; it runs from the back to where the slope faces."""
    facets = []
    reach = 2 * float(footprint.length)
    near = shapely.get_coordinates(footprint.centroid)[0]
    x, y = axes.down.tolist()
    for (left, low), (right, high) in pairwise(profile):
        begin, end = axes.low + left * axes.span, axes.low + right * axes.span
        area = footprint
        if left > 0:
            area = shapely.intersection(area, half_plane(x, y, -begin, reach, near))
        if right < 1:
            area = shapely.intersection(area, half_plane(-x, -y, end, reach, near))
        slope = (high - low) / (end - begin)
        facets += _pieces(area, (slope * x, slope * y, low - slope * begin))
    return facets


def half_hipped(footprint: Polygon, axes: Axes, from_height: float) -> list[Facet]:
    """Return a gabled roof whose ends are hipped above a height (0..1), at the same pitch."""
    gabled = ridged(footprint, axes, ((0.0, 0.0), (0.5, 1.0), (1.0, 0.0)))
    # Steeper where the ridge is so short that the hips would meet below it.
    slope = max(2 / axes.span, 2 * (1 - from_height) / (axes.end - axes.start))
    x, y = (axes.along * slope).tolist()
    hips: list[Plane] = [
        (x, y, from_height - slope * axes.start),
        (-x, -y, from_height + slope * axes.end),
    ]
    reach = 2 * float(footprint.length)
    near = shapely.get_coordinates(footprint.centroid)[0]
    facets = []
    planes = [facet.plane for facet in gabled] + hips
    areas = [facet.area for facet in gabled] + [footprint, footprint]
    for k, (plane, area) in enumerate(zip(planes, areas, strict=True)):
        left = area
        for n, other in enumerate(planes):
            a, b, c = np.subtract(other, plane).tolist()
            same = k < len(gabled) and n < len(gabled)
            if n == k or same or np.hypot(a, b) < 1e-12:
                continue
            left = shapely.intersection(left, half_plane(a, b, c, reach, near))
        facets += _pieces(left, plane)
    return facets


def _pieces(area: shapely.Geometry, plane: Plane) -> list[Facet]:
    return [
        Facet(part, plane)
        for part in shapely.get_parts(area)
        if isinstance(part, Polygon) and part.area > SPECK_M2
    ]
