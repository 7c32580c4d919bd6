"""Clustering of the points of one frame in plan."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

__all__ = ["clusters"]

#: Size of cells in plan, metres, and maximum number of empty cells between points of one object, in
#: successive passes.
CELL_M = 0.2
GAPS = (2, 1, 0)
#: Least number of points of an object.
LEAST = 8
#: Longer objects of less height are two vehicles, one behind the other, metres.
LONG_M, LOW_M = 6.3, 2.3
#: Pedestrians: maximum diagonal, least and greatest height, metres.
PERSON_M, SHORT_M, TALL_M = 1.4, 1.1, 2.1
#: Maximum share of a group's points in a part that is no pedestrian, and least share in
#: pedestrians.
FEW, MOSTLY = 0.1, 0.7


def clusters(points: NDArray[np.float64], above: NDArray[np.float64]) -> Iterator[NDArray[np.intp]]:
    """Yield the rows (M,) of each object's points.

    Args:
        points: (N, 3) points of one frame, metres.
        above: (N,) heights above the ground, metres.
    """
    yield from _split(np.arange(len(points)), points, above, 0)


def _split(
    rows: NDArray[np.intp], points: NDArray[np.float64], above: NDArray[np.float64], depth: int
) -> Iterator[NDArray[np.intp]]:
    if len(rows) < LEAST:
        return
    cell = np.floor((points[rows, :2] - points[rows, :2].min(axis=0)) / CELL_M).astype(int)
    grid = np.zeros(cell.max(axis=0) + 1 + 2 * GAPS[0], bool)
    reach = GAPS[depth]
    # Cells belong to one object if at most `reach` empty cells are between them.
    for east in range(reach + 1):
        for north in range(reach + 1):
            grid[cell[:, 0] + east, cell[:, 1] + north] = True
    number, _ = label(grid, np.ones((3, 3)))
    component = number[cell[:, 0], cell[:, 1]]
    order = np.argsort(component, kind="stable")
    starts = np.flatnonzero(np.diff(component[order])) + 1
    for part in np.split(rows[order], starts):
        if len(part) < LEAST:
            continue
        if depth + 1 < len(GAPS) and (people := _people(part, points, above)):
            yield from people
            continue
        long = float(np.linalg.norm(np.ptp(points[part, :2], axis=0)))
        low = float(np.quantile(above[part], 0.98)) < LOW_M
        if long > LONG_M and low and depth + 1 < len(GAPS):
            yield from _split(part, points, above, depth + 1)
        else:
            yield part


def _people(
    rows: NDArray[np.intp], points: NDArray[np.float64], above: NDArray[np.float64]
) -> list[NDArray[np.intp]]:
    """Return the pedestrians of a group; empty if it is something else."""
    if np.linalg.norm(np.ptp(points[rows, :2], axis=0)) < PERSON_M:
        return []
    people = []
    for part in _split(rows, points, above, len(GAPS) - 1):
        wide = float(np.linalg.norm(np.ptp(points[part, :2], axis=0)))
        tall = float(np.quantile(above[part], 0.98))
        if wide < PERSON_M and SHORT_M < tall < TALL_M:
            people.append(part)
        elif len(part) > FEW * len(rows):
            return []
    return people if sum(map(len, people)) > MOSTLY * len(rows) else []
