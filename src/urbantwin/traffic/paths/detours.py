"""Detours of pedestrians around obstacles on SUMO's paths.

SUMO's pedestrians know lanes and walking areas, but not the walls, posts and benches on them. A
path through an obstacle is replaced by the shortest one around it, on the footway if that is not
much longer. The higher speed that this needs becomes a delay in `crowd`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from urbantwin.traffic.paths.walked_ground import SOLID, WalkedCells

__all__ = ["round_blocks"]

#: Duration over which corners of outlines are rounded, seconds; displacement per step below which
#: the heading stays, metres.
_ROUNDED_S, _MOVED_M = 0.7, 0.02
#: Maximum number of consecutive obstacles avoided by one detour.
_AT_ONCE = 4


def round_blocks(
    columns: dict[str, NDArray[Any]],
    walks: NDArray[np.bool_],
    cells: WalkedCells,
    step_s: float,
) -> dict[str, NDArray[Any]]:
    """Return poses in which pedestrians on the ground walk around obstacles.

    Args:
        columns: poses by trip and step: ``trip``, ``step``, ``xy``, ``yaw``, ``distance``,
            ``speed``.
        walks: (N,) mask of the rows of pedestrians on the ground.
        cells: raster of obstacles and footways.
        step_s: time between steps, seconds.
    """
    trip, step = columns["trip"], columns["step"]
    found = {name: columns[name].copy() for name in ("xy", "yaw", "distance", "speed")}
    breaks = np.flatnonzero((np.diff(trip) != 0) | (np.diff(step) != 1)) + 1
    for rows in np.split(np.arange(len(trip)), breaks):
        if len(rows) < 2 or not walks[rows].any():
            continue
        xy = found["xy"][rows]
        way = _round(xy, cells)
        if way is None:
            continue
        changed = walks[rows] & (way != xy).any(axis=1)
        way = np.where(walks[rows, None], way, xy)
        wide = round(_ROUNDED_S / step_s)
        near = uniform_filter1d(changed.astype(float), 2 * wide + 1, mode="nearest") > 0
        way[near] = uniform_filter1d(way, wide, axis=0, mode="nearest")[near]
        moved = np.diff(way, axis=0, prepend=way[:1])
        went = np.hypot(*moved.T)
        turns = np.flatnonzero(near & (went > _MOVED_M))
        last = np.searchsorted(turns, np.arange(len(rows)), side="right") - 1
        course = np.arctan2(moved[turns, 1], moved[turns, 0])
        turned = near & (last >= 0)
        found["yaw"][rows[turned]] = course[last[turned]]
        found["xy"][rows] = way
        found["distance"][rows] = found["distance"][rows[0]] + np.cumsum(went)
        found["speed"][rows[near]] = went[near] / step_s
    return {**columns, **found}


def _round(way: NDArray[np.float64], cells: WalkedCells) -> NDArray[np.float64] | None:
    """Return a path (N, 2) around obstacles; ``None`` if it has none."""
    inside = cells.at(way) == SOLID
    if not inside.any():
        return None
    way = way.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
    runs = edges.reshape(-1, 2).tolist()
    k = 0
    while k < len(runs):
        start, k = runs[k][0], k + 1
        for n in range(k, min(k + _AT_ONCE, len(runs) + 1)):
            # If no path leads into a courtyard, one may lead past it.
            stop = runs[n - 1][1]
            low, high = max(start - 1, 0), min(stop, len(way) - 1)
            arc = cells.way(way[low], way[high])
            if arc is not None:
                way[start:stop] = _along(arc, way[low : high + 1])[start - low :][: stop - start]
                k = n
                break
    return way


def _along(arc: NDArray[np.float64], run: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points on a detour (K, 2) in proportion to progress on the replaced path (N, 2)."""
    went = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(run, axis=0).T))])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(arc, axis=0).T))])
    at = went / max(went[-1], 1e-6) * along[-1]
    return np.column_stack([np.interp(at, along, arc[:, k]) for k in (0, 1)])
