"""Detours: people walk round what stands in their way, where SUMO leads them straight through.

SUMO's walkers know lanes and walking areas, not the walls, posts and benches on them. Whoever's
way leads through something goes the shortest way round it, on the footway where that is not much
longer. It would have to run for it: `crowd` lets it come later.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from urbantwin.traffic.paths.walked_ground import SOLID, WalkedCells

__all__ = ["round_blocks"]

#: Corners of outlines are rounded over so long, seconds; who moves less in a step does not turn.
_ROUNDED_S, _MOVED_M = 0.7, 0.02
#: So many places where something stands are gone round at once at the most.
_AT_ONCE = 4


def round_blocks(
    columns: dict[str, NDArray[Any]],
    walks: NDArray[np.bool_],
    cells: WalkedCells,
    step_s: float,
) -> dict[str, NDArray[Any]]:
    """Return poses in which everybody on foot on the ground goes round what stands there.

    Args:
        columns: poses by trip and step: ``trip``, ``step``, ``xy``, ``yaw``, ``distance``,
            ``speed``.
        walks: (N,) who is on foot on the ground.
        cells: what stands in the way, and where they rather are.
        step_s: time between steps.
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
    """Return a way (N, 2) that leads round what stands there; ``None`` where it meets nothing."""
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
            # Where no way leads into a court, one leads past it.
            stop = runs[n - 1][1]
            low, high = max(start - 1, 0), min(stop, len(way) - 1)
            arc = cells.way(way[low], way[high])
            if arc is not None:
                way[start:stop] = _along(arc, way[low : high + 1])[start - low :][: stop - start]
                k = n
                break
    return way


def _along(arc: NDArray[np.float64], run: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places on a way round (K, 2) as one goes on along the way that it replaces (N, 2)."""
    went = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(run, axis=0).T))])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(arc, axis=0).T))])
    at = went / max(went[-1], 1e-6) * along[-1]
    return np.column_stack([np.interp(at, along, arc[:, k]) for k in (0, 1)])
