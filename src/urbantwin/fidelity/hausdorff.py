"""P95 bidirectional Hausdorff distance between two clouds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urbantwin.fidelity.nearest_point import NearestDistances

__all__ = ["P95Hausdorff"]


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
        """Return the 95th percentiles (linear between ranks) of distances already known."""
        return cls(
            real_to_synthetic=float(np.percentile(distances.real_to_synthetic, 95)),
            synthetic_to_real=float(np.percentile(distances.synthetic_to_real, 95)),
        )
