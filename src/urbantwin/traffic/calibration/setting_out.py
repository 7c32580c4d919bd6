"""Accelerations of starting vehicles: of all, or of the first of queues."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from urbantwin.traffic.calibration.passages import SETTLES_S, STANDS_MS, Passage, SeenTrack

__all__ = ["FADES_MS", "FIRST_MS", "first_to_set_out", "setting_out"]

#: Speed ranges in which accelerations are measured, m/s: after the start, and at higher speed.
FIRST_MS, FADES_MS = (1.0, 5.0), (6.0, 9.0)
_STOOD_S = 1.0
#: Time after the stop line during which the first of a queue has no vehicle ahead, seconds.
_NOBODY_AHEAD_S = 8.0


def setting_out(
    vehicles: Iterable[SeenTrack], begin_s: float, end_s: float, speeds_ms: tuple[float, float]
) -> list[float]:
    """Return the mean acceleration between two speeds of each vehicle, m/s2.

    The last acceleration of each counts; from low speeds only after standing.
    """
    rates = (_sets_out(seen, begin_s, end_s, *speeds_ms) for seen in vehicles)
    return [rate for rate in rates if rate is not None]


def first_to_set_out(
    first: Iterable[Passage], begin_s: float, end_s: float, speeds_ms: tuple[float, float]
) -> list[float]:
    """Return the mean acceleration of the first vehicles of queues near the stop line, m/s2."""
    rates = (
        _sets_out(passage.seen, begin_s, min(end_s, passage.passed_s + _NOBODY_AHEAD_S), *speeds_ms)
        for passage in first
    )
    return [rate for rate in rates if rate is not None]


def _sets_out(
    one: SeenTrack, begin_s: float, end_s: float, low_ms: float, high_ms: float
) -> float | None:
    in_span = (one.time_s >= max(begin_s, float(one.time_s[0]) + SETTLES_S)) & (one.time_s < end_s)
    speed, times = np.abs(one.speed[in_span]), one.time_s[in_span]
    slow = np.flatnonzero(speed <= low_ms)
    if not len(slow):
        return None
    stood = times[speed < STANDS_MS]
    if low_ms <= FIRST_MS[0] and (len(stood) < 2 or np.ptp(stood) < _STOOD_S):
        return None
    fast = slow[-1] + np.flatnonzero(speed[slow[-1] :] >= high_ms)
    if not len(fast):
        return None
    ends = [
        float(np.interp(value, speed[k : k + 2], times[k : k + 2]))
        for value, k in ((low_ms, slow[-1]), (high_ms, fast[0] - 1))
    ]
    return (high_ms - low_ms) / (ends[1] - ends[0])
