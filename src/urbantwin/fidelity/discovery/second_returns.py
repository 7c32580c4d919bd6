"""Whether a sensor reports two returns of one firing: two points at one azimuth of a ring."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.discovery.point_rays import PointRays

__all__ = ["reports_two"]

#: Two points are of one firing if they are nearer to each other than this, columns; a sensor tells
#: echoes apart that are farther from each other than this, metres (half a pulse of 5 ns).
_SAME, _APART_M = 0.03, 0.75
#: Gaps between these, columns, are those of points that were put on a wrong ring.
_CHANCE = (0.1, 0.9)
#: So large a share of a sensor's points has a second one, and so many times that of chance. On
#: frames of five real sensors three have 0.9 to 5 % and 60 times or more, two 0.4 % and 7 at most.
_LEAST, _TIMES = 0.005, 20.0


def reports_two(
    frames: Sequence[NDArray[np.float64]],
    rays: Sequence[PointRays],
    sensor: int,
    place: NDArray[np.float64],
    step_rad: float,
) -> bool:
    """Return whether firings of a sensor have two returns.

    Args:
        frames: (N, 3) points of each.
        rays: of the same.
        sensor: its number in them.
        place: (3,) where it is.
        step_rad: from column to column.
    """
    points, twice, chance = 0, 0, 0
    for frame, one in zip(frames, rays, strict=True):
        rows = np.flatnonzero(one.sensor == sensor)
        rows = rows[np.lexsort((one.azimuth[rows], one.ring[rows]))]
        range_m = np.linalg.norm(frame[rows] - place, axis=1)
        gap = np.diff(one.azimuth[rows]) / step_rad
        echoes = (np.diff(one.ring[rows]) == 0) & (np.abs(np.diff(range_m)) > _APART_M)
        points += len(rows)
        twice += int((echoes & (gap < _SAME)).sum())
        chance += int((echoes & (gap > _CHANCE[0]) & (gap < _CHANCE[1])).sum())
    by_chance = chance * _SAME / (_CHANCE[1] - _CHANCE[0])
    return twice > max(_LEAST * points, _TIMES * by_chance)
