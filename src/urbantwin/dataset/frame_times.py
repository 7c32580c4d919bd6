"""Which frames a span of a motion has."""

from __future__ import annotations

import math
from typing import Any

from urbantwin.dataset.motion_interpolation import SAME_TIME_S
from urbantwin.errors import InputError

__all__ = ["frame_times"]


def frame_times(
    rate_hz: float,
    start_s: float,
    stop_s: float | None,
    steps_s: Any,  # noqa: ANN401
) -> dict[int, float]:
    """Return the number of each frame and its time: the multiples of 1 / rate within the span.

    Raises:
        InputError: the span is empty or leaves the motion.
    """
    if not len(steps_s):
        raise InputError("the motion has no steps", expected="a motion with traffic")
    first, last = float(steps_s[0]), float(steps_s[-1])
    stop = last if stop_s is None else stop_s
    span = f"a span within the motion's {first:g} to {last:g} s"
    if not (math.isfinite(start_s) and math.isfinite(stop)):
        raise InputError(f"{start_s} to {stop} s is not a span", place="start_s", expected=span)
    if start_s < first - SAME_TIME_S:
        raise InputError(f"{start_s:g} s is before the motion", place="start_s", expected=span)
    if stop > last + SAME_TIME_S:
        raise InputError(f"{stop:g} s is after the motion", place="stop_s", expected=span)
    low = math.ceil((start_s - SAME_TIME_S) * rate_hz)
    high = math.floor((stop + SAME_TIME_S) * rate_hz)
    if high < low:
        raise InputError(
            f"no frame at {rate_hz:g} Hz lies in {start_s:g} to {stop:g} s",
            place="stop_s",
            expected=span,
        )
    return {index: index / rate_hz for index in range(low, high + 1)}
