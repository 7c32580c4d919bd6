"""P95 bidirectional Hausdorff distance between two clouds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.nearest import NearestDistances, PointTree, nearest_distances

__all__ = ["P95Hausdorff", "p95_hausdorff"]


@dataclass(frozen=True)
class P95Hausdorff:
    """Distances in metres; ``both`` is the larger of the two directions."""

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


def p95_hausdorff(
    real: NDArray[np.float64],
    synthetic: NDArray[np.float64],
    *,
    real_tree: PointTree | None = None,
) -> P95Hausdorff:
    """Return the 95th percentile of nearest-neighbour distances, in both directions.

    The Hausdorff distance with its outer maximum replaced by a quantile, so that single stray
    points do not decide it (Huttenlocher, Klanderman, Rucklidge 1993, "Comparing images using the
    Hausdorff distance", the partial distance, here with f = 0.95). Percentiles
    are interpolated linearly.

    Args:
        real: (N, 3) metres, N >= 1.
        synthetic: (M, 3) metres, M >= 1, the same frame.
        real_tree: a tree of ``real`` to use again.
    """
    return P95Hausdorff.of(nearest_distances(real, synthetic, real_tree=real_tree))
