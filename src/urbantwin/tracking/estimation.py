"""State estimation of tracked road users: filtering, and smoothing with later detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.tracking.kalman import SEEN, STATE, begun, corrected, predicted, smoothed
from urbantwin.tracking.road_user import RoadUser

__all__ = ["Estimate", "estimates", "fronted"]

#: Distance travelled, metres, and speed, m/s, from which motion determines the front.
_MIN_TRAVEL_M, _MIN_SPEED_M_S = 2.0, 0.5
#: Distance up to which a track may be reversing, metres, if this share of its detections says so.
_MAX_REVERSING_M, _REVERSING_SHARE = 12.0, 0.75

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimate:
    """One track, at every frame from its first to its last.

    Attributes:
        frame: (K,) consecutive numbers of frames.
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
    """Return the estimated states of the tracks of one group.

    Args:
        frames: for each track, the frames of its detections, ascending.
        seen: for each track, its detections: x, y, height of the underside, yaw (n, 4).
        user: their motion model.
        time_s: (all frames,) seconds.
        smooth: whether later detections are used, too; else states depend on the past alone.
    """
    if not frames:
        return []
    first = np.array([track_frames[0] for track_frames in frames])
    long = np.array([track_frames[-1] - track_frames[0] + 1 for track_frames in frames])
    # The longest first, so that the tracks that continue at a step are the first rows of all
    # arrays.
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
        detected = np.flatnonzero(np.isfinite(look[:on, step, 0]))
        state[detected, step], covariance[detected, step] = corrected(
            state[detected, step], covariance[detected, step], look[detected, step], user
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
        track_state = state[row, : long[row]]
        velocity = track_state[:, 4:6]
        if user.turns:
            ahead = np.column_stack([np.cos(track_state[:, 3]), np.sin(track_state[:, 3])])
            velocity = track_state[:, 4:5] * ahead
        frame = first[row] + np.arange(long[row])
        made[number] = Estimate(frame, track_state[:, :SEEN].copy(), velocity.copy())
    return [estimate for estimate in made if estimate is not None]


def fronted(
    one: Estimate, frame: NDArray[np.int64], yaw: Floats, weight: Floats, user: RoadUser
) -> Floats:
    """Return headings (K,) with the front ahead; the filters estimate axes without a front.

    A wheeled road user has one front for its whole track: the end in the direction of motion.
    Exceptions are consistent detections against it on a path of a few metres, as at parking spaces;
    and static ones, for which the majority of detections decides. Pedestrians turn round: while
    walking they face the direction of motion.

    Args:
        one: the track.
        frame: (n,) frames of its detections.
        yaw: (n,) detected headings.
        weight: (n,) weights of the detections.
        user: its motion model.
    """
    axis = one.state[:, 3]
    facing = np.cos(yaw - axis[frame - one.frame[0]])
    votes = float((weight * facing).sum())
    ahead = one.velocity[:, 0] * np.cos(axis) + one.velocity[:, 1] * np.sin(axis)
    steps = np.diff(one.state[:, :2], axis=0)
    half = axis[:-1] + wrapped(np.diff(axis)) / 2
    travelled_m = float((steps[:, 0] * np.cos(half) + steps[:, 1] * np.sin(half)).sum())
    agree = float(weight[np.sign(facing) == np.sign(votes)].sum()) / max(float(weight.sum()), 1e-9)
    backs = abs(travelled_m) < _MAX_REVERSING_M and agree > _REVERSING_SHARE and len(yaw) > 3
    front = (
        np.sign(travelled_m)
        if abs(travelled_m) > _MIN_TRAVEL_M and not backs
        else (np.sign(votes) or 1.0)
    )
    turned = np.full(len(axis), front)
    if not user.turns:
        goes = np.abs(ahead) > _MIN_SPEED_M_S
        if goes.any():
            moving_rows = np.flatnonzero(goes)
            nearest = moving_rows[
                np.abs(np.arange(len(axis))[:, None] - moving_rows[None]).argmin(axis=1)
            ]
            turned = np.sign(ahead)[nearest]
    return np.asarray(wrapped(axis + np.where(turned < 0, np.pi, 0.0)))
