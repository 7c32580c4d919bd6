"""The challenge's realism, and what a fit of mean and covariance makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.chamfer import chamfer_squared
from urbantwin.fidelity.earth_mover import earth_mover
from urbantwin.fidelity.frechet import frechet_places
from urbantwin.fidelity.mean_discrepancy import mean_discrepancy
from urbantwin.fidelity.nearest_point import nearest_distances
from urbantwin.fidelity.sampling import sampled

__all__ = ["EMD_POINTS", "POINTS", "SEED", "MomentFit", "fit_moments", "realism"]

#: Points of each side's frames put together, and the seed that they are drawn with.
POINTS, SEED = 10_000, 1234
#: Of those, points that are assigned to each other (all of them would take minutes).
EMD_POINTS = 2_000


def realism(
    real: Sequence[NDArray[np.float64]], synthetic: Sequence[NDArray[np.float64]]
) -> dict[str, float]:
    """Return CD (m2), MMD, EMD (m) and FPD (m2) of the frames put together.

    Args:
        real: (N, 3) points of each frame, metres, cropped, at least one point in all.
        synthetic: the same of the twin.
    """
    a, b = (sampled(np.concatenate(list(side)), POINTS, SEED) for side in (real, synthetic))
    return {
        "CD": chamfer_squared(nearest_distances(a, b)),
        "MMD": mean_discrepancy(a, b, most=EMD_POINTS, seed=SEED),
        "EMD": earth_mover(a, b, most=EMD_POINTS, seed=SEED),
        "FPD": frechet_places(a, b),
    }


@dataclass(frozen=True, eq=False)
class MomentFit:
    """The affine map that gives a cloud another's mean and covariance.

    Attributes:
        matrix: (3, 3).
        source_mean: (3,) metres.
        target_mean: (3,) metres.
    """

    matrix: NDArray[np.float64]
    source_mean: NDArray[np.float64]
    target_mean: NDArray[np.float64]

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 3) points where the fit puts them."""
        return (points - self.source_mean) @ self.matrix.T + self.target_mean


def fit_moments(source: NDArray[np.float64], target: NDArray[np.float64]) -> MomentFit:
    """Return the map of least displacement from one Gaussian to the other.

    A = S^(-1/2) (S^(1/2) T S^(1/2))^(1/2) S^(-1/2) (Dowson and Landau 1982; Olkin and Pukelsheim
    1982). It knows nothing of streets: a cloud's errors stay, smeared. Directions in which the
    source has no extent are left as they are.

    Args:
        source: (N, 3) metres.
        target: (M, 3) metres.
    """
    s, t = (np.cov(cloud, rowvar=False, bias=True) for cloud in (source, target))
    value, vector = np.linalg.eigh(s)
    kept = value > 1e-9 * max(float(value.max()), 1e-12)
    root = np.sqrt(np.where(kept, value, 1.0))
    half, back = (vector * root) @ vector.T, (vector / root) @ vector.T
    inner, inner_vector = np.linalg.eigh(half @ t @ half)
    middle = (inner_vector * np.sqrt(np.maximum(inner, 0.0))) @ inner_vector.T
    return MomentFit(back @ middle @ back, source.mean(axis=0), target.mean(axis=0))
