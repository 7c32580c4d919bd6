"""Static ranges of a direction (modes) from many firings along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["ALTERNATES", "MOST_MODES", "RangeModes", "range_modes"]

#: Maximum number of ranges per direction, such as the edge of a pole in front of a fence in front
#: of a house.
MOST_MODES = 3
#: Width of the ranges of one surface, metres, plus this share of the range (slanted ground).
_WIDTH_M, _WIDTH_SHARE = 0.5, 0.01
#: Minimum gap between two modes, metres.
_GAP_M = 0.25
#: Minimum number of frames with a return of a mode, and minimum share of the frames that could see
#: it.
_LEAST_LOOKS, _LEAST_SHARE = 2, 0.05
#: Minimum share of a mode in front of another surface: in one lane, cars pass at one range.
_LEAST_BEFORE = 0.3
#: Minimum rate of alternation of a random mode, relative to independent firings.
ALTERNATES = 0.7
#: Maximum number of candidates per direction.
_TRIES = 6
_UNSEEN, _NEARER, _BEYOND, _HIT = 0, 1, 2, 3


@dataclass(frozen=True, eq=False)
class RangeModes:
    """The static ranges of C directions, the most frequent first; share 0 if there is none.

    Attributes:
        range_m: (C, 3) float32, metres.
        sigma_m: (C, 3) float32, standard deviation, metres.
        share: (C, 3) float32, share of the returns in the firings that no passing object obstructs.
            The sum is below 1 if returns are lost.
        intensity: (C, 3) float32, mean; nan if unknown.
        looks: (C,) int32, number of frames without an object in front of the nearest range.
    """

    range_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    share: NDArray[np.float32]
    intensity: NDArray[np.float32]
    looks: NDArray[np.int32]


def range_modes(
    cell: NDArray[np.integer[Any]],
    frame: NDArray[np.integer[Any]],
    range_m: NDArray[np.float32],
    intensity: NDArray[np.float32],
    *,
    cells: int,
    frames: int,
) -> RangeModes:
    """Return the static ranges of every direction.

    A frequent range is static if firings without it are rare or scattered over time: an edge, a
    leaf, a fence and a surface too dark for the sensor alternate between firings. A waiting object
    arrives and leaves once, and a return from beyond proves that it moved. A firing counts for a
    range (its return), against it (a return from beyond, or none) or not at all (a nearer return).
    The number of changes between firings for and against is compared with that of independent
    firings with the same share (the runs test of Wald and Wolfowitz 1940, with a threshold of 0.7).

    Args:
        cell: (N,) direction of each return, from 0.
        frame: (N,) ascending frame numbers, from 0, in order of time.
        range_m: (N,) ranges, metres.
        intensity: (N,) intensities, nan if unknown.
        cells: number of directions.
        frames: number of frames.
    """
    start = np.zeros(cells + 1, np.int64)
    np.cumsum(np.bincount(cell, minlength=cells), out=start[1:])
    looks = tuple(np.empty(len(cell), kind) for kind in (np.int32, np.float32, np.float32))
    _by_cell(start[:-1].copy(), cell, (frame, range_m, intensity), looks)
    found = [np.zeros((cells, MOST_MODES), np.float32) for _ in range(4)]
    unobstructed = np.full(cells, frames, np.int32)
    _modes(start, looks, frames, tuple(found), unobstructed)
    return RangeModes(found[0], found[1], found[2], found[3], unobstructed)


@numba.njit(cache=True, nogil=True)
def _by_cell(place: Any, cell: Any, given: Any, sorted_: Any) -> None:  # noqa: ANN401
    """Sort returns by cell, and in order of time within a cell."""
    frame, range_m, intensity = given
    to_frame, to_range, to_intensity = sorted_
    for n in range(len(cell)):
        at = place[cell[n]]
        place[cell[n]] += 1
        to_frame[at], to_range[at], to_intensity[at] = frame[n], range_m[n], intensity[n]


@numba.njit(cache=True, nogil=True)
def _fullest(ranges: Any, free: Any) -> Any:  # noqa: ANN401
    """Return the largest number of free ascending ranges of one surface, and its bounds."""
    best, low, high = 0, 0, 0
    count, j = 0, 0
    for i in range(len(ranges)):
        wide = _WIDTH_M + _WIDTH_SHARE * ranges[i]
        while j < len(ranges) and ranges[j] <= ranges[i] + wide:
            count += free[j]
            j += 1
        if free[i] and count >= best:  # the farthest of equally frequent ones
            best, low, high = count, i, j
        count -= free[i]
    return best, low, high


@numba.njit(cache=True, nogil=True)
def _stands(state: Any) -> Any:  # noqa: ANN401
    """Return whether a range with these states of frames (F,) is static, and its share."""
    hits, beyond, lost, changes = 0, 0, 0, 0
    before = _NEARER
    for seen in state:
        if seen == _NEARER:
            continue
        hits += seen == _HIT
        beyond += seen == _BEYOND
        lost += seen == _UNSEEN
        if before != _NEARER and (seen == _HIT) != (before == _HIT):
            changes += 1
        before = seen
    missed = beyond + lost
    total = hits + missed
    if hits < _LEAST_LOOKS or hits < _LEAST_SHARE * total:
        return False, 0.0
    share = hits / total
    if changes >= ALTERNATES * 2.0 * hits * missed / total:
        return share >= _LEAST_BEFORE or beyond < lost, share
    return beyond < max(_LEAST_LOOKS, _LEAST_SHARE * total) and share >= 0.5, share


@numba.njit(cache=True, nogil=True)
def _moments(ranges: Any, light: Any, free: Any) -> Any:  # noqa: ANN401
    """Return mean and deviation of the free ranges, and their mean intensity."""
    total, square, bright, lit, count = 0.0, 0.0, 0.0, 0, 0
    for i in range(len(ranges)):
        if free[i]:
            total += ranges[i]
            count += 1
            if not np.isnan(light[i]):
                bright += light[i]
                lit += 1
    middle = total / count
    for i in range(len(ranges)):
        if free[i]:
            square += (ranges[i] - middle) ** 2
    return middle, np.sqrt(square / count), bright / lit if lit else np.nan


@numba.njit(cache=True, nogil=True)
def _saw(frame: Any, range_m: Any, near: float, far: float, state: Any) -> None:  # noqa: ANN401
    """Write the state of every frame (F,) for the ranges from near to far."""
    state[:] = _UNSEEN
    for k in range(len(frame)):
        seen = _NEARER
        if range_m[k] > far:
            seen = _BEYOND
        elif range_m[k] >= near:
            seen = _HIT
        state[frame[k]] = max(state[frame[k]], seen)


@numba.njit(cache=True, nogil=True)
def _modes(start: Any, looks: Any, frames: int, out: Any, unobstructed: Any) -> None:  # noqa: ANN401
    """Write the modes of every cell."""
    out_range, out_sigma, out_share, out_intensity = out
    state = np.empty(frames, np.uint8)
    # Columns: range, standard deviation, intensity, share.
    mode = np.empty((_TRIES, 4))
    for c in range(len(start) - 1):
        here = slice(start[c], start[c + 1])
        frame, range_m = looks[0][here], looks[1][here]
        order = np.argsort(range_m.astype(np.float64))
        ranges, light = range_m[order], looks[2][here][order]
        free = np.ones(len(ranges), np.bool_)
        found, nearest = 0, np.inf
        for _ in range(_TRIES):
            best, low, high = _fullest(ranges, free)
            if best < _LEAST_LOOKS:
                break
            near, far = ranges[low], ranges[high - 1]
            mode[found, 0], mode[found, 1], mode[found, 2] = _moments(
                ranges[low:high], light[low:high], free[low:high]
            )
            free &= (ranges < near - _GAP_M) | (ranges > far + _GAP_M)
            _saw(frame, range_m, near, far, state)
            still, mode[found, 3] = _stands(state)
            if still:
                found += 1
                if near < nearest:
                    nearest = near
                    unobstructed[c] = (state != _NEARER).sum()
        # A farther mode has its share of the firings that nearer modes let pass.
        left = 1.0
        for i in np.argsort(mode[:found, 0]):
            mode[i, 3] *= left
            left -= mode[i, 3]
        for n, i in enumerate(np.argsort(-mode[:found, 3])[:MOST_MODES]):
            out_range[c, n], out_sigma[c, n] = mode[i, 0], mode[i, 1]
            out_intensity[c, n], out_share[c, n] = mode[i, 2], mode[i, 3]
