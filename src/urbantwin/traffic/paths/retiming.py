"""Retiming: the same path, driven later and within the limits of its class.

A path gives the position as a function of time. Here only the time changes: at each step the actor
moves as far as possible without passing a bound. It brakes in time and as gently as possible, and
nowhere exceeds its original speed or that of curves. It falls behind and catches up; it is never
ahead of the original.
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

#: Maximum delay, metres.
BEHIND_M = 30.0


@dataclass(frozen=True, eq=False)
class Let:
    """A constraint to yield to another actor.

    Attributes:
        first: number of the other's path.
        since: own step of the first overlap.
        begin: first own step of the constraint.
        bound: maximum position in these steps, metres; infinite without a bound.
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
    """The path of a vehicle during a visit without gaps.

    Attributes:
        number: number of the path.
        bodies: (B, N) rows of the columns by time, of the first body and the towed ones.
        kind: its class.
        pace: its original progress and speed limits.
        at: (N,) current position along the path, metres.
        start: step of the motion in which it begins.
        lets: constraints to yield to others.
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
        """Return a body's values (rows, ...) at positions along the path, within a part of it."""
        strictly = self._strictly[part]
        when = np.interp(at, strictly, np.arange(len(strictly), dtype=np.float64))
        low = np.minimum(when.astype(int), len(strictly) - 1)
        high = np.minimum(low + 1, len(strictly) - 1)
        share = (when - low).reshape(-1, *[1] * (values.ndim - 1))
        body_values = values[self.bodies[body][part]]
        return np.asarray(body_values[low] + (body_values[high] - body_values[low]) * share)

    def row_at(self, at: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the fractional own step at which the original reached positions."""
        return np.interp(at, self._strictly, np.arange(len(self._strictly), dtype=np.float64))

    def part(self, low_m: float, high_m: float) -> slice:
        """Return the steps within which the path goes from one position to another."""
        first, last = np.searchsorted(self._strictly, [low_m, high_m])
        return slice(max(int(first) - 1, 0), int(last) + 2)


#: Resolution of paths, metres, and length over which curvature is taken, metres.
GRID_M = 0.2
_CURVE_M = 1.6
#: Maximum lateral acceleration, m/s2, and least speed limit by curves, m/s.
_MAX_LATERAL_MS2, _MIN_CURVE_SPEED_MS = 3.2, 1.0
#: Factor and increment, m/s, on the original speed within a distance, metres, for catching up.
_CATCH_UP_FACTOR, _CATCH_UP_MS, _CATCH_UP_RANGE_M = 1.1, 0.5, 10.0
#: Delay below which an actor counts as on time, metres; factor on a class's acceleration that is
#: tolerated.
_ON_TIME_M, _TOLERATED_FACTOR = 0.005, 1.3
#: Look-ahead time, seconds.
_LOOK_AHEAD_S = 10.0


@dataclass(frozen=True)
class Limits:
    """Limits of a class, m/s2.

    Attributes:
        starts: maximum acceleration.
        brakes: decelerations to try, the gentlest first.
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
    """Progress of an actor along its path, and its speed limits.

    Attributes:
        at: (N,) original position at each step, metres, not decreasing.
        speeds: (G,) maximum speed every ``GRID_M`` of the path, m/s.
        step_s: time between steps, seconds.
    """

    at: NDArray[np.float64]
    speeds: NDArray[np.float64]
    step_s: float

    def allowed(self, brake: float) -> NDArray[np.float64]:
        """Return the maximum speed (G,) from which later limits are reached with a braking, m/s."""
        reach = 2 * brake * GRID_M * np.arange(len(self.speeds))
        least = np.minimum.accumulate((np.square(self.speeds) + reach)[::-1])[::-1]
        return np.asarray(np.sqrt(least - reach))


def curve_speeds(
    at: NDArray[np.float64], yaw: NDArray[np.float64], step_s: float
) -> NDArray[np.float64]:
    """Return the maximum speed every ``GRID_M`` of a path (G,), m/s.

    Args:
        at: (N,) position of the actor at each step, metres, not decreasing.
        yaw: (N,) its heading, rad, continuous.
        step_s: time between steps, seconds.
    """
    grid = np.arange(0.0, at[-1] + GRID_M, GRID_M)
    speed = np.gradient(at, step_s)
    reach = round(_CATCH_UP_RANGE_M / GRID_M)
    cell = np.minimum((at / GRID_M).astype(int), len(grid) - 1)
    fastest = np.zeros(len(grid))
    np.maximum.at(fastest, cell, speed)
    fastest = _max_around(fastest, reach) * _CATCH_UP_FACTOR + _CATCH_UP_MS
    distinct, group = np.unique(np.round(at, 3), return_inverse=True)
    heading = np.interp(grid, distinct, np.bincount(group, yaw) / np.bincount(group))
    half = round(_CURVE_M / GRID_M / 2)
    padded = np.pad(heading, half, mode="edge")
    turn = np.abs(padded[2 * half :] - padded[: -2 * half]) / (2 * half * GRID_M)
    allowed = np.sqrt(_MAX_LATERAL_MS2 / np.maximum(_max_around(turn, half), 1e-6))
    return np.minimum(fastest, np.maximum(allowed, _MIN_CURVE_SPEED_MS))


def retimed(
    pace: Pace,
    bound: NDArray[np.float64],
    limits: Limits,
    was: NDArray[np.float64] | None = None,
    since: int = 1,
    until: int | None = None,
) -> NDArray[np.float64]:
    """Return the actor's position at each step (N,), metres, with the gentlest sufficient braking.

    Args:
        pace: its progress and speed limits.
        bound: (N,) maximum positions, metres; infinite without a bound.
        limits: limits of its class.
        was: (N,) its current positions; ``None``: those of ``pace``.
        since: first step that may change.
        until: step from which the current positions are kept, once they are reached.
    """
    most = np.minimum(bound, pace.at)
    was = pace.at if was is None else was
    until = len(most) if until is None else until
    hard = _exceeds_limits(pace, limits)
    hard |= most < pace.at - 1e-9
    ahead = round(_LOOK_AHEAD_S / pace.step_s)
    for brake in limits.brakes:
        allowed = pace.allowed(brake)
        position, hardest = driven(
            pace.at, most, was, hard, allowed, since, until, ahead, pace.step_s, GRID_M,
            limits.starts, brake, limits.brakes[-1], _ON_TIME_M,
        )  # fmt: skip
        if hardest <= brake * 1.15:
            break
    return np.asarray(position)


def _exceeds_limits(pace: Pace, limits: Limits) -> NDArray[np.bool_]:
    """Return the steps (N,) in which the actor exceeds its class's limits."""
    if len(pace.at) < 2:
        return np.zeros(len(pace.at), np.bool_)
    speed = np.gradient(pace.at, pace.step_s)
    gain = np.gradient(speed, pace.step_s)
    cell = np.minimum((pace.at / GRID_M).astype(int), len(pace.speeds) - 1)
    fast = speed > pace.speeds[cell] + 1e-3
    return np.asarray(
        (gain < -limits.brakes[-1]) | (gain > limits.starts * _TOLERATED_FACTOR) | fast
    )


def _max_around(values: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Return the greatest of the values (N,) within a number of steps to each side."""
    return np.asarray(maximum_filter1d(values, 2 * reach + 1, mode="nearest"))
