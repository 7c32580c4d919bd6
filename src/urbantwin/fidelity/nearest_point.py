"""Distances to the nearest point of the other cloud, both ways."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.compiled.box_tree import arranged, boxed
from urbantwin.fidelity.compiled.nearest_point import LEAF, leaf_table, nearest_points
from urbantwin.processes import threads

__all__ = ["NearestDistances", "PointTree", "nearest_distances"]

#: Minimum number of leaves per thread.
_LEAST_LEAVES = 512


@dataclass(frozen=True, eq=False)
class NearestDistances:
    """Distances in metres: (N,) of the real points, (M,) of the synthetic ones."""

    real_to_synthetic: NDArray[np.float64]
    synthetic_to_real: NDArray[np.float64]


class PointTree:
    """Points in a balanced k-d tree of boxes (Friedman, Bentley and Finkel 1977).

    Queries are exact: all points are queried together (Curtin et al. 2013, "Tree-independent
    dual-tree algorithms", with one level of the query tree).

    Args:
        points: (N, 3) metres, N >= 1, finite.
    """

    def __init__(self, points: NDArray[np.float64]) -> None:
        points = np.ascontiguousarray(points, np.float64)
        self._order, levels = arranged(points, LEAF)
        self._box = boxed(points, points, self._order, levels)
        self._table = leaf_table(points, self._order, levels)

    def nearest_of(self, other: PointTree) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return distance (N,), metres, and row of the point nearest to each of another tree."""
        square, where = np.empty(len(self._order)), np.empty(len(self._order), np.int64)
        leaves = len(self._table)
        runs = max(1, min(threads(), leaves // _LEAST_LEAVES))

        def fill(run: int) -> None:
            nearest_points(
                run * leaves // runs,
                (run + 1) * leaves // runs,
                self._table,
                self._box,
                self._order,
                other._table,
                other._box,
                other._order,
                square,
                where,
            )

        if runs == 1:
            fill(0)
        else:
            with ThreadPoolExecutor(runs) as pool:
                list(pool.map(fill, range(runs)))
        return np.sqrt(square), where


def nearest_distances(
    real: NDArray[np.float64],
    synthetic: NDArray[np.float64],
    *,
    real_tree: PointTree | None = None,
) -> NearestDistances:
    """Return the distance of every point to the nearest one of the other cloud.

    Args:
        real: (N, 3) metres, N >= 1.
        synthetic: (M, 3) metres, M >= 1, the same frame.
        real_tree: an existing tree of ``real``.
    """
    wanted = [synthetic] if real_tree is not None else [synthetic, real]
    with ThreadPoolExecutor(threads()) as pool:
        its, *made = pool.map(PointTree, wanted)
    mine = real_tree if real_tree is not None else made[0]
    return NearestDistances(mine.nearest_of(its)[0], its.nearest_of(mine)[0])
