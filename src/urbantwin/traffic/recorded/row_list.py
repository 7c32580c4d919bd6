"""Rows of tracks collected one after the other, from formats that are no tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.traffic.recorded.track import RecordedRows

__all__ = ["RowList", "yaw_of_quaternion"]

_UNKNOWN = (math.nan, math.nan, math.nan)


@dataclass
class RowList:
    """Collects rows of a file."""

    file: Path
    expected: str
    rows: list[tuple[str, float, str, float, float, float, float, float, float, float]] = field(
        default_factory=list
    )
    places: list[str] = field(default_factory=list)

    def add(
        self,
        place: str,
        track: str,
        time_s: float,
        kind: str,
        xyz: Sequence[float],
        yaw: float = math.nan,
        size: Sequence[float] = _UNKNOWN,
    ) -> None:
        """Add a row; ``place`` says where in the file it stands.

        Raises:
            InputError: a number is missing, or is none.
        """
        numbers = (time_s, *xyz, yaw, *size)
        if len(xyz) != 3 or len(size) != 3 or not all(_is_number(one) for one in numbers):
            raise self.error(place, "holds something else than numbers")
        if not all(math.isfinite(one) for one in (time_s, *xyz[:2])):
            raise self.error(place, "has a number that is not finite")
        self.places.append(place)
        x, y, z = map(float, xyz)
        length, width, height = map(float, size)
        self.rows.append(
            (str(track), float(time_s), str(kind), x, y, z, float(yaw), length, width, height)
        )

    def error(self, place: str, problem: str) -> InputError:
        """Return the error to raise for a place in the file."""
        return InputError(problem, file=self.file, place=place, expected=self.expected)

    def made(self) -> RecordedRows:
        """Return the rows, track by track in the order of time.

        Raises:
            InputError: there are none.
        """
        if not self.rows:
            raise InputError("has no tracks", file=self.file, expected=self.expected)
        rows = sorted(zip(self.rows, self.places, strict=True), key=lambda one: one[0][1])
        columns = list(zip(*(row for row, _ in rows), strict=True))
        numbers = np.array(columns[3:], np.float64)
        places = [place for _, place in rows]
        return RecordedRows(
            self.file,
            np.array(columns[0], object),
            np.array(columns[1], np.float64),
            np.array(columns[2], object),
            numbers[:3].T,
            numbers[3],
            numbers[4:].T,
            lambda row: places[row],
        )


def yaw_of_quaternion(w: float, x: float, y: float, z: float) -> float:
    """Return the heading of a quaternion, rad: of its x axis in plan."""
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
