"""Which pieces of a mesh touch each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial import cKDTree

from urbantwin.reconstruct.cleaning.connected import Pieces
from urbantwin.reconstruct.cleaning.grid import Grid
from urbantwin.reconstruct.model import TriangleMesh

__all__ = ["contacts"]

#: Most steps along a triangle's longest side.
_MOST_STEPS = 128
#: Nearest points looked at: at the reach apart, a sheet has five within reach.
_NEIGHBOURS = 16
#: Points worked on at once.
_AT_ONCE = 200_000

_Range = tuple[Grid, NDArray[np.float64], NDArray[np.float64]]


def contacts(
    mesh: TriangleMesh, pieces: Pieces, some: NDArray[np.bool_], reach: float
) -> NDArray[np.int64]:
    """Return pairs (P, 2) of pieces that come within about ``reach``, one of them of ``some``.

    Triangles are sampled at the reach; points of different pieces are compared.

    Args:
        mesh: welded, site frame, metres.
        pieces: of the mesh, K of them.
        some: (K,) bool.
        reach: metres.
    """
    none = np.zeros((0, 2), np.int64)
    mine = np.flatnonzero(some[pieces.of_face])
    if not len(mine):
        return none
    corners = mesh.vertices[mesh.faces]
    points, owner = _sampled(corners[mine], pieces.of_face[mine], reach)
    tree = cKDTree(points)
    span = max(float(np.ptp(points[:, :2], axis=0).max()), 1.0)
    grid = Grid.over(
        (*(points[:, :2].min(axis=0) - 1.0), *(points[:, :2].max(axis=0) + 1.0)),
        max(0.5, span / 1000),
    )
    low = minimum_filter(np.nan_to_num(grid.lowest(points), nan=np.inf), 3) - reach
    high = maximum_filter(np.nan_to_num(grid.highest(points), nan=-np.inf), 3) + reach
    other = _beside((grid, low, high), corners, ~some[pieces.of_face])
    around, others = _sampled(corners[other], pieces.of_face[other], reach, (grid, low, high))
    pairs = [none]
    for places, owners in ((points, owner), (around, others)):
        for part in np.array_split(np.arange(len(places)), max(1, len(places) // _AT_ONCE)):
            if not len(part):
                continue
            count = min(_NEIGHBOURS, len(points))
            distance, index = tree.query(
                places[part], k=count, distance_upper_bound=1.2 * reach, workers=-1
            )
            index = index.reshape(len(part), count)
            hit = np.isfinite(distance.reshape(len(part), count))
            row, column = np.nonzero(hit)
            first, second = owner[index[row, column]], owners[part][row]
            apart = first != second
            found = np.column_stack([first[apart], second[apart]])
            pairs.append(np.unique(found, axis=0).astype(np.int64))
    return np.unique(np.concatenate(pairs), axis=0)


def _beside(
    where: _Range, corners: NDArray[np.float64], able: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return which triangles (F, 3, 3) have bounds that meet the occupied cells of a grid."""
    grid, low, high = where
    face_low, face_high = corners.min(axis=1), corners.max(axis=1)
    sums = np.zeros((grid.rows + 1, grid.columns + 1), np.int64)
    sums[1:, 1:] = (high > low).cumsum(axis=0).cumsum(axis=1)
    east, north = grid.west + grid.columns * grid.step, grid.south + grid.rows * grid.step
    able = able & (face_high[:, 0] >= grid.west) & (face_low[:, 0] <= east)
    able &= (face_high[:, 1] >= grid.south) & (face_low[:, 1] <= north)
    able &= (face_high[:, 2] >= low.min()) & (face_low[:, 2] <= high.max())
    numbers = np.flatnonzero(able)
    r0, c0 = grid.cells(face_low[numbers, :2])
    r1, c1 = grid.cells(face_high[numbers, :2])
    total = sums[r1 + 1, c1 + 1] - sums[r0, c1 + 1] - sums[r1 + 1, c0] + sums[r0, c0]
    return np.asarray(numbers[total > 0])


def _sampled(
    corners: NDArray[np.float64],
    owner: NDArray[np.int32],
    spacing: float,
    where: _Range | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return points (N, 3) on triangles, about ``spacing`` apart, and whose they are (N,)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    sides = (a - b, b - c, c - a)
    longest = np.sqrt(np.maximum.reduce([(side**2).sum(axis=1) for side in sides]))
    steps = np.clip(longest / spacing, 1, _MOST_STEPS)
    # In powers of two, so that all triangles of one kind are worked on at once.
    level = 2 ** np.ceil(np.log2(steps)).astype(np.int64)
    points, owners = [np.zeros((0, 3))], [np.zeros(0, np.int32)]
    for n in np.unique(level):
        i, j = (k.ravel() for k in np.indices((n + 1, n + 1)))
        inside = i + j <= n
        u, v = (i[inside] / n)[None, :, None], (j[inside] / n)[None, :, None]
        members = np.flatnonzero(level == n)
        parts = max(1, len(members) * u.size // (4 * _AT_ONCE))
        for part in np.array_split(members, parts):
            place = a[part][:, None] - u * sides[0][part][:, None] + v * sides[2][part][:, None]
            place = place.reshape(-1, 3)
            whose = np.repeat(owner[part], u.size)
            if where is not None:
                grid, low, high = where
                cell = grid.cells(place[:, :2])
                near = (place[:, 2] >= low[cell]) & (place[:, 2] <= high[cell])
                place, whose = place[near], whose[near]
            points.append(place)
            owners.append(whose)
    return np.concatenate(points), np.concatenate(owners)
