"""Casting rays at triangles: the seam between our geometry and a ray tracer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Hits", "RayCaster"]


@dataclass(frozen=True, eq=False)
class Hits:
    """What N rays hit first.

    Attributes:
        range_m: (N,) float32, distance to the first hit; ``inf`` where a ray hits nothing.
        face: (N,) int32, the face that was hit; -1 where a ray hits nothing.
    """

    range_m: NDArray[np.float32]
    face: NDArray[np.int32]


class RayCaster(Protocol):
    """Finds the first triangle along each of many rays."""

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return the first hit of each ray.

        Args:
            origins: (3,) where all rays leave, or (N, 3) where each does, metres.
            directions: (N, 3) unit vectors.
        """
        ...
