"""Retiming: the same way, driven later and as its class can drive.

A way is a place as a function of time. Here only the time changes: at each step the actor goes as
far as it can without passing a bound, braking in time and no harder than it has to, and faster
nowhere than it went itself or than a curve allows. It falls behind and makes up for it; it is never
ahead of what it did.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from urbantwin.traffic.compiled.waiting import driven

__all__ = ["BEHIND_M", "LIMITS", "Let", "Limits", "Pace", "Way", "curve_speeds", "retimed"]

#: How far one falls behind at the most, metres.
BEHIND_M = 30.0


@dataclass(frozen=True, eq=False)
class Let:
    """That somebody lets another go first when they meet.

    Attributes:
        first: the other's way.
        since: the step of its own way since which they would lie in each other.
        begin: the first of its steps in which it has to do with the other.
        bound: how far it may be in these steps, metres; infinite where it is free.
    """

    first: int
    since: int
    begin: int
    bound: NDArray[np.float64]

    @property
    def until(self) -> int:
        """The step after the last."""
        return self.begin + len(self.bound)


@dataclass(eq=False)
class Way:
    """Somebody's way while it is there without a gap.

    Attributes:
        number: of the way.
        bodies: (B, N) rows of the columns by time, of whoever goes first and those that it draws.
        kind: its class.
        pace: how it may go.
        at: (N,) how far it is now, metres.
        start: the step of the motion in which it begins.
        lets: whom it lets go first.
    """

    number: int
    bodies: NDArray[np.int64]
    kind: str
    pace: Pace
    at: NDArray[np.float64]
    start: int
    lets: tuple[Let, ...] = ()

    @cached_property
    def _strictly(self) -> NDArray[np.float64]:
        return self.pace.at + 1e-7 * np.arange(len(self.pace.at))

    def between(
        self,
        values: NDArray[Any],
        body: int,
        at: NDArray[np.float64],
        part: slice = slice(None),
    ) -> NDArray[Any]:
        """Return what a body's values (rows, ...) are where the way is so far, in a part of it."""
        strictly = self._strictly[part]
        when = np.interp(at, strictly, np.arange(len(strictly), dtype=np.float64))
        low = np.minimum(when.astype(int), len(strictly) - 1)
        high = np.minimum(low + 1, len(strictly) - 1)
        share = (when - low).reshape(-1, *[1] * (values.ndim - 1))
        mine = values[self.bodies[body][part]]
        return np.asarray(mine[low] + (mine[high] - mine[low]) * share)

    def row_at(self, at: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return when it was so far itself, in its own steps, not whole."""
        return np.interp(at, self._strictly, np.arange(len(self._strictly), dtype=np.float64))

    def part(self, low_m: float, high_m: float) -> slice:
        """Return the steps within which the way goes from one length to another."""
        first, last = np.searchsorted(self._strictly, [low_m, high_m])
        return slice(max(int(first) - 1, 0), int(last) + 2)


#: Ways are looked at so finely, metres, and curves over so long a piece, metres.
GRID_M = 0.2
_CURVE_M = 1.6
#: Sideways acceleration that nobody who drives exceeds, m/s2, nor slows down below, m/s.
_SIDEWAYS_MS2, _SLOWEST_MS = 3.2, 1.0
#: Who makes up for time goes a little faster than it did near there: by this share and by so much,
#: m/s, near being so far, metres.
_FASTER, _FASTER_MS, _NEAR_M = 1.1, 0.5, 10.0
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

    def allowed(self, brake: float) -> NDArray[np.float64]:
        """Return the greatest speed (G,) with which one can brake so for what comes, m/s."""
        reach = 2 * brake * GRID_M * np.arange(len(self.speeds))
        least = np.minimum.accumulate((np.square(self.speeds) + reach)[::-1])[::-1]
        return np.asarray(np.sqrt(least - reach))


def curve_speeds(
    at: NDArray[np.float64], yaw: NDArray[np.float64], step_s: float
) -> NDArray[np.float64]:
    """Return the greatest speed every ``GRID_M`` of a way (G,), m/s.

    Args:
        at: (N,) how far the actor is at each step, metres, not decreasing.
        yaw: (N,) its heading, rad, continuous.
        step_s: time between steps.
    """
    grid = np.arange(0.0, at[-1] + GRID_M, GRID_M)
    went = np.gradient(at, step_s)
    reach = round(_NEAR_M / GRID_M)
    cell = np.minimum((at / GRID_M).astype(int), len(grid) - 1)
    fastest = np.zeros(len(grid))
    np.maximum.at(fastest, cell, went)
    fastest = _most(fastest, reach) * _FASTER + _FASTER_MS
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
    was: NDArray[np.float64] | None = None,
    since: int = 1,
    until: int | None = None,
) -> NDArray[np.float64]:
    """Return how far the actor is at each step (N,), metres, of what it can do the gentlest.

    Args:
        pace: how it may go.
        bound: (N,) farther than which it is not to be, metres; infinite where it is free.
        limits: of its class.
        was: (N,) how far it was so far; as ``pace`` says, where not given.
        since: the first step that may be another.
        until: the step from which on it does as it did, once it is where it was.
    """
    most = np.minimum(bound, pace.at)
    was = pace.at if was is None else was
    until = len(most) if until is None else until
    hard = _hard(pace, limits)
    hard |= most < pace.at - 1e-9
    ahead = round(_AHEAD_S / pace.step_s)
    for brake in limits.brakes:
        allowed = pace.allowed(brake)
        at, hardest = driven(
            pace.at, most, was, hard, allowed, since, until, ahead, pace.step_s, GRID_M,
            limits.starts, brake, limits.brakes[-1], _SAME_M,
        )  # fmt: skip
        if hardest <= brake * 1.15:
            break
    return np.asarray(at)


def _hard(pace: Pace, limits: Limits) -> NDArray[np.bool_]:
    """Return in which steps (N,) the actor does what its class does not."""
    if len(pace.at) < 2:
        return np.zeros(len(pace.at), np.bool_)
    speed = np.gradient(pace.at, pace.step_s)
    gain = np.gradient(speed, pace.step_s)
    cell = np.minimum((pace.at / GRID_M).astype(int), len(pace.speeds) - 1)
    fast = speed > pace.speeds[cell] + 1e-3
    return np.asarray((gain < -limits.brakes[-1]) | (gain > limits.starts * _HARDER) | fast)


def _most(values: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Return the greatest of the values (N,) within so many to each side."""
    return np.asarray(maximum_filter1d(values, 2 * reach + 1, mode="nearest"))
