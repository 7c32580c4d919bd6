"""A patch of the bare earth: the heights that one source gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ElevationPatch"]


@dataclass(frozen=True, eq=False)
class ElevationPatch:
    """Heights of the bare earth on a grid, where a source has them.

    Attributes:
        west, south: position of the first node, site frame, metres.
        step: between nodes, metres.
        heights: (rows from south to north, columns from west to east) float64 metres above the
            anchor's ground; nan where the source has none.
        detail_m: size of the smallest things that the source shows, metres (point spacing, cell).
        name: of the source.
    """

    west: float
    south: float
    step: float
    heights: NDArray[np.float64]
    detail_m: float
    name: str
