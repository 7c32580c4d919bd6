"""The Jensen-Shannon divergence of two histograms."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["jensen_shannon"]


def jensen_shannon(first: ArrayLike, second: ArrayLike) -> float | None:
    """Return the Jensen-Shannon divergence, base 2: 0 for equal, 1 for disjoint histograms.

    JSD(P, Q) = KL(P | M) / 2 + KL(Q | M) / 2 with M = (P + Q) / 2 and KL(P | M) = sum of
    P log2(P / M) where P > 0 (Lin 1991, "Divergence measures based on the Shannon entropy",
    IEEE Trans. Inf. Theory 37(1)). Histograms are divided by their sums first. It is the
    divergence itself and not its square root (the Jensen-Shannon distance).

    Args:
        first: (K,) counts or weights, not negative.
        second: (K,) the same bins.

    Returns:
        0..1, or None where either histogram is empty: there is then no distribution to compare.
    """
    p, q = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if p.shape != q.shape or p.ndim != 1:
        raise ValueError(f"histograms must be of one shape (K,), not {p.shape} and {q.shape}")
    if (p < 0).any() or (q < 0).any():
        raise ValueError("a histogram has a negative bin")
    if not p.sum() or not q.sum():
        return None
    p, q = p / p.sum(), q / q.sum()
    middle = (p + q) / 2
    return float(np.clip((_relative_entropy(p, middle) + _relative_entropy(q, middle)) / 2, 0, 1))


def _relative_entropy(p: NDArray[np.float64], m: NDArray[np.float64]) -> float:
    some = p > 0
    return float((p[some] * np.log2(p[some] / m[some])).sum())
