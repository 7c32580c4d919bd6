"""Where tracked road users were: their detections filtered, and smoothed by what came later."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.tracking.kalman import SEEN, STATE, begun, corrected, predicted, smoothed
from urbantwin.tracking.road_user import RoadUser

__all__ = ["Estimate", "estimates", "fronted"]

#: Who came farther than this goes ahead, metres; who is faster than this does, m/s.
_GONE_M, _GOES_M_S = 2.0, 0.5
#: Who came no farther than this may have gone backwards, if so many of its detections say so.
_BACKS_M, _AGREE = 12.0, 0.75

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimate:
    """One track, at every frame from its first to its last.

    Attributes:
        frame: (K,) numbers of frames, one after the other.
        state: (K, 4) x, y, height of the underside, yaw.
        velocity: (K, 2) m/s in x and y.
    """

    frame: NDArray[np.int64]
    state: Floats
    velocity: Floats


def estimates(
    frames: Sequence[NDArray[np.int64]],
    seen: Sequence[Floats],
    user: RoadUser,
    time_s: Floats,
    *,
    smooth: bool,
) -> list[Estimate]:
    """Return where tracks of one group were.

    Args:
        frames: of each track, the frames in which it was seen, ascending.
        seen: of each track, what was seen then: x, y, height of the underside, yaw (n, 4).
        user: how they move.
        time_s: (all frames,) seconds.
        smooth: whether what came later tells, too; else every state is of the past alone.
    """
    if not frames:
        return []
    first = np.array([one[0] for one in frames])
    long = np.array([one[-1] - one[0] + 1 for one in frames])
    # The longest first: those that go on at a step are the first rows of all arrays.
    order = np.argsort(-long, kind="stable")
    first, long = first[order], long[order]
    look = np.full((len(order), long[0], SEEN), np.nan)
    for row, number in enumerate(order):
        look[row, frames[number] - first[row]] = seen[number]
    state = np.zeros((len(order), long[0], STATE))
    covariance = np.zeros((len(order), long[0], STATE, STATE))
    foreseen = []
    state[:, 0], covariance[:, 0] = begun(look[:, 0], user)
    for step in range(1, int(long[0])):
        on = int((long > step).sum())
        seconds = time_s[first[:on] + step] - time_s[first[:on] + step - 1]
        expected = predicted(state[:on, step - 1], covariance[:on, step - 1], seconds, user)
        state[:on, step], covariance[:on, step] = expected[:2]
        there = np.flatnonzero(np.isfinite(look[:on, step, 0]))
        state[there, step], covariance[there, step] = corrected(
            state[there, step], covariance[there, step], look[there, step], user
        )
        foreseen.append(expected)
    if smooth:
        for step in range(int(long[0]) - 2, -1, -1):
            on = len(foreseen[step][0])
            state[:on, step] = smoothed(
                state[:on, step], covariance[:on, step], state[:on, step + 1], foreseen[step]
            )
    made: list[Estimate | None] = [None] * len(order)
    for row, number in enumerate(order):
        mine = state[row, : long[row]]
        velocity = mine[:, 4:6]
        if user.turns:
            ahead = np.column_stack([np.cos(mine[:, 3]), np.sin(mine[:, 3])])
            velocity = mine[:, 4:5] * ahead
        frame = first[row] + np.arange(long[row])
        made[number] = Estimate(frame, mine[:, :SEEN].copy(), velocity.copy())
    return [one for one in made if one is not None]


def fronted(
    one: Estimate, frame: NDArray[np.int64], yaw: Floats, weight: Floats, user: RoadUser
) -> Floats:
    """Return headings (K,) with their fronts ahead; filters follow axes, which have none.

    What moves on wheels has one front all its way: the end with which it goes, but detections
    that agree against it where it came a few metres only, as in and out of parking places; of what
    stands, the end that most of them say. People turn round: where they walk they look ahead.

    Args:
        one: the track.
        frame: (n,) in which it was seen.
        yaw: (n,) as detected.
        weight: (n,) of each.
        user: how it moves.
    """
    axis = one.state[:, 3]
    facing = np.cos(yaw - axis[frame - one.frame[0]])
    votes = float((weight * facing).sum())
    ahead = one.velocity[:, 0] * np.cos(axis) + one.velocity[:, 1] * np.sin(axis)
    steps = np.diff(one.state[:, :2], axis=0)
    half = axis[:-1] + wrapped(np.diff(axis)) / 2
    gone = float((steps[:, 0] * np.cos(half) + steps[:, 1] * np.sin(half)).sum())
    agree = float(weight[np.sign(facing) == np.sign(votes)].sum()) / max(float(weight.sum()), 1e-9)
    backs = abs(gone) < _BACKS_M and agree > _AGREE and len(yaw) > 3
    front = np.sign(gone) if abs(gone) > _GONE_M and not backs else (np.sign(votes) or 1.0)
    turned = np.full(len(axis), front)
    if not user.turns:
        goes = np.abs(ahead) > _GOES_M_S
        if goes.any():
            at = np.flatnonzero(goes)
            nearest = at[np.abs(np.arange(len(axis))[:, None] - at[None]).argmin(axis=1)]
            turned = np.sign(ahead)[nearest]
    return np.asarray(wrapped(axis + np.where(turned < 0, np.pi, 0.0)))
