"""Chamfer distance, and the density-aware one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.nearest_point import NearestDistances, PointTree
from urbantwin.fidelity.sampling import sample_rows

__all__ = ["DENSITY_POINTS", "DENSITY_SCALE_M", "chamfer", "chamfer_squared", "density_chamfer"]

#: Points of each cloud that the density-aware distance looks at.
DENSITY_POINTS = 20_000
#: Distance over which a neighbour's worth falls to 1/e, metres (1 / alpha of the paper).
DENSITY_SCALE_M = 1.0


def chamfer(distances: NearestDistances) -> float:
    """Return the mean of both directions' mean distance to the nearest point, metres.

    Barrow et al. 1977, "Parametric correspondence and chamfer matching", made symmetric: half
    the sum of both directions, so two parallel planes at a distance d have d.
    """
    return float((distances.real_to_synthetic.mean() + distances.synthetic_to_real.mean()) / 2)


def chamfer_squared(distances: NearestDistances) -> float:
    """Return the sum of both directions' mean squared distance, square metres.

    As Fan, Su and Guibas 2017 ("A point set generation network") define it, and most of what
    was published on learned clouds: two parallel planes at a distance d have 2 d^2.
    """
    return float((distances.real_to_synthetic**2).mean() + (distances.synthetic_to_real**2).mean())


def density_chamfer(
    real: NDArray[np.float64],
    synthetic: NDArray[np.float64],
    *,
    most: int = DENSITY_POINTS,
    scale_m: float = DENSITY_SCALE_M,
) -> float:
    """Return the density-aware Chamfer distance: 0 for equal clouds, below 1 for far ones.

    Wu et al. 2021, "Density-aware Chamfer distance as a comprehensive metric for point cloud
    completion", with as many points on both sides: the mean over both directions of
    1 - exp(-d / scale) / n, where d is a point's distance to its nearest neighbour on the other
    side and n the number of points that have this same neighbour. Points that crowd where the
    other cloud has few therefore count as unmatched, which the plain distance does not see.

    Args:
        real: (N, 3) metres, N >= 1.
        synthetic: (M, 3) metres, M >= 1.
        most: points of each side; both are sampled down to the smallest of N, M and this.
        scale_m: over which exp falls to 1/e. The paper's clouds fill a unit sphere with
            1/1000; a street at the spacing of a LiDAR's points needs metres.
    """
    count = min(len(real), len(synthetic), most)
    a, b = (PointTree(cloud[sample_rows(len(cloud), count)]) for cloud in (real, synthetic))
    return (_one_way(a, b, scale_m) + _one_way(b, a, scale_m)) / 2


def _one_way(a: PointTree, b: PointTree, scale_m: float) -> float:
    distance, neighbour = a.nearest_of(b)
    crowd = np.bincount(neighbour)[neighbour]
    return float((1 - np.exp(-distance / scale_m) / crowd).mean())
