"""Retiming: the same way, driven later and as its class can drive.

A way is a place as a function of time. Here only the time changes: at each step the actor goes as
far as it can without passing a bound, braking in time and no harder than it has to, and faster
nowhere than it went itself or than a curve allows. It falls behind and makes up for it; it is never
ahead of what it did.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LIMITS", "RUNS_MS", "Limits", "Pace", "curve_speeds", "retimed"]

#: Ways are looked at so finely, metres, and curves over so long a piece, metres.
GRID_M = 0.2
_CURVE_M = 1.6
#: Sideways acceleration that nobody who drives exceeds, m/s2, nor slows down below, m/s.
_SIDEWAYS_MS2, _SLOWEST_MS = 3.2, 1.0
#: Who makes up for time goes a little faster than it did near there: by this share and by so much,
#: m/s, near being so far, metres.
_FASTER, _FASTER_MS, _NEAR_M = 1.1, 0.5, 10.0
#: Nobody on foot is faster, m/s: a gentle run, as of who hurries over a crossing.
RUNS_MS = 2.4
#: Who is less behind than this is where it was, metres; who starts harder than its class by less
#: than this share may.
_SAME_M, _HARDER = 0.005, 1.3
#: How far one looks ahead, seconds.
_AHEAD_S = 10.0


@dataclass(frozen=True)
class Limits:
    """What a class does on its way, m/s2.

    Attributes:
        starts: the most that it speeds up.
        brakes: how hard it brakes, as gently as it can: what is tried one after the other.
    """

    starts: float
    brakes: tuple[float, ...]


_CAR = Limits(3.0, (2.0, 3.0, 4.5, 6.0, 7.5))
_HEAVY = Limits(1.5, (1.5, 2.5, 4.0, 5.5))
#: Cars brake with 7.5 m/s2 and more, and comfortably with 3.4 (AASHTO, Geometric Design of Highways
#: and Streets, 2018, 3.2.2); loaded trucks and buses with 5 to 6 (UN Regulation 13: 5.0 and more);
#: bicycles tip over at 5 to 6 (Wilson, Bicycling Science, 2004, chapter 7).
LIMITS = {
    "car": _CAR,
    "van": _CAR,
    "truck": _HEAVY,
    "bus": _HEAVY,
    "motorcycle": Limits(4.0, (2.0, 3.0, 4.5, 6.0, 7.5)),
    "bicycle": Limits(1.5, (1.5, 2.5, 3.5, 4.5)),
    "pedestrian": Limits(1.2, (1.2, 2.0, 3.0)),
}


@dataclass(frozen=True, eq=False)
class Pace:
    """How an actor may go along its way.

    Attributes:
        at: (N,) how far it went itself by each step, metres, not decreasing.
        speeds: (G,) greatest speed every ``GRID_M`` of the way, m/s.
        step_s: time between steps.
    """

    at: NDArray[np.float64]
    speeds: NDArray[np.float64]
    step_s: float


def curve_speeds(
    at: NDArray[np.float64], yaw: NDArray[np.float64], step_s: float, *, walks: bool
) -> NDArray[np.float64]:
    """Return the greatest speed every ``GRID_M`` of a way (G,), m/s.

    Args:
        at: (N,) how far the actor is at each step, metres, not decreasing.
        yaw: (N,) its heading, rad, continuous.
        step_s: time between steps.
        walks: whether it may turn as sharply as it likes.
    """
    grid = np.arange(0.0, at[-1] + GRID_M, GRID_M)
    went = np.gradient(at, step_s)
    reach = round(_NEAR_M / GRID_M)
    cell = np.minimum((at / GRID_M).astype(int), len(grid) - 1)
    fastest = np.zeros(len(grid))
    np.maximum.at(fastest, cell, went)
    fastest = _most(fastest, reach) * _FASTER + _FASTER_MS
    if walks:
        return np.minimum(fastest, RUNS_MS)
    distinct, group = np.unique(np.round(at, 3), return_inverse=True)
    heading = np.interp(grid, distinct, np.bincount(group, yaw) / np.bincount(group))
    half = round(_CURVE_M / GRID_M / 2)
    padded = np.pad(heading, half, mode="edge")
    turn = np.abs(padded[2 * half :] - padded[: -2 * half]) / (2 * half * GRID_M)
    allowed = np.sqrt(_SIDEWAYS_MS2 / np.maximum(_most(turn, half), 1e-6))
    return np.minimum(fastest, np.maximum(allowed, _SLOWEST_MS))


def retimed(
    pace: Pace,
    bound: NDArray[np.float64],
    limits: Limits,
    begun: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return how far the actor is at each step (N,), metres, of what it can do the gentlest.

    Args:
        pace: how it may go.
        bound: (N,) farther than which it is not to be, metres; infinite where it is free.
        limits: of its class.
        begun: (M,) how far it is at its first steps, whatever comes.
    """
    most = np.minimum(bound, pace.at)
    first = pace.at[:1] if begun is None or not len(begun) else begun
    for brake in limits.brakes:
        at, hardest = _driven(pace, most, first, limits.starts, (brake, limits.brakes[-1]))
        if hardest <= brake * 1.15:
            break
    return at


def _driven(
    pace: Pace,
    most: NDArray[np.float64],
    first: NDArray[np.float64],
    starts: float,
    brakes: tuple[float, float],
) -> tuple[NDArray[np.float64], float]:
    """Return how far one is at each step, and how hard it braked.

    It plans to brake with the one of ``brakes``, and does with the other at the most.
    """
    step_s, count, begun = pace.step_s, len(most), min(len(first), len(most))
    brake, hardest = brakes
    ahead = round(_AHEAD_S / step_s)
    # What the way allows, so that one can brake for what comes.
    allowed = np.square(pace.speeds)
    for k in range(len(allowed) - 2, -1, -1):
        allowed[k] = min(allowed[k], allowed[k + 1] + 2 * brake * GRID_M)
    allowed = np.sqrt(allowed)
    later = step_s * np.arange(0, ahead)
    fallen = brake * later**2 / 2
    slowed = brake * later
    at = np.empty(count)
    follows = _next(_watches(pace, most, starts, hardest))
    at[:begun] = first[:begun]
    early = at[:begun] if begun > 1 else pace.at
    speed = (
        (early[-1] - early[-2]) / step_s if begun > 1 else float(np.diff(early[:2]).sum()) / step_s
    )
    did = 0.0
    k = begun
    while k < count:
        # Where nothing is in the way it goes as it went.
        if follows[k] > k and pace.at[k - 1] - at[k - 1] < _SAME_M:
            at[k : follows[k]] = pace.at[k : follows[k]]
            k = int(follows[k])
            speed = float(pace.at[k - 1] - pace.at[k - 2]) / step_s if k > 1 else speed
            continue
        room = most[k : k + ahead] - at[k - 1]
        n = len(room)
        # Goes on for one step at a speed v, then brakes: never beyond, whether it has come to a
        # standstill by then or not.
        stops = np.sqrt(np.maximum((brake * step_s) ** 2 + 2 * brake * room, 0.0)) - brake * step_s
        goes = (room + fallen[:n]) / (later[:n] + step_s)
        safe = float(np.where(goes >= slowed[:n], goes, stops).min())
        here = allowed[min(int(at[k - 1] / GRID_M), len(allowed) - 1)]
        wanted = min(safe, here, speed + starts * step_s)
        now = max(wanted, speed - hardest * step_s, 0.0)
        did = max(did, (speed - now) / step_s)
        if wanted < now:
            did = max(did, hardest * 2)
        speed = now
        at[k] = at[k - 1] + speed * step_s
        k += 1
    return at, did


def _watches(
    pace: Pace, most: NDArray[np.float64], starts: float, hardest: float
) -> NDArray[np.bool_]:
    """Return in which steps (N,) one has to look ahead: before what it cannot do as it did."""
    speed = np.gradient(pace.at, pace.step_s) if len(most) > 1 else np.zeros(1)
    gain = np.gradient(speed, pace.step_s) if len(most) > 1 else np.zeros(1)
    cell = np.minimum((pace.at / GRID_M).astype(int), len(pace.speeds) - 1)
    hard = (gain < -hardest) | (gain > starts * _HARDER) | (speed > pace.speeds[cell] + 1e-3)
    hard |= most < pace.at - 1e-9
    row = np.arange(len(hard))
    after = _next(hard)
    return np.asarray(after - row <= round(_AHEAD_S / pace.step_s)) & (after < len(hard))


def _next(wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the first wanted row at or after each (N,); N where there is none."""
    row = np.where(wanted, np.arange(len(wanted)), len(wanted))
    return np.asarray(np.minimum.accumulate(row[::-1])[::-1])


def _most(values: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Return the greatest of the values (N,) within so many to each side."""
    padded = np.pad(values, reach, mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1))
