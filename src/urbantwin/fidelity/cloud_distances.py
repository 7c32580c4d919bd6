"""Distances between two clouds: Hausdorff, Chamfer, earth mover's, mean discrepancy, Frechet."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from urbantwin.fidelity.nearest_point import NearestDistances, PointTree
from urbantwin.fidelity.sampling import sample_rows, sampled
from urbantwin.processes import threads

__all__ = [
    "DENSITY_POINTS",
    "DENSITY_SCALE_M",
    "P95Hausdorff",
    "chamfer",
    "chamfer_squared",
    "density_chamfer",
    "earth_mover",
    "frechet",
    "frechet_places",
    "frechet_shapes",
    "mean_discrepancy",
    "shape_features",
    "sliced_earth_mover",
]


@dataclass(frozen=True)
class P95Hausdorff:
    """The 95th percentile of nearest-neighbour distances in each direction, metres.

    The Hausdorff distance with its outer maximum replaced by a quantile, so that single stray
    points do not decide it (Huttenlocher, Klanderman, Rucklidge 1993, "Comparing images using the
    Hausdorff distance", the partial distance, here with f = 0.95).
    """

    real_to_synthetic: float
    synthetic_to_real: float

    @property
    def both(self) -> float:
        """The bidirectional distance."""
        return max(self.real_to_synthetic, self.synthetic_to_real)

    @classmethod
    def of(cls, distances: NearestDistances) -> P95Hausdorff:
        """Return the 95th percentiles (linear between ranks) of known distances."""
        return cls(
            real_to_synthetic=float(np.percentile(distances.real_to_synthetic, 95)),
            synthetic_to_real=float(np.percentile(distances.synthetic_to_real, 95)),
        )


#: Maximum number of points of each cloud for the density-aware distance.
DENSITY_POINTS = 20_000
#: Distance over which the weight of a neighbour falls to 1/e, metres (1 / alpha of the paper).
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


#: Maximum number of points of each cloud for the exact earth mover's distance.
EARTH_MOVER_POINTS = 750
#: Directions of the sliced distance, and quantiles compared per slice.
SLICES = 64
SLICE_QUANTILES = 512
#: Maximum number of projected points; larger clouds are sampled.
SLICE_POINTS = 20_000


def earth_mover(
    real: NDArray[np.float64],
    synthetic: NDArray[np.float64],
    *,
    most: int = EARTH_MOVER_POINTS,
    seed: int = 0,
) -> float:
    """Return the mean distance that points must move to become the other cloud, metres.

    Rubner, Tomasi and Guibas 2000 ("The earth mover's distance as a metric for image
    retrieval"), equal weights: the best one-to-one assignment, exact (Crouse 2016, "On
    implementing 2D rectangular assignment algorithms", as scipy has it), of samples of both
    clouds. Samples of one scene differ from each other: the figure is never 0 between two
    frames, falls with more points, and is read beside real against real.

    Args:
        real: (N, 3) metres, N >= 1.
        synthetic: (M, 3) metres, M >= 1.
        most: points of each sample; the smallest of N, M and this are taken.
        seed: of the samples. Clouds of the same length are sampled at the same rows.
    """
    count = min(len(real), len(synthetic), most)
    a, b = (cloud[sample_rows(len(cloud), count, seed)] for cloud in (real, synthetic))
    cost = cdist(a, b)
    row, column = linear_sum_assignment(cost)
    return float(cost[row, column].mean())


def sliced_earth_mover(
    real: NDArray[np.float64], synthetic: NDArray[np.float64], *, seed: int = 0
) -> float:
    """Return the mean earth mover's distance of the clouds' projections onto lines, metres.

    Bonneel et al. 2015, "Sliced and Radon Wasserstein barycenters of measures": along each of
    64 random directions the distance of two distributions on a line is the mean difference of
    their quantiles (here 512). It takes 20,000 points where the exact distance takes 750, and
    is therefore little raised by sampling; a cloud moved by t has |t| / 2 in the mean over all
    directions. Never above the exact distance of the same points.
    """
    generator = np.random.Generator(np.random.Philox(key=seed))
    direction = generator.normal(size=(3, SLICES)).T
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    level = (np.arange(SLICE_QUANTILES) + 0.5) / SLICE_QUANTILES
    a, b = (
        _quantiles(_projected(sampled(cloud, SLICE_POINTS, seed), direction), level)
        for cloud in (real, synthetic)
    )
    return float(np.abs(a - b).mean())


def _projected(points: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coordinates (S, N) of (N, 3) points along (S, 3) directions.

    No matrix product is used: its last digits would depend on the number of threads.
    """
    x, y, z = np.ascontiguousarray(points.T)
    return np.asarray(direction[:, :1] * x + direction[:, 1:2] * y + direction[:, 2:] * z)


def _quantiles(values: NDArray[np.float64], level: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quantiles (S, Q) of rows (S, N): the value at each share of the points."""
    count = values.shape[1]
    ranks = np.minimum((level * count).astype(np.int64), count - 1)
    values.sort(axis=1)
    return values[:, ranks]


#: Maximum number of points of each cloud for the mean discrepancy.
DISCREPANCY_POINTS = 1_000
#: Widths (sigma) of the Gaussian kernels whose mean is the kernel, metres.
KERNEL_WIDTHS_M = (1.0, 4.0, 16.0)


def mean_discrepancy(
    real: NDArray[np.float64],
    synthetic: NDArray[np.float64],
    *,
    most: int = DISCREPANCY_POINTS,
    widths_m: tuple[float, ...] = KERNEL_WIDTHS_M,
    seed: int = 0,
) -> float:
    """Return the squared maximum mean discrepancy: 0 for equal clouds, at most 2.

    Gretton et al. 2012, "A kernel two-sample test", equation 5 (the biased estimate, which is
    never negative): mean k(x, x') + mean k(y, y') - 2 mean k(x, y), with k the mean of Gaussian
    kernels exp(-d^2 / (2 sigma^2)): a street corner has structure from kerbs to houses.

    Args:
        real: (N, 3) metres, N >= 1.
        synthetic: (M, 3) metres, M >= 1.
        most: points of each sample; the smallest of N, M and this are taken.
        widths_m: sigma of the kernels, metres.
        seed: of the samples. Clouds of the same length are sampled at the same rows.
    """
    count = min(len(real), len(synthetic), most)
    a, b = (cloud[sample_rows(len(cloud), count, seed)] for cloud in (real, synthetic))
    own = _mean_kernel(a, a, widths_m) + _mean_kernel(b, b, widths_m)
    return max(0.0, own - 2 * _mean_kernel(a, b, widths_m))


def _mean_kernel(
    a: NDArray[np.float64], b: NDArray[np.float64], widths_m: tuple[float, ...]
) -> float:
    square = cdist(a, b, "sqeuclidean")
    widths = sorted(widths_m, reverse=True)
    kernel = np.exp(square / (-2 * widths[0] ** 2))
    means = [kernel.mean()]
    for before, width in pairwise(widths):
        times = (before / width) ** 2
        if times == 16:  # a fourth of the width: the power that squaring four times makes
            for _ in range(4):
                np.square(kernel, out=kernel)
        else:
            np.exp(square / (-2 * width**2), out=kernel)
        means.append(kernel.mean())
    return float(np.mean(means))


#: Sampled points whose neighbourhood is described, and the neighbours of each.
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
    """Return the squared Frechet distance of the clouds' x, y, z, square metres.

    The "Frechet point distance" of the published challenge. It depends on nine numbers per cloud,
    its mean and covariance. An affine map of any cloud makes it 0 (see ``challenge/``).

    Args:
        real: (N, 3) metres, N >= 1.
        synthetic: (M, 3) metres, M >= 1.
    """
    return _of_samples(real, synthetic)


def frechet_shapes(real: NDArray[np.float64], synthetic: NDArray[np.float64]) -> float | None:
    """Return the squared Frechet distance of the local shape around points, without unit.

    The distance of Heusel et al. 2017 ("GANs trained by a two time-scale update rule", for images;
    Shu et al. 2019 for clouds), with the reproducible features of ``shape_features`` instead of a
    network's. An affine map of the whole cloud does not make it 0.

    Args:
        real: (N, 3) metres.
        synthetic: (M, 3) metres.

    Returns:
        None if either cloud has no more than ``NEIGHBOURS`` points.
    """
    if min(len(real), len(synthetic)) <= NEIGHBOURS:
        return None
    return _of_samples(shape_features(real), shape_features(synthetic))


def shape_features(points: NDArray[np.float64], seed: int = 0) -> NDArray[np.float64]:
    """Return the local shape around sampled points, (S, 5), S = min(N, 3000).

    With l1 >= l2 >= l3 the roots of the eigenvalues of the covariance of a point and its 16 nearest
    neighbours: linearity (l1 - l2) / l1, planarity (l2 - l3) / l1, scattering l3 / l1 (Demantke et
    al. 2011, "Dimensionality based scale selection in 3D lidar point clouds"); verticality 1 -
    |n_z| of the normal; and the natural logarithm of the neighbours' mean distance in metres.

    Args:
        points: (N, 3) metres, N > ``NEIGHBOURS``.
        seed: seed of the sample of described points; neighbours are searched among all points.
    """
    chosen = sample_rows(len(points), min(len(points), SHAPE_POINTS), seed)
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)  # fast to build
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

    No matrix product is used: its last digits would depend on the number of threads.
    """
    mean = values.mean(axis=0)
    off = values - mean
    return mean, np.einsum("ni,nj->ij", off, off) / len(off)
