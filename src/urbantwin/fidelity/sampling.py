"""Reproducible samples of points and of frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["evenly", "sample_rows", "sampled"]


def evenly(count: int, most: int) -> list[int]:
    """Return the indices of all of ``count`` items, or of ``most`` that are spread evenly."""
    spread: list[int] = np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()
    return spread


def sample_rows(count: int, wanted: int, seed: int = 0) -> NDArray[np.int64]:
    """Return ``wanted`` of ``count`` indices in order, without repeats.

    The sample is random instead of every n-th: points are stored by ring or by column, and a fixed
    stride would favour some rings. Philox is keyed by the seed: equal on every machine.
    """
    generator = np.random.Generator(np.random.Philox(key=seed))
    return np.sort(generator.choice(count, wanted, replace=False))


def sampled(points: NDArray[np.float64], most: int, seed: int = 0) -> NDArray[np.float64]:
    """Return the points, or a sample of ``most`` of them if there are more."""
    return points[sample_rows(len(points), most, seed)] if len(points) > most else points
