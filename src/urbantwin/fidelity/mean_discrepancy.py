"""Maximum mean discrepancy of two clouds."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from urbantwin.fidelity.sampling import sample_rows

__all__ = ["DISCREPANCY_POINTS", "KERNEL_WIDTHS_M", "mean_discrepancy"]

#: Points of each cloud that are compared.
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
