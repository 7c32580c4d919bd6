"""Assignment of points to the columns of their ring: a sensor fires once per column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar import Sensor
from urbantwin.lidar.pattern import beam_azimuths

__all__ = ["columns_apart", "fired_columns"]

#: Points nearer to each other are returns of one firing, columns.
_SAME = 0.05
#: Maximum displacement of a point, columns.
_MOST = 1.0


def fired_columns(
    ring: NDArray[np.integer],
    azimuth: NDArray[np.float64],
    columns: int,
    model: Sensor | None,
    turns_per_second: float = 0.0,
) -> NDArray[np.int64]:
    """Return the columns (N,) in which a sensor fired at points.

    Args:
        ring: (N,) channels of the points.
        azimuth: (N,) azimuths of the points in the sensor frame, rad.
        columns: columns per rotation.
        model: model with azimuth offsets and direction of rotation; None: clockwise without
            offsets.
        turns_per_second: rotation rate, which shifts channels that fire later; 0: no shift.
    """
    turned, clockwise = azimuth, True
    if model is not None:
        first = beam_azimuths(model, columns, turns_per_second=turns_per_second)[:, 0]
        turned, clockwise = turned - first[ring], model.spin == "cw"
    at = (-turned if clockwise else turned) * columns / (2 * np.pi)
    return columns_apart(ring, at, columns)


def columns_apart(
    ring: NDArray[np.integer], at: NDArray[np.float64], columns: int
) -> NDArray[np.int64]:
    """Return the columns (N,) of points, with as few points as possible sharing one on a ring.

    A motor does not rotate evenly, and column borders differ between rotations. Two neighbours half
    a column off their centres may then be nearest to the same column. In this case a few are moved
    one column up or down, in order. Returns of one firing stay together.

    Args:
        ring: (N,) ring of each point.
        at: (N,) fractional column of each point, from 0; it may exceed one rotation.
        columns: columns per rotation.
    """
    turned = np.mod(at, columns)
    order = np.lexsort((turned, ring))
    found = np.rint(turned).astype(np.int64)
    starts = np.flatnonzero(np.diff(ring[order], prepend=ring[order[:1]] - 1))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        place = turned[rows]
        # Begin at the ring's widest gap, so that no seam lies within a run of neighbours.
        gap = np.diff(place, append=place[0] + columns)
        first = (int(gap.argmax()) + 1) % len(rows)
        place = np.concatenate([place[first:], place[:first] + columns])
        fires = np.cumsum(np.diff(place, prepend=-np.inf) > _SAME) - 1
        firing = np.flatnonzero(np.diff(fires, prepend=-1))
        apart = _apart(place[firing])
        found[np.concatenate([rows[first:], rows[:first]])] = apart[fires]
    return np.asarray(found % columns)


def _apart(place: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the columns (F,) of firings, in order."""
    where, column = place.tolist(), np.rint(place).astype(np.int64).tolist()
    for k in np.flatnonzero(np.diff(column) == 0).tolist():
        ways = [way for step in (1, -1) if (way := _moved(where, column, k, step))]
        if column[k] == column[k + 1] and ways:
            for number, moved in min(ways, key=len):
                column[number] = moved
    return np.array(column, np.int64)


def _moved(
    where: list[float], column: list[int], k: int, step: int
) -> list[tuple[int, int]] | None:
    """Return the moves that separate firing ``k`` from the next; ``None`` if one is too large.

    Args:
        where: fractional columns of the firings.
        column: their columns so far.
        k: the first of two firings in one column.
        step: 1: later firings move up; -1: ``k`` and earlier ones move down.
    """
    number, last, moved = (k + 1 if step > 0 else k), column[k], []
    while 0 <= number < len(column) and (column[number] - last) * step <= 0:
        last += step
        if abs(last - where[number]) > _MOST:
            return None
        moved.append((number, last))
        number += step
    return moved
