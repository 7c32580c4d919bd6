"""Which frames follow each other at once, and which after a gap, where nobody says when they were.

Frames of published data are often a choice of a longer recording, and not an even one. What moves
tells: who is no longer in place is a step farther in the next frame if that is 1/rate later, and
anywhere after a gap. How often somebody else is found there by chance, frames tell that are far
apart in the same recording. Both give the likelihoods of each pair of frames; how many pairs have a
gap is found with them (expectation maximisation; Dempster, Laird and Rubin, Journal of the Royal
Statistical Society B 39, 1977), so that what nobody's movement tells is decided by the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from urbantwin.geometry import wrapped
from urbantwin.traffic.observed.association import (
    DRIVES_M_S,
    ERROR_M,
    LARGE_M,
    RIDES_M_S,
    WALKS_M_S,
)
from urbantwin.traffic.observed.box_fit import SeenObject
from urbantwin.traffic.observed.frame_times import LONGEST_S, FrameTimes, evenly_spaced

__all__ = ["found_times"]

#: Who is as near as this is still in place, metres, and tells of no gap: where frames are so far
#: apart, seconds, that who walks is farther. Where they are not, everybody is asked.
_STAYS_M, _STEP_S = 0.4, 0.3
#: The same object is not taller, or longer from corner to corner, by more, metres: small, large.
_TALLER_M, _LONGER_M = (0.15, 0.2), (0.6, 1.5)
#: A vehicle moves along its sides, radians, once it has moved so far, metres.
_ALONG, _MOVED_M = np.radians(30.0), 1.0
#: Objects are asked of which so many points were seen, not farther from their sensor, metres, and
#: of which so many of the points moved.
_POINTS, _REACH_M, _MOVES = 10, 40.0, 0.5
#: Of small ones that left their place, the shares a walker's step away, a rider's, and elsewhere,
#: and of large ones, in frames that follow each other: of simulated places, where all else was
#: fitted as well (docs/howto/recorded_traffic.md).
_FOLLOWS = np.array([[0.5, 0.2, 0.3], [0.8, 0.0, 0.2]])
#: They are as good as so many objects of the recording itself.
_KNOWN = 100.0
#: The same by chance, where a recording says nothing of it; as good as so many objects.
_CHANCE, _SUPPOSED = np.array([[0.2, 0.1, 0.7], [0.3, 0.0, 0.7]]), 5.0
#: Chance is told by so many pairs of frames, at least so many frames apart.
_CHANCE_PAIRS, _APART = 60, 3
#: Pairs with a gap and without that are supposed beforehand, and the logarithm of the likelihood
#: that must be gained by gaps for there to be any.
_GAPS, _NONE, _GAINED = 0.1, 2.0, 3.0
_ROUNDS, _FIRST = 100, 0.3
#: Instead of nothing in a logarithm; and what no evidence exceeds.
_NEVER, _MOST = 1e-12, 50.0


@dataclass(frozen=True, eq=False)
class _Objects:
    """What is asked of the N objects of a frame.

    Attributes:
        place: (N, 2) of their middles, metres.
        top: (N,) metres above the ground.
        diagonal: (N,) from corner to corner, metres.
        way: (N,) of the longer side, radians.
        outline: (N,) numbers of outlines, 0 where there is none.
    """

    place: NDArray[np.float64]
    top: NDArray[np.float64]
    diagonal: NDArray[np.float64]
    way: NDArray[np.float64]
    outline: NDArray[np.int64]

    @property
    def large(self) -> NDArray[np.bool_]:
        return self.diagonal > LARGE_M


def found_times(frames: Sequence[Sequence[SeenObject]], rate_hz: float) -> FrameTimes:
    """Return which frames follow each other at once, by what moves in them.

    Args:
        frames: the objects of each.
        rate_hz: frames per second where there is no gap.
    """
    evenly = evenly_spaced(len(frames), rate_hz)
    if 1 / rate_hz > LONGEST_S or len(frames) < _APART + 2:
        return evenly
    asked = [_asked(one) for one in frames]
    count, seconds = len(asked), 1 / rate_hz
    apart = max(_APART, count // 4)
    pairs = [(first, other) for first in range(count) for other in range(first + apart, count)]
    chance = _SUPPOSED * _CHANCE + sum(
        _counted(asked[first], asked[other], seconds)
        for first, other in pairs[:: max(1, len(pairs) // _CHANCE_PAIRS)]
    )
    counted = np.array([_counted(*pair, seconds) for pair in pairwise(asked)])
    likely = _gaps(counted, chance / chance.sum(axis=1, keepdims=True))
    gap = likely > 0.5
    return FrameTimes(evenly.time_s, gap, np.where(gap, likely, 1 - likely))


def _asked(objects: Sequence[SeenObject]) -> _Objects:
    kept = [
        one
        for one in objects
        if len(one.points) >= _POINTS
        and (one.moves >= _MOVES or one.diagonal > LARGE_M)
        and np.linalg.norm(one.middle - one.sensor) < _REACH_M
    ]
    names = {"pedestrian": 1, "bicycle": 2}
    return _Objects(
        np.array([one.middle for one in kept]).reshape(-1, 2),
        np.array([one.top for one in kept]),
        np.array([one.diagonal for one in kept]),
        np.array([one.long_way for one in kept]),
        np.array(
            [names.get(one.silhouette or "", 3 * (one.diagonal > LARGE_M)) for one in kept],
            np.int64,
        ),
    )


def _counted(one: _Objects, other: _Objects, seconds: float) -> NDArray[np.float64]:
    """Return how many left their place and are a walker's step, a rider's and not to be found.

    Of small and of large objects (2, 3); large ones drive a vehicle's way, which counts as the
    first. Who is in one frame alone is half an object.
    """
    way = other.place[None] - one.place[:, None]
    gone = np.linalg.norm(way, axis=2)
    large = np.maximum(one.diagonal[:, None], other.diagonal) > LARGE_M
    fits = gone <= np.where(large, DRIVES_M_S, RIDES_M_S) * seconds + ERROR_M
    alike = fits.copy()
    for mine, its, most in (
        (one.diagonal, other.diagonal, _LONGER_M),
        (one.top, other.top, _TALLER_M),
    ):
        alike &= np.abs(mine[:, None] - its) < np.where(large, most[1], most[0])
    both = (one.outline[:, None] > 0) & (other.outline > 0)
    fits &= ~(both & (one.outline[:, None] != other.outline) & (gone > 2 * ERROR_M))
    walks = (one.outline[:, None] == 1) & (other.outline == 1)
    fits &= ~(walks & (gone > WALKS_M_S * seconds + ERROR_M))
    heading = np.arctan2(way[..., 1], way[..., 0])
    for side in (one.way[:, None], other.way[None]):
        off = np.abs(wrapped(2 * (heading - side))) / 2
        fits &= ~(large & (gone > _MOVED_M) & (off > _ALONG))
    # Who has nobody else in reach is the same, whatever rings and hidden parts make of it.
    alone = (fits.sum(axis=0) == 1) & (fits.sum(axis=1, keepdims=True) == 1)
    fits &= alike | alone
    cost = np.where(fits, gone, np.inf)
    stays = _STAYS_M if seconds > _STEP_S else 0.0
    still, kept = _matched(np.where(cost < stays, cost, np.inf))
    left = ~np.isin(np.arange(len(one.top)), still)
    came = ~np.isin(np.arange(len(other.top)), kept)
    found = []
    for kind in (False, True):
        among = cost[np.ix_(left & (one.large == kind), came & (other.large == kind))]
        met = among[_matched(among)]
        near = len(met) if kind else int((met <= WALKS_M_S * seconds + ERROR_M).sum())
        alone = sum(among.shape) / 2 - len(met)
        found.append([near, len(met) - near, alone])
    return np.array(found, np.float64)


def _matched(cost: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows and columns of pairs at the least cost; those of infinite cost are none."""
    far = 1e3
    rows, columns = linear_sum_assignment(np.minimum(cost, far))
    kept = cost[rows, columns] < far
    return rows[kept], columns[kept]


def _gaps(counted: NDArray[np.float64], chance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how likely each of N pairs has a gap; 0 for all where gaps explain hardly more.

    Args:
        counted: (N, 2, 3) what `_counted` says of each.
        chance: (2, 3) shares of the same that chance makes.
    """
    by_chance = (counted * np.log(chance + _NEVER)).sum(axis=(1, 2))
    found = [_fitted(counted, chance, by_chance, share) for share in (_FIRST, 0.0)]
    return found[0][0] if found[0][1] - found[1][1] > _GAINED else np.zeros(len(counted))


def _fitted(
    counted: NDArray[np.float64],
    chance: NDArray[np.float64],
    by_chance: NDArray[np.float64],
    share: float,
) -> tuple[NDArray[np.float64], float]:
    """Return how likely each pair has a gap, and the logarithm of the likelihood of all.

    Args:
        counted: (N, 2, 3) what `_counted` says of each.
        chance: (2, 3) shares of the same that chance makes.
        by_chance: (N,) logarithms of the likelihoods with a gap.
        share: of pairs with a gap, to begin with; 0 for no gaps at all.
    """
    follows, even = _FOLLOWS, share == 0.0
    for _ in range(_ROUNDS):
        at_once = (counted * np.log(follows + _NEVER)).sum(axis=(1, 2))
        ratio = np.exp(np.clip(at_once - by_chance, -_MOST, _MOST))
        likely = share / (share + (1 - share) * ratio)
        if not even:
            share = (likely.sum() + _GAPS) / (len(counted) + _GAPS + _NONE)
        seen = (counted * (1 - likely)[:, None, None]).sum(axis=0) + _KNOWN * _FOLLOWS
        follows = seen / seen.sum(axis=1, keepdims=True)
        # No nearer to chance than halfway: else a gap between all frames were none.
        halfway = (_FOLLOWS + chance) / 2
        follows = np.where(follows[:, 2:] > halfway[:, 2:], halfway, follows)
    with np.errstate(divide="ignore"):
        every = np.logaddexp(np.log(share) + by_chance, np.log(1 - share) + at_once).sum()
    return likely, float(every + _KNOWN * (_FOLLOWS * np.log(follows + _NEVER)).sum())
