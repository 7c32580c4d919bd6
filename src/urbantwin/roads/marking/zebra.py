"""Zebra crossings: stripes parallel to the traffic that they stop."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.marking.lines import placed
from urbantwin.roads.model import LaneModel, RoadArea
from urbantwin.roads.network import Lane

__all__ = ["zebra", "zebra_of_area"]

#: Stripes of a zebra crossing, metres: painted, and from one to the next.
STRIPE_M, PERIOD_M = 0.5, 1.0


def zebra(lane: Lane) -> list[NDArray[np.float64]]:
    """Return the stripes of a crossing, (4, 2) corners each, site frame, metres."""
    return _stripes(shapely.LineString(lane.centre[:, :2]), lane.width)


def zebra_of_area(model: LaneModel, area: RoadArea) -> list[NDArray[np.float64]]:
    """Return the stripes of a mapped crosswalk that joins no sidewalks, as ``zebra`` does.

    People walk along the longer side of the rectangle around it.
    """
    corners = shapely.MultiPoint(placed(model, area.road, area.s, area.corners))
    around = shapely.minimum_rotated_rectangle(corners)
    if not isinstance(around, shapely.Polygon):
        return []
    ring = shapely.get_coordinates(around)[:4]
    sides = np.linalg.norm(ring - np.roll(ring, -1, axis=0), axis=1)
    k = int(np.argmin(sides[:2]))
    ends = [(ring[k] + ring[k + 1]) / 2, (ring[k + 2] + ring[(k + 3) % 4]) / 2]
    return _stripes(shapely.LineString(ends), float(sides[k]))


def _stripes(line: shapely.LineString, width: float) -> list[NDArray[np.float64]]:
    if line.length < STRIPE_M:
        return []
    count = int((line.length + PERIOD_M - STRIPE_M) // PERIOD_M)
    margin = (line.length - (count - 1) * PERIOD_M - STRIPE_M) / 2
    stripes = []
    for number in range(count):
        at = margin + number * PERIOD_M
        a, b = (np.array(line.interpolate(d).coords[0]) for d in (at, at + STRIPE_M))
        across = np.array([a[1] - b[1], b[0] - a[0]])
        across *= width / 2 / np.linalg.norm(across)
        stripes.append(np.array([a - across, b - across, b + across, a + across]))
    return stripes
