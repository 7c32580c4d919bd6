"""The bare earth under everything that stands on it, on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import grey_opening, median_filter

from urbantwin.reconstruct.cleaning.height_grid import filled

__all__ = ["bare_earth", "bare_street"]


def bare_street(lowest: NDArray[np.float64], step: float, widest_m: float) -> NDArray[np.float64]:
    """Return the surface without anything narrower than ``widest_m``.

    A morphological opening: what a square of that size cannot enter from below is cut off. A
    plane of any slope stays what it is, and so does a step between two surfaces that are wider.

    Args:
        lowest: (rows, columns) heights of the lowest surface, metres; nan where none is.
        step: side of a cell, metres.
        widest_m: what is narrower is removed, metres.
    """
    size = 2 * int(np.ceil(widest_m / step / 2)) + 1
    # A pit of one cell (a scan's noise) would drag the whole window down.
    return np.asarray(grey_opening(median_filter(filled(lowest), 3), size, mode="nearest"))


def bare_earth(
    lowest: NDArray[np.float64],
    step: float,
    *,
    slope: float = 0.2,
    widest_m: float = 60.0,
    least_m: float = 0.3,
) -> NDArray[np.bool_]:
    """Return which cells (rows, columns) show the bare earth.

    The simple morphological filter of Pingel, Clarke and McBride (2013, ISPRS J. 77, 21-30): the
    surface is opened with wider and wider windows; what an opening lowers by more than the
    terrain could rise over that window stands on the ground.

    Args:
        lowest: heights of the lowest surface, metres; nan where none is.
        step: side of a cell, metres.
        slope: steepest terrain, rise over run.
        widest_m: widest building, metres.
        least_m: what is lower than this over its surroundings is ground.
    """
    surface = filled(lowest)
    # Pits below the ground are noise: closed as in the paper's first step.
    pit = -(grey_opening(-surface, 3, mode="nearest")) - surface > 1.0
    surface = np.where(pit, median_filter(surface, 5), surface)
    stands = pit
    last = surface
    reach, before = 1, 0
    while before * 2 * step < widest_m:
        opened = grey_opening(last, 2 * reach + 1, mode="nearest")
        stands |= last - opened > max(least_m, slope * reach * step)
        last = opened
        before, reach = reach, max(reach + 1, int(reach * 1.5))
    # Cells above the opened terrain that a slow rise of windows let through: slopes of roofs.
    return np.asarray(~(stands | np.isnan(lowest)))
