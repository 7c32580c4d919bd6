"""Losses of the fit by sector of the view; sectors are nearly independent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["SECTORS", "Loss", "sectors_of"]

#: Number of azimuth sectors: the scatter of a difference over them shows its significance. Errors
#: of twins are local, so errors of neighbouring beams are correlated.
SECTORS = 16


@dataclass(frozen=True, eq=False)
class Loss:
    """A mean of single losses, by sector.

    Attributes:
        total: (S,) sum of the weighted losses in each sector.
        weight: (S,) sum of the weights, independent of the parameters.
    """

    total: NDArray[np.float64]
    weight: NDArray[np.float64]

    @classmethod
    def of(
        cls, losses: NDArray[np.float64], weights: NDArray[np.float64], sector: NDArray[np.int64]
    ) -> Loss:
        """Sum losses (N,) with weights (N,) by their sectors (N,)."""
        return cls(
            np.bincount(sector, losses * weights, minlength=SECTORS).astype(np.float64),
            np.bincount(sector, weights, minlength=SECTORS).astype(np.float64),
        )

    @property
    def mean(self) -> float:
        """The weighted mean; 0 without losses."""
        return float(self.total.sum() / max(self.weight.sum(), 1e-12))

    def worse_than(self, other: Loss) -> tuple[float, float]:
        """Return the excess of this mean over another, and its standard error over sectors."""
        whole = max(float(self.weight.sum()), 1e-12)
        apart = self.total - other.total
        mean = float(apart.sum()) / whole
        there = self.weight > 0
        count = int(there.sum())
        if count < 2:
            return mean, 0.0
        scatter = apart[there] - self.weight[there] * mean
        return mean, float(np.sqrt((scatter**2).sum() * count / (count - 1))) / whole


def sectors_of(directions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the sector (N,) of directions (N, 3)."""
    turn = np.arctan2(directions[:, 1], directions[:, 0]) / (2 * np.pi) + 0.5
    return np.minimum((turn * SECTORS).astype(np.int64), SECTORS - 1)
