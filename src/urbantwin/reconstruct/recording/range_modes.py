"""Modes of range: where the static world stands in a direction, from many looks along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["ALTERNATES", "MOST_MODES", "RangeModes", "range_modes"]

#: The edge of a pole before a fence before a house: a direction has so many ranges at most.
MOST_MODES = 3
#: Ranges of one surface lie within this, and within this share of them (slanting ground).
_WIDTH_M, _WIDTH_SHARE = 0.5, 0.01
#: Between two modes there is a gap this wide, metres.
_GAP_M = 0.25
#: A mode has looks in so many frames and in this share of those that could see it.
_LEAST_LOOKS, _LEAST_SHARE = 2, 0.05
#: What stands before something else has this share: in the same lane, cars come by at one range.
_LEAST_BEFORE = 0.3
#: What comes and goes at random alternates this often, of what independent looks would.
ALTERNATES = 0.7
#: Candidates that are looked at in one direction.
_TRIES = 6
_UNSEEN, _NEARER, _BEYOND, _HIT = 0, 1, 2, 3


@dataclass(frozen=True, eq=False)
class RangeModes:
    """The static ranges of C directions, the most frequent first; share 0 where there is none.

    Attributes:
        range_m: (C, 3) float32, metres.
        sigma_m: (C, 3) float32, standard deviation, metres.
        share: (C, 3) float32, of the looks that nothing passing by obstructs, those that came
            back from there. Their sum is below 1 where looks are lost.
        intensity: (C, 3) float32, mean; nan where unknown.
        looks: (C,) int32, frames in which nothing stood before the nearest of them.
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
    """Return the ranges at which something always stands, of every direction.

    A range that many looks share stands still if looks that pass it by are rare or scattered over
    time: an edge, a leaf, a fence and a surface too dark for the sensor come and go from one look
    to the next. What waits comes once and goes once, and a look beyond it proves that it moved.
    So a look counts for a range (it came back from there), against it (it came back from beyond,
    or not at all) or not at all (something nearer was in the way), and the changes between looks
    for and against are held against those of independent looks with the same share (the runs test
    of Wald and Wolfowitz 1940, with a threshold of 0.7).

    Args:
        cell: (N,) direction of each look, from 0.
        frame: (N,) ascending numbers of frames, from 0, in the order of time.
        range_m: (N,) metres.
        intensity: (N,) nan where it is not known.
        cells: how many directions there are.
        frames: how many frames there are.
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
    """Sort looks by cell, those of a cell in the order of time."""
    frame, range_m, intensity = given
    to_frame, to_range, to_intensity = sorted_
    for n in range(len(cell)):
        at = place[cell[n]]
        place[cell[n]] += 1
        to_frame[at], to_range[at], to_intensity[at] = frame[n], range_m[n], intensity[n]


@numba.njit(cache=True, nogil=True)
def _fullest(ranges: Any, free: Any) -> Any:  # noqa: ANN401
    """Return how many free ones of ascending ranges one surface holds at most, and where."""
    best, low, high = 0, 0, 0
    count, j = 0, 0
    for i in range(len(ranges)):
        wide = _WIDTH_M + _WIDTH_SHARE * ranges[i]
        while j < len(ranges) and ranges[j] <= ranges[i] + wide:
            count += free[j]
            j += 1
        if free[i] and count >= best:  # Of equally frequent ones the farthest.
            best, low, high = count, i, j
        count -= free[i]
    return best, low, high


@numba.njit(cache=True, nogil=True)
def _stands(state: Any) -> Any:  # noqa: ANN401
    """Return whether what frames saw of a range (F,) stands still, and its share of the looks."""
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
    """Return mean and deviation of the free ones of ranges, and the mean of their intensity."""
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
    """Write what every frame (F,) saw of the ranges from near to far."""
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
    # Of each mode: range, standard deviation, intensity, share.
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
        # Of looks that a nearer mode lets through a farther one has its share.
        left = 1.0
        for i in np.argsort(mode[:found, 0]):
            mode[i, 3] *= left
            left -= mode[i, 3]
        for n, i in enumerate(np.argsort(-mode[:found, 3])[:MOST_MODES]):
            out_range[c, n], out_sigma[c, n] = mode[i, 0], mode[i, 1]
            out_intensity[c, n], out_share[c, n] = mode[i, 2], mode[i, 3]
