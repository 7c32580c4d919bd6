"""Short straight pieces of the rings that turning beams draw on what they meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.fidelity.compiled.straight_runs import straight_runs

__all__ = ["RingPieces", "ring_pieces"]

#: Neighbours of a point among which its piece is looked for: of one ring a dozen, and of others
#: that cross there.
_NEIGHBOURS = 24
#: They are all within this, metres; nearer together than this, nothing can be told apart.
_WITHIN_M, _TOO_NEAR_M = 3.0, 0.1
#: Points of a piece at least, and how far they may lie beside its line: noise of the ranges.
_FEWEST, _ASIDE_M = 7, 0.02
#: A piece is so many times as long as it is wide (root mean squares).
_SLENDER = 6.0
#: No direction of a piece is known better than this, radians: rings bend.
_BEST_RAD = 0.004


@dataclass(frozen=True, eq=False)
class RingPieces:
    """Pieces of rings, or what looks like one.

    Attributes:
        middle: (P, 3) float64, metres, in the frame of the points.
        along: (P, 3) unit vectors; their sign means nothing.
        sigma: (P,) standard deviation of the direction, radians.
        aside_m: (P,) root mean square of what the points lie beside the line.
    """

    middle: NDArray[np.float64]
    along: NDArray[np.float64]
    sigma: NDArray[np.float64]
    aside_m: NDArray[np.float64]

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.middle)

    def of(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> RingPieces:
        """Return some of them: a mask (P,) or indices."""
        return RingPieces(self.middle[rows], self.along[rows], self.sigma[rows], self.aside_m[rows])


def ring_pieces(frames: Sequence[NDArray[np.float64]], wanted: int, seed: int) -> RingPieces:
    """Return pieces of rings around points that are drawn from frames.

    Every frame is looked at by itself: what moves has rings, too. Of the lines through a point
    and one of its neighbours the one that most neighbours lie on is taken, so that rings of other
    sensors may cross there. Columns of a sensor, edges and poles give lines as well; they are
    told from rings later, by where nobody stands who could have drawn them.

    Args:
        frames: (N, 3) points of each, metres. Their order does not matter.
        wanted: points to look around, of all frames together.
        seed: what is drawn follows from it.
    """
    random = np.random.default_rng(seed)
    found = []
    for points in frames:
        distinct = np.unique(points, axis=0)
        many = min(len(distinct), -(-wanted // len(frames)))
        seeds = np.sort(random.choice(len(distinct), many, replace=False))
        tree = cKDTree(distinct)
        away, near = tree.query(
            distinct[seeds], k=_NEIGHBOURS, distance_upper_bound=_WITHIN_M, workers=-1
        )
        kept = np.isfinite(away).all(axis=1) & (away[:, -1] > _TOO_NEAR_M)
        count, middle, along, aside, spread = straight_runs(
            distinct, seeds[kept], near[kept], _ASIDE_M, _FEWEST
        )
        good = (count >= _FEWEST) & (spread > _SLENDER * aside)
        sigma = aside[good] / spread[good] / np.sqrt(count[good])
        found.append(
            RingPieces(middle[good], along[good], np.maximum(sigma, _BEST_RAD), aside[good])
        )
    return RingPieces(
        *(
            np.concatenate([getattr(one, name) for one in found])
            for name in ("middle", "along", "sigma", "aside_m")
        )
    )
