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
_SMOOTHING_S, _MIN_MOTION_M = 0.7, 0.02
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
    changed_columns = {name: columns[name].copy() for name in ("xy", "yaw", "distance", "speed")}
    breaks = np.flatnonzero((np.diff(trip) != 0) | (np.diff(step) != 1)) + 1
    for rows in np.split(np.arange(len(trip)), breaks):
        if len(rows) < 2 or not walks[rows].any():
            continue
        xy = changed_columns["xy"][rows]
        detour = _around_obstacles(xy, cells)
        if detour is None:
            continue
        changed = walks[rows] & (detour != xy).any(axis=1)
        detour = np.where(walks[rows, None], detour, xy)
        wide = round(_SMOOTHING_S / step_s)
        is_near = uniform_filter1d(changed.astype(float), 2 * wide + 1, mode="nearest") > 0
        detour[is_near] = uniform_filter1d(detour, wide, axis=0, mode="nearest")[is_near]
        moved = np.diff(detour, axis=0, prepend=detour[:1])
        step_m = np.hypot(*moved.T)
        turns = np.flatnonzero(is_near & (step_m > _MIN_MOTION_M))
        last = np.searchsorted(turns, np.arange(len(rows)), side="right") - 1
        course = np.arctan2(moved[turns, 1], moved[turns, 0])
        turned = is_near & (last >= 0)
        changed_columns["yaw"][rows[turned]] = course[last[turned]]
        changed_columns["xy"][rows] = detour
        changed_columns["distance"][rows] = changed_columns["distance"][rows[0]] + np.cumsum(step_m)
        changed_columns["speed"][rows[is_near]] = step_m[is_near] / step_s
    return {**columns, **changed_columns}


def _around_obstacles(way: NDArray[np.float64], cells: WalkedCells) -> NDArray[np.float64] | None:
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
                way[start:stop] = _points_on_detour(arc, way[low : high + 1])[start - low :][
                    : stop - start
                ]
                k = n
                break
    return way


def _points_on_detour(arc: NDArray[np.float64], run: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points on a detour (K, 2) in proportion to progress on the replaced path (N, 2)."""
    progress_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(run, axis=0).T))])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(arc, axis=0).T))])
    station_m = progress_m / max(progress_m[-1], 1e-6) * along[-1]
    return np.column_stack([np.interp(station_m, along, arc[:, k]) for k in (0, 1)])
