"""Frechet distances between Gaussians fitted to clouds: of places, and of local shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.fidelity.sampling import sample_rows
from urbantwin.processes import threads

__all__ = [
    "NEIGHBOURS",
    "SHAPE_POINTS",
    "frechet",
    "frechet_places",
    "frechet_shapes",
    "shape_features",
]

#: Points whose surroundings are described, and how many neighbours describe them.
SHAPE_POINTS = 3_000
NEIGHBOURS = 16


def frechet(
    mean1: NDArray[np.float64],
    covariance1: NDArray[np.float64],
    mean2: NDArray[np.float64],
    covariance2: NDArray[np.float64],
) -> float:
    """Return the squared Frechet distance of two Gaussians.

    |m1 - m2|^2 + tr(S1 + S2 - 2 (S1 S2)^(1/2)) (Dowson and Landau 1982, "The Frechet distance
    between multivariate normal distributions"). The trace of the root is the sum of the roots
    of the eigenvalues of S1^(1/2) S2 S1^(1/2), which is symmetric: no complex numbers arise.

    Args:
        mean1: (K,) of the first.
        covariance1: (K, K) of the first, symmetric, not negative.
        mean2: (K,) of the second.
        covariance2: (K, K) of the second.
    """
    value, vector = np.linalg.eigh(covariance1)
    root = (vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T
    inner = np.linalg.eigvalsh(root @ covariance2 @ root)
    cross = np.sqrt(np.maximum(inner, 0.0)).sum()
    apart = float(((mean1 - mean2) ** 2).sum())
    return max(0.0, apart + float(np.trace(covariance1) + np.trace(covariance2) - 2 * cross))


def frechet_places(real: NDArray[np.float64], synthetic: NDArray[np.float64]) -> float:
    """Return the squared Frechet distance of the clouds' x, y, z themselves, square metres.

    The "Frechet point distance" of the published challenge: nine numbers a cloud, its mean and
    covariance, decide it, and nothing else of the cloud does. An affine map of any cloud makes
    it 0 (see ``challenge/``).

    Args:
        real: (N, 3) metres, N >= 1.
        synthetic: (M, 3) metres, M >= 1.
    """
    return _of_samples(real, synthetic)


def frechet_shapes(real: NDArray[np.float64], synthetic: NDArray[np.float64]) -> float | None:
    """Return the squared Frechet distance of the local shape around points, no unit.

    The distance of Heusel et al. 2017 ("GANs trained by a two time-scale update rule", for
    images; Shu et al. 2019 for clouds) with features that anybody can compute in place of a
    network's: those of ``shape_features``. An affine map of the whole cloud does not make it 0.

    Args:
        real: (N, 3) metres.
        synthetic: (M, 3) metres.

    Returns:
        None where either cloud has no more than ``NEIGHBOURS`` points.
    """
    if min(len(real), len(synthetic)) <= NEIGHBOURS:
        return None
    return _of_samples(shape_features(real), shape_features(synthetic))


def shape_features(points: NDArray[np.float64], seed: int = 0) -> NDArray[np.float64]:
    """Return how points lie among their 16 nearest neighbours, (S, 5), S = min(N, 3000).

    With l1 >= l2 >= l3 the roots of the eigenvalues of the neighbours' covariance: linearity
    (l1 - l2) / l1, planarity (l2 - l3) / l1, scattering l3 / l1 (Demantke et al. 2011,
    "Dimensionality based scale selection in 3D lidar point clouds"); verticality 1 - |n_z| of
    the normal; and the natural logarithm of the neighbours' mean distance in metres.

    Args:
        points: (N, 3) metres, N > ``NEIGHBOURS``.
        seed: of the sample of points that are described; neighbours are sought among all.
    """
    chosen = sample_rows(len(points), min(len(points), SHAPE_POINTS), seed)
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)  # soon built
    distance, near = tree.query(points[chosen], k=NEIGHBOURS + 1, workers=threads())
    around = points[near] - points[near].mean(axis=1, keepdims=True)
    covariance = np.einsum("sni,snj->sij", around, around) / (NEIGHBOURS + 1)
    value, vector = np.linalg.eigh(covariance)
    l3, l2, l1 = np.sqrt(np.maximum(value, 0.0)).T
    l1 = np.maximum(l1, 1e-9)
    spacing = np.log(np.maximum(distance[:, 1:].mean(axis=1), 1e-6))
    upright = 1 - np.abs(vector[:, 2, 0])
    return np.column_stack([(l1 - l2) / l1, (l2 - l3) / l1, l3 / l1, upright, spacing])


def _of_samples(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return frechet(*_moments(first), *_moments(second))


def _moments(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean (K,) and covariance (K, K) of (N, K) values.

    Written out: a matrix product would depend on the number of threads in its last digits.
    """
    mean = values.mean(axis=0)
    off = values - mean
    return mean, np.einsum("ni,nj->ij", off, off) / len(off)
