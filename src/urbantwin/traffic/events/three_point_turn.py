"""Turning round where a street is too narrow for one sweep: forward, back, and forward again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.events.lane_way import Way
from urbantwin.traffic.events.places import Spot

__all__ = ["TurnInThree", "turn_in_three"]

#: Turned so far when the far kerb is reached, rad.
_FIRST = np.radians(75.0)
#: Mean speed between two reversals, m/s; pause at each, s; braking before and speeding up after.
_PACE_MS, _PAUSE_S, _GENTLE_MS2 = 1.5, 0.8, 2.0
_EVERY_M, _EVERY_S = 0.1, 0.1


class TurnInThree(NamedTuple):
    """Where somebody is who turns round in three moves.

    Attributes:
        time_s: (N,) from when the second move, backwards, is half done.
        xy: (N, 2) site frame, metres.
        yaw: (N,) where it faces, rad, without leaps.
        moves: (M, 2) places of the three moves alone.
    """

    time_s: NDArray[np.float64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    moves: NDArray[np.float64]


def turn_in_three(
    spot: Spot, back: Spot, radius: float, before: Way, away: Way, speed: float
) -> TurnInThree | None:
    """Return a turn of three moves on circles of one radius; ``None`` where none leads back.

    Turned by a and then by b, it has moved across by R (1 - cos a), back by R (cos a - cos b), and
    on by R (1 + cos b): together 2 R (1 - cos a + cos b), which is how far the lanes are apart.

    Args:
        spot: where it begins, on the way there.
        back: a place on the lane that leads back.
        radius: of the middle of the vehicle, metres.
        before: the way to the spot.
        away: the way onwards from the place on the lane back.
        speed: on both, m/s.
    """
    ahead = np.array([np.cos(spot.yaw), np.sin(spot.yaw)])
    left = np.array([-ahead[1], ahead[0]])
    across = float((back.xy - spot.xy) @ left)
    side, apart = np.sign(across), abs(across)
    cosine = np.cos(_FIRST) - 1.0 + apart / (2 * radius)
    if not -0.95 < cosine < np.cos(_FIRST):
        return None
    second = float(np.arccos(cosine))
    pieces: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    x = y = 0.0
    for first, last, way in ((0.0, _FIRST, 1.0), (_FIRST, second, -1.0), (second, np.pi, 1.0)):
        count = max(int((last - first) * radius / _EVERY_M), 4)
        turned = np.linspace(first, last, count + 1)
        local = np.column_stack(
            [
                x + way * radius * (np.sin(turned) - np.sin(first)),
                y + way * radius * (np.cos(first) - np.cos(turned)),
            ]
        )
        x, y = local[-1]
        xy = spot.xy + local[:, :1] * ahead + side * local[:, 1:] * left
        pieces.append((xy, spot.yaw + side * turned))
    facing = np.array([np.cos(back.yaw), np.sin(back.yaw)])
    onwards = away.points[(away.points - pieces[-1][0][-1]) @ facing > 0.4]
    if len(onwards) < 2:
        return None
    times, places, yaws = _line(before, speed, stops=True)
    clock = float(times[-1]) + _PAUSE_S
    middle_s = clock
    for number, (xy, yaw) in enumerate(pieces):
        lasts = len(xy) * _EVERY_M / _PACE_MS
        share = np.linspace(0.0, 1.0, max(int(lasts / _EVERY_S), 4) + 1)
        done = (1 - np.cos(np.pi * share)) / 2 * (len(xy) - 1)
        rows = np.arange(len(xy))
        times = np.append(times, clock + share * lasts)
        places = np.vstack(
            [places, *[np.column_stack([np.interp(done, rows, one) for one in xy.T])]]
        )
        yaws = np.append(yaws, np.interp(done, rows, yaw))
        if number == 1:
            middle_s = clock + lasts / 2
        clock += lasts + _PAUSE_S
    last_times, last_places, last_yaws = _line(Way(onwards), speed, stops=False)
    times = np.append(times, clock + last_times)
    places = np.vstack([places, last_places])
    yaws = np.unwrap(np.append(yaws, last_yaws))
    moves = np.vstack([xy for xy, _ in pieces])
    return TurnInThree(times - middle_s, places, yaws, moves)


def _line(
    way: Way, speed: float, *, stops: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return times (N,), places and headings of who goes along a way and stops or sets off there.

    Times begin at 0.
    """
    gentle_m = min(speed * speed / (2 * _GENTLE_MS2), way.length)
    gentle_s = np.sqrt(2 * gentle_m / _GENTLE_MS2)
    even_s = (way.length - gentle_m) / speed
    times = np.linspace(0.0, even_s + gentle_s, max(int((even_s + gentle_s) / _EVERY_S), 2) + 1)
    off = times if not stops else times[-1] - times
    gone = np.where(
        off < gentle_s,
        _GENTLE_MS2 * off**2 / 2,
        gentle_m + np.maximum(off - gentle_s, 0.0) * speed,
    )
    station = way.length - gone if stops else gone
    heading = np.array([way.heading(float(one)) for one in station])
    return times, way.at(station), np.unwrap(heading)
