"""Which column of its ring each point is of: a sensor fires once in every column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar import Sensor
from urbantwin.lidar.pattern import beam_azimuths

__all__ = ["columns_apart", "fired_columns"]

#: Points nearer to each other than this, columns, are returns of one firing.
_SAME = 0.05
#: No point is put farther than this from where it is, columns.
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
        azimuth: (N,) of the points, sensor frame, rad.
        columns: in a turn.
        model: says where channels look and which way it turns; none: clockwise, all alike.
        turns_per_second: how far channels that fire later look on; 0: not at all.
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
    """Return the columns (N,) of points, of which as few as can be share one on their ring.

    A motor does not turn evenly, and where a turn begins is not where the columns of another do:
    of neighbours half a column apart from their middles two may be nearest to the same, and none to
    the next. Then a few are put one column on, or back, in their order. Returns of one firing stay
    together.

    Args:
        ring: (N,) of each point.
        at: (N,) where it is on it, columns from 0, not whole; round the turn where needed.
        columns: in a turn.
    """
    turned = np.mod(at, columns)
    order = np.lexsort((turned, ring))
    found = np.rint(turned).astype(np.int64)
    starts = np.flatnonzero(np.diff(ring[order], prepend=ring[order[:1]] - 1))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        place = turned[rows]
        # Begin where the ring has its widest gap: there is no seam within a run of neighbours.
        gap = np.diff(place, append=place[0] + columns)
        first = (int(gap.argmax()) + 1) % len(rows)
        place = np.concatenate([place[first:], place[:first] + columns])
        fires = np.cumsum(np.diff(place, prepend=-np.inf) > _SAME) - 1
        firing = np.flatnonzero(np.diff(fires, prepend=-1))
        apart = _apart(place[firing])
        found[np.concatenate([rows[first:], rows[:first]])] = apart[fires]
    return np.asarray(found % columns)


def _apart(place: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the columns (F,) of firings in their order."""
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
    """Return who is put where for ``k`` and the next to be apart; ``None`` where it is too far.

    Args:
        where: firings are, columns.
        column: that they have so far.
        k: the first of two in one column.
        step: 1: those after it go on; -1: it and those before go back.
    """
    number, last, moved = (k + 1 if step > 0 else k), column[k], []
    while 0 <= number < len(column) and (column[number] - last) * step <= 0:
        last += step
        if abs(last - where[number]) > _MOST:
            return None
        moved.append((number, last))
        number += step
    return moved
