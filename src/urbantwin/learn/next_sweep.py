"""The sweep after another, in the place of that other: what `pretraining` asks a network for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import Recording
from urbantwin.learn.frames import Levelled, levelled

__all__ = ["followed", "next_sweep"]

#: What stands: between these heights above the ground, in cells of this edge, metres.
_LOW_M, _HIGH_M, _CELL_M = 0.5, 3.0, 1.0
#: Two sweeps show the same place if both have something in so many of the cells where either has:
#: 0.53 to 0.84 a tenth of a second later, 0.22 to 0.35 if one is a metre off, below 0.1 elsewhere.
_LEAST_SHARED = 0.4


def followed(recording: Recording, names: Sequence[str]) -> list[bool]:
    """Return which of some frames of a recording are followed by another of them.

    Args:
        recording: with all of its frames.
        names: of the frames that may be seen, in their order.
    """
    place = {name: number for number, name in enumerate(recording.names)}
    at = [place[name] for name in names]
    return [after == this + 1 for this, after in pairwise(at)] + [False] * bool(at)


def next_sweep(
    frame: Frame, level: Levelled, after: Frame, reach_m: float
) -> NDArray[np.float32] | None:
    """Return the points (N, 3) of the sweep after a frame, where that frame's are on level ground.

    The sensors stand still, or the recording tells where they are in both; None where it does so of
    one alone, or where the two do not show the same place: another drive has begun, or it moves and
    nobody says how.

    Args:
        frame: a sweep.
        level: the same on level ground.
        after: the sweep after it.
        reach_m: points that are farther from the middle of ``after`` along x or y are left out.
    """
    here, there = frame.world_SE3_frame, after.world_SE3_frame
    if (here is None) != (there is None):
        return None
    moved = replace(after, boxes=None)
    if here is not None and there is not None:
        moved = moved.moved(here.inverse() @ there)
    found = levelled(moved, reach_m)
    points = found.frame.points[:, :3].copy()
    points[:, :2] += found.middle - level.middle
    return points if _shared(level.frame.points, points) >= _LEAST_SHARED else None


def _shared(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return in how many cells where either has something that stands both have, 0..1."""
    first, second = _standing(one), _standing(other)
    either = len(np.union1d(first, second))
    return len(np.intersect1d(first, second)) / either if either else 1.0


def _standing(points: NDArray[np.float32]) -> NDArray[np.int64]:
    high = (points[:, 2] >= _LOW_M) & (points[:, 2] < _HIGH_M)
    column, row = np.floor(points[high, :2] / _CELL_M).astype(np.int64).T
    return np.unique(row * 100_000 + column)
