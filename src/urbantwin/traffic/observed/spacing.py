"""Detection of gaps between frames without given times.

Frames of published data are often an uneven selection from a longer recording. Moving objects
reveal it: an object that left its place is one step farther in the next frame if that is 1/rate
later, and anywhere after a gap. How often another object is found there by chance follows from
frames far apart in the same recording.

Both give the likelihoods for each pair of frames. The share of pairs with a gap is estimated with
them (expectation maximisation; Dempster, Laird and Rubin, Journal of the Royal Statistical Society
B 39, 1977), so that pairs without moving objects follow the others.
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

#: Objects within this distance, metres, have stayed and give no evidence, if frames are at least
#: this far apart, seconds, so that a pedestrian moves farther. At higher rates all objects count.
_STATIONARY_M, _STEP_S = 0.4, 0.3
#: Maximum difference in height, and in diagonal, of the same object, metres: small, large.
_MAX_HEIGHT_DIFFERENCE_M, _MAX_DIAGONAL_DIFFERENCE_M = (0.15, 0.2), (0.6, 1.5)
#: Maximum angle between a vehicle's long side and its motion, radians, and least motion for that
#: test, metres.
_AXIS_TOLERANCE_RAD, _AXIS_TEST_M = np.radians(30.0), 1.0
#: Least number of points of an object, maximum distance from its sensor, metres, and least share of
#: moving points.
_MIN_POINTS, _REACH_M, _MIN_MOVING_SHARE = 10, 40.0, 0.5
#: Shares in consecutive frames of small and of large objects that left their place: found within a
#: pedestrian's step, within a rider's, and not found. From simulated places, on which the other
#: constants were fitted, too (docs/howto/recorded_traffic.md).
_SHARES_IN_SEQUENCE = np.array([[0.5, 0.2, 0.3], [0.8, 0.0, 0.2]])
#: Weight of these shares, as a number of objects.
_SHARES_WEIGHT = 100.0
#: The same shares by chance, as a prior; and its weight, as a number of objects.
_SHARES_BY_CHANCE, _CHANCE_WEIGHT = np.array([[0.2, 0.1, 0.7], [0.3, 0.0, 0.7]]), 5.0
#: Number of pairs of frames for the shares by chance, and their least distance in frames.
_CHANCE_PAIRS, _CHANCE_DISTANCE = 60, 3
#: Prior numbers of pairs with and without a gap, and least gain of log-likelihood for any gaps.
_PRIOR_GAPS, _PRIOR_WITHOUT_GAP, _MIN_GAIN = 0.1, 2.0, 3.0
_ROUNDS, _FIRST_SHARE = 100, 0.3
#: Least argument of a logarithm, and maximum evidence.
_MIN_PROBABILITY, _MAX_EVIDENCE = 1e-12, 50.0


@dataclass(frozen=True, eq=False)
class _Objects:
    """The N objects of a frame that give evidence.

    Attributes:
        place: (N, 2) centres, metres.
        top: (N,) metres above the ground.
        diagonal: (N,) metres.
        way: (N,) direction of the longer side, radians.
        outline: (N,) numbers of outlines, 0 for none.
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
    """Return the times of frames, with gaps detected from moving objects.

    Args:
        frames: the objects of each frame.
        rate_hz: frame rate without gaps.
    """
    evenly = evenly_spaced(len(frames), rate_hz)
    if 1 / rate_hz > LONGEST_S or len(frames) < _CHANCE_DISTANCE + 2:
        return evenly
    frame_objects = [_clear_objects(frame) for frame in frames]
    count, seconds = len(frame_objects), 1 / rate_hz
    apart = max(_CHANCE_DISTANCE, count // 4)
    pairs = [(first, other) for first in range(count) for other in range(first + apart, count)]
    chance = _CHANCE_WEIGHT * _SHARES_BY_CHANCE + sum(
        _transition_counts(frame_objects[first], frame_objects[other], seconds)
        for first, other in pairs[:: max(1, len(pairs) // _CHANCE_PAIRS)]
    )
    counted = np.array([_transition_counts(*pair, seconds) for pair in pairwise(frame_objects)])
    likely = _gaps(counted, chance / chance.sum(axis=1, keepdims=True))
    gap = likely > 0.5
    return FrameTimes(evenly.time_s, gap, np.where(gap, likely, 1 - likely))


def _clear_objects(objects: Sequence[SeenObject]) -> _Objects:
    clear = [
        item
        for item in objects
        if len(item.points) >= _MIN_POINTS
        and (item.moves >= _MIN_MOVING_SHARE or item.diagonal > LARGE_M)
        and np.linalg.norm(item.middle - item.sensor) < _REACH_M
    ]
    names = {"pedestrian": 1, "bicycle": 2}
    return _Objects(
        np.array([item.middle for item in clear]).reshape(-1, 2),
        np.array([item.top for item in clear]),
        np.array([item.diagonal for item in clear]),
        np.array([item.long_way for item in clear]),
        np.array(
            [names.get(item.silhouette or "", 3 * (item.diagonal > LARGE_M)) for item in clear],
            np.int64,
        ),
    )


def _transition_counts(one: _Objects, other: _Objects, seconds: float) -> NDArray[np.float64]:
    """Count objects that left their place: within a pedestrian's step, a rider's, and lost.

    The result (2, 3) is for small and large objects; large ones within a vehicle's range count as
    the first. An object in one frame alone counts as half.
    """
    step = other.place[None] - one.place[:, None]
    moved_m = np.linalg.norm(step, axis=2)
    large = np.maximum(one.diagonal[:, None], other.diagonal) > LARGE_M
    fits = moved_m <= np.where(large, DRIVES_M_S, RIDES_M_S) * seconds + ERROR_M
    alike = fits.copy()
    for values, other_values, most in (
        (one.diagonal, other.diagonal, _MAX_DIAGONAL_DIFFERENCE_M),
        (one.top, other.top, _MAX_HEIGHT_DIFFERENCE_M),
    ):
        alike &= np.abs(values[:, None] - other_values) < np.where(large, most[1], most[0])
    both = (one.outline[:, None] > 0) & (other.outline > 0)
    fits &= ~(both & (one.outline[:, None] != other.outline) & (moved_m > 2 * ERROR_M))
    walks = (one.outline[:, None] == 1) & (other.outline == 1)
    fits &= ~(walks & (moved_m > WALKS_M_S * seconds + ERROR_M))
    heading = np.arctan2(step[..., 1], step[..., 0])
    for side in (one.way[:, None], other.way[None]):
        off = np.abs(wrapped(2 * (heading - side))) / 2
        fits &= ~(large & (moved_m > _AXIS_TEST_M) & (off > _AXIS_TOLERANCE_RAD))
    # A unique candidate is the same object, despite differences by rings and hidden parts.
    alone = (fits.sum(axis=0) == 1) & (fits.sum(axis=1, keepdims=True) == 1)
    fits &= alike | alone
    cost = np.where(fits, moved_m, np.inf)
    stays = _STATIONARY_M if seconds > _STEP_S else 0.0
    still, still_later = _matched(np.where(cost < stays, cost, np.inf))
    disappeared = ~np.isin(np.arange(len(one.top)), still)
    appeared = ~np.isin(np.arange(len(other.top)), still_later)
    counts = []
    for kind in (False, True):
        among = cost[np.ix_(disappeared & (one.large == kind), appeared & (other.large == kind))]
        pair_distances = among[_matched(among)]
        nearby = (
            len(pair_distances)
            if kind
            else int((pair_distances <= WALKS_M_S * seconds + ERROR_M).sum())
        )
        alone = sum(among.shape) / 2 - len(pair_distances)
        counts.append([nearby, len(pair_distances) - nearby, alone])
    return np.array(counts, np.float64)


def _matched(cost: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows and columns of a minimum-cost assignment, without infinite costs."""
    far = 1e3
    rows, columns = linear_sum_assignment(np.minimum(cost, far))
    is_finite = cost[rows, columns] < far
    return rows[is_finite], columns[is_finite]


def _gaps(counted: NDArray[np.float64], chance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the probability of a gap for each of N pairs; 0 for all if gaps explain hardly more.

    Args:
        counted: (N, 2, 3) results of `_transition_counts`.
        chance: (2, 3) shares of the same by chance.
    """
    by_chance = (counted * np.log(chance + _MIN_PROBABILITY)).sum(axis=(1, 2))
    fits = [_fitted(counted, chance, by_chance, share) for share in (_FIRST_SHARE, 0.0)]
    return fits[0][0] if fits[0][1] - fits[1][1] > _MIN_GAIN else np.zeros(len(counted))


def _fitted(
    counted: NDArray[np.float64],
    chance: NDArray[np.float64],
    by_chance: NDArray[np.float64],
    share: float,
) -> tuple[NDArray[np.float64], float]:
    """Return the probability of a gap for each pair, and the log-likelihood of all.

    Args:
        counted: (N, 2, 3) results of `_transition_counts`.
        chance: (2, 3) shares of the same by chance.
        by_chance: (N,) log-likelihoods with a gap.
        share: initial share of pairs with a gap; 0 for no gaps at all.
    """
    follows, even = _SHARES_IN_SEQUENCE, share == 0.0
    for _ in range(_ROUNDS):
        at_once = (counted * np.log(follows + _MIN_PROBABILITY)).sum(axis=(1, 2))
        ratio = np.exp(np.clip(at_once - by_chance, -_MAX_EVIDENCE, _MAX_EVIDENCE))
        likely = share / (share + (1 - share) * ratio)
        if not even:
            share = (likely.sum() + _PRIOR_GAPS) / (len(counted) + _PRIOR_GAPS + _PRIOR_WITHOUT_GAP)
        seen = (counted * (1 - likely)[:, None, None]).sum(
            axis=0
        ) + _SHARES_WEIGHT * _SHARES_IN_SEQUENCE
        follows = seen / seen.sum(axis=1, keepdims=True)
        # At most halfway to chance, else gaps between all frames would look like none.
        halfway = (_SHARES_IN_SEQUENCE + chance) / 2
        follows = np.where(follows[:, 2:] > halfway[:, 2:], halfway, follows)
    with np.errstate(divide="ignore"):
        log_likelihood = np.logaddexp(np.log(share) + by_chance, np.log(1 - share) + at_once).sum()
    return likely, float(
        log_likelihood
        + _SHARES_WEIGHT * (_SHARES_IN_SEQUENCE * np.log(follows + _MIN_PROBABILITY)).sum()
    )
