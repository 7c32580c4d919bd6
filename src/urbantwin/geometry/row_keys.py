"""One number for each row of whole numbers, as ``numpy.unique`` compares numbers quickly."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["row_keys"]


def row_keys(rows: NDArray[np.integer[Any]]) -> NDArray[np.integer[Any]]:
    """Return a number (N,) for each of rows (N, K), equal and in order as the rows are.

    ``np.unique(row_keys(rows), axis=0, ...)`` finds which are equal as it does of the rows
    themselves, in a tenth of the time. Where they lie farther apart than an index can number, what
    is returned are the rows.
    """
    if not len(rows):
        return rows
    low = rows.min(axis=0)
    size = rows.max(axis=0).astype(np.float64) - low + 1
    if np.prod(size) > 2**52:  # no float is exact beyond it
        return rows
    return np.asarray(np.ravel_multi_index(tuple((rows - low).T), tuple(size.astype(np.int64))))
