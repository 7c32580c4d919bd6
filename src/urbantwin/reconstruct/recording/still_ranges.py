"""What stands still and what moves, by direction from a sensor that stands still."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.reconstruct.compiled.static_points import stand_still
from urbantwin.reconstruct.recording.range_modes import RangeModes, range_modes

__all__ = ["COLUMNS", "StillRanges", "moves_as_nearest"]

#: A cell of directions is called row times this, and column.
COLUMNS = 1 << 16
#: A point is of a static range within this, three standard deviations and a share of the range.
_NEAR_M, _NEAR_SHARE = 0.2, 0.003
#: A point that moves has another within this and a share of its range: else it is noise.
_ALONE_M, _ALONE_SHARE = 0.5, 0.01
#: What is on no beam does as the nearest point that is, within this, metres; else it stands still.
_BESIDE_M = 1.0


class StillRanges:
    """The ranges at which something always stands, by cells of directions.

    What stands in each is found by `range_modes`: it needs a look beyond what waits, so a car that
    is parked all the time stands still, and so does one that waits at a red light from the first
    frame to the last.

    Args:
        cell: (N,) direction of each look, row times `COLUMNS` and column.
        frame: (N,) ascending numbers of frames, from 0, in the order of time.
        range_m: (N,) metres.
        frames: how many frames there are.
        turns: columns of a whole turn: the last is beside the first.
        rows_beside: rows above and below in which a point may stand still as well.
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
        """Return which points (N,) of a frame stand where nothing always does.

        What lies beyond everything static in its direction stands still: it was hidden.

        Args:
            cell: (N,) of each point.
            range_m: (N,) of each point.
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
    """Write which points (N,) on no beam of a sensor move: those beside others that do.

    Args:
        moves: (N,) of the points on beams; of the others false, to be written.
        points: (N, 3) metres.
        known: (N,) which points are on beams.
    """
    lost, on = np.flatnonzero(~known), np.flatnonzero(known)
    if len(lost) and len(on):
        away, nearest = cKDTree(points[on]).query(points[lost], distance_upper_bound=_BESIDE_M)
        near = np.isfinite(away)
        moves[lost[near]] = moves[on[nearest[near]]]
