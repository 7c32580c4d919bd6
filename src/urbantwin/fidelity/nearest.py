"""Distances to the nearest point of the other cloud, both ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["NearestDistances", "nearest_distances"]


@dataclass(frozen=True, eq=False)
class NearestDistances:
    """Distances in metres: (N,) of the real points, (M,) of the synthetic ones."""

    real_to_synthetic: NDArray[np.float64]
    synthetic_to_real: NDArray[np.float64]


def nearest_distances(
    real: NDArray[np.float64],
    synthetic: NDArray[np.float64],
    *,
    real_tree: cKDTree | None = None,
) -> NearestDistances:
    """Return the distance of every point to the nearest one of the other cloud.

    Args:
        real: (N, 3) metres, N >= 1.
        synthetic: (M, 3) metres, M >= 1, the same frame.
        real_tree: a tree of ``real`` to use again.
    """
    tree = real_tree if real_tree is not None else cKDTree(real)
    to_synthetic, _ = cKDTree(synthetic).query(real, workers=-1)
    to_real, _ = tree.query(synthetic, workers=-1)
    return NearestDistances(to_synthetic, to_real)
