"""Static and moving points by direction from a fixed sensor."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.reconstruct.compiled.static_points import stand_still
from urbantwin.reconstruct.recording.range_modes import RangeModes, range_modes

__all__ = ["COLUMNS", "StillRanges", "moves_as_nearest"]

#: Cell index = row * COLUMNS + column.
COLUMNS = 1 << 16
#: A point is at a static range within the larger of this distance (metres) and three standard
#: deviations, plus this share of the range.
_NEAR_M, _NEAR_SHARE = 0.2, 0.003
#: Distance (metres, plus a share of the range) within which a moving point has another one;
#: otherwise it is noise.
_ALONE_M, _ALONE_SHARE = 0.5, 0.01
#: A point on no beam is classified as its nearest neighbour on a beam within this distance, metres;
#: otherwise it is static.
_BESIDE_M = 1.0


class StillRanges:
    """The static ranges by cells of directions.

    They are found by `range_modes`, which needs a return from beyond a waiting object. A car that
    is parked throughout is static, and so is one that waits at a red light from the first frame to
    the last.

    Args:
        cell: (N,) direction of each return, row times `COLUMNS` plus column.
        frame: (N,) ascending frame numbers, from 0, in order of time.
        range_m: (N,) metres.
        frames: number of frames.
        turns: columns of a whole rotation: the last is next to the first.
        rows_beside: number of rows above and below whose static ranges also apply.
    """

    def __init__(
        self,
        cell: NDArray[np.int64],
        frame: NDArray[np.integer[Any]],
        range_m: NDArray[np.float64],
        *,
        frames: int,
        turns: int,
        rows_beside: int = 0,
    ) -> None:
        self.cells, place = np.unique(cell, return_inverse=True)
        self.modes: RangeModes = range_modes(
            place,
            frame,
            range_m.astype(np.float32),
            np.full(len(cell), np.nan, np.float32),
            cells=len(self.cells),
            frames=frames,
        )
        self._turns, self._beside = turns, rows_beside
        self._stands = self.modes.share > 0
        self._reach_m = np.maximum(_NEAR_M, 3 * self.modes.sigma_m)
        self._reach_m += _NEAR_SHARE * self.modes.range_m

    def moving(
        self, cell: NDArray[np.int64], range_m: NDArray[np.float64], points: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return the mask of the points (N,) of a frame that are not at static ranges.

        Points beyond all static surfaces of their direction are static: those were hidden before.

        Args:
            cell: (N,) direction of each point.
            range_m: (N,) range of each point.
            points: (N, 3) metres.
        """
        still = stand_still(
            cell,
            range_m,
            self.cells,
            self._stands,
            self.modes.range_m,
            self._reach_m,
            COLUMNS,
            self._turns,
            self._beside,
        )
        moves = np.flatnonzero(~still)
        if len(moves):
            away = cKDTree(points[moves]).query(points[moves], k=2)[0][:, 1]
            still[moves[away > _ALONE_M + _ALONE_SHARE * range_m[moves]]] = True
        return np.asarray(~still)


def moves_as_nearest(
    moves: NDArray[np.bool_], points: NDArray[np.float64], known: NDArray[np.bool_]
) -> None:
    """Write the moving state of points (N,) on no beam, from their nearest neighbours.

    Args:
        moves: (N,) state of the points on beams; false for the others, to be written.
        points: (N, 3) metres.
        known: (N,) mask of the points on beams.
    """
    lost, on = np.flatnonzero(~known), np.flatnonzero(known)
    if len(lost) and len(on):
        away, nearest = cKDTree(points[on]).query(points[lost], distance_upper_bound=_BESIDE_M)
        near = np.isfinite(away)
        moves[lost[near]] = moves[on[nearest[near]]]
