"""Zebra crossings: stripes along the way of the traffic that they stop."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.network import Lane

__all__ = ["zebra"]

#: Stripes of a zebra crossing, metres: painted, and from one to the next.
STRIPE_M, PERIOD_M = 0.5, 1.0


def zebra(lane: Lane) -> list[NDArray[np.float64]]:
    """Return the stripes of a crossing, (4, 2) corners each, site frame, metres."""
    line = shapely.LineString(lane.centre[:, :2])
    if line.length < STRIPE_M:
        return []
    count = int((line.length + PERIOD_M - STRIPE_M) // PERIOD_M)
    margin = (line.length - (count - 1) * PERIOD_M - STRIPE_M) / 2
    stripes = []
    for number in range(count):
        at = margin + number * PERIOD_M
        a, b = (np.array(line.interpolate(d).coords[0]) for d in (at, at + STRIPE_M))
        across = np.array([a[1] - b[1], b[0] - a[0]])
        across *= lane.width / 2 / np.linalg.norm(across)
        stripes.append(np.array([a - across, b - across, b + across, a + across]))
    return stripes
