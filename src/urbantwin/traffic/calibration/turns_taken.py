"""Lateral accelerations and speeds of unhindered vehicles in turns."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from urbantwin.traffic.calibration.passages import SETTLES_S, Passage

__all__ = ["turns_taken"]

_Movement = tuple[str, str]
#: Least change of heading of a turn, rad, and speed below which a vehicle was held up, m/s.
_MIN_TURN_RAD, _HELD_UP_MS = 0.8, 2.5


def turns_taken(
    passages: Sequence[Passage], begin_s: float, end_s: float
) -> tuple[dict[_Movement, list[float]], dict[_Movement, list[float]]]:
    """Return lateral accelerations and speeds of unhindered vehicles in turns, by movement.

    Args:
        passages: all passages.
        begin_s: begin of the span.
        end_s: end of the span.

    Returns:
        80 % quantiles of lateral acceleration in a turn, m/s2; and 20 % quantiles of speed, m/s.
    """
    accelerations: dict[_Movement, list[float]] = defaultdict(list)
    speeds: dict[_Movement, list[float]] = defaultdict(list)
    for passage in passages:
        turn = _in_a_turn(passage, begin_s, end_s)
        if turn is not None:
            accelerations[passage.approach, passage.leaving].append(turn[0])
            speeds[passage.approach, passage.leaving].append(turn[1])
    return dict(accelerations), dict(speeds)


def _in_a_turn(one: Passage, begin_s: float, end_s: float) -> tuple[float, float] | None:
    seen = one.seen
    first = max(begin_s, float(seen.time_s[0]) + SETTLES_S)
    rows = slice(*np.searchsorted(seen.time_s, [first, end_s]).tolist())
    times, speed = seen.time_s[rows], np.abs(seen.speed[rows])
    if len(times) < 3:
        return None
    # Resampled, since headings of trackers and of SUMO change in steps.
    times_s = np.arange(times[0], times[-1] + 1e-9, 0.5)
    if len(times_s) < 4:
        return None
    yaw = np.interp(times_s, times, np.unwrap(seen.yaw[rows]))
    pace = np.interp(times_s, times, speed)[1:-1]
    rate = np.abs(yaw[2:] - yaw[:-2]) / (times_s[2:] - times_s[:-2])
    turns = rate > _MIN_TURN_RAD / 10
    if np.ptp(yaw) < _MIN_TURN_RAD or not turns.any() or pace[turns].min() < _HELD_UP_MS:
        return None
    return float(np.quantile((rate * pace)[turns], 0.8)), float(np.quantile(pace[turns], 0.2))
