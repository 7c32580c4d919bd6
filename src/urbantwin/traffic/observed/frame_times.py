"""When frames were taken, and which of them are so near in time that one is followed through them.

Over a gap nobody is followed: who stands in the place of another would be taken for it, and nobody
has a speed. Both sides of it are looks of their own.
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

#: Over more than this a vehicle is anybody's, seconds: it drives 40 m meanwhile.
LONGEST_S = 2.5
_EXPECTED = "a table with the columns frame and seconds, ascending, of every frame"
_SECONDS = ("seconds", "time_s")
_MOST_BYTES, _MOST_S = 1 << 26, 1e12


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """Moments of frames.

    Attributes:
        time_s: (N,) ascending, seconds from the first one. Where nobody said how long a gap is, it
            counts as long as the others.
        gap: (N - 1,) whether one is followed by a gap.
        confidence: (N - 1,) how likely `gap` is right, 0.5 to 1; ``None`` where times were told.
        told: whether somebody said when frames were taken.
    """

    time_s: NDArray[np.float64]
    gap: NDArray[np.bool_]
    confidence: NDArray[np.float64] | None = None
    told: bool = False

    def group(self) -> NDArray[np.int64]:
        """Return (N,) numbers of the frames without a gap between them, from 0."""
        return np.concatenate([[0], np.cumsum(self.gap)]).astype(np.int64)


def evenly_spaced(count: int, rate_hz: float) -> FrameTimes:
    """Return the times of frames at a rate; gaps are between all of them if it is too slow."""
    slow = 1 / rate_hz > LONGEST_S
    return FrameTimes(np.arange(count) / rate_hz, np.full(max(count - 1, 0), slow))


def read_frame_times(file: Path, names: Sequence[str]) -> FrameTimes:
    """Return the times of frames from a table: ``frame``, and ``seconds`` or ``time_s``.

    Frames are named as their files, with or without the ending; of several rows of a frame, as in
    the ``frames.csv`` of our own exports, the first counts. Between steps longer than 2.5 s is a
    gap.

    Args:
        file: the table, CSV.
        names: of the frames, in order.

    Raises:
        InputError: it cannot be read, a frame is missing, or time does not go on.
    """
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise InputError("is too large", file=file, expected=_EXPECTED)
        rows = list(csv.DictReader(file.read_text("utf-8-sig").splitlines(), strict=True))
    except (OSError, UnicodeDecodeError, csv.Error):
        raise InputError("cannot be read", file=file, expected=_EXPECTED) from None
    column = next((one for one in _SECONDS if rows and one in rows[0]), None)
    if column is None or "frame" not in rows[0]:
        raise InputError("lacks columns or rows", file=file, expected=_EXPECTED)
    told: dict[str, float] = {}
    for line, row in enumerate(rows, 2):
        try:
            seconds = float(row[column])
        except (TypeError, ValueError):
            seconds = math.nan
        if not abs(seconds) < _MOST_S:
            place = f"line {line}"
            raise InputError("has no time", file=file, place=place, expected="seconds")
        told.setdefault(_name(row["frame"] or ""), seconds)
    missing = [name for name in names if _name(name) not in told]
    if missing:
        raise InputError(f"does not say when frame {missing[0]} was taken", file=file,
                         expected=_EXPECTED)  # fmt: skip
    time_s = np.array([told[_name(name)] for name in names])
    passed = np.diff(time_s)
    if (back := np.flatnonzero(passed <= 0)).size:
        raise InputError(
            f"frame {names[back[0] + 1]} is not later than {names[back[0]]}",
            file=file,
            expected="frames in the order of time",
        )
    return FrameTimes(time_s - time_s[0], passed > LONGEST_S, told=True)


def _name(frame: str) -> str:
    """Return what a frame is called, without the ending of a file."""
    return Path(frame.strip()).stem
