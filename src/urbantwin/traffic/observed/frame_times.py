"""Times of frames, and gaps over which objects are not tracked.

Over a gap objects are not associated, since another object in the same place would be mistaken for
the first, and speeds are unknown. Both sides of a gap are separate observations.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = ["LONGEST_S", "FrameTimes", "evenly_spaced", "read_frame_times"]

#: Maximum time between tracked frames, seconds: a vehicle drives up to 40 m meanwhile.
LONGEST_S = 2.5
_EXPECTED = "a table with the columns frame and seconds, ascending, of every frame"
_TIME_COLUMNS = ("seconds", "time_s")
_MAX_BYTES, _MAX_SECONDS = 1 << 26, 1e12


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """Times of frames.

    Attributes:
        time_s: (N,) ascending, seconds from the first. A gap of unknown duration counts like the
            other steps.
        gap: (N - 1,) whether there is a gap after the frame.
        confidence: (N - 1,) probability that `gap` is right, 0.5 to 1; ``None`` if times are given.
        told: whether the times were given by the user.
    """

    time_s: NDArray[np.float64]
    gap: NDArray[np.bool_]
    confidence: NDArray[np.float64] | None = None
    told: bool = False

    def group(self) -> NDArray[np.int64]:
        """Return (N,) numbers of groups of frames without gaps, from 0."""
        return np.concatenate([[0], np.cumsum(self.gap)]).astype(np.int64)


def evenly_spaced(count: int, rate_hz: float) -> FrameTimes:
    """Return the times of frames at a rate; all steps are gaps if it is too low."""
    slow = 1 / rate_hz > LONGEST_S
    return FrameTimes(np.arange(count) / rate_hz, np.full(max(count - 1, 0), slow))


def read_frame_times(file: Path, names: Sequence[str]) -> FrameTimes:
    """Return the times of frames from a table with ``frame``, and ``seconds`` or ``time_s``.

    Frames are named like their files, with or without extension. Of several rows of a frame, as in
    the ``frames.csv`` of UrbanTwin's exports, the first counts. Steps longer than 2.5 s are gaps.

    Args:
        file: the table, CSV.
        names: names of the frames, in order.

    Raises:
        InputError: it cannot be read, a frame is missing, or times do not ascend.
    """
    try:
        if file.stat().st_size > _MAX_BYTES:
            raise InputError("is too large", file=file, expected=_EXPECTED)
        rows = list(csv.DictReader(file.read_text("utf-8-sig").splitlines(), strict=True))
    except (OSError, UnicodeDecodeError, csv.Error):
        raise InputError("cannot be read", file=file, expected=_EXPECTED) from None
    column = next((name for name in _TIME_COLUMNS if rows and name in rows[0]), None)
    if column is None or "frame" not in rows[0]:
        raise InputError("lacks columns or rows", file=file, expected=_EXPECTED)
    seconds_of: dict[str, float] = {}
    for line, row in enumerate(rows, 2):
        try:
            seconds = float(row[column])
        except (TypeError, ValueError):
            seconds = math.nan
        if not abs(seconds) < _MAX_SECONDS:
            place = f"line {line}"
            raise InputError("has no time", file=file, place=place, expected="seconds")
        seconds_of.setdefault(_name(row["frame"] or ""), seconds)
    missing = [name for name in names if _name(name) not in seconds_of]
    if missing:
        raise InputError(f"does not say when frame {missing[0]} was taken", file=file,
                         expected=_EXPECTED)  # fmt: skip
    time_s = np.array([seconds_of[_name(name)] for name in names])
    passed = np.diff(time_s)
    if (back := np.flatnonzero(passed <= 0)).size:
        raise InputError(
            f"frame {names[back[0] + 1]} is not later than {names[back[0]]}",
            file=file,
            expected="frames in the order of time",
        )
    return FrameTimes(time_s - time_s[0], passed > LONGEST_S, told=True)


def _name(frame: str) -> str:
    """Return the name of a frame, without a file's extension."""
    return Path(frame.strip()).stem
