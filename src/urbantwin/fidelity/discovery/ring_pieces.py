"""Short straight pieces of the rings that rotating beams trace on surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.fidelity.compiled.straight_runs import straight_runs

__all__ = ["RingPieces", "ring_pieces"]

#: Maximum and minimum extent of a neighbourhood with a piece, metres: in smaller ones range noise
#: would determine the direction of the line.
_WITHIN_M, _TOO_NEAR_M = 3.0, 0.1
#: Minimum number of points of a piece, and their maximum distance from its line, metres.
_FEWEST, _ASIDE_M = 7, 0.02
#: Least ratio of a piece's length to its width (root mean squares).
_SLENDER = 6.0
#: Least standard deviation of a piece's direction, radians: rings are curved.
_BEST_RAD = 0.004


@dataclass(frozen=True, eq=False)
class RingPieces:
    """Pieces of rings, and other straight runs of points.

    Attributes:
        middle: (P, 3) float64, metres, in the frame of the points.
        along: (P, 3) unit vectors of either sign.
        sigma: (P,) standard deviation of the direction, radians.
    """

    middle: NDArray[np.float64]
    along: NDArray[np.float64]
    sigma: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of pieces."""
        return len(self.middle)

    def of(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> RingPieces:
        """Return the pieces of a mask (P,) or of indices."""
        return RingPieces(self.middle[rows], self.along[rows], self.sigma[rows])


def ring_pieces(
    frames: Sequence[NDArray[np.float64]], wanted: int, neighbours: int, seed: int
) -> RingPieces:
    """Return pieces of rings around random points of frames.

    Pieces are found in each frame separately, because rings on moving objects count, too. Of the
    lines through a point and one of its neighbours, the one with most neighbours is chosen, as
    rings of other sensors may cross there. Columns of a scan, edges and poles are straight runs as
    well; they are rejected later, because no sensor position explains them as rings.

    Args:
        frames: (N, 3) points of each frame, metres, in any order.
        wanted: number of points to examine, over all frames.
        neighbours: number of neighbours of a point among which its piece is searched.
        seed: seed of the random draw.
    """
    random = np.random.default_rng(seed)
    found = []
    for points in frames:
        distinct = np.unique(points, axis=0)
        many = min(len(distinct), -(-wanted // len(frames)))
        seeds = np.sort(random.choice(len(distinct), many, replace=False))
        tree = cKDTree(distinct)
        away, near = tree.query(
            distinct[seeds], k=neighbours, distance_upper_bound=_WITHIN_M, workers=-1
        )
        kept = np.isfinite(away).all(axis=1) & (away[:, -1] > _TOO_NEAR_M)
        count, middle, along, aside, spread = straight_runs(
            distinct, seeds[kept], near[kept], _ASIDE_M, _FEWEST
        )
        good = (count >= _FEWEST) & (spread > _SLENDER * aside)
        sigma = aside[good] / spread[good] / np.sqrt(count[good])
        found.append(RingPieces(middle[good], along[good], np.maximum(sigma, _BEST_RAD)))
    return RingPieces(
        *(
            np.concatenate([getattr(one, name) for one in found])
            for name in ("middle", "along", "sigma")
        )
    )
